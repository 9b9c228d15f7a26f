"""Design of a camera: iris, distances, pitch and focal length from focus, image fill, depth and disparity.

Equations are solved and rays are traced in turn until the camera meets its targets.
"""

from __future__ import annotations

import dataclasses
import math

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import warn_if_implausible
from plenoptic.camera.design.equations import (
    FIELDS,
    DesignTargets,
    ImageFill,
    MainLensState,
    Numbers,
    check_count,
    check_targets,
    solve,
    template_array,
)
from plenoptic.camera.gaussian import CameraKind, image_plane, neighbour_distance, paraxial_cone, sharp_image
from plenoptic.camera.report.illumination import clear_pupil, touching_fill, with_semi_diameter
from plenoptic.core.values import check_kind, choice, length_in_mm, positive, value, wavelength_in_nm
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import best_focus
from plenoptic.optics.lens.models import FocusCriterion, LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor

_ROUNDS = 40
"""Most iterations; each reduces the errors ten to a thousand times, unless the rims of the lens vignette."""
_LIMIT_ROUNDS = 3
"""Iterations of the largest iris, whose rims are seen from an array that moves a little with it."""


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
        Traced diameter of the micro images over their distance, less the target; 0 without that target.
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
            traced = self._trace(camera)
            history.append(self._step(numbers, camera, lens_state, traced))
            if not math.isfinite(traced.slope):
                break
            if self._converges(history[-1], tolerance):
                if "h" not in self.fixed and self._clear_iris(camera) < numbers["h"]:
                    break
                return CameraDesign(camera, tuple(FIELDS[u] for u in FIELDS if u not in self.fixed), tuple(history))
            lens_state = traced
        else:
            last = history[-1]
            raise InvalidValueError(
                f"after {len(history)} rounds the focus is still off by {last.focus_error:.2g} mm and the image fill "
                f"by {last.fill_error:.2g}; give a larger tolerance, or more numbers"
            )
        raise InvalidValueError(self._vignetting_message(camera, traced.fill, history[0].semi_diameter, tolerance))

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
        distance, b = self.fixed.get("L", image), self.fixed.get("b", 0.0)
        if lens.model is not LensModel.NONE and b > distance > 0:
            raise InvalidValueError(
                f"microlenses_to_sensor is {b:g} mm, and the main lens's image is {distance:.4g} mm behind the iris; "
                "give it in mm, as 0.7 for 700 micrometres"
            )
        position = max(distance, end + 1e-3 * (abs(image) + abs(end) + lens.stop.semi_diameter))
        fill = self._fill(None)
        for _ in range(_ROUNDS):
            cone = paraxial_cone(lens, position, self.wavelength)
            lens_state = MainLensState(image, shift, cone.slope / lens.stop.semi_diameter, cone.vergence, fill)
            numbers = solve(targets, self.fixed, lens_state)
            if not numbers["L"] > end:
                raise InvalidValueError(
                    f"stop_to_microlenses would be {numbers['L']:.4g} mm, and the last lens vertex is at "
                    f"z = {end:.4g}; choose a plane nearer to the lens, or a smaller virtual depth"
                )
            before, position, fill = (position, fill), numbers["L"], self._fill(self._camera(numbers))
            if (position, fill) == before or (position == before[0] and math.isnan(fill)):
                break
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
        targets, lens, z = self.targets, camera.lens, camera.stop_to_microlenses
        slope, clear = clear_pupil(lens, z, self.wavelength)
        # Past rims that vignette, the iris would become larger and larger.
        if "h" not in self.fixed and clear < lens.stop.semi_diameter:
            lens = with_semi_diameter(lens, clear)
        image = 0.0 if targets.z is None else self._image(lens, targets.z)
        shift = 0.0 if targets.depth_at is None else self._image(lens, targets.depth_at) - image
        vergence = paraxial_cone(lens, z, self.wavelength).vergence
        return MainLensState(image, shift, slope / lens.stop.semi_diameter, vergence, self._fill(camera))

    def _fill(self, camera: PlenopticCamera | None) -> float:
        """Target for the diameter of micro images over their distance in a camera; nan without."""
        fill = self.targets.image_fill
        if not isinstance(fill, ImageFill):
            return math.nan if fill is None else fill
        if camera is None:
            return 1.0
        cone = paraxial_cone(camera.lens, camera.stop_to_microlenses, self.wavelength)
        return touching_fill(camera, cone.vergence)

    def _image(self, lens: LensStack, z: float) -> float:
        if lens.model is LensModel.NONE:
            return z
        return best_focus(lens, z_object=z, wavelength=self.wavelength, criterion=self.criterion)

    def _step(self, n: Numbers, camera: PlenopticCamera, before: MainLensState, traced: MainLensState) -> DesignStep:
        fill = focus = 0.0
        if self.targets.image_fill is not None:
            diameter = 2.0 * n["b"] * traced.slope * n["h"]
            fill = diameter / (n["p"] * abs(1.0 + n["b"] * traced.vergence)) - traced.fill
        if self.targets.z is not None:
            focus = traced.image - n["L"] - sharp_image(camera, n["f"])
        return DesignStep(n["h"], n["L"], n["b"], n["p"], n["f"], focus, fill, traced.shift - before.shift)

    def _converges(self, step: DesignStep, tolerance: float) -> bool:
        position_tolerance = tolerance * abs(step.stop_to_microlenses)
        focused = abs(step.focus_error) <= position_tolerance and abs(step.depth_error) <= position_tolerance
        return focused and abs(step.fill_error) <= tolerance

    def _clear_iris(self, camera: PlenopticCamera) -> float:
        """Semi-diameter in mm of the iris that rims and other stops leave clear."""
        return clear_pupil(camera.lens, camera.stop_to_microlenses, self.wavelength)[1]

    def _vignetting_message(self, camera: PlenopticCamera, fill: float, semi_diameter: float, tolerance: float) -> str:
        limit, largest_fill = self._limits(camera, tolerance)
        reached = f" and image_fill to {math.floor(1e3 * largest_fill) / 1e3:.3f}" if largest_fill > 0 else ""
        return (
            f"image_fill {fill:.4g} cannot be had: it takes an iris of semi-diameter {semi_diameter:.4g} mm by "
            f"Gaussian optics, but rims and other stops of the lens limit it to {limit:.4g} mm{reached}; ask for less, "
            "for a larger microlenses_to_sensor or for a smaller pitch"
        )

    def _limits(self, camera: PlenopticCamera, tolerance: float) -> tuple[float, float]:
        """Largest iris in mm and largest image fill of this design; nan if it has no solution with that iris."""
        targets, limit = dataclasses.replace(self.targets, image_fill=None), self._clear_iris(camera)
        for _ in range(_LIMIT_ROUNDS):
            try:
                fixed = {**self.fixed, "h": limit}
                camera = dataclasses.replace(self, targets=targets, fixed=fixed).run(tolerance).camera
            except InvalidValueError:
                return limit, math.nan
            limit = min(limit, self._clear_iris(camera))
        traced, b = self._trace(camera), camera.microlenses_to_sensor
        assert camera.microlenses is not None
        distance = neighbour_distance(camera.microlenses) * abs(1.0 + b * traced.vergence)
        return limit, 2.0 * b * traced.slope * camera.lens.stop.semi_diameter / distance


