"""How near views of plenoptic 1.0 cameras are to the truth: interpolated, and merged from the samples of all views."""

import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl
from plenoptic.optics.microlens.lattice import Lattice

STOP = 3.5
PITCH = 0.147
SQUARE_PITCH = PITCH * 0.75**0.25
VIEWS = ((0, 0), (2, 0), (0, -2), (-2, 1))
RESOLVED = 6.0
"""Pitches of microlenses, as far as the plane in focus, that the shortest waves of the smooth texture are long."""
SCENES = (((0.9,), 0.0), ((1.12,), 0.0), ((1.12, 1.0, 0.9), 0.0), ((1.12, 1.0, 0.9), RESOLVED))
"""Parts of the distance in focus at which planes stand, and the shortest waves of their texture."""


def tables(*, quick):
    side, samples, kinds = (300, 16, 1) if quick else (480, 64, None)
    rows = []
    for name, camera in list(cameras(side).items())[:kinds]:
        for parts, shortest in SCENES[:kinds]:
            waves, places = f"{RESOLVED:g} pitches and longer" if shortest else "all", ", ".join(map(str, parts))
            rows.append((name, waves, places, *scored(camera, shortest, samples, parts)))
    remark = (
        "PSNR of four views against a conventional camera with a stop of 0.25 mm at their place in the pupil, planes "
        "at multiples of the distance in focus, three with edges. Merged with true and with estimated disparity. "
        "Error over stated: RMS, of decode and of merged views. Time of the merged views: CPU, a pixel of a view. The "
        "lattices of one lens have as many microlenses per mm^2."
    )
    title = f"Views of 1.0 cameras beside pinholes: {side} x {side} pixels, planes with 1/f texture"
    columns = (
        "array | waves | planes | decode: dB | merged: dB | estimated: dB | error over stated | merged | us a pixel"
    )
    yield Table(title, columns, rows, [remark])


def cameras(side):
    """Name: camera."""
    square = {"pitch": SQUARE_PITCH, "lattice": Lattice.SQUARE}
    found = {
        name: reference.built((side, side), stop=STOP, z=134.6, b=1.2, focal_lengths=(1.2,), **array)
        for name, array in (("hexagonal", {"pitch": PITCH}), ("square", square), ("square, turned by 20 deg", square))
    }
    name = "square, turned by 20 deg"
    found[name] = found[name].moved(pl.CameraPart.MICROLENSES, tilt=(0.0, 0.0, 0.35))
    tessar, sensor = pl.load_lens("tessar-102mm-f4.5"), pl.Sensor((side, side), 0.0055)
    tessar = tessar.with_stop(pl.CircularStop(5.0))
    array = pl.MicrolensArray(0.077, (0.78,), Lattice.HEXAGONAL)
    found["hexagonal, tessar"] = pl.PlenopticCamera(tessar, sensor, 125.0, array, 0.78)
    return found


def scored(camera, shortest, samples, parts):
    """PSNR of views and of merged ones, by true and estimated disparity; true over stated errors; time a pixel."""
    white = pl.render_white(camera, samples=64, seed=5, progress=False)
    field = pl.lightfield.decode(white, white, views=7)
    scene = planes(field.z_focus, shortest * field.object_spacing[0], parts)
    shot = pl.render(scene, camera, samples=samples, progress=False)
    field = pl.lightfield.decode(shot, white, views=7)
    estimated = pl.lightfield.depth(field, progress=False).disparity
    merged, by_estimate = (
        timed(pl.lightfield.decode, shot, white, views=7, disparity=disparity)
        for disparity in (true_disparity(field, scene), estimated)
    )
    fields, inner = (field, merged[1], by_estimate[1]), np.s_[4:-4, 4:-4]
    off, stated = np.empty((2, 3, len(VIEWS)))
    for k, (u, v) in enumerate(VIEWS):
        truth = through_pinhole(scene, camera, field, u, v, 16 if samples < 64 else 512)[inner]
        for n, one in enumerate(fields):
            off[n, k] = np.nanmean((one.view(u, v)[inner][..., 0] - truth) ** 2)
            stated[n, k] = np.nanmean(one.standard_error[u + 3, v + 3][inner] ** 2)
    off, stated = off.mean(axis=1), stated.mean(axis=1)
    time = 1e6 * by_estimate[0].cpu / field.views.size
    return (*(-10 * np.log10(off)).tolist(), *np.sqrt(off / stated)[:2].tolist(), time)


def true_disparity(field, scene):
    """Disparity of the central view, traced."""
    z = -field.truth(scene, truth=pl.Truth.DEPTH).depth.round(6)
    found = np.full(z.shape, np.nan)
    for plane in np.unique(z[np.isfinite(z)]):
        traced = field.model.traced_disparity(1).of(field.model.disparity(field.camera, plane))
        found = np.where(z == plane, traced, found)
    return found


def planes(z, shortest, parts):
    """Planes that glow, across the axis, with waves of at least `shortest` mm: the first one everywhere."""
    places = {1.12: (-60, 120), 1.0: (-15, 12), 0.9: (2, 12)}
    quads = []
    for number, part in enumerate(parts):
        left, width = (-60, 120) if number == 0 else places[part]
        height = max(width, 40)
        noise = reference.noise(number, 1024, sides=(height, width), shortest=shortest)
        quads.append(reference.glowing(noise, (left, -height / 2, part * z), (width, 0, 0), (0, height, 0)))
    return pl.Scene(quads)


def through_pinhole(scene, camera, field, u, v, samples):
    """What a view would be of a conventional camera with a small stop, on the same pixels."""
    (rows, columns), pitch = field.views.shape[2:4], field.spacing[0]
    lens = camera.lens
    iris = next(k for k, element in enumerate(lens.elements) if isinstance(element, pl.CircularStop))
    place = field.pupil[u + 3, v + 3] * lens.elements[iris].semi_diameter
    lens = lens.with_stop(pl.CircularStop(semi_diameter=0.25)).moved(iris, shift=(*place.tolist(), 0.0))
    middle = field.origin + np.array([0.5 - columns / 2, rows / 2 - 0.5]) * pitch
    sensor = pl.Sensor(shape=(rows, columns), pixel_pitch=pitch)
    small = pl.PlenopticCamera(lens, sensor, camera.stop_to_microlenses)
    small = small.moved(pl.CameraPart.SENSOR, shift=(*middle.tolist(), 0.0))
    seen, sky = (pl.render(part, small, samples=samples, progress=False) for part in (scene, pl.Scene(background=1.0)))
    return np.asarray((seen.image / sky.image)[..., 0], dtype=np.float64)
