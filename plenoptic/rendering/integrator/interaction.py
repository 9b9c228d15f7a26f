"""The surfaces that the rays of a bundle meet, and the lights that are drawn for them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.compile import SceneTables
from plenoptic.scene.geometry.accel import Intersector
from plenoptic.scene.materials.alpha_mask import NESTED, geometry

_SURFACE, _DRAWN, _DIMENSIONS = 16, 7, 4
"""Numbers that kernels know of a surface and of a light that was drawn, and of a Sobol point: `interaction.WIDTH`,
`sample_emitters.WIDTH`, `sobol.DIMENSIONS`."""


class PathRays:
    """Room for rays and what belongs to them; None for what a scene does not need."""

    def __init__(self, most: int, channels: int, scene: SceneTables, *, onward: bool, telling: bool) -> None:
        self.rays = np.empty((most, 6))
        self.path_of = np.empty(most, dtype=np.int64)
        weighed = onward or scene.absorption is not None
        self.throughput = np.empty((most, channels)) if weighed else None
        self.density = np.empty(most) if onward else None
        self.media = None if scene.absorption is None else np.empty((most, NESTED), dtype=np.int32)
        self.rough = np.empty(most, dtype=np.uint8) if telling else None


class MetSurfaces:
    """Rows for surfaces that scatter, and lights drawn for them.

    `basis` is None where paths have the scene's channels.
    """

    def __init__(
        self,
        scene: SceneTables,
        intersector: Intersector,
        basis: NDArray[np.float64] | None,
        most: int,
        channels: int,
        *,
        lights: bool,
    ) -> None:
        self._scene, self._intersector, self._basis = scene, intersector, basis
        self.rows = np.empty((most, _SURFACE))
        self.base = np.empty((most, channels))
        self.keys, self.indices = np.empty(most, dtype=np.uint64), np.empty(most, dtype=np.uint32)
        self.random = np.empty((_DIMENSIONS, most))
        self._lanes, self._materials = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
        self.lane_of, self.material_of = self._lanes[:0], self._materials[:0]
        room = most if lights else 0
        self.drawn, self.lit = np.empty((room, _DRAWN)), np.empty((room, channels))

    def describe(
        self,
        now: PathRays,
        hits: NDArray[np.int32],
        placed: NDArray[np.int32] | None,
        path_key: NDArray[np.uint64],
        path_index: NDArray[np.uint32],
        bounce: int,
        waves: NDArray[np.int64] | None,
    ) -> None:
        """Find out what the surfaces are like that rays meet."""
        from plenoptic.core.kernels import sobol
        from plenoptic.scene.geometry.kernels import interaction
        from plenoptic.scene.textures.kernels import colors

        scene, matrices = self._scene, self._intersector.placements
        met = interaction.fill_surfaces(
            self.rows,
            self._lanes,
            self._materials,
            hits,
            placed,
            now.rays,
            scene.vertices,
            scene.triangles,
            scene.triangle_material,
            scene.scatters,
            scene.normals,
            scene.uv,
            matrices,
            self._intersector.middle,
            scene.roughness,
            scene.metallic,
        )
        self.lane_of, self.material_of = lanes, materials = self._lanes[:met], self._materials[:met]
        sobol.fill_drawn(self.random, self.keys, self.indices, lanes, now.path_of, path_key, path_index, bounce + 1)
        colors.fill_base(self.base, lanes, materials, now.path_of, scene.albedo, waves, self._basis)
        textures = (scene.base_texture, scene.roughness_texture, scene.metallic_texture)
        if any(column is not None for column in textures):
            colors.fill_textured(
                self.base,
                self.rows,
                lanes,
                materials,
                now.path_of,
                scene.channels,
                *textures,
                scene.texels,
                scene.texture_rows,
                waves,
                self._basis,
            )
        if scene.normal_texture is not None:
            colors.fill_bent(
                self.rows,
                lanes,
                materials,
                hits,
                placed,
                now.rays,
                scene.vertices,
                scene.triangles,
                scene.uv,
                matrices,
                scene.normal_texture,
                scene.texels,
                scene.texture_rows,
            )

    def draw_lights(self, now: PathRays, waves: NDArray[np.int64] | None) -> None:
        """Draw a light for each surface."""
        from plenoptic.scene.lights.kernels import sample_emitters

        scene, lights, sky = self._scene, self._scene.lights, self._scene.environment
        sample_emitters.fill_drawn_lights(
            self.drawn,
            self.lit,
            self.rows,
            self.lane_of,
            self.material_of,
            scene.takes_light,
            now.path_of,
            self.random,
            *geometry(scene, self._intersector),
            scene.channels,
            scene.emission,
            scene.two_sided,
            scene.emission_texture,
            scene.opacity,
            scene.cutoff,
            scene.opacity_texture,
            scene.texels,
            scene.texture_rows,
            lights.cdf,
            lights.row,
            lights.kind,
            lights.place,
            lights.material_density,
            lights.points,
            lights.point_colours,
            lights.suns,
            lights.sun_colours,
            None if sky is None else sky.texels,
            None if sky is None else sky.rows_cdf,
            None if sky is None else sky.columns_cdf,
            None if sky is None else sky.density,
            None if sky is None else sky.rotation,
            lights.environment_share,
            lights.far,
            waves,
            self._basis,
        )
        if scene.absorption is not None:
            from plenoptic.scene.materials.kernels import absorption

            absorption.fill_dimmed_lights(
                self.lit,
                now.media,
                self.drawn,
                self.rows,
                self.lane_of,
                self.material_of,
                now.path_of,
                scene.absorption,
                waves,
                self._basis,
            )
