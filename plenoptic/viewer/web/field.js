// The page of a light field: what is shown, and what moves it.

import { clamp, length, percentile, significant, withError } from "./numbers.js";
import { readBytes, readFacts } from "./planes.js";
import { draw, openGl, program } from "./gl.js";
import { imageWindow } from "./window.js";
import { watchGestures, watchKeys } from "./gestures.js";
import {
  apology, button, choice, colorBar, element, fillStage, keyList, notes, readout, slider, styleColor,
} from "./panel.js";
import { distanceAt, mappedDisparity, matcher } from "./focus.js";
import { fieldPictures, offsetAt, opening } from "./field_pictures.js";
import { pupilMap } from "./pupil.js";
import { fieldPlanes } from "./field_planes.js";

const GAP = 2;                 // pixels between views of the sheet
const SLICE = 0.3, LEAST = 72; // height of the slice: share of the stage, CSS pixels
const THIRDS = [1 / 6, 1 / 2, 5 / 6];  // of the picture: places by which it is judged what is in focus at first
const GLIDE = 220;             // ms that the focus takes to move to what was clicked

async function lightField(facts) {
  const stage = document.getElementById("stage");
  const [canvas, overlay] = ["picture", "overlay"].map((id) => document.getElementById(id));
  const gl = openGl(canvas);
  if (!gl) {
    apology("This browser offers no WebGL2, which the viewer needs: the picture shows the central view. Another "
      + "browser, or this one with hardware acceleration switched on, shows all.");
    return;
  }
  const { rows, columns, u, v, focus } = facts;
  const bytes = readBytes();
  const pictures = fieldPictures(gl, facts);
  const coloring = program(gl, "values");
  const matched = focus && matcher(gl, pictures.views, pictures.padded, pictures.setTaps);
  const most = Math.hypot(u.length - 1, v.length - 1) + 1;
  const state = {
    shown: "picture", viewpoint: [...facts.middle], disparity: 0, stops: 0, row: Math.floor(rows / 2), mark: null,
    across: Math.max(1, Math.min(u.length, v.length)),
  };
  const start = structuredClone(state);
  const planes = {};
  let loaded = 0, gliding = 0;

  // ---- what is drawn ----

  const sliceHeight = () => (state.shown === "slice"
    ? Math.round(Math.max(LEAST, SLICE * stage.clientHeight)) : 0);
  const size = () => ({ width: stage.clientWidth, height: stage.clientHeight - sliceHeight() });
  const pictureWindow = imageWindow(columns, rows, size);
  const sheetWindow = imageWindow(u.length * (columns + GAP) - GAP, v.length * (rows + GAP) - GAP, size);
  const seen = () => (state.shown === "sheet" ? sheetWindow : pictureWindow);
  const gain = () => (facts.top / facts.white) * 2 ** state.stops;
  const chosen = () => (state.shown === "single"
    ? [{ i: Math.round(state.viewpoint[0]), j: Math.round(state.viewpoint[1]), share: 1 }]
    : opening(pictures.counts, state.viewpoint, state.across));

  const paint = () => {
    const ground = styleColor("--ground");
    const slice = Math.round(sliceHeight() * devicePixelRatio);
    const viewport = [0, slice, canvas.width, canvas.height - slice];
    const place = seen().place(canvas.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (state.shown === "sheet") pictures.sheet(viewport, place, ground, gain(), GAP);
    else if (planes[state.shown]) {
      const { texture, table, range } = planes[state.shown];
      draw(gl, coloring, { viewport, place, ground, plane: texture, table, range, size: [columns, rows] });
    } else {
      const from = state.shown === "single" ? state.viewpoint.map(Math.round) : state.viewpoint;
      pictures.refocus(chosen(), from, state.disparity);
      pictures.show(viewport, place, ground, gain());
      if (slice)
        pictures.slice([0, 0, canvas.width, slice - 4], place, ground, gain(), from, state.disparity, state.row);
    }
    paintOverlay();
    const alone = state.shown === "single";
    pupil.paint(chosen(), alone ? state.viewpoint.map(Math.round) : state.viewpoint, alone ? 1 : state.across);
    stage.dataset.frames = Number(stage.dataset.frames ?? 0) + 1;
  };
  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; paint(); });
  };

  const paintOverlay = () => {
    const pen = overlay.getContext("2d");
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, stage.clientWidth, stage.clientHeight);
    const line = (path) => {
      for (const [width, color] of [[3, "rgba(0,0,0,0.55)"], [1.25, "#ffffff"]]) {
        pen.lineWidth = width;
        pen.strokeStyle = color;
        pen.beginPath();
        path();
        pen.stroke();
      }
    };
    if (state.shown === "slice") {
      const y = pictureWindow.toStage({ x: 0, y: state.row + 0.5 }).y;
      const [left, right] = [0, columns].map((x) => pictureWindow.toStage({ x, y: 0 }).x);
      line(() => { pen.moveTo(Math.max(left, 0), y); pen.lineTo(Math.min(right, stage.clientWidth), y); });
    }
    if (state.mark && state.shown === "picture") {
      const at = pictureWindow.toStage(state.mark);
      line(() => pen.arc(at.x, at.y, 9, 0, 2 * Math.PI));
    }
  };

  // ---- what moves ----

  const pupil = pupilMap(u.length, v.length, (i, j) => look(i, j));

  const look = (i, j) => {
    state.viewpoint = [clamp(i, 0, u.length - 1), clamp(j, 0, v.length - 1)];
    controls.u?.set(state.viewpoint[0] - facts.middle[0]);
    controls.v?.set(state.viewpoint[1] - facts.middle[1]);
    state.mark = null;
    redraw();
  };
  const open = (across) => {
    state.across = clamp(across, 1, most);
    controls.across?.set(state.across);
    redraw();
  };
  const focusOn = (disparity) => {
    if (!focus || !Number.isFinite(disparity)) return;
    state.disparity = clamp(disparity, focus.low, focus.high);
    controls.focus.set(state.disparity);
    redraw();
  };
  const glideTo = (disparity) => {
    if (!Number.isFinite(disparity)) return;
    const [from, began, own] = [state.disparity, performance.now(), ++gliding];
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const move = () => {
      if (own !== gliding) return;
      const share = still ? 1 : clamp((performance.now() - began) / GLIDE, 0, 1);
      focusOn(from + (disparity - from) * share * share * (3 - 2 * share));
      if (share < 1) requestAnimationFrame(move);
    };
    move();
  };
  const expose = (stops) => {
    state.stops = clamp(stops, -6, 6);
    controls.exposure.set(state.stops);
    redraw();
  };
  const showOnly = (shown) => {
    state.shown = shown;
    controls.shown.set(shown);
    const summed = shown === "picture" || shown === "slice";
    controls.across?.hide(!summed);
    controls.focus?.hide(!summed);
    controls.row.hide(shown !== "slice");
    controls.exposure.hide(Boolean(planes[shown]));
    viewpoint.hidden = !summed && shown !== "single";
    describeColors();
    seen().resized();
    redraw();
  };
  const sliceAt = (row) => {
    state.row = clamp(Math.floor(row), 0, rows - 1);
    controls.row.set(state.row);
    redraw();
  };
  const focusAt = async (point) => {
    if (!focus || state.shown !== "picture") return;
    state.mark = point;
    const from = state.viewpoint;
    if (planes.depth) {
      const away = { x: offsetAt(u, from[0]) - u[facts.middle[0]], y: facts.ratio * (offsetAt(v, from[1]) - v[facts.middle[1]]) };
      glideTo(mappedDisparity(planes.depth.shown, rows, columns, point, away));
    } else glideTo(await matched(pictures.offsets(from), point, focus));
    redraw();
  };

  /** The disparity that the scene has in its middle: what is in focus at first; 0 where it is not known. */
  const midScene = async () => {
    const found = planes.depth ? [...planes.depth.shown] : [];
    for (const x of planes.depth ? [] : THIRDS)
      for (const y of THIRDS)
        found.push(await matched(pictures.offsets(facts.middle), { x: x * columns, y: y * rows }, focus));
    const known = found.filter(Number.isFinite);
    return known.length > found.length / 3 ? percentile(known, 0.5) : 0;
  };

  // ---- controls ----

  const distanceText = (disparity) => {
    const distance = distanceAt(focus, disparity);
    const moves = `disparity ${significant(disparity * facts.block, 3)} px`;
    return Number.isFinite(distance) ? `${length(distance, 4)} · ${moves}` : moves;
  };
  const placed = (name, [low, high]) => (value) => {
    if (Math.abs(value) < 0.05) return "middle";
    return `${significant(Math.abs(value), 2)} ${value > 0 ? high : low}`;
  };
  const controls = {
    shown: choice({
      id: "shown", label: "Show", value: state.shown, change: showOnly,
      options: [
        ["picture", "Picture"], ["single", "One view"], ["sheet", "All views"], ["slice", "Slice"],
        ...(facts.disparity ? [["depth", "Depth"], ["depth_error", "Depth error"]] : []),
        ...(facts.error ? [["error", "Error"]] : []),
      ],
    }),
    exposure: slider({
      id: "exposure", label: "Exposure", min: -6, max: 6, value: 0, input: expose,
      text: (stops) => `${stops > 0.005 ? "+" : ""}${significant(stops, 2)} EV`,
    }),
    row: slider({
      id: "row", label: "Row of the slice", min: 0, max: rows - 1, step: 1, value: state.row, input: sliceAt,
      text: (row) => `${row * facts.block}`,
    }),
  };
  if (focus)
    controls.focus = slider({
      id: "focus", label: "Focus", min: focus.low, max: focus.high, value: 0, text: distanceText,
      input: (disparity) => { gliding++; state.mark = null; focusOn(disparity); },
    });
  if (most > 1)
    controls.across = slider({
      id: "aperture", label: "Aperture", min: 1, max: most, value: state.across, input: open,
      text: (across) => {
        const summed = opening(pictures.counts, state.viewpoint, across).length;
        return `${significant(across, 2)} across · ${summed} view${summed > 1 ? "s" : ""}`;
      },
    });
  for (const [axis, name, offsets, words] of [[0, "u", u, ["left", "right"]], [1, "v", v, ["up", "down"]]])
    if (offsets.length > 1)
      controls[name] = slider({
        id: `view-${name}`, label: axis ? "Viewpoint, down" : "Viewpoint, across", value: 0,
        min: -facts.middle[axis], max: offsets.length - 1 - facts.middle[axis], text: placed(name, words),
        input: (value) => (axis ? look(state.viewpoint[0], facts.middle[1] + value) : look(facts.middle[0] + value, state.viewpoint[1])),
      });
  const viewpoint = element("div", { className: "group viewpoint" }, pupil.made,
    element("div", {}, ...["u", "v"].filter((name) => controls[name]).map((name) => controls[name].made)));
  const bar = colorBar();
  const atCursor = readout("At the cursor");
  const restart = () => {
    gliding++;
    Object.assign(state, structuredClone(start), { shown: state.shown });
    look(...state.viewpoint);
    open(state.across);
    focusOn(start.disparity);
    expose(0);
    seen().fit();
    redraw();
  };
  const zoomed = (factor, at) => { seen().zoom(factor, at); redraw(); };
  const fit = () => { seen().fit(); redraw(); };
  const actual = () => { seen().actual(); redraw(); };

  const describeColors = () => {
    const shown = planes[state.shown];
    if (!shown) return bar.hide();
    bar.show(shown.title, shown.map, shown.ticks());
  };

  // ---- at the cursor ----

  const describe = (point) => {
    const { x, y } = point ? pictureWindow.toImage(point) : { x: -1, y: -1 };
    const [column, row] = [Math.floor(x), Math.floor(y)];
    if (state.shown === "sheet" || column < 0 || row < 0 || column >= columns || row >= rows) {
      atCursor.show([["", state.shown === "sheet" ? "Click a view to see it alone." : "Point at the picture."]]);
      return;
    }
    const at = row * columns + column;
    const value = (name) => (planes[name] ? planes[name].values[at] : NaN);
    const disparity = value("depth");
    const distance = focus && Number.isFinite(disparity) ? distanceAt(focus, disparity) : NaN;
    const slope = focus ? (distanceAt(focus, disparity + 1e-3) - distance) / 1e-3 : NaN;
    const found = (name, text) => (planes[name] ? text : null);
    atCursor.show([
      ["Row, column", `${row * facts.block}, ${column * facts.block}`],
      ["Depth", found("depth", Number.isFinite(distance)
        ? `${withError(distance, Math.abs(slope * value("depth_error")), 5)} mm` : "–")],
      ["Disparity", found("depth", Number.isFinite(disparity)
        ? `${withError(disparity * facts.block, value("depth_error") * facts.block, 3)} px` : "–")],
      ["Standard error", found("error", `${significant(value("error"), 3)} radiance`)],
    ]);
  };

  watchGestures(stage, {
    hover: describe,
    leave: () => describe(null),
    drag: (dx, dy) => {
      if (state.shown === "sheet" || planes[state.shown]) { seen().pan(dx, dy); redraw(); return; }
      const box = size();
      const reach = Math.min(box.width, box.height);
      look(state.viewpoint[0] + (dx / reach) * (u.length - 1) * 1.4, state.viewpoint[1] + (dy / reach) * (v.length - 1) * 1.4);
    },
    tap: (point) => {
      const at = seen().toImage(point);
      describe(point);
      if (state.shown === "sheet") {
        const [i, j] = [Math.floor(at.x / (columns + GAP)), Math.floor(at.y / (rows + GAP))];
        if (i < 0 || j < 0 || i >= u.length || j >= v.length) return;
        look(i, j);
        showOnly("single");
      } else if (at.x >= 0 && at.y >= 0 && at.x < columns && at.y < rows && point.y < size().height) {
        if (state.shown === "slice") sliceAt(at.y);
        else focusAt(at);
      }
    },
    zoom: zoomed,
    pan: (dx, dy) => { seen().pan(dx, dy); redraw(); },
  });
  const moveBy = (i, j) => () => {
    const size = state.shown === "single" ? 1 : 0.25;
    look(state.viewpoint[0] + i * size, state.viewpoint[1] + j * size);
  };
  const kinds = () => [...document.querySelectorAll("input[name=shown]")].map((radio) => radio.value);
  const refocus = (way) => () => {
    if (focus) { gliding++; focusOn(state.disparity + (way * (focus.high - focus.low)) / 60); }
  };
  watchKeys({
    ArrowLeft: moveBy(-1, 0), ArrowRight: moveBy(1, 0), ArrowUp: moveBy(0, -1), ArrowDown: moveBy(0, 1),
    ",": refocus(1), ".": refocus(-1),
    "[": () => open(state.across - 0.5), "]": () => open(state.across + 0.5),
    "+": () => zoomed(1.25), "=": () => zoomed(1.25), "-": () => zoomed(0.8), "0": fit, "1": actual,
    e: () => expose(state.stops + 0.25), E: () => expose(state.stops - 0.25),
    d: () => showOnly(kinds()[(kinds().indexOf(state.shown) + 1) % kinds().length]),
    PageUp: () => sliceAt(state.row - 1), PageDown: () => sliceAt(state.row + 1),
    Enter: () => focusAt({ x: columns / 2, y: rows / 2 }), Home: restart,
  });

  const kept = facts.quality === 100 ? "without losses" : `with losses (WebP, quality ${facts.quality})`;
  const [across, down, allRows, allColumns] = facts.whole;
  document.getElementById("panel").replaceChildren(
    controls.shown.made,
    element("div", { className: "group" },
      ...["focus", "across", "row", "exposure"].filter((name) => controls[name]).map((name) => controls[name].made)),
    viewpoint, bar.made,
    atCursor.made,
    element("div", { className: "buttons" },
      button("−", "Zoom out", () => zoomed(0.8)), button("+", "Zoom in", () => zoomed(1.25)),
      button("Fit", "Show all of it", fit), button("1 : 1", "Pixels of the screen are pixels of the picture", actual),
      button("Reset", "Viewpoint, focus, aperture and exposure as at first", restart)),
    keyList([
      ["drag", "moves the viewpoint"], ["click", focus ? "focuses there; in the slice, chooses the row" : "chooses the row of the slice"],
      ["wheel, pinch", "zoom"], ["shift + drag, two fingers", "move the picture"],
      ["← → ↑ ↓", "viewpoint"], [", .", "focus nearer, farther"], ["[ ]", "aperture"], ["e E", "exposure up, down"],
      ["d", "show the next"], ["+ − 0 1", "zoom, fit, 1 : 1"], ["Enter", "focus on the middle"],
      ["Page up, down", "row of the slice"], ["Home", "all as at first"],
    ]),
    notes("What is stored", [
      `${u.length} × ${v.length} views of ${rows} × ${columns} pixels`
        + (facts.block > 1 || u.length < across || v.length < down
          ? `, of ${across} × ${down} of ${allRows} × ${allColumns}: every pixel is the mean of ${facts.block} × ${facts.block}. ` : ". ")
        + `They are kept in 8 bits (sRGB), ${kept}. 255 is ${significant(facts.top, 3)} (radiance of the scene); `
        + `${facts.cut > 0 ? `${significant(100 * facts.cut, 2)} % of the values are brighter and cut.` : "nothing is brighter."}`,
      "The picture is the mean of the views in the aperture, in linear light, each moved by disparity times its "
        + "offset and read between pixels by bilinear interpolation. Grey: no view has light there.",
      ...(facts.disparity ? ["Depth is of the central view: the distance along the axis from the camera's origin, and its "
        + "standard error, one standard deviation. The map is grey where that is more than 0.15 of its range."] : []),
      ...(facts.error ? ["The error is one standard deviation of the central view's radiance, the root mean square over its channels."] : []),
    ]));

  // ---- begin ----

  controls.row.hide(true);
  fillStage(stage, [canvas, overlay], () => { pictureWindow.resized(); sheetWindow.resized(); redraw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  describe(null);
  await pictures.load(bytes, facts.middle, (count) => {
    loaded = count;
    paint();
    stage.classList.add("live");
    stage.dataset.views = loaded;
  });
  await fieldPlanes(gl, bytes, facts, planes);
  if (focus && state.disparity === start.disparity) {
    start.disparity = await midScene();
    focusOn(start.disparity);
  }
  stage.dataset.ready = "yes";
}

const begin = (facts) => lightField(facts).catch((problem) => {
  apology(`The viewer stopped: ${problem.message}. The picture shows the central view.`);
  throw problem;
});
begin(readFacts().light_field);
