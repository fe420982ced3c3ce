#include "bench/report/page_assets.hpp"

namespace meltbench::report {

// Nothing here keeps a time of its own but `moment`: slider, play button, the plots' cursor and the maps all set it.
const std::string_view kProfileScript = R"js(
(() => {
  const { page, css, make, format } = bench;
  const root = document.getElementById("profiles");
  const none = 65535;
  const playing_s = 10;
  const views = [];
  let moment = 0;
  let span = [0, 1];  // The times that the plots show.

  const decodeLayer = layer => {
    if (!layer) return null;
    const numbers = new Uint16Array(bench.decodeBytes(layer.data));
    const values = Float64Array.from(numbers, n => n === none ? NaN : layer.from + layer.step * n);
    return { values, front: layer.front, melting: layer.melting };
  };
  // The last instant not after t.
  const indexAt = (times, t) => {
    let low = 0, high = times.length;
    while (low + 1 < high) {
      const middle = (low + high) >> 1;
      times[middle] <= t ? low = middle : high = middle;
    }
    return low;
  };
  const niceTicks = (low, high, count) => {
    if (!(high > low)) return [low];
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(factor => factor * power).find(size => size >= rough);
    const ticks = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i) ticks.push(i * step);
    return ticks;
  };
  const tickText = (value, ticks) => {
    const step = ticks.length > 1 ? ticks[1] - ticks[0] : Math.abs(value) / 1000 || 1;
    return value.toFixed(Math.min(6, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))));
  };
  const isShown = run => !bench.hiddenRuns.has(run.run);

  // Colours: inferno (van der Walt and Smith, CC0) from dark to bright; for differences from one hue over the page's
  // own middle to another.
  const inferno = ["#000004", "#210c4a", "#57106e", "#8a226a", "#bc3754", "#e45a31", "#f98e09", "#f9cb35", "#fcffa4"];
  const rgb = text => [1, 3, 5].map(at => parseInt(text.slice(at, at + 2), 16));
  const makePalette = anchors => {
    const palette = new Uint32Array(256);
    for (let i = 0; i < 256; ++i) {
      const place = i / 255 * (anchors.length - 1);
      const first = Math.min(Math.floor(place), anchors.length - 2);
      const [a, b] = [rgb(anchors[first]), rgb(anchors[first + 1])];
      const [r, g, blue] = a.map((value, c) => Math.round(value + (b[c] - value) * (place - first)));
      palette[i] = (255 << 24 | blue << 16 | g << 8 | r) >>> 0;
    }
    return palette;
  };
  const paletteOf = view =>
    makePalette(view.mode === "difference" ? [css("--below"), css("--middle"), css("--above")] : inferno);

  const fitCanvas = (canvas, width, height) => {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = "12px " + getComputedStyle(document.body).fontFamily;
    context.fillStyle = css("--muted");
    context.strokeStyle = css("--line");
    return { context, ratio };
  };

  // ---- the profile at one moment ----
  const rowsAt = view => {
    const columns = view.plot.series.map(({ of, layer }) => {
      const offset = indexAt(of.t, moment) * view.points;
      return of.xs.map((x, point) => [x, of.layers[layer].values[offset + point]]);
    });
    const rows = new Map(view.xs.map(x => [x, [x, ...columns.map(() => null)]]));
    columns.forEach((column, i) => { for (const [x, value] of column) rows.get(x)[i + 1] = value; });
    return [...rows.values()];
  };
  const drawLines = view => (context, area, graph) => {
    context.save();
    context.lineWidth = 1.5;
    const melting = new Set();
    for (const run of view.runs.filter(isShown)) {
      const now = indexAt(run.t, moment);
      run.layers.forEach((layer, i) => {
        if (!layer || view.entry.hiddenSignals.has(view.signals[i])) return;
        if (layer.melting.length && layer.melting[now] !== null) melting.add(layer.melting[now]);
        const front = layer.front.length ? layer.front[now] : null;
        if (!front || !run.length) return;
        context.strokeStyle = css("--run" + (view.many ? run.run : i) % 8);
        context.globalAlpha = 0.75;
        context.setLineDash(i > 0 ? [7, 4] : []);
        context.beginPath();
        const x = graph.toDomXCoord(1000 * front);
        context.moveTo(x, area.y);
        context.lineTo(x, area.y + area.h);
        context.stroke();
      });
    }
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle = css("--muted");
    context.setLineDash([2, 3]);
    context.font = "12px " + getComputedStyle(document.body).fontFamily;
    context.textAlign = "right";
    for (const value of melting) {
      const y = graph.toDomYCoord(value);
      context.beginPath();
      context.moveTo(area.x, y);
      context.lineTo(area.x + area.w, y);
      context.stroke();
      context.fillText("melting point " + format(value), area.x + area.w - 4, y - 4);
    }
    context.restore();
  };
  const addProfilePlot = view => {
    const figure = make("figure");
    const caption = make("figcaption");
    caption.append(make("b", {}, view.name + " along the barrel"), make("small", {},
      "[" + view.unit + "] over the " + view.along + (view.inMetres ? "; the melting front upright" : "")));
    const place = make("div", { class: "plot" });
    figure.append(caption, place);
    root.append(figure);
    const entry = { plot: view.plot, outputs: [], hiddenSignals: new Set() };
    view.entry = entry;
    bench.addLegend(caption, entry);
    const clear = () => { for (const { output } of entry.outputs) output.textContent = ""; };
    entry.graph = new Dygraph(place, rowsAt(view), {
      labels: ["x", ...view.plot.series.map((_, i) => "s" + i)],
      colors: bench.colors(entry),
      series: bench.lineStyles(view.plot),
      legend: "never",
      connectSeparatedPoints: true,
      interactionModel: bench.interaction,
      axes: {
        x: { axisLabelFormatter: value => format(value), pixelsPerLabel: 70 },
        y: { axisLabelFormatter: value => format(value), axisLabelWidth: 64, pixelsPerLabel: 34 }
      },
      gridLineColor: css("--grid"),
      axisLineColor: css("--line"),
      highlightCircleSize: 3,
      underlayCallback: drawLines(view),
      highlightCallback: (event, x) => {
        const row = entry.graph.getRowForX(x);
        for (const { column, output } of entry.outputs) {
          output.textContent = row === null ? "" : format(entry.graph.getValue(row, column + 1));
        }
      },
      unhighlightCallback: clear
    });
  };

  // ---- space-time maps ----
  const valueAt = (view, run, mode, at) =>
    mode === "difference" ? run.layers[0].values[at] - run.layers[1].values[at] : run.layers[mode].values[at];
  const unitOf = view => view.mode === "difference" && view.unit === "\u00b0C" ? "K" : view.unit;
  const hasMode = (run, mode) => mode === "difference" ? run.layers[0] && run.layers[1] : run.layers[mode];
  // The colours span what is to be seen. Truth and estimate share them; of differences the largest 2 % are cut off,
  // as the first guess of an estimate would drown what follows.
  const findRange = view => {
    const values = [];
    for (const run of view.runs.filter(isShown)) {
      const [first, last] = span.map(t => indexAt(run.t, t));
      const modes = view.mode === "difference" ? ["difference"] : run.layers.map((_, i) => i);
      for (const mode of modes.filter(m => hasMode(run, m))) {
        for (let at = first * view.points; at < (last + 1) * view.points; ++at) {
          const value = valueAt(view, run, mode, at);
          if (!Number.isNaN(value)) values.push(value);
        }
      }
    }
    if (values.length === 0) return [0, 1];
    if (view.mode === "difference") {
      const sizes = Float64Array.from(values, Math.abs).sort();
      const size = sizes[Math.floor(0.98 * (sizes.length - 1))] || 1e-9;
      return [-size, size];
    }
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    return high > low ? [low, high] : [low - 0.5, low + 0.5];
  };
  const drawScale = (view, palette, [low, high]) => {
    const [width, bar, margin] = [240, 10, 22];
    const { context } = fitCanvas(view.scale, width, 30);
    for (let x = 0; x < width - 2 * margin; ++x) {
      const color = palette[Math.round(x / (width - 2 * margin - 1) * 255)];
      context.fillStyle = `rgb(${color & 255},${color >> 8 & 255},${color >> 16 & 255})`;
      context.fillRect(margin + x, 0, 1.5, bar);
    }
    context.strokeRect(margin + 0.5, 0.5, width - 2 * margin, bar);
    context.fillStyle = css("--muted");
    context.textAlign = "center";
    const ticks = niceTicks(low, high, 4);
    for (const value of ticks) {
      const x = margin + (value - low) / (high - low) * (width - 2 * margin);
      context.fillRect(x - 0.5, bar, 1, 4);
      context.fillText(tickText(value, ticks), x, 26);
    }
    view.scale.setAttribute("aria-label", "colours from " + format(low) + " to " + format(high) + " " + unitOf(view));
    view.scaleUnit.textContent = unitOf(view);
  };
  const edges = { left: 46, right: 14, top: 6, bottom: 22 };
  const areaOf = map => ({
    x: edges.left, y: edges.top, w: Math.max(map.place.clientWidth - edges.left - edges.right, 1),
    h: map.place.clientHeight - edges.top - edges.bottom
  });
  const paintField = (view, run, image, palette, [low, high]) => {
    const pixels = new Uint32Array(image.data.buffer);
    const { width, height } = image;
    const column = new Uint32Array(height);
    let painted = -1;
    const end = run.t[run.t.length - 1];
    for (let i = 0; i < width; ++i) {
      const t = span[0] + (i + 0.5) / width * (span[1] - span[0]);
      if (t < run.t[0] || t > end) continue;
      const now = indexAt(run.t, t);
      for (let j = 0; j < height && now !== painted; ++j) {
        const place = (1 - (j + 0.5) / height) * (view.points - 1);
        const point = Math.min(Math.floor(place), view.points - 2);
        const a = valueAt(view, run, view.mode, now * view.points + point);
        const b = valueAt(view, run, view.mode, now * view.points + point + 1);
        const share = (a + (b - a) * (place - point) - low) / (high - low);
        column[j] = Number.isNaN(share) ? 0 : palette[Math.round(255 * Math.min(1, Math.max(0, share)))];
      }
      painted = now;
      for (let j = 0; j < height; ++j) pixels[j * width + i] = column[j];
    }
  };
  const drawFront = (run, layer, dashed, context, area) => {
    if (!run.length || !layer || layer.front.length === 0) return;
    context.beginPath();
    let down = false;
    run.t.forEach((t, i) => {
      const front = layer.front[i];
      if (!front) { down = false; return; }
      const x = area.x + (t - span[0]) / (span[1] - span[0]) * area.w;
      const y = area.y + (1 - front / run.length) * area.h;
      down ? context.lineTo(x, y) : context.moveTo(x, y);
      down = true;
    });
    context.lineJoin = "round";
    context.setLineDash(dashed ? [6, 4] : []);
    for (const [color, width] of [["#000000", 4], ["#ffffff", 1.75]]) {
      context.strokeStyle = color;
      context.lineWidth = width;
      context.stroke();
    }
    context.setLineDash([]);
  };
  const drawAxes = (run, context, area) => {
    context.lineWidth = 1;
    context.strokeStyle = css("--line");
    context.fillStyle = css("--muted");
    context.strokeRect(area.x - 0.5, area.y - 0.5, area.w + 1, area.h + 1);
    const length = run.length ? 1000 * run.length : 1;
    const places = niceTicks(0, length, 5);
    context.textAlign = "right";
    for (const value of places) {
      const y = area.y + (1 - value / length) * area.h;
      context.fillRect(area.x - 5, y - 0.5, 5, 1);
      context.fillText(tickText(value, places), area.x - 8, y + 4);
    }
    const times = niceTicks(span[0], span[1], Math.max(2, area.w / 65));
    context.textAlign = "center";
    for (const value of times) {
      const x = area.x + (value - span[0]) / (span[1] - span[0]) * area.w;
      context.fillRect(x - 0.5, area.y + area.h, 1, 5);
      context.fillText(tickText(value, times), x, area.y + area.h + 18);
    }
  };
  const drawMap = (view, map, palette, range) => {
    const { run, place, canvas } = map;
    map.figure.hidden = !isShown(run) || !hasMode(run, view.mode);
    if (map.figure.hidden) return;
    const area = areaOf(map);
    const { context, ratio } = fitCanvas(canvas, place.clientWidth, place.clientHeight);
    const image = context.createImageData(Math.max(1, Math.round(area.w * ratio)), Math.round(area.h * ratio));
    paintField(view, run, image, palette, range);
    context.putImageData(image, Math.round(area.x * ratio), Math.round(area.y * ratio));
    drawAxes(run, context, area);
    context.save();
    context.beginPath();
    context.rect(area.x, area.y, area.w, area.h);
    context.clip();
    run.layers.forEach((layer, i) => {
      if (view.mode === "difference" || view.mode === i) drawFront(run, layer, i > 0, context, area);
    });
    context.restore();
  };
  const placeCursor = map => {
    const area = areaOf(map);
    const share = (moment - span[0]) / (span[1] - span[0]);
    map.cursor.hidden = !(share >= 0 && share <= 1);
    map.cursor.style.left = area.x + share * area.w + "px";
  };
  const drawMaps = view => {
    const palette = paletteOf(view);
    const range = findRange(view);
    drawScale(view, palette, range);
    view.note.hidden = view.mode !== "difference";
    for (const map of view.maps) {
      drawMap(view, map, palette, range);
      placeCursor(map);
    }
  };
  const tellPoint = (view, map, event) => {
    const area = areaOf(map);
    const box = map.place.getBoundingClientRect();
    const across = (event.clientX - box.left - area.x) / area.w;
    const up = 1 - (event.clientY - box.top - area.y) / area.h;
    if (across < 0 || across > 1 || up < 0 || up > 1) { map.output.textContent = ""; return; }
    const t = span[0] + across * (span[1] - span[0]);
    const point = Math.round(up * (view.points - 1));
    const value = valueAt(view, map.run, view.mode, indexAt(map.run.t, t) * view.points + point);
    map.output.textContent = format(Number(t.toPrecision(5))) + " s, " + format(map.run.xs[point]) +
      (map.run.length ? " mm: " : " L: ") + format(Number(value.toPrecision(5))) + " " + unitOf(view);
    stop();
    show(t);
  };
  const addMap = (view, grid, run) => {
    const figure = make("figure");
    const caption = make("figcaption");
    const name = make("span");
    name.append(make("span", { class: "swatch run" + run.run % 8 }), page.runs[run.run]);
    const output = make("output");
    caption.append(name, output);
    const place = make("div", { class: "map" });
    const label = view.name + " over place and time, " + page.runs[run.run];
    const canvas = make("canvas", { role: "img", "aria-label": label });
    const cursor = make("div", { class: "cursor" });
    place.append(canvas, cursor);
    figure.append(caption, place);
    grid.append(figure);
    const map = { run, figure, place, canvas, cursor, output };
    canvas.addEventListener("pointermove", event => {
      if (event.pointerType === "mouse") tellPoint(view, map, event);
    });
    canvas.addEventListener("pointerleave", () => { output.textContent = ""; });
    canvas.addEventListener("click", event => tellPoint(view, map, event));
    view.maps.push(map);
  };
  const addMaps = view => {
    const bar = make("div", { class: "choices" });
    bar.append(make("b", {}, view.name + " over place and time"));
    const modes = view.layers.map((layer, i) => [i, layer.role]);
    if (view.layers.length > 1) modes.push(["difference", view.layers[0].role + " \u2212 " + view.layers[1].role]);
    const choices = make("span", { class: "choice", role: "group", "aria-label": "shown in the maps" });
    for (const [mode, text] of modes) {
      const button = make("button", { "aria-pressed": String(mode === view.mode) }, text);
      button.addEventListener("click", () => {
        view.mode = mode;
        for (const other of choices.children) other.setAttribute("aria-pressed", String(other === button));
        drawMaps(view);
      });
      choices.append(button);
    }
    view.scale = make("canvas", { class: "scale", role: "img" });
    view.note = make("small", {}, "the colours end where 2 % of the differences are larger");
    view.scaleUnit = make("small");
    bar.append(choices, view.scale, view.scaleUnit, view.note);
    const grid = make("div", { class: "maps" });
    root.append(bar, grid);
    view.maps = [];
    for (const run of view.runs) addMap(view, grid, run);
    root.append(make("p", { class: "muted" }, "Upwards the " + view.along + ", to the right the time [s]" +
      (view.inMetres ? "; the line is the melting front, dashed where it is estimated" : "") +
      ". At most 300 instants per run are kept, closest where most happens; signals.csv has every row."));
  };

  const addView = profile => {
    const runs = profile.runs.map(run => ({
      run: run.run, t: run.t, length: run.length_m, layers: run.layers.map(decodeLayer),
      xs: Array.from({ length: profile.points }, (_, i) =>
        Number((i / (profile.points - 1) * (run.length_m ? 1000 * run.length_m : 1)).toPrecision(9)))
    }));
    // Without a length of each run there is only one scale that all of them have.
    const inMetres = runs.every(run => run.length);
    if (!inMetres) {
      for (const run of runs) {
        run.length = null;
        run.xs = run.xs.map((_, i) => Number((i / (profile.points - 1)).toPrecision(9)));
      }
    }
    const signals = profile.layers.map(layer => layer.signal);
    const series = signals.flatMap((signal, layer) =>
      runs.filter(run => run.layers[layer]).map(run => ({ signal, run: run.run, layer, of: run })));
    const view = {
      points: profile.points, layers: profile.layers, signals, runs, inMetres, mode: 0,
      unit: profile.unit === "degC" ? "\u00b0C" : profile.unit,
      name: profile.quantity === "T" ? "Temperature" : profile.quantity,
      along: inMetres ? "distance from the inlet [mm]" : "distance from the inlet as a share of the length",
      many: page.runs.length > 1,
      xs: [...new Set(runs.flatMap(run => run.xs))].sort((a, b) => a - b),
      plot: { signals, dashed: true, series }
    };
    views.push(view);
    return view;
  };

  // ---- the moment ----
  let drawing = false;
  const draw = () => {
    drawing = false;
    slider.value = moment;
    output.textContent = "t = " + moment.toFixed(3) + " s";
    for (const view of views) {
      view.entry.graph.updateOptions({ file: rowsAt(view) });
      view.maps.forEach(placeCursor);
    }
  };
  const show = t => {
    moment = t;
    if (!drawing) requestAnimationFrame(draw);
    drawing = true;
  };
  let started = null;
  const stop = () => {
    started = null;
    play.textContent = "\u25b6 play";
  };
  const advance = now => {
    if (!started) return;
    const t = started.moment + (now - started.at) / 1000 * (span[1] - span[0]) / playing_s;
    show(Math.min(t, span[1]));
    if (t >= span[1]) stop(); else requestAnimationFrame(advance);
  };
  const start = () => {
    const isInside = moment >= span[0] && moment < span[1] - 1e-6 * (span[1] - span[0]);
    started = { at: performance.now(), moment: isInside ? moment : span[0] };
    play.textContent = "\u25a0 stop";
    requestAnimationFrame(advance);
  };

  const bar = make("div", { class: "scrub" });
  const play = make("button", { class: "play" }, "\u25b6 play");
  const slider = make("input", { type: "range", step: "any", "aria-label": "moment of the profiles" });
  const output = make("output");
  bar.append(play, slider, output);
  play.addEventListener("click", () => { started ? stop() : start(); });
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });

  // The vertical scale stands still while the profile moves.
  const holdScale = view => {
    let [low, high] = [Infinity, -Infinity];
    for (const run of view.runs) {
      const [first, last] = span.map(t => indexAt(run.t, t));
      for (const layer of run.layers.filter(Boolean)) {
        for (const value of layer.values.subarray(first * view.points, (last + 1) * view.points)) {
          if (value < low) low = value;
          if (value > high) high = value;
        }
      }
    }
    if (!(low <= high)) return;
    const margin = 0.05 * (high - low) || 0.5;
    view.entry.graph.updateOptions({ valueRange: [low - margin, high + margin] });
  };
  const follow = () => {
    const next = bench.visibleWindow();
    if (next[0] === span[0] && next[1] === span[1]) return;
    span = next;
    slider.min = span[0];
    slider.max = span[1];
    slider.value = moment;
    for (const view of views) {
      holdScale(view);
      drawMaps(view);
    }
  };

  for (const profile of page.profiles) {
    const view = addView(profile);
    addProfilePlot(view);
    if (views.length === 1) root.append(bar);
    addMaps(view);
  }
  const first = views[0].runs[0];
  moment = first.t[Math.floor(first.t.length / 4)];
  follow();
  draw();
  bench.listeners.window.push(follow);
  bench.listeners.moment.push(t => { if (!started) show(t); });
  bench.listeners.redraw.push(() => {
    for (const view of views) {
      bench.restyle(view.entry);
      drawMaps(view);
    }
  });
  new ResizeObserver(() => views.forEach(drawMaps)).observe(root);
})();
)js";

}  // namespace meltbench::report
