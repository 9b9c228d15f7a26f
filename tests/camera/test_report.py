import dataclasses
import math
import re

import numpy as np
import pytest
from camera_helpers import CAMERA, refused, the_lens

import plenoptic as pl
from plenoptic.camera.gaussian import CameraKind, neighbour_distance, paraxial_cone
from plenoptic.camera.report import illumination
from plenoptic.camera.report.findings import CameraFindingKind
from plenoptic.camera.report.report import camera_report

LENS, SENSOR = CAMERA.lens, CAMERA.sensor
THIN, PARAXIAL = (LENS.with_model(model) for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL))
POINTS = pl.paraxial.cardinal_points(LENS)
PITCH, FOCAL = 0.217, 2.0
EPS = 2.0**-52


def camera_with(b, place=123.3, lens=LENS, microlenses=CAMERA.microlenses):
    return pl.PlenopticCamera(lens, SENSOR, place, microlenses, b)


PLATE = pl.Surface(50.0, 0.5, pl.ConstantMedium(1.5), semi_diameter=4.0), pl.Surface(math.inf, semi_diameter=4.0)
NO_LENS = pl.LensStack([pl.CircularStop(1.0, thickness=0.5), *PLATE], model=pl.LensModel.NONE)
KINDS = {
    # b > f: the image stands in front of the array, b < f: behind it.
    CameraKind.GALILEAN: camera_with(1.7, lens=THIN),
    CameraKind.KEPLERIAN: camera_with(2.4, 150.0, lens=THIN),
    CameraKind.PLENOPTIC_1: camera_with(2.0, 130.0, lens=THIN),
    # Without a lens, with an iris: 1/13 + 1/b = 1/f, in focus at 13 - 3 before the iris.
    CameraKind.CAMERA_ARRAY: camera_with(1 / (1 / FOCAL - 1 / 13), 3.0, lens=NO_LENS),
    CameraKind.CONVENTIONAL: pl.PlenopticCamera(lens=THIN, sensor=SENSOR, stop_to_microlenses=135.0),
}


def behind_lens(camera, z, half_width=None, n=41):
    """Heights on the array and slopes there of rays of the axial point z, evenly spread over the iris, that pass."""
    half_width = 0.8 * camera.lens.stop.semi_diameter if half_width is None else half_width
    y = np.linspace(-half_width, half_width, n)
    out = camera.lens.trace(pl.RayBundle([[0, 0, z]] * n, np.column_stack([0 * y, y, np.full(n, -z)])))
    out = out.selected(out.status == 0)
    return out.at_z(camera.stop_to_microlenses)[:, 1], out.direction[:, 1] / out.direction[:, 2]


def width_of_light(camera, z):
    """Of the axial point z on the array, by its marginal rays through the thin lens."""
    reach = POINTS.entrance_pupil_semi_diameter * z / (z - POINTS.rear_principal)
    return np.ptp(behind_lens(camera, z, (1 - 1e-12) * reach, 2)[0])


def on_sensor(camera, y, slope, centre):
    """Through a thin microlens at `centre` to the sensor."""
    return y + camera.microlenses_to_sensor * (slope - (y - centre) / camera.microlenses.focal_length)


def test_reference_camera_in_mode_2():
    # The reference: 1.7 mm, stop 10 mm: images every 21.987 pixels, a = 11.33 behind the array, z = -404 to within 0.1;
    # 12 % of its pixels are illuminated by several microlenses, here counted on points of a cell.
    report = camera_report(CAMERA)
    (focus,) = report.focus
    assert report.kind is CameraKind.GALILEAN
    assert report.image_pitch_pixels == pytest.approx(21.987, abs=5e-4)
    assert focus.image_distance == pytest.approx(34 / 3, rel=1e-14)
    assert focus.virtual_depth == pytest.approx(20 / 3, rel=1e-14)
    assert focus.disparity == pytest.approx(3.255, rel=1e-12)
    assert focus.z == pytest.approx(-404.0, abs=0.1)
    assert report.overlap_fraction == pytest.approx(0.12, abs=0.02)
    assert [finding.kind for finding in report.warnings] == [CameraFindingKind.OVERLAP]
    # The plane imaged onto the array is named.
    assert report.array_plane == pytest.approx(pl.paraxial.object_position(LENS, 123.3), rel=1e-14)
    assert f"{report.array_plane:.6g} mm" in repr(report) and focus.z != report.array_plane
    assert camera_report(KINDS[CameraKind.CONVENTIONAL]).array_plane is None


