"""Views of focused cameras against exact pictures, beside those that take one patch of each microlens."""

import dataclasses
from functools import partial
from typing import NamedTuple

import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl
from plenoptic.camera.gaussian import lateral_magnification, object_plane
from plenoptic.lightfield.raw_arrays import raw_arrays
from plenoptic.truth.channels import Truth

_THREE = (1.85, 2.0, 2.3)
"""In focus at virtual depths of 12.3, 6.7 and 3.8."""
_TEXELS, _SIDE = 1024, 0.05
"""Of a texture, and of a texel in its image, mm: five pixels of the sensor."""
_FINE = 3
"""Points a side at which the exact picture is looked at in each pixel."""
_MARGIN = 18
"""Pixels of views that do not count: beyond the border, microlenses are missing."""


class Card(NamedTuple):
    """A square with a texture of 1/f noise that glows, at a virtual depth."""

    virtual_depth: float
    texels: int = _TEXELS
    centre: tuple[float, float] = (0.0, 0.0)  # in its image, mm

    def noise(self):
        return reference.noise(int(100 * self.virtual_depth), _TEXELS)[: self.texels, : self.texels]

    def placed(self, camera):
        """Its lower left corner and side, mm."""
        image = camera.stop_to_microlenses + self.virtual_depth * camera.microlenses_to_sensor
        z = object_plane(camera.lens, image, camera.wavelength)
        larger = 1.0 / abs(lateral_magnification(camera.lens, z, camera.wavelength))
        side = self.texels * _SIDE * larger
        return self.centre[0] * larger - side / 2, self.centre[1] * larger - side / 2, z, side

    def mesh(self, camera):
        x, y, z, side = self.placed(camera)
        return reference.glowing(self.noise(), (x, y, z), (side, 0, 0), (0, side, 0))

    def radiance(self, camera, position):
        """At points (..., 3) of it, between the middles of texels."""
        x, y, _, side = self.placed(camera)
        texture = reference.grey(self.noise())
        at = np.stack([y + side - position[..., 1], position[..., 0] - x], axis=-1) * (self.texels / side) - 0.5
        low = np.floor(np.nan_to_num(at)).astype(np.int64)
        (row, column), (down, along) = np.moveaxis(low, -1, 0), np.moveaxis(at - low, -1, 0)

        def texel(i, j):
            return texture[np.clip(row + i, 0, self.texels - 1), np.clip(column + j, 0, self.texels - 1)]

        upper, lower = ((1 - along) * texel(i, 0) + along * texel(i, 1) for i in (0, 1))
        return (1 - down) * upper + down * lower


_HIDING = (Card(8.0, 40, (0.3, 0.2)), Card(4.0))
CASES = (
    ("three types, one in focus", _THREE, (Card(6.667),)),
    ("one type, in focus", (2.0,), (Card(6.667),)),
    ("three types, none in focus", _THREE, (Card(3.0),)),
    ("three types, occlusion", _THREE, _HIDING),
    ("one type, occlusion", (2.0,), _HIDING),
)


def tables(*, quick):
    side, samples, margin = (120, 16, 6) if quick else (330, 256, _MARGIN)
    rows = [row for case in (CASES[-1:] if quick else CASES) for row in _rows(*case, side, samples, margin)]
    remark = (
        f"{side} x {side} pixels, {samples} samples. The exact picture is the mean of {_FINE} x {_FINE} "
        f"lookups in each pixel along its rays; {margin} pixels at each border do not count. Patches have the "
        "median disparity of their microlens's middle. One thread."
    )
    columns = "scene | depth | viewpoint | one patch a microlens | render_view | gain | us per raw pixel"
    yield Table("Views of focused cameras: PSNR in dB over a peak of 1", columns, rows, [remark])


def _rows(title, types, cards, side, samples, margin):
    camera = reference.built((side, side), focal_lengths=types)
    scene = pl.Scene([card.mesh(camera) for card in cards])
    shot = pl.render(scene, camera, samples=samples, max_bounces=0, truth=Truth.CHORD_DISPARITY, progress=False)
    white = pl.render_white(camera, samples=samples, seed=5, progress=False)
    maps = {"true": shot.truth.chord_disparity, "estimated": pl.lightfield.depth(shot, white).disparity}
    for viewpoint in ((0.0, 0.0), (0.5, 0.0)):
        for name, disparity in maps.items():
            taken = partial(pl.lightfield.render_view, shot, white, disparity, viewpoint=viewpoint, threads=1)
            taken()
            cost, view = timed(taken)
            exact = _exact(cards, scene, view)
            pictures = view.picture[..., 0], _patches(shot, white, disparity, view)
            ours, patches = (_psnr(picture - exact, margin) for picture in pictures)
            found = (f"{value:.1f}" for value in (patches, ours, ours - patches))
            yield title, name, str(viewpoint), *found, 1e6 * cost.wall / shot.image[..., 0].size


def _exact(cards, scene, view):
    """The mean radiance of a view's pixels."""
    steps = (np.arange(_FINE) - (_FINE - 1) / 2) / _FINE * view.spacing
    total = np.zeros(view.disparity.shape)
    for step in np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2):
        moved = dataclasses.replace(view, on_array=view.on_array + step)
        found = moved.truth(scene, truth=Truth.POSITION | Truth.OBJECT)
        for number, card in enumerate(cards):
            total += np.where(found.object == number, card.radiance(view.camera, found.position), 0.0)
    return total / len(steps) ** 2


def _psnr(off, margin):
    inner = off[margin:-margin, margin:-margin]
    return float(-10 * np.log10(np.nanmean(inner**2)))


def _patches(shot, white, disparity, view):
    """A view of which each microlens fills its own cell, magnified by one disparity: T. Georgiev and A. Lumsdaine.

    For cameras without parts out of place: local axes are those of the array.
    """
    camera, planes = view.camera, raw_arrays(shot, white, 0.1)
    b, pixel = camera.microlenses_to_sensor, camera.sensor.pixel_pitch
    points = pl.paraxial.cardinal_points(camera.lens, wavelength=camera.wavelength)
    distance = camera.stop_to_microlenses - points.exit_pupil
    pupil = np.array(view.viewpoint) * points.pupil_magnification * camera.lens.stop.semi_diameter
    centres = pl.microlens_centres(camera)
    near = np.rint(centres.pixel).astype(np.int64)[:, None] + np.stack(np.mgrid[-4:5, -4:5], axis=-1).reshape(-1, 2)
    inside = ((near >= 0) & (near < disparity.shape)).all(axis=-1)
    row, column = np.moveaxis(np.where(inside[..., None], near, 0), -1, 0)
    found = np.where(inside, disparity[row, column], np.nan)
    usable = np.isfinite(found).any(axis=1)
    behind = b * min(camera.microlenses.pitches) / (np.nanmedian(found[usable], axis=1) * pixel)
    middles = centres.on_array[usable]
    places = view.on_array.reshape(-1, 2)
    parts = np.array_split(places, 64)
    own = np.concatenate([((part[:, None] - middles) ** 2).sum(axis=-1).argmin(axis=1) for part in parts])
    # The image of the point that the ray from the pupil shows, seen through the microlens.
    image = places + (places - pupil) * (behind[own] / distance)[:, None]
    on_sensor = middles[own] + (image - middles[own]) * (b / behind[own])[:, None]
    radiance, _ = planes.read(camera.sensor.pixel_of(on_sensor))
    return np.asarray(radiance[:, 0].reshape(view.disparity.shape))
