// The page of a raw image: zoomed to single pixels, with all that is known of each.

import { clamp, length, percentile, significant, ticks, withError } from "./numbers.js";
import { plane, readBytes, readFacts } from "./planes.js";
import { colorTable, KINDS } from "./colors.js";
import { draw, numbersTexture, openGl, program } from "./gl.js";
import { imageWindow } from "./window.js";
import { watchGestures, watchKeys } from "./gestures.js";
import {
  apology, button, choice, colorBar, element, fillStage, keyList, notes, readout, slider, styleColor, toggle,
} from "./panel.js";
import { readLenses } from "./lenses.js";
import { chiefRays, imagesOf } from "./sight.js";
import { paintOverlay } from "./raw_overlay.js";

const REACH = 2, SHOWS = 1.2; // pixels around a place that are asked, and how near to it what they show is

async function rawImage(facts) {
  const stage = document.getElementById("stage");
  const [canvas, overlay] = ["picture", "overlay"].map((id) => document.getElementById(id));
  const gl = openGl(canvas);
  if (!gl) {
    apology("This browser offers no WebGL2, which the viewer needs: the picture is a small copy of the image. Another "
      + "browser, or this one with hardware acceleration switched on, shows all.");
    return;
  }
  const { rows, columns, block, first, unit } = facts;
  const bytes = readBytes();
  const showing = program(gl, "raw"), coloring = program(gl, "values");
  const seen = imageWindow(columns, rows, () => ({ width: stage.clientWidth, height: stage.clientHeight }));
  const state = { shown: "image", stops: 0, cells: false, centres: false, hover: null, cursor: null, images: [] };
  const colored = {}, planes = {};
  let channels = [], lenses = null, rays = null, picture = null;

  // Pixels of the page, counted from its corner, and places on the sensor, where whole numbers are centres of pixels.
  const onSensor = ({ x, y }) => ({ row: first[0] + y * block - 0.5, column: first[1] + x * block - 0.5 });
  const inPage = ({ row, column }) => ({ x: (column + 0.5 - first[1]) / block, y: (row + 0.5 - first[0]) / block });
  const inside = (x, y) => x >= 0 && y >= 0 && x < columns && y < rows;
  /** The pixel of the page around a place of it: its number, and the row and column of its middle on the sensor. */
  const pixelAt = ({ x, y }) => {
    const [column, row] = [Math.floor(x), Math.floor(y)];
    if (!inside(column, row)) return null;
    const middle = Math.floor(block / 2);
    return {
      number: row * columns + column, x: column, y: row,
      row: first[0] + row * block + middle, column: first[1] + column * block + middle,
    };
  };
  const lensOf = (pixel) => (lenses ? lenses.at(pixel.number, pixel) : -1);

  // ---- what is drawn ----

  const paint = () => {
    const viewport = [0, 0, canvas.width, canvas.height];
    const place = seen.place(canvas.height), ground = styleColor("--ground"), size = [columns, rows];
    const shown = colored[state.shown];
    if (shown) draw(gl, coloring, { viewport, place, ground, size, plane: shown.texture, table: shown.table, range: shown.range });
    else draw(gl, showing, { viewport, place, ground, size, picture, gain: 2 ** state.stops / facts.white });
    const pen = overlay.getContext("2d");
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, stage.clientWidth, stage.clientHeight);
    paintOverlay(pen, {
      lenses, scale: seen.scale / block, cells: state.cells, centres: state.centres, images: state.images,
      size: { width: stage.clientWidth, height: stage.clientHeight },
      toStage: (place) => seen.toStage(inPage(place)),
      cursor: state.cursor && {
        row: first[0] + state.cursor.y * block, column: first[1] + state.cursor.x * block, block,
      },
    });
    stage.dataset.frames = Number(stage.dataset.frames ?? 0) + 1;
  };
  let asked = false;
  const redraw = () => {
    if (asked || !picture) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; paint(); });
  };

  // ---- what is said of a pixel ----

  const valueText = (values, error) => {
    if (values.every(Number.isNaN)) return "–";
    const enough = error > 0 ? clamp(Math.ceil(Math.log10(Math.max(...values.map(Math.abs)) / error)) + 1, 2, 5) : 4;
    return `${values.map((value) => significant(value, enough)).join(", ")}`;
  };
  const describe = (pixel) => {
    if (!pixel) {
      atCursor.show([["", "Point at a pixel, or walk with the arrow keys."]]);
      return;
    }
    const { number } = pixel;
    const value = (name) => (planes[name] ? planes[name][number] : NaN);
    const has = (name, text) => (planes[name] ? text : null);
    const error = value("error");
    const lens = lensOf(pixel);
    const virtual = value("virtual_depth");
    const disparity = planes.disparity ? value("disparity")
      : planes.virtual_depth && facts.lenses ? facts.lenses.pitch / virtual : NaN;
    const type = lens < 0 ? -1 : lenses.type[lens];
    const focal = facts.lenses?.focal_lengths ?? [];
    atCursor.show([
      ["Pixel (row, column)", `${pixel.row}, ${pixel.column}`],
      ["Microlens", lenses && (lens < 0 ? "none" : lenses.name(lens) + (lenses.known ? "" : ", by its centre"))],
      ["Type", lenses && (type < 0 ? "–" : `${type}, f = ${significant(focal[type], 4)} mm`)],
      ["Depth", has("depth", value("depth") === Infinity ? "nothing met" : length(value("depth"), 5))],
      ["Virtual depth", has("virtual_depth", significant(virtual, 4))],
      ["Disparity", planes.disparity || (planes.virtual_depth && facts.lenses)
        ? `${significant(disparity, 4)}${Number.isFinite(disparity) ? " px" : ""}` : null],
      [channels.length === 3 ? "Value R, G, B" : "Value", valueText(channels.map((channel) => channel[number]), error)],
      ["Standard error", has("error", significant(error, 2))],
      ["", `Values in ${unit}${facts.block > 1 ? `, means of ${block} × ${block} pixels` : ""}.`],
      ["", state.images.length ? imagesText() : null],
    ]);
  };
  const imagesText = () => {
    const hidden = state.images.filter((image) => image.hidden).length;
    const shown = state.images.length - hidden;
    return `The same point is seen through ${shown} microlens${shown === 1 ? "" : "es"}`
      + (hidden ? `, and hidden in ${hidden} more (dashed).` : ".");
  };

  /** Where the chief ray of the point that a pixel shows meets the sensor: rays of rim pixels run beside it. */
  const chiefPlace = (pixel) => {
    const off = (name) => (planes[name] && Number.isFinite(planes[name][pixel.number]) ? planes[name][pixel.number] : 0);
    return { row: pixel.row + off("beside_row"), column: pixel.column + off("beside_column") };
  };
  /** Microlenses and depths of the pixels that show what is around a place; null where it is not on the page. */
  const look = (place) => {
    const { x, y } = inPage(place);
    if (!inside(Math.floor(x), Math.floor(y))) return null;
    const around = [];
    for (let i = -REACH; i <= REACH; i++)
      for (let j = -REACH; j <= REACH; j++) {
        const pixel = pixelAt({ x: Math.floor(x) + i + 0.5, y: Math.floor(y) + j + 0.5 });
        if (!pixel) continue;
        const shows = chiefPlace(pixel);
        if (Math.hypot(shows.row - place.row, shows.column - place.column) < SHOWS * block)
          around.push({ lens: lensOf(pixel), depth: planes.depth[pixel.number] });
      }
    return around;
  };
  const choose = (pixel) => {
    state.cursor = pixel;
    state.images = [];
    stage.dataset.images = "[]";
    if (pixel && rays) {
      const lens = lensOf(pixel), depth = planes.depth[pixel.number];
      if (lens >= 0 && Number.isFinite(depth)) {
        state.images = imagesOf(rays, lenses, rays.point(lens, chiefPlace(pixel), depth), look);
        stage.dataset.images = JSON.stringify(state.images.map(({ lens: n, row, column, hidden }) =>
          ({ i: lenses.i[n], j: lenses.j[n], row, column, hidden })));
      }
    }
    describe(pixel);
    redraw();
  };

  // ---- controls ----

  const expose = (stops) => { state.stops = clamp(stops, -10, 10); exposure.set(state.stops); redraw(); };
  const showOnly = (shown) => {
    state.shown = shown;
    kinds.set(shown);
    const named = colored[shown];
    if (named) bar.show(named.title, named.map, named.ticks);
    else bar.hide();
    exposure.hide(Boolean(named));
    redraw();
  };
  const overlaid = (name, on) => { state[name] = on; toggles[name].set(on); redraw(); };
  const zoomed = (factor, at) => { seen.zoom(factor, at); redraw(); };
  const fit = () => { seen.fit(); redraw(); };
  const actual = () => { seen.actual(); redraw(); };
  const clear = () => { choose(null); };
  const TITLES = {
    depth: ["Depth", "Depth, mm (even steps of its reciprocal)"], virtual_depth: ["Virtual depth", "Virtual depth (even steps of its reciprocal)"],
    disparity: ["Disparity", "Disparity between neighbouring microlenses, px"], error: ["Error", `Standard error, ${unit}`],
  };
  const kinds = choice({
    id: "shown", label: "Show", value: "image", change: showOnly,
    options: [["image", "Image"], ...["depth", "virtual_depth", "disparity", "error"]
      .filter((name) => facts.planes[name]).map((name) => [name, TITLES[name][0]])],
  });
  const exposure = slider({
    id: "exposure", label: "Exposure", min: -10, max: 10, value: 0, input: expose,
    text: (stops) => `${stops > 0.005 ? "+" : ""}${significant(stops, 2)} EV`,
  });
  const toggles = {
    cells: toggle({ id: "cells", label: "Cells of the lattice", value: false, change: (on) => overlaid("cells", on) }),
    centres: toggle({ id: "centres", label: "Centres of micro images", value: false, change: (on) => overlaid("centres", on) }),
  };
  const bar = colorBar();
  const atCursor = readout("At the cursor");

  const hovered = (point) => (point ? pixelAt(seen.toImage(point)) : null);
  watchGestures(stage, {
    hover: (point) => { state.hover = hovered(point); describe(state.hover ?? state.cursor); },
    leave: () => { state.hover = null; describe(state.cursor); },
    drag: (dx, dy) => { seen.pan(dx, dy); redraw(); },
    tap: (point) => choose(hovered(point)),
    zoom: zoomed,
    pan: (dx, dy) => { seen.pan(dx, dy); redraw(); },
  });
  const walk = (dx, dy) => (far) => {
    const by = far ? 10 : 1;
    const from = state.cursor ?? pixelAt({ x: columns / 2, y: rows / 2 });
    const to = pixelAt({ x: clamp(from.x + dx * by, 0, columns - 1) + 0.5, y: clamp(from.y + dy * by, 0, rows - 1) + 0.5 });
    seen.reveal(to.x + 0.5, to.y + 0.5);
    choose(to);
  };
  const names = ["image", ...["depth", "virtual_depth", "disparity", "error"].filter((name) => facts.planes[name])];
  watchKeys({
    ArrowLeft: walk(-1, 0), ArrowRight: walk(1, 0), ArrowUp: walk(0, -1), ArrowDown: walk(0, 1),
    "+": () => zoomed(1.5), "=": () => zoomed(1.5), "-": () => zoomed(1 / 1.5), "0": fit, "1": actual,
    e: () => expose(state.stops + 0.25), E: () => expose(state.stops - 0.25),
    d: () => showOnly(names[(names.indexOf(state.shown) + 1) % names.length]),
    l: () => lenses && overlaid("cells", !state.cells), c: () => lenses && overlaid("centres", !state.centres),
    Escape: clear,
  });

  const focal = facts.lenses?.focal_lengths ?? [];
  const legend = focal.length > 1 && element("div", { className: "kinds" }, ...focal.map((f, type) => {
    const mark = element("i");
    mark.style.background = KINDS[type % KINDS.length];
    return element("span", {}, mark, `type ${type}, f = ${significant(f, 4)} mm`);
  }));
  const step = 100 * (facts.image[0].step / 2);
  document.getElementById("panel").replaceChildren(
    kinds.made, bar.made,
    element("div", { className: "group" }, exposure.made),
    ...(facts.lenses ? [element("div", { className: "group" },
      ...(facts.lenses.cell ? [toggles.cells.made] : []), toggles.centres.made, ...(legend ? [legend] : []))] : []),
    atCursor.made,
    element("div", { className: "buttons" },
      button("−", "Zoom out", () => zoomed(1 / 1.5)), button("+", "Zoom in", () => zoomed(1.5)),
      button("Fit", "Show all of it", fit), button("1 : 1", "Pixels of the screen are pixels of the image", actual),
      button("Clear", "No pixel chosen", clear)),
    keyList([
      ["wheel, pinch", "zoom, to single pixels"], ["drag", "moves the image"],
      ["click, tap", facts.sight ? "lights up all images of the point that the pixel shows" : "chooses a pixel"],
      ["← → ↑ ↓", "from pixel to pixel, with shift by ten"], ["e E", "exposure up, down"], ["d", "show the next"],
      ...(facts.lenses ? [["l, c", "cells of the lattice, centres"]] : []),
      ["+ − 0 1", "zoom, fit, 1 : 1"], ["Esc", "no pixel chosen"],
    ]),
    notes("What is stored", [
      `${rows} × ${columns} pixels${block > 1 ? `, each the mean of ${block} × ${block}; depths and microlenses are of their middles` : ""}. `
        + `Values are kept within ${significant(step, 2)} % of themselves, standard errors (one standard deviation, the root mean `
        + `square over the channels) within ${significant(Math.max(1, 50 * (facts.planes.error?.step ?? 0)), 2)} %, depths in 65 534 steps of their reciprocals.`,
      `White is ${significant(facts.white, 3)} ${unit}.${facts.samples ? ` Up to ${facts.samples} paths a pixel.` : ""} Grey: there is no value.`,
      ...(facts.sight ? ["Images of a point are found by chief rays through the real lens, as a polynomial that is good to "
        + `${significant(facts.sight.error, 2)} pixels (99 % of rays). They light up where the page's pixels belong to that microlens, and are `
        + "dashed where these show something else: there the point is hidden."] : []),
      ...facts.left_out,
    ]));

  // ---- begin ----

  fillStage(stage, [canvas, overlay], () => { seen.resized(); redraw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  describe(null);
  channels = await Promise.all(facts.image.map((each) => plane(bytes, each, columns)));
  const numbers = new Float32Array(4 * rows * columns);
  for (let n = 0; n < rows * columns; n++) {
    const values = [0, 1, 2].map((k) => channels[channels.length === 3 ? k : 0][n]);
    // An infinite value is shown as white.
    if (values.some(Number.isNaN)) continue;
    values.forEach((value, k) => { numbers[4 * n + k] = clamp(value, -1e30, 1e30); });
    numbers[4 * n + 3] = 1;
  }
  picture = numbersTexture(gl, numbers, columns, rows);
  paint();
  stage.classList.add("live");
  if (facts.lenses) lenses = await readLenses(bytes, facts.lenses, columns);
  await Promise.all(Object.entries(facts.planes).map(async ([name, each]) => { planes[name] = await plane(bytes, each, columns); }));
  if (facts.sight) rays = chiefRays(facts.sight, lenses);

  for (const name of names.slice(1)) {
    const reciprocal = name === "depth" || name === "virtual_depth";
    const values = planes[name].map((value) => (reciprocal ? 1 / value : value));
    const sent = values.map((value, n) =>
      (Number.isFinite(value) && !(reciprocal && planes[name][n] === Infinity) ? value : 3e38));
    const known = sent.map((value) => (value > 1e38 ? NaN : value));
    let [low, high] = name === "error" ? [0, percentile(known, 0.98)] : [percentile(known, 0.01), percentile(known, 0.99)];
    if (!(high > low)) [low, high] = Number.isFinite(low) ? [low - 0.5 * Math.abs(low || 1), low + 0.5 * Math.abs(low || 1)] : [0, 1];
    const share = (value) => (value - low) / (high - low);
    const marks = reciprocal && low * high > 0
      ? ticks(1 / high, 1 / low, 4).map((value) => [share(1 / value), significant(value, 3)])
      : ticks(low, high, 4).map((value) => [share(value), significant(reciprocal ? 1 / value : value, 3)]);
    const map = name === "error" ? "cividis" : "viridis";
    colored[name] = {
      title: TITLES[name][1], map, range: [low, high], ticks: marks.filter(([at]) => at >= 0 && at <= 1),
      texture: numbersTexture(gl, sent, columns, rows), table: numbersTexture(gl, colorTable(map), 256, 1),
    };
  }
  stage.dataset.ready = "yes";
}

rawImage(readFacts().raw).catch((problem) => {
  apology(`The viewer stopped: ${problem.message}. The picture is a small copy of the image.`);
  throw problem;
});
