"""Transparent materials: bodies, and panes without thickness."""

from __future__ import annotations

from plenoptic.core.values import checked_field, value
from plenoptic.errors import SceneError
from plenoptic.scene.materials.material_records import SMOOTH, MaterialRow
from plenoptic.scene.materials.medium import Medium, as_medium
from plenoptic.scene.textures.color import Colour, as_colour, as_fraction, as_index


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
    medium : Medium, optional
        Medium of the body where it also scatters; `absorption` is the short form of one that does not.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        An index that is not above 0, a negative absorption, an alpha outside [0, 1], an absorption beside a medium.

    Notes
    -----
    Light that is drawn directly does not find its way through refracting surfaces: light on a surface behind glass
    is found by paths that happen to hit the light. Point lights and suns without extent are never hit.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Dielectric(1.33, absorption=(0.02, 0.004, 0.001))
    Dielectric(index=1.33, absorption=(0.02, 0.004, 0.001))
    """

    index: float = checked_field(as_index, default=1.5)
    alpha: float = checked_field(as_fraction, default=0.0)
    absorption: Colour = checked_field(as_colour, default=0.0)
    exterior: float = checked_field(as_index, default=1.0)
    medium: Medium | None = checked_field(as_medium, default=None)

    def __post_init__(self) -> None:
        if self.medium is not None and self.absorption != 0.0:
            raise SceneError("the body has an absorption and a medium; give the absorption to the medium alone")

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        medium = Medium(self.absorption) if self.medium is None else self.medium
        return MaterialRow(
            1.0,
            roughness=self.alpha,
            absorption=medium.absorption,
            scattering=medium.scattering,
            asymmetry=medium.phase.g,
            glass_index=(self.index, self.exterior),
            fresnel=True,
            specular=self.alpha < SMOOTH,
        )


@value
class ThinGlass:
    """A pane without thickness: it reflects, and lets the rest pass straight on.

    All reflections inside the pane count: with Fresnel's reflectance R of one surface it reflects 2 R / (1 + R).

    Parameters
    ----------
    index : float
        Refractive index of the pane, above 0.
    transmittance : float or (float, float, float)
        In [0, 1]: transmitted share of the light that is not reflected.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        An index that is not above 0, a transmittance outside [0, 1].

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.materials.ThinGlass(transmittance=(0.9, 1.0, 0.9))
    ThinGlass(transmittance=(0.9, 1.0, 0.9))
    """

    index: float = checked_field(as_index, default=1.5)
    transmittance: Colour = checked_field(as_colour, default=1.0, at_most=1.0)

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        return MaterialRow(self.transmittance, roughness=0.0, pane_index=self.index, fresnel=True, specular=True)
