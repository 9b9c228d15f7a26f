"""Accuracy of depth: planes, edges, weak texture, noise and colour filters before several cameras, and views."""

from collections.abc import Callable
from typing import NamedTuple

import depth_scenes as scenes
import numpy as np
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
    return (*shares, honest, confidence, depth, 1e3 * cost.cpu / found.disparity.size)


def _views(quick):
    """Depth of the views of 1.0 cameras whose lenses aberrate."""
    rows, pooled = [], []
    for name in list(scenes.VIEW_CAMERAS)[: 1 if quick else None]:
        camera, focus = scenes.view_camera(name, 300 if quick else 500), scenes.VIEW_CAMERAS[name][-1]
        white = pl.render_white(camera, samples=128, progress=False, seed=5)
        for k, part in enumerate((0.75, 0.85, 0.95, 1.08, 1.25, 1.6)):
            z = part * focus
            shot = pl.render(pl.Scene([scenes.resolved_card(camera, z, 3 + k)]), camera, samples=64, progress=False)
            field = pl.lightfield.decode(shot, white)
            pl.lightfield.depth(field)
            cost, found = timed(pl.lightfield.depth, field)
            inside = np.s_[4:-4, 4:-4]
            traced = field.model.traced_disparity(1).of(field.model.disparity(camera, z))
            error, stated = (found.disparity - traced)[inside], found.standard_error[inside]
            pooled.append(np.nanmean((error / stated) ** 2))
            depths = 100 * (found.depth[inside] / -z - 1)
            row = (100 * np.isfinite(error).mean(), np.nanmean(error), np.sqrt(np.nanmean(error**2)), pooled[-1] ** 0.5)
            row = *row, np.nanmedian(depths), np.sqrt(np.nanmean(depths**2)), 1e3 * cost.cpu / found.disparity.size
            rows.append((name, z, field.disparity_at(z)[0], *map(float, row)))
    columns = "camera | z / mm | disparity | kept % | bias | RMS error | error / stated | depth bias % | "
    columns += "RMS depth error % | ms a pixel"
    remark = "Disparity, bias and error in pixels of a view for each pixel of u, against the traced one, no border. "
    remark += f"Error / stated of all rows together: {np.sqrt(np.mean(pooled)):.2f}."
    return Table("Depth of views: textured planes before 1.0 cameras", columns, rows, [remark])
