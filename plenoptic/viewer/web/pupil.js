// A map of the views as they lie in the pupil, with the aperture on it: the viewpoint is moved there too.

import { clamp } from "./numbers.js";
import { element } from "./panel.js";

const SIDE = 148, MARGIN = 16; // CSS pixels

/** Of so many views; `look` is called with places between views, which are counted from 0. */
export function pupilMap(across, down, look) {
  const step = (SIDE - MARGIN) / Math.max(across, down);
  const dot = clamp(step * 0.3, 1, 6);
  const made = element("canvas", {
    id: "pupil", width: SIDE * 2, height: SIDE * 2, role: "img",
    ariaLabel: "Map of the views: the disc is the aperture around the viewpoint",
  });
  const place = (i, j) => [SIDE / 2 + (i - (across - 1) / 2) * step, SIDE / 2 + (j - (down - 1) / 2) * step];

  made.addEventListener("pointerdown", (event) => made.setPointerCapture(event.pointerId));
  for (const kind of ["pointerdown", "pointermove"])
    made.addEventListener(kind, (event) => {
      if (!event.buttons) return;
      const box = made.getBoundingClientRect();
      const at = (where, count) => (where - SIDE / 2) / step + (count - 1) / 2;
      look(at(event.clientX - box.left, across), at(event.clientY - box.top, down));
    });
  return {
    made,
    /** Views with their shares, and the aperture's middle and width in views. */
    paint(chosen, viewpoint, width) {
      const pen = made.getContext("2d");
      const style = getComputedStyle(document.documentElement);
      const [ink, accent] = ["--faint", "--accent"].map((name) => style.getPropertyValue(name));
      pen.setTransform(2, 0, 0, 2, 0, 0);
      pen.clearRect(0, 0, SIDE, SIDE);
      const shares = new Map(chosen.map(({ i, j, share }) => [i * down + j, share]));
      for (let i = 0; i < across; i++)
        for (let j = 0; j < down; j++)
          for (const [color, opacity] of [[ink, 1], [accent, shares.get(i * down + j) ?? 0]]) {
            pen.globalAlpha = opacity;
            pen.fillStyle = color;
            pen.beginPath();
            pen.arc(...place(i, j), dot, 0, 2 * Math.PI);
            pen.fill();
          }
      pen.globalAlpha = 1;
      pen.strokeStyle = accent;
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.arc(...place(...viewpoint), (width / 2) * step, 0, 2 * Math.PI);
      pen.stroke();
    },
  };
}
