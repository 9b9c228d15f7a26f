"""Bodies that light passes."""

from __future__ import annotations

from plenoptic.core.values import finite, set_field, value
from plenoptic.errors import SceneError
from plenoptic.scene.materials.conductor import as_alpha
from plenoptic.scene.materials.row import SMOOTH, MaterialRow
from plenoptic.scene.textures.color import Colour, as_colour


@value
class Dielectric:
    """The surface of a transparent body, such as glass or water.

    Fresnel's equations for unpolarised light share it out between reflection and refraction. The body lies behind the
    fronts of its triangles: the mesh must be closed and wind outwards. Radiance scales with the square of the index
    where it enters a medium, and back where it leaves.

    Parameters
    ----------
    index : float
        Refractive index behind the front, above 0, the same at all wavelengths.
    alpha : float
        Roughness of the surface, as in `Conductor`; 0 is polished.
    absorption : float or (float, float, float)
        Per mm, 0 or more: of radiance, exp(-absorption t) is left after t mm in the body (Beer-Lambert).
    exterior : float
        Refractive index before the front: 1 in air; for a surface between glass and water, that of the other one.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        An index that is not above 0, a negative absorption, an alpha outside [0, 1].

    Notes
    -----
    Light that is drawn directly does not find its way through refracting surfaces: what reaches a surface through glass
    is found by paths that happen to meet the light. Point lights and suns without extent are never met like that.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Dielectric(1.33, absorption=(0.02, 0.004, 0.001))
    Dielectric(index=1.33, absorption=(0.02, 0.004, 0.001))
    """

    index: float = 1.5
    alpha: float = 0.0
    absorption: Colour = 0.0
    exterior: float = 1.0

    def __post_init__(self) -> None:
        for name in ("index", "exterior"):
            number = finite(getattr(self, name), name)
            if not number > 0:
                raise SceneError(f"{name} is {number:g}; it must be above 0")
            set_field(self, name, number)
        set_field(self, "alpha", as_alpha(self.alpha))
        set_field(self, "absorption", as_colour(self.absorption, "absorption"))

    def row(self) -> MaterialRow:
        """Its numbers; what it lacks keeps its default."""
        return MaterialRow(
            1.0,
            roughness=self.alpha,
            absorption=self.absorption,
            glass_index=(self.index, self.exterior),
            fresnel=True,
            specular=self.alpha < SMOOTH,
        )
