// Curves of a dive, one below the other, over one axis of time: zoom and cursor are shared, findings are shaded.
"use strict";

const HEIGHT = 150;
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Eight colours that people who see fewer of them tell apart (Okabe and Ito), darker on white, lighter on black.
function palette() {
  return matchMedia("(prefers-color-scheme: dark)").matches
    ? ["#56b4e9", "#ff8f4d", "#5fd39a", "#e79fc7", "#f0e442", "#9aa7b4", "#f0c04e", "#8fb8ff"]
    : ["#0068a3", "#b84f00", "#1b7046", "#a3467c", "#855b00", "#566370", "#c62828", "#4b3f9e"];
}

async function load(address, from, to) {
  const query = from === undefined ? "" : `?begin=${from}&end=${to}`;
  const answer = await fetch(address + query);
  if (!answer.ok) throw new Error(`the server says ${answer.status}`);
  return answer.json();
}

async function showOverview(place) {
  const sources = [place.dataset.overview, place.dataset.beside].filter(Boolean);
  let found;
  try {
    found = await Promise.all(sources.map((address) => load(address)));
  } catch (error) {
    place.textContent = `The curves cannot be shown: ${error.message}.`;
    return;
  }
  place.replaceChildren();
  const view = new Overview(place, sources, found);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => view.draw());
}

class Overview {
  constructor(place, sources, found) {
    Object.assign(this, { place, sources, found, charts: [], zoomed: null });
    this.sync = uPlot.sync(`overview-${Overview.count = (Overview.count || 0) + 1}`);
    this.bar = place.appendChild(document.createElement("div"));
    this.bar.className = "bar";
    this.body = place.appendChild(document.createElement("div"));
    this.draw();
    new ResizeObserver(() => {
      for (const { chart } of this.charts) chart.setSize({ width: this.width(), height: HEIGHT });
    }).observe(place);
  }

  width() {
    return Math.max(this.place.clientWidth, 200);
  }

  // Panels in the order of the first dive; where two are shown, each stands above that of the other one.
  panels() {
    const titles = [...new Set(this.found.flatMap((dive) => dive.panels.map((panel) => panel.title)))];
    return titles.flatMap((title) => this.found.flatMap((dive, which) => {
      const panel = dive.panels.find((one) => one.title === title);
      return panel ? [{ panel, which, dive }] : [];
    }));
  }

  draw() {
    for (const { chart } of this.charts) chart.destroy();
    this.body.replaceChildren();
    const panels = this.panels();
    const ends = panels.flatMap(({ panel }) => [panel.t[0], panel.t[panel.t.length - 1]]).filter(Number.isFinite);
    this.all = [Math.min(...ends), Math.max(...ends)];
    if (!panels.length) this.body.textContent = "Nothing of this dive can be drawn.";
    this.charts = panels.map((one) => ({ ...one, chart: this.chart(one) }));
    this.legend();
    if (this.zoomed) this.apply(this.zoomed);
  }