def test_reference_camera_in_mode_1():
    report = camera_report(camera_with(2.0, lens=the_lens(4.25)))
    assert report.kind is CameraKind.PLENOPTIC_1
    assert "virtual depth" not in str(report) and "that see a point" not in str(report)
    assert report.image_pitch_pixels == pytest.approx(22.038, abs=5e-4)
    assert report.focus[0].image_distance == report.focus[0].virtual_depth == 0.0
    assert report.focus[0].z == pytest.approx(pl.paraxial.object_position(LENS, 123.3), rel=1e-14)


def test_rays_of_the_plane_in_focus_meet_on_the_sensor():
    # The law behind focus and disparity, by rays through ideal lenses: all rays of the axial point that pass the
    # microlens at c land at c - c b/s, with b/s from the disparity; in a plenoptic 1.0 they meet on the array.
    for kind, camera in KINDS.items():
        report = camera_report(camera)
        (focus,) = report.focus
        assert report.kind is focus.kind is kind
        assert focus.z < 0 and focus.z_far < focus.z < focus.z_near, kind
        assert (report.image_pitch is None) == (kind is CameraKind.CONVENTIONAL)
        y, slope = behind_lens(camera, focus.z)
        # Rounding of positions near 100 mm and slopes, over distances near 100 mm.
        error = 1e4 * EPS * 100
        if kind in (CameraKind.PLENOPTIC_1, CameraKind.CONVENTIONAL):
            np.testing.assert_allclose(y, 0.0, atol=error)
            continue
        centre = PITCH * np.round(y / PITCH)
        landed = on_sensor(camera, y, slope, centre)
        per_neighbour = focus.disparity * SENSOR.pixel_pitch / PITCH
        sign = 1.0 if kind is CameraKind.GALILEAN else -1.0
        np.testing.assert_allclose(landed, centre * (1.0 - sign * per_neighbour), atol=error, err_msg=kind.name)


def test_depth_of_field_ends_where_the_blur_is_a_pixel():
    for kind in (CameraKind.GALILEAN, CameraKind.KEPLERIAN, CameraKind.CAMERA_ARRAY):
        camera, focus = KINDS[kind], camera_report(KINDS[kind]).focus[0]
        for z in (focus.z_far, focus.z_near):
            y, slope = behind_lens(camera, z)
            # Linear in the height on the array, so that two rays tell of the whole opening of the microlens at 0.
            ends = on_sensor(camera, y[[0, -1]], slope[[0, -1]], 0.0)
            blur = abs(np.diff(ends)[0] / np.diff(y[[0, -1]])[0]) * PITCH
            assert blur == pytest.approx(SENSOR.pixel_pitch, rel=1e-9), (kind, z)
    # In a conventional camera the spread of the marginal rays, with an iris as large as the entrance pupil.
    camera, focus = KINDS[CameraKind.CONVENTIONAL], camera_report(KINDS[CameraKind.CONVENTIONAL]).focus[0]
    for z in (focus.z_far, focus.z_near):
        assert width_of_light(camera, z) == pytest.approx(SENSOR.pixel_pitch, rel=1e-8)


def test_light_of_a_point_covers_as_many_microlenses_as_said():
    for kind in (CameraKind.GALILEAN, CameraKind.KEPLERIAN):
        camera, focus = KINDS[kind], camera_report(KINDS[kind]).focus[0]
        across = width_of_light(camera, focus.z) / PITCH
        assert across == pytest.approx(focus.lenses_across, rel=1e-9)
        area = math.pi / 4 * (PITCH * across) ** 2
        assert focus.lenses_seeing == pytest.approx(area / camera.microlenses.cell_area, rel=1e-9)


