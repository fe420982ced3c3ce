#include "bench/report/page_assets.hpp"

namespace meltbench::report {

const std::string_view kPageScript = R"js(
"use strict";
const bench = {};  // What the page's other scripts use of this one.
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const overlaid = page.runs.length > 1;
  const graphs = [];
  const hiddenRuns = new Set();
  const listeners = { moment: [], window: [], redraw: [] };
  const tell = (what, ...values) => { for (const listener of listeners[what]) listener(...values); };
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const make = (tag, attributes, text) => {
    const element = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes || {})) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return element;
  };

  // float32 as base64: NaN is a gap in the line, +Infinity is "no sample here" (null for dygraphs: the line goes on).
  const decodeBytes = text => {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
    return bytes.buffer;
  };
  const decode = text =>
    Array.from(new Float32Array(decodeBytes(text)), value => value === Infinity ? null : value);

  // Six digits, and no "1e-7" next to "0.0001": small and large numbers all get the exponent form.
  const format = value => {
    if (value === null || value === undefined) return "";
    if (Number.isNaN(value)) return "none";
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-4 || size >= 1e7)) return Number(value.toPrecision(4)).toExponential();
    return String(Number(value.toPrecision(6)));
  };

  const dashes = [null, [7, 4], [2, 3], [9, 3, 2, 3], [12, 4], [4, 2]];
  // One run: a colour per signal. Several: a colour per run and a dash per signal. The same in all runs: grey.
  const look = (plot, series) => {
    const index = plot.signals.indexOf(series.signal);
    const isSetPoint = plot.signals.length > 1 && series.signal.includes("set_point");
    if (series.run < 0) return { color: "--muted", dash: isSetPoint ? [4, 4] : dashes[index % 6] };
    if (overlaid) return { color: "--run" + series.run % 8, dash: dashes[index % 6] };
    if (isSetPoint) return { color: "--muted", dash: [4, 4] };
    return { color: "--run" + index % 8, dash: plot.dashed ? dashes[index % 6] : null };
  };

  const markColor = { fault: "--bad", failed: "--bad", warning: "--warn", info: "--muted" };
  const drawMarks = (context, area, graph) => {
    for (const mark of page.marks) {
      if (hiddenRuns.has(mark.run)) continue;
      const x = graph.toDomXCoord(mark.t);
      if (x < area.x - 1 || x > area.x + area.w + 1) continue;
      context.fillStyle = context.strokeStyle = css(markColor[mark.kind]);
      context.globalAlpha = mark.kind === "info" ? 0.7 : 1;
      context.beginPath();
      context.moveTo(x - 4, area.y);
      context.lineTo(x + 4, area.y);
      context.lineTo(x, area.y + 7);
      context.fill();
      if (mark.kind !== "info") {
        context.setLineDash(mark.kind === "failed" ? [3, 3] : []);
        context.beginPath();
        context.moveTo(x, area.y);
        context.lineTo(x, area.y + area.h);
        context.stroke();
        context.setLineDash([]);
      }
      context.globalAlpha = 1;
    }
  };

  const clock = document.getElementById("clock");
  const near = document.getElementById("near");
  const help = near.textContent;
  const showMoment = t => {
    clock.textContent = t === null ? "" : "t = " + t.toFixed(3) + " s";
    if (t !== null) tell("moment", t);
    if (t === null || graphs.length === 0) { near.textContent = help; return; }
    const graph = graphs[0].graph;
    const reach = 6 * (graph.toDataXCoord(1) - graph.toDataXCoord(0));
    near.textContent = page.marks.filter(m => !hiddenRuns.has(m.run) && Math.abs(m.t - t) <= reach).slice(0, 3)
      .map(m => (overlaid ? page.runs[m.run] + ": " : "") + m.text + " (" + format(m.t) + " s)").join("; ");
  };

  const colors = entry => entry.plot.series.map(series => css(look(entry.plot, series).color));
  const visibility = entry =>
    entry.plot.series.map(s => !hiddenRuns.has(s.run) && !entry.hiddenSignals.has(s.signal));

  const addLegend = (caption, entry) => {
    for (const signal of entry.plot.signals) {
      const button = make("button", { class: "toggle", "aria-pressed": "true", title: "show or hide" });
      const first = entry.plot.series.find(s => s.signal === signal);
      const { color, dash } = look(entry.plot, first);
      button.innerHTML = '<svg viewBox="0 0 26 8"><line x1="0" y1="4" x2="26" y2="4" stroke-width="2"/></svg>';
      const line = button.querySelector("line");
      line.style.stroke = overlaid && first.run >= 0 ? "var(--text)" : "var(" + color + ")";
      if (dash) line.setAttribute("stroke-dasharray", dash.join(" "));
      button.append(signal);
      const columns = entry.plot.series.map((series, column) => ({ series, column }))
        .filter(({ series }) => series.signal === signal).sort((a, b) => a.series.run - b.series.run);
      for (const { series, column } of columns) {
        const output = make("output");
        if (overlaid && series.run >= 0) output.style.color = "var(" + look(entry.plot, series).color + ")";
        button.append(output);
        entry.outputs.push({ column, output });
      }
      button.addEventListener("click", () => {
        const hidden = entry.hiddenSignals;
        hidden.has(signal) ? hidden.delete(signal) : hidden.add(signal);
        button.setAttribute("aria-pressed", String(!hidden.has(signal)));
        entry.graph.updateOptions({ visibility: visibility(entry) });
      });
      caption.append(button);
    }
  };

  // A finger on a plot scrolls the page; the buttons with times zoom.
  const interaction = Object.assign({}, Dygraph.defaultInteractionModel);
  for (const touch of ["touchstart", "touchmove", "touchend"]) delete interaction[touch];
  const lineStyles = plot => Object.fromEntries(plot.series.map((series, i) =>
    ["s" + i, {
      strokePattern: look(plot, series).dash, strokeWidth: series.signal === plot.signals[0] ? 1.8 : 1.2,
      stepPlot: plot.stepped === true
    }]));

  const addPlot = plot => {
    plot.signals = [...new Set(plot.series.map(s => s.signal))];
    plot.series.reverse();  // What is drawn last lies on top: the first signal, which is the truth where there is one.
    const figure = make("figure");
    const caption = make("figcaption");
    caption.append(make("b", {}, plot.title), make("small", {}, plot.unit ? "[" + plot.unit + "]" : ""));
    const place = make("div", { class: "plot" });
    figure.append(caption, place);
    document.getElementById("plots").append(figure);

    const entry = { plot, outputs: [], hiddenSignals: new Set() };
    addLegend(caption, entry);
    const columns = plot.series.map(series => decode(series.data));
    const rows = page.t.map((t, row) => [t, ...columns.map(column => column[row])]);
    entry.graph = new Dygraph(place, rows, {
      labels: ["t", ...plot.series.map((_, i) => "s" + i)],
      colors: colors(entry),
      series: lineStyles(plot),
      legend: "never",
      connectSeparatedPoints: true,
      interactionModel: interaction,
      axes: {
        x: { axisLabelFormatter: value => format(value), pixelsPerLabel: 70 },
        y: { axisLabelFormatter: value => format(value), axisLabelWidth: 64, pixelsPerLabel: 34 }
      },
      gridLineColor: css("--grid"),
      axisLineColor: css("--line"),
      highlightCircleSize: 3,
      underlayCallback: drawMarks,
      drawCallback: () => { if (graphs[0] === entry) tell("window"); },
      highlightCallback: (event, t, points) => {
        showMoment(t);
        for (const { graph, outputs } of graphs) {
          const row = graph.getRowForX(t);
          for (const { column, output } of outputs) {
            output.textContent = row === null || row === undefined ? "" : format(graph.getValue(row, column + 1));
          }
        }
      },
      unhighlightCallback: () => {
        showMoment(null);
        for (const { outputs } of graphs) for (const { output } of outputs) output.textContent = "";
      }
    });
    graphs.push(entry);
  };

  const restyle = entry => entry.graph.updateOptions({
    colors: colors(entry), gridLineColor: css("--grid"), axisLineColor: css("--line"), visibility: visibility(entry)
  });
  const redraw = () => {
    graphs.forEach(restyle);
    tell("redraw");
  };

  page.plots.forEach(addPlot);
  const all = graphs.map(entry => entry.graph);
  if (all.length > 1) Dygraph.synchronize(all, { zoom: true, selection: true, range: false });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  for (const button of document.querySelectorAll(".bar .toggle")) {
    button.addEventListener("click", () => {
      const run = Number(button.dataset.run);
      hiddenRuns.has(run) ? hiddenRuns.delete(run) : hiddenRuns.add(run);
      button.setAttribute("aria-pressed", String(!hiddenRuns.has(run)));
      redraw();
    });
  }
  const whole = page.t.length ? [page.t[0], page.t[page.t.length - 1]] : [0, 1];
  const zoom = window => { if (all.length) all[0].updateOptions({ dateWindow: window }); };
  document.getElementById("reset").addEventListener("click", () => zoom(null));
  for (const button of document.querySelectorAll("button.at")) {
    button.addEventListener("click", () => {
      const t = Number(button.dataset.t);
      const half = (whole[1] - whole[0]) / 40;
      zoom([Math.max(whole[0], t - half), Math.min(whole[1], t + half)]);
      tell("moment", t);
      document.getElementById("plots-title").scrollIntoView({ behavior: "smooth" });
    });
  }

  const visibleWindow = () => all.length ? all[0].xAxisRange() : whole;
  Object.assign(bench, {
    page, css, make, format, decodeBytes, colors, visibility, addLegend, interaction, lineStyles, restyle, hiddenRuns,
    listeners, visibleWindow
  });
})();
)js";

}  // namespace meltbench::report
