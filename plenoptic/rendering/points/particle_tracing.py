"""Light of particles on the sensor: rays of many particles are traced together, and summed over pixels."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.points.projection import entrance_in_world, transmission_to_lens
from plenoptic.camera.psf.sensor_hits import (
    BUNDLE,
    ForwardRecord,
    fill_losses_behind_array,
    fill_to_sensor,
    in_lens_axes,
)
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.entrance_pupil import entrance_polygons, rim_polygons
from plenoptic.rendering.points.particle_scene import ParticleScene, Passband

REPLICATES = 8
"""Independent scramblings of the rays of a particle, from whose variance the standard error follows."""
MAX_RAYS = 1 << 18
"""Largest number of rays of a particle."""
_LEAST_RAYS = 128
"""Least number of rays of a particle without a time limit."""
_DARK_RAYS = 1 << 20
"""Rays of particles of which none reaches the sensor before these particles count as dark."""
_PILOT, _CANDIDATES = 64, 1024
"""Number of particles from whose errors the number of rays is chosen, and of those among which they are sought."""
_POINTS, _TASK_RAYS = 1024, 1 << 19
"""Largest number of particles, and of rays, of one task."""


class ParticleBatch(NamedTuple):
    """Particles whose rays are traced together, in the lens's axes."""

    number: NDArray[np.int64]
    """(n,): indices among all particles, the seeds of their random numbers."""
    point: Floats
    """(n, 3)"""
    radius: Floats
    """(n,)"""
    polygon: Floats
    """(n, 2, k): corners on the entrance plane, counter-clockwise."""
    colour: Floats
    """(n, channels): factors of the weights of each channel."""
    each: int
    """Rays of a particle and replicate."""
    offset: int
    """Index of the first of them in the net of the replicate."""
    replicates: int = REPLICATES


class ParticlePixels(NamedTuple):
    """Pixels that some particles illuminate."""

    number: NDArray[np.int64]
    """(n,): indices of the particles."""
    counts: NDArray[np.int64]
    """(n,): number of pixels of each."""
    entries: tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]
    """Pixels (m,), and weights and their standard errors (m, channels) in sr."""
    moments: Floats
    """(n, replicates, 3): light, and light times x and y on the sensor, in mm; the mean over the channels."""


class RayNumber(NamedTuple):
    """Rays of each particle, the wall time of a ray in s, and the time at which all should be traced."""

    rays: int
    seconds: float = 0.0
    end: float = math.inf
    """As of `time.perf_counter`."""


def choose_rays(scene: ParticleScene, target_error: float, threads: int, end: float = math.inf) -> RayNumber:
    """Rays of each particle, so that the standard error of its light is `target_error` of it, by a few lit particles.

    The errors are averaged over particles by the squares of their light; at most `MAX_RAYS`. Particles that stay dark
    get the least number: few rays may miss the sensor by chance, so that more of them are traced first.
    """
    rays = fewest = whole_replicates(scene, _LEAST_RAYS)
    pilot, polygons = _lit_particles(scene, rays, threads)
    aimed = int(np.isfinite([polygon[:, 0, 0] for polygon in polygons]).all(axis=0).sum())
    while True:
        begin = time.perf_counter()
        tasks = _ParticleTasks(scene, pilot, RayNumber(rays), polygons)
        parts = [
            part.moments[:, :, 0]
            for part in run_in_order(functools.partial(_trace_task, scene), tasks, threads=threads)
        ]
        seconds = time.perf_counter() - begin
        light = np.concatenate(parts)
        squares, is_lit = light.var(axis=1, ddof=1).sum() / REPLICATES, light.any()
        is_exact = squares <= target_error**2 * np.square(light.mean(axis=1)).sum()
        if not is_lit:
            is_exact = not 0 < rays * aimed < _DARK_RAYS
        if is_exact or 2 * rays > MAX_RAYS or begin + 8.0 * seconds > end:
            return RayNumber(rays if is_lit else fewest, seconds / max(rays * len(pilot), 1), end)
        rays *= 2


