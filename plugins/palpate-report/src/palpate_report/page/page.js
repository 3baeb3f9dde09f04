"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const DASHES = ["solid", "dash"];
  const MOST_LISTED = 12;
  const state = { spot: 0, scenario: data.generalising, selected: null };
  const element = (id) => document.getElementById(id);
  // The library reads some marks in its texts as HTML; a name is a name.
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const four = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(4))));
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  // ------------------------------------------------------------------ what all figures share

  const isNarrow = () => window.innerWidth < 560;

  function layout(more) {
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true,
      font: { color: colour("ink"), family: "system-ui, sans-serif", size: isNarrow() ? 11 : 13 },
      margin: { l: isNarrow() ? 48 : 60, r: 12, t: isNarrow() ? 12 : 32, b: 48 }, showlegend: false, hovermode: "closest",
      hoverlabel: { bgcolor: colour("panel"), bordercolor: colour("soft"), font: { color: colour("ink") } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("ink") },
    };
    return Object.assign(base, more);
  }

  function axis(title, more) {
    const look = { title: { text: plain(title), standoff: 6 }, gridcolor: colour("grid"), zerolinecolor: colour("rule"),
      linecolor: colour("soft"), showline: true, automargin: true, exponentformat: "power" };
    return Object.assign(look, more);
  }

  const FLAT = [["toImage"], ["zoom2d", "pan2d", "select2d", "lasso2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"]];
  const DEEP = [["toImage"], ["orbitRotation", "pan3d", "zoom3d"], ["resetCameraDefault3d"]];

  const config = (name) => ({
    responsive: true, displaylogo: false, displayModeBar: isNarrow() ? false : "hover", showSendToCloud: false,
    modeBarButtons: name === "around" ? DEEP : data.sets.ids.length && name === "pairs" ? FLAT : FLAT.map((group) => group.filter((b) => !/^(select|lasso)/.test(b))), toImageButtonOptions: { format: name === "around" ? "png" : "svg", filename: name },
  });

  let drawing = 0;

  /** Whether a figure is there and not in a section that is folded, where it has no size. */
  const isShown = (id) => element(id) !== null && element(id).closest("details:not([open])") === null;

  /** While it draws, the library reports selections that the user has not made. */
  function draw(id, traces, shape) {
    drawing += 1;
    const pictures = () => element(id).querySelectorAll(".main-svg").forEach((svg) => svg.setAttribute("aria-hidden", "true"));
    Plotly.react(element(id), traces, shape, config(id)).then(pictures).finally(() => { drawing -= 1; });
  }

  function line(name, x, y, look) {
    return { type: "scatter", mode: "lines", name: plain(name), x, y, line: look,
      hovertemplate: "%{x:.4g}, %{y:.4g}<extra>%{fullData.name}</extra>" };
  }

  // ------------------------------------------------------------------ searches

  const searches = () => data.searches[state.spot][state.scenario];

  /** One line of all ways of a search, with gaps between them. */
  const joined = (search, of) => search.ways.flatMap((way) => [...of(way), null]);

  /** Of the joint fit, which comes first, and of the one at the spot: the colours of their curves. */
  function searchLook(k) {
    const s = k || data.spots.length === 1 ? state.scenario : data.scenarios.length;
    return { color: colour(`line${s % 6}`), dash: DASHES[k], width: 2 };
  }

  /** Ways of the searches along two of their numbers, a diamond at each least Fopt, a circle at reported values. */
  function wayTraces(x, y, axes) {
    return searches().flatMap((search, k) => {
      const last = search.ways[search.ways.length - 1], name = `${search.fit}: fit`;
      const meta = [[k ? "╍◆" : "━◆", searchLook(k).color, `path of the fit to ${search.fit}, to its least Fopt`]];
      const mark = (symbol) => ({ mode: "markers", marker: { symbol, size: 11, color: searchLook(k).color, line: { width: 1, color: colour("paper") } } });
      const drawn = [Object.assign(line(name, joined(search, x), joined(search, y), searchLook(k)), axes),
        Object.assign(line(`${name}, least Fopt`, x(last).slice(-1), y(last).slice(-1)), mark("diamond"), axes, { meta })];
      if (search.reported) {
        const at = { fopt: [search.reported.fopt], values: search.reported.values.map((value) => [value]) };
        drawn.push(Object.assign(line(`${name}, reported values`, x(at), y(at)), mark("circle"), axes,
          { meta: [["●", searchLook(k).color, `reported values of the fit to ${search.fit}`]] }));
      }
      return drawn;
    });
  }

  // ------------------------------------------------------------------ figures of sections

  /** Data of a figure in the page's colours, with its texts as texts. */
  function themed(value) {
    if (typeof value === "string") return value.startsWith("--") ? colour(value.slice(2)) : plain(value);
    if (Array.isArray(value)) return value.map(themed);
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, themed(item)]));
  }

  function drawFigure(figure, k) {
    const id = `figure-${k}`;
    if (!isShown(id)) return;
    const shape = themed(figure.layout);
    delete shape.images;
    for (const key of Object.keys(shape).filter((name) => /^[xy]axis\d*$/.test(name))) {
      const { title, ...more } = shape[key];
      shape[key] = Object.assign(axis("", more), { title: { text: title || "", standoff: 6 } });
    }
    const traces = themed(figure.traces);
    traces.filter((t) => t.type === "scatter" && !t.hoverinfo).forEach((t) => {
      t.hovertemplate = `${t.text ? "%{text}: " : "%{x:.4g}, "}%{y:.4g}<extra>%{fullData.name}</extra>`;
    });
    draw(id, traces, layout(Object.assign({ height: figure.height, legend: { orientation: "h", y: -0.22 } }, shape)));
  }

  const drawFigures = () => data.figures.forEach(drawFigure);

  // ------------------------------------------------------------------ sets

  const fopts = (spot) => data.sets.fopt[spot][state.scenario];

  function least(values) {
    let best = -1;
    values.forEach((v, i) => { if (v !== null && (best < 0 || v < values[best])) best = i; });
    return best;
  }

  /** Sets in the order in which to draw them: the best last, so that they are on top. */
  function order(values) {
    const rank = (v) => (v === null ? Infinity : v);
    return values.map((_, i) => i).sort((a, b) => rank(values[b]) - rank(values[a]));
  }

  /** Fopt at the lower end of the colours. */
  const lowest = () => Math.max(1e-4 * data.limits.colour, Math.min(0.5 * data.limits.colour, ...fopts(state.spot).filter((v) => v !== null)));

  function look(value) {
    if (value === null) return { symbol: "cross-thin-open", color: colour("failed") };
    if (value > data.limits.colour) return { symbol: "x-thin-open", color: colour("above") };
    const place = Math.log(value / lowest()) / Math.log(data.limits.colour / lowest());
    return { symbol: "circle", color: data.colours[Math.round(Math.max(0, place) * (data.colours.length - 1))] };
  }

  function points(x, y, values, more) {
    const drawn = order(values).filter((i) => x[i] !== null && y[i] !== null), looks = drawn.map((i) => look(values[i]));
    // Without any point the library draws no axes, and lines at NaN in their place.
    const along = (v) => (drawn.length ? drawn.map((i) => v[i]) : [null]);
    const trace = { type: "scatter", mode: "markers", x: along(x), y: along(y), customdata: drawn,
      text: drawn.map((i) => `set ${data.sets.ids[i]}, Fopt ${four(values[i])}`),
      marker: { symbol: looks.map((l) => l.symbol), color: looks.map((l) => l.color), size: 7,
        line: { width: 0.8, color: looks.map((l) => (l.symbol === "circle" ? colour("soft") : l.color)) } },
      unselected: { marker: { opacity: 0.15 } }, selected: { marker: { size: 9 } },
      hovertemplate: "%{text}<br>%{x:.4g}, %{y:.4g}<extra></extra>" };
    if (drawn.length) trace.meta = [["●", colour("soft"), "set, coloured by its Fopt"], ["×", colour("above"), `set of Fopt above ${data.limits.colour}`], ["+", colour("failed"), "set that failed or is missing"]];
    if (state.selected) trace.selectedpoints = drawn.flatMap((i, k) => (state.selected.has(i) ? [k] : []));
    return Object.assign(trace, more);
  }

  function star(x, y, more) {
    return Object.assign({ type: "scatter", mode: "markers", x: [x], y: [y], hoverinfo: "skip",
      meta: [["★", colour("least"), "set of the least Fopt"]], marker: { symbol: "star", size: 13, color: colour("least"), line: { width: 1, color: colour("paper") } } }, more);
  }

  /** Pairs of parameters, then each parameter against Fopt (its second index is −1). */
  function panels() {
    const n = data.parameters.length, found = [];
    for (let i = 0; i < n; i += 1) for (let j = i + 1; j < n; j += 1) found.push([i, j]);
    const pairs = found.slice(0, data.limits.pairs);
    const lines = data.parameters.map((_, i) => [i, -1]);
    return pairs.length && !data.sets.ids.length ? pairs.concat(lines.filter(([i]) => isProfiled(i))) : pairs.concat(lines);
  }

  const isProfiled = (i) => data.along.some((of) => of[i] !== null);

  /** Contour lines of Fopt in a plane, or Fopt along one parameter, of the fit that leads. */
  function valleyTraces(i, j, axes) {
    const quiet = { color: colour("soft"), width: 1 }, label = (line) => line.x.map((_, k) => (k === line.label ? four(line.level) : ""));
    if (j < 0) {
      const found = data.along[state.scenario][i];
      return found ? [Object.assign(line("least Fopt, the others fitted again", found.x, found.y, { color: colour("soft"), width: 1.6 }),
        { meta: [["━", colour("soft"), "least Fopt at each value, the other parameters fitted again"]] }, axes)] : [];
    }
    return (data.contours[state.scenario][`${i} ${j}`] || []).map((each) => Object.assign(line(`Fopt ${four(each.level)}`, each.x, each.y, quiet),
      { mode: "lines+text", text: label(each), textfont: { size: 10, color: colour("soft") }, unselected: { textfont: { color: colour("soft") } }, hovertemplate: "%{fullData.name}<extra></extra>",
        meta: [["─", colour("soft"), "contour line at the written Fopt, the other parameters fitted again"]] }, axes));
  }

  /** What the curves allow in a plane of two parameters, by draws of the fit that leads. */
  function drawsTrace(i, j, axes) {
    const [x, y] = j < 0 ? [null, null] : [data.draws[state.scenario][i], data.draws[state.scenario][j]];
    if (!x || !y) return [];
    return [Object.assign({ type: "scatter", mode: "markers", x, y, hoverinfo: "skip",
      meta: [["●", colour("measured"), "draws of the fit: what the curves and the error budget allow"]], marker: { size: 4, color: colour("measured"), opacity: 0.35 } }, axes)];
  }

  /** The true value, across the whole panel. */
  function truthLines(i, j, id) {
    const look = { type: "line", line: { color: colour("least"), width: 1.2, dash: "dot" } }, found = [];
    const at = (n) => (n < 0 ? null : data.parameters[n].truth);
    if (at(i) !== null) found.push({ ...look, xref: `x${id}`, yref: `y${id} domain`, x0: at(i), x1: at(i), y0: 0, y1: 1 });
    if (at(j) !== null) found.push({ ...look, xref: `x${id} domain`, yref: `y${id}`, x0: 0, x1: 1, y0: at(j), y1: at(j) });
    return found;
  }

  function colourBar() {
    const scale = data.colours.map((c, k) => [k / (data.colours.length - 1), c]);
    const ends = [lowest(), data.limits.colour].map(Math.log10), ticks = [0, 0.5, 1].map((part) => ends[0] + part * (ends[1] - ends[0]));
    return { type: "scatter", mode: "markers", x: [null], y: [null], hoverinfo: "skip", marker: { color: [0], cmin: ends[0],
      cmax: ends[1], colorscale: scale, showscale: true, colorbar: Object.assign({ thickness: 12, outlinewidth: 0, tickvals: ticks, ticktext: ticks.map((v) => String(Number((10 ** v).toPrecision(2)))) }, isNarrow()
        ? { orientation: "h", x: 0.5, len: 0.9, y: 1, yanchor: "bottom", title: { text: "Fopt", side: "top" } }
        : { x: 1.01, len: 1, title: { text: "Fopt", side: "right" } }) } };
  }

  /** The legend: mark, colour and meaning of all that is drawn, each once. */
  function listKeys(traces) {
    const keys = new Map(traces.flatMap((t) => t.meta || []).map((key) => [key[2], key]));
    element("pairs-legend").replaceChildren(...[...keys.values()].map(([mark, color, text]) => {
      const item = document.createElement("li"), key = document.createElement("span");
      key.textContent = mark;
      key.style.color = color;
      item.append(key, ` ${text}`);
      return item;
    }));
  }

  function drawPairs() {
    if (!isShown("pairs")) return;
    const list = panels(), width = element("pairs").clientWidth, values = fopts(state.spot), best = least(values);
    const columns = Math.min(width < 520 ? 1 : width < 860 ? 2 : 3, list.length), rows = Math.ceil(list.length / columns);
    const gap = [columns > 1 ? 0.11 : 0, Math.min(0.35 / rows, 0.12)];
    const size = [(1 - gap[0] * (columns - 1)) / columns, (1 - gap[1] * (rows - 1)) / rows];
    const capped = values.map((v) => (v === null || v > data.limits.fopt ? null : v));
    const truths = [], traces = data.sets.ids.length ? [colourBar()] : [], shape = { dragmode: data.sets.ids.length ? "select" : "zoom", height: rows * (columns === 1 ? 300 : 290) + 60, uirevision: state.spot };
    list.forEach(([i, j], k) => {
      const id = k ? String(k + 1) : "", left = (k % columns) * (size[0] + gap[0]), top = 1 - Math.floor(k / columns) * (size[1] + gap[1]);
      const p = data.parameters[i], q = data.parameters[j], axes = { xaxis: `x${id}`, yaxis: `y${id}` };
      const kind = (of) => (of && of.log ? "log" : "linear");
      shape[`xaxis${id}`] = axis(p.label, { domain: [left, left + size[0]], anchor: `y${id}`, type: kind(p), nticks: 5, tickformat: "~g" });
      shape[`yaxis${id}`] = axis(q ? q.label : "Fopt (NMSE)", { domain: [Math.max(0, top - size[1]), top], anchor: `x${id}`, type: q || !isProfiled(i) ? kind(q) : "log", nticks: 5, tickformat: "~g" });
      const x = data.sets.values[i], y = q ? data.sets.values[j] : capped;
      traces.push(...valleyTraces(i, j, axes), points(x, y, values, axes));
      if (best >= 0 && y[best] !== null) traces.push(star(x[best], y[best], axes));
      traces.push(...drawsTrace(i, j, axes));
      truths.push(...truthLines(i, j, id));
      const shown = (v) => (v > data.limits.fopt ? null : v);
      const along = (n) => (way) => (n < 0 ? way.fopt.map(shown) : way.values[n]);
      traces.push(...wayTraces(along(i), along(j), axes));
    });
    listKeys([...traces, ...(truths.length ? [{ meta: [["┅", colour("least"), "true value"]] }] : [])]);
    element("pairs").style.height = `${shape.height}px`;
    draw("pairs", traces, layout(Object.assign(shape, { shapes: truths, margin: { l: 56, r: isNarrow() ? 8 : 70, t: isNarrow() ? 64 : 32, b: 48 } })));
  }

  // ------------------------------------------------------------------ selection

  function listed() {
    const values = fopts(state.spot), rank = (i) => (values[i] === null ? Infinity : values[i]);
    return [...state.selected].sort((a, b) => rank(a) - rank(b)).slice(0, MOST_LISTED);
  }

  function cell(kind, text, scope) {
    const made = document.createElement(kind);
    made.textContent = text;
    if (scope) made.scope = scope; else if (kind === "td") made.className = "number";
    return made;
  }

  function listSelected() {
    const n = state.selected ? state.selected.size : 0, box = element("selected");
    box.hidden = n === 0;
    box.replaceChildren();
    const more = n > MOST_LISTED ? `; the best ${MOST_LISTED} are listed` : "";
    element("selected-count").textContent = n ? `${n} of ${data.sets.ids.length} sets ${n === 1 ? "is" : "are"} selected${more}.` : "No set is selected.";
    if (!n) return;
    const table = document.createElement("table"), head = table.createTHead().insertRow(), body = table.createTBody();
    table.createCaption().textContent = `Selected sets, scenario ${data.scenarios[state.scenario].name}`;
    const names = ["set", ...data.parameters.map((p) => p.label), ...data.spots.map((s) => `Fopt at ${s}`)];
    names.forEach((name) => head.append(cell("th", name, "col")));
    listed().forEach((i) => {
      const row = body.insertRow();
      row.append(cell("th", data.sets.ids[i], "row"), ...data.sets.values.map((v) => cell("td", four(v[i]))),
        ...data.spots.map((_, s) => cell("td", four(fopts(s)[i]))));
    });
    box.append(table);
  }

  function select(indices) {
    state.selected = indices && indices.length ? new Set(indices) : null;
    listSelected();
    drawPairs();
  }

  function listen(id) {
    if (!isShown(id) || !element(id).on || element(id).dataset.listens) return;
    element(id).dataset.listens = "yes";
    const own = (event) => event.points.map((p) => p.customdata).filter((i) => i !== undefined);
    const on = (name, then) => element(id).on(name, (event) => { if (!drawing) then(event); });
    on("plotly_selected", (event) => { if (event) select(own(event)); });
    on("plotly_click", (event) => select(own(event)));
    on("plotly_deselect", () => select(null));
  }

  // ------------------------------------------------------------------ limb

  const eye = { turn: -0.9, tilt: 0.45, far: 2.3 };
  const camera = () => ({ up: { x: 0, y: 0, z: 1 }, eye: { x: eye.far * Math.cos(eye.tilt) * Math.cos(eye.turn),
    y: eye.far * Math.cos(eye.tilt) * Math.sin(eye.turn), z: eye.far * Math.sin(eye.tilt) } });

  function drawScene() {
    if (!isShown("around")) return;
    const shown = data.limbs[state.spot];
    const traces = shown.map((t) => Object.assign({}, t, { name: plain(t.name), showlegend: true }));
    traces.forEach((t) => {
      if (t.type === "scatter3d" && t.mode === "lines") t.line = Object.assign({ width: 6 }, t.line, { color: colour("ink") });
    });
    const side = (title) => axis(title, { backgroundcolor: "rgba(0,0,0,0)", nticks: 4 });
    const shape = { scene: { aspectmode: "data", camera: camera(), xaxis: side("x (mm)"), yaxis: side("y (mm)"), zaxis: side("z (mm)") },
      showlegend: true, legend: { orientation: "h", y: -0.02 }, margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: state.spot };
    draw("around", traces, layout(shape));
  }

  function turn(way) {
    const step = { left: ["turn", -0.35], right: ["turn", 0.35], up: ["tilt", 0.2], down: ["tilt", -0.2] }[way];
    if (step) eye[step[0]] += step[1];
    else eye.far *= way === "in" ? 0.85 : 1.18;
    eye.tilt = Math.min(1.5, Math.max(-1.5, eye.tilt));
    Plotly.relayout(element("around"), { "scene.camera": camera() });
  }

  // ------------------------------------------------------------------ sections that fold

  function unfold(target) {
    const section = target && (target.closest("details") || target.querySelector("details"));
    if (section) section.open = true;
  }

  function listenToSections() {
    let due = 0;
    // On a phone the way to the end is long enough without them.
    if (isNarrow()) document.querySelectorAll("section:not(#section-curves) > details").forEach((d) => { d.open = false; });
    document.querySelectorAll("details").forEach((section) => section.addEventListener("toggle", () => {
      cancelAnimationFrame(due);
      due = requestAnimationFrame(() => { drawAll(); listen("pairs"); });
    }));
    document.querySelectorAll("a[href^='#']").forEach((link) => link.addEventListener("click", () => unfold(element(link.hash.slice(1)))));
    unfold(element(location.hash.slice(1)));
    document.querySelectorAll("[data-turn]").forEach((b) => b.addEventListener("click", () => turn(b.dataset.turn)));
  }

  // ------------------------------------------------------------------ the page

  const skin = makeSkin({ data, state, element, isShown, colour });

  function drawAll() { drawFigures(); drawPairs(); drawScene(); skin.draw(); }

  function reset() {
    ["pairs", ...data.figures.map((_, k) => `figure-${k}`), "around"].forEach((id) => {
      if (element(id) && element(id).data) { Plotly.purge(element(id)); delete element(id).dataset.listens; }
    });
    Object.assign(eye, { turn: -0.9, tilt: 0.45, far: 2.3 });
    skin.reset();
    drawAll();
    listen("pairs");
  }

  function listenToControls() {
    document.querySelectorAll("[data-menu]").forEach((menu) => menu.addEventListener("change", () => {
      state[menu.dataset.menu] = Number(menu.value);
      document.querySelectorAll(`[data-menu="${menu.dataset.menu}"]`).forEach((other) => { other.value = menu.value; });
      if (state.selected) listSelected();
      drawAll();
    }));
    skin.listen();
    document.querySelectorAll("[data-choice]").forEach((menu) => {
      const options = menu.closest(".choice").querySelectorAll(":scope > div");
      const show = () => options.forEach((option, k) => option.classList.toggle("unchosen", k !== Number(menu.value)));
      menu.addEventListener("change", show);
      show();
    });
    document.querySelectorAll("[data-copy]").forEach((b) => b.addEventListener("click", () => {
      const of = b.closest("details"), rows = [...of.querySelectorAll(":scope > .wide tr")];
      const text = of.querySelector(":scope > .copied");
      navigator.clipboard.writeText(text ? text.textContent : rows.map((r) => [...r.cells].map((c) => c.textContent.trim()).join("\t")).join("\n"));
    }));
    document.querySelectorAll("[data-reset]").forEach((b) => b.addEventListener("click", reset));
    element("clear")?.addEventListener("click", () => select(null));
    element("pick")?.addEventListener("submit", (event) => {
      event.preventDefault();
      const most = Number(element("most").value), values = fopts(state.spot);
      select(values.flatMap((v, i) => (v !== null && v <= most ? [i] : [])));
    });
    let waiting = 0, width = window.innerWidth;
    window.addEventListener("resize", () => {
      clearTimeout(waiting);
      waiting = setTimeout(() => { if (window.innerWidth !== width) { width = window.innerWidth; drawAll(); } }, 200);
    });
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  }

  async function library() {
    const packed = Uint8Array.from(atob(element("library").textContent), (c) => c.charCodeAt(0));
    const text = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).text();
    const script = document.createElement("script");
    script.textContent = text;
    document.head.append(script);
    if (!window.Plotly) throw new Error("the plotting library did not start");
  }

  async function begin() {
    try {
      await library();
      listenToControls();
      drawAll();
      listen("pairs");
      listenToSections();
      document.documentElement.dataset.ready = "yes";
    } catch (error) {
      element("trouble").hidden = false;
      element("trouble").textContent = `The figures cannot be drawn here (${error.message}); the same figures are in the folder figures/.`;
      throw error;
    }
  }

  begin();
})();
