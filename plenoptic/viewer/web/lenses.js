// Microlenses: a row of the page's table each, and which of them a pixel belongs to.

import { wholeNumbers } from "./planes.js";

const WIDTH = 7; // indices i, j, type, place on the array x, y in mm, centre of the image row, column

/** Of the page; `ofPixels` holds the number of each pixel's microlens, from 1 on, or is null. */
export async function readLenses(bytes, facts, columns) {
  const table = new Float32Array((await wholeNumbers(bytes, facts.table, WIDTH)).buffer);
  const ofPixels = facts.of_pixels && await wholeNumbers(bytes, facts.of_pixels, columns);
  const column = (k) => Float32Array.from({ length: facts.count }, (_, n) => table[WIDTH * n + k]);
  const [i, j, type, x, y, row, centreColumn] = Array.from({ length: WIDTH }, (_, k) => column(k));

  /** The microlens whose image has its centre nearest to a place, -1 farther away than a cell reaches. */
  const nearest = (place) => {
    let best = -1, least = (1.3 * facts.radius) ** 2;
    for (let n = 0; n < facts.count; n++) {
      const apart = (row[n] - place.row) ** 2 + (centreColumn[n] - place.column) ** 2;
      if (apart < least) [best, least] = [n, apart];
    }
    return best;
  };
  return {
    count: facts.count, i, j, type, x, y, row, column: centreColumn, facts,
    /** The microlens that a pixel belongs to: number of the pixel in the page, and its place on the sensor; or -1. */
    at: (number, place) => (ofPixels ? ofPixels[number] - 1 : nearest(place)),
    known: ofPixels !== null,
    name: (n) => (facts.free ? `number ${i[n]}` : `(${i[n]}, ${j[n]})`),
  };
}
