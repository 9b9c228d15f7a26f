"""How near views of plenoptic 1.0 cameras are to the truth, beside linear interpolation of the same samples."""

import numpy as np
import reference
from matplotlib.tri import LinearTriInterpolator, Triangulation
from table import Table

import plenoptic as pl
from plenoptic.lightfield.raw_arrays import raw_arrays
from plenoptic.optics.microlens.lattice import Lattice

STOP = 3.5
PITCH = 0.147
VIEWS = ((0, 0), (2, 0), (0, -2), (-2, 1))
RESOLVED = 6.0
"""Pitches of microlenses, as far as the plane in focus, that the shortest waves of the smooth texture are long."""


def tables(*, quick):
    side, samples, kinds = (300, 16, 1) if quick else (900, 256, 2)
    rows = []
    for waves, shortest in (("6 pitches and longer", RESOLVED), ("all", 0.0))[:kinds]:
        for lattice, pitch in ((Lattice.HEXAGONAL, PITCH), (Lattice.SQUARE, PITCH * 0.75**0.25))[:kinds]:
            array = {"pitch": pitch, "focal_lengths": (1.2,), "lattice": lattice}
            camera = reference.built((side, side), stop=STOP, z=134.6, b=1.2, **array)
            for u, v, *found in scored(camera, shortest, samples):
                rows.append((lattice.name, waves, f"{u}, {v}", *found))
    remark = (
        "PSNR against a conventional camera with a stop of 0.25 mm at the place of the view in the pupil. Planes "
        "at 0.9, 1 and 1.12 times the distance in focus. Linear: matplotlib's triangulation of the same samples; "
        "both lattices have as many microlenses per mm^2. What remains is at edges of planes, and waves "
        "that are shorter than the lattice resolves. Square lattices need no interpolation."
    )
    title = f"Views of 1.0 cameras beside pinholes: {side} x {side} pixels, three planes with 1/f texture"
    yield Table(title, "lattice | waves | u, v | decode: dB | linear: dB | true over stated error", rows, [remark])


def scored(camera, shortest, samples):
    """u, v, PSNR of the view and of linear interpolation, true over stated error."""
    white = pl.render_white(camera, samples=64, seed=5, progress=False)
    field = pl.lightfield.decode(white, white, views=7)
    scene = planes(field.z_focus, shortest * field.object_spacing[0])
    shot = pl.render(scene, camera, samples=samples, progress=False)
    field = pl.lightfield.decode(shot, white, views=7)
    inner = np.s_[4:-4, 4:-4]
    for u, v in VIEWS:
        truth = through_pinhole(scene, camera, field, u, v, 16 if samples < 64 else 128)[inner]
        off = field.view(u, v)[inner][..., 0] - truth
        stated = field.standard_error[u + 3, v + 3][inner][..., 0]
        plain = linear(camera, shot, white, field, u, v)[inner] - truth
        yield u, v, psnr(off), psnr(plain), float(np.sqrt(np.nanmean(off**2) / np.nanmean(stated**2)))


def psnr(off):
    return float(-10 * np.log10(np.nanmean(off**2)))


def planes(z, shortest):
    """Three planes that glow, across the axis, with waves of at least `shortest` mm."""
    places = ((-60, 120, 1.12), (-15, 12, 1.0), (2, 12, 0.9))
    quads = []
    for number, (left, width, part) in enumerate(places):
        height = max(width, 40)
        noise = reference.noise(number, 1024, sides=(height, width), shortest=shortest)
        quads.append(reference.glowing(noise, (left, -height / 2, part * z), (width, 0, 0), (0, height, 0)))
    return pl.Scene(quads)


def through_pinhole(scene, camera, field, u, v, samples):
    """What a view would be of a conventional camera with a small stop, on the same pixels."""
    (rows, columns), pitch = field.views.shape[2:4], field.spacing[0]
    lens, place = camera.lens, field.pupil[u + 3, v + 3] * STOP
    iris = next(k for k, element in enumerate(lens.elements) if isinstance(element, pl.CircularStop))
    lens = lens.with_stop(pl.CircularStop(semi_diameter=0.25)).moved(iris, shift=(*place.tolist(), 0.0))
    middle = field.origin + np.array([0.5 - columns / 2, rows / 2 - 0.5]) * pitch
    sensor = pl.Sensor(shape=(rows, columns), pixel_pitch=pitch)
    small = pl.PlenopticCamera(lens, sensor, camera.stop_to_microlenses)
    small = small.moved(pl.CameraPart.SENSOR, shift=(*middle.tolist(), 0.0))
    seen, sky = (pl.render(part, small, samples=samples, progress=False) for part in (scene, pl.Scene(background=1.0)))
    return np.asarray((seen.image / sky.image)[..., 0], dtype=np.float64)


def linear(camera, shot, white, field, u, v):
    """A view by linear interpolation between microlenses."""
    centres = pl.microlens_centres(camera)
    value, _ = raw_arrays(shot, white, 0.05).read(centres.pixel + np.array([v, u]))
    known = np.isfinite(value[:, 0])
    mesh = Triangulation(*centres.on_array[known].T)
    x = field.origin[0] - field.spacing[0] * np.arange(field.views.shape[3])
    y = field.origin[1] + field.spacing[1] * np.arange(field.views.shape[2])
    return np.ma.filled(LinearTriInterpolator(mesh, value[known, 0])(*np.meshgrid(x, y)), np.nan)