  chart({ panel, which, dive }) {
    const box = this.body.appendChild(document.createElement("div"));
    box.className = "chart";
    const unit = panel.unit === "1" ? "" : `, ${panel.unit}`;
    const title = panel.title + unit + (this.found.length > 1 ? ` (${dive.name})` : "");
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", `${title} over time: ${panel.series.map((one) => one.name).join(", ")}`);
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1 } };
    const colours = palette();
    const options = {
      title, width: this.width(), height: HEIGHT,
      cursor: { sync: { key: this.sync.key, scales: ["x", null] }, drag: { x: true, y: false, setScale: false } },
      scales: {
        x: { time: false, range: () => this.zoomed || this.all },
        y: { dir: panel.title === "Depth" ? -1 : 1 }, // the surface is above
      },
      axes: [
        { ...axis, size: 28, values: (chart, ticks) => ticks.map((tick) => `${+tick.toFixed(3)} s`) },
        { ...axis, size: 52 },
      ],
      series: [
        { label: "time", value: (chart, value) => (value === null ? "–" : `${value.toFixed(1)} s`) },
        ...panel.series.map((one, i) => ({
          label: one.name,
          stroke: one.name === "before" ? colour("--before") : one.name === "after" ? colour("--after") : colours[i % 8],
          dash: one.name === "before" ? [5, 3] : DASHES[Math.floor(i / 8) % 4],
          width: 1.5, points: { show: false },
          value: (chart, value) => (value === null ? "–" : `${+value.toPrecision(4)}`),
        })),
      ],
      hooks: {
        drawClear: [(chart) => this.shade(chart, dive)],
        setSelect: [(chart) => {
          if (chart.select.width < 4) return;
          const from = chart.posToVal(chart.select.left, "x");
          const to = chart.posToVal(chart.select.left + chart.select.width, "x");
          chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          this.look([from, to]);
        }],
      },
    };
    const made = new uPlot(options, [panel.t, ...panel.series.map((one) => one.values)], box);
    made.over.addEventListener("dblclick", () => this.look(null));
    return made;
  }

  shade(chart, dive) {
    const { ctx, bbox } = chart;
    const across = (time) => chart.valToPos(time, "x", true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const span of dive.spans) {
      const left = across(span.from);
      const names = { error: "--bad", warning: "--warn", "held-out": "--after" };
      ctx.globalAlpha = span.kind === "held-out" ? 0.1 : 0.18;
      ctx.fillStyle = colour(names[span.kind] || "--soft");
      ctx.fillRect(left, bbox.top, Math.max(across(span.to) - left, 2), bbox.height);
    }
    ctx.globalAlpha = 1;
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textBaseline = "top";
    for (const mode of dive.modes) {
      const left = across(mode.from);
      ctx.fillStyle = colour("--edge");
      ctx.fillRect(left, bbox.top, devicePixelRatio, bbox.height);
      if (across(mode.to) - left > ctx.measureText(mode.name).width + 8) {
        ctx.fillStyle = colour("--soft");
        ctx.fillText(mode.name, Math.max(left, bbox.left) + 4 * devicePixelRatio, bbox.top + 2);
      }
    }
    ctx.restore();
  }

  legend() {
    const kinds = { "held-out": "predicted, not learnt from", error: "what is wrong", warning: "warnings", info: "remarks" };
    this.bar.replaceChildren();
    const seen = new Set(this.found.flatMap((dive) => dive.spans.map((span) => span.kind)));
    for (const [kind, label] of Object.entries(kinds)) {
      if (!seen.has(kind)) continue;
      const swatch = document.createElement("i");
      swatch.className = `span-${kind}`;
      const entry = document.createElement("span");
      entry.append(swatch, label);
      this.bar.append(entry);
    }
    for (const [text, share] of [["Closer", 0.5], ["Wider", 2], ["Earlier", -1], ["Later", 1], ["All", 0]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "quiet";
      button.textContent = text;
      button.addEventListener("click", () => this.step(text, share));
      this.bar.append(button);
    }
  }

  // The same with keys alone: each of the buttons looks at another stretch.
  step(text, share) {
    const [low, high] = this.zoomed || this.all;
    const middle = (low + high) / 2;
    const half = (high - low) / 2;
    if (text === "All") this.look(null);
    else if (text === "Closer" || text === "Wider") this.look([middle - half * share, middle + half * share]);
    else this.look([low + half * share, high + half * share]);
  }

  look(span) {
    if (span) span = [Math.max(span[0], this.all[0]), Math.min(span[1], this.all[1])];
    this.zoomed = span && span[1] - span[0] > 0.05 && span[1] - span[0] < this.all[1] - this.all[0] ? span : null;
    this.apply(this.zoomed);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.closer(this.zoomed), 150);
  }

  apply(span) {
    const [min, max] = span || this.all;
    for (const { chart } of this.charts) chart.setScale("x", { min, max });
  }

  // Curves are thinned to what a screen shows: a stretch that is looked at closer comes anew.
  async closer(span) {
    try {
      const fresh = await Promise.all(this.sources.map((a) => (span ? load(a, span[0], span[1]) : load(a))));
      if (span !== this.zoomed) return;
      for (const { chart, panel, which } of this.charts) {
        const now = fresh[which].panels.find((one) => one.title === panel.title);
        if (now && now.t.length) chart.setData([now.t, ...now.series.map((one) => one.values)]);
      }
      this.apply(span);
    } catch {
      return; // the coarser curves stay
    }
  }
}
