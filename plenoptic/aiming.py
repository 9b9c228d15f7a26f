"""Ray aiming: rays from one object point through given points of the real iris."""

from plenoptic.optics.lens.pupil.iris_points import fan, hexapolar, square_grid
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays, aimed_rays_reverse, chief_ray, entrance_pupil_of

__all__ = ["aimed_rays", "aimed_rays_reverse", "chief_ray", "entrance_pupil_of", "fan", "hexapolar", "square_grid"]
