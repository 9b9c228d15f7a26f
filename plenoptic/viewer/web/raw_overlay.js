// What is drawn over a raw image: cells and centres of microlenses, the cursor, images of one point.

import { KINDS } from "./colors.js";

const CELLS_FROM = 7, CENTRES_FROM = 12; // CSS pixels that a microlens takes at least where they are drawn

/** Draws with `pen`; `toStage` leads from rows and columns of the sensor to the stage. */
export function paintOverlay(pen, { lenses, toStage, scale, size, cells, centres, cursor, images }) {
  const outlined = (path, color, width) => {
    for (const [ink, wide] of [["rgba(0,0,0,0.7)", width + 2], [color, width]]) {
      pen.strokeStyle = ink;
      pen.lineWidth = wide;
      pen.beginPath();
      path();
      pen.stroke();
    }
  };
  const pitch = lenses ? lenses.facts.pitch * scale : 0;
  if (lenses && (cells || centres)) {
    const shown = [];
    const margin = 2 * pitch;
    for (let n = 0; n < lenses.count; n++) {
      const at = toStage({ row: lenses.row[n], column: lenses.column[n] });
      if (at.x > -margin && at.y > -margin && at.x < size.width + margin && at.y < size.height + margin)
        shown.push([n, at]);
    }
    if (cells && lenses.facts.cell && pitch >= CELLS_FROM) {
      pen.strokeStyle = "rgba(255,255,255,0.55)";
      pen.lineWidth = 1;
      pen.beginPath();
      for (const [, { x, y }] of shown)
        lenses.facts.cell.forEach(([row, column], k) => {
          const [right, down] = [x + column * scale, y + row * scale];
          if (k) pen.lineTo(right, down);
          else pen.moveTo(right, down);
          if (k === lenses.facts.cell.length - 1) pen.closePath();
        });
      pen.stroke();
    }
    if (centres && pitch >= CENTRES_FROM) {
      const reach = Math.min(6, pitch / 5);
      lenses.facts.focal_lengths.forEach((_, type) => {
        outlined(() => {
          for (const [n, { x, y }] of shown) {
            if (lenses.type[n] !== type) continue;
            pen.moveTo(x - reach, y);
            pen.lineTo(x + reach, y);
            pen.moveTo(x, y - reach);
            pen.lineTo(x, y + reach);
          }
        }, KINDS[type % KINDS.length], 1.25);
      });
    }
  }
  if (images.length) {
    // All else steps back a little, so that the images of the point are found at a glance.
    pen.fillStyle = "rgba(0,0,0,0.25)";
    pen.fillRect(0, 0, size.width, size.height);
    const radius = Math.max(5, 0.7 * scale);
    for (const { row, column, hidden } of images) {
      const { x, y } = toStage({ row, column });
      pen.setLineDash(hidden ? [2, 3] : []);
      outlined(() => { pen.moveTo(x + radius, y); pen.arc(x, y, radius, 0, 2 * Math.PI); }, hidden ? "#bbbbbb" : "#ffd23f", 2);
    }
    pen.setLineDash([]);
  }
  if (cursor) {
    const low = toStage({ row: cursor.row - 0.5, column: cursor.column - 0.5 });
    const side = Math.max(cursor.block * scale, 7);
    const shift = (cursor.block * scale - side) / 2;
    outlined(() => pen.rect(low.x + shift, low.y + shift, side, side), "#ffffff", 1.5);
  }
}
