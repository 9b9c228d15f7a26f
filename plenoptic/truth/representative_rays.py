"""The ray that stands for a pixel, of all that bring it light.

It starts at the pixel's centre and passes the lit centroid of the microlens that gives the centre most light. Where no
light reaches the centre, it starts at the point of the sensitive area that is nearest to where a microlens images the
middle of the pupil: the image of a small stop may light a corner of a pixel only. Where light passes beside the middle,
between several rims, and through stars and masks, it starts at the brightest of many points. Fixed sets of probes find
the light, so that neither samples nor seeds matter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.paths import fill_through_array
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import feeding_regions, is_exact
from plenoptic.camera.sampling.record import FedPixels
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS
from plenoptic.core.values import Floats


def _points(bits: int) -> Floats:
    """(2^bits, 2): evenly spread in the unit square, in the order of their first coordinate (Hammersley)."""
    count = 1 << bits
    reversed_bits = [int(f"{i:0{bits}b}"[::-1], 2) for i in range(count)]
    return np.stack([np.arange(count) + 0.5, np.array(reversed_bits) + 0.5], axis=1) / count


def _shifted(points: Floats, count: int) -> Floats:
    """(count, n, 2): patterns that fill the gaps of one another, each in its order (M. Roberts's R2 sequence)."""
    shift = np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    first, second = np.modf(0.5 + shift)[0].T[:, :, None]
    return np.stack([(np.arange(len(points)) + first) / len(points), np.modf(points[:, 1] + second)[0]], axis=-1)


_PROBES, _MORE_PROBES = _points(4)[None], _points(6)[None]
"""Where rays look for light in what feeds a start: the pixel's centre, and any other."""
_RIM_STARTS = np.stack(np.meshgrid(*2 * [np.linspace(-0.499, 0.499, 4)]), axis=-1).reshape(-1, 2)
_STARTS = _points(6) - 0.5
_SHIFTED_PROBES = _shifted(_points(6), len(_STARTS))
"""Starts on a pixel, in parts of its sides, and their probes; more where the hole of a stop is not convex."""
_TOGETHER = 1 << 15
"""Probes at a time."""


class StartRays(NamedTuple):
    """One ray for each of n starts on the sensor."""

    blocks: Floats
    """Aimed, then traced; lost where no light reaches the start."""
    lanes: NDArray[np.void] | None
    """What is individual about the rays' microlenses."""
    cells: Floats
    """(n, 3): see `PixelRays`."""
    light: Floats
    """(n,): of its microlens, as its probes weigh it."""
    nearest: NDArray[np.int64]
    """(n,): the probe that arrives nearest to where the ray is aimed; -1 without light."""


class PixelRays(NamedTuple):
    """One ray a pixel, the representative one."""

    starts: Floats
    """(n, 2): on the sensor, local."""
    before: Floats
    """Blocks of rays between array and lens, in the lens's axes, on their way to the scene."""
    blocks: Floats
    """The same rays behind the lens; those of pixels without light are lost."""
    aims: Floats
    """(n, 2): where they pass the array's rear principal plane on their way from the sensor, local."""
    cells: Floats
    """(n, 3): centre of the cell of each pixel's microlens, local, and its row in the list of lenses or -1; nan where
    the pixel has none."""
    dark: NDArray[np.bool_]
    """(n,): whether no light can reach the pixel, as far as bounds on the pupil tell."""

    @property
    def lost(self) -> NDArray[np.bool_]:
        """(n,): whether no light was found for the pixel."""
        return _are_lost(self.blocks, len(self.starts))


def _lost_rays(pixels: Floats) -> PixelRays:
    """Those of dark pixels."""
    n = len(pixels)
    blocks = np.zeros((-(-n // BLOCK), 8, BLOCK))
    blocks[:, STATUS // BLOCK] = MISSED
    flat = blocks.reshape(-1)
    return PixelRays(pixels.copy(), flat.copy(), flat, pixels.copy(), np.full((n, 3), np.nan), np.ones(n, dtype=bool))


def representative_rays(camera: CameraRecord, pixels: Floats, fed: FedPixels) -> PixelRays:
    """The rays of pixels with centres (n, 2), and what feeds them."""
    rays = _lost_rays(pixels)
    rays.dark[fed.place] = False
    which = np.arange(len(fed.place))
    if camera.convex and is_exact(camera):
        _fill_region_rays(rays, camera, fed.place, which, fed.centres[:, None], fed)
    left = np.flatnonzero(rays.lost[fed.place])
    if left.size:
        left = _look(rays, camera, left, fed.centres[left, None], fed, _PROBES)
    if left.size:
        from plenoptic.truth.kernels import representative_ray

        starts = np.empty((len(left), representative_ray.CANDIDATES, 2))
        if camera.array is None:
            starts[:] = fed.centres[left, None]
        else:
            plane, pixel = camera.sensor.plane, camera.sensor.pixel
            representative_ray.fill_aimed_starts(starts, left, fed, pixel, plane, camera.pupil)
        left = _look(rays, camera, left, starts, fed, _MORE_PROBES)
    if left.size:
        # A pupil that several rims end is pointed: its tips, far from the middle, light corners of pixels.
        on_pixel = camera.sensor.pixel.within(_RIM_STARTS if camera.convex else _STARTS)
        _look(rays, camera, left, fed.centres[left, None] + on_pixel, fed, _SHIFTED_PROBES[: len(on_pixel)])
    return rays


def _look(
    rays: PixelRays, camera: CameraRecord, which: NDArray[np.int64], starts: Floats, fed: FedPixels, probes: Floats
) -> NDArray[np.int64]:
    """Put the brightest ray of the starts (m, k, 2) in the place of those of fed pixels `which` (m,).

    Returns the pixels that still have none.
    """
    lit = np.zeros(len(which), dtype=bool)
    together = max(1, _TOGETHER // (starts.shape[1] * probes.shape[1]))
    for first in range(0, len(which), together):
        some = starts[first : first + together]
        more, light = _rays_from(camera, np.ascontiguousarray(some.reshape(-1, 2)), probes)
        best = light.reshape(some.shape[:2]).argmax(axis=1) + np.arange(len(some)) * some.shape[1]
        found = lit[first : first + together] = light[best] > 0
        to, source = fed.place[which[first : first + together][found]], best[found]
        for name in ("starts", "aims", "cells"):
            getattr(rays, name)[to] = getattr(more, name)[source]
        for name in ("before", "blocks"):
            _put(getattr(rays, name), to, _fields(getattr(more, name), source))
    return which[~lit]


def _fill_region_rays(
    rays: PixelRays,
    camera: CameraRecord,
    at: NDArray[np.int64],
    which: NDArray[np.int64],
    starts: Floats,
    fed: FedPixels,
) -> None:
    """Rays from starts (m, k, 2) on fed pixels `which`, through the largest part of a microlens that feeds one."""
    from plenoptic.truth.kernels import representative_ray

    lanes = camera.own(rays.blocks.size // 8)
    representative_ray.fill_region_rays(rays, lanes, at, which, starts, fed)
    rays.before[:] = _trace(rays.blocks, lanes, camera)


def _rays_from(camera: CameraRecord, starts: Floats, patterns: Floats) -> tuple[PixelRays, Floats]:
    """A ray from each start (n, 2), found by probes in patterns (s, k, 2) in what feeds it; and its light (n,)."""
    from plenoptic.truth.kernels import representative_ray

    n = len(starts)
    regions = feeding_regions(camera, starts)
    aims = np.empty((n * patterns.shape[1], representative_ray.AIM))
    probes = np.empty(-(-len(aims) // BLOCK) * RAY)
    lanes = camera.own(probes.size // 8)
    representative_ray.fill_probes(probes, lanes, aims, starts, regions, patterns)
    _trace(probes, lanes, camera)
    size = -(-n // BLOCK)
    blocks, lanes, cells = np.empty(size * RAY), camera.own(size * BLOCK), np.empty((n, 3))
    rays = StartRays(blocks, lanes, cells, np.empty(n), np.empty(n, dtype=np.int64))
    representative_ray.fill_centroid_rays(rays, starts, probes, aims, regions)
    every = np.arange(n)
    aimed = _fields(blocks, every)
    before = _trace(blocks, lanes, camera)
    missed = np.flatnonzero(_are_lost(blocks, n) & (rays.nearest >= 0))
    if missed.size:
        # Where what passes is no convex body, its centroid may be dark.
        aimed[missed, :2] = aims[rays.nearest[missed], :2]
        aimed[missed, 3:5] = aimed[missed, :2] - starts[missed]
        _put(blocks, every, aimed)
        before = _trace(blocks, lanes, camera)
    return PixelRays(starts.copy(), before, blocks, aimed[:, :2], cells, np.zeros(n, dtype=bool)), rays.light


def _trace(blocks: Floats, lanes: NDArray[np.void] | None, camera: CameraRecord) -> Floats:
    """Trace aimed rays to the scene; returns them as they are between array and lens."""
    from plenoptic.optics.lens.kernels.trace import fill_traced

    fill_through_array(blocks, lanes, camera)
    before = blocks.copy()
    fill_traced(blocks, camera.lens, None)
    return before


def _are_lost(blocks: Floats, n: int) -> NDArray[np.bool_]:
    return np.asarray(blocks.reshape(-1, 8, BLOCK)[:, STATUS // BLOCK].reshape(-1)[:n] != 0)


def _fields(blocks: Floats, which: NDArray[np.int64]) -> Floats:
    """(m, 8): x, y, z, direction, weight and status of some rays of a bundle."""
    return blocks.reshape(-1, 8, BLOCK)[which // BLOCK, :, which % BLOCK]


def _put(blocks: Floats, which: NDArray[np.int64], fields: Floats) -> None:
    """Set them."""
    blocks.reshape(-1, 8, BLOCK)[which // BLOCK, :, which % BLOCK] = fields
