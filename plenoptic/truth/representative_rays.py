"""Representative ray of a pixel.

It starts at the pixel's centre and passes the illuminated centroid of the microlens that gives the centre most light.
If no light reaches the centre, it starts at the point of the sensitive area nearest to a microlens's image of the
pupil's centre: the image of a small stop may illuminate only a corner of a pixel. If the pupil's centre is vignetted,
or the stop is a star or mask, it starts at the brightest of many points. Rays are found from aperture regions, if these
are exact, or by fixed sets of probe rays, so that the result does not depend on samples or seeds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import fill_through_array
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.sampling.aperture_regions import aperture_regions
from plenoptic.camera.sampling.sampling_records import IlluminatedPixels
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS
from plenoptic.core.values import Floats


def _hammersley_points(bits: int) -> Floats:
    """Hammersley points (2^bits, 2) in the unit square, in the order of their first coordinate."""
    count = 1 << bits
    reversed_bits = [int(f"{i:0{bits}b}"[::-1], 2) for i in range(count)]
    return np.stack([np.arange(count) + 0.5, np.array(reversed_bits) + 0.5], axis=1) / count


def _shifted_patterns(points: Floats, count: int) -> Floats:
    """Patterns (count, n, 2) shifted by M. Roberts's R2 sequence, so that they fill each other's gaps."""
    shift = np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    first, second = np.modf(0.5 + shift)[0].T[:, :, None]
    return np.stack([(np.arange(len(points)) + first) / len(points), np.modf(points[:, 1] + second)[0]], axis=-1)


_PROBES, _DENSE_PROBES = _hammersley_points(4)[None], _hammersley_points(6)[None]
"""Probe points in the aperture region of a start: of the pixel's centre, and of any other start."""
_RIM_STARTS = np.stack(np.meshgrid(*2 * [np.linspace(-0.499, 0.499, 4)]), axis=-1).reshape(-1, 2)
_STARTS = _hammersley_points(6) - 0.5
_SHIFTED_PROBES = _shifted_patterns(_hammersley_points(6), len(_STARTS))
"""Starts on a pixel, as fractions of its sides, and their probes; the larger set is for stops that are not convex."""
_CHUNK = 1 << 14
"""Probe rays that are traced together."""


class StartRays(NamedTuple):
    """Rays from n starts on the sensor, one for each."""

    blocks: Floats
    """Aimed, then traced; lost if no light reaches the start."""
    lenslets: NDArray[np.void] | None
    """Lenslet parameters of the rays; None if all microlenses are alike."""
    cells: Floats
    """(n, 3): see `RepresentativeRays`."""
    light: Floats
    """(n,): light through its microlens, the sum of the probes' weights."""
    nearest: NDArray[np.int64]
    """(n,): unvignetted probe nearest to the aim of the ray; -1 without light."""


class RepresentativeRays(NamedTuple):
    """Representative rays, one for each pixel."""

    starts: Floats
    """(n, 2): starts on the sensor, local."""
    before: Floats
    """Blocks of rays between array and lens, in the lens's axes, on their way to the scene."""
    blocks: Floats
    """Blocks of the same rays in front of the lens; those of pixels without light are lost."""
    aims: Floats
    """(n, 2): intersections with the array's rear principal plane, local."""
    cells: Floats
    """(n, 3): centre of the cell of each pixel's microlens, local, and its row in the lens table or -1; nan without a
    microlens."""
    dark: NDArray[np.bool_]
    """(n,): True if no light can reach the pixel, by bounds on the pupil."""

    @property
    def lost(self) -> NDArray[np.bool_]:
        """(n,): True if no ray was found for the pixel."""
        return _are_lost(self.blocks, len(self.starts))


