"""Centres of micro images: closed forms of thin lenses, laws, agreement with aiming and with white images."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, pairs, refused, the_lens

import plenoptic as pl
from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import CameraPart
from plenoptic.camera.points import centroids
from plenoptic.camera.points.centres import CentreMethod, aimed_slopes, microlens_centres
from plenoptic.camera.points.centroids import centroids_at, moment_points
from plenoptic.optics.microlens.lattice import polygon_moments

ORTHOGONAL, CHIEF_RAY, CENTROID = CentreMethod
PIXEL, GLASS = 0.010, pl.ConstantMedium(1.5)


def the_camera(lens=None, shape=(200, 300), b=2.0, **array):
    """The reference camera in mode 1.0."""
    return camera_with(b, 4.25, shape, lens, **array)


def pupil_of(lens):
    points = pl.paraxial.cardinal_points(lens)
    return {pl.LensModel.NONE: 0.0, pl.LensModel.THIN: points.rear_principal}.get(lens.model, points.exit_pupil)


def opening_points(array):
    return moment_points(polygon_moments(array.opening.corners[None])[2][0])


def centroids_of(camera, points):
    """Of ideal microlenses of f = 2 mm with openings as designed."""
    return centroids_at(array_axes(camera), camera.microlenses, points, 0.5, opening_points(camera.microlenses))


def by_index(centres):
    return {tuple(index): row for row, index in enumerate(centres.index.tolist())}


def test_ideal_lenses_project_the_array_from_the_pupils_middle():
    for model in (pl.LensModel.NONE, pl.LensModel.THIN, pl.LensModel.PARAXIAL):
        for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE):
            camera = the_camera(the_lens(4.25, model), lattice=lattice)
            centres = microlens_centres(camera)
            gap = camera.stop_to_microlenses - pupil_of(camera.lens)
            # The polynomial reproduces a straight line to some rounding errors of the largest coordinate.
            np.testing.assert_allclose(centres.position, centres.on_array * (1 + 2.0 / gap), atol=1e-13)
            assert len(centres) > 100
            np.testing.assert_allclose(centres.on_array, centres.index @ camera.microlenses.basis, atol=1e-14)
    straight = microlens_centres(camera, ORTHOGONAL)
    np.testing.assert_array_equal(straight.position, straight.on_array)


def test_images_of_the_reference_repeat_every_22_038_pixels():
    # Paraxial, near the axis: 21.7 (1 + 2 / (123.3 + 5.23)); pupil aberrations grow with the square of the radius.
    centres = microlens_centres(the_camera(shape=(70, 70), lattice=pl.Lattice.SQUARE))
    np.testing.assert_allclose(np.diff(np.unique(centres.pixel[:, 0].round(6))), 22.038, atol=5e-4)


def test_a_telecentric_pupil_projects_along_the_axis():
    front, back = (
        pl.Surface(r, d, m, semi_diameter=30.0) for r, d, m in ((100.0, 4.0, GLASS), (-100.0, 0.0, pl.optics.AIR))
    )
    lens = pl.LensStack([pl.CircularStop(1.0, thickness=97.0), front, back])
    gap = pl.paraxial.cardinal_points(lens).exit_pupil
    centres = microlens_centres(the_camera(lens, to_array=150.0))
    # Wherever the pupil is, far away, on either side: its spherical aberration grows with the cube of the radius
    # (2.5e-6 mm at 1 mm here), and nothing else may.
    off = np.linalg.norm(centres.position - centres.on_array * (1 + 2.0 / (150.0 - gap)), axis=1)
    assert (off <= 4e-6 * np.linalg.norm(centres.on_array, axis=1) ** 3 + 1e-12).all()


def test_plates_are_traced():
    """A single large plano-convex lens, followed surface by surface, leads the same ray to the same place."""
    for side, index in ((pl.optics.ConvexSide.SCENE, 1.5), (pl.optics.ConvexSide.SENSOR, 1.9)):
        kind = {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.8, "index": index, "convex_side": side}
        camera = the_camera(shape=(2400, 2400), b=2.0, pitch=0.5, **kind)
        axes, centres = array_axes(camera), microlens_centres(camera)
        rows = [int(np.argmax(centres.on_array @ direction)) for direction in ((1, 0), (1, 1), (-1, 2))]
        slopes = aimed_slopes(axes, centres.on_array[rows])
        glass, radius = pl.ConstantMedium(index), 2.0 * (index - 1)
        curved = side is pl.optics.ConvexSide.SCENE
        first, last = (radius, math.inf) if curved else (math.inf, -radius)
        surfaces = pl.Surface(first, 0.8, glass, semi_diameter=0.3), pl.Surface(last, semi_diameter=0.3)
        plate = pl.LensStack([pl.CircularStop(5.0, thickness=1.0), *surfaces])
        for row, (u, v) in zip(rows, slopes, strict=True):
            # Through the vertex of the curved side, at z = 1 or 1.8 of the stack; inside, Snell's law.
            outside = math.hypot(u, v)
            inside = math.tan(math.asin(math.sin(math.atan(outside)) / index)) / outside
            start = (0.0 if curved else -0.8 * inside) * np.array([u, v])
            ray = pl.RayBundle([[*(start - np.array([u, v])), 0.0]], [[u, v, 1.0]])
            # The sensor lies 2 mm behind the rear principal plane: in the vertex, or thickness / n before the flat
            # side.
            landed = plate.trace(ray).at_z(1.8 + (2.0 - 0.8 / index if curved else 2.0))[0, :2]
            # Rounding of coordinates of 15 mm, and the chief ray of a point moved by 1e-6.
            np.testing.assert_allclose(centres.position[row] - centres.on_array[row], landed, atol=1e-8)


def test_interpolated_chief_rays_are_those_that_are_aimed_at():
    fisheye = pl.load_lens("fisheye-100mm-f8")
    decentred = the_lens(4.25).moved(slice(8, 10), shift=(0.3, -0.1, 0.0), tilt=(0.01, 0.0, 0.0))
    straight, moved = (the_camera(lens, shape=(1000, 1400)) for lens in (None, decentred))
    wide, large = {"shape": (2400, 3600), "pitch": 0.4}, float(fisheye.vertices[-1]) + 5
    for camera in (the_camera(**wide), the_camera(fisheye, to_array=max(120.0, large), **wide), moved):
        centres = microlens_centres(camera)
        rows = np.random.default_rng(3).choice(len(centres), 30, replace=False)
        aim_rays = centres.on_array[rows] + 2.0 * aimed_slopes(array_axes(camera), centres.on_array[rows])
        # As documented; the iris is met to 1e-9 mm, which the lever of the sensor makes smaller.
        assert np.abs(centres.position[rows] - aim_rays).max() < 1e-9
    # The decentred lens is interpolated in two dimensions.
    designed = microlens_centres(straight)
    interpolated, aimed_ = pairs(centres, designed)
    assert np.abs(centres.position[interpolated] - designed.position[aimed_]).max() > 1e-3


def half_shut(stop=3.6):
    """A camera with a stop behind the lens that cuts micro images away from the axis."""
    return the_camera(the_lens(stop).inserted(pl.CircularStop(3.5), 60.0), shape=(1200, 1200))


def test_centroids_converge_with_finer_lines(monkeypatch):
    camera = half_shut()
    points = np.array([[0.0, 0.0], [2.0, 1.0], [4.0, -3.0], [-5.0, 2.0]])
    coarse = centroids_of(camera, points)
    monkeypatch.setattr(centroids, "LINES", 160)
    monkeypatch.setattr(centroids, "PLACES", 60)
    fine = centroids_of(camera, points)
    # Documented: some 0.01 pixels.
    assert np.abs(coarse - fine).max() < 0.02 * PIXEL
    assert np.abs(fine[0]).max() < 1e-5  # on the axis, by symmetry; halving eight times leaves some 1e-5


def test_vignetting_draws_centroids_away_from_chief_rays_towards_the_axis_or_from_it_but_not_across():
    camera = half_shut()
    points = np.array([[4.0, 0.0], [0.0, 4.0], [2.8, 2.8]])
    offset = centroids_of(camera, points) - (points + 2.0 * aimed_slopes(array_axes(camera), points))
    outwards = points / np.linalg.norm(points, axis=1)[:, None]
    along = np.sum(offset * outwards, axis=1)
    across = offset[:, 0] * outwards[:, 1] - offset[:, 1] * outwards[:, 0]
    assert (np.abs(along) > 0.5 * PIXEL).all()
    assert np.abs(across).max() < 0.02 * PIXEL
    assert np.ptp(along) < 0.05 * PIXEL  # round lens, round stops: the same at all azimuths


def test_interpolated_centroids_are_those_of_the_quadrature(monkeypatch):
    monkeypatch.setattr(centroids, "FIELDS", 21)  # fewer than usual: quicker, and a stricter test
    camera = half_shut()
    computed_centres = microlens_centres(camera, CENTROID)
    assert len(computed_centres) > 33 * 33
    rows = np.random.default_rng(5).choice(
        np.flatnonzero(np.abs(computed_centres.on_array).max(axis=1) < 5), 30, replace=False
    )
    direct = centroids_of(camera, computed_centres.on_array[rows])
    assert np.abs(computed_centres.position[rows] - direct).max() < 0.02 * PIXEL


def test_centroids_of_a_rendered_white_image_are_those_of_the_geometry():
    region = np.s_[560:650, 150:260]
    rows, columns = np.mgrid[region]
    for lattice, part in ((pl.Lattice.SQUARE, None), (pl.Lattice.HEXAGONAL, CameraPart.MICROLENSES)):
        camera = dataclasses.replace(half_shut(), microlenses=pl.MicrolensArray(0.217, (2.0,), lattice))
        if part is not None:
            camera = camera.moved(part, shift=(0.03, 0.05, -0.02), tilt=(0.01, -0.015, 0.02))
        white = pl.render_white(camera, samples=128, region=region, seed=5, progress=False)
        centroid, chief = microlens_centres(camera, CENTROID, white=white), microlens_centres(camera)
        assert len(centroid) >= 6
        computed = centroids_of(camera, centroid.on_array)
        for key, row in by_index(centroid).items():
            place = centroid.position[row]
            offset = camera.sensor.centre_of(rows, columns) - place
            in_image = np.hypot(offset[..., 0], offset[..., 1]) < 0.11
            error = white.standard_error[in_image, 0].astype(float)
            sigma = np.linalg.norm(error * np.hypot(*offset[in_image].T)) / white.image[in_image].sum(dtype=float)
            # Five standard errors, and the 0.02 pixels of the computed one.
            assert np.linalg.norm(place - computed[row]) < 5 * sigma + 0.02 * PIXEL, (lattice, part)
            # Vignetted: it can fail.
            assert np.linalg.norm(place - chief.position[by_index(chief)[key]]) > 0.2 * PIXEL


def test_four_points_have_the_moments_of_the_opening():
    for lattice, width in ((pl.Lattice.SQUARE, 1.0 / 12), (pl.Lattice.HEXAGONAL, 5.0 / 72)):
        # Of a square of side 1: 1/12; of a hexagon of apothem 1/2, side 1/sqrt(3): 5 side^2 / 24.
        points = opening_points(pl.MicrolensArray(1.0, (2.0,), lattice))
        np.testing.assert_allclose((points**2).mean(axis=0), width, rtol=1e-12)
        np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-15)


def test_only_centres_on_the_sensor_and_its_margin_are_listed():
    camera = the_camera(shape=(90, 150))
    few, many = microlens_centres(camera), microlens_centres(camera, margin=0.3)
    for centres, margin in ((few, 0.0), (many, 0.3)):
        assert (np.abs(centres.position) <= np.array([0.75, 0.45]) + margin + 1e-9).all()
    assert by_index(few).keys() < by_index(many).keys()
    # Every lattice point whose image is on the sensor is there: the area over that of an image's cell, to the rim.
    assert len(many) == pytest.approx((1.5 + 0.6) * (0.9 + 0.6) / (camera.microlenses.cell_area * 1.0157**2), rel=0.15)
    np.testing.assert_allclose(camera.sensor.pixel_of(few.position), few.pixel, atol=1e-12)
    assert len(microlens_centres(camera, margin=-5.0)) == 0


def test_types_follow_the_array():
    camera = the_camera(focal_lengths=(1.8, 2.0, 2.2))
    centres, lenses = microlens_centres(camera), camera.microlenses.lenses((-2.0, -2.0), (2.0, 2.0))
    typed, designed_ = pairs(centres, lenses)
    assert len(typed) == len(centres) and set(centres.type.tolist()) == {0, 1, 2}
    np.testing.assert_array_equal(lenses.type[designed_], centres.type[typed])


def test_jitter_moves_centres():
    lens, shape = the_lens(4.25, pl.LensModel.THIN), (160, 200)
    spoiled = the_camera(lens, shape, imperfections=pl.MicrolensImperfections(pitch_jitter=0.01, seed=3))
    for method in CentreMethod:
        moved, straight = microlens_centres(spoiled, method), microlens_centres(the_camera(lens, shape), method)
        jittered, designed_ = pairs(moved, straight)
        assert len(jittered) > 10
        shift = moved.on_array[jittered] - straight.on_array[designed_]
        assert shift.std() == pytest.approx(0.01, rel=0.15)
        # Openings stay, and all that passes one is deviated alike: centroids follow axes by b / f = 1.
        scale = 1 + 2.0 / (123.3 - pupil_of(lens)) if method is CHIEF_RAY else 1.0
        step = moved.position[jittered] - straight.position[designed_]
        np.testing.assert_allclose(step, scale * shift, atol=1e-12 if method is not CENTROID else 0.01 * PIXEL)


def test_dark_microlenses_have_no_centroid():
    dark = pl.optics.MicrolensDeviations(index=[(0, 0)], transmission=[0.0])
    camera = the_camera(shape=(70, 70), imperfections=dark)
    assert (0, 0) in by_index(microlens_centres(camera))
    computed_centres = microlens_centres(camera, CENTROID)
    assert (0, 0) not in by_index(computed_centres) and len(computed_centres) > 4


def rotation_of(tilt):
    """About x, then y, then z."""
    (a, b, c), (s, t, u) = np.cos(tilt), np.sin(tilt)
    about_z, about_y, about_x = [[c, -u, 0], [u, c, 0], [0, 0, 1]], [[b, 0, t], [0, 1, 0], [-t, 0, b]], np.eye(3)
    about_x[1:, 1:] = [[a, -s], [s, a]]
    return np.array(about_z) @ about_y @ about_x


def test_parts_out_of_place_project_through_space():
    """The line from the pupil's middle through each microlens meets the sensor: computed with points in space."""
    camera, shift = the_camera(the_lens(4.25, pl.LensModel.THIN)), (0.05, -0.04, 0.1)
    for part in CameraPart:
        for tilt in ((0.0, 0.0, 0.03), (0.02, -0.03, 0.01)):
            moved = camera.moved(part, shift=shift, tilt=tilt)
            poses = [(np.eye(3), np.array([0.0, 0.0, z])) for z in (0.0, 123.3, 125.3)]
            poses[part] = (rotation_of(tilt), poses[part][1] + shift)
            (lens, at_lens), (array, at_array), (sensor, at_sensor) = poses
            pupil = lens @ [0.0, 0.0, pupil_of(camera.lens)] + at_lens
            for method in (CHIEF_RAY, ORTHOGONAL):
                centres = microlens_centres(moved, method)
                assert len(centres) > 100
                space = np.column_stack([centres.on_array, np.zeros(len(centres))]) @ array.T + at_array
                along = space - pupil if method is CHIEF_RAY else np.broadcast_to(array[:, 2], space.shape)
                t = ((at_sensor - space) @ sensor[:, 2]) / (along @ sensor[:, 2])
                hits = (space + t[:, None] * along - at_sensor) @ sensor
                np.testing.assert_allclose(centres.position, hits[:, :2], atol=1e-10, err_msg=f"{part} {tilt}")


