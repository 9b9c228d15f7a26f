"""Design of a camera: iris, distances, pitch and focal length from focus, image fill, depth and disparity."""

from __future__ import annotations

from plenoptic.camera.design.equations import FIELDS, DesignTargets, check_count, check_targets, template_array
from plenoptic.camera.design.search import CameraDesign, Search
from plenoptic.camera.gaussian import CameraKind, neighbour_distance
from plenoptic.core.values import check_kind, choice, length_in_mm, positive, wavelength_in_nm
from plenoptic.optics.lens.models import FocusCriterion
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor


def design_camera(  # noqa: PLR0913
    lens: LensStack,
    *,
    sensor: Sensor,
    kind: CameraKind,
    z: float | None = None,
    image_fill: float | None = 1.0,
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
    """Design a plenoptic camera whose traced rays meet targets for focus, microlens images and depth.

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
    image_fill : float, optional
        Diameter of the microlens images over their distance; 1 matches the f-numbers of main lens and microlenses.
        None: no target.
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
    check_targets(targets, lens)
    wave = wavelength_in_nm(wavelength)
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
    search = Search(lens, sensor, targets, fixed, template, best, wave)
    return search.run(positive(tolerance, "tolerance"))
