// Depth and errors of the central view, as colours with their scales.

import { percentile, significant, ticks } from "./numbers.js";
import { plane } from "./planes.js";
import { colorTable } from "./colors.js";
import { numbersTexture } from "./gl.js";
import { disparityAt, distanceAt } from "./focus.js";

const UNSURE = 0.15; // standard error, as a part of the range of depth, from which on none is shown

const evenly = (low, high) => () =>
  ticks(low, high).map((value) => [(value - low) / (high - low || 1), significant(value, 2)]);

/** A scale from 0 on; numbers beside it are `unit` times those of the plane. */
function errors(title, unit = 1) {
  return (values) => {
    const high = Math.max(percentile(values, 0.98), 1e-12) || 1;
    return { map: "cividis", range: [0, high], title, ticks: evenly(0, high * unit) };
  };
}

function depths(focus, sure, block) {
  return (values) => {
    const ends = [percentile(values, 0.01), percentile(values, 0.99)];
    const [low, high] = ends[1] > ends[0] ? ends : [ends[0] - 0.5, ends[0] + 0.5];
    // Where there is no texture, what was found says nothing.
    const shown = values.map((value, n) => (sure[n] < UNSURE * (high - low) ? value : NaN));
    const [far, near] = [distanceAt(focus, low), distanceAt(focus, high)];
    const known = Number.isFinite(far) && Number.isFinite(near);
    const marks = () => ticks(near, far, 4).map((distance) =>
      [(disparityAt(focus, distance) - low) / (high - low), significant(distance, 3)]);
    return {
      map: "viridis", range: [low, high], shown,
      title: known ? "Depth of the central view, mm (even steps of disparity)" : "Disparity of the central view, px",
      ticks: () => (known ? marks() : evenly(low * block, high * block)()).filter(([share]) => share >= 0 && share <= 1),
    };
  };
}

/** Fill `planes` with what the page holds of depth, depth_error and error: numbers, textures, scales. */
export async function fieldPlanes(gl, bytes, facts, planes) {
  const { rows, columns } = facts;
  const prepare = async (name, block, make) => {
    if (!block) return;
    const values = await plane(bytes, block, columns);
    const { shown = values, ...described } = make(values);
    const sent = shown.map((value) => (Number.isFinite(value) ? value : 3e38));
    planes[name] = {
      ...described, values, shown, texture: numbersTexture(gl, sent, columns, rows),
      table: numbersTexture(gl, colorTable(described.map), 256, 1),
    };
  };
  await prepare("depth_error", facts.disparity_error, errors("Standard error of the disparity, px", facts.block));
  await prepare("depth", facts.disparity, depths(facts.focus, planes.depth_error?.values, facts.block));
  await prepare("error", facts.error, errors("Standard error of the central view, radiance"));
}
