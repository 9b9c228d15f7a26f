"""Ground truth of pixels: geometry, identities, images of points in closed form and by chords, and bits."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, the_lens

import plenoptic as pl
from plenoptic.camera.points.projection import project
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.truth.channels import NO_MICROLENS, Truth
from plenoptic.truth.ground_truth import ground_truth

THIN_LENS = pl.LensModel.THIN


def plane(z, size=4000.0):
    return pl.Scene([pl.quad((-size / 2, -size / 2, z), (size, 0, 0), (0, size, 0), material=pl.Emissive(1.0))])


def thin_image(lens, z):
    """Image position of the plane z by a thin lens, by the lens formula from its principal plane."""
    points = pl.paraxial.cardinal_points(lens)
    s = points.rear_principal - z
    return points.rear_principal + 1.0 / (1.0 / points.efl - 1.0 / s)


SOME = np.s_[100:116, 300:316]
POSE = {"position": (30.0, -20.0, 50.0), "look_at": (10.0, 5.0, -350.0), "up": (0.2, 1.0, 0.1)}


def test_depth_distance_and_position_are_one_point():
    plain = camera_with()
    placed = plain.moved(pl.CameraPart.LENS, shift=(0.5, -0.3, 0.2), tilt=(0.01, -0.02, 0.3)).posed(**POSE)
    for camera in (plain, placed):
        truth = ground_truth(pl.objects_scene(), camera, region=SOME)
        in_camera = truth.position if camera.pose is None else camera.pose.to_camera(truth.position)
        is_hit = np.isfinite(truth.depth)
        assert is_hit.mean() > 0.9
        # Some ten roundings of coordinates below 1000 mm: 1e-12.
        np.testing.assert_allclose(truth.depth[is_hit], -in_camera[is_hit][:, 2], rtol=0, atol=1e-11)
        np.testing.assert_allclose(
            truth.distance[is_hit], np.linalg.norm(in_camera[is_hit], axis=1), rtol=0, atol=1e-11
        )
        assert np.isnan(truth.position[~is_hit]).all() and np.isinf(truth.distance[~is_hit]).all()
        # It lies on the plane that is seen, whose normal faces the camera.
        truth = ground_truth(plane(-404.0), camera, region=SOME)
        is_hit = np.isfinite(truth.depth)
        assert is_hit.any()
        np.testing.assert_allclose(truth.position[is_hit][:, 2], -404.0, rtol=1e-14)
        np.testing.assert_allclose(truth.normal[is_hit], np.broadcast_to([0.0, 0.0, 1.0], truth.position[is_hit].shape))


def test_normals_of_a_sphere_are_those_of_its_facets():
    # Facets of 128 x 64 segments are turned from the sphere by at most half their diagonal, 0.5 hypot(2 pi / 128,
    # pi / 64) = 0.035.
    ball = pl.sphere(60.0, center=(5.0, -3.0, -500.0), material=pl.Lambertian(0.5))
    truth = ground_truth(pl.Scene([ball], background=1.0), camera_with(), region=np.s_[::1, 250:262])
    is_hit = np.isfinite(truth.depth)
    outwards = (truth.position[is_hit] - [5.0, -3.0, -500.0]) / 60.0
    normal = truth.normal[is_hit]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-15)
    assert np.all(np.einsum("ij,ij->i", outwards, normal) > math.cos(0.036) * 0.999)
    # Towards the camera, and of the triangle, not of its vertices: many pixels share a facet's.
    assert np.all(normal[:, 2] > 0)
    assert len(np.unique(normal.round(9), axis=0)) < 0.5 * len(normal)


def test_normals_face_the_camera_from_either_side():
    for order in ((4000, 0, 0), (0, 4000, 0)), ((0, 4000, 0), (4000, 0, 0)):
        sheet = pl.Scene([pl.quad((-2000, -2000, -404), *order)], background=1.0)
        truth = ground_truth(sheet, camera_with(), region=np.s_[250:252, 250:252])
        np.testing.assert_array_equal(truth.normal[0, 0], [0.0, 0.0, 1.0])


def test_objects_and_materials_have_the_numbers_of_the_scene():
    grey, red = pl.Lambertian(0.5), pl.Lambertian((0.8, 0.1, 0.1))
    quads = [
        pl.quad((x, y, -404.0), (200, 0, 0), (0, 200, 0), material=material)
        for x, y, material in ((0, 0, grey), (-200, 0, red), (-200, -200, grey))
    ]
    lamp = pl.QuadLight((0, -200, -404.0), (200, 0, 0), (0, 200, 0), radiance=1.0)
    truth = ground_truth(pl.Scene(quads, lights=[lamp]), camera_with())
    is_hit = np.isfinite(truth.depth)
    x, y = truth.position[..., 0], truth.position[..., 1]
    expected = np.select([(x > 0) & (y > 0), (x < 0) & (y > 0), (x < 0) & (y < 0)], [0, 1, 2], 3)
    inside = is_hit & (np.abs(x) > 1e-6) & (np.abs(y) > 1e-6)
    assert inside.mean() > 0.7
    np.testing.assert_array_equal(truth.object[inside], expected[inside])
    np.testing.assert_array_equal(truth.material[inside], np.array([0, 1, 0, 2])[expected[inside]])
    assert (truth.object[~is_hit] == -1).all() and (truth.material[~is_hit] == -1).all()


ARRAYS = [
    {"focal_lengths": (1.7, 2.0, 2.4)},
    {"lattice": pl.Lattice.SQUARE},
    {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.3, 0.2)},
    {"imperfections": pl.MicrolensImperfections(pitch_jitter=0.004, decentre=0.004, seed=3)},
    {"model": pl.optics.MicrolensModel.SPHERICAL},
    {"model": pl.optics.MicrolensModel.PINHOLE},
    {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.6)},
]


def test_a_pixel_belongs_to_the_microlens_whose_image_is_nearest():
    # The exit pupil lies 128.5 mm before the array: images of centres are enlarged by 1 + b / 128.5, to within
    # the pupil's aberrations. Halfway between images either may give more light.
    for array in ARRAYS:
        camera = camera_with(**array)
        microlenses_ = camera.microlenses
        truth = ground_truth(None, camera, region=np.s_[40:60, 40:60])
        assert truth.kinds == Truth.MICROLENS | Truth.INCIDENCE_ANGLE | Truth.STATE
        rows, columns = np.mgrid[40:60, 40:60]
        on_array = camera.sensor.centre_of(rows, columns) / (1 + 1.7 / 128.5)
        lit = truth.microlens_type >= 0
        assert lit.mean() > 0.4, array
        index = truth.microlens[lit].astype(int)
        np.testing.assert_array_equal(truth.microlens[~lit], NO_MICROLENS)
        off = np.hypot(*(index @ microlenses_.basis - on_array[lit]).T)
        nearest = np.hypot(*(microlenses_.nearest(on_array[lit]) - on_array[lit]).T)
        assert np.all(off < nearest + 0.04), array
        types = microlenses_.type_pattern
        expected = types[index[:, 0] % types.shape[0], index[:, 1] % types.shape[1]]
        np.testing.assert_array_equal(truth.microlens_type[lit], expected)
        assert len(np.unique(index, axis=0)) >= 2


def test_free_microlenses_have_their_numbers():
    regular = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
    lenses = regular.lenses((-4.0, -4.0), (4.0, 4.0))
    order = np.random.default_rng(1).permutation(len(lenses))
    # Lenses far outside take part in the numbering only.
    centres = np.concatenate([lenses.centre[order], [[50.0, 0.0], [0.0, -50.0]]])[::-1]
    types = np.arange(len(centres)) % 2
    free = camera_with(lattice=pl.Lattice.FREE, centres=centres, types=types, focal_lengths=(2.0, 2.0), pitch=0.2)
    region = np.s_[60:90, 400:420]
    regular_truth, free_truth = (
        ground_truth(None, camera_with(), region=region),
        ground_truth(None, free, region=region),
    )
    lit = regular_truth.microlens_type >= 0
    # Cells and outlines are cut in another order, and a probe on the edge of the light may be on either side of it.
    other = free_truth.microlens_type >= 0
    assert np.mean(other != lit) < 0.02
    lit &= other
    number = free_truth.microlens[..., 0][lit]
    assert (free_truth.microlens[..., 1][lit] == 0).all()
    # A pixel between two microlenses may go to either.
    same = np.hypot(*(centres[number] - regular_truth.microlens[lit] @ regular.basis).T) < 1e-6
    assert same.mean() > 0.97
    np.testing.assert_array_equal(free_truth.microlens_type[lit], types[number])


def test_angles_of_incidence_without_microlenses_are_those_from_the_exit_pupil():
    # Without aberrations the centroid of the light is the middle of the exit pupil. Each of the 16 probes that find it
    # stands for a square of 0.44 radii along a side: single pixels are off by less than half a radius, their mean by a
    # fraction of that.
    lens = the_lens(1.0, pl.LensModel.PARAXIAL)
    camera = bare_camera(lens, shape=(33, 65), pitch=1.0)
    points = pl.paraxial.cardinal_points(lens)
    truth = ground_truth(None, camera, truth=Truth.INCIDENCE_ANGLE)
    assert truth.kinds == Truth.INCIDENCE_ANGLE
    rows, columns = np.mgrid[0:33, 0:65]
    off = np.linalg.norm(camera.sensor.centre_of(rows, columns), axis=-1)
    to_pupil = 134.6 - points.exit_pupil
    expected = np.arctan2(off, to_pupil)
    off = (truth.incidence_angle - expected) / (points.exit_pupil_semi_diameter / to_pupil)
    assert np.abs(off).max() < 0.5 and abs(off.mean()) < 0.05


def test_angles_of_incidence_lead_through_the_microlens():
    # The exit pupil's image on a microlens of 0.217 mm is all of it for pixels near the centre of its image: the lit
    # centroid is the centre of the cell there, and the path from the pixel to it is straight.
    thin, region = camera_with(), np.s_[248:264, 120:136]
    thick = camera_with(model=pl.optics.MicrolensModel.SPHERICAL)
    for camera in (thin, *(camera_.moved(pl.CameraPart.SENSOR, tilt=(0.05, -0.03, 0.4)) for camera_ in (thin, thick))):
        truth = ground_truth(None, camera, truth=Truth.INCIDENCE_ANGLE | Truth.MICROLENS, region=region)
        rows, columns = np.mgrid[region]
        lit = truth.microlens_type >= 0
        np.testing.assert_array_equal(np.isnan(truth.incidence_angle), ~lit)
        turn = np.eye(3) if camera.sensor_placement is None else np.asarray(camera.sensor_placement.rotation)
        on_sensor = camera.sensor.centre_of(rows, columns)
        pixel = np.append(on_sensor, np.zeros((*rows.shape, 1)), axis=-1) @ turn.T + [0.0, 0.0, 1.7]
        centre = np.append(truth.microlens @ camera.microlenses.basis, np.zeros((*rows.shape, 1)), axis=-1)
        ray = centre - pixel
        expected = np.arccos(ray @ -turn[:, 2] / np.linalg.norm(ray, axis=-1))
        # Where part of a microlens is dark, its lit centroid lies off its centre, but inside: a corner is 0.1253 mm
        # away.
        off = np.abs(truth.incidence_angle - expected)[lit]
        assert np.mean(off < 1e-9) > 0.3 and off.max() < 0.1253 / 1.7


def test_virtual_depth_and_disparity_of_a_thin_lens_are_closed_forms():
    # A thin lens images planes onto planes without aberrations. Derivatives are good to 1e-9 (see `truth._TURN`).
    lens = the_lens(model=THIN_LENS)
    for b, to_array in ((1.7, 123.3), (2.4, 112.0), (2.0, 123.3)):  # Galilean, Keplerian, 1.0
        camera = camera_with(b=b, lens=lens, to_array=to_array)
        for z in (-300.0, -404.0, -1000.0, -1e6):
            truth = ground_truth(plane(z, size=-z), camera, region=np.s_[200:208, 240:256])
            a = thin_image(lens, z) - camera.stop_to_microlenses
            is_hit = np.isfinite(truth.depth)
            assert is_hit.mean() > 0.8
            np.testing.assert_allclose(truth.depth[is_hit], -z, rtol=8 * np.finfo(float).eps)
            np.testing.assert_allclose(truth.virtual_depth[is_hit], a / b, rtol=3e-9)
            np.testing.assert_allclose(truth.disparity[is_hit], 21.7 * b / a, rtol=3e-9)
            np.testing.assert_allclose(truth.view_disparity[is_hit], a / (21.7 * b), rtol=3e-9)
            assert np.isnan(truth.virtual_depth[~is_hit]).all()


def middle_of(camera):
    """Ground truth of the plane at z = -404 in the middle of the sensor, and which pixels meet it."""
    truth = ground_truth(plane(-404.0), camera, region=np.s_[250:262, 250:262])
    is_hit = np.isfinite(truth.depth)
    assert is_hit.any()
    return truth, is_hit


def test_a_point_imaged_on_the_array_has_no_virtual_depth_and_stands_still_in_views():
    lens = the_lens(model=THIN_LENS)
    truth, is_hit = middle_of(camera_with(lens=lens, b=2.0, to_array=thin_image(lens, -404.0)))
    np.testing.assert_allclose(truth.virtual_depth[is_hit], 0.0, atol=1e-9)
    np.testing.assert_allclose(truth.view_disparity[is_hit], 0.0, atol=1e-9)
    assert not np.isnan(truth.disparity[is_hit]).any()


def test_without_main_lens_the_scene_is_its_own_image():
    # A camera array: a is minus the distance from the array to the plane.
    truth, is_hit = middle_of(camera_with(lens=the_lens(16.0, pl.LensModel.NONE), to_array=40.0, b=2.0))
    np.testing.assert_allclose(truth.virtual_depth[is_hit], -444.0 / 2.0, rtol=3e-9)


def test_virtual_depth_on_a_tilted_array_and_sensor():
    # Both distances are along the array's normal: a from its plane to the image point, b to the pixel.
    lens, tilt = the_lens(model=THIN_LENS), 0.05
    camera = camera_with(lens=lens).moved(pl.CameraPart.MICROLENSES, tilt=(0.0, tilt, 0.0))
    truth = ground_truth(plane(-404.0), camera, region=np.s_[250:262, 40:472])
    is_hit = np.isfinite(truth.depth)
    rows, columns = np.mgrid[250:262, 40:472]
    b = camera.sensor.centre_of(rows, columns)[is_hit][:, 0] * math.sin(tilt) + 1.7 * math.cos(tilt)
    # A thin lens images points along rays through its centre.
    z_image, principal = thin_image(lens, -404.0), pl.paraxial.cardinal_points(lens).rear_principal
    fraction = (z_image - principal) / (-404.0 - principal)
    a = truth.position[is_hit][:, 0] * fraction * math.sin(tilt) + (z_image - 123.3) * math.cos(tilt)
    # Where the centre is dark the ray starts half a pixel aside at most: 0.005 mm of 1.7, times the tilt.
    off = np.abs(truth.virtual_depth[is_hit] * b / a - 1.0)
    assert (off < 1e-8).mean() > 0.98 and off.max() < 1.1 * tilt * 0.005 / 1.7
    assert np.ptp(truth.virtual_depth[is_hit]) > 0.02


def test_what_a_pixel_sees_through_a_pinhole_is_projected_onto_its_centre():
    # Its ray passes the microlens's centre: it is the chief ray itself. 1e-9 mm behind the lens is 1e-7 pixels. Where
    # the pixel's centre is dark, the ray starts elsewhere on the pixel.
    jitter = pl.MicrolensImperfections(pitch_jitter=0.005, decentre=0.005, seed=2)
    rectangular = {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.25, 0.2)}
    for placed, array in ((False, {}), (True, {}), (True, rectangular), (True, {"imperfections": jitter})):
        camera = camera_with(model=pl.optics.MicrolensModel.PINHOLE, **array)
        if placed:
            camera = (
                camera.moved(pl.CameraPart.LENS, shift=(0.2, 0.1, 0.1), tilt=(0.01, 0.02, 0.1))
                .moved(pl.CameraPart.MICROLENSES, shift=(0.03, 0.02, 0.1), tilt=(0.01, -0.01, 0.05))
                .moved(pl.CameraPart.SENSOR, shift=(0.05, 0.02, -0.05), tilt=(-0.01, 0.02, -0.03))
                .posed(**POSE)
            )
        region = np.s_[130:134, 400:406]
        truth = ground_truth(pl.objects_scene(), camera, region=region)
        is_hit = np.isfinite(truth.depth)
        assert is_hit.mean() > 0.5
        projection = project(camera, truth.position[is_hit])
        rows, columns = np.mgrid[region]
        off = []
        for k, (row, column, index) in enumerate(
            zip(rows[is_hit], columns[is_hit], truth.microlens[is_hit], strict=True)
        ):
            in_row = (projection.point == k) & (projection.index == index).all(axis=1)
            assert in_row.sum() == 1 and projection.passes[in_row].all() and projection.visible[in_row].all()
            off.append(np.abs(projection.pixel[in_row][0] - [row, column]).max())
        assert np.mean(np.array(off) < 1e-6) > 0.6 and max(off) < 0.5, (placed, array)


def test_a_rendering_has_the_same_truth_and_only_requested_channels():
    camera, scene, region = camera_with(), pl.objects_scene(), np.s_[230:250, 240:280]
    whole = ground_truth(scene, camera, region=region)
    requested = Truth.NORMAL | Truth.DISPARITY
    shot = pl.render(scene, camera, samples=1, region=region, truth=requested, tile_side=7, progress=False)
    assert shot.truth.kinds == requested and shot.depth is None
    np.testing.assert_array_equal(shot.truth.normal, whole.normal)
    np.testing.assert_array_equal(shot.truth.disparity, whole.disparity)
    without = pl.render(scene, camera, samples=1, region=region, truth=Truth.NONE, tile_side=7, progress=False)
    assert without.truth is None
    np.testing.assert_array_equal(without.image, shot.image)


def test_unavailable_channels_are_left_out():
    camera, region = camera_with(), np.s_[250:254, 250:254]
    shot = pl.render(pl.Scene(background=1.0), camera, samples=1, region=region, truth=Truth.ALL, progress=False)
    assert shot.truth == ground_truth(None, camera, region=region)
    with pytest.raises(pl.errors.InvalidValueError, match="nothing of .*DEPTH.* can be found"):
        ground_truth(None, camera, truth=Truth.DEPTH)
    # A conventional camera has no microlenses.
    bare = bare_camera(shape=(32, 32), pitch=0.1)
    truth = ground_truth(plane(-404.0), bare)
    assert truth.kinds == Truth.ALL & ~(Truth.MICROLENS | Truth.VIRTUAL_DEPTH | Truth.DISPARITY)
    np.testing.assert_allclose(truth.depth, 404.0, rtol=1e-14)
    with pytest.raises(pl.errors.InvalidValueError, match="no meshes and the camera no microlenses"):
        ground_truth(None, bare, truth=Truth.ALL & ~(Truth.INCIDENCE_ANGLE | Truth.STATE))
    # The plan says so.
    white = pl.shapes.white_plane()
    for scene, camera_, truth, runs, reason in (
        (white, camera, Truth.DEPTH | Truth.OBJECT, True, "depth, object"),
        (white, camera, Truth.NONE, False, "not asked for"),
        (pl.Scene(background=1.0), camera, Truth.DEPTH, False, "there is no mesh"),
        (white, bare, Truth.DISPARITY, False, "there are no microlenses"),
    ):
        decision = next(
            d for d in pl.plan(scene, camera_, truth=truth).decisions if d.stage is pl.rendering.Stage.TRUTH
        )
        assert (decision.runs, decision.reason) == (runs, reason)


WANTED = Truth.POSITION | Truth.MICROLENS | Truth.DISPARITY | Truth.CHORD_DISPARITY
LEANING = pl.Scene([pl.quad((-900, -900, -380.0), (1800, 0, -90), (0, 1800, 200), material=pl.Emissive(1.0))])
SMALL = {"shape": (400, 400)}
TILTED = pl.optics.Placement(rotation=rotation_about_axes((0.01, 0.02, 0.05)), shift=(0.03, -0.02, 0.01))
PLACED = {"microlenses_placement": TILTED, "sensor_placement": TILTED}
CAMERAS = {
    "hexagonal": camera_with(**SMALL),
    "Keplerian, square": camera_with(b=2.3, lattice=pl.Lattice.SQUARE, **SMALL).focused_at(z=-300.0),
    "rectangular": camera_with(lattice=pl.Lattice.RECTANGULAR, pitch=(0.2, 0.25), **SMALL),
    "out of place": dataclasses.replace(
        camera_with(imperfections=pl.MicrolensImperfections(decentre=0.002, seed=3), **SMALL), **PLACED
    ),
}


def slope_of_projection(camera, point, lens):
    """Disparity by `project` from a microlens to its neighbours; through a wider stop, which vignettes less."""
    wide = dataclasses.replace(camera, lens=the_lens(stop=22.0))
    projection, array = project(wide, point, rays=8), camera.microlenses
    centres = pl.microlens_centres(camera, pl.CentreMethod.ORTHOGONAL, margin=1.0)
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    steps += [(1, -1), (-1, 1)] if array.lattice is pl.Lattice.HEXAGONAL else []
    slopes = []
    for index in [lens, *(lens + np.array(step) for step in steps)]:
        centre = centres.pixel[(centres.index == index).all(axis=1)][0]
        slopes.append((projection.pixel[(projection.index == index).all(axis=1)][0] - centre, centre))
    offset, centre = np.moveaxis(slopes, 1, 0)
    image_steps, centre_steps = offset[1:] - offset[0], centre[1:] - centre[0]
    return -min(array.pitches) / 0.01 * (image_steps * centre_steps).sum() / (centre_steps**2).sum()


def test_disparity_of_chords_is_that_of_projections_through_neighbours():
    # To 1e-8 pixels: chief rays pass their centres to 1e-10 mm, and lenses are 0.2 mm apart.
    for name, camera_ in CAMERAS.items():
        truth = ground_truth(LEANING, camera_, truth=WANTED, region=np.s_[190:214, 150:174], threads=2)
        for pixel in ((3, 4), (12, 12), (20, 7)):
            expected = slope_of_projection(camera_, truth.position[pixel], truth.microlens[pixel])
            assert truth.chord_disparity[pixel] == pytest.approx(expected, rel=0, abs=1e-8), name
        # Aberrations over a pitch.
        assert np.nanmax(np.abs(truth.chord_disparity / truth.disparity - 1)) < 0.05
        part = ground_truth(LEANING, camera_, truth=WANTED, region=np.s_[197:209, 155:168], threads=1)
        assert np.array_equal(part.chord_disparity, truth.chord_disparity[7:19, 5:18], equal_nan=True)


def test_without_aberrations_disparity_of_chords_is_that_of_rays_near_the_pixels_own():
    # Both are pitch / (v pixel pitch); derivatives of the latter are differences, good to 1e-8 of it.
    for model, region in ((THIN_LENS, np.s_[100:130, 20:60]), (pl.LensModel.NONE, np.s_[190:200, 190:200])):
        truth = ground_truth(LEANING, camera_with(lens=the_lens(model=model), **SMALL), truth=WANTED, region=region)
        is_hit = np.isfinite(truth.disparity)
        assert is_hit.any() and np.array_equal(np.isfinite(truth.chord_disparity), is_hit)
        assert np.abs(truth.chord_disparity / truth.disparity - 1)[is_hit].max() < 1e-7
    # Lenses without a lattice have no neighbours.
    centres = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)).lenses((-1.0, -1.0), (1.0, 1.0)).design
    free = camera_with(pitch=0.12, lattice=pl.Lattice.FREE, centres=centres, **SMALL)
    truth = ground_truth(LEANING, free, truth=WANTED, region=np.s_[184:216, 184:216])
    assert np.isfinite(truth.disparity).any() and np.isnan(truth.chord_disparity).all()
