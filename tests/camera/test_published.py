"""Published cameras: their numbers, and what the page about them states."""

import math
from pathlib import Path

import numpy as np
import pytest
from camera_helpers import refused, white

import plenoptic as pl
import plenoptic.truth.pair_geometry
from plenoptic.camera.design.published import published_camera

PAGE = Path(__file__).parents[2] / "docs" / "cameras.md"
CAMERAS = {name: pl.load_camera(name) for name in pl.camera_names()}
REPORTS = {name: camera.report() for name, camera in CAMERAS.items()}


def thin_lens_images(exit_pupil, b, pitch, pixel):
    """Distance of micro images in pixels, as seen from an exit pupil."""
    return pitch * (1.0 + b / exit_pupil) / pixel


def test_micro_images_are_as_far_apart_as_published():
    published = {
        # Measured in white images of the data set; two directions of the lattice.
        "raytrix-r12-like": (23.3126, 6e-4),
        # Exit pupils by the files. That of our lens for the F01 is nearer: 0.025 mm (1 / 28 mm - 1 / 224 mm) = 8e-4.
        "lytro-f01-like": (thin_lens_images(223.577, 0.025, 0.014, 0.0014), 8.2e-4),
        "lytro-illum-like": (thin_lens_images(97.286, 0.037, 0.020, 0.0014), 1e-5),
        # Whole numbers of pixels.
        "raytrix-r29-like": (31, 0.5 / 31),
        "light-field-microscope-40x": (15, 0.5 / 15),
    }
    for name, (pixels, tolerance) in published.items():
        assert REPORTS[name].image_pitch_pixels == pytest.approx(pixels, rel=tolerance), name


def test_f_numbers_and_numbers_of_microlenses_are_as_published():
    for name, f_number in {"lytro-f01-like": 1.92, "lytro-illum-like": 2.2, "raytrix-r12-like": 4.0}.items():
        assert REPORTS[name].f_number == pytest.approx(f_number, rel=1e-5), name
    # An objective of magnification 40 and NA 0.95: f/(40 / 1.9) at its image.
    microscope = REPORTS["light-field-microscope-40x"]
    assert microscope.working_f_number_paraxial == pytest.approx(40 / 1.9, rel=1e-4)
    assert microscope.focus[0].magnification == pytest.approx(-40.0, rel=1e-3)
    assert REPORTS["raytrix-r29-like"].microlens_f_number == pytest.approx(7.0, rel=1e-9)
    for name, number in {"lytro-illum-like": 541 * 434, "raytrix-r12-like": 176 * 152}.items():
        assert REPORTS[name].microlenses == pytest.approx(number, rel=5e-3), name


def test_the_r12_is_the_calibrated_thin_lens_camera():
    camera, report = CAMERAS["raytrix-r12-like"], REPORTS["raytrix-r12-like"]
    points = pl.paraxial.cardinal_points(camera.lens)
    assert camera.stop_to_microlenses - points.rear_principal == pytest.approx(56.859967, abs=1e-4)
    for f, focus in zip(camera.microlenses.focal_lengths, report.focus, strict=True):
        image = 56.859967 + 1.0 / (1.0 / camera.microlenses_to_sensor - 1.0 / f)
        distance = 1.0 / (1.0 / 49.885 - 1.0 / image)
        assert points.front_principal - focus.z == pytest.approx(distance, rel=1e-5)


def test_rows_of_microlenses_lie_along_the_sensor():
    for name in ("raytrix-r12-like", "raytrix-r29-like", "lytro-illum-like", "lytro-f01-like"):
        centres = pl.microlens_centres(CAMERAS[name], margin=-0.47 * CAMERAS[name].sensor.size[0])
        steps = centres.pixel - centres.pixel[np.hypot(*centres.on_array.T).argmin()]
        nearest = steps[np.argsort(np.hypot(*steps.T))[1:7]]
        # Two of six neighbours; in other rows they are sqrt(3) / 2 of the distance away.
        same_row = np.abs(nearest[:, 0]) < 1e-3
        assert same_row.sum() == 2 and np.abs(nearest[~same_row, 0]).min() > 5, name


def test_the_array_of_the_r29_has_210_lenses_in_a_row():
    array = CAMERAS["raytrix-r29-like"].microlenses
    rows = array.lenses((-0.3, -math.inf), (0.3, math.inf))
    assert set(np.unique(rows.design[:, 0], return_counts=True)[1].tolist()) == {209, 210}


def test_the_papers_cameras_are_the_examples():
    for name, kind in (("michels-2018-plenoptic-2", "GALILEAN"), ("michels-2018-plenoptic-1", "PLENOPTIC_1")):
        assert CAMERAS[name] == pl.camera.example_camera(pl.CameraKind[kind])


def test_the_phone_has_dual_pixels_for_its_chief_rays(monkeypatch):
    monkeypatch.setattr(plenoptic.truth.pair_geometry, "_SAMPLES", 1 << 12)
    camera, report = CAMERAS["google-pixel-2-like"], REPORTS["google-pixel-2-like"]
    assert math.prod(camera.sensor.shape) == pytest.approx(12.2e6, rel=1e-3)
    assert report.f_number == pytest.approx(1.8, rel=1e-6)
    assert camera.sensor.angular_response.pupil_distance == pytest.approx(report.exit_pupil_distance, rel=1e-3)
    # Two views with a baseline B have the disparity B f (1 / z - 1 / z_focus) / pitch: 1.14 mm, of which gaps are 0.1.
    geometry, middle = pl.sensor.pair_geometry(camera), (1512, 1513, 2016, 2017)
    near, far = (float(geometry.disparity(z, region=middle)[0, 0]) for z in (500.0, math.inf))
    assert (near - far) * 500.0 * 0.0014 / 4.4 == pytest.approx(1.0, abs=0.2)
    assert camera.sensor.half_diagonal / 4.4 == pytest.approx(math.hypot(12.0, 18.0) / 27.0, rel=5e-3)


def test_every_camera_makes_an_image_and_names_its_source():
    for name, camera in CAMERAS.items():
        rows, columns = camera.sensor.shape
        region = np.s_[rows // 2 - 16 : rows // 2 + 16, columns // 2 - 16 : columns // 2 + 16]
        shot = white(camera, samples=4, region=region)
        assert np.isfinite(shot.image).all() and (shot.image > 0).mean() > 0.5, name
        published = published_camera(name)
        assert all(text in repr(published) for text in (name, published.source, *published.published))
        assert published.published and published.assumed


def test_an_unknown_camera_is_refused():
    with refused("'lytro'.*lytro-f01-like"):
        pl.load_camera("lytro")
    with refused("no camera"):
        pl.load_camera(["lytro"])


def rows_of_page():
    """Rows of the page's table by the cameras' reports."""
    for name, report in REPORTS.items():
        if CAMERAS[name].microlenses is None:
            continue
        focused = report.kind is not pl.CameraKind.PLENOPTIC_1
        depth = ", ".join(f"{focus.virtual_depth:.2f}" for focus in report.focus) if focused else "-"
        lens = f"f/{report.f_number:.2f}, f/{report.working_f_number_paraxial:.2f}"
        yield (
            f"| `{name}` | {report.image_pitch_pixels:.3f} | {report.image_fill:.3f} | {lens} "
            f"| f/{report.microlens_f_number:.2f} | {depth} | {100 * report.corner_pupil_fraction:.0f} % "
            f"| {report.microlenses} |"
        )


def test_the_page_states_what_is_measured():
    page = PAGE.read_text(encoding="utf-8")
    missing = [row for row in rows_of_page() if row not in page]
    assert not missing, "\n".join(missing)
