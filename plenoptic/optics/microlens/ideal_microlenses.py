"""Ideal microlenses in one plane: pinholes and thin lenses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.trace import RayArrays, in_chunks
from plenoptic.optics.microlens.aperture import has_clear_gaps
from plenoptic.optics.microlens.model_records import ArrayCrossing, Depths, LensletRows, Pair, TracedPaths, Waves

if TYPE_CHECKING:
    from plenoptic.core.rays import RayBundle
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.optics.microlens.microlens_record import ArrayRecord, SensorPlane


class IdealMicrolenses(NamedTuple):
    """Refraction by ideal microlenses. Every microlens model has these members."""

    focuses: bool
    """True for thin lenses; pinholes have no power, and no ray from a point meets them."""
    is_plate: bool = False
    """True if rays pass two surfaces of glass, where openings limit them: they deviate from those of ideal lenses."""
    is_flat: bool = False
    """True if a plane with the normals of a sphere stands for the sphere."""

    @property
    def is_thin(self) -> bool:
        """True if a power describes the refraction, so that dispersion is a factor of it."""
        return self.focuses

    def check(self, array: MicrolensArray) -> None:
        """Raise an error for an array that cannot be built."""
        if not self.focuses and has_clear_gaps(array.aperture):
            raise InvalidValueError("light passes a PINHOLE only at its centre; give gaps=Gaps.OPAQUE")

    def record(self, array: MicrolensArray, wavelengths: tuple[float, ...]) -> None:
        """Record for the model's kernels, at the camera's wavelength and those sampled by paths."""

    def depths(self, array: MicrolensArray) -> Depths:
        """Distances of the principal planes from the vertices."""
        return Depths()

    def shift_chief_rays(
        self, array: MicrolensArray, points: Floats, slopes: Floats, wavelength: float, rear: bool
    ) -> Floats:
        """Points at which chief rays, through the optical centre of lenses, cross a principal plane as they run outside
        the lens: from points (n, 2) of that plane, the rear one for True, slopes (n, 2), and a wavelength in nm.
        """
        return points

    def exit_points(self, array: MicrolensArray, power: float, aimed: Pair, slopes: Pair, leaving: Pair) -> Pair:
        """Points on the rear surface of a lens of a power at which rays exit, traced in reverse from points of the rear
        principal plane with slopes per length of z; `leaving` are those at which they leave the lens.
        """
        return aimed

    def to_lens(self, blocks: Floats, lenslets: LensletRows, crossing: ArrayCrossing, waves: Waves) -> None:
        """Turn aimed samples into rays towards the main lens (see `kernels.to_lens`)."""
        from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_pinholes, fill_thin
        from plenoptic.optics.microlens.kernels.to_lens import fill_openings

        array, sensor, z_plane = crossing
        if lenslets is not None:
            fill_openings(blocks, lenslets, array.opening)
        if not self.focuses:
            fill_pinholes(blocks, sensor, z_plane)
            return
        factors = array.power_factors
        fill_thin(blocks, lenslets, sensor, array.power, z_plane, factors, None if factors is None else waves)

    def to_sensor(self, blocks: Floats, crossing: ArrayCrossing, differs: bool) -> None:
        """Trace rays behind the main lens to the sensor (see `kernels.to_sensor`), through lenses that may differ."""
        from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin_forward

        array, sensor, z_plane = crossing
        fill_thin_forward(blocks, z_plane, sensor, array, array if differs else None)

    def mirror_image(self, model: tuple[Any, ...] | None) -> tuple[Any, ...] | None:
        """Record of the mirror image of the model in a plane perpendicular to the axis."""
        return model

    def faces(self, array: MicrolensArray) -> tuple[SensorPlane | None, ...]:
        """Faces that reflect, but for a plane in front: planes behind the rear principal one; None: curved sides."""
        return ()

    def is_flat_in_front(self, array: MicrolensArray) -> bool:
        """True if a plane through the first vertex stands for the face towards the lens."""
        return True

    def trace_rays(
        self, rays: RayBundle, traced: TracedPaths, array: ArrayRecord, differs: bool, index: float
    ) -> RayBundle:
        """Trace rays, at the wavelength of a refractive index, through an array of lenses that may differ, in its axes
        with the first vertex at z = 0; fills `traced`.
        """
        from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin_lenses

        def fill(out: RayArrays, rays_in: RayArrays, first: int, end: int) -> None:
            fill_thin_lenses(out, traced, rays_in, array, array if differs else None, first, end)

        return in_chunks(fill, rays)
