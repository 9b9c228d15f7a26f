"""The surfaces that the rays of a bundle meet, and the lights that are drawn for them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.materials.alpha_mask import NESTED

_SURFACE, _DRAWN, _DIMENSIONS = 15, 7, 4
"""Numbers that kernels know of a surface and of a light that was drawn, and of a Sobol point: `interaction.WIDTH`,
`sample_emitters.WIDTH`, `sobol.DIMENSIONS`."""


class PathRays:
    """Room for rays and what belongs to them; None for what a scene does not need."""

    def __init__(self, most: int, channels: int, scene: SceneRecord, *, onward: bool, telling: bool) -> None:
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
        scene: SceneRecord,
        basis: NDArray[np.float64] | None,
        most: int,
        channels: int,
        *,
        lights: bool,
    ) -> None:
        self._scene, self._basis = scene, basis
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

        scene, geometry, bsdf = self._scene, self._scene.geometry, self._scene.bsdf
        assert geometry is not None and bsdf is not None
        met = interaction.fill_surfaces(
            self.rows,
            self._lanes,
            self._materials,
            hits,
            placed,
            now.rays,
            geometry.vertices,
            geometry.triangles,
            geometry.triangle_material,
            bsdf.scatters,
            geometry.normals,
            geometry.uv,
            geometry.instance_to_world,
            geometry.middle,
            bsdf.roughness,
            bsdf.metallic,
        )
        self.lane_of, self.material_of = lanes, materials = self._lanes[:met], self._materials[:met]
        sobol.fill_drawn(self.random, self.keys, self.indices, lanes, now.path_of, path_key, path_index, bounce + 1)
        colors.fill_base(self.base, lanes, materials, now.path_of, bsdf.base_color, waves, self._basis)
        textures = scene.textures
        if textures is None:
            return
        columns = (textures.base_color, textures.roughness, textures.metallic)
        given = [column for column in columns if column is not None]
        if given:
            colors.fill_textured(
                self.base,
                self.rows,
                lanes,
                materials,
                now.path_of,
                scene.channels,
                *(None if column is None else column.row for column in columns),
                given[0].texels,
                given[0].textures,
                waves,
                self._basis,
            )
        if textures.normal is not None:
            colors.fill_bent(
                self.rows,
                lanes,
                materials,
                hits,
                placed,
                now.rays,
                geometry.vertices,
                geometry.triangles,
                geometry.uv,
                geometry.instance_to_world,
                textures.normal.row,
                textures.normal.texels,
                textures.normal.textures,
            )

    def draw_lights(self, now: PathRays, waves: NDArray[np.int64] | None) -> None:
        """Draw a light for each surface."""
        from plenoptic.scene.lights.kernels import sample_emitters

        scene, geometry, bsdf, emission, alpha = (
            self._scene,
            self._scene.geometry,
            self._scene.bsdf,
            self._scene.emission,
            self._scene.alpha,
        )
        assert geometry is not None and bsdf is not None
        lights, sky = scene.lights, scene.lights.sky
        environment = sky.environment
        glow = None if emission is None else emission.texture
        holes = None if alpha is None else alpha.texture
        either = holes if glow is None else glow
        sample_emitters.fill_drawn_lights(
            self.drawn,
            self.lit,
            self.rows,
            self.lane_of,
            self.material_of,
            bsdf.takes_light,
            now.path_of,
            self.random,
            geometry.vertices,
            geometry.triangles,
            geometry.triangle_material,
            geometry.uv,
            geometry.instance_to_world,
            geometry.middle,
            scene.channels,
            None if emission is None else emission.radiance,
            None if emission is None else emission.two_sided,
            None if glow is None else glow.row,
            None if alpha is None else alpha.opacity,
            None if alpha is None else alpha.cutoff,
            None if holes is None else holes.row,
            None if either is None else either.texels,
            None if either is None else either.textures,
            lights.cdf,
            lights.items,
            None if emission is None else emission.pdf,
            lights.points,
            lights.point_colors,
            sky.suns,
            sky.sun_colors,
            None if environment is None else environment.texels,
            None if environment is None else environment.rows_cdf,
            None if environment is None else environment.columns_cdf,
            None if environment is None else environment.pdf,
            None if environment is None else environment.rotation,
            0.0 if environment is None else environment.probability,
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
