"""Rounds of solving and tracing until a camera's design meets its requirements."""

from __future__ import annotations

import dataclasses
import math

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.design.equations import Lens, solved
from plenoptic.camera.design.wishes import FIELDS, Numbers, Wishes
from plenoptic.camera.report.focus import sharp_image
from plenoptic.camera.report.optics import image_plane, paraxial_cone, traced_slope, with_semi_diameter
from plenoptic.core.values import value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import best_focus
from plenoptic.optics.lens.models import FocusCriterion, LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.sensor.sensor import Sensor

_ROUNDS = 40
"""Each round makes the errors some ten to a thousand times smaller, unless the rims of the lens are in the way."""


@value
class DesignStep:
    """One round of a design: its values, and the deviations of traced rays from the wishes. See `design_camera`.

    Attributes
    ----------
    semi_diameter, stop_to_microlenses, microlenses_to_sensor, pitch, focal_length : float
        mm.
    focus_error : float
        Where the traced image of the plane in focus is, behind where it should be, in mm; 0 without a wish for z.
    fill_error : float
        Traced diameter of the microlens images over their distance, less the wish; 0 without that wish.
    depth_error : float
        How far the traced image of the plane `depth_at` has moved since the last round, in mm.
    """

    semi_diameter: float
    stop_to_microlenses: float
    microlenses_to_sensor: float
    pitch: float
    focal_length: float
    focus_error: float
    fill_error: float
    depth_error: float


@value
class CameraDesign:
    """A camera that meets wishes, and how it was found. See `design_camera`, which makes it.

    Attributes
    ----------
    camera : PlenopticCamera
    solved_for : tuple of str
        Names of the numbers that were not given.
    history : tuple of DesignStep
        The first is the paraxial solution, the last the camera.
    """

    camera: PlenopticCamera
    solved_for: tuple[str, ...]
    history: tuple[DesignStep, ...]

    def __repr__(self) -> str:
        last = self.history[-1]
        lines = [f"CameraDesign: {len(self.history)} rounds, solved for {', '.join(self.solved_for) or 'nothing'}"]
        lines += [f"  {name:<22} {getattr(last, name):>12.7g} mm" for name in FIELDS.values()]
        lines.append(f"  {'focus error':<22} {last.focus_error:>12.1e} mm")
        lines.append(f"  {'image fill error':<22} {last.fill_error:>12.1e}")
        return "\n".join(lines)


