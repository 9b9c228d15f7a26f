"""Pages of the viewer: how large they are, how soon they show something, and how many pictures a second they make."""

import itertools
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl
from plenoptic.lightfield.depth_map import DepthMap

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "viewer"))
from looking import FLAGS, SOFTWARE, chromium_path, field_of

DISCS = ((-0.3, 0.3, 0.35, 0.18), (0.2, 0.65, 0.4, 0.16), (0.7, 0.48, 0.72, 0.2))
"""Disparity, place and radius in parts of the picture, before a background at -0.8."""
FRAMES = """async (count) => {
  const [focus, aperture] = ["focus", "aperture"].map((id) => document.getElementById(id));
  const gl = document.getElementById("picture").getContext("webgl2");
  aperture.value = aperture.max;
  aperture.dispatchEvent(new Event("input"));
  const one = new Uint8Array(4);
  const frame = async (k) => {
    focus.value = -0.8 + (1.5 * k) / count;
    focus.dispatchEvent(new Event("input"));
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one);  // which is there when all is drawn
  };
  await frame(0);
  const begin = performance.now();
  for (let k = 1; k <= count; k++) await frame(k);
  return (1000 * count) / (performance.now() - begin);
}"""


def tables(*, quick):
    views, side, pixels = (3, 64, 64) if quick else (9, 512, 1024)
    field, depth = light_field(views, side)
    shot, rows, missing = raw_image(pixels), [], None
    for name, make in (
        (f"{views} x {views} views of {side} x {side}", lambda: field.viewer(depth=depth)),
        (f"raw image of {pixels} x {pixels}, all truth", shot.viewer),
    ):
        cost, page = timed(make)
        seen, missing = looked_at(page, frames=(3 if quick else 12) if "views" in name else 0)
        rows.append((name, len(page.document.encode()) / 1e6, cost.wall, *seen))
    columns = "page | size: MB | made in: s | first picture: s | all there: s | pictures / s"
    remark = (
        "In Chromium, WebGL2 in software: from opening the file to the first picture on the canvas and to all data "
        "unpacked, and pictures of all views summed, each at a new focus. Views are 1/f texture, 0.25 e^N(0, 0.6), "
        "a hard case for their size; the raw image is rendered with 4 samples a pixel, and noise hardly shrinks."
    )
    yield Table("Pages of the viewer", columns, rows, [remark + (f" {missing}." if missing else "")])


def looked_at(page, *, frames):
    """Seconds to the first picture and to all, pictures a second; why there are none."""
    program = chromium_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return (None, None, None), "Without playwright (the extra `browser`) nothing is opened"
    if program is None:
        return (None, None, None), "Without Chromium nothing is opened"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "page.html"
        page.save(path)
        browser = playwright.chromium.launch(executable_path=program, args=[*FLAGS, *SOFTWARE])
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        begin = time.perf_counter()
        tab.goto(path.as_uri())
        tab.wait_for_selector("#stage.live", timeout=120_000)
        first = time.perf_counter() - begin
        tab.wait_for_selector("#stage[data-ready]", state="attached", timeout=120_000)
        ready = time.perf_counter() - begin
        rate = tab.evaluate(FRAMES, frames) if frames else None
        browser.close()
    return (first, ready, rate), None


def texture(number, side):
    """(side, side, 3): amplitudes fall with the frequency; channels resemble each other."""
    common, *own = (reference.noise(4 * number + k, side, power=1.1) for k in range(4))
    return 0.25 * np.exp(0.6 * np.stack([(0.7 * common + 0.5 * one) / np.hypot(0.7, 0.5) for one in own], axis=-1))


def light_field(count, side):
    """Textured discs at several depths before a textured wall, and their depth."""
    y, x = np.mgrid[:side, :side]
    offsets = np.arange(count) - float(count // 2)
    views, disparity = np.zeros((count, count, side, side, 3), np.float32), np.full((side, side), -0.8)
    for number, (moves, across, along, radius) in enumerate(((-0.8, 0.5, 0.5, np.inf), *DISCS)):
        paint = texture(number, 2 * side)
        for (i, u), (j, v) in itertools.product(enumerate(offsets), repeat=2):
            (down, t), (right, s) = ((int(np.floor(moves * o)), moves * o % 1.0) for o in (v, u))
            top, left = side // 2 + down, side // 2 + right
            part = paint[top : top + side + 1, left : left + side + 1]
            moved = (1 - t) * part[:-1] + t * part[1:]
            shown = (1 - s) * moved[:, :-1] + s * moved[:, 1:]
            inside = np.hypot(x + moves * u - across * side, y + moves * v - along * side) < radius * side
            views[i, j][inside] = shown[inside]
            if u == v == 0:
                disparity[inside] = moves
    field = field_of(views, (0.01 * np.sqrt(views)).astype(np.float32))
    sure, unknown = np.ones((side, side)), np.full((side, side), np.nan)
    return field, DepthMap(disparity, 0.01 * sure, sure, unknown, unknown)


def raw_image(side):
    camera = reference.built((side, side), focal_lengths=(1.9, 2.0, 2.1))
    return pl.render(pl.still_life(), camera, samples=4, truth=pl.Truth.ALL, progress=False)
