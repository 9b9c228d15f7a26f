import math
import re
from itertools import pairwise

import pytest
from camera_helpers import GAUSS as LENS
from camera_helpers import refused

import plenoptic as pl
from plenoptic.camera.design.design import design_camera
from plenoptic.camera.gaussian import CameraKind
from plenoptic.camera.report.report import camera_report
from plenoptic.optics.lens.analysis.best_focus import best_focus

# Reports of paraxial lenses cost less.
THIN, NONE, PARAXIAL = (LENS.with_model(pl.LensModel[name]) for name in ("THIN", "NONE", "PARAXIAL"))
POINTS = pl.paraxial.cardinal_points(LENS)
SENSOR = pl.Sensor(shape=(512, 512), pixel_pitch=0.01)
GALILEAN, KEPLERIAN, FIRST = CameraKind.GALILEAN, CameraKind.KEPLERIAN, CameraKind.PLENOPTIC_1
RMS = pl.FocusCriterion.RMS_SPOT
PLAIN = {"kind": GALILEAN, "z": -404.0, "pitch": 0.217, "focal_length": 2.0, "virtual_depth": 4.0}


def design(lens=LENS, *, image_fill=1.0, **targets):
    return design_camera(lens, sensor=SENSOR, image_fill=image_fill, **targets)


def test_reports_of_designs_state_the_targets():
    for targets in (
        {"kind": GALILEAN, "pitch": 0.217, "focal_length": 2.0, "virtual_depth": 4.0},
        {"kind": KEPLERIAN, "pitch": 0.217, "focal_length": 2.0, "virtual_depth": 4.0, "image_fill": 0.9},
        {"kind": GALILEAN, "pitch": 0.217, "focal_length": 2.0, "disparity": 3.0},
        {"kind": GALILEAN, "pitch": 0.217, "microlenses_to_sensor": 1.7, "virtual_depth": 5.0},
        {"kind": GALILEAN, "pitch": 0.217, "semi_diameter": 5.0, "disparity": 3.0},
        {"kind": GALILEAN, "focal_length": 2.0, "semi_diameter": 5.0, "virtual_depth": 5.0},
        {"kind": GALILEAN, "focal_length": 2.0, "microlenses_to_sensor": 1.7, "disparity": 3.0},
        {"kind": GALILEAN, "focal_length": 2.0, "semi_diameter": 5.0, "disparity": 3.0},
        {"kind": KEPLERIAN, "focal_length": 2.0, "semi_diameter": 5.0, "disparity": 3.0},
        {"kind": GALILEAN, "pitch": 0.217, "stop_to_microlenses": 123.3, "virtual_depth": 5.0},
        {"kind": KEPLERIAN, "pitch": 0.217, "focal_length": 2.0, "stop_to_microlenses": 150.0},
        {"kind": GALILEAN, "pitch": 0.217, "focal_length": 2.0, "virtual_depth": 3.0, "lattice": pl.Lattice.SQUARE},
        # Negative microlenses are Galilean: b = f (1 - 2).
        {"kind": GALILEAN, "pitch": 0.217, "microlenses_to_sensor": 1.0, "virtual_depth": 0.5},
        {"kind": FIRST, "pitch": 0.217, "focal_length": 2.0},
        {"kind": FIRST, "focal_length": 2.0, "semi_diameter": 5.0},
        {"kind": FIRST, "pitch": 0.217, "semi_diameter": 5.0},
        {"kind": FIRST, "pitch": 0.217, "semi_diameter": 5.0, "focal_length": 2.0, "image_fill": None},
    ):
        result = design(LENS if len(targets) == 3 else PARAXIAL, z=-404.0, **targets)
        report, camera = camera_report(result.camera), result.camera
        (focus,) = report.focus
        assert report.kind is targets["kind"], targets
        # The search ends at 1e-8 of the array's distance, times the longitudinal magnification 1 / 0.319^2.
        assert focus.z_traced == pytest.approx(-404.0, abs=1e-8 * 150 * 10 * 2), targets
        if targets.get("image_fill", 1.0) is not None:
            assert report.image_fill == pytest.approx(targets.get("image_fill", 1.0), abs=1.1e-8), targets
        for name in ("virtual_depth", "disparity"):
            assert name not in targets or getattr(focus, name) == pytest.approx(targets[name], rel=1e-9), targets
        # What is given is kept, to the bit.
        camera_values = {
            "pitch": camera.microlenses.pitch,
            "focal_length": camera.microlenses.focal_length,
            "semi_diameter": camera.lens.stop.semi_diameter,
            "stop_to_microlenses": camera.stop_to_microlenses,
            "microlenses_to_sensor": camera.microlenses_to_sensor,
        }
        for name, has in camera_values.items():
            assert (name in result.solved_for) == (name not in targets) or name == "semi_diameter", (name, targets)
            assert name not in targets or has == targets[name], (name, targets)


