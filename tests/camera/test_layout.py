"""The picture of a camera: rays of one pixel, what the camera sees, key numbers."""

import dataclasses
import math

import numpy as np
from camera_helpers import CAMERA as GALILEAN
from camera_helpers import bare_camera

import plenoptic as pl
from plenoptic.camera.report.layout import camera_frustum, section_rays
from plenoptic.plots.notebook.camera_html import report_html

LENS, SENSOR, ARRAY = GALILEAN.lens, GALILEAN.sensor, GALILEAN.microlenses
ONE, CONVENTIONAL = pl.PlenopticCamera(LENS, SENSOR, 134.6, ARRAY, 2.0), bare_camera()
TILTED = GALILEAN.moved(pl.CameraPart.SENSOR, tilt=(0.03, 0.0, 0.0)).moved(pl.CameraPart.LENS, tilt=(0.02, 0.0, 0.0))
ROUND = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.01)
WALLED = pl.MicrolensArray(10.0, (8.0,), pl.Lattice.SQUARE, walls=pl.optics.Walls.OPAQUE, aperture=ROUND)
WALLED = pl.PlenopticCamera(pl.no_lens(25.0), pl.Sensor(shape=(300, 300), pixel_pitch=0.1), 1.0, WALLED, 8.1)


def test_rays_lie_on_the_pixel_and_in_its_microlens():
    for camera in (GALILEAN, ONE, TILTED):
        rays = section_rays(camera)
        at = rays.sensor.inverse().points(rays.paths[:, 0])
        np.testing.assert_allclose(at, np.tile([*SENSOR.centre_of(*rays.pixel), 0.0], (len(at), 1)), atol=1e-12)
        in_array = rays.array.inverse().points(rays.paths[:, 1])
        assert np.abs(in_array[:, 2]).max() < 1e-12
        assert np.hypot(*(in_array[:, :2] - in_array[:, :2].mean(axis=0)).T).max() <= 0.217 / 2 + 1e-12
        assert np.isfinite(rays.directions).all()


def test_rays_of_a_pixel_meet_where_it_is_in_focus_or_in_the_iris():
    """In a camera 2.0 the rays of a pixel through a microlens meet in the plane in focus, to the lens's aberrations."""
    rays, focus = section_rays(GALILEAN), GALILEAN.report().focus[0]
    along = (focus.z - rays.paths[:, -1, 2]) / rays.directions[:, 2]
    hits = rays.paths[:, -1] + along[:, None] * rays.directions
    # The pixel's image is m times its size, and the double Gauss blurs by some 20 um at the array (f/8).
    assert np.ptp(hits[:, 1]) < 0.2 * abs(0.217 / focus.magnification)
    # In a camera 1.0 they come through one place of the iris: microlenses image the exit pupil onto the sensor.
    rays = section_rays(ONE)
    at_iris = rays.paths[:, 1 + len(LENS.elements) - LENS.iris_index, :2]
    # A microlens of 0.217 mm at f/9.2 images the pupil, which is 130 mm away and not infinitely far.
    assert np.ptp(at_iris[:, 1]) < 0.25


def test_the_frustum_meets_the_plane_in_focus_in_the_field():
    frustum, report = GALILEAN.frustum, GALILEAN.report()
    focus = report.focus[0]
    np.testing.assert_allclose(frustum.in_focus[:, 2], focus.z)
    half, z_array = 0.5 * SENSOR.size[0] / (1 + 1.7 / report.exit_pupil_distance), report.array_plane
    # The chief ray meets that plane at the height of the array's image as seen from the entrance pupil: within 5 %.
    points, half_field = pl.paraxial.cardinal_points(LENS), half / abs(pl.paraxial.magnification(LENS, z_array))
    expected = half_field * (points.entrance_pupil - focus.z) / (points.entrance_pupil - z_array)
    np.testing.assert_allclose(np.abs(frustum.in_focus[:, :2]), expected, rtol=0.02)
    posed = GALILEAN.posed(position=(100.0, 0.0, 0.0), look_at=(0.0, 0.0, 0.0)).frustum
    np.testing.assert_allclose(posed.in_focus.mean(axis=0), [100.0 + focus.z, 0, 0], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(posed.directions, axis=1), 1.0)


def test_corners_that_no_light_reaches_are_left_out():
    fisheye = pl.load_lens("fisheye-100mm-f8")
    camera = pl.PlenopticCamera(fisheye, pl.Sensor((3000, 3000), 0.1), float(fisheye.vertices[-1]) + 150.0)
    assert np.isfinite(camera_frustum(camera).directions).all()


def test_a_view_of_a_file_has_a_frustum():
    view = pl.scene.View("front", (0, 0, 400), (0, 0, 0), vertical_field_of_view=0.4, aspect_ratio=1.5)
    slopes = view.frustum.directions[:, :2] / -view.frustum.directions[:, 2:]
    np.testing.assert_allclose(np.abs(slopes), np.tile([1.5 * math.tan(0.2), math.tan(0.2)], (4, 1)))
    assert view.frustum.in_focus is None
    flat = dataclasses.replace(view, vertical_field_of_view=None)
    np.testing.assert_allclose(flat.frustum.directions, np.tile([0, 0, -1.0], (4, 1)))


def test_figures_have_a_section_and_a_detail():
    from matplotlib.figure import Figure

    for camera in (GALILEAN, ONE, TILTED, CONVENTIONAL, WALLED):
        figure = camera.layout(figure=Figure())
        assert len(figure.axes) == (1 if camera.microlenses is None else 2)
        figure.canvas.draw()


def test_key_numbers_are_those_of_the_report():
    for text in ("Galilean", "100.72 mm, f/6.94", "pitch 0.217 mm", "512 x 512 pixels", "403.91 mm before the iris"):
        assert text in GALILEAN._repr_html_()
    horizon = dataclasses.replace(CONVENTIONAL, stop_to_microlenses=102.2).focused_at(-math.inf)
    assert "at infinity" in horizon._repr_html_()


def test_reports_begin_with_their_warnings():
    kinds = pl.camera.CameraFindingKind
    findings = [pl.camera.CameraFinding(kind, f"about <{kind.name}>") for kind in (kinds.DARK_GAPS, kinds.INSIDE_LENS)]
    html = report_html(dataclasses.replace(GALILEAN.report(), warnings=tuple(findings)))
    assert html.index("DARK_GAPS") < html.index("INSIDE_LENS") < html.index("focal length")
    assert "about &lt;DARK_GAPS&gt;" in html