def test_depth_of_field_of_a_plenoptic_1():
    # |s| = p b / q = 43.4 mm behind and before the array at 130: before it lies the rear focus, so far is the horizon.
    camera, focus = KINDS[CameraKind.PLENOPTIC_1], camera_report(KINDS[CameraKind.PLENOPTIC_1]).focus[0]
    assert focus.z_far == -math.inf
    image = pl.paraxial.cardinal_points(LENS).rear_focus
    near = POINTS.rear_principal - 1 / (1 / POINTS.efl - 1 / (130 + PITCH * 2.0 / 0.01 - POINTS.rear_principal))
    assert focus.z_near == pytest.approx(near, rel=1e-12)
    assert focus.disparity == 0 and focus.disparity_near == pytest.approx(1.0, rel=1e-9)
    assert focus.disparity_far == pytest.approx((image - 130) * 0.01 / (PITCH * 2.0), rel=1e-9)
    # Views of neighbouring pixels, by rays: through the pixel q off the axis, a point at z_near is on the microlens
    # that lies one pitch farther. The ray leaves pixel q through the centre of that microlens, c - q / b slopes.
    y, slope = behind_lens(camera, focus.z_near)
    height = np.interp(0.01 / 2.0, *(array[np.argsort(slope)] for array in (slope, y)))
    assert abs(height) == pytest.approx(PITCH, rel=1e-6)


def test_closed_forms_of_thin_lenses():
    traced = 0
    for b, f in ((0.5, 0.3), (1.99, 2.0), (2.01, 2.0), (0.5, 5.0), (6.0, 5.0), (6.0, 0.3)):
        camera = camera_with(b, 160.0, lens=THIN, microlenses=pl.MicrolensArray(pitch=PITCH, focal_lengths=(f,)))
        (focus,) = camera_report(camera).focus
        s = 1 / (1 / b - 1 / f)
        # 1/b - 1/f loses digits where they are close: eps s / b.
        error = 8 * EPS * (1 + abs(s) / b)
        assert focus.kind is (CameraKind.GALILEAN if s > 0 else CameraKind.KEPLERIAN), (b, f)
        assert focus.image_distance == pytest.approx(s, rel=error), (b, f)
        assert focus.virtual_depth == pytest.approx(abs(s) / b, rel=error), (b, f)
        assert focus.disparity == pytest.approx(PITCH * b / abs(s) / 0.01, rel=error), (b, f)
        assert focus.effective_resolution == pytest.approx(min(1.0, b / abs(s)), rel=error), (b, f)
        image = 160.0 + s - POINTS.rear_principal
        if not image > POINTS.efl * 1.001:
            assert math.isnan(focus.z) or image < 0, (b, f)
            continue
        z = POINTS.rear_principal - 1 / (1 / POINTS.efl - 1 / image)
        assert focus.z == pytest.approx(z, rel=1e-9), (b, f)
        assert focus.magnification == pytest.approx(image / (z - POINTS.rear_principal), rel=1e-9), (b, f)
        # What neighbouring pixels under a microlens see is a pixel's pitch, back through microlens and lens.
        assert focus.object_sampling == pytest.approx(0.01 * abs(s) / b / abs(focus.magnification), rel=1e-9), (b, f)
        traced += 1
    assert traced >= 4


def test_traced_focus_is_what_focused_at_inverts():
    for z in (-300.0, -5000.0):
        focused = CAMERA.focused_at(z, criterion=pl.FocusCriterion.RMS_SPOT)
        # The search ends at 1e-11 of the image distance, times the longitudinal magnification (z / efl)^2.
        error = 1e-11 * 150 * (z / 50) ** 2
        assert camera_report(focused).focus[0].z_traced == pytest.approx(z, abs=error)
        assert camera_report(CAMERA.focused_at(z)).focus[0].z == pytest.approx(z, rel=1e-9)
    for lens in (THIN, LENS):
        report = camera_report(camera_with(2.0, lens=lens).focused_at(-math.inf, criterion=pl.FocusCriterion.RMS_SPOT))
        assert report.focus[0].z_traced == report.focus[0].z_far == -math.inf
        assert CameraFindingKind.FOCUS_OUT_OF_REACH not in [finding.kind for finding in report.warnings]


def test_traced_f_number_tends_to_the_paraxial_one():
    # Aberrations of the pupil change the slope by a part that falls with the square of the stop.
    for model in pl.LensModel:
        off = []
        for semi_diameter in (4.0, 2.0, 1.0):
            lens = LENS.with_model(model).with_stop(pl.CircularStop(semi_diameter))
            off.append(illumination.clear_pupil(lens, 123.3, 587.6)[0] / paraxial_cone(lens, 123.3, 587.6).slope - 1.0)
        if model is not pl.LensModel.EXACT:
            np.testing.assert_allclose(off, 0.0, atol=1e-9)
            continue
        assert np.divide(off[:2], off[1:]) == pytest.approx(4.0, rel=0.1)


