"""Particles before a camera, compiled: passbands of the camera, colours, pilots and meshes that hide them."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.psf.sensor_hits import ForwardRecord, diffraction_record, in_lens_axes
from plenoptic.core.color.spectra import colour_tables
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import ImplausibleSceneWarning, SceneError
from plenoptic.optics.lens.pupil.entrance_pupil import Outlines
from plenoptic.scene.points import Points

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
    from plenoptic.rendering.points.particle_media import ParticleMedia
    from plenoptic.scene.cache import PreparedScene
    from plenoptic.scene.scene import Scene

_WAVELENGTHS = 16
"""Wavelengths at which a camera with a spectral sensitivity is traced."""
_GHOST_WAVELENGTHS = 4
"""Those of its ghosts, which are dim and blurred."""
_LOSSES = 4
"""Wavelengths of each passband at which the loss in media is computed."""


class Passband(NamedTuple):
    """Record of a camera at one wavelength, and the weights of the light there."""

    record: ForwardRecord
    weights: Floats
    """(C, 3): channels, from red, green and blue of the particles; they add up to 1 for each channel."""
    extinction: Floats | None
    """(media + 1, C), or (media + 1, k) with a `spectrum`: loss of light in `ParticleScene.media` of each channel, or
    at each of k wavelengths, per mm; None without a medium."""
    spectrum: Floats | None
    """(k, C, 3): `weights` of those wavelengths, which add up to all; None if the channels have their losses."""
    outlines: Outlines
    """Outlines of the pupil that particles share, added to by the tasks that trace them."""


class ParticleScene(NamedTuple):
    """Particles before a camera, compiled."""

    points: Points
    lit: NDArray[np.int64]
    """Particles that have light in any channel."""
    passbands: tuple[Passband, ...]
    hue: Floats | None
    """(n, 3): colours of particles over their means; None if weights have no colour: neither camera nor medium has."""
    intensity: Floats
    """(n, 1) or (n, 3): what weights are multiplied by."""
    occluder: PreparedScene | None
    media: ParticleMedia | None
    sheet_lengths: Floats | None
    """(n, media + 1): lengths of the light of a sheet in `media`, in mm; None without a sheet or media."""
    seed: np.uint64

    @property
    def channels(self) -> int:
        """Channels of the weights."""
        return 1 if self.hue is None else len(self.passbands[0].weights)

    @property
    def image_channels(self) -> int:
        """Channels of images."""
        return max(self.channels, len(self.intensity[0]))


def particle_scene(
    points: Points, camera: PlenopticCamera, scene: Scene | None, seed: int, ghosts: Ghosts | None = None
) -> ParticleScene:
    """Compile particles before a camera, hidden by the meshes of a scene and weakened by its media.

    With `ghosts`, light reaches the sensor by reflections in the lens only, each pair of surfaces being a passband.
    Raises errors of particles at bad places.
    """
    record = diffraction_record(camera)
    in_lens_axes(record, points.positions)
    centre = _pupil_centre(record)
    media = lengths = None
    if scene is not None:
        from plenoptic.rendering.points.particle_media import particle_media, sheet_lengths

        media = particle_media(scene, centre)
        if media is not None and points.sheet is not None:
            lengths = sheet_lengths(media, points.sheet, points.positions)
    extinction = None if media is None else media.extinction
    passbands = _passbands(camera, record, extinction, _WAVELENGTHS if ghosts is None else _GHOST_WAVELENGTHS)
    if ghosts is not None:
        from plenoptic.camera.psf.ghost_spread import ghost_records  # few images have ghosts

        passbands = tuple(
            band._replace(record=path) for band in passbands for path in ghost_records(band.record.camera, ghosts)
        )
    occluder = None if scene is None else _occluder(scene, points, centre)
    intensity = points.intensities(centre)
    columns = intensity if intensity.ndim == 2 else intensity[:, None]
    hue = None
    if camera.sensitivity is not None or len(passbands[0].weights) > 1:
        mean = columns.mean(axis=1, keepdims=True)
        hue = np.broadcast_to(np.divide(columns, mean, out=np.ones(columns.shape), where=mean > 0), (len(points), 3))
        columns = mean
    lit = np.flatnonzero(columns.any(axis=1))
    return ParticleScene(points, lit, passbands, hue, columns, occluder, media, lengths, np.uint64(seed))


def _passbands(
    camera: PlenopticCamera, record: ForwardRecord, extinction: Floats | None, wavelengths: int
) -> tuple[Passband, ...]:
    """Camera at its wavelength, or at wavelengths that stand for parts of its spectral sensitivity.

    `extinction` (media + 1, 3) is that of red, green and blue.
    """
    if camera.sensitivity is None:
        if extinction is None or not np.ptp(extinction, axis=1).any():
            grey = None if extinction is None else np.ascontiguousarray(extinction[:, :1])
            return (Passband(record, np.ones((1, 3)) / 3, grey, None, {}),)
        return (Passband(record, np.eye(3), extinction, None, {}),)
    tables = colour_tables(camera.sensitivity)
    probability = np.diff(tables.cdf, prepend=0.0)
    middle, parts = tables.cdf - 0.5 * probability, min(wavelengths, len(tables.wavelengths))
    part = np.arange(parts) if parts == len(middle) else np.minimum((parts * middle).astype(int), parts - 1)
    bands = []
    for k in np.unique(part):
        rows = part == k
        wavelength = float(np.average(tables.wavelengths[rows], weights=probability[rows]))
        weights = (probability[rows, None] * tables.weights[rows]).T @ tables.basis[rows]
        loss = spectrum = None
        if extinction is not None:  # the spectra of its colours
            groups = np.array_split(np.flatnonzero(rows), min(_LOSSES, int(rows.sum())))
            means = [np.average(tables.basis[group], axis=0, weights=probability[group]) for group in groups]
            loss = extinction @ np.transpose(means)
            spectrum = np.array(
                [(probability[group, None] * tables.weights[group]).T @ tables.basis[group] for group in groups]
            )
        record = diffraction_record(dataclasses.replace(camera, wavelength=wavelength))
        bands.append(Passband(record, weights, loss, spectrum, {}))
    return tuple(bands)


def _pupil_centre(record: ForwardRecord) -> Floats:
    """Centre (3,) of the entrance pupil in the world, or of the first plane of a telecentric lens."""
    z = record.entrance.pupil[0]
    centre = np.array([[0.0, 0.0, z if np.isfinite(z) else record.entrance.z]])
    pose, lens_pose = record.camera.pose, record.parts.lens_to_camera
    centre = centre if lens_pose is None else lens_pose.points(centre)
    return np.asarray((centre if pose is None else pose.to_world(centre))[0])


def _occluder(scene: Scene, points: Points, centre: Floats) -> PreparedScene | None:
    """Compile the meshes that hide particles; raise a SceneError for particles inside bodies of glass, and warn of
    glass between them and the pupil's centre.
    """
    from plenoptic.rendering.points.particle_media import is_unrefracting
    from plenoptic.scene.cache import PreparedScene, prepared_scene
    from plenoptic.scene.geometry.instance import Instances
    from plenoptic.scene.materials.alpha_mask import media_at
    from plenoptic.scene.materials.dielectric import Dielectric, ThinGlass
    from plenoptic.scene.scene_record import build_record

    meshes = [part for part in scene.meshes if not is_unrefracting(part)]
    if not meshes:
        return None
    if len(meshes) == len(scene.meshes):
        prepared = prepared_scene(scene)
    else:
        prepared = PreparedScene(build_record(meshes, scene.lights, scene.background, medium=scene.medium)[0])
    names = [name for name, part in zip(scene.object_names, scene.meshes, strict=False) if not is_unrefracting(part)]
    glass, is_near_glass = [], np.zeros(len(points), bool)
    for k, part in enumerate(meshes):
        material = (part.mesh if isinstance(part, Instances) else part).material
        if isinstance(material, Dielectric | ThinGlass):
            glass.append(k)
        if isinstance(material, Dielectric):
            low, high = part.bounds
            is_near_glass |= ((low < points.positions) & (points.positions < high)).all(axis=1)
    body = 0 if prepared.record.surrounding is None else 1
    for k in np.flatnonzero(is_near_glass).tolist():
        assert prepared.intersector is not None
        if media_at(prepared.record, prepared.intersector, points.positions[k])[body] >= 0:
            raise SceneError(
                f"particle {k} at {points.positions[k].tolist()} mm lies inside a body of glass, whose surface stops "
                "its rays; move it outside, give the medium to pl.Scene(medium=), or put an emissive mesh there"
            )
    if glass:
        _warn_of_glass({k: names[k] for k in glass}, prepared, points.positions, centre)
    return prepared


def _warn_of_glass(glass: dict[int, str], prepared: PreparedScene, points: Floats, centre: Floats) -> None:
    """Warn of meshes of glass, by numbers and names, that particles lie behind."""
    from plenoptic.scene.geometry.kernels.interaction import fill_distances
    from plenoptic.scene.materials.alpha_mask import no_hits

    record, distance = prepared.record, np.linalg.norm(centre - points, axis=1)
    assert prepared.intersector is not None and record.triangle_mesh is not None
    rays, reached = np.column_stack([points, (centre - points) / distance[:, None]]), np.empty(len(points))
    hits = no_hits(record, len(points))
    prepared.intersector.fill_closest(hits, rays)
    fill_distances(reached, hits, rays, record.geometry)
    hidden = record.triangle_mesh[hits.triangle[reached < distance]]
    if names := [name for k, name in glass.items() if (hidden == k).any()]:
        count = int(np.isin(hidden, list(glass)).sum())
        warn(
            f"{count} of {len(points)} particles lie behind glass, which hides them: {', '.join(names[:8])}; remove "
            "it, or put a window before the lens by pl.optics.window",
            ImplausibleSceneWarning,
        )


def pixel_area(camera: PlenopticCamera) -> float:
    """Area of a pixel in mm^2, by which light is divided."""
    return math.pow(camera.sensor.pixel_pitch, 2)