def test_the_first_step_is_paraxial_and_errors_fall():
    result = design(**PLAIN)
    first, last = result.history[0], result.history[-1]
    assert first.stop_to_microlenses == pytest.approx(pl.paraxial.image_position(LENS, -404.0) - 6.0, rel=1e-13)
    cone = (first.stop_to_microlenses - POINTS.exit_pupil) / (2 * POINTS.pupil_magnification * first.semi_diameter)
    distance = first.stop_to_microlenses - POINTS.exit_pupil
    assert 1.5 / cone == pytest.approx(0.217 * (1 + 1.5 / distance), rel=1e-12)
    # The aberrations of this lens: spherical aberration moves the focus by a tenth of a millimetre.
    assert abs(first.focus_error) > 0.05 and abs(first.fill_error) > 1e-4
    assert abs(last.focus_error) < 1e-8 * last.stop_to_microlenses and abs(last.fill_error) < 1e-8
    sizes = [abs(step.focus_error) for step in result.history]
    assert all(later < 0.3 * before for before, later in pairwise(sizes))


def test_where_a_design_is_in_focus():
    result = design(kind=FIRST, z=-404.0, pitch=0.217, focal_length=2.0, criterion=pl.FocusCriterion.PARAXIAL)
    assert result.camera.stop_to_microlenses == pl.paraxial.image_position(LENS, -404.0)
    assert camera_report(result.camera).image_fill == pytest.approx(1.0, abs=1.1e-8)
    horizon = design(kind=FIRST, z=-math.inf, pitch=0.217, focal_length=2.0)
    assert camera_report(horizon.camera).focus[0].z_traced == -math.inf
    # A virtual depth is that of the plane in focus.
    assert design(PARAXIAL, **PLAIN, depth_at=-404.0).camera == design(PARAXIAL, **PLAIN).camera


def test_disparity_in_another_plane():
    # By the traced images of both planes: s = image of the other plane behind the array.
    for kind, fixed in ((GALILEAN, False), (KEPLERIAN, False), (FIRST, False), (GALILEAN, True), (KEPLERIAN, True)):
        disparity = 0.4 if kind is FIRST else 3.0
        free = {"focal_length": 2.0, "semi_diameter": 5.0} if kind is FIRST else {"focal_length": 2.0, "pitch": 0.217}
        free = {"microlenses_to_sensor": 1.7, "pitch": 0.217} if fixed else free
        fill = None if kind is FIRST else 1.0
        lens = LENS if kind is KEPLERIAN else PARAXIAL
        targets = {"disparity": disparity, "depth_at": -390.0, "image_fill": fill, **free}
        camera = design(lens, kind=kind, z=-404.0, **targets).camera
        image = best_focus(camera.lens, z_object=-390.0, criterion=RMS)
        s, b, p = image - camera.stop_to_microlenses, camera.microlenses_to_sensor, camera.microlenses.pitch
        traced_disparity = s * 0.01 / (b * p) if kind is FIRST else p * b / abs(s) / 0.01
        assert traced_disparity == pytest.approx(disparity, rel=1e-7), (kind, fixed)
        assert camera_report(camera).focus[0].z_traced == pytest.approx(-404.0, abs=1e-5), (kind, fixed)