def _lit_particles(
    scene: ParticleScene, rays: int, threads: int
) -> tuple[NDArray[np.int64], list[NDArray[np.float32]]]:
    """Some particles whose light reaches the sensor, and their polygons; some dark ones if there are hardly others."""
    candidates = np.random.default_rng(0).permutation(scene.lit if len(scene.lit) else len(scene.points))
    lit: list[NDArray[np.int64]] = []
    for first in range(0, min(len(candidates), _CANDIDATES), _PILOT):
        number = candidates[first : first + _PILOT]
        parts = trace_particles(scene, RayNumber(rays), threads, number)
        lit.append(np.concatenate([part.number[part.moments[:, :, 0].any(axis=1)] for part in parts]))
        if sum(map(len, lit)) >= _PILOT // 2:
            break
    pilot = np.concatenate(lit)[:_PILOT]
    pilot = np.sort(pilot if len(pilot) else candidates[:_PILOT])
    return pilot, entrance_polygons_at(scene, pilot)


def whole_replicates(scene: ParticleScene, rays: int) -> int:
    """Number of rays of each particle, rounded up to whole replicates of all wavelengths."""
    unit = REPLICATES * len(scene.passbands)
    return int(-(-rays // unit) * unit)


def trace_particles(
    scene: ParticleScene, rays: RayNumber, threads: int, number: NDArray[np.int64] | None = None
) -> Iterator[ParticlePixels]:
    """Trace rays of each particle to the sensor, of some or all, in their order.

    A particle's pixels follow from the seed, its index and its number of rays alone.
    """
    tasks = _ParticleTasks(scene, np.arange(len(scene.points)) if number is None else number, rays)
    return run_in_order(functools.partial(_trace_task, scene), tasks, threads=threads)


def entrance_polygons_at(scene: ParticleScene, number: NDArray[np.int64]) -> list[NDArray[np.float32]]:
    """Polygons (n, sides, 2) of some particles on the entrance plane at each wavelength; nan if dark."""
    world, radius = scene.points.positions[number], 0.5 * scene.points.diameter[number]
    radii = radius if radius.any() else None
    return [_polygons(band, in_lens_axes(band.record, world), radii).astype(np.float32) for band in scene.passbands]


def _polygons(band: Passband, points: Floats, radii: Floats | None) -> Floats:
    """Corners (n, sides, 2) of polygons around the rays of points (n, 3) in the lens axes; nan if dark."""
    if band.record.unfolded is None:
        return entrance_polygons(band.record.entrance, points, radii, band.outlines)
    return rim_polygons(band.record.entrance, points, radii)


class ParticleTask(NamedTuple):
    """Particles (n,) to trace together, rays of a replicate and wavelength, polygons at each wavelength (or None)."""

    number: NDArray[np.int64]
    each: int
    polygons: list[NDArray[np.float32]] | None


class _ParticleTasks:
    """Tasks of particles, with fewer rays for the later ones if time gets short."""

    def __init__(
        self,
        scene: ParticleScene,
        number: NDArray[np.int64],
        rays: RayNumber,
        polygons: list[NDArray[np.float32]] | None = None,
    ) -> None:
        self.scene, self.number, self.rays, self.polygons = scene, number, rays, polygons
        self.size = min(max(_TASK_RAYS // rays.rays, 1), _POINTS)

    def __length_hint__(self) -> int:
        return -(-len(self.number) // self.size)

    def __iter__(self) -> Iterator[ParticleTask]:
        begin, unit, n_traced = time.perf_counter(), whole_replicates(self.scene, 1), 0
        for first in range(0, len(self.number), self.size):
            clock, part = time.perf_counter(), slice(first, first + self.size)
            rays, remaining = self.rays.rays, len(self.number) - first
            seconds = max(self.rays.seconds, (clock - begin) / max(n_traced, 1))
            while rays * remaining * seconds > self.rays.end - clock and rays >= 2 * unit:
                rays //= 2
            number = self.number[part]
            n_traced += rays * len(number)
            polygons = None if self.polygons is None else [polygon[part] for polygon in self.polygons]
            yield ParticleTask(number, rays // unit, polygons)


def _trace_task(scene: ParticleScene, task: ParticleTask) -> ParticlePixels:
    """Trace the rays of some particles to their polygons, bundle by bundle."""
    from plenoptic.rendering.points.kernels.particle_rays import fill_entries

    number, each = task.number, task.each
    polygons = entrance_polygons_at(scene, number) if task.polygons is None else task.polygons
    world = scene.points.positions[number]
    lens_points = [in_lens_axes(band.record, world) for band in scene.passbands]
    lit = np.flatnonzero(np.all([np.isfinite(polygon[:, 0, 0]) for polygon in polygons], axis=0))
    bands, rays = len(scene.passbands), REPLICATES * each * len(scene.passbands)
    size = max(BUNDLE // (REPLICATES * each), 1)
    counts, moments = np.zeros(len(number), np.int64), np.zeros((len(number), REPLICATES, 3))
    table = np.empty(1 << (2 * rays).bit_length(), np.int64)
    sums = np.empty((rays, REPLICATES, scene.channels))
    parts = []
    for first in range(0, len(lit), size):
        rows = lit[first : first + size]
        pixel = np.empty((bands, len(rows), REPLICATES, each), np.int32)
        weight = np.empty((*pixel.shape, scene.channels))
        part_moments = np.zeros((len(rows), REPLICATES, 3))
        for k, band in enumerate(scene.passbands):
            corners = np.ascontiguousarray(polygons[k][rows].transpose(0, 2, 1), dtype=np.float64)
            radius = 0.5 * scene.points.diameter[number[rows]]
            colour = np.ones((len(rows), 1))
            if band.spectrum is not None:  # colours come with the transmission of each wavelength
                colour = np.ones((len(rows), scene.channels))
            elif scene.hue is not None:
                colour = np.ascontiguousarray(scene.hue[number[rows]] @ band.weights.T)
            batch = ParticleBatch(number[rows], lens_points[k][rows], radius, corners, colour, each, k * each)
            _trace_bundle(scene, band, batch, (pixel[k], weight[k], part_moments))
        entries = (
            np.empty(pixel.size, np.int32),
            np.empty((pixel.size, scene.channels), np.float32),
            np.empty((pixel.size, scene.channels), np.float32),
        )
        part_counts = np.empty(len(rows), np.int64)
        n = fill_entries(entries, part_counts, pixel, weight, table, sums, each)
        parts.append(tuple(column[:n].copy() for column in entries))
        counts[rows], moments[rows] = part_counts, part_moments / each
    columns = tuple(np.concatenate(column) for column in zip(*parts, strict=True)) if parts else _no_entries(scene)
    return ParticlePixels(number, counts, columns, moments)  # type: ignore[arg-type]


def _no_entries(scene: ParticleScene) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    nothing = np.empty((0, scene.channels), np.float32)
    return np.empty(0, np.int32), nothing, nothing


def _trace_bundle(
    scene: ParticleScene, band: Passband, batch: ParticleBatch, results: tuple[NDArray[np.int32], Floats, Floats]
) -> None:
    """Trace the rays of a batch at one wavelength, and fill pixels, weights and moments of `fill_pixels`."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
    from plenoptic.rendering.points.kernels import particle_rays

    record, (pixel, weight, moments) = band.record, results
    n = pixel.size
    blocks = np.empty(-(-n // BLOCK) * RAY)
    lengths, transmission = None if band.extinction is None else np.empty(n), None
    particle_rays.fill_particle_rays(blocks, batch, scene.seed, record.entrance.z, record.ideal, lengths)
    if lengths is not None:
        if not record.ideal:  # the first plane of ideal lenses is that of the entrance
            _add_path_to_first_element(lengths, blocks, record)
        transmission = _transmission(_optical_depth(lengths, blocks, scene, batch, band), scene, batch, band)
    if scene.occluder is not None:
        centres, entering = _segments(blocks, scene, batch)
        particle_rays.weaken_rays(blocks, transmission_to_lens(record, centres, entering, scene.occluder))
    if record.iris is not None:
        particle_rays.fill_particle_deflections(blocks, batch, scene.seed, record.iris, None)
    fill_to_sensor(blocks, record)
    if record.has_losses_before_array:
        fill_losses_behind_array(blocks, np.empty(blocks.size), record)
    if record.deflection is not None:
        particle_rays.fill_particle_deflections(blocks, batch, scene.seed, None, record.deflection)
    screen = (*record.camera.sensor.shape, record.camera.sensor.pixel_pitch)
    flat = weight.reshape(n, -1)
    particle_rays.fill_pixels(pixel.reshape(n), flat, moments, blocks, batch, screen, record.opening, transmission)


def _add_path_to_first_element(lengths: Floats, blocks: Floats, record: ForwardRecord) -> None:
    """Add the paths of rays from the plane of the entrance to the first element, in mm; lost rays get any number."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, Z
    from plenoptic.optics.lens.kernels.trace import fill_through_lens

    reached = blocks.copy()
    fill_through_lens(reached, record.lens.part(0, 1), None)
    paths = (part.reshape(-1, RAY)[:, : Z + BLOCK].reshape(-1, 3, BLOCK) for part in (reached, blocks))
    lengths += np.linalg.norm(np.subtract(*paths), axis=1).ravel()[: lengths.size]


def _optical_depth(
    lengths: Floats, blocks: Floats, scene: ParticleScene, batch: ParticleBatch, band: Passband
) -> Floats:
    """Optical depth (n, k) of the media along rays of given lengths (n,), and along the sheet up to them."""
    media, extinction = scene.media, band.extinction
    assert media is not None and extinction is not None
    at_lens = extinction[media.around_lens]
    depth = np.multiply.outer(lengths, at_lens)
    if media.bodies is not None:
        from plenoptic.rendering.points.particle_media import depth_in_bodies

        centres, entering = _segments(blocks, scene, batch)
        starts = entrance_in_world(band.record, entering)
        depth += depth_in_bodies(media, extinction - at_lens, (starts, centres), media.at_lens)
    if scene.sheet_lengths is not None:
        before = scene.sheet_lengths[batch.number] @ extinction
        depth += np.repeat(before, batch.replicates * batch.each, axis=0)
    return np.asarray(depth)


def _transmission(depth: Floats, scene: ParticleScene, batch: ParticleBatch, band: Passband) -> Floats:
    """Fraction (n, channels) of light left by an optical depth (n, k), with a spectrum times the particle's colour."""
    transmission = np.exp(-depth)
    if band.spectrum is None:
        return transmission
    assert scene.hue is not None
    parts = np.einsum("pi,kci->pkc", scene.hue[batch.number], band.spectrum)
    of_particles = transmission.reshape(len(parts), -1, transmission.shape[1]) @ parts
    return np.ascontiguousarray(of_particles.reshape(len(transmission), -1))


def _segments(blocks: Floats, scene: ParticleScene, batch: ParticleBatch) -> tuple[Floats, Floats]:
    """Centres (n, 3) of the particles of rays, in the world, and points (n, 2) of the rays on the entrance plane."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, X, Y

    of_each = batch.replicates * batch.each
    rays, n = blocks.reshape(-1, RAY), of_each * len(batch.number)
    entering = np.column_stack([rays[:, X : X + BLOCK].ravel()[:n], rays[:, Y : Y + BLOCK].ravel()[:n]])
    return np.repeat(scene.points.positions[batch.number], of_each, axis=0), entering