def test_f_numbers_and_images_follow_the_exit_pupil():
    report = camera_report(CAMERA)
    distance, diameter = 123.3 - POINTS.exit_pupil, 2 * POINTS.exit_pupil_semi_diameter
    assert report.exit_pupil_distance == pytest.approx(distance, rel=1e-12)
    assert report.working_f_number_paraxial == pytest.approx(distance / diameter, rel=1e-12)
    assert report.microlens_f_number == pytest.approx(1.7 / PITCH, rel=1e-14)
    assert report.image_diameter == pytest.approx(1.7 / report.working_f_number, rel=1e-12)
    assert report.f_number_match == pytest.approx(report.microlens_f_number / report.working_f_number, rel=1e-12)
    assert report.image_pitch == pytest.approx(PITCH * (1 + 1.7 / distance), rel=1e-12)
    assert report.image_fill == pytest.approx(report.image_diameter / report.image_pitch, rel=1e-14)


def test_a_telecentric_lens_repeats_images_at_the_pitch():
    # The iris in the front focus of a singlet: its exit pupil is infinitely far, and the cone at the array is that of
    # the iris over the focal length.
    surfaces = pl.load_lens("singlet-100mm-f4").elements[1:]
    plain = pl.LensStack([pl.CircularStop(4.0, thickness=50.0), *surfaces])
    points = pl.paraxial.cardinal_points(plain)
    lens = pl.LensStack([pl.CircularStop(4.0, thickness=50.0 - points.front_focus), *surfaces])
    place = pl.paraxial.cardinal_points(lens).rear_focus
    for model in (pl.LensModel.EXACT, pl.LensModel.PARAXIAL):
        report = camera_report(camera_with(2.0, place, lens=lens.with_model(model)))
        assert abs(report.exit_pupil_distance) > 1e12
        assert report.image_pitch == pytest.approx(PITCH, rel=1e-12)
        assert report.working_f_number_paraxial == pytest.approx(points.efl / 8.0, rel=1e-9)


TESSAR, HEXAGON = pl.load_lens("tessar-102mm-f4.5"), pl.PolygonStop(blades=6, semi_diameter=4.5)
SQUARE = {"lattice": pl.Lattice.SQUARE}
WHITE_CASES = {
    # Lens, iris, place of the array behind the last vertex or the iris, array, distance to the sensor.
    "galilean": (LENS, 5.0, 123.3, {}, 1.7),
    "stopped down": (LENS, 4.0, 123.3, {}, 1.7),
    "hexagonal iris": (LENS, HEXAGON, 123.3, {}, 1.7),
    "round openings": (LENS, 4.0, 123.3, {"aperture": pl.optics.MicrolensAperture(fill_factor=0.6)}, 1.7),
    "keplerian": (LENS, 3.0, 140.0, {}, 2.4),
    "1.0": (LENS, 4.0, 134.6, {}, 2.0),
    "1.0, square": (LENS, 4.25, 134.6, SQUARE, 2.0),
    "f/2.6, galilean": (LENS, 17.0, 134.6, {"focal_lengths": (0.6,)}, 0.5),
    # Rims end the light at f/2.67, Gaussian optics say f/2.25: 26 % of the sensor where rays leave 62 % dark.
    "f/2.6, 1.0": (LENS, 20.0, 134.6, {"focal_lengths": (0.4,), **SQUARE}, 0.4),
    "tessar, wide open": (TESSAR, 12.0, float(TESSAR.vertices[-1]) + 95.0, {"focal_lengths": (0.8,), **SQUARE}, 0.8),
    "tessar, two types": (TESSAR, 6.0, float(TESSAR.vertices[-1]) + 95.0, {"focal_lengths": (1.2, 1.3)}, 1.1),
    "thin lens": (THIN, 4.0, 123.3, SQUARE, 1.8),
}