def test_a_camera_array_looks_at_its_plane():
    targets = {"z": -404.0, "pitch": 0.217, "focal_length": 2.0, "stop_to_microlenses": 100.0}
    result = design(NONE, kind=CameraKind.CAMERA_ARRAY, **targets)
    # 1/b = 1/f - 1/504, and the iris at 100 mm fills images that touch.
    assert result.camera.microlenses_to_sensor == pytest.approx(1 / (1 / 2.0 - 1 / 504.0), rel=1e-12)
    b = result.camera.microlenses_to_sensor
    assert result.camera.lens.stop.semi_diameter == pytest.approx(0.217 * (1 + b / 100) * 100 / (2 * b), rel=2e-8)
    assert camera_report(result.camera).focus[0].z == pytest.approx(-404.0, rel=1e-11)


def test_the_stop_keeps_its_shape_and_the_array_what_it_has():
    opening = pl.optics.MicrolensAperture(fill_factor=0.8)
    array = pl.MicrolensArray(0.217, (2.4, 2.0), pl.Lattice.SQUARE, aperture=opening)
    lens = LENS.with_stop(pl.PolygonStop(blades=5, semi_diameter=9.0, rotation=0.3))
    result = design(lens, kind=GALILEAN, z=-404.0, microlenses=array, virtual_depth=4.0, wavelength=550.0)
    stop = result.camera.lens.stop
    assert result.camera.microlenses == array and result.camera.wavelength == 550.0
    assert (stop.blades, stop.rotation) == (5, 0.3) and 0 < stop.semi_diameter < 9.0
    assert result.camera.microlenses_to_sensor == pytest.approx(2.4 * 0.75, rel=1e-12)
    focused = result.camera.focused_at(-404.0, criterion=RMS, microlens_type=0)
    assert focused.stop_to_microlenses == pytest.approx(result.camera.stop_to_microlenses, rel=2e-8)


@pytest.mark.filterwarnings("ignore::plenoptic.errors.ImplausibleCameraWarning")  # pixels of 10 nm
def test_micrometre_lenses_and_kilometres():
    for scale in (1e-3, 1e3):
        front = pl.Surface(50.0 * scale, 4.0 * scale, pl.ConstantMedium(1.5), semi_diameter=12.0 * scale)
        surfaces = front, pl.Surface(-80.0 * scale, semi_diameter=12.0 * scale)
        lens = pl.LensStack([pl.CircularStop(4.0 * scale, thickness=1.0 * scale), *surfaces])
        targets = {"z": -1e6 * scale, "pitch": 0.2 * scale, "focal_length": 2.0 * scale, "virtual_depth": 3.0}
        targets |= {"kind": GALILEAN, "image_fill": 1.0}
        result = design_camera(lens, sensor=pl.Sensor((100, 100), 1e-2 * scale), **targets)
        assert result.camera.microlenses_to_sensor == pytest.approx(4.0 / 3.0 * scale, rel=1e-12)
        report = camera_report(result.camera)
        assert report.image_fill == pytest.approx(1.0, abs=2e-8)
        # 1e-8 of the image distance, times (1e6 / 61)^2.
        assert report.focus[0].z_traced == pytest.approx(-1e6 * scale, rel=2e-8 * 60 * (1e6 / 61) ** 2 / 1e6)


TWICE = {"stop_to_microlenses": 123.3, "microlenses_to_sensor": 1.7, "semi_diameter": 5.0, "image_fill": None}
TWICE |= {"pitch": None, "virtual_depth": None}


