"""Media between particles and the lens: the scene's, and those of bodies whose surfaces do not refract."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.cache import PreparedScene
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.alpha_mask import NESTED, SALTS, media_at, no_hits
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.scene import Scene
from plenoptic.scene.scene_record import box_around, build_record

_LONGEST = 1e100
"""Length in mm in place of an infinite one, whose product with an extinction of 0 is not a number."""


class ParticleMedia(NamedTuple):
    """Media that weaken the light of particles, which goes straight through their surfaces."""

    extinction: Floats
    """(media + 1, 3): absorption and scattering per mm; the last row is that outside all bodies."""
    bodies: PreparedScene | None
    """The bodies alone; None if the scene's medium is the only one."""
    box: Floats | None
    """(2, 3): lowest and highest corner of the bodies."""
    at_lens: NDArray[np.int32]
    """(NESTED,): media that the lens is in, as of `media_at`."""

    @property
    def around_lens(self) -> int:
        """Row of `extinction` at the lens."""
        rows = self.at_lens[self.at_lens >= 0]
        return int(rows[-1]) if len(rows) else -1


def is_unrefracting(part: Mesh | Instances) -> bool:
    """True for a body with the index of its surroundings."""
    material = (part.mesh if isinstance(part, Instances) else part).material
    return isinstance(material, Dielectric) and material.index == material.exterior


def particle_media(scene: Scene, lens: Floats) -> ParticleMedia | None:
    """Media of a scene for a lens at a point (3,); None if nothing is weakened."""
    parts = [part for part in scene.meshes if is_unrefracting(part)]
    if not parts and scene.medium is None:
        return None
    record, surfaces = build_record(parts, (), None, medium=scene.medium)
    rows = [material.row() for material in surfaces.materials]
    extinction = [np.zeros(3) + np.add(row.absorption, row.scattering) for row in rows]
    medium = scene.medium
    extinction.append(np.zeros(3) + (0.0 if medium is None else np.add(medium.absorption, medium.scattering)))
    bodies = PreparedScene(record) if parts else None
    at_lens = media_at(record, None if bodies is None else bodies.intersector, lens)
    return ParticleMedia(np.array(extinction), bodies, box_around([part.bounds for part in parts]), at_lens)


def depth_in_bodies(
    media: ParticleMedia, extinction: Floats, segments: tuple[Floats, Floats], at_start: NDArray[np.int32]
) -> Floats:
    """Optical depth (n, C) from starts to ends (n, 3), by an extinction (media + 1, C); `at_start` are media (NESTED,)
    there.
    """
    from plenoptic.rendering.points.kernels.particle_media import cross_surfaces

    assert media.bodies is not None and media.bodies.intersector is not None
    starts, ends = segments
    left, n, which = np.linalg.norm(ends - starts, axis=1), len(starts), np.arange(len(starts))
    rays, depth = np.column_stack([starts, (ends - starts) / left[:, None]]), np.zeros((n, extinction.shape[1]))
    lanes, again = (rays, left, np.tile(at_start, (n, 1))), np.empty(n, np.int64)
    for _ in range(SALTS):
        hits = no_hits(media.bodies.record, len(which))
        media.bodies.intersector.fill_closest(hits, np.ascontiguousarray(rays[which]))
        count = cross_surfaces(again, depth, lanes, hits, which, media.bodies.record.geometry, extinction)
        if not count:
            break
        which = again[:count].copy()
    return depth


def sheet_lengths(media: ParticleMedia, sheet: Sheet, points: Floats) -> Floats:
    """Lengths (n, media + 1) in mm in each medium of the light of a sheet, from its start to points (n, 3).

    The last is 0 if there is no medium outside all bodies.
    """
    lengths = np.clip(sheet.lengths_at(points), 0.0, _LONGEST)
    in_media, has_outside = np.zeros((len(points), len(media.extinction))), media.extinction[-1].any()
    if media.box is not None:
        # Rays come from outside all bodies, and their lengths before the start of the sheet are subtracted.
        towards, outside = sheet.directions_at(points), np.full(NESTED, -1, np.int32)
        unit = np.eye(len(media.extinction))
        unit[-1] = 0.0
        far = 2.0 * np.linalg.norm(points - media.box.mean(axis=0), axis=1)
        far += 2.0 * np.linalg.norm(np.ptp(media.box, axis=0))
        starts, ends = points - far[:, None] * towards, points - np.minimum(lengths, 0.999 * far)[:, None] * towards
        in_media += depth_in_bodies(media, unit, (starts, points), outside)
        in_media -= depth_in_bodies(media, unit, (starts, ends), outside)
    if has_outside:
        in_media[:, -1] = lengths - in_media.sum(axis=1)
    return in_media