@pytest.mark.parametrize("name", WHITE_CASES)
def test_dark_part_is_that_of_the_white_image(name):
    lens, iris, place, fields, b = WHITE_CASES[name]
    array = pl.MicrolensArray(**{"pitch": PITCH, "focal_lengths": (FOCAL,), **fields})
    pixels, stop = 160, iris if isinstance(iris, pl.PolygonStop) else pl.CircularStop(iris)
    sensor = pl.Sensor((264, 184), PITCH / pixels)  # a cell and its border, for all lattices
    camera = pl.PlenopticCamera(lens.with_stop(stop), sensor, place, array, b)
    report = camera_report(camera)
    # Pixels that are lit by less than a 16th may get no ray: at most 0.2 % of all, against 64 samples.
    white = pl.render_white(camera, samples=16, progress=False).image[..., 0]
    y, x = (np.arange(n) - (n - 1) / 2 for n in sensor.shape)
    cells = np.stack(np.meshgrid(-x, -y), axis=-1) * sensor.pixel_pitch * PITCH / report.image_pitch
    # Pixels in one cell, whose sides are the array's; those along the border of an image are lit in part.
    inside = (np.abs(cells @ np.linalg.inv(array.basis)) < 0.5).all(axis=-1)
    assert not (inside[[0, -1]].any() or inside[:, [0, -1]].any())
    lit = white > 0
    core = lit.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        core &= np.roll(lit, step, axis)
    least, most = 1 - lit[inside].mean(), 1 - core[inside].mean()
    assert least - 0.004 < report.dark_fraction < most + 0.004


def test_microlenses_that_image_the_pupil_onto_the_sensor_light_it_as_pinholes_do():
    # 1/f = 1/b + 1/D. The iris is near, so that images lie far from their microlenses: 1 + b / D = 5/3.
    b, f = 2.0, 1 / (1 / 2.0 + 1 / 3.0)
    thin = pl.MicrolensArray(PITCH, (f,))
    wide = camera_report(camera_with(b, 3.0, lens=NO_LENS, microlenses=thin))
    assert wide.image_pitch == pytest.approx(PITCH * 5 / 3, rel=1e-12)
    assert wide.image_border_pixels == pytest.approx(0.0, abs=1e-9)
    for fill in (0.7, 1.3):
        lens = NO_LENS.with_stop(pl.CircularStop(fill / wide.image_fill))
        reports = [
            camera_report(camera_with(b, 3.0, lens=lens, microlenses=array))
            for array in (thin, dataclasses.replace(thin, model=pl.optics.MicrolensModel.PINHOLE))
        ]
        assert reports[0].dark_fraction == pytest.approx(reports[1].dark_fraction, abs=1e-2)
        assert reports[0].overlap_fraction == pytest.approx(reports[1].overlap_fraction, abs=1e-2)
        # Discs of 0.7 of their distance leave 1 - 0.49 pi / (2 sqrt(3)); larger than 2 / sqrt(3), they leave nothing.
        dark = max(0.0, 1 - fill**2 * math.pi / 12**0.5) if fill < 1 else 0.0
        assert reports[1].dark_fraction == pytest.approx(dark, abs=0.005)


def test_the_corner_sees_the_iris_at_an_angle():
    # The corner of the sensor belongs to the microlens at corner / (1 + b / D), D from the pupil.
    for model, pupil in ((pl.LensModel.NONE, 0.0), (pl.LensModel.PARAXIAL, POINTS.exit_pupil)):
        report = camera_report(camera_with(2.2, lens=LENS.with_model(model)))
        distance = 123.3 - pupil
        reach = SENSOR.half_diagonal / (1 + 2.2 / distance)
        assert math.tan(report.corner_chief_angle) == pytest.approx(reach / distance, rel=1e-9)
        assert report.corner_pupil_fraction == 1.0


def test_several_types_are_each_what_they_are_alone():
    together, *alone = (
        camera_report(camera_with(1.7, lens=THIN, microlenses=pl.MicrolensArray(PITCH, focal_lengths))).focus
        for focal_lengths in ((1.7, 2.0, 2.4), (1.7,), (2.0,), (2.4,))
    )
    assert [(dataclasses.replace(focus, type=0),) for focus in together] == alone
    assert [focus.kind.name for focus in together] == ["PLENOPTIC_1", "GALILEAN", "GALILEAN"]


