"""Iteration of solving and tracing until a camera's design meets its targets."""

from __future__ import annotations

import dataclasses
import math

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.design.equations import FIELDS, DesignTargets, MainLensState, Numbers, solve
from plenoptic.camera.gaussian import image_plane, paraxial_cone, sharp_image
from plenoptic.camera.report.illumination import traced_slope, with_semi_diameter
from plenoptic.core.values import value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import best_focus
from plenoptic.optics.lens.models import FocusCriterion, LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.sensor.sensor import Sensor

_ROUNDS = 40
"""Most iterations; each reduces the errors ten to a thousand times, unless the rims of the lens vignette."""


@value
class DesignStep:
    """Iteration of a design: its numbers, and the deviation of traced rays from the targets. See `design_camera`.

    Attributes
    ----------
    semi_diameter, stop_to_microlenses, microlenses_to_sensor, pitch, focal_length : float
        mm.
    focus_error : float
        Position of the traced image of the plane in focus, behind its target, in mm; 0 without a target z.
    fill_error : float
        Traced diameter of the microlens images over their distance, less the target; 0 without that target.
    depth_error : float
        Displacement of the traced image of the plane `depth_at` since the last iteration, in mm.
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
    """Camera that meets design targets, and the iterations towards it. See `design_camera`, which makes it.

    Attributes
    ----------
    camera : PlenopticCamera
    solved_for : tuple of str
        Names of the numbers that were solved for.
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
    """Constant parameters of the iteration for a design."""

    lens: LensStack
    sensor: Sensor
    targets: DesignTargets
    fixed: Numbers
    template: MicrolensArray
    criterion: FocusCriterion
    wavelength: float

    def run(self, tolerance: float) -> CameraDesign:
        """Solve and trace until the targets are met."""
        history: list[DesignStep] = []
        lens_state = self._gaussian()
        for _ in range(_ROUNDS):
            numbers = solve(self.targets, self.fixed, lens_state)
            camera = self._camera(numbers)
            try:
                traced = self._trace(camera)
            except InvalidValueError:
                if "h" in self.fixed:
                    raise
                # No light of the axis passes an iris larger than all rims.
                raise InvalidValueError(self._vignetting_message(numbers["h"], history)) from None
            history.append(self._step(numbers, camera, lens_state, traced))
            if self._is_converged(history[-1], tolerance):
                return CameraDesign(camera, tuple(FIELDS[u] for u in FIELDS if u not in self.fixed), tuple(history))
            if not math.isfinite(traced.slope):
                break
            lens_state = traced
        raise InvalidValueError(self._failure_message(history))

    def _gaussian(self) -> MainLensState:
        """Main lens by Gaussian optics, with the cone of light at the position of the array that follows from it."""
        targets, lens, end = self.targets, self.lens, float(self.lens.vertices[-1])
        image = 0.0 if targets.z is None else image_plane(lens, targets.z, self.wavelength)
        shift = 0.0 if targets.depth_at is None else image_plane(lens, targets.depth_at, self.wavelength) - image
        if not (math.isfinite(image) and math.isfinite(shift)):
            raise InvalidValueError(
                f"the plane z = {targets.z:g} mm, or depth_at, has its image at infinity; choose another, or a lens "
                "with a focal length"
            )
        position = max(self.fixed.get("L", image), end + 1e-3 * (abs(image) + abs(end) + lens.stop.semi_diameter))
        for _ in range(_ROUNDS):
            cone = paraxial_cone(lens, position, self.wavelength)
            lens_state = MainLensState(image, shift, cone.slope / lens.stop.semi_diameter, cone.vergence)
            new_position = solve(targets, self.fixed, lens_state)["L"]
            if not new_position > end:
                raise InvalidValueError(
                    f"stop_to_microlenses would be {new_position:.4g} mm, and the last lens vertex is at "
                    f"z = {end:.4g}; "
                    "choose a plane nearer to the lens, or a smaller virtual depth"
                )
            if new_position == position:
                break
            position = new_position
        return lens_state

    def _camera(self, n: Numbers) -> PlenopticCamera:
        array = self.template
        if "p" not in self.fixed or "f" not in self.fixed:
            array = dataclasses.replace(array, pitch=n["p"], focal_lengths=(n["f"],))
        return PlenopticCamera(
            lens=self.lens if n["h"] == self.lens.stop.semi_diameter else with_semi_diameter(self.lens, n["h"]),
            sensor=self.sensor,
            stop_to_microlenses=n["L"],
            microlenses=array,
            microlenses_to_sensor=n["b"],
            wavelength=self.wavelength,
        )

    def _trace(self, camera: PlenopticCamera) -> MainLensState:
        targets, z = self.targets, camera.stop_to_microlenses
        image = 0.0 if targets.z is None else self._image(camera.lens, targets.z)
        shift = 0.0 if targets.depth_at is None else self._image(camera.lens, targets.depth_at) - image
        slope = traced_slope(camera.lens, z, self.wavelength) / camera.lens.stop.semi_diameter
        return MainLensState(image, shift, slope, paraxial_cone(camera.lens, z, self.wavelength).vergence)

    def _image(self, lens: LensStack, z: float) -> float:
        if lens.model is LensModel.NONE:
            return z
        return best_focus(lens, z_object=z, wavelength=self.wavelength, criterion=self.criterion)

    def _step(self, n: Numbers, camera: PlenopticCamera, before: MainLensState, traced: MainLensState) -> DesignStep:
        fill = focus = 0.0
        if self.targets.image_fill is not None:
            diameter = 2.0 * n["b"] * traced.slope * n["h"]
            fill = diameter / (n["p"] * abs(1.0 + n["b"] * traced.vergence)) - self.targets.image_fill
        if self.targets.z is not None:
            focus = traced.image - n["L"] - sharp_image(camera, n["f"])
        return DesignStep(n["h"], n["L"], n["b"], n["p"], n["f"], focus, fill, traced.shift - before.shift)

    def _is_converged(self, step: DesignStep, tolerance: float) -> bool:
        position_tolerance = tolerance * abs(step.stop_to_microlenses)
        focused = abs(step.focus_error) <= position_tolerance and abs(step.depth_error) <= position_tolerance
        return focused and abs(step.fill_error) <= tolerance

    def _failure_message(self, history: list[DesignStep]) -> str:
        last = history[-1]
        if not math.isfinite(last.fill_error) or last.fill_error < -1e-6:
            return self._vignetting_message(last.semi_diameter, history)
        return (
            f"after {len(history)} rounds the focus is still off by {last.focus_error:.2g} mm and the image fill by "
            f"{last.fill_error:.2g}; give a larger tolerance, or more numbers"
        )

    def _vignetting_message(self, semi_diameter: float, history: list[DesignStep]) -> str:
        target = self.targets.image_fill or 0.0
        fills = (step.fill_error + target for step in history if math.isfinite(step.fill_error))
        largest_fill = max(fills, default=0.0)
        reached = f" to {largest_fill:.3f}" if largest_fill > 0 else ""
        return (
            f"image_fill {target:g} cannot be had: it would take an iris of semi-diameter {semi_diameter:.4g} mm or "
            f"more, but rims and other stops of the lens limit image_fill{reached}; ask for less, for a larger "
            "microlenses_to_sensor or for a smaller pitch"
        )