def test_impossible_targets():
    for changes, says in (
        ({"semi_diameter": 5.0}, "too many; leave out 1"),
        ({"virtual_depth": None, "image_fill": None}, "too few; give 1 more"),
        ({"disparity": 3.0}, "say the same"),
        ({"virtual_depth": 0.9}, "virtual depth above 1"),
        ({"virtual_depth": -4.0}, "above 0"),
        ({"virtual_depth": None, "disparity": 30.0, "pitch": None, "semi_diameter": 5.0}, "smaller disparity"),
        ({"z": 404.0}, "in front of the camera"),
        ({"z": POINTS.front_focus}, "no real image behind the lens"),
        ({"z": -50.0}, "beyond the front focus at z = -"),
        ({"z": -0.404}, "looks like metres: give -404"),
        ({"depth_at": -50.0}, "the plane depth_at = -50 mm has no real image"),
        ({"microlenses_to_sensor": 700.0, "virtual_depth": None}, "0.7 for 700 micrometres"),
        ({"depth_at": 0.0}, "in front of the camera"),
        ({"virtual_depth": None, "depth_at": -300.0, "stop_to_microlenses": 120.0}, "depth_at is the plane"),
        ({"kind": FIRST}, "another plane depth_at"),
        ({"kind": CameraKind.CONVENTIONAL}, "focused_at"),
        ({"kind": CameraKind.CAMERA_ARRAY}, "LensModel.NONE"),
        ({"lens": NONE}, "LensModel.NONE"),
        ({"lens": 3}, "lens is"),
        ({"lattice": pl.Lattice.FREE}, "give microlenses"),
        ({"microlenses": pl.MicrolensArray(0.2, (2.0,))}, "leave out pitch"),
        ({"pitch": -0.2}, "pitch is -0.2"),
        ({"virtual_depth": 100.0}, "is impossible|last lens vertex"),
        ({"virtual_depth": 60.0}, "last lens vertex"),
        # The iris may be opened as one likes: the rims of the lens end the light at f/2.6.
        ({"pitch": 1.0, "lens": LENS}, "image_fill 1 cannot be had"),
        ({"lens": LENS.inserted(pl.CircularStop(3.0), z=40.0)}, "image_fill 1 cannot be had"),
        ({"virtual_depth": None, "stop_to_microlenses": 150.0}, "needs its image behind the array"),
        ({"tolerance": 0.0}, "tolerance"),
        # Focus is given twice, and nothing says the pitch.
        (TWICE, "nothing left to choose|cannot be found"),
    ):
        targets = PLAIN | changes
        with refused(says):
            design(targets.pop("lens", PARAXIAL), **targets)


def test_a_sensor_in_micrometres_is_told_by_the_design_and_the_report():
    with pytest.warns(pl.errors.ImplausibleCameraWarning, match=r"give pixel_pitch \(5.5\) in mm"):
        camera = design_camera(PARAXIAL, sensor=pl.Sensor((200, 200), 5.5), **PLAIN).camera
    (finding,) = (f for f in camera_report(camera).warnings if f.kind.name == "IMPLAUSIBLE")
    assert "give pixel_pitch (5.5) in mm" in str(finding)


def test_limits_that_are_named_hold():
    # An iris of f/2 seen from the array 100 mm behind it: microlenses of f/1.8 are too fast for it.
    wide = {"kind": FIRST, "z": -1000.0, "pitch": 0.02, "focal_length": 0.035}
    with pytest.raises(pl.errors.InvalidValueError, match="cannot be had") as error:
        design(**wide)
    iris, limit, fill = (
        float(number) for number in re.findall(r"(\d+\.\d+)(?: mm by|(?: mm)? and|;)", str(error.value))
    )
    camera = design(**wide, image_fill=fill).camera
    assert camera_report(camera).image_fill == pytest.approx(fill, abs=1.1e-8)
    assert camera.lens.stop.semi_diameter == pytest.approx(limit, rel=2e-3)
    with refused("cannot be had"):
        design(**wide, image_fill=fill + 0.002)
    # The iris that it would take is that of Gaussian optics.
    assert design(LENS.with_model(pl.LensModel.PARAXIAL), **wide).camera.lens.stop.semi_diameter == pytest.approx(
        iris, rel=1e-3
    )


def test_default_designs_have_no_warnings():
    for kind, numbers in (
        (FIRST, {}),
        (FIRST, {"lattice": pl.Lattice.SQUARE}),
        (GALILEAN, {"virtual_depth": 4.0}),
        (GALILEAN, {"virtual_depth": 8.0, "lattice": pl.Lattice.SQUARE}),
        (KEPLERIAN, {"virtual_depth": 4.0}),
        (GALILEAN, {"disparity": 4.0}),
    ):
        camera = design_camera(LENS, sensor=SENSOR, kind=kind, z=-404.0, pitch=0.2, focal_length=2.0, **numbers).camera
        report = camera_report(camera)
        assert not report.warnings, (kind, numbers)
        border = report.image_border_pixels / report.image_pitch_pixels
        assert report.image_fill == pytest.approx(1.0 - border, abs=1e-6), (kind, numbers)
