"""Cameras as built: what moves together changes nothing, what moves alone changes what geometry says."""

import dataclasses
import math

import camera_helpers
import numpy as np
import pytest
from camera_helpers import CAMERA, agree, bare_camera, compiled_anew, refused, the_lens, with_array

import plenoptic as pl
from plenoptic.camera import camera_record as camera_records
from plenoptic.optics.lens.placement import rotation_about_axes

THIN = the_lens(model=pl.LensModel.THIN)
REGION = np.s_[200:224, 230:262]
LENS_PART, ARRAY, SENSOR = pl.CameraPart


def white(camera, samples=64, region=REGION, seed=0):
    return camera_helpers.white(camera, samples, region, seed)


def together(camera, shift, tilt):
    """All parts moved as one body about the centre of the iris."""
    turn, whole = rotation_about_axes(tilt), {}
    for name, z in (("lens", 0.0), ("microlenses", camera.stop_to_microlenses), ("sensor", camera.z_sensor)):
        place = np.array([0.0, 0.0, z])
        whole[f"{name}_placement"] = pl.optics.Placement(shift=turn @ place - place + shift, rotation=turn)
    return dataclasses.replace(camera, **whole)


def test_what_shifts_together_changes_no_bit_and_what_turns_together_nothing_else():
    plain = white(CAMERA).image
    assert np.array_equal(white(together(CAMERA, (1.0, -2.0, 4.0), (0, 0, 0))).image, plain)
    for tilt in ((0.2, 0.1, 0.0), (0.0, 0.0, 1.0)):
        # Rounding moves single paths over rims; where none is near, pixels agree to rounding of float32.
        turned = white(together(CAMERA, (0, 0, 0), tilt)).image
        assert np.median(np.abs(turned - plain) / plain.max()) < 1e-6, tilt
        assert abs(turned.sum(dtype=np.float64) / plain.sum(dtype=np.float64) - 1) < 2e-3, tilt


def test_turned_and_posed_cameras_see_the_same():
    # A camera whose parts all turn by the motion T is the camera posed by T.
    scene = pl.check_scene()
    tilt, shift = (0.004, -0.003, 0.0), (0.3, 0.2, 1.0)
    built = together(CAMERA, shift, tilt)
    posed = dataclasses.replace(CAMERA, pose=pl.Pose(rotation_about_axes(tilt), np.array(shift)))
    a, b = (pl.render(scene, each, samples=32, region=REGION, progress=False) for each in (built, posed))
    assert np.median(np.abs(a.image - b.image)) < 1e-6 * b.image.max()
    agree(a, b)


def test_a_lattice_is_the_same_after_a_step_and_a_sixth_of_a_turn():
    basis = CAMERA.microlenses.basis
    stepped = CAMERA.moved(ARRAY, shift=(*(2 * basis[0] - basis[1]), 0.0))
    assert np.allclose(white(stepped).image, white(CAMERA).image, rtol=1e-4, atol=1e-6)
    agree(white(CAMERA.moved(ARRAY, tilt=(0, 0, math.pi / 3)), 256), white(CAMERA, 256))


@pytest.mark.slow
def test_tilts_tend_to_none():
    for part in (ARRAY, SENSOR, LENS_PART):
        agree(white(CAMERA.moved(part, tilt=(1e-7, -1e-7, 0.0)), 256), white(CAMERA, 256))


def test_a_tilted_conventional_camera_weighs_light_by_both_cosines():
    # The pupil is far away compared with its size: E = L A cos(sensor) cos(axis) / r^2 for each pixel.
    lens = the_lens(2.0, pl.LensModel.THIN)
    camera = bare_camera(lens, shape=(64, 64), pitch=0.2)
    tilt = (math.radians(20.0), math.radians(-10.0), 0.0)
    shot, turn = white(camera.moved(SENSOR, tilt=tilt), 256, None), rotation_about_axes(tilt)
    points = np.concatenate([camera.sensor.centre_of(*np.mgrid[:64, :64]), np.zeros((64, 64, 1))], axis=-1) @ turn.T
    points[..., 2] += camera.z_sensor
    principal = pl.paraxial.cardinal_points(lens, 587.6)
    ray = np.array([0.0, 0.0, principal.rear_principal]) - points
    area = math.pi * principal.entrance_pupil_semi_diameter**2
    expected = area * (-ray @ turn[:, 2]) * (-ray[..., 2]) / (ray**2).sum(axis=-1) ** 2
    # The pupil is 4 mm wide at 130 mm: corrections of second order, (2/130)^2. Blocks of 16 x 16 pixels: by errors.
    image, error = shot.image[..., 0].astype(float), shot.standard_error[..., 0].astype(float)
    sums, expected_sums, square = (a.reshape(4, 16, 4, 16).sum(axis=(1, 3)) for a in (image, expected, error**2))
    assert np.all(np.abs(sums - expected_sums) < 4 * np.sqrt(square) + 5e-4 * expected_sums)
    assert np.all(np.sqrt(square) < 2e-3 * expected_sums)


def focused():
    """A thin lens and a sensor in the image of z = -404."""
    return pl.PlenopticCamera(lens=THIN, sensor=pl.Sensor((400, 400), 0.02), stop_to_microlenses=130.0).focused_at(-404)


