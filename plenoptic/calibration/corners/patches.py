"""Windows around the micro images of a raw image."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.corners.corner_fit import Windows
from plenoptic.calibration.corners.vignetting import border_blur, visible_centre
from plenoptic.calibration.white_image import equalise, mean_filter, noise_variance
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.values import Floats, plain_array
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice, default_pattern
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

_LIT, UNVIGNETTED = (0.5, 0.95), (0.7, 0.8)
"""Least light of pixels over that of their micro image in the white image, smooth, and, without one, largest distance
from the centre over the radius: for the search and for the last fit."""
_RIM = 1.3
"""Largest distance from the centre at which the border of a micro image is looked for, over its radius."""
_BRIGHT = 0.98
"""Quantile of the light in the window around a micro image that counts as its brightest."""
_NOISE, _CENTRE = 1.25, 512
"""Standard deviations of the noise of means by which it raises that quantile, and rows and columns of the central part
of the white image that tell the noise."""
_PAIRS = 1 << 20
"""Pairs of micro images and points that are compared together."""


class Patches(NamedTuple):
    """Square windows around micro images."""

    lattice_index: NDArray[np.int64]
    """(n, 2)."""
    centre: Floats
    """(n, 2): row and column."""
    radius: Floats
    """(n,)."""
    corner: NDArray[np.int64]
    """(n, 2): first row and column of the window."""
    light: Floats
    """(n, s, s)."""
    weight: Floats
    """(n, s, s): 0 outside the micro image."""
    white: Floats
    """(n, s, s): white image over its brightest in the micro image; 1 without a white image."""
    kind: NDArray[np.int64]
    """(n,): type of the microlens."""
    border: Floats
    """(n,): radius in pixels of the blur of the micro image's border, 0 without a white image."""

    def rows(self, chosen: NDArray[np.int64]) -> Patches:
        """Some of the windows."""
        return Patches._make(part[chosen] for part in self)

    def visible(self, position: Floats, w: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Micro images and virtual points (k, 2) that they should show, with their reciprocal virtual depths (k,)."""
        parts = []
        step = max(1, _PAIRS // max(len(w), 1))
        for first in range(0, len(self.centre), step):
            rows = slice(first, first + step)
            offset = (position - self.centre[rows, None]) * w[:, None]
            image, point = np.nonzero(np.hypot(offset[..., 0], offset[..., 1]) < self.radius[rows, None])
            parts.append((image + first, point))
        image, point = (np.concatenate(part) for part in zip(*parts, strict=True))
        return image, point

    def windows(self, image: NDArray[np.int64], pixel: Floats, radius: Floats) -> Windows:
        """Windows of radii (m,) around pixels (m, 2) in micro images (m,)."""
        reach = int(np.ceil(radius.max(initial=0.0)))
        steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
        place = np.rint(pixel).astype(np.int64)[:, None] + steps
        local = place - self.corner[image, None]
        side = self.light.shape[1]
        inside = ((local >= 0) & (local < side)).all(axis=-1)
        row, column = np.clip(local, 0, side - 1).transpose(2, 0, 1)
        distance = np.hypot(*(place - pixel[:, None]).transpose(2, 0, 1))
        light = self.light[image[:, None], row, column]
        weight = self.weight[image[:, None], row, column] * (inside & (distance < radius[:, None]))
        return Windows(place.astype(np.float64), light, weight)

    def visible_centres(self, image: NDArray[np.int64], pixel: Floats) -> Floats:
        """`visible_centre` (m, k, 2) of the microlens at pixels (m, k, 2) in micro images (m,)."""
        local = np.clip(pixel.astype(np.int64) - self.corner[image, None], 0, self.light.shape[1] - 1)
        return visible_centre(self.white, image[:, None], local[..., 0], local[..., 1])


def _light(image: Any, name: str, shape: tuple[int, int]) -> Floats:
    """Light above black (H, W)."""
    black: float | None = None
    if isinstance(image, Exposure):
        data, black = image.image, 0.0
    elif isinstance(image, RawImage):
        data, black = image.data, image.black_level
    else:
        data = plain_array(image, name)
    if data.shape[:2] != shape or data.ndim not in (2, 3) or data.shape[2:] not in ((), (1,), (3,)):
        raise InvalidValueError(f"{name} has shape {data.shape}; the micro images are those of {shape[0]} x {shape[1]}")
    plane = data.astype(np.float64).reshape(*shape, -1).mean(axis=2)
    if not np.isfinite(plane).all():
        raise InvalidValueError(f"{name} holds values that are not finite; correct them")
    return np.asarray(plane - (np.percentile(plane, 0.1) if black is None else black))


def patches_of(raw: Any, white: Any, grid: MicroImageGrid) -> tuple[Patches, Patches]:
    """Micro images with their lit pixels, and with those that are not vignetted."""
    light = _light(raw, "raw", grid.shape)
    gain, noise = np.ones(grid.shape), 0.0
    if white is None:
        equalise(light)
    else:
        gain = _light(white, "white", grid.shape)
        light = light / np.maximum(gain, 1e-3 * np.percentile(gain, 99))
        is_mosaic = equalise(gain)
        first = [max(0, (size - _CENTRE) // 2) for size in grid.shape]
        centre_part = gain[first[0] : first[0] + _CENTRE, first[1] : first[1] + _CENTRE]
        noise = math.sqrt(float(noise_variance(centre_part, is_mosaic).max())) / 3.0
    index = grid.on_sensor
    (kind, radius), centre = _kinds(grid, index), grid.centres_of(index)
    reach = int(np.ceil(radius.max() + 1.0))
    corner = np.rint(centre).astype(np.int64) - reach
    row, column = (corner[:, k, None] + np.arange(2 * reach + 1) for k in (0, 1))
    distance = np.hypot(row[:, :, None] - centre[:, 0, None, None], column[:, None] - centre[:, 1, None, None])
    at = np.clip(row, 0, grid.shape[0] - 1)[:, :, None], np.clip(column, 0, grid.shape[1] - 1)[:, None]
    on_sensor = ((row >= 0) & (row < grid.shape[0]))[:, :, None] & ((column >= 0) & (column < grid.shape[1]))[:, None]
    weight = gain[at] * on_sensor
    smooth = mean_filter(np.pad(gain, 1, mode="edge"))[at]
    bright = np.quantile(smooth.reshape(len(smooth), -1), _BRIGHT, axis=1) - _NOISE * noise
    bright = np.maximum(bright, 1e-300)[:, None, None]
    lit, unvignetted = (
        weight * ((smooth > least * bright) & (distance < (part if white is None else 1.1) * radius[:, None, None]))
        for least, part in (_LIT, UNVIGNETTED)
    )
    visible, border = gain[at] / bright, np.zeros(len(index))
    if white is not None:
        border = border_blur(visible * (distance < _RIM * radius[:, None, None]))
        border = np.array([np.median(border[kind == k]) for k in range(int(kind.max()) + 1)])[kind]
    patches = Patches(index, centre, radius, corner, light[at], lit, visible, kind, border)
    return patches, patches._replace(weight=unvignetted)


def _kinds(grid: MicroImageGrid, index: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
    """Type (n,) of micro images, also where images of types are alike, and the median radius of the type."""
    pattern = grid.type_pattern
    if not pattern.max():
        pattern = default_pattern(3 if grid.lattice is Lattice.HEXAGONAL else 2)
    kind = pattern[tuple(np.mod(index, pattern.shape).T)]
    if grid.radius is None or grid.index is None:
        return kind, np.full(len(index), 0.42 * grid.pitch)
    measured = pattern[tuple(np.mod(grid.index, pattern.shape).T)]
    return kind, np.array([np.median(grid.radius[measured == k]) for k in range(int(pattern.max()) + 1)])[kind]
