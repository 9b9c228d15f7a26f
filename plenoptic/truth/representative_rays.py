"""The ray that stands for a pixel, of all that bring it light.

It starts at the pixel's centre and passes the lit centroid of the microlens that gives the centre most light. Where no
light reaches the centre, it starts at the point of the sensitive area that is nearest to where a microlens images the
middle of the pupil: the image of a small stop may light a corner of a pixel only. Where light passes beside the middle,
between several rims, and through stars and masks, it starts at the brightest of many points. Light is found through the
regions that feed pixels, where these are exact, or by fixed sets of probes, so that neither samples nor seeds matter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import feeding_regions
from plenoptic.camera.sampling.record import FedPixels
from plenoptic.camera.sampling.through_array import fill_through_array
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS
from plenoptic.core.values import Floats


def _points(bits: int) -> Floats:
    """(2^bits, 2): evenly spread in the unit square, in the order of their first coordinate (Hammersley)."""
    count = 1 << bits
    reversed_bits = [int(f"{i:0{bits}b}"[::-1], 2) for i in range(count)]
    return np.stack([np.arange(count) + 0.5, np.array(reversed_bits) + 0.5], axis=1) / count


def _shift(points: Floats, count: int) -> Floats:
    """(count, n, 2): patterns that fill the gaps of one another, each in its order (M. Roberts's R2 sequence)."""
    shift = np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    first, second = np.modf(0.5 + shift)[0].T[:, :, None]
    return np.stack([(np.arange(len(points)) + first) / len(points), np.modf(points[:, 1] + second)[0]], axis=-1)


_PROBES, _MORE_PROBES = _points(4)[None], _points(6)[None]
"""Where rays look for light in what feeds a start: the pixel's centre, and any other."""
_RIM_STARTS = np.stack(np.meshgrid(*2 * [np.linspace(-0.499, 0.499, 4)]), axis=-1).reshape(-1, 2)
_STARTS = _points(6) - 0.5
_SHIFTED_PROBES = _shift(_points(6), len(_STARTS))
"""Starts on a pixel, in parts of its sides, and their probes; more where the hole of a stop is not convex."""
_TOGETHER = 1 << 14
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
    """Rays of dark pixels."""
    n = len(pixels)
    blocks = np.zeros((-(-n // BLOCK), 8, BLOCK))
    blocks[:, STATUS // BLOCK] = MISSED
    flat = blocks.reshape(-1)
    return PixelRays(pixels.copy(), flat.copy(), flat, pixels.copy(), np.full((n, 3), np.nan), np.ones(n, dtype=bool))


def representative_rays(camera: CameraRecord, pixels: Floats, fed: FedPixels) -> PixelRays:
    """The rays of pixels with centres (n, 2), of which those `fed` get light."""
    rays = _found_rays(camera, pixels, fed.place, np.arange(len(fed.place)), fed.centres[:, None], fed, _PROBES)
    rays.dark[fed.place] = False
    for starts_on, probes in ((_aimed_starts, _MORE_PROBES), (_spread_starts, _SHIFTED_PROBES)):
        left = np.flatnonzero(rays.lost[fed.place])
        if not left.size:
            break
        starts, every = starts_on(camera, left, fed), np.arange(len(left))
        more = _found_rays(camera, fed.centres[left], every, left, starts, fed, probes)
        lit = np.flatnonzero(~more.lost)
        _take(rays, fed.place[left[lit]], more, lit)
    return rays


def _aimed_starts(camera: CameraRecord, which: NDArray[np.int64], fed: FedPixels) -> Floats:
    """(m, k, 2): on fed pixels `which`, near where microlenses image the middle of the pupil."""
    from plenoptic.truth.kernels import representative_ray

    starts = np.repeat(fed.centres[which, None], representative_ray.CANDIDATES, axis=1)
    if camera.array is not None:
        plane, pixel = camera.sensor.plane, camera.sensor.pixel
        representative_ray.fill_aimed_starts(starts, which, fed, pixel, plane, camera.pupil)
    return starts


def _spread_starts(camera: CameraRecord, which: NDArray[np.int64], fed: FedPixels) -> Floats:
    """(m, k, 2): all over them. A pupil that several rims end is pointed: its tips light corners of pixels."""
    return fed.centres[which, None] + camera.sensor.pixel.within(_RIM_STARTS if camera.convex else _STARTS)


def _found_rays(
    camera: CameraRecord,
    pixels: Floats,
    at: NDArray[np.int64],
    which: NDArray[np.int64],
    starts: Floats,
    fed: FedPixels,
    probes: Floats,
) -> PixelRays:
    """Rays of pixels (n, 2), of which those `at` some places, the fed ones `which`, have starts (m, k, 2).

    Where the aperture regions of starts are known, a ray passes the largest part of a microlens; probes look where it
    is lost, and where it is not known.
    """
    rays, left, bounded = _lost_rays(pixels), np.arange(len(at)), camera.convex and camera.exact
    if bounded:
        from plenoptic.truth.kernels import representative_ray

        lanes = camera.own(rays.blocks.size // 8)
        representative_ray.fill_region_rays(rays, lanes, at, which, starts, fed, camera.sensor.plane.distance)
        aimed = ~rays.lost
        rays.before[:] = _trace(rays.blocks, lanes, camera)
        left = np.flatnonzero((aimed & rays.lost)[at])
    patterns, together = probes[: starts.shape[1]], max(1, _TOGETHER // (starts.shape[1] * probes.shape[1]))
    # Without pixels, a look at nothing shows which kernels there will be.
    for first in range(0, len(left), together) if len(pixels) or bounded else (0,):
        some = left[first : first + together]
        more, light = _rays_from(camera, np.ascontiguousarray(starts[some].reshape(-1, 2)), patterns)
        best = light.reshape(len(some), starts.shape[1]).argmax(axis=1) + np.arange(len(some)) * starts.shape[1]
        lit = light[best] > 0
        _take(rays, at[some[lit]], more, best[lit])
    return rays


def _take(rays: PixelRays, to: NDArray[np.int64], others: PixelRays, which: NDArray[np.int64]) -> None:
    """Put some of other rays in the place of those `to`."""
    rays.starts[to], rays.aims[to], rays.cells[to] = others.starts[which], others.aims[which], others.cells[which]
    _put(rays.before, to, _fields(others.before, which))
    _put(rays.blocks, to, _fields(others.blocks, which))


def _rays_from(camera: CameraRecord, starts: Floats, patterns: Floats) -> tuple[PixelRays, Floats]:
    """Ray from each start (n, 2), found by probes in patterns (s, k, 2) in its aperture regions; and its light (n,)."""
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
