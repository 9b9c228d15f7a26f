"""Light fields to look at, the browser that shows them, and what pages say."""

import base64
import dataclasses
import io
import json
import os
import re
import shutil

import numpy as np

import plenoptic as pl

FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader")
"""WebGL2 without a graphics card."""


def camera_of(rows, columns, **array):
    """The double Gauss and hexagonal microlenses of plenoptic 2.0."""
    array = pl.MicrolensArray(**{"pitch": 0.217, "focal_lengths": (1.9, 2.0, 2.1), **array})
    sensor = pl.Sensor(shape=(rows, columns), pixel_pitch=0.01)
    return dataclasses.replace(pl.camera.example_camera(), microlenses=array, sensor=sensor)


def chromium_path():
    """The program, or None."""
    return os.environ.get("PLENOPTIC_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")


def facts_of(viewer):
    """What the page's scripts read, and its bytes."""
    text = re.search(r'id="facts">(.*?)</script>', viewer.document, re.DOTALL)[1]
    data = re.search(r'id="data">(.*?)</script>', viewer.document, re.DOTALL)[1]
    (facts,) = json.loads(text).values()
    return facts, base64.b64decode(data)


def readout(page):
    """Names and values beside the picture."""
    names, values = page.locator("#readout dt").all_inner_texts(), page.locator("#readout dd").all_inner_texts()
    return {name: value.replace("−", "-") for name, value in zip(names, values, strict=True) if name}


def moved(page, slider, value):
    """Set a slider as a hand does."""
    page.evaluate(
        "([id, value]) => { const range = document.getElementById(id); range.value = value;"
        " range.dispatchEvent(new Event('input')); }",
        [slider, value],
    )


def painted(page):
    """After the next frame."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def point_of(page, row, column, rows=220, columns=260):
    """Where a pixel is on the page, when all of the image is shown."""
    box = page.locator("#stage").bounding_box()
    scale = min(box["width"] / columns, box["height"] / rows)
    return (
        box["x"] + box["width"] / 2 + (column + 0.5 - columns / 2) * scale,
        box["y"] + box["height"] / 2 + (row + 0.5 - rows / 2) * scale,
    )


def photographed(page, rows, columns):
    """The picture, pixel by pixel, as it is on the screen."""
    from PIL import Image

    page.keyboard.press("1")
    painted(page)
    box = page.locator("#stage").bounding_box()
    assert box["x"] == round(box["x"]) and box["y"] == round(box["y"])
    left, top = (
        int(box[at] - np.floor(size / 2 - box[length] / 2 + 0.5))
        for at, size, length in (("x", columns, "width"), ("y", rows, "height"))
    )
    clip = {"x": left, "y": top, "width": columns, "height": rows}
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB"), float)


def touching(page):
    """A function that begins, moves or ends touches at places."""
    session = page.context.new_cdp_session(page)
    return lambda kind, *points: session.send(
        "Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in points]}
    )


def views_of(across=5, down=5, rows=40, columns=56, channels=3, *, seed=1):
    """A light field of smooth random views without a camera; a corner of one view holds nothing."""
    rng = np.random.default_rng(seed)
    u, v, y, x = np.ogrid[:across, :down, :rows, :columns]
    views = np.zeros((across, down, rows, columns, channels), np.float32)
    for _ in range(6):
        (a, b), phases = rng.uniform(0.1, 0.9, 2), rng.uniform(0, 6, channels)
        angle = a * (x + 0.7 * (u - across // 2)) + b * (y + 0.7 * (v - down // 2))
        views += np.exp(2 * np.sin(angle[..., None] + phases))
    views *= rng.uniform(0.7, 1.3, (across, down, 1, 1, 1)).astype(np.float32)
    if views.shape[:2] != (1, 1):
        views[0, 0, :7, :9] = np.nan
    return field_of(views)


def field_of(views, error=None):
    across, down = views.shape[:2]
    u, v = (np.arange(count) - float(count // 2) for count in (across, down))
    places = np.stack(np.meshgrid(u, -v, indexing="ij"), axis=-1)
    nowhere = np.full((*views.shape[2:4], 2), np.nan)
    nothing, apart = {"origin": np.full(2, np.nan), "camera": None}, {"spacing": (np.nan, np.nan), "u": u, "v": v}
    nothing |= {"pixel": nowhere, "on_array": nowhere, "pupil": np.full((across, down, 2), np.nan)}
    known = {"exit_pupil": places, "object_spacing": (1.0, 1.0), "z_focus": -400.0, "standard_error": error}
    return pl.lightfield.LightField(views=np.asarray(views, np.float32), **known, **nothing, **apart)
