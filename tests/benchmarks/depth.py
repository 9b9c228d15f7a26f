"""Accuracy of depth: planes, edges, weak texture, noise and colour filters before several cameras, and views."""

from collections.abc import Callable
from typing import NamedTuple

import depth_scenes as scenes
import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl

_TRUTH = pl.Truth.CHORD_DISPARITY | pl.Truth.DEPTH | pl.Truth.MICROLENS
_COLUMNS = "camera | scene | kept % | bias % | Rel7 % | Rel3 % | Rel1 % | error / stated | confidence | "
_COLUMNS += "depth error % | ms a pixel"
_REMARK = (
    "Pixels within 7/22 of a pitch of the centres of micro images. Bias: median of disparity over the chord's, "
    "less 1; Rel: pixels whose relative error is larger; error / stated: RMS of error over standard error, of pixels "
    "whose error is below 7 %; confidence: median; depth error: median of |depth / truth - 1|; one thread, warm. The "
    "sensor collects some 4000 electrons at radiance 1, with 3 electrons of read noise."
)
_RGGB = pl.BayerPattern.RGGB
_SENSOR = {"photon_rate": 2.9e5, "exposure_time": 1.0, "gain": 0.25, "bits": 12, "read_noise": 3.0, "prnu": 0.005}


class Case(NamedTuple):
    """A scene before a camera, and what is done to raw and white image before depth is found."""

    name: str
    meshes: Callable[[pl.PlenopticCamera], list[pl.Mesh]]
    sensor: pl.SensorModel | None = None


def _plane(v, **more):
    return lambda camera: [scenes.plane(camera, v, int(10 * abs(v)), **more)]


PLANES = [Case(f"plane at v = {abs(v):g}", _plane(v)) for v in (3.0, 4.5, 7.0)]
EDGE = Case("edge, v = 6 before 3.5", lambda c: [scenes.plane(c, 3.5, 5), scenes.plane(c, 6.0, 6, right=True)])
OTHERS = [
    Case("edge, v = 4.5 before 3", lambda c: [scenes.plane(c, 3.0, 5), scenes.plane(c, 4.5, 6, right=True)]),
    Case("v = 4.5, leaning 55 deg", _plane(4.5, tilt=55.0)),
    Case("v = 4.5, contrast 0.1", _plane(4.5, contrast=0.05)),
    Case("v = 4.5, contrast 0.04", _plane(4.5, contrast=0.02)),
    Case("v = 4.5, uniform", _plane(4.5, contrast=0.0)),
    Case("v = 4.5, sensor", _plane(4.5), pl.SensorModel(**_SENSOR)),
    Case("v = 4.5, Bayer filter", _plane(4.5, colours=3), pl.SensorModel(colour_filters=_RGGB, **_SENSOR)),
]


def tables(*, quick):
    one, three = scenes.focused(), scenes.three_types()
    listed = [("one type", one, PLANES[:1] if quick else [*PLANES, EDGE, *OTHERS])]
    if not quick:
        keplerian = scenes.focused(focal_lengths=(1.9,), b=2.2, z=145.0)
        square = scenes.focused(focal_lengths=(1.6,), lattice=pl.Lattice.SQUARE, pitch=0.17, b=1.3)
        before = [Case(f"plane at v = -{-v:g}", _plane(v)) for v in (-3.0, -4.5, -7.0)]
        listed += [("three types", three, [*PLANES, EDGE, *OTHERS])]
        listed += [("square", square, PLANES), ("turned", scenes.turned(), PLANES), ("Keplerian", keplerian, before)]
    rows = [row for name, camera, cases in listed for row in _rows(name, camera, cases, quick)]
    yield Table("Depth of raw images against the chord's truth", _COLUMNS, rows, [_REMARK])
    yield _views(quick)


def _rows(name, camera, cases, quick):
    half, samples = (60, 32) if quick else (128, 128)
    region = np.s_[256 - half : 256 + half, 256 - half : 256 + half]
    white = pl.render_white(camera, samples=2 * samples, region=region, progress=False, seed=9)
    for case in cases:
        scene, how = pl.Scene(case.meshes(camera)), {"samples": samples, "region": region, "progress": False}
        shot = pl.render(scene, camera, truth=_TRUTH, **how)
        yield (name, case.name, *measured(camera, shot, white, case.sensor))


def measured(camera, shot, white, sensor=None):
    """The numbers of a row."""
    pictures = (shot, white) if sensor is None else (shot.develop(sensor).demosaic(), white.develop(sensor).demosaic())
    pl.lightfield.depth(*pictures, camera=camera, threads=1)
    cost, found = timed(pl.lightfield.depth, *pictures, camera=camera, threads=1)
    where = scenes.near_centres(camera, shot)
    truth = shot.truth.chord_disparity
    scores = pl.lightfield.disparity_scores(found.disparity, truth, where=where)
    error = found.disparity - truth
    usual = where & (np.abs(error) < 0.07 * np.abs(truth))
    honest = float(np.sqrt(np.mean((error[usual] / found.standard_error[usual]) ** 2)))
    depth = float(100 * np.nanmedian(np.abs(found.depth / shot.truth.depth - 1)[where]))
    confidence = float(np.nanmedian(found.confidence[where]))
    shares = (100 * scores.kept, 100 * scores.bias, *scores.relative)
    return (*shares, honest, confidence, depth, 1e3 * cost.wall / found.disparity.size)


def _views(quick):
    """Slopes of epipolar lines in views of a 1.0 camera."""
    rows = []
    for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE):
        camera = reference.built((330, 330) if quick else (660, 660), stop=4.25, b=2.0, lattice=lattice)
        white = pl.render_white(camera, samples=64, progress=False)
        for z in (-470.0,) if quick else (-420.0, -470.0, -560.0, -700.0):
            side = abs(0.217 / pl.paraxial.magnification(camera.lens, z)) * 256
            card = reference.glowing(reference.noise(3, 512), (-side / 2, -side / 2, z), (side, 0, 0), (0, side, 0))
            scene = pl.Scene([card])
            field = pl.lightfield.decode(pl.render(scene, camera, samples=64, progress=False), white)
            pl.lightfield.depth(field)
            cost, found = timed(pl.lightfield.depth, field)
            inside = np.s_[2:-2, 2:-2]
            error = found.disparity[inside] - field.disparity_at(z)[0]
            honest = float(np.sqrt(np.nanmean((error / found.standard_error[inside]) ** 2)))
            row = (100 * np.isfinite(error).mean(), np.nanmedian(error), np.sqrt(np.nanmean(error**2)), honest)
            depth = 100 * np.nanmedian(np.abs(found.depth[inside] / -z - 1))
            row = *row, depth, 1e3 * cost.wall / found.disparity.size
            rows.append((lattice.name, z, field.disparity_at(z)[0], *map(float, row)))
    columns = "lattice | z / mm | disparity | kept % | bias | RMS error | error / stated | depth error % | ms a pixel"
    remark = "Disparity, bias and error in pixels of a view for each pixel of u, against `disparity_at`, no border."
    return Table("Depth of views: textured planes, 21 x 21 views of a 1.0 camera", columns, rows, [remark])