def design_camera(  # noqa: PLR0913
    lens: LensStack,
    *,
    sensor: Sensor,
    kind: CameraKind,
    z: float | None = None,
    image_fill: float | ImageFill | None = ImageFill.TOUCHING,
    virtual_depth: float | None = None,
    disparity: float | None = None,
    depth_at: float | None = None,
    microlenses: MicrolensArray | None = None,
    pitch: float | None = None,
    focal_length: float | None = None,
    lattice: Lattice = Lattice.HEXAGONAL,
    semi_diameter: float | None = None,
    stop_to_microlenses: float | None = None,
    microlenses_to_sensor: float | None = None,
    criterion: FocusCriterion = FocusCriterion.RMS_SPOT,
    wavelength: float = 587.6,
    tolerance: float = 1e-8,
) -> CameraDesign:
    """Design a plenoptic camera whose traced rays meet targets for focus, micro images and depth.

    Each target (z, image_fill, virtual_depth or disparity, and kind=PLENOPTIC_1 with
    microlenses_to_sensor = focal_length) determines one number that is not given. The iris is solved for if
    `semi_diameter` is left out and `image_fill` determines no other number; otherwise it does not change.

    Parameters
    ----------
    lens : LensStack
        The main lens, traced by its model.
    sensor : Sensor
    kind : CameraKind
        PLENOPTIC_1, KEPLERIAN, GALILEAN, or CAMERA_ARRAY for a lens with LensModel.NONE.
    z : float, optional
        The plane in focus in the camera's frame in mm, negative; -inf: infinity.
    image_fill : float or ImageFill, optional
        Diameter of the micro images over their distance; 1 matches the f-numbers of main lens and microlenses.
        Default: TOUCHING, less than 1 by the border that fades out, so that neighbours do not overlap. None: no target.
    virtual_depth : float, optional
        Image distance from the array over microlenses_to_sensor, see `MicrolensFocus`.
    disparity : float, optional
        Pixels between the images of neighbouring microlenses, above 0; for PLENOPTIC_1 microlenses between the views of
        neighbouring pixels. Instead of virtual_depth.
    depth_at : float, optional
        The plane of virtual_depth or disparity, in mm; default: the plane in focus.
    microlenses : MicrolensArray, optional
        Array with pitch and focal length (of the microlens on the axis, at `wavelength`).
    pitch, focal_length : float, optional
        Pitch and focal length of the microlenses in mm, instead of `microlenses`.
    lattice : Lattice, optional
        Lattice, if `microlenses` is left out.
    semi_diameter : float, optional
        Semi-diameter of the iris in mm.
    stop_to_microlenses, microlenses_to_sensor : float, optional
        Distances as in `PlenopticCamera`, mm.
    criterion : FocusCriterion, optional
        Criterion for the main lens's image of the plane in focus.
    wavelength : float, optional
        Wavelength of the design in nm.
    tolerance : float, optional
        Largest error of the traced focus over the distance of the array, and of the traced image fill.

    Raises
    ------
    InvalidValueError
        If targets contradict each other or the numbers given, leave a number undetermined, or are impossible: an image
        on the wrong side of the array, more light than the rims of the lens transmit, a camera inside its lens.

    Notes
    -----
    The first solution is paraxial. Each iteration traces the image of the plane in focus and the slope of the marginal
    ray at the centre of the array, and solves the equations again with these, until the solution converges.

    Examples
    --------
    >>> import plenoptic as pl
    >>> design = pl.design_camera(pl.load_lens("double-gauss-100mm-f2"), sensor=pl.Sensor((512, 512), 0.010), z=-404.0,
    ...     kind=pl.CameraKind.GALILEAN, pitch=0.217, focal_length=2.0, virtual_depth=4.0, image_fill=0.95)
    >>> design.solved_for
    ('semi_diameter', 'stop_to_microlenses', 'microlenses_to_sensor')
    >>> camera = design.camera
    >>> f"{camera.microlenses_to_sensor:.3f} mm, iris {camera.lens.stop.semi_diameter:.2f} mm"
    '1.500 mm, iris 5.97 mm'
    """
    check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
    check_kind(sensor, "sensor", Sensor, "pl.Sensor((512, 512), 0.01)")
    kind = choice(kind, CameraKind, "kind")
    targets = DesignTargets(kind, z, depth_at, image_fill, virtual_depth, disparity, sensor.pixel_pitch)
    wave = wavelength_in_nm(wavelength)
    check_targets(targets, lens, wave)
    template = template_array(microlenses, pitch, focal_length, lattice)
    lengths = {"h": semi_diameter, "L": stop_to_microlenses, "b": microlenses_to_sensor}
    fixed = {u: length_in_mm(x, FIELDS[u]) for u, x in lengths.items() if x is not None}
    if microlenses is not None:
        fixed |= {"p": neighbour_distance(template), "f": template.focal_length / template.power_factor(wave)}
    if pitch is not None:
        fixed["p"] = float(pitch)
    if focal_length is not None:
        fixed["f"] = float(focal_length)
    if "h" not in fixed and (targets.image_fill is None or len(targets.names) <= 4 - len(fixed)):
        fixed["h"] = lens.stop.semi_diameter
    check_count(targets, fixed)
    best = choice(criterion, FocusCriterion, "criterion")
    design = Search(lens, sensor, targets, fixed, template, best, wave).run(positive(tolerance, "tolerance"))
    warn_if_implausible(design.camera)
    return design