def test_microlenses_are_counted_as_listed():
    for array in (
        pl.MicrolensArray(0.217, (2.0,)),
        pl.MicrolensArray(0.32, (2.0,), pl.Lattice.SQUARE),
        pl.MicrolensArray((0.3, 0.1), (2.0,), pl.Lattice.RECTANGULAR),
        pl.MicrolensArray(0.7, (2.0,), pl.Lattice.FREE, centres=[(0, 0), (0.5, 0), (0, 0.6), (4, 4), (2.5, -2.5)]),
    ):
        camera = camera_with(1.7, microlenses=array)
        for vergence in (0.0, 1 / 128.5, -0.01):
            half = 2.56 / (1 + 1.7 * vergence)
            listed = array.lenses((-half, -half), (half, half))
            assert illumination.images_on_sensor(camera, vergence) == len(listed), array.lattice


def test_distance_of_neighbours():
    hexagonal = pl.MicrolensArray(0.2, (2.0,))
    centres = hexagonal.lenses((-2, -2), (2, 2)).centre
    free = dataclasses.replace(hexagonal, lattice=pl.Lattice.FREE, centres=centres)
    assert neighbour_distance(free) == pytest.approx(0.2, rel=1e-12)
    assert neighbour_distance(pl.MicrolensArray((0.3, 0.1), (2.0,), pl.Lattice.RECTANGULAR)) == 0.1
    listed, regular = (camera_report(camera_with(1.7, lens=THIN, microlenses=array)) for array in (free, hexagonal))
    assert listed.image_pitch == pytest.approx(regular.image_pitch)


def kinds_of(camera):
    return {finding.kind.name for finding in camera_report(camera).warnings}


def test_findings():
    # An ideal lens, whose report costs less, where rims do not matter.
    ideal, small, wide = (PARAXIAL.with_stop(pl.CircularStop(stop)) for stop in (5.0, 3.0, 8.0))
    assert {"DARK_GAPS", "F_NUMBER_MISMATCH"} <= kinds_of(camera_with(1.7, lens=small))
    open_iris = kinds_of(camera_with(1.7, lens=wide))
    assert {"OVERLAP", "F_NUMBER_MISMATCH"} <= open_iris and "DARK_GAPS" not in open_iris
    assert "TOUCHES_LENS" in kinds_of(camera_with(1.7, 30.35, lens=ideal))
    assert "TOUCHES_LENS" not in kinds_of(camera_with(1.7, 31.0, lens=ideal))
    assert "FOCUS_OUT_OF_REACH" in kinds_of(camera_with(1.7, 60.0, lens=ideal))
    assert "FEW_VIEWS" in kinds_of(camera_with(0.9, 133.0, lens=ideal))
    assert "FOCUSED_AT_INFINITY" in kinds_of(camera_with(1.99, 110.0, lens=ideal))
    assert "FEW_PIXELS" in kinds_of(camera_with(1.7, lens=ideal, microlenses=pl.MicrolensArray(0.03, (2.0,))))
    assert "CUT_OFF_IMAGES" in kinds_of(camera_with(1.7, lens=LENS.inserted(pl.CircularStop(4.5), z=60.0)))
    assert "DEPTH_GAP" in kinds_of(camera_with(1.7, lens=ideal, microlenses=pl.MicrolensArray(PITCH, (1.8, 2.4))))
    # 51.2 mm hold 235.9 microlenses and 232.9 images: 1.7 / 128.5 of them fewer.
    large = dataclasses.replace(CAMERA, lens=ideal, sensor=pl.Sensor((5120, 512), 0.01))
    assert "PERSPECTIVE" not in kinds_of(CAMERA)
    (message,) = (f for f in camera_report(large).warnings if f.kind is CameraFindingKind.PERSPECTIVE)
    assert "3.1 fewer images" in str(message)


