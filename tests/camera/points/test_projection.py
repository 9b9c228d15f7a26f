"""Projection of points: closed forms, the real lens, the light of small emitters, and what hides them."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, in_world, pairs, refused, the_lens

import plenoptic as pl
from plenoptic.camera.assembly import array_axes
from plenoptic.camera.points.projection import project
from plenoptic.camera.points.projection_rows import Aim, EntranceRays, ThroughArray, aim_rays
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.camera.psf.sensor_hits import RayTask, forward_record, trace_task
from plenoptic.core.kernels.sobol import mix
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.pupil import entrance_pupil
from plenoptic.optics.lens.pupil.entrance_pupil import entrance_polygon, entrance_polygons
from plenoptic.optics.lens.trace import trace_record

PINHOLE, _, FLAT, SPHERICAL = pl.optics.MicrolensModel


def assembled(camera):
    """All parts out of place, and posed."""
    shifts = (0.2, 0.1, 0.1), (0.03, 0.02, 0.1), (0.05, 0.02, -0.05)
    tilts = (0.01, 0.02, 0.1), (0.01, -0.01, 0.05), (-0.01, 0.02, -0.03)
    for part, shift, tilt in zip(pl.CameraPart, shifts, tilts, strict=True):
        camera = camera.moved(part, shift=shift, tilt=tilt)
    return camera.posed((100, 50, 700), (30, -20, 10), (0.1, 1, 0))


def test_positions_of_a_thin_camera_are_closed_forms():
    # The image at x, a behind the array; seen through the centre c it falls at c + b (x - c) / a.
    lens = the_lens(model=pl.LensModel.THIN)
    cardinal = pl.paraxial.cardinal_points(lens)
    for b, depths in ((1.7, (-150.0, -1e6)), (2.0, (-300.0, -1500.0)), (2.3, (-150.0, -1500.0))):
        camera = camera_with(lens=lens, b=b, to_array=112.0 if b > 2 else 123.3)
        for z in depths:
            s = cardinal.rear_principal - z
            behind = 1.0 / (1.0 / cardinal.efl - 1.0 / s)
            a = cardinal.rear_principal + behind - camera.stop_to_microlenses
            points = np.array([[0.0, 0.0, z], [0.004 * s, -0.003 * s, z]])
            projection = project(camera, points)
            assert projection.visible.sum() > 6
            has_ray = np.isfinite(projection.position[:, 0])
            assert has_ray.mean() > 0.8
            centre = projection.index[has_ray] @ camera.microlenses.basis
            image = -points[projection.point[has_ray], :2] * behind / s
            # Chief rays pass centres to 1e-9 mm; slopes to that over a, and up to 2.3 mm behind the array. From 1e6 mm
            # away, directions are good to eps in 1e6 mm over 120 mm: no worse.
            np.testing.assert_allclose(
                projection.position[has_ray], centre + b * (image - centre) / a, rtol=0, atol=1e-8
            )
            np.testing.assert_array_equal(projection.pixel, camera.sensor.pixel_of(projection.position))


def test_points_of_the_plane_in_focus_fall_onto_one_spot_each():
    # Thin lenses without aberrations, in focus: chief ray and centroid agree.
    camera = camera_with(lens=the_lens(model=pl.LensModel.THIN)).focused_at(z=-404.0)
    projection = project(camera, [(0, 0, -404), (5, -4, -404)], rays=512)
    both = np.isfinite(projection.position[:, 0]) & np.isfinite(projection.centroid[:, 0])
    assert both.sum() > 50
    np.testing.assert_allclose(projection.centroid[both], projection.position[both], rtol=0, atol=1e-8)


KINDS = {
    "thin": {},
    "types": {"focal_lengths": (1.7, 2.0, 2.4)},
    "rectangular": {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.25, 0.2)},
    "spherical": {"model": SPHERICAL},
    "spherical to the sensor": {"model": SPHERICAL, "convex_side": pl.optics.ConvexSide.SENSOR},
    "flat": {"model": FLAT, "index": 100.0},
    "flat to the sensor": {"model": FLAT, "index": 100.0, "convex_side": pl.optics.ConvexSide.SENSOR},
    "imperfect": {"imperfections": pl.MicrolensImperfections(pitch_jitter=0.004, decentre=0.003, seed=4)},
}
FEW = ["types", "flat", "spherical to the sensor", "imperfect"]
ALL = [pytest.param(KINDS, placed, 1 << 18, marks=pytest.mark.slow) for placed in (False, True)]


@pytest.mark.parametrize(("names", "placed", "rays"), [(FEW, True, 1 << 17), *ALL])
def test_the_chief_ray_is_what_small_microlenses_leave_of_the_light(names, placed, rays):
    # Light through small round openings about the optical centres is the chief ray and its neighbours: a spot of radius
    # 24 um times 2 % near the plane in focus. Its centroid differs from the chief ray by aberrations of even order, a
    # part 0.05 of those of a whole cell, up to 3e-4 mm at the edge of the light: below 2e-5 mm.
    small = {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.05)}
    for name in names:
        array = small | KINDS[name]
        if "imperfections" in array:
            # An opening that is not about the optical axis has no chief ray for its centroid.
            array["imperfections"] = dataclasses.replace(array["imperfections"], decentre=0.0)
        camera = camera_with(**array)
        camera = assembled(camera) if placed else camera
        point = in_world(camera, [(5.0, 3.0, -400.0)])
        projection = project(camera, point, rays=rays)
        # Openings are 0.05 mm wide, which the image point, 11 mm behind them, sees as 0.6 mm of the exit pupil. All of
        # them are lit whose chief ray passes the iris 0.7 mm inside its edge.
        inner = project(dataclasses.replace(camera, lens=the_lens(stop=4.3)), point, rays=8)
        inside = {tuple(index) for index in inner.index[inner.passes].tolist()}
        is_inside = np.array([tuple(index) in inside for index in projection.index.tolist()]) & projection.visible
        assert is_inside.sum() > 10, name
        off, error = (
            (projection.centroid - projection.position)[is_inside],
            np.hypot(projection.centroid_error[is_inside], 2e-5),
        )
        # Errors have 7 degrees of freedom: RMS 1.2 of scores; of 60 numbers, one in a thousand is beyond 6.
        scores = off / error
        assert np.abs(scores).max() < 6.5, (name, placed)
        assert np.sqrt(np.mean(scores**2)) < 1.2 * (1 + 3 / math.sqrt(2 * scores.size)), (name, placed)


def test_chief_rays_pass_centres_to_a_millionth_of_a_micrometre():
    points, targets = np.tile([4.0, -3.0, -380.0], (200, 1)), np.random.default_rng(3).uniform(-1.5, 1.5, (200, 2))
    for name in ("thin", "spherical to the sensor"):
        for camera in (camera_with(**KINDS[name]), assembled(camera_with(**KINDS[name]))):
            bare = lens_record(camera.lens, camera.wavelength, reverse=False, clipping=False)
            entrance = EntranceRays(-40.0, 5.0, camera.wavelength, bare, bare)
            aim = Aim(bare, ThroughArray(array_axes(camera), camera.microlenses).intersections)
            entry = aim_rays(entrance, aim, points, targets, np.zeros((200, 2)))
            passed = aim.intersections(trace_record(bare, entrance.through(points, entry)))
            np.testing.assert_allclose(passed, targets, rtol=0, atol=1e-9, err_msg=name)


def test_free_microlenses_that_repeat_a_lattice_see_the_same():
    lenses = camera_with().microlenses.lenses((-4.0, -4.0), (4.0, 4.0))
    free = camera_with(lattice=pl.Lattice.FREE, centres=lenses.centre)
    regular, listed = (project(camera, (4.0, 2.0, -390.0)) for camera in (camera_with(), free))
    place = {tuple(index): k for k, index in enumerate(regular.index.tolist())}
    matched = [place[tuple(index)] for index in lenses.index[listed.index[:, 0]].tolist()]
    assert len(matched) == len(regular) and (listed.index[:, 1] == 0).all()
    np.testing.assert_allclose(listed.position, regular.position[matched], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(listed.passes, regular.passes[matched])


def test_a_conventional_camera_has_one_row_a_point_through_the_centre_of_the_iris():
    points = np.array([(0.0, 0.0, -404.0), (6.0, -3.0, -404.0), (-2.0, 5.0, -1e6), (1.0, 1.0, -80.0)])
    for model in (pl.LensModel.EXACT, pl.LensModel.THIN, pl.LensModel.PARAXIAL):
        lens = the_lens(model=model)
        camera = bare_camera(lens)
        projection = project(camera, points)
        np.testing.assert_array_equal(projection.point, np.arange(4))
        assert projection.index is None and projection.type is None and projection.passes.all()
        for k, (x, y, z) in enumerate(points.tolist()):
            ray = pl.aiming.chief_ray(lens, field=(x, y), z_object=z)
            landed = lens.trace(ray).at_z(camera.z_sensor)[0, :2]
            # The iris is hit to 1e-9 mm on either side; 134.6 mm behind it rays are no more than 3 times as far off.
            np.testing.assert_allclose(projection.position[k], landed, rtol=0, atol=1e-8, err_msg=model.name)


def test_light_of_all_microlenses_is_that_of_the_point():
    scores = []
    for kind, placed in (("thin", False), ("types", True), ("spherical", False), ("flat", True)):
        camera = camera_with(**KINDS[kind])
        camera = assembled(camera) if placed else camera
        point = in_world(camera, (5.0, 3.0, -380.0))
        projection, spread = project(camera, point, rays=1 << 15), point_spread(camera, point, rays=1 << 16)
        error = math.hypot(np.sqrt((projection.light_error**2).sum()), spread.light_error)
        assert abs(projection.light.sum() - spread.light) < 4 * error, kind
        assert error < 0.003 * spread.light, kind
        # Microlenses at the edge of the light are seen without their chief ray.
        edge = projection.visible & ~projection.passes
        assert 3 < edge.sum() < 0.5 * len(projection), kind
        assert projection.light[edge].mean() < 0.5 * projection.light[projection.passes].mean(), kind
        assert np.isfinite(projection.centroid[projection.visible]).all(), kind
        landed = landing_points(camera, point, rays=1 << 16)
        bright = np.flatnonzero(projection.light > 0.5 * projection.light.max())
        assert len(bright) > 20, kind
        for k in bright:
            mine = (landed.index == projection.index[k]).all(axis=1)
            mean = np.average(landed.position[mine], weights=landed.weight[mine], axis=0)
            scores.append((projection.centroid[k] - mean) / (1.2 * projection.centroid_error[k] + 1e-6))
    # Errors have 7 degrees of freedom, RMS 1.2 of scores, and in each thousand numbers one beyond 6.
    assert np.abs(scores).max() < 8 and np.sqrt(np.mean(np.square(scores))) < 1.4


def test_light_of_points_is_that_of_single_replicates_whatever_the_number_of_rays():
    # Bundles of 8192 rays: points fill a part of one, parts of several, and replicates more than one each.
    points = np.array([(4.0, 2.0, -390.0), (0.0, 0.0, -420.0)])
    for camera in (camera_with(**KINDS["types"]), bare_camera(the_lens())):
        record = forward_record(camera)
        for each in (3, 100, 300, 8200):
            projection = project(camera, points, rays=32 * each)
            for k, (point, polygon) in enumerate(zip(points, entrance_polygons(record.entrance, points), strict=True)):
                tasks = [RayTask(point, polygon.T.copy(), 0, replicate, 0, each) for replicate in range(32)]
                x, y, z = point.view(np.uint64)
                with np.errstate(over="ignore"):
                    seed = mix(mix(mix(np.uint64(0), x), y), z)
                light = [trace_task(record, task, seed).rows["weight"].sum() / each for task in tasks]
                rows = projection.selected(projection.point == k)
                np.testing.assert_allclose(rows.light.sum(), np.mean(light), rtol=1e-12, err_msg=str(each))
                if projection.index is None:
                    error = np.std(light, ddof=1) / math.sqrt(32)
                    np.testing.assert_allclose(rows.light_error[0], error, rtol=1e-9)


def test_errors_of_opposite_points_are_independent():
    # Of a centred lens, whose light has the same symmetry: equal random numbers give equal errors.
    x, y = np.meshgrid(np.linspace(1.0, 6.0, 6), np.linspace(-6.0, 6.0, 7))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -404.0)])
    light = project(bare_camera(the_lens()), np.concatenate([points, points * (-1, -1, 1)]), rays=256).light
    assert len(np.unique(light)) == len(light) == 84


def test_rows_of_a_point_do_not_depend_on_the_other_points():
    # Points in a cluster, and far from it; products of matrices round differently for one row and for many.
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-8.0, 8.0, (60, 2)), rng.uniform(-420.0, -380.0, 60)])
    points[::7] *= 2.5
    for name, placed in (("types", False), ("spherical", True)):
        camera = assembled(camera_with(**KINDS[name])) if placed else camera_with(**KINDS[name])
        world, tolerance = in_world(camera, points), 1e-9 if placed else 0.0
        together = project(camera, world, rays=1 << 9)
        for k in range(0, 60, 5):
            alone, part = project(camera, world[k], rays=1 << 9), together.selected(together.point == k)
            for column in ("index", "passes", "visible"):
                np.testing.assert_array_equal(getattr(part, column), getattr(alone, column), err_msg=name)
            for column in ("position", "light", "light_error", "centroid"):
                np.testing.assert_allclose(
                    getattr(part, column), getattr(alone, column), rtol=tolerance, atol=tolerance
                )


def test_chief_rays_that_pass_end_near_the_sensor():
    # Of a fast aspheric lens, whose chief rays are far from a linear function of the microlens.
    lens = pl.load_lens("asphere-15mm-f0.9")
    microlenses, image = pl.MicrolensArray(0.6, (1.2,)), pl.paraxial.image_position(lens, -450.0)
    camera = pl.PlenopticCamera(lens, pl.Sensor((1000, 1000), 0.015), image, microlenses, 0.9)
    camera = camera.moved(pl.CameraPart.LENS, shift=(0.3, 0.15, 0.0), tilt=(0.03, -0.02, 0.1))
    x = np.linspace(0.0, 60.0, 16)
    projection = project(camera, np.column_stack([x, 0.3 * x, np.full(16, -40.0)]), rays=1 << 10)
    dark = projection.light == 0
    assert dark.sum() > 10 and projection.passes[dark].all()
    assert np.abs(projection.position[dark]).max() <= 0.6 * 15.0


def test_outlines_of_regions_hold_all_light():
    # Rays of a grid over the first element pass the lens inside the polygon alone, at the edge of the field too.
    rng, grid = (
        np.random.default_rng(6),
        np.stack(np.meshgrid(*[np.linspace(-30.0, 30.0, 61)] * 2), axis=-1).reshape(-1, 2),
    )
    for camera in (camera_with(), assembled(camera_with())):
        record = forward_record(camera)
        z = rng.uniform(-700.0, -200.0, 200)
        points = np.column_stack([rng.uniform(-0.15, 0.15, (200, 2)) * np.abs(z)[:, None], z])
        polygons, own = entrance_polygons(record.entrance, points), 0
        for point, polygon in zip(points, polygons, strict=True):
            start = np.column_stack([grid, np.full(len(grid), record.entrance.z)])
            passes = trace_record(record.lens, pl.RayBundle(start, start - point)).status == 0
            side, offset = np.roll(polygon, -1, axis=0) - polygon, grid[passes, None] - polygon
            assert (side[:, 0] * offset[..., 1] - side[:, 1] * offset[..., 0] >= 0).all()
            alone = entrance_polygon(record.entrance, point)
            assert alone is not None or np.isnan(polygon).all()
            own += alone is None or np.array_equal(alone, polygon)
            if alone is not None:
                extents = [np.prod(np.ptp(shape, axis=0)) for shape in (polygon, alone)]
                assert extents[0] < 1.5 * extents[1]
        assert own < 150
    # The opening of a thin lens is the same for all points, and is found once for each region.
    entrance = forward_record(camera_with(lens=the_lens(model=pl.LensModel.THIN))).entrance
    alone = entrance_polygon(entrance, points[0])
    for polygon in entrance_polygons(entrance, points):
        np.testing.assert_allclose(np.sort(np.hypot(*polygon.T)), np.sort(np.hypot(*alone.T)), rtol=1e-6)
        own += np.array_equal(polygon, alone)
    assert own < 250


@pytest.mark.parametrize("turned", [False, True])
def test_points_amid_darkness_need_no_search(turned, monkeypatch):
    """Points beyond the field share the search of their cubes; near its edge all that see light keep it."""
    entrance = forward_record(assembled(camera_with()) if turned else camera_with()).entrance
    rng, searches = np.random.default_rng(8), []
    monkeypatch.setattr(entrance_pupil, "_outline", lambda *a, f=entrance_pupil._outline: searches.append(a) or f(*a))
    beyond = rng.uniform((400.0, 0.0, -420.0), (420.0, 20.0, -400.0), (200, 3))
    assert np.isnan(entrance_polygons(entrance, beyond)).all() and 0 < len(searches) < 100
    angle, height = rng.uniform(0, 2 * math.pi, 24), rng.uniform(200.0, 330.0, 24)
    edge = np.column_stack([height * np.cos(angle), height * np.sin(angle), np.full(24, -404.0)])
    polygons = entrance_polygons(entrance, edge)
    is_dark = np.array([entrance_polygon(entrance, point) is None for point in edge])
    assert (np.isnan(polygons[:, 0, 0]) == is_dark).all() and 4 < is_dark.sum() < 20


def test_what_lands_beside_the_sensor_is_not_visible():
    for shape in ((24, 40), (40, 24)):
        projection = project(camera_with(shape=shape), (0.0, 0.0, -404.0))
        within = np.minimum(projection.pixel, np.array(shape) - 1 - projection.pixel).min(axis=1)
        inside, far = within > -0.5, within < -2
        assert inside.any() and not inside.all()
        assert not projection.visible[far].any() and projection.visible[inside & projection.passes].all(), shape


def test_a_dark_microlens_is_not_lit():
    dark = pl.optics.MicrolensDeviations(index=[(0, 0)], transmission=[0.0])
    projection = project(camera_with(imperfections=dark), (0.0, 0.0, -404.0))
    middle = (projection.index == 0).all(axis=1)
    assert middle.sum() == 1 and projection.passes[middle].all()
    assert not projection.visible[middle].any() and (projection.light[middle] == 0).all()
    assert np.isnan(projection.centroid[middle]).all()
    assert projection.visible[~middle].all()


def test_a_camera_array_sees_with_every_lens_whose_chief_ray_meets_the_sensor():
    # Without main lens: a ray from the point through each centre. More lenses get light than rays are traced.
    camera = camera_with(lens=the_lens(16.0, pl.LensModel.NONE), to_array=40.0, b=2.0)
    point = np.array([10.0, 5.0, -404.0])
    projection = project(camera, point, rays=64)
    centre = projection.index @ camera.microlenses.basis
    expected = centre + 2.0 * (centre - point[:2]) / 444.0
    np.testing.assert_allclose(projection.position, expected, rtol=0, atol=1e-9)
    inside = (np.abs(expected) < 2.56).all(axis=1)
    assert inside.sum() > 600 and projection.visible[inside].all()
    # The rest of the light is that of images that reach over the edge of the sensor, half a pitch at most.
    assert not projection.visible[(np.abs(expected) > 2.56 + 0.13).any(axis=1)].any()
    unknown = projection.visible & (projection.light == 0)
    assert (
        unknown.any()
        and np.isinf(projection.light_error[unknown]).all()
        and np.isnan(projection.centroid[unknown]).all()
    )


def test_a_point_imaged_onto_the_array_is_seen_by_one_microlens():
    camera = camera_with(2.0, lens=the_lens(4.25, pl.LensModel.THIN)).focused_at(z=-404.0)
    projection = project(camera, (0.1, 0.05, -404.0))
    assert len(projection) == 1 and projection.visible.all() and np.isnan(projection.position).all()
    spread = point_spread(camera, (0.1, 0.05, -404.0))
    joint_light = math.hypot(spread.light_error, projection.light_error[0])
    assert abs(projection.light[0] - spread.light) < 5 * joint_light < 0.1 * spread.light
    joint = np.hypot(spread.centroid_error, projection.centroid_error[0])
    assert np.all(np.abs(projection.centroid[0] - spread.centroid) < 5 * joint)


def test_pinholes_show_points_along_chief_rays():
    projection = project(camera_with(model=PINHOLE), (0.0, 0.0, -404.0))
    thin = project(camera_with(), (0.0, 0.0, -404.0))
    assert projection.passes.all() and projection.visible.all() and np.isnan(projection.light).all()
    np.testing.assert_array_equal(projection.centroid, projection.position)
    np.testing.assert_array_equal(projection.position, thin.position[thin.passes])


def test_points_out_of_sight_have_no_rows():
    away = (5000.0, 0.0, -60.0)
    aside, nothing = (project(camera_with(), points) for points in ([(0.0, 0.0, -404.0), away], away))
    assert (aside.point == 0).all() and len(aside) > 20
    assert len(nothing) == 0 and nothing.index.shape == (0, 2)
    # Every point of a conventional camera has its row.
    bare = project(bare_camera(), away)
    assert len(bare) == 1 and not bare.visible.any() and not bare.passes.any()


def card(z, side):
    return pl.quad((-side / 2, -side / 2, z), (side, 0, 0), (0, side, 0), material=pl.Lambertian(0.5))


def test_the_surface_of_a_point_does_not_hide_it():
    camera = camera_with()
    for z in (-404.0, -1e6):
        scene = pl.Scene([card(z, -2 * z)], background=1.0)
        points = np.array([[0.0, 0.0, z], [-0.01 * z, 0.005 * z, z]])
        np.testing.assert_array_equal(project(camera, points, scene=scene).visible, project(camera, points).visible)
    # A scene without meshes hides nothing.
    assert project(camera, points, scene=pl.Scene(background=1.0)) == project(camera, points)


def test_a_card_hides_what_is_behind_it():
    points = np.array([(0.0, 0.0, -404.0), (0.0, 0.0, -350.0)])
    projection = project(camera_with(), points, scene=pl.Scene([card(-380.0, 50)], background=1.0))
    assert not projection.visible[projection.point == 0].any() and projection.visible[projection.point == 1].all()


def test_half_a_card_hides_the_microlenses_that_look_past_its_other_side():
    # A card over the half x > 0 right before the lens. The image of a point on the axis lies behind the array, whose
    # microlenses at x > 0 therefore get the light of the half x > 0 of the lens.
    straight = camera_with()
    for camera in (straight, straight.posed((100, 50, 700), (30, -20, 10), (0.1, 1, 0))):
        half = pl.box(20.0, center=(10.0, 0.0, -60.0), material=pl.Lambertian(0.5))
        if camera.pose is not None:
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = camera.pose.rotation, camera.pose.position
            half = half.transformed(matrix)
        point = in_world(camera, [[0.0, 0.0, -404.0]])
        projection = project(camera, point, scene=pl.Scene([half], background=1.0))
        x = (projection.index @ camera.microlenses.basis)[:, 0]
        aside = np.abs(x) > 0.1
        np.testing.assert_array_equal(projection.visible[aside], (x < 0)[aside])


def test_chief_rays_depend_neither_on_threads_and_other_points_nor_on_the_rays_for_light():
    camera, points = camera_with(), [(0, 0, -404), (3, 2, -390), (-1, 4, -500)]
    one, two = (project(camera, points, threads=n) for n in (1, 2))
    assert one == two
    last = one.selected(one.point == 2)
    assert (last.point == 2).all() and len(last) == (one.point == 2).sum()
    np.testing.assert_array_equal(last.points, one.points)
    np.testing.assert_array_equal(project(camera, points[0]).position, one.position[one.point == 0])
    few, many = (project(camera, points[1], rays=n) for n in (64, 1 << 14))
    few_rows, many_rows = pairs(few, many)
    assert len(few_rows) == len(few)
    np.testing.assert_array_equal(few.position[few_rows], many.position[many_rows])
    assert np.median(many.centroid_error) < 0.1 * np.median(few.centroid_error)


def test_of_several_chief_rays_the_one_that_passes_is_found():
    """Behind a strong retrofocus lens a point and a microlens have two rays: one vignetted, and one that is seen."""
    lens, array = pl.load_lens("retrofocus-100mm-f1.9"), pl.MicrolensArray(pitch=3.0, focal_lengths=(10.0,))
    camera = pl.PlenopticCamera(lens, pl.Sensor((300, 400), 0.2), 318.18947573, array, 8.0)
    projection = camera.project([9.35, 29.43, -446.0])
    (row,) = np.flatnonzero((projection.index == (-3, -1)).all(axis=1))
    assert projection.passes[row]
    # Pixels are 0.2 mm: the blur of the light is some of them wide, and its middle is on the ray that passes.
    np.testing.assert_allclose(projection.pixel[row], [110.0, 231.0], atol=0.01)
    np.testing.assert_allclose(projection.pixel[row], projection.centroid_pixel[row], atol=0.2)


def test_impossible_arguments():
    for change, sentence in (
        ({"camera": 3}, "camera is an int; give a PlenopticCamera"),
        ({"points": (0, 0, -10)}, r"point 0 lies at z = -10 mm .* points must lie in front of it"),
        ({"points": (0, 0)}, r"points has shape \(1, 2\); it must have shape \(n, 3\)"),
        ({"rays": 0}, "rays is 0; it must be at least 1"),
        ({"scene": 3}, "scene is an int; give a Scene"),
    ):
        with refused(sentence):
            project(**{"camera": camera_with(), "points": (0, 0, -404), **change})
