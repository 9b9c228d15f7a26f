"""Which stages a camera needs, and why."""

from __future__ import annotations

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import ApertureShape, Gaps, Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.stops.circle import circle_around
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.rendering.plan.stages import Decision, Stage, first_reason

_NONE = "the camera has none"


def camera_decisions(camera: PlenopticCamera) -> list[Decision]:
    """Decisions on everything between the pixel and the scene, in the order of the stages."""
    return [
        *_sensor_decisions(camera),
        *_array_decisions(camera),
        *_assembly_decisions(camera),
        *_lens_decisions(camera),
    ]


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _sensor_decisions(camera: PlenopticCamera) -> list[Decision]:
    seen, sensor = camera.sensitivity, camera.sensor
    axes = assembly(camera).sensor_to_local.turn
    turned = bool(axes[0, 1] != 0 or axes[1, 0] != 0)
    return [
        Decision(
            Stage.WAVELENGTHS,
            seen is not None,
            f"everything at {camera.wavelength:g} nm"
            if seen is None
            else "paths draw wavelengths from {:g} to {:g} nm".format(*seen.wavelength_range),
        ),
        Decision(
            Stage.PIXEL_RESPONSE,
            sensor.angular_response is not None,
            "pixels see all directions alike" if sensor.angular_response is None else "it depends on direction",
        ),
        Decision(
            Stage.TURNED_PIXELS,
            turned,
            "their sides lie askew to x and y" if turned else "their sides are along x and y",
        ),
        Decision(
            Stage.BLEMISHES,
            bool(camera.blemishes),
            f"{sum(map(len, camera.blemishes))} grains of dust or scratches"
            if camera.blemishes
            else "no dust and no scratches",
        ),
    ]


def _array_decisions(camera: PlenopticCamera) -> list[Decision]:
    array = camera.microlenses
    if array is None:
        stages = range(Stage.MICROLENSES, Stage.MICROLENS_PLATES + 1)
        return [Decision(Stage(stage), False, _NONE) for stage in stages]
    types = len(set(array.focal_lengths))
    return [
        Decision(Stage.MICROLENSES, True, f"pitch {' x '.join(f'{p:g}' for p in dict.fromkeys(array.pitches))} mm"),
        Decision(Stage.MICROLENS_TYPES, types > 1, _counted(types, "focal length")),
        Decision(Stage.OPENINGS, *_opening(array)),
        Decision(
            Stage.WALLS,
            array.walls is Walls.OPAQUE,
            "each lens lights its own cell" if array.walls is Walls.OPAQUE else "lenses light all of the sensor",
        ),
        Decision(
            Stage.LISTED_LENSES,
            array.lattice is Lattice.FREE or array.imperfections is not None,
            first_reason(
                array.lattice is not Lattice.FREE,
                "centres are listed",
                array.imperfections is None,
                "lenses have imperfections",
                "lenses are all as designed",
            ),
        ),
        Decision(Stage.MICROLENS_PLATES, array.is_plate, f"microlenses are {array.model.name}"),
    ]


def _opening(array: MicrolensArray) -> tuple[bool, str]:
    """Whether paths are tested against openings, and why."""
    if array.aperture is None:
        return False, "lenses fill their cells"
    if array.aperture.gaps is Gaps.CLEAR:
        return True, "light passes beside the openings"
    if array.aperture.shape is ApertureShape.CIRCLE:
        return True, "openings are round"
    return array.is_plate and array.aperture.fill_factor < 1, "paths are aimed into the openings"


def _assembly_decisions(camera: PlenopticCamera) -> list[Decision]:
    parts = assembly(camera)
    array = camera.microlenses is not None
    return [
        Decision(
            Stage.TILTED_SENSOR,
            parts.lean is not None,
            "it is parallel to the array" if array else "it is perpendicular to the lens's axis",
        )
        if parts.lean is None
        else Decision(Stage.TILTED_SENSOR, True, "its distance varies"),
        Decision(
            Stage.TILTED_ARRAY,
            parts.frame is not None,
            first_reason(
                array, _NONE, parts.frame is not None, "it is perpendicular to the lens's axis", "it is tilted"
            ),
        ),
    ]


def _lens_decisions(camera: PlenopticCamera) -> list[Decision]:
    lens = camera.lens
    exact = lens.model is LensModel.EXACT
    stops = [e for e in lens.elements if not isinstance(e, Surface) and circle_around(e) is not e]
    surfaces = [e for e in lens.elements if isinstance(e, Surface)]
    shaped = sum(1 for e in surfaces if e.aspheric or e.conic or e.departure is not None)
    moved = sum(1 for e in lens.elements if e.placement is not None)
    ideal = f"{lens.model.name} stands for the lens"
    return [
        Decision(
            Stage.LENS, True, f"{len(lens.elements)} elements, {len(surfaces)} of them refracting" if exact else ideal
        ),
        Decision(
            Stage.ASPHERES,
            exact and shaped > 0,
            first_reason(
                exact,
                ideal,
                shaped > 0,
                "all surfaces are spheres or planes",
                _counted(shaped, "conic or aspheric surface"),
            ),
        ),
        Decision(
            Stage.PLACEMENTS,
            exact and moved > 0,
            first_reason(
                exact, ideal, moved > 0, "all elements are centred", f"{_counted(moved, 'element')} out of place"
            ),
        ),
        Decision(
            Stage.SHAPED_STOPS,
            bool(stops),
            f"{_counted(len(stops), 'stop')} that {'is' if len(stops) == 1 else 'are'} not round"
            if stops
            else "all stops are round",
        ),
        Decision(
            Stage.DISPLACED_LENS,
            camera.lens_placement is not None,
            "it stands as designed" if camera.lens_placement is None else "its axes are not the camera's",
        ),
        Decision(
            Stage.POSE, camera.pose is not None, "the world is the camera's frame" if camera.pose is None else "posed"
        ),
    ]
