// The views on the graphics card, and pictures made of them.

import { clamp } from "./numbers.js";
import { part } from "./planes.js";
import { draw, program, still, tapsOf, target } from "./gl.js";

const AT_ONCE = 9; // views that are decoded at the same time

/** Offset (of u or v) at a place between views, which are counted from 0. */
export function offsetAt(offsets, place) {
  if (offsets.length === 1) return offsets[0];
  const first = clamp(Math.floor(place), 0, offsets.length - 2);
  return offsets[first] + (place - first) * (offsets[first + 1] - offsets[first]);
}

/** Views with shares: a round opening of some views across, whose rim is as soft as one view is wide. */
export function opening(counts, viewpoint, across) {
  const found = [];
  for (let i = 0; i < counts[0]; i++)
    for (let j = 0; j < counts[1]; j++) {
      const share = clamp(across / 2 + 0.5 - Math.hypot(i - viewpoint[0], j - viewpoint[1]), 0, 1);
      if (share > 0) found.push({ i, j, share });
    }
  return found;
}

export function fieldPictures(gl, facts) {
  const { rows, columns, u, v, ratio } = facts;
  const counts = [u.length, v.length];
  const padded = [columns + 2, rows + 2];
  const views = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, views);
  // One clear pixel around each view: what lies beyond counts as nothing.
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.SRGB8_ALPHA8, ...padded, u.length * v.length);
  still(gl, gl.TEXTURE_2D_ARRAY, gl.LINEAR);
  const sum = target(gl, columns, rows);
  const [summing, showing, listing, slicing] = ["sum", "show", "sheet", "slice"].map((name) => program(gl, name));
  const there = new Set();
  const nearestThere = (share) => share.filter(({ i, j }) => there.has(i * v.length + j));

  const setTaps = tapsOf(gl);
  const movedBy = (chosen, from, disparity) => {
    const all = chosen.reduce((total, { share }) => total + share, 0);
    const [across, down] = [offsetAt(u, from[0]), offsetAt(v, from[1])];
    return chosen.flatMap(({ i, j, share }) => [
      -disparity * (u[i] - across), -disparity * ratio * (v[j] - down), i * v.length + j, share / all,
    ]);
  };

  return {
    views, padded, counts, setTaps,
    /** Put views on the card, the central one first; calls `shown` after it and in the end. */
    async load(bytes, middle, shown) {
      const put = async (number) => {
        const blob = new Blob([part(bytes, facts.views[number])], { type: "image/webp" });
        const picture = await createImageBitmap(blob, { premultiplyAlpha: "premultiply", colorSpaceConversion: "none" });
        gl.bindTexture(gl.TEXTURE_2D_ARRAY, views);
        gl.texSubImage3D(
          gl.TEXTURE_2D_ARRAY, 0, 1, 1, number, picture.width, picture.height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture);
        picture.close();
        there.add(number);
      };
      const first = middle[0] * v.length + middle[1];
      await put(first);
      shown(1);
      const others = facts.views.map((_, number) => number).filter((number) => number !== first);
      for (let k = 0; k < others.length; k += AT_ONCE) await Promise.all(others.slice(k, k + AT_ONCE).map(put));
      shown(facts.views.length);
    },
    /** Views of an opening, moved so that a disparity stands still, as seen from a viewpoint; how many they are. */
    refocus(chosen, from, disparity) {
      const loaded = nearestThere(chosen);
      if (!loaded.length) return 0;
      const count = setTaps(movedBy(loaded, from, disparity));
      draw(gl, summing, { viewport: [0, 0, columns, rows], views, count, padded }, sum);
      return loaded.length;
    },
    show(viewport, place, ground, gain) {
      draw(gl, showing, { viewport, place, ground, gain, picture: sum.texture, size: [columns, rows] });
    },
    sheet(viewport, place, ground, gain, gap) {
      draw(gl, listing, { viewport, place, ground, gain, gap, views, size: [columns, rows], counts });
    },
    /** A row of the views beside each other along u, at the nearest v. */
    slice(viewport, place, ground, gain, from, disparity, row) {
      const j = Math.round(from[1]);
      const line = u.map((_, i) => ({ i, j, share: 1 }));
      const count = setTaps(movedBy(line, from, disparity));
      draw(gl, slicing, {
        viewport, place, ground, gain, views, count, row, rows: viewport[3], size: [columns, rows],
      });
    },
    /** Offsets of all views from a viewpoint at disparity 1, for matching. */
    offsets: (from) => movedBy(opening(counts, from, 1e3), from, -1),
  };
}