def test_centroids_of_a_small_pupil_are_where_chief_rays_land():
    """A small stop sends every part of a cell the same light, but for cos^4: 4 d u d theta ... of second order."""
    straight, tilted = the_camera(the_lens(0.1, pl.LensModel.THIN), b=1.7), the_camera(the_lens(0.05), (120, 160))
    # cos^4 behind a lens of power 1/f varies by 4 u d / f across the cell (u < 0.02, d / f < 0.06), and rays through d
    # land (1 - b / f) d beside the middle: 4 u <d^2> / f (1 - b / f) < 4 x 0.02 x 0.0025 / 2 x 0.15 = 1.5e-5 mm. A
    # tilted sensor cuts the cone of a cell obliquely: (1 - b / f) is no longer 0, b differs by 0.03 x 0.1 mm along the
    # cell; <d^2> 0.03 / f = 0.0025 x 0.015 = 4e-5 mm.
    array, sensor = (tilted.moved(part, tilt=(0.02, -0.03, 0.1)) for part in list(CameraPart)[1:])
    for camera, tolerance in ((straight, 2e-5), (array, 1e-4), (sensor, 1e-4)):
        chief, centroid = microlens_centres(camera), microlens_centres(camera, CENTROID)
        chief_rows, centroid_rows = pairs(chief, centroid)
        assert len(chief_rows) > 10
        assert np.abs(centroid.position[centroid_rows] - chief.position[chief_rows]).max() < tolerance


def test_impossible_questions_say_what_to_do():
    camera, (white, narrow) = the_camera(shape=(64, 64)), (pl.Exposure(np.ones((64, n, 1))) for n in (64, 63))
    for camera_, options, message in (
        ((bare_camera(),), {}, "no microlenses"),
        ((camera,), {"white": white}, "does not use it"),
        ((camera, CENTROID), {"white": narrow}, "render it with this camera"),
        ((camera, 7), {}, "method is 7"),
    ):
        with refused(message):
            microlens_centres(*camera_, **options)


def test_free_lattices_split_a_white_image_between_neighbours():
    free = the_camera(shape=(160, 160), lattice=pl.Lattice.FREE, centres=[[-0.1, 0.0], [0.12, 0.0]])
    chief = microlens_centres(free)
    assert len(chief) == len(microlens_centres(free, CENTROID)) == 2
    image = np.zeros((160, 160, 1))
    spots = np.rint(chief.pixel).astype(int) + np.eye(2, dtype=int)
    image[tuple(spots.T)] = 1.0
    computed_centres = microlens_centres(free, CENTROID, white=pl.Exposure(image))
    np.testing.assert_allclose(computed_centres.pixel, spots, atol=1e-9)
