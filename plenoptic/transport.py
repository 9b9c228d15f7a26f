"""Light transport: paths that left the lens, followed through the scene stage after stage."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.tables import CameraTables
from plenoptic.scene.accel import Intersector
from plenoptic.scene.tables import SceneTables
from plenoptic.stages import Plan, Stage


class Settings(NamedTuple):
    """What a tile needs to know beside camera and scene."""

    samples: int
    replicates: int
    seed: np.uint64
    max_bounces: int
    plan: Plan


class Transport:
    """Follows the paths of a tile's bundles through the scene; its arrays are used again for each bundle."""

    def __init__(
        self,
        tables: CameraTables,
        scene: SceneTables,
        intersector: Intersector | None,
        settings: Settings,
        most: int,
    ) -> None:
        self._camera, self._scene, self._intersector, self._settings = tables, scene, intersector, settings
        self._basis = None if tables.colour is None else tables.colour.basis
        self._channels = channels = scene.channels if tables.colour is None else 1
        plan = settings.plan
        self._radiance = np.empty((most, channels))
        self._rays = np.empty((most, 6))
        self._lanes = np.empty(most, dtype=np.int64)
        self._hits = np.full(most, -1, dtype=np.int32)
        if plan.runs(Stage.SCATTERING):
            self._keys, self._indices = np.empty(most, dtype=np.uint64), np.empty(most, dtype=np.uint32)
            lights = plan.runs(Stage.DIRECT_LIGHT)
            self._shadow_rays = np.empty((most if lights else 0, 6))
            self._shadow_path = np.empty(most if lights else 0, dtype=np.int64)
            self._shadow_radiance = np.empty((most if lights else 0, channels))
            self._blocked = np.empty(most if lights else 0, dtype=np.uint8)

    def radiance(
        self,
        blocks: NDArray[np.float64],
        start: int,
        n: int,
        number: NDArray[np.int64],
        waves: NDArray[np.int64] | None,
    ) -> NDArray[np.float64]:
        """What the paths of a bundle see, (n, channels); 0 for those that did not leave the lens.

        With `waves`, the number of each path's wavelength, there is one channel.
        """
        from plenoptic.camera import _sample
        from plenoptic.scene import _shade

        scene, settings, plan = self._scene, self._settings, self._settings.plan
        radiance = self._radiance[:n]
        radiance[:] = 0.0
        found = _sample.fill_world_rays(
            self._rays, self._lanes, blocks, n, self._camera.rotation, self._camera.position
        )
        rays, path_of = self._rays[:found], self._lanes[:found]
        throughput = None
        if plan.runs(Stage.SCATTERING):
            _sample.fill_path_keys(
                self._keys[:n],
                self._indices[:n],
                start,
                settings.samples,
                min(settings.replicates, settings.samples),
                settings.seed,
                number,
            )
        for bounce in range(settings.max_bounces + 1):
            hits = self._hits[: len(path_of)]
            if self._intersector is not None:
                self._intersector.fill_closest(hits, rays, coherent=bounce == 0)
            emission = scene.emission if bounce == 0 or not plan.runs(Stage.DIRECT_LIGHT) else None
            _shade.fill_emitted(
                radiance,
                throughput,
                path_of,
                hits,
                rays,
                scene.vertices,
                scene.triangles,
                scene.triangle_material,
                emission,
                scene.two_sided,
                scene.background,
                waves,
                self._basis,
            )
            if bounce == settings.max_bounces or not plan.runs(Stage.SCATTERING):
                break
            more = bounce + 1 < settings.max_bounces or plan.runs(Stage.BACKGROUND)
            rays, path_of, throughput = self._scatter(
                radiance, hits, rays, path_of, throughput, bounce, more and plan.runs(Stage.ONWARD_RAYS), waves
            )
            if not len(path_of):
                break
        return radiance

    def _scatter(
        self,
        radiance: NDArray[np.float64],
        hits: NDArray[np.int32],
        rays: NDArray[np.float64],
        path_of: NDArray[np.int64],
        throughput: NDArray[np.float64] | None,
        bounce: int,
        onward: bool,
        waves: NDArray[np.int64] | None,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Add direct light and return the rays onwards, their paths and throughputs."""
        from plenoptic.scene import _shade

        assert self._intersector is not None
        scene = self._scene
        room = len(path_of) if onward else 0
        next_rays = np.empty((room, 6))
        next_path = np.empty(room, dtype=np.int64)
        next_throughput = np.empty((room, self._channels))
        shadows, onwards = _shade.fill_scattered(
            next_rays if onward else None,
            next_path,
            next_throughput,
            self._shadow_rays,
            self._shadow_path,
            self._shadow_radiance,
            hits,
            rays,
            path_of,
            throughput,
            self._keys,
            self._indices,
            bounce,
            scene.vertices,
            scene.triangles,
            scene.triangle_material,
            scene.normals,
            scene.uv,
            scene.albedo,
            scene.material_texture,
            scene.texels,
            scene.texture_shape,
            scene.emission,
            scene.two_sided,
            scene.light_triangles,
            scene.light_cdf,
            scene.light_area_pdf,
            self._intersector.middle,
            waves,
            self._basis,
        )
        if shadows:
            self._intersector.fill_blocked(self._blocked[:shadows], self._shadow_rays[:shadows])
            _shade.fill_direct(radiance, self._blocked, self._shadow_path[:shadows], self._shadow_radiance)
        return next_rays[:onwards], next_path[:onwards], next_throughput[:onwards]