def _lost_rays(pixels: Floats) -> RepresentativeRays:
    """Rays of dark pixels: all are lost."""
    n = len(pixels)
    blocks = np.zeros((-(-n // BLOCK), 8, BLOCK))
    blocks[:, STATUS // BLOCK] = MISSED
    flat = blocks.reshape(-1)
    return RepresentativeRays(
        pixels.copy(), flat.copy(), flat, pixels.copy(), np.full((n, 3), np.nan), np.ones(n, dtype=bool)
    )


def representative_rays(camera: CameraRecord, pixels: Floats, illuminated: IlluminatedPixels) -> RepresentativeRays:
    """Find the representative rays of pixels with centres (n, 2), some of which are illuminated."""
    place, centres = illuminated.place, illuminated.centres[:, None]
    rays = _find_rays(camera, pixels, place, np.arange(len(place)), centres, illuminated, _PROBES)
    rays.dark[place] = False
    for make_starts, probes in ((_aimed_starts, _DENSE_PROBES), (_spread_starts, _SHIFTED_PROBES)):
        remaining = np.flatnonzero(rays.lost[place])
        if not remaining.size:
            break
        starts, all_indices = make_starts(camera, remaining, illuminated), np.arange(len(remaining))
        pixels = illuminated.centres[remaining]
        candidates = _find_rays(camera, pixels, all_indices, remaining, starts, illuminated, probes)
        lit = np.flatnonzero(~candidates.lost)
        _replace_rays(rays, place[remaining[lit]], candidates, lit)
    return rays


def _aimed_starts(camera: CameraRecord, indices: NDArray[np.int64], illuminated: IlluminatedPixels) -> Floats:
    """Starts (m, k, 2) on illuminated pixels `indices`, nearest to the microlenses' images of the pupil's centre."""
    from plenoptic.truth.kernels import representative_ray

    starts = np.repeat(illuminated.centres[indices, None], representative_ray.CANDIDATES, axis=1)
    if camera.array is not None:
        plane, pixel = camera.sensor.plane, camera.sensor.pixel
        representative_ray.fill_aimed_starts(starts, indices, illuminated, pixel, plane, camera.pupil)
    return starts


def _spread_starts(camera: CameraRecord, indices: NDArray[np.int64], illuminated: IlluminatedPixels) -> Floats:
    """Starts (m, k, 2) all over illuminated pixels `indices`.

    A pupil vignetted by several rims has tips, which illuminate corners of pixels.
    """
    return illuminated.centres[indices, None] + camera.sensor.pixel.within(_RIM_STARTS if camera.convex else _STARTS)


def _find_rays(
    camera: CameraRecord,
    pixels: Floats,
    places: NDArray[np.int64],
    indices: NDArray[np.int64],
    starts: Floats,
    illuminated: IlluminatedPixels,
    probes: Floats,
) -> RepresentativeRays:
    """Find rays of pixels (n, 2) from starts (m, k, 2) on those at `places`, the illuminated ones `indices`.

    With exact regions, a ray passes the largest part of a microlens. Probes are used if it is lost, or if regions are
    not exact.
    """
    rays, remaining, is_exact = _lost_rays(pixels), np.arange(len(places)), camera.convex and camera.exact
    if is_exact:
        from plenoptic.truth.kernels import representative_ray

        lenslets = camera.lenslet_parameters(rays.blocks.size // 8)
        distance = camera.sensor.plane.distance
        representative_ray.fill_region_rays(rays, lenslets, places, indices, starts, illuminated, distance)
        aimed = ~rays.lost
        rays.before[:] = _trace(rays.blocks, lenslets, camera)
        remaining = np.flatnonzero((aimed & rays.lost)[places])
    patterns, chunk_size = probes[: starts.shape[1]], max(1, _CHUNK // (starts.shape[1] * probes.shape[1]))
    # Without pixels, an empty call compiles the kernels.
    for first in range(0, len(remaining), chunk_size) if len(pixels) or is_exact else (0,):
        chunk = remaining[first : first + chunk_size]
        candidates, light = _rays_from(camera, np.ascontiguousarray(starts[chunk].reshape(-1, 2)), patterns)
        brightest = light.reshape(len(chunk), starts.shape[1]).argmax(axis=1) + np.arange(len(chunk)) * starts.shape[1]
        lit = light[brightest] > 0
        _replace_rays(rays, places[chunk[lit]], candidates, brightest[lit])
    return rays


def _replace_rays(
    rays: RepresentativeRays, rows: NDArray[np.int64], source: RepresentativeRays, indices: NDArray[np.int64]
) -> None:
    """Replace the rays `rows` by rays `indices` of another set."""
    rays.starts[rows], rays.aims[rows] = source.starts[indices], source.aims[indices]
    rays.cells[rows] = source.cells[indices]
    _set_fields(rays.before, rows, ray_fields(source.before, indices))
    _set_fields(rays.blocks, rows, ray_fields(source.blocks, indices))


def _rays_from(camera: CameraRecord, starts: Floats, patterns: Floats) -> tuple[RepresentativeRays, Floats]:
    """Find a ray from each start (n, 2) by probes of patterns (s, k, 2) in its aperture region; and its light (n,)."""
    from plenoptic.truth.kernels import representative_ray

    n = len(starts)
    regions = aperture_regions(camera, starts)
    aims = np.empty((n * patterns.shape[1], representative_ray.AIM))
    probes = np.empty(-(-len(aims) // BLOCK) * RAY)
    lenslets = camera.lenslet_parameters(probes.size // 8)
    representative_ray.fill_probes(probes, lenslets, aims, starts, regions, patterns)
    _trace(probes, lenslets, camera)
    size = -(-n // BLOCK)
    blocks, lenslets, cells = np.empty(size * RAY), camera.lenslet_parameters(size * BLOCK), np.empty((n, 3))
    rays = StartRays(blocks, lenslets, cells, np.empty(n), np.empty(n, dtype=np.int64))
    representative_ray.fill_centroid_rays(rays, starts, probes, aims, regions)
    all_indices = np.arange(n)
    aimed = ray_fields(blocks, all_indices)
    before = _trace(blocks, lenslets, camera)
    missed = np.flatnonzero(_are_lost(blocks, n) & (rays.nearest >= 0))
    if missed.size:
        # The centroid of a region that is not convex may be dark.
        aimed[missed, :2] = aims[rays.nearest[missed], :2]
        aimed[missed, 3:5] = aimed[missed, :2] - starts[missed]
        _set_fields(blocks, all_indices, aimed)
        before = _trace(blocks, lenslets, camera)
    return RepresentativeRays(starts.copy(), before, blocks, aimed[:, :2], cells, np.zeros(n, dtype=bool)), rays.light


def _trace(blocks: Floats, lenslets: NDArray[np.void] | None, camera: CameraRecord) -> Floats:
    """Trace aimed rays through array and lens; return a copy of them between array and lens."""
    from plenoptic.optics.lens.kernels.trace import fill_traced

    fill_through_array(blocks, lenslets, camera)
    before = blocks.copy()
    fill_traced(blocks, camera.lens, None)
    return before


def _are_lost(blocks: Floats, n: int) -> NDArray[np.bool_]:
    return np.asarray(blocks.reshape(-1, 8, BLOCK)[:, STATUS // BLOCK].reshape(-1)[:n] != 0)


def ray_fields(blocks: Floats, indices: NDArray[np.int64]) -> Floats:
    """Fields (m, 8) of some rays of a bundle: x, y, z, direction, weight and status."""
    return blocks.reshape(-1, 8, BLOCK)[indices // BLOCK, :, indices % BLOCK]


def _set_fields(blocks: Floats, indices: NDArray[np.int64], fields: Floats) -> None:
    """Set the fields of some rays of a bundle."""
    blocks.reshape(-1, 8, BLOCK)[indices // BLOCK, :, indices % BLOCK] = fields
