// Where other microlenses see what a pixel shows: chief rays as a polynomial of four variables. See sight.py.

const STEPS = 12, NEAR = 1e-4; // of Newton's method; pixels
const SAME = 0.02;             // depths that differ by this part belong to one surface

function exponents(degree) {
  const found = [];
  for (let a = 0; a <= degree; a++)
    for (let b = 0; a + b <= degree; b++)
      for (let c = 0; a + b + c <= degree; c++)
        for (let d = 0; a + b + c + d <= degree; d++) found.push([a, b, c, d]);
  return found;
}

/** Functions of the page's polynomial for its microlenses. */
export function chiefRays(facts, lenses) {
  const { degree, middle, half, series, straight } = facts;
  const powers = exponents(degree);
  const width = degree + 1;

  /** Pixel straight behind a microlens. */
  const straightAt = (n) => [0, 1].map((k) => straight[k] + straight[2 + k] * lenses.x[n] + straight[4 + k] * lenses.y[n]);

  /** The polynomial of a microlens in the offset of the pixel alone: [line number][power of row, of column]. */
  const ofLens = (n) => {
    const [s, t] = [(lenses.x[n] - middle[0]) / half[0], (lenses.y[n] - middle[1]) / half[1]];
    const table = Array.from({ length: 4 }, () => new Float64Array(width * width));
    powers.forEach(([a, b, c, d], k) => {
      const share = s ** a * t ** b;
      for (let line = 0; line < 4; line++) table[line][c * width + d] += share * series[line * powers.length + k];
    });
    return table;
  };
  /** x and y at a depth on the line of a pixel, and their derivatives by its row and column. */
  const met = (table, offset, depth) => {
    const [p, q] = [(offset[0] - middle[2]) / half[2], (offset[1] - middle[3]) / half[3]];
    const found = [0, 1].map(() => [0, 0, 0]);
    for (let c = 0; c <= degree; c++)
      for (let d = 0; c + d <= degree; d++) {
        const term = p ** c * q ** d;
        const byRow = c ? (c * p ** (c - 1) * q ** d) / half[2] : 0;
        const byColumn = d ? (d * p ** c * q ** (d - 1)) / half[3] : 0;
        for (let axis = 0; axis < 2; axis++) {
          const share = table[axis][c * width + d] - depth * table[2 + axis][c * width + d];
          found[axis][0] += share * term;
          found[axis][1] += share * byRow;
          found[axis][2] += share * byColumn;
        }
      }
    return found;
  };

  return {
    /** The point {x, y, depth} in the camera's frame that a place on the sensor shows through a microlens. */
    point(n, place, depth) {
      const from = straightAt(n);
      const [[x], [y]] = met(ofLens(n), [place.row - from[0], place.column - from[1]], depth);
      return { x, y, depth };
    },
    /** Where the chief ray of a point through a microlens meets the sensor; null where there is none near. */
    image(n, point) {
      const table = ofLens(n), from = straightAt(n);
      const centre = Number.isFinite(lenses.row[n]) ? [lenses.row[n] - from[0], lenses.column[n] - from[1]] : [0, 0];
      const offset = [...centre];
      const reach = 1.5 * lenses.facts.radius;
      for (let k = 0; k < STEPS; k++) {
        const [[x, a, b], [y, c, d]] = met(table, offset, point.depth);
        const area = a * d - b * c;
        if (!(Math.abs(area) > 1e-12)) return null;
        const [right, up] = [point.x - x, point.y - y];
        const moved = [(d * right - b * up) / area, (a * up - c * right) / area];
        offset[0] += moved[0];
        offset[1] += moved[1];
        if (Math.hypot(offset[0] - centre[0], offset[1] - centre[1]) > 3 * reach) return null;
        if (Math.hypot(...moved) < NEAR)
          return Math.hypot(offset[0] - centre[0], offset[1] - centre[1]) < reach
            ? { row: from[0] + offset[0], column: from[1] + offset[1] } : null;
      }
      return null;
    },
  };
}

/** Images of a point in all microlenses that show it: {lens, row, column, hidden}. `look` says what is at a place. */
export function imagesOf(rays, lenses, point, look) {
  const found = [];
  for (let n = 0; n < lenses.count; n++) {
    const place = rays.image(n, point);
    const around = place && look(place);
    if (!around) continue;
    const own = around.filter(({ lens, depth }) => lens === n && Number.isFinite(depth));
    if (!own.length) continue;
    // Something nearer at all of them stands before the point.
    const hidden = own.every(({ depth }) => Math.abs(depth / point.depth - 1) > SAME);
    found.push({ lens: n, ...place, hidden });
  }
  return found;
}
