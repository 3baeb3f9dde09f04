"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const digits = (value) => (Math.abs(value) < 1e4 ? value.toPrecision(4) : value.toFixed(0)).replace("-", "−");

  /** Values of a curve where its axis is at x, in the order travelled; none next to a missing one. */
  function passed(along, values, x) {
    const found = [], known = (i) => i >= 0 && along[i] !== null && values[i] !== null;
    for (let i = 1; i < along.length; i += 1) {
      const a = along[i - 1], b = along[i];
      if (!known(i - 1) || !known(i) || a === b || (x - a) * (x - b) > 0 || (x === a && known(i - 2))) continue;
      found.push(values[i - 1] + (x - a) / (b - a) * (values[i] - values[i - 1]));
    }
    return found;
  }

  /** A press and its return differ; of a path that passes more often, the range. */
  function text(curve, x) {
    const found = curve ? passed(curve[0], curve[1], x) : [];
    if (found.length > 2) return `${digits(Math.min(...found))} to ${digits(Math.max(...found))}`;
    return found.length ? found.map(digits).join(" / ") : "–";
  }

  /** Move the cursors of a section to the step of its slider next to a place. */
  function move(section, figures, place) {
    const slider = section.querySelector("input");
    slider.value = place;
    const x = Number(slider.value);
    section.querySelector("output").textContent = digits(x);
    section.querySelectorAll(".traced").forEach((shown, k) => {
      const { box, ends, lines } = figures[k], mark = shown.querySelector(".cursor");
      const share = (x - ends[0]) / (ends[1] - ends[0]);
      mark.hidden = share < 0 || share > 1;
      mark.style.left = `${100 * (box[0] + share * (box[1] - box[0]))}%`;
      mark.style.top = `${100 * box[2]}%`;
      mark.style.height = `${100 * (box[3] - box[2])}%`;
      shown.querySelector(".at").textContent = digits(x);
      shown.querySelectorAll("tbody tr").forEach((row, i) => {
        row.querySelectorAll("td").forEach((cell, j) => { cell.textContent = text(lines[i][j], x); });
      });
    });
  }

  document.querySelectorAll("[data-view]").forEach((section) => {
    const figures = data[section.dataset.view], slider = section.querySelector("input");
    const places = figures.flatMap((f) => f.lines.flatMap((line) => line.flatMap((curve) => (curve ? curve[0] : []))));
    const ends = [Math.min, Math.max].map((end) => places.reduce((a, b) => end(a, b)));
    const step = 10 ** Math.floor(Math.log10((ends[1] - ends[0]) / 100));
    Object.assign(slider, { step, min: step * Math.floor(ends[0] / step), max: step * Math.ceil(ends[1] / step) });
    slider.addEventListener("input", () => move(section, figures, Number(slider.value)));
    section.querySelectorAll(".under").forEach((shown, k) => shown.addEventListener("pointermove", (event) => {
      const { box, ends } = figures[k], frame = shown.getBoundingClientRect();
      const share = ((event.clientX - frame.left) / frame.width - box[0]) / (box[1] - box[0]);
      if (share >= 0 && share <= 1) move(section, figures, ends[0] + share * (ends[1] - ends[0]));
    }));
    move(section, figures, 0.25 * slider.min + 0.75 * slider.max);
  });
  document.documentElement.dataset.ready = "yes";
})();
