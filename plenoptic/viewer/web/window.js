// Which part of an image the stage shows: zoom and place.

import { clamp } from "./numbers.js";

const MOST = 96; // CSS pixels that one of the image becomes at most

/** Of an image of some columns and rows, on a stage whose size in CSS pixels is asked for each time. */
export function imageWindow(columns, rows, stageSize) {
  let scale = 1, x = columns / 2, y = rows / 2, fitted = true;

  const fitScale = () => {
    const { width, height } = stageSize();
    return Math.max(Math.min(width / columns, height / rows), 1e-3);
  };
  const settle = () => {
    const { width, height } = stageSize();
    const inside = (place, length, shown) =>
      shown >= length * scale ? length / 2 : clamp(place, shown / scale / 2, length - shown / scale / 2);
    x = inside(x, columns, width);
    y = inside(y, rows, height);
  };
  const self = {
    fit() { scale = fitScale(); fitted = true; settle(); },
    /** Pixel by pixel of the screen, with their edges on its. */
    actual() {
      const { width, height } = stageSize();
      scale = 1 / devicePixelRatio;
      fitted = false;
      settle();
      const onPixels = (place, shown) => Math.round((place - shown / scale / 2)) + shown / scale / 2;
      x = onPixels(x, width);
      y = onPixels(y, height);
    },
    /** After the stage has changed. */
    resized() { if (fitted) self.fit(); else settle(); },
    zoom(factor, at) {
      const { width, height } = stageSize();
      const point = at ?? { x: width / 2, y: height / 2 };
      const held = self.toImage(point);
      const least = Math.min(fitScale(), 1 / devicePixelRatio);
      scale = clamp(scale * factor, least, MOST);
      fitted = Math.abs(scale / fitScale() - 1) < 1e-3;
      x = held.x - (point.x - width / 2) / scale;
      y = held.y - (point.y - height / 2) / scale;
      settle();
    },
    pan(dx, dy) { x -= dx / scale; y -= dy / scale; settle(); },
    /** Bring a place of the image into sight. */
    reveal(column, row) {
      const { width, height } = stageSize();
      const margin = 24 / scale;
      x = clamp(x, column + margin - width / scale / 2, column - margin + width / scale / 2);
      y = clamp(y, row + margin - height / scale / 2, row - margin + height / scale / 2);
      settle();
    },
    toImage({ x: right, y: down }) {
      const { width, height } = stageSize();
      return { x: x + (right - width / 2) / scale, y: y + (down - height / 2) / scale };
    },
    toStage({ x: column, y: row }) {
      const { width, height } = stageSize();
      return { x: (column - x) * scale + width / 2, y: (row - y) * scale + height / 2 };
    },
    get scale() { return scale; },
    /** For shaders: the image's place at the lower left corner of the canvas, and its steps for each canvas pixel. */
    place(canvasHeight) {
      const ratio = devicePixelRatio;
      const corner = self.toImage({ x: 0, y: canvasHeight / ratio });
      return [corner.x, corner.y, 1 / scale / ratio, -1 / scale / ratio];
    },
  };
  return self;
}
