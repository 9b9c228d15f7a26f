"""Decisions on the stages of a camera: a table of conditions and reasons."""

from __future__ import annotations

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.sampling.region_bounds import bounds_reason, no_core_reason
from plenoptic.optics.lens.loss_record import has_losses
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import ApertureShape, Gaps, Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.stops.stop_registry import is_circle
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.rendering.plan.stages import Decision, Stage, decide, left_out

_NONE = "the camera has none"


def camera_decisions(camera: PlenopticCamera, *, white: bool) -> list[Decision]:
    """Decisions on all stages between the pixel and the scene, in order."""
    array = camera.microlenses
    groups = [_sensor(camera), _diffraction(camera), _pupils(camera, white=white), _array(array), _assembly(camera)]
    return [*(decision for group in groups for decision in group), *_lens(camera)]


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _sensor(camera: PlenopticCamera) -> list[Decision]:
    sensitivity, response, grains = camera.sensitivity, camera.sensor.angular_response, sum(map(len, camera.blemishes))
    low, high = (0.0, 0.0) if sensitivity is None else sensitivity.wavelength_range
    axes = assembly(camera).sensor_to_local.turn
    askew = bool(axes[0, 1] != 0 or axes[1, 0] != 0)
    single_wavelength, all_waves = (
        f"everything at {camera.wavelength:g} nm",
        f"paths draw wavelengths from {low:g} to {high:g} nm",
    )
    isotropic, upright = "pixels see all directions alike", "their sides are along x and y"
    return [
        decide(Stage.WAVELENGTHS, sensitivity is not None, single_wavelength, all_waves),
        decide(Stage.PIXEL_RESPONSE, response is not None, isotropic, "it depends on direction"),
        decide(Stage.TURNED_PIXELS, askew, upright, "their sides lie askew to x and y"),
        decide(Stage.BLEMISHES, camera.blemishes, "no dust and no scratches", f"{grains} grains of dust or scratches"),
    ]


def _diffraction(camera: PlenopticCamera) -> list[Decision]:
    array, iris = camera.microlenses, camera.diffraction is not None and camera.diffraction.iris
    if camera.diffraction is None:
        return left_out(Stage.DIFFRACTION, Stage.DIFFRACTION, "paths are straight between surfaces")
    bends = ["at the iris"] if iris else []
    if array is not None:
        width, distance = 2e3 * array.opening.reach, 1e3 * camera.microlenses_to_sensor
        bends.append(f"at openings up to {width:.3g} um wide, {distance:.4g} um before the sensor")
    return [decide(Stage.DIFFRACTION, "paths bend " + " and ".join(bends))]


def _pupils(camera: PlenopticCamera, *, white: bool) -> list[Decision]:
    """Decisions on the computation of the illuminated pupil of a pixel."""
    no_core = no_core_reason(camera) if white else "a scene is seen"
    bounds = bounds_reason(camera, with_core=not no_core)
    return [
        decide(Stage.APERTURE_REGIONS, not bounds, bounds, "each point of a pixel sees the openings of the lens"),
        decide(
            Stage.UNVIGNETTED_CORE, *(not no_core, no_core), *(not bounds, bounds), "unvignetted light is not traced"
        ),
    ]


def _array(array: MicrolensArray | None) -> list[Decision]:
    if array is None:
        return left_out(Stage.MICROLENSES, Stage.MICROLENS_PLATES, _NONE)
    pitch = f"pitch {' x '.join(f'{p:g}' for p in dict.fromkeys(array.pitches))} mm"
    types = len(set(array.focal_lengths))
    lengths = _count(types, "focal length")
    free = array.lattice is Lattice.FREE
    reason = "centres are listed" if free else "lenses have imperfections"
    if array.medium is not None:
        pitch += ", of a medium"
    model = f"microlenses are {array.model.name}"
    return [
        decide(Stage.MICROLENSES, pitch),
        decide(Stage.MICROLENS_TYPES, types > 1, lengths, lengths),
        _openings(array),
        decide(
            Stage.WALLS, array.walls is Walls.OPAQUE, "lenses light all of the sensor", "each lens lights its own cell"
        ),
        decide(Stage.LISTED_LENSES, free or array.imperfections is not None, "lenses are all as designed", reason),
        decide(Stage.MICROLENS_PLATES, array.is_plate, model, model),
    ]


def _openings(array: MicrolensArray) -> Decision:
    """Decision on testing paths against the microlens apertures."""
    opening, filled, aimed = array.aperture, "lenses fill their cells", "paths are aimed into the openings"
    if opening is None:
        return decide(Stage.OPENINGS, False, filled, filled)
    clear, circles = opening.gaps is Gaps.CLEAR, opening.shape is ApertureShape.CIRCLE
    tested = clear or circles or (array.is_plate and opening.fill_factor < 1)
    reason = "light passes beside the openings" if clear else "openings are round" if circles else aimed
    return decide(Stage.OPENINGS, tested, aimed, reason)


def _assembly(camera: PlenopticCamera) -> list[Decision]:
    parts, array = assembly(camera), camera.microlenses is not None
    across = "it is perpendicular to the lens's axis"
    parallel = "it is parallel to the array" if array else across
    return [
        decide(Stage.TILTED_SENSOR, parts.tilt is not None, parallel, "its distance varies"),
        decide(Stage.TILTED_ARRAY, array, _NONE, parts.frame is not None, across, "it is tilted"),
    ]


def _lens(camera: PlenopticCamera) -> list[Decision]:
    lens = camera.lens
    exact = lens.model is LensModel.EXACT
    stops = [e for e in lens.elements if not isinstance(e, Surface) and not is_circle(e)]
    surfaces = [e for e in lens.elements if isinstance(e, Surface)]
    shaped = sum(1 for e in surfaces if e.aspheric or e.conic or e.freeform is not None)
    moved = sum(1 for e in lens.elements if e.placement is not None)
    ideal = f"{lens.model.name} stands for the lens"
    mirrors = sum(isinstance(e.medium, Mirror) for e in surfaces)
    elements = f"{len(lens.elements)} elements, {len(surfaces) - mirrors} of them refracting"
    elements += f", {mirrors} reflecting" if mirrors else ""
    spheres, aspheres = "all surfaces are spheres or planes", _count(shaped, "conic or aspheric surface")
    odd_stops = f"{_count(len(stops), 'stop')} that {'is' if len(stops) == 1 else 'are'} not round"
    centred, displaced = "all elements are centred", f"{_count(moved, 'element')} out of place"
    uncoated = "no surface has a coating: the lens transmits all light"
    coated, coated_plates = has_losses(lens), camera.microlenses is not None and camera.microlenses.coating is not None
    losing = [_count(len(surfaces), "surface"), "the glasses"] if coated else []
    losing += ["the microlenses"] if coated_plates else []
    taking = f"{' and '.join(losing)} take light"
    in_place, astray = "it stands as designed", "its axes are not the camera's"
    return [
        decide(Stage.LENS, elements if exact else ideal),
        decide(Stage.ASPHERES, exact, ideal, shaped, spheres, aspheres),
        decide(Stage.PLACEMENTS, exact, ideal, moved, centred, displaced),
        decide(Stage.SHAPED_STOPS, stops, "all stops are round", odd_stops),
        decide(Stage.LOSSES, exact or coated_plates, ideal, losing, uncoated, taking),
        decide(Stage.DISPLACED_LENS, camera.lens_placement is not None, in_place, astray),
        decide(Stage.POSE, camera.pose is not None, "the world is the camera's frame", "posed"),
    ]