def test_the_iris_named_for_dark_gaps_matches():
    small = LENS.with_stop(pl.CircularStop(3.0))
    for camera in (camera_with(1.7, lens=small), camera_with(0.3, 134.0, LENS, pl.MicrolensArray(0.217, (0.4,)))):
        finding = next(one for one in camera_report(camera).warnings if one.kind is CameraFindingKind.DARK_GAPS)
        iris, *limit = (float(number) for number in re.findall(r"([\d.]+) mm", str(finding)))
        matched = dataclasses.replace(camera, lens=LENS.with_stop(pl.CircularStop(iris)).with_model(PARAXIAL.model))
        report = camera_report(matched)
        border = report.image_border_pixels / report.image_pitch_pixels
        assert report.image_fill == pytest.approx(1.0 - border, abs=1e-3)
        # Rims end the light of an iris of f/0.8 at f/2.6: then the finding names their limit.
        wide = dataclasses.replace(camera, lens=LENS.with_stop(pl.CircularStop(min([iris, *limit]))))
        assert camera_report(wide).image_fill == pytest.approx(1.0 - border, abs=0.01) or limit


def test_array_inside_a_concave_last_surface():
    # The vertex is at 5 mm, the rim of radius 20 at 5 + 20 - sqrt(400 - 144) = 9 mm.
    front = pl.Surface(30.0, 4.0, pl.ConstantMedium(1.7), semi_diameter=12.0)
    lens = pl.LensStack([pl.CircularStop(3.0, thickness=1.0), front, pl.Surface(20.0, semi_diameter=12.0)])
    report = camera_report(camera_with(1.7, 7.0, lens=lens))
    assert report.clearance == pytest.approx(-2.0, abs=1e-9)
    assert CameraFindingKind.INSIDE_LENS in [finding.kind for finding in report.warnings]


def test_every_model_has_a_report():
    models = pl.optics.MicrolensModel
    pairs = [*((model, models.THIN) for model in pl.LensModel), *((pl.LensModel.PARAXIAL, model) for model in models)]
    for model, array_model in pairs:
        index = 100.0 if array_model is models.FLAT_HIGH_INDEX else 1.5
        array = pl.MicrolensArray(PITCH, (FOCAL,), model=array_model, index=index)
        report = camera_report(camera_with(2.004, lens=LENS.with_model(model), microlenses=array))
        assert (report.efl is None) == (model is pl.LensModel.NONE)
        assert report.working_f_number == pytest.approx(report.working_f_number_paraxial, rel=0.01), model
        if array_model is models.PINHOLE:
            assert report.image_border_pixels == 0.0
            assert (report.focus[0].z_far, report.focus[0].z_near) == (-math.inf, LENS.vertices[0])


def test_polygons_count_as_their_circles():
    hexagon, circle = camera_report(camera_with(1.7, lens=the_lens(pl.PolygonStop(6, 5.0)))), camera_report(CAMERA)
    assert hexagon.working_f_number == circle.working_f_number
    assert hexagon.dark_fraction > circle.dark_fraction + 0.03


def test_a_report_prints_as_a_table():
    text = repr(camera_report(CAMERA))
    for words in ("Galilean", "mm", "pixels", "virtual depth", "6.66667", "OVERLAP", "13 %"):
        assert words in text
    assert max(map(len, text.splitlines())) <= 110
    plain = repr(camera_report(KINDS[CameraKind.CONVENTIONAL]))
    assert "virtual depth" not in plain and "microlens" not in plain and "no warnings" in plain
    with refused("camera is a"):
        camera_report(LENS)


def test_the_figure_draws_what_the_report_says():
    plt = pytest.importorskip("matplotlib.pyplot")
    from plenoptic.plots.camera import plot_camera

    report = camera_report(CAMERA)
    section, microlenses = plot_camera(CAMERA, report).axes
    lines = {line.get_label(): line for line in section.lines}
    assert set(lines["array"].get_xdata()) == {123.3} and set(lines["sensor"].get_xdata()) == {125.0}
    # The light under the microlens on the axis ends on the sensor as wide as its image; the next one is a pitch away.
    ends = [patch.get_xy() for patch in microlenses.patches if patch.get_xy()[:, 0].max() > 0]
    widths = [np.ptp(corners[:, 1][corners[:, 0] == 1.7]) for corners in ends]
    np.testing.assert_allclose(widths, report.image_diameter, rtol=1e-12)
    middles = [corners[:, 1][corners[:, 0] == 1.7].mean() for corners in ends]
    np.testing.assert_allclose(np.diff(middles), report.image_pitch, rtol=1e-12)
    conventional = KINDS[CameraKind.CONVENTIONAL]
    assert len(plot_camera(conventional, camera_report(conventional)).axes) == 1
    plt.close("all")