def test_a_tilted_sensor_sees_a_tilted_plane_sharply():
    # Scheimpflug: a thin lens images the plane z = -404 + k y onto a plane, and a sensor in it sees points as points.
    camera, points = focused(), pl.paraxial.cardinal_points(THIN, 587.6)
    f, k, y = points.efl, 0.3, np.linspace(-8.0, 8.0, 5)
    ahead, behind = 404.0 + points.rear_principal - k * y, camera.z_sensor - points.rear_principal
    image = f * ahead / (ahead - f)
    slope = np.polyfit(-y * image / ahead, image - behind, 1)[0]

    def blur(tilt):
        tilted = camera.moved(SENSOR, tilt=(math.atan(tilt), 0.0, 0.0))
        landed = [pl.camera.landing_points(tilted, (0.0, each, -404.0 + k * each), rays=512).position for each in y]
        return max(float(np.ptp(place, axis=0).max()) for place in landed)

    assert blur(slope) < 1e-9 < 1e-3 < blur(0.0) < blur(-slope)


def test_what_is_shifted_moves_the_picture_the_right_way():
    # The sensor reads out rotated by 180 degrees: moved to +x, it sees the picture move right; moved to +y, up. The
    # lens takes the image with it by 1 - magnification.
    camera = focused()
    middle, pixels = camera.project((0.0, 0.0, -404.0)).pixel[0], 1.0 / 0.02
    principal = pl.paraxial.cardinal_points(THIN, 587.6).rear_principal
    magnification = -(camera.z_sensor - principal) / (404.0 + principal)
    for shift, row, column in (((1.0, 0.0, 0.0), 0.0, 1.0), ((0.0, 1.0, 0.0), -1.0, 0.0)):
        by_sensor, by_lens = (
            camera.moved(part, shift=shift).project((0.0, 0.0, -404.0)).pixel[0] - middle
            for part in (SENSOR, LENS_PART)
        )
        assert by_sensor == pytest.approx([row * pixels, column * pixels], abs=1e-9)
        less = 1 - magnification
        assert by_lens == pytest.approx([-row * pixels * less, -column * pixels * less])


MOVES = (
    [(ARRAY, (0.5, -0.3, 0.2), (0.05, -0.03, 1.0))],
    [(SENSOR, (0.5, -0.3, 0.1), (0.14, -0.09, 0.3))],
    [(LENS_PART, (0.5, -0.3, 0.2), (0.05, -0.03, 1.0))],
    [(ARRAY, (0, 0, 0), (0.14, 0.0, 0.0)), (SENSOR, (0, 0, 0), (0.1, 0.05, 0.0))],
)
MODELS = pl.optics.MicrolensModel


TWO = [(MOVES[2], MODELS.THIN), (MOVES[3], MODELS.SPHERICAL)]
ALL = [(moves, model) for moves in MOVES for model in (MODELS.THIN, MODELS.SPHERICAL)]


@pytest.mark.parametrize("cases", [TWO, pytest.param(ALL, marks=pytest.mark.slow)], ids=["two", "all"])
def test_wider_margins_change_no_image(cases, monkeypatch):
    region, compile_camera = np.s_[200:216, 20:44], camera_records.camera_record

    def with_slack(camera):
        tables = compile_camera(camera)
        return tables._replace(pupil=tables.pupil._replace(margin=tables.pupil.margin + 1.0))

    for moves, model in cases:
        camera = with_array(CAMERA, model=model)
        for part, shift, tilt in moves:
            camera = camera.moved(part, shift=shift, tilt=tilt)
        narrow = white(camera, 512, region)
        with monkeypatch.context() as patch:
            patch.setattr("plenoptic.camera.cache.camera_record", with_slack)
            wide = white(compiled_anew(camera), 1024, region, seed=1)
        agree(narrow, wide, case=(moves, model))


def test_the_design_is_kept_beside_what_was_built():
    shifted = CAMERA.moved(ARRAY, shift=(0.02, 0.0, 0.0))
    built = shifted.moved(ARRAY, tilt=(0.0, 0.0, 0.01)).moved(SENSOR, shift=(0, 0.01, 0))
    assert built != CAMERA and built.design == CAMERA
    assert built.microlenses_placement.shift.tolist() == [0.02, 0.0, 0.0]
    assert with_array(CAMERA, imperfections=pl.MicrolensImperfections(pitch_jitter=0.001)).design == CAMERA


def test_impossible_assemblies_are_refused():
    out_of_place = pl.optics.Placement(shift=(0.1, 0, 0))
    for make, message in (
        (lambda: CAMERA.moved(SENSOR, tilt=(math.radians(50.0), 0.0, 0.0)), "behind the part in front"),
        (lambda: CAMERA.moved(ARRAY, shift=(0.0, 0.0, -100.0)), "last vertex"),
        (lambda: dataclasses.replace(bare_camera(), microlenses_placement=out_of_place), "without microlenses"),
        (lambda: CAMERA.moved(7), "CameraPart"),
        (lambda: CAMERA.moved(SENSOR, shift=0.1), "shift has shape"),
    ):
        with refused(message):
            make()


def test_built_values_stand_beside_those_of_the_design():
    moved = CAMERA.moved(SENSOR, shift=(0.02, 0.0, 0.1), tilt=(0.0, 0.01, 0.0))
    # The report is on the design, and says so.
    said, plain = ({finding.kind for finding in camera.report().warnings} for camera in (moved, CAMERA))
    assert pl.camera.CameraFindingKind.OUT_OF_PLACE in said - plain
    built = pl.camera.as_built(moved)
    assert built["sensor: shift x"].built == pytest.approx(0.02)
    assert built["sensor: tilt about y"].built == pytest.approx(10.0)
    assert (built["array to sensor"].design, built["array to sensor"].built) == pytest.approx((1.7, 1.8))
    # Its edges lie 2.56 mm from the middle.
    assert built["array to sensor, least at a corner"].built == pytest.approx(1.8 - 2.56 * math.sin(0.01))
    with pytest.raises(KeyError, match="there are sensor"):
        built["sensor: shift y"]