@dataclasses.dataclass(frozen=True)
class Search:
    """Quantities that stay the same while a design is searched for."""

    lens: LensStack
    sensor: Sensor
    wishes: Wishes
    given: Numbers
    template: MicrolensArray
    criterion: FocusCriterion
    wavelength: float

    def found(self, tolerance: float) -> CameraDesign:
        """Rounds of solving and tracing until the wishes are met."""
        history: list[DesignStep] = []
        optics = self._gaussian()
        for _ in range(_ROUNDS):
            numbers = solved(self.wishes, self.given, optics)
            camera = self._camera(numbers)
            try:
                traced = self._trace_lens(camera)
            except InvalidValueError:
                if "h" in self.given:
                    raise
                # No light of the axis passes an iris that is beyond all rims.
                raise InvalidValueError(self._too_much_light(numbers["h"], history)) from None
            history.append(self._step(numbers, camera, optics, traced))
            if self._meets(history[-1], tolerance):
                return CameraDesign(camera, tuple(FIELDS[u] for u in FIELDS if u not in self.given), tuple(history))
            if not math.isfinite(traced.slope):
                break
            optics = traced
        raise InvalidValueError(self._not_met(history))

    def _gaussian(self) -> Lens:
        """Gaussian properties of the lens, with the cone of light at the array that follows from them."""
        wishes, lens, end = self.wishes, self.lens, float(self.lens.vertices[-1])
        image = 0.0 if wishes.z is None else image_plane(lens, wishes.z, self.wavelength)
        shift = 0.0 if wishes.depth_at is None else image_plane(lens, wishes.depth_at, self.wavelength) - image
        if not (math.isfinite(image) and math.isfinite(shift)):
            raise InvalidValueError(
                f"the plane z = {wishes.z:g} mm, or depth_at, has its image at infinity; choose another, or a lens "
                "with a focal length"
            )
        place = max(self.given.get("L", image), end + 1e-3 * (abs(image) + abs(end) + lens.stop.semi_diameter))
        for _ in range(_ROUNDS):
            cone = paraxial_cone(lens, place, self.wavelength)
            gaussian = Lens(image, shift, cone.slope / lens.stop.semi_diameter, cone.vergence)
            distance = solved(wishes, self.given, gaussian)["L"]
            if not distance > end:
                raise InvalidValueError(
                    f"stop_to_microlenses would be {distance:.4g} mm, and the last lens vertex is at z = {end:.4g}; "
                    "choose a plane nearer to the lens, or a smaller virtual depth"
                )
            if distance == place:
                break
            place = distance
        return gaussian

    def _camera(self, n: Numbers) -> PlenopticCamera:
        array = self.template
        if "p" not in self.given or "f" not in self.given:
            array = dataclasses.replace(array, pitch=n["p"], focal_lengths=(n["f"],))
        return PlenopticCamera(
            lens=self.lens if n["h"] == self.lens.stop.semi_diameter else with_semi_diameter(self.lens, n["h"]),
            sensor=self.sensor,
            stop_to_microlenses=n["L"],
            microlenses=array,
            microlenses_to_sensor=n["b"],
            wavelength=self.wavelength,
        )

    def _trace_lens(self, camera: PlenopticCamera) -> Lens:
        wishes, z = self.wishes, camera.stop_to_microlenses
        image = 0.0 if wishes.z is None else self._image(camera.lens, wishes.z)
        shift = 0.0 if wishes.depth_at is None else self._image(camera.lens, wishes.depth_at) - image
        slope = traced_slope(camera.lens, z, self.wavelength) / camera.lens.stop.semi_diameter
        return Lens(image, shift, slope, paraxial_cone(camera.lens, z, self.wavelength).vergence)

    def _image(self, lens: LensStack, z: float) -> float:
        if lens.model is LensModel.NONE:
            return z
        return best_focus(lens, z_object=z, wavelength=self.wavelength, criterion=self.criterion)

    def _step(self, n: Numbers, camera: PlenopticCamera, before: Lens, traced: Lens) -> DesignStep:
        fill = focus = 0.0
        if self.wishes.image_fill is not None:
            diameter = 2.0 * n["b"] * traced.slope * n["h"]
            fill = diameter / (n["p"] * abs(1.0 + n["b"] * traced.vergence)) - self.wishes.image_fill
        if self.wishes.z is not None:
            focus = traced.image - n["L"] - sharp_image(camera, n["f"])
        return DesignStep(n["h"], n["L"], n["b"], n["p"], n["f"], focus, fill, traced.shift - before.shift)

    def _meets(self, step: DesignStep, tolerance: float) -> bool:
        near = tolerance * abs(step.stop_to_microlenses)
        focused = abs(step.focus_error) <= near and abs(step.depth_error) <= near
        return focused and abs(step.fill_error) <= tolerance

    def _not_met(self, history: list[DesignStep]) -> str:
        last = history[-1]
        if not math.isfinite(last.fill_error) or last.fill_error < -1e-6:
            return self._too_much_light(last.semi_diameter, history)
        return (
            f"after {len(history)} rounds the focus is still off by {last.focus_error:.2g} mm and the image fill by "
            f"{last.fill_error:.2g}; give a larger tolerance, or more numbers"
        )

    def _too_much_light(self, semi_diameter: float, history: list[DesignStep]) -> str:
        fill = self.wishes.image_fill or 0.0
        reached = max((step.fill_error + fill for step in history if math.isfinite(step.fill_error)), default=0.0)
        so_far = f" and let {reached:.3f} be filled" if reached > 0 else ""
        return (
            f"image_fill {fill:g} cannot be had: it would take an iris of semi-diameter {semi_diameter:.4g} mm or "
            f"more, but rims and other stops of the lens end the light before{so_far}; wish for less, or for a larger "
            "microlenses_to_sensor or a smaller pitch"
        )
