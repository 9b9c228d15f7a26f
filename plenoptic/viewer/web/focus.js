// From disparity to distance, and from a place in the picture to its disparity.

import { clamp } from "./numbers.js";
import { draw, program, rowOf, target } from "./gl.js";

const TRIED = 96;

/** -z in mm at a disparity; NaN where it is not known. The table holds 1 / distance, which is nearly a line. */
export function distanceAt(focus, disparity) {
  const { low, high, closeness } = focus;
  const place = clamp(((disparity - low) / (high - low)) * (closeness.length - 1), 0, closeness.length - 1);
  const first = Math.min(Math.floor(place), closeness.length - 2);
  const [one, two] = [closeness[first], closeness[first + 1]];
  if (one === null || two === null) return NaN;
  return 1 / (one + (place - first) * (two - one));
}

/** The disparity that has a distance, or null: for the marks of a scale. */
export function disparityAt(focus, distance) {
  const { low, high, closeness } = focus;
  for (let k = 0; k + 1 < closeness.length; k++) {
    const [one, two] = [closeness[k], closeness[k + 1]];
    if (one === null || two === null) continue;
    const share = (1 / distance - one) / (two - one);
    if (share >= 0 && share <= 1) return low + ((k + share) / (closeness.length - 1)) * (high - low);
  }
  return null;
}

/** What the central view's map says of a place in the picture of a viewpoint that is (u, v) away from it. */
export function mappedDisparity(map, rows, columns, point, away) {
  const nearest = (x, y) => {
    for (let reach = 0; reach < 5; reach++) {
      const found = [];
      for (let i = -reach; i <= reach; i++)
        for (let j = -reach; j <= reach; j++) {
          const [column, row] = [Math.floor(x) + i, Math.floor(y) + j];
          if (column < 0 || row < 0 || column >= columns || row >= rows) continue;
          const value = map[row * columns + column];
          if (Number.isFinite(value)) found.push(value);
        }
      if (found.length) return found.sort((a, b) => a - b)[found.length >> 1];
    }
    return NaN;
  };
  let found = nearest(point.x, point.y);
  // Where the place is seen from the middle depends on what is looked for.
  for (let k = 0; k < 4 && Number.isFinite(found); k++)
    found = nearest(point.x + found * away.x, point.y + found * away.y);
  return found;
}

/** Finds the disparity at which the views agree best around a place, where no map tells it. */
export function matcher(gl, views, padded, setTaps) {
  const matching = program(gl, "match");
  const costs = target(gl, TRIED, 1, true);
  return async (offsets, point, { low, high }) => {
    if (!costs.floats) return NaN;
    const step = (high - low) / (TRIED - 1);
    draw(gl, matching, {
      viewport: [0, 0, TRIED, 1], views, count: setTaps(offsets), padded, point: [point.x, point.y],
      range: [low, step],
    }, costs);
    const row = await rowOf(gl, costs, TRIED);
    const cost = Array.from({ length: TRIED }, (_, k) => row[4 * k]);
    const best = cost.indexOf(Math.min(...cost));
    if (!(cost[best] < 100)) return NaN;
    // The lowest point of the parabola through three.
    const [one, two, three] = [cost[best - 1], cost[best], cost[best + 1]];
    const bend = one - 2 * two + three;
    return low + step * (best + (bend > 0 ? clamp((0.5 * (one - three)) / bend, -0.5, 0.5) : 0));
  };
}
