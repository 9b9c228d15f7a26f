"""The lens: a stack of surfaces and stops on one axis."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import draw, picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import MAX_POINTS, Floats, check_kind, choice, read_only, set_field, value, whole
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import AIR, Medium, refractive_indices
from plenoptic.optics.lens.elements import Element, check_stop, checked_elements, description, is_glass, profile_of
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.specification import Specification
from plenoptic.optics.stops.stop_registry import Stop
from plenoptic.optics.surfaces.mirror import medium_behind
from plenoptic.optics.surfaces.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from plenoptic.optics.lens.checks.finding import Findings
    from plenoptic.optics.lens.ghosts.ghost_table import GhostTable


@value
class LensStack:
    """A lens: surfaces and stops in the order of the light path from the scene.

    The lens has its own frame: z along the axis towards the sensor, z = 0 at the iris, lengths in mm.

    Parameters
    ----------
    elements : sequence of Surface and stops: CircularStop, PolygonStop, StarStop, MaskStop, RingStop
        From the scene (-z) to the sensor (+z); at least one surface and one stop. Each one's `thickness` is the gap
        to the next. Kept as a tuple; the gap behind the last one belongs to the camera and is set to 0.
    iris : int, optional
        Index in `elements` of the iris; the first stop by default.
    name, source : str, optional
        Name for messages and figures; source of the prescription: patent, book and page.
    front_medium, rear_medium : Medium, optional
        Medium of the scene, before the first surface, and that of the sensor, behind the last one; keyword only. AIR
        means that all indices are relative to air, as in glass catalogues. For a lens in vacuum, or in real air with
        absolute indices, see `Absolute`.
    model : LensModel, optional
        Model of ray tracing; keyword only. EXACT traces every surface.
    specification : Specification, optional
        Fields, wavelengths, object and image as stated in the lens file; keyword only.

    Raises
    ------
    PrescriptionError
        If there is no surface or no stop, `iris` is no stop, the length is not finite, the last medium is not
        `rear_medium`, or the media around LensModel.NONE differ.

    Examples
    --------
    >>> import plenoptic as pl
    >>> singlet = pl.LensStack([pl.CircularStop(semi_diameter=5.0, thickness=2.0),
    ...                         pl.Surface(51.68, thickness=4.0, medium=pl.ConstantMedium(1.5168), semi_diameter=12.0),
    ...                         pl.Surface(float("inf"), semi_diameter=12.0)], name="plano-convex")
    >>> singlet
    <LensStack 'plano-convex': 2 surfaces, 1 stop, 6 mm long>
    >>> singlet.vertices
    array([0., 2., 6.])
    """

    elements: Sequence[Element]
    iris: int | None = None
    name: str = ""
    source: str = ""
    front_medium: Medium = dataclasses.field(default=AIR, kw_only=True)
    rear_medium: Medium = dataclasses.field(default=AIR, kw_only=True)
    model: LensModel = dataclasses.field(default=LensModel.EXACT, kw_only=True)
    specification: Specification | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_field(self, "model", choice(self.model, LensModel, "model"))
        if self.specification is not None:
            check_kind(self.specification, "specification", Specification, "that of another lens, or leave it out")
        set_field(self, "elements", checked_elements(self.elements, self.front_medium, self.rear_medium))
        if self.model is LensModel.NONE and self.front_medium != self.rear_medium:
            raise PrescriptionError("the model is NONE, which refracts no light between two media: choose another one")
        stops = [i for i, element in enumerate(self.elements) if not isinstance(element, Surface)]
        iris = stops[0] if self.iris is None else whole(self.iris, "iris", at_least=0)
        if iris not in stops:
            raise PrescriptionError(f"iris is element {iris}, which is not a stop; the stops are elements {stops}")
        set_field(self, "iris", iris)

    @property
    def iris_index(self) -> int:
        """Index in `elements` of the iris."""
        assert self.iris is not None
        return self.iris

    @property
    def stop(self) -> Stop:
        """The iris."""
        element = self.elements[self.iris_index]
        assert not isinstance(element, Surface)
        return element

    @property
    def vertices(self) -> Floats:
        """Position z of each element in mm, (n,), never decreasing from surface to surface; exactly 0 at the iris."""
        gaps = [element.thickness for element in self.elements]
        iris = self.iris_index
        before = -np.cumsum([0.0, *gaps[:iris][::-1]])[::-1]
        after = np.cumsum([0.0, *gaps[iris:-1]])
        return read_only(np.concatenate([before[:-1], after]))

    @property
    def length(self) -> float:
        """Distance from the first to the last element in mm."""
        return float(self.vertices[-1] - self.vertices[0])

    @property
    def gap_media(self) -> tuple[Medium, ...]:
        """Medium before the first element and behind each element, n + 1 in all."""
        media: list[Medium] = [self.front_medium]
        for element in self.elements:
            media.append(medium_behind(element.medium, media[-1]) if isinstance(element, Surface) else media[-1])
        return tuple(media)

    def indices(self, wavelength: float = 587.6) -> Floats:
        """Refractive index before the first element and behind each element, (n + 1,), at a wavelength in nm.

        A stop has the index of its gap. InvalidValueError if a medium is not defined there; PrescriptionError if an
        index is below 1 or not finite.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.load_lens("singlet-100mm-f4").indices(587.6).round(4)
        array([1.    , 1.    , 1.5168, 1.    ])
        """
        return read_only(refractive_indices(self.gap_media, wavelength))

    def with_model(self, model: LensModel) -> LensStack:
        """The same lens with another model, which `trace` and cameras use.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.THIN)
        >>> out = lens.trace(pl.RayBundle([[0, 5, -400.0]], [[0, 0, 1.0]]))
        >>> bool(abs(out.at_z(pl.paraxial.cardinal_points(lens).rear_focus)[0, 1]) < 1e-12)
        True
        """
        return dataclasses.replace(self, model=model)

    def moved(
        self,
        which: int | slice | Sequence[int],
        *,
        shift: Sequence[float] = (0.0, 0.0, 0.0),
        tilt: Sequence[float] = (0.0, 0.0, 0.0),
        pivot: float | None = None,
    ) -> LensStack:
        """The same lens with one element, or several as one rigid group, decentred and tilted.

        Moves accumulate: each one acts on the result of the preceding ones. The paraxial description stays that of the
        centred lens. PrescriptionError if `which` selects no element, or elements on both sides of a mirror.

        Parameters
        ----------
        which : int, slice or sequence of int
            Indices in `elements`.
        shift : (3,) sequence of float, optional
            Along x, y and z in mm.
        tilt : (3,) sequence of float, optional
            About the axes through the pivot parallel to x, y and z, one after the other, radians. A positive tilt about
            x turns y towards z.
        pivot : float, optional
            z in the lens frame, mm, of the axial point about which the group is rotated; by default the vertex of its
            first element.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("singlet-100mm-f4")
        >>> lens.moved(slice(1, 3), shift=(0.2, 0, 0)).elements[1].placement.shift.tolist()
        [0.2, 0.0, 0.0]
        """
        from plenoptic.optics.lens.modify import move_elements  # imports this module

        return move_elements(self, which, shift, tilt, pivot)

    def scaled(self, factor: float | None = None, *, focal_length: float | None = None) -> LensStack:
        """The same lens in another size: every length times one factor.

        Radii, gaps, semi-diameters, aspheric and freeform coefficients, shifts and the specification scale; angles,
        f-numbers and glasses stay. So do `name` and `source`, which `dataclasses.replace` changes. InvalidValueError if
        neither or both of the arguments are given, or the lens has no such focal length.

        Parameters
        ----------
        factor : float, optional
            From 1e-6 to 1e6.
        focal_length : float, optional
            Effective focal length of the scaled lens at 587.6 nm in mm, in place of a factor.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2").scaled(focal_length=35.0)
        >>> round(pl.paraxial.cardinal_points(lens).efl, 12)
        35.0
        """
        from plenoptic.optics.lens.modify import scale_lens  # imports this module

        return scale_lens(self, factor, focal_length)

    def with_stop(self, stop: Stop) -> LensStack:
        """The same lens with another iris in the same place; the gap behind the iris stays.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.PolygonStop(blades=6, semi_diameter=5.0))
        >>> lens.stop
        PolygonStop(blades=6, semi_diameter=5.0, thickness=9.0)
        """
        check_stop(stop)
        elements = list(self.elements)
        placement = self.stop.placement if stop.placement is None else stop.placement
        elements[self.iris_index] = dataclasses.replace(stop, thickness=self.stop.thickness, placement=placement)
        specification = None if self.specification is None else self.specification.without_aperture()
        return dataclasses.replace(self, elements=elements, specification=specification)

    def inserted(self, stop: Stop, z: float) -> LensStack:
        """The same lens with one more stop at z, mm in the lens frame, in an air gap; the iris stays.

        It may lie outside the lens. Its thickness becomes the rest of the gap. PrescriptionError if z is in a glass.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2")
        >>> lens.inserted(pl.CircularStop(18.0), z=31.0).vertices[-2:]
        array([30.31, 31.  ])
        """
        from plenoptic.optics.lens.modify import insert_stop  # imports this module

        return insert_stop(self, check_stop(stop), z)

    def profiles(self, points: int = 41) -> tuple[Floats, ...]:
        """Cross section of each element in the plane x = 0, up to its rim: (points, 2) arrays of z, y in mm.

        An element that is tilted out of that plane is projected. A mirror is drawn in the space before it.
        """
        count = whole(points, "points", at_least=2, at_most=MAX_POINTS)
        return tuple(profile_of(*at, count) for at in zip(self.elements, self.vertices.tolist(), strict=True))

    @property
    def glasses(self) -> tuple[tuple[int, int], ...]:
        """Pairs of surfaces (indices in `elements`) with glass between them."""
        surfaces = [i for i, element in enumerate(self.elements) if isinstance(element, Surface)]
        return tuple((i, j) for i, j in pairwise(surfaces) if is_glass(self, i + 1))

    def __repr__(self) -> str:
        model = "" if self.model is LensModel.EXACT else f", as {self.model.name}"
        return f"<LensStack {self.name!r}: {description(self.elements, self.length)}{model}>"

    _repr_html_ = picture_of

    def check(self, wavelength: float = 587.6) -> Findings:
        """Check the lens at a wavelength in nm: a tuple of findings, empty where nothing is implausible.

        Checks include overlapping edges, vignetting, total reflection, and another aperture than the lens file states.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.load_lens("double-gauss-100mm-f2").check()
        no findings: nothing is implausible
        """
        from plenoptic.optics.lens.checks.check import findings  # imports this module

        return findings(self, wavelength)

    def transmission(self, field: float = 0.0, wavelength: float = 587.6) -> float:
        """Light of a field (rad along y) that passes; surfaces without coating are bare: `aberrations.transmission`."""
        from plenoptic.optics.lens.analysis.transmission import transmission  # imports this module

        return float(transmission(self, [field], wavelength=wavelength)[0])

    def ghosts(
        self,
        *,
        field: Sequence[float] = (0.0, 0.0),
        z_object: float = -math.inf,
        z_image: float | None = None,
        wavelength: float = 587.6,
        sensor: float | None = None,
        rays: int = 4096,
    ) -> GhostTable:
        """Ghosts: the light of each pair of surfaces that reflect it, on the image plane, beside the image light.

        Each surface reflects and transmits unpolarised light, bare unless it has a coating; rims and stops clip rays.
        Ground edges and the barrel reflect nothing. PrescriptionError if the lens has mirrors.

        Parameters
        ----------
        field, z_object, z_image, wavelength
            See `aberrations.spot_diagram`; one wavelength.
        sensor : float, optional
            Reflectance of a mirror in the plane z_image, as `sensor.silicon_reflectance`; None: it reflects nothing.
        rays : int, optional
            Rays that cover the first element: a fixed set, whose even spread gives the stated errors.

        Examples
        --------
        >>> import plenoptic as pl
        >>> ghosts = pl.load_lens("singlet-100mm-f4").ghosts(sensor=0.3)
        >>> ghosts.names, ghosts.energy.round(4).tolist(), ghosts.focus.round(1).tolist()
        (('sensor-2', 'sensor-1', '2-1'), [0.0126, 0.0116, 0.0018], [-193.4, -79.5, -85.6])
        """
        from plenoptic.optics.lens.ghosts.ghost_table import find_ghosts  # imports this module

        return find_ghosts(self, (field, z_object, z_image, wavelength), sensor=sensor, rays=rays)

    def layout(
        self,
        *,
        fields: ArrayLike | None = None,
        z_object: float | None = None,
        rays: int = 7,
        wavelength: float = 587.6,
        z_image: float | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw the lens with a fan of real rays for each field, true to scale.

        z to the right, y upwards, in mm; one colour a field. InvalidValueError if a field is out of range or the object
        is not before the lens.

        Parameters
        ----------
        fields : (n,) array, optional
            Along +y: half angles in radians, or heights in mm in the plane `z_object`; three if left out.
        z_object : float, optional
            mm; -inf for infinity. Default: -inf, or the front focus of a lens without a rear focus behind it.
        rays : int, optional
            Rays of each fan, uniform over the diameter of the iris along y. Clipped rays end at their rim.
        wavelength, z_image : float, optional
            nm; z at which rays end, mm, by default the paraxial image plane.
        ax : matplotlib.axes.Axes, optional

        Examples
        --------
        >>> import plenoptic as pl
        >>> ax = pl.load_lens("double-gauss-100mm-f2").layout(fields=[0.0, 0.2])
        >>> [text.get_text() for text in ax.get_legend().get_texts()]
        ['0°', '11.5°']
        """
        drawn: Axes = draw(
            self, ax, fields=fields, z_object=z_object, rays=rays, wavelength=wavelength, z_image=z_image
        )
        return drawn

    def trace(self, rays: RayBundle, *, threads: int | None = None) -> RayBundle:
        """Trace rays through the lens towards the sensor.

        Rays are in the lens frame, with origins anywhere along them, those of the result on the last element. Weights
        lose light in coated lenses, see `transmission`. A lost ray has weight 0, a status, the index of its element,
        and NaN for origin and direction. `threads`: None is one for each processor, at most NUMBA_NUM_THREADS.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2")
        >>> out = lens.trace(pl.RayBundle([[0, 0, -404.0], [0, 30, -404]], [[0, 0, 1.0], [0, 0, 1]]))
        >>> [pl.RayStatus(s).name for s in out.status], out.lost_at.tolist()
        (['OK', 'CLIPPED'], [-1, 0])
        """
        from plenoptic.optics.lens.trace import trace_rays  # imports this module

        return trace_rays(self, rays, reverse=False, threads=threads)

    def trace_reverse(self, rays: RayBundle, *, threads: int | None = None) -> RayBundle:
        """Trace rays through the lens towards the scene; otherwise as `trace`.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2")
        >>> lens.trace_reverse(pl.RayBundle([[0, 0, 123.3]], [[0, 0, -1.0]])).at_z(-404.0)
        array([[   0.,    0., -404.]])
        """
        from plenoptic.optics.lens.trace import trace_rays  # imports this module

        return trace_rays(self, rays, reverse=True, threads=threads)
