"use strict";
/** The skin under the press, drawn on a canvas: from the farthest triangle to the nearest. */
const makeSkin = ({ data, state, element, isShown, colour }) => {
  const START = { turn: -0.9, tilt: 0.7, zoom: 1 };
  const TOOL = "#597399", BETWEEN_MS = 250;
  let playing = 0;
  const eye = { ...START }, known = new Map();
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
  const scale = data.colours.map(rgb);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  /** Numbers of two bytes each, as they were before they were packed. */
  function unpacked({ scale: worth, data: packed }) {
    const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
    return Float32Array.from(new Int16Array(bytes.buffer), (v) => v * worth);
  }

  function skinAt(spot) {
    const skin = data.skins[spot];
    if (skin && !known.has(spot)) {
      const [points, displacements, pressures] = ["points", "displacements", "pressures"].map((name) => unpacked(skin[name]));
      const moves = Float32Array.from(pressures, (_, i) => Math.hypot(...displacements.subarray(3 * i, 3 * i + 3)));
      known.set(spot, { ...skin, points, displacements, quantities: { displacement: moves, pressure: pressures, slip: slips({ ...skin, points, displacements, pressures }) } });
    }
    return known.get(spot);
  }

  /** Distance along the tool that each point in contact has slipped since the deepest state. */
  function slips({ n, first, points, displacements, pressures, positions, rotations }) {
    const inTool = (step, i) => {
      const p = [0, 1, 2].map((d) => points[3 * i + d] + displacements[3 * (step * n + i) + d] - positions[step][d]);
      return [0, 1, 2].map((k) => dot(p, rotations[step].map((row) => row[k])));
    };
    return Float32Array.from(pressures, (pressure, at) => {
      const [step, i] = [Math.floor(at / n), at % n];
      if (step <= first || !(pressure > 0 && pressures[first * n + i] > 0)) return 0;
      const [a, b] = [inTool(step, i), inTool(first, i)];
      return Math.hypot(...a.map((x, d) => x - b[d]));
    });
  }

  /** Axes of the view: to the right, up, and towards the eye. */
  function view() {
    const [s, c] = [Math.sin(eye.turn), Math.cos(eye.turn)], [st, ct] = [Math.sin(eye.tilt), Math.cos(eye.tilt)];
    return [[-s, c, 0], [-st * c, -st * s, ct], [ct * c, ct * s, st]];
  }

  /** Middle of the whole skin and of the indenter as seen along these axes, and their width and height. */
  function extent(skin, axes) {
    const { first, positions, rotations } = skin, seen = [];
    for (let i = 0; i < skin.n; i += 1) seen.push(skin.points.subarray(3 * i, 3 * i + 3));
    skin.indenter.forEach((x) => seen.push(positions[first].map((o, d) => o + dot(rotations[first][d], x))));
    return [0, 1].map((k) => {
      const along = seen.map((p) => dot(axes[k], p)), [low, high] = [along.reduce((a, b) => Math.min(a, b)), along.reduce((a, b) => Math.max(a, b))];
      return { middle: (low + high) / 2, length: Math.max(high - low, 1e-9) };
    });
  }

  /** Corners of the smallest convex shape around points of the plane (Andrew, 1979). */
  function hull(points) {
    const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const turnsRight = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0;
    const half = (list) => list.reduce((found, p) => {
      while (found.length > 1 && turnsRight(found[found.length - 2], found[found.length - 1], p)) found.pop();
      return [...found, p];
    }, []).slice(0, -1);
    return [...half(sorted), ...half(sorted.reverse())];
  }

  function paintTriangles(context, skin, step, place, axes, values, most) {
    const n = skin.n, at = [], corners = skin.triangles;
    for (let i = 0; i < n; i += 1) {
      const p = [0, 1, 2].map((d) => skin.points[3 * i + d] + skin.displacements[3 * (step * n + i) + d]);
      at.push(axes.map((axis) => dot(axis, p)));
    }
    const order = Array.from({ length: corners.length / 3 }, (_, t) => t);
    const depth = order.map((t) => at[corners[3 * t]][2] + at[corners[3 * t + 1]][2] + at[corners[3 * t + 2]][2]);
    order.sort((a, b) => depth[a] - depth[b]);
    context.lineWidth = 0.7;
    order.forEach((t) => {
      const [i, j, k] = [0, 1, 2].map((d) => corners[3 * t + d]), [a, b, c] = [at[i], at[j], at[k]];
      const [u, v] = [[0, 1, 2].map((d) => b[d] - a[d]), [0, 1, 2].map((d) => c[d] - a[d])];
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const light = 0.65 + 0.35 * Math.abs(normal[2] * 0.8 + normal[1] * 0.6) / (Math.hypot(...normal) || 1);
      const mean = (values[step * n + i] + values[step * n + j] + values[step * n + k]) / 3;
      const tint = scale[Math.round(Math.min(1, Math.max(0, mean / most)) * (scale.length - 1))];
      context.fillStyle = context.strokeStyle = `rgb(${tint.map((part) => Math.round(part * light)).join(",")})`;
      context.beginPath();
      [a, b, c].forEach((p) => context.lineTo(...place(p)));
      context.closePath();
      context.fill();
      context.stroke();
    });
  }

  /** The indenter as one sees it from here: lit from above, and glass over the skin that it touches. */
  function paintIndenter(context, skin, step, place, axes) {
    const { positions, rotations } = skin, seen = skin.indenter.map((x) => {
      const p = positions[step].map((o, d) => o + dot(rotations[step][d], x));
      return place(axes.map((axis) => dot(axis, p)));
    });
    context.strokeStyle = TOOL;
    context.lineWidth = 1.4;
    context.beginPath();
    hull(seen).forEach((p) => context.lineTo(...p));
    context.closePath();
    const [top, bottom] = [Math.min(...seen.map((p) => p[1])), Math.max(...seen.map((p) => p[1]))];
    const light = context.createLinearGradient(0, top, 0, bottom);
    light.addColorStop(0, "#a9bcd9");
    light.addColorStop(0.5, TOOL);
    light.addColorStop(1, "#2f3f5c");
    context.globalAlpha = 0.55;
    context.fillStyle = light;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
  }

  function paintScale(context, width, height, most, unit) {
    const [high, wide, left, top] = [0.5 * height, 12, width - 70, 0.25 * height];
    scale.forEach((tint, k) => {
      context.fillStyle = `rgb(${tint.join(",")})`;
      context.fillRect(left, top + high * (1 - (k + 1) / scale.length), wide, high / scale.length + 1);
    });
    context.fillStyle = colour("ink");
    context.font = "12px system-ui, sans-serif";
    [[0, "0"], [0.5, String(Number((most / 2).toPrecision(2)))], [1, String(Number(most.toPrecision(2)))]].forEach(([share, text]) => {
      context.fillText(text, left + wide + 4, top + high * (1 - share) + 4);
    });
    context.fillText(`(${unit})`, left, top - 10);
  }

  function draw() {
    if (!isShown("skin")) return;
    const canvas = element("skin"), slider = element("skin-step"), skin = skinAt(state.spot);
    element("skin-missing").hidden = Boolean(skin);
    canvas.hidden = !skin;
    if (!skin) { element("skin-label").textContent = ""; return; }
    if (Number(slider.dataset.spot ?? -1) !== state.spot) {
      slider.max = skin.labels.length - 1;
      slider.value = skin.first;
      slider.dataset.spot = state.spot;
    }
    const step = Number(slider.value), quantity = element("skin-quantity").value, values = skin.quantities[quantity];
    const unit = quantity === "pressure" ? skin.unit : "mm", most = values.reduce((a, b) => Math.max(a, b), 1e-12);
    const now = values.subarray(step * skin.n, (step + 1) * skin.n).reduce((a, b) => Math.max(a, b), 0);
    const what = { pressure: "contact pressure", displacement: "displacement", slip: "slip" }[quantity];
    element("skin-label").textContent = `${skin.labels[step]}: largest ${what} ${Number(now.toPrecision(3))} ${unit}`;
    canvas.setAttribute("aria-label", `Skin under the indenter at ${element("skin-label").textContent}`);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight], fine = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [width * fine, height * fine];
    const context = canvas.getContext("2d"), axes = view(), right = width - 80;
    const [across, up] = extent(skin, axes), size = 0.96 * eye.zoom * Math.min(right / across.length, height / up.length);
    context.scale(fine, fine);
    // All of it at first; what comes closer is the spot.
    const place = (p) => [0.5 * right + size * (p[0] - across.middle / eye.zoom), 0.5 * height - size * (p[1] - up.middle / eye.zoom)];
    context.save();
    context.beginPath();
    context.rect(0, 0, right, height); // the scale stays readable
    context.clip();
    paintTriangles(context, skin, step, place, axes, values, most);
    if (skin.indenter.length) paintIndenter(context, skin, step, place, axes);
    context.restore();
    paintScale(context, width, height, most, unit);
  }

  function turn(way) {
    const move = { left: ["turn", -0.3], right: ["turn", 0.3], up: ["tilt", 0.15], down: ["tilt", -0.15] }[way];
    if (move) eye[move[0]] += move[1];
    else eye.zoom *= way === "in" ? 1.2 : 1 / 1.2;
    eye.tilt = Math.min(1.5, Math.max(-0.2, eye.tilt));
    draw();
  }

  /** Show one state after the other, or stop. */
  function play() {
    const button = element("skin-play"), slider = element("skin-step");
    button.textContent = playing ? "Play" : "Pause";
    if (playing) {
      clearInterval(playing);
      playing = 0;
      return;
    }
    playing = setInterval(() => {
      slider.value = Number(slider.value) < Number(slider.max) ? Number(slider.value) + 1 : 0;
      draw();
    }, BETWEEN_MS);
  }

  function listen() {
    element("skin-play")?.addEventListener("click", play);
    ["skin-step", "skin-quantity"].forEach((id) => element(id)?.addEventListener("input", draw));
    document.querySelectorAll("[data-turn-skin]").forEach((b) => b.addEventListener("click", () => turn(b.dataset.turnSkin)));
  }

  function reset() {
    Object.assign(eye, START);
    delete element("skin-step")?.dataset.spot;
  }

  return { draw, listen, reset };
};
