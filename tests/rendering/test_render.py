"""Rendering: laws of light, closed forms, honest errors, and bits that do not depend on scheduling."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.sampling import region_bounds
from plenoptic.truth.channels import Truth

sys.path.insert(0, str(Path(__file__).parent / "integrator"))
from pinholes import irradiance_of_polygon  # noqa: E402


def reference_camera(b=1.7, stop=5.0, shape=(512, 512), pitch=0.010, **array):
    """The camera of the reference scenes; mode 2.0 by default, 1.0 with b = 2.0 and stop = 4.25."""
    return dataclasses.replace(
        pl.camera.example_camera(),
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=stop)),
        microlenses=pl.MicrolensArray(**{"pitch": 0.217, "focal_lengths": (2.0,), **array}),
        sensor=pl.Sensor(shape=shape, pixel_pitch=pitch),
        microlenses_to_sensor=b,
    )


def conventional(stop, pixels, pitch, distance=134.6):
    """Without microlenses; in focus at z = -404 mm by default."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=stop))
    return pl.PlenopticCamera(lens, pl.Sensor((pixels, pixels), pitch), stop_to_microlenses=distance)


def hexagon_solid_angle(pitch, distance):
    """Projected solid angle of a hexagonal cell seen from the point below its centre."""
    angle = math.pi / 3 * np.arange(6)
    corners = np.column_stack([np.cos(angle), np.sin(angle), np.full(6, distance / (pitch / math.sqrt(3)))])
    return irradiance_of_polygon(np.zeros((1, 3)), (0.0, 0.0, 1.0), corners)[0]


def test_white_pixel_is_projected_solid_angle_of_its_cell():
    # The pixel on the axis (odd sensor) is shrunk until its extent does not matter: the solid angle is stationary at
    # the centre, so a pixel of 1e-4 mm is off by O((1e-4 / 1.7)^2) = 3e-9 of it.
    expected = hexagon_solid_angle(0.217, 1.7)
    assert expected == pytest.approx(0.0140472, abs=5e-8)
    camera = reference_camera(shape=(1, 1), pitch=1e-4)
    white = pl.render_white(camera, samples=1 << 14, replicates=8, progress=False)  # a block has one pixel
    error = float(white.standard_error[0, 0, 0])
    assert error < 1e-6
    # 5 standard errors with 7 degrees of freedom, and float32.
    assert white.image[0, 0, 0] == pytest.approx(expected, abs=5 * error + 1e-7 * expected)


def test_uniform_scene_is_its_radiance_times_white():
    region = np.s_[240:272, 300:332]
    for mode, lattice in (((1.7, 5.0), pl.Lattice.HEXAGONAL), ((2.0, 4.25), pl.Lattice.SQUARE)):
        camera = reference_camera(*mode, lattice=lattice)
        white = pl.render_white(camera, samples=64, region=region, seed=1, progress=False)
        scene = pl.Scene(background=2.5)
        shot = pl.render(scene, camera, samples=64, region=region, seed=2, progress=False)
        deviation = shot.image - 2.5 * white.image
        joint = np.hypot(shot.standard_error, 2.5 * white.standard_error)
        # Sum over pixels: independent errors. 4 standard errors.
        assert abs(deviation.sum(dtype=np.float64)) < 4 * math.sqrt(np.square(joint, dtype=np.float64).sum()), mode
        # Errors are pooled over blocks: those of pixels that lose one path in a hundred are right on average only.
        assert np.sqrt(np.mean(deviation**2) / np.mean(joint**2)) < 1.3, mode


def test_the_same_seed_makes_light_of_all_radiances_alike():
    camera, settings = reference_camera(), {"samples": 16, "region": np.s_[250:260, 250:260], "progress": False}
    one, four, little = (pl.render(pl.Scene(background=r), camera, **settings).image for r in (1.0, 4.0, 2.0**-20))
    np.testing.assert_array_equal(four, 4.0 * one)
    np.testing.assert_array_equal(little, 2.0**-20 * one)
    # An emissive plane that fills the view is a sky.
    np.testing.assert_array_equal(pl.render(pl.shapes.white_plane(), camera, **settings).image, one)


def micro_image_pitch(camera):
    """Pitch in pixels, from the centroids of white micro images at the two ends of the sensor along y."""
    # Along the column of lenses through x = 0 (nearest neighbours along y).
    middle = camera.sensor.shape[1] // 2
    white = pl.render_white(camera, samples=64, region=np.s_[:, middle - 11 : middle + 11], progress=False)
    rows, k = np.arange(camera.sensor.shape[0]) + 0.5, np.arange(-11, 12)
    expected = 0.217 / 0.010 * (1 + camera.microlenses_to_sensor / 128.5)
    places = camera.sensor.shape[0] / 2 + k[:, None] * expected
    # A window of one pitch: what leaks in from the neighbours is the same on both sides.
    weight = np.clip(expected / 2 + 0.5 - np.abs(rows - places), 0, 1)
    profiles = weight * white.image.sum(axis=(1, 2), dtype=np.float64)
    return np.polyfit(k, profiles @ rows / profiles.sum(axis=1), 1)[0]


def test_micro_images_repeat_at_the_reference_pitch():
    for mode, expected in (((1.7, 5.0), 21.987), ((2.0, 4.25), 22.038)):
        assert micro_image_pitch(reference_camera(*mode)) == pytest.approx(expected, abs=0.01), mode


def small_light(x, y, z, size):
    return pl.Scene([pl.quad((x - size / 2, y - size / 2, z), (size, 0, 0), (0, size, 0), material=pl.Emissive(1.0))])


def spots_by_microlens(camera, scene, scale, samples=256):
    """Centroid (x, y on the sensor, mm) and flux of a small light in each micro image, keyed by the cell.

    Pixels count for the microlens whose centre times `scale` is nearest.
    """
    shot = pl.render(scene, camera, samples=samples, progress=False, truth=Truth.NONE)
    rows, columns = np.nonzero(shot.image[:, :, 0])
    light = shot.image[rows, columns, 0].astype(np.float64)
    places = camera.sensor.centre_of(rows, columns)
    cells = camera.microlenses.nearest(places / scale)
    found = {}
    for cell in np.unique(cells.round(9), axis=0):
        mine = np.all(np.abs(cells - cell) < 1e-6, axis=1)
        found[tuple(cell)] = ((places[mine] * light[mine, None]).sum(axis=0) / light[mine].sum(), light[mine].sum())
    return found


def disparities_in_mode_2():
    """On-axis disparities in the plane in focus, in pixels: from lens centres, and from chief-ray centres."""
    camera = reference_camera(shape=(192, 192))
    points = pl.paraxial.cardinal_points(camera.lens)
    a = pl.paraxial.image_position(camera.lens, -404.0) - 123.3
    spots = spots_by_microlens(camera, small_light(0, 0, -404, 0.2), 1 - 1.7 / a)
    cell, spot = np.array([(c[1], s[0][1]) for c, s in spots.items() if abs(c[0]) < 1e-6 and abs(c[1]) < 0.5]).T
    assert len(cell) >= 5
    step = np.polyfit(cell / 0.217, spot / 0.010, 1)[0]
    return 21.7 - step, 21.7 * (1 + 1.7 / (123.3 - points.exit_pupil)) - step


def test_disparity_between_neighbouring_microlenses_in_mode_2():
    # The point's image lies a = 11.33 behind the array, and through the centre of the microlens at c it falls on the
    # sensor at c (1 - b / a), b = 1.7: disparity of neighbours relative to the lens centres p b / a = 3.255 pixels,
    # relative to the chief-ray centres c (1 + b / L) it is p b (1 / a + 1 / L) = 3.542 pixels.
    assert disparities_in_mode_2() == pytest.approx((3.255, 3.542), abs=0.02)


def test_direction_in_mode_1_decides_the_place_under_the_microlens():
    # With the sensor in the focal plane, a point imaged on the array (a = 0) lights the whole image of the one
    # microlens above it; one imaged behind spreads over its neighbours.
    camera = reference_camera(2.0, 4.25, shape=(64, 64)).focused_at(z=-404.0)
    spots = spots_by_microlens(camera, small_light(0, 0, -404, 0.2), 1.0)
    brightest = max(spots.values(), key=lambda s: s[1])
    assert brightest[1] / sum(s[1] for s in spots.values()) > 0.99
    np.testing.assert_allclose(brightest[0], 0.0, atol=0.002)


def test_image_stands_upright_and_is_not_mirrored():
    # A light up and to the right of the axis appears in the upper right of the image, with and without microlenses.
    for camera in (conventional(2.0, 32, 0.16, 130.0).focused_at(z=-404.0), reference_camera()):
        shot = pl.render(small_light(5.0, 3.0, -404, 0.5), camera, samples=4, progress=False)
        row, column = np.argwhere(shot.image[:, :, 0] > 0).mean(axis=0)
        height, width = camera.sensor.shape
        assert row < 0.4 * height and column > 0.6 * width
        # Magnification -0.328 of the double Gauss at this distance.
        assert (column + 0.5 - width / 2) * camera.sensor.pixel_pitch == pytest.approx(5.0 * 0.33, abs=0.25)


def test_pose_moves_the_camera_and_not_the_picture():
    camera = reference_camera()
    region = np.s_[200:220, 300:320]
    # Without onward rays: the frame in which their directions are drawn would turn with the scene.
    scene = pl.Scene(pl.objects_scene().meshes, pl.objects_scene().lights)
    here = pl.render(scene, camera, samples=16, region=region, max_bounces=1, progress=False)
    # The same scene and camera turned and shifted together.
    turn = pl.Pose.look_at((300, -200, 500), (0, 0, 0), up=(0.3, 1, 0.1))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.rotation, turn.position
    moved = pl.Scene([mesh.transformed(matrix) for mesh in (*scene.meshes, *(light.mesh() for light in scene.lights))])
    posed = camera.posed(position=(300, -200, 500), look_at=(0, 0, 0), up=(0.3, 1, 0.1))
    there = pl.render(moved, posed, samples=16, region=region, max_bounces=1, progress=False)
    # The same random numbers: only float32 rounding at edges decides otherwise, for a few paths.
    joint = np.hypot(here.standard_error, there.standard_error)
    assert np.mean(np.abs(there.image - here.image) < 0.2 * joint + 1e-6) > 0.9
    np.testing.assert_allclose(there.depth, here.depth, rtol=1e-9)


def test_depth_of_a_plane_is_exact():
    region = np.s_[200:232, 200:232]
    shot = pl.render(pl.shapes.white_plane(), reference_camera(), samples=1, region=region, progress=False)
    finite = np.isfinite(shot.depth)
    assert finite.mean() > 0.95
    # A few roundings of coordinates near 404.
    np.testing.assert_allclose(shot.depth[finite], 404.0, rtol=8 * np.finfo(float).eps)
    # Nothing in view is infinitely far.
    behind = pl.Scene([pl.box(10.0, center=(0, 0, 500), material=pl.Emissive(1.0))])
    camera, settings = reference_camera(), {"samples": 1, "region": np.s_[:8, :8], "progress": False}
    shot = pl.render(behind, camera, **settings)
    assert np.all(np.isinf(shot.depth)) and not shot.image.any()
    # Depth is left out on request, and without meshes.
    assert pl.render(pl.shapes.white_plane(), camera, truth=Truth.NONE, **settings).depth is None
    assert pl.render(pl.Scene(background=1.0), camera, **settings).depth is None


@pytest.mark.parametrize("sampler", list(pl.rendering.Sampler))
def test_bits_do_not_depend_on_what_fits_into_a_batch(monkeypatch, sampler):
    # Where replicates do not divide the samples, a batch with just room for all of them holds all but a few.
    camera = pl.PlenopticCamera(pl.no_lens(1.0), pl.Sensor((5, 4), 0.5), stop_to_microlenses=10.0)
    numbers = np.random.default_rng(5)
    for samples, replicates in numbers.integers(1, (70, 13), size=(12, 2)).tolist():
        how = {"samples": samples, "replicates": replicates, "sampler": sampler, "progress": False}
        monkeypatch.setattr("plenoptic.rendering.schedule.clock.PATHS_PER_BATCH", 1 << 20)
        whole = pl.render_white(camera, **how)
        for room in (20 * samples, 20 * samples - 1, int(numbers.integers(1, 20 * samples + 1))):
            monkeypatch.setattr("plenoptic.rendering.schedule.clock.PATHS_PER_BATCH", room)
            other = pl.render_white(camera, **how)
            np.testing.assert_array_equal(other.image, whole.image)
            if samples > 1 and replicates > 1:
                np.testing.assert_array_equal(other.standard_error, whole.standard_error)
            assert other.stats.paths == whole.stats.paths


def test_statistics_count_every_path():
    shot = pl.render_white(reference_camera(), samples=16, region=np.s_[240:272, 240:272], progress=False)
    stats = shot.stats
    assert stats.paths_through_lens + sum(count for _, _, count in stats.lost) == stats.paths
    assert stats.paths <= 32 * 32 * 16 and stats.nonfinite == 0
    assert stats.fraction_through_lens > 0.6
    assert {cause for cause, _, _ in stats.lost} <= {"clipped", "missed"}
    # Numbers may come from NumPy; an error needs two replicates, which have a sample each.
    for samples, replicates, left in ((1, 8, 1), (np.int64(8), np.int32(1), 1), (3, 8, 3)):
        settings = {"seed": 2**64 - 1, "region": np.s_[:4, :4], "progress": False}
        shot = pl.render_white(reference_camera(), samples=samples, replicates=replicates, **settings)
        assert (shot.standard_error is None) == (left == 1) and shot.replicates == left and shot.seed == 2**64 - 1


def test_spherical_microlenses_approach_thin_ones():
    # A higher index makes the same focal length with a flatter sphere. Its edge stands at the sag h = r^2 / (2 R) above
    # or below the plane, which changes the solid angle by about 2 h / b: 0.9 % for index 1.5, a tenth of it for 6.
    settings = {"samples": 512, "region": np.s_[250:262, 250:262], "progress": False}
    thin = pl.render_white(reference_camera(), **settings).image.sum(dtype=np.float64)
    for side in pl.optics.ConvexSide:
        off = []
        for index in (1.5, 6.0):
            lenses = {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.05, "index": index}
            spherical = pl.render_white(reference_camera(**lenses, convex_side=side), **settings)
            off.append(abs(spherical.image.sum(dtype=np.float64) / thin - 1))
            assert spherical.stats.lost_by_cause["outside_microlens"] < 0.05 * spherical.stats.paths
        assert 0.003 < off[0] < 0.011 and off[1] < 0.2 * off[0], side


def test_pinholes_show_the_pupil_under_every_microlens():
    # Micro images are the exit pupil seen through a point: at b = 1.7 from pinholes at 128.5 from the pupil they
    # have the semi-diameter 7.76 * 1.7 / 128.5 = 0.1027 mm; the light is that of the cell where they are lit.
    # 22 rows and 38 columns are a period of the hexagonal lattice: two micro images.
    camera = reference_camera(model=pl.optics.MicrolensModel.PINHOLE)
    white = pl.render_white(camera, samples=64, region=np.s_[245:267, 237:275], progress=False)
    points = pl.paraxial.cardinal_points(camera.lens)
    radius = points.exit_pupil_semi_diameter * 1.7 / (123.3 - points.exit_pupil)
    lit = white.image.sum(dtype=np.float64) * 0.01**2 / hexagon_solid_angle(0.217, 1.7) / 2
    # cos^4 falls by 0.7 % to the rim; the pupil's spherical aberration is some 0.25 % of its size.
    assert lit == pytest.approx(math.pi * radius**2, rel=0.02)


def test_all_light_through_an_array_arrives_somewhere():
    # Thin microlenses only redistribute: the sum over a large patch of the sensor is the same for two focal lengths, to
    # within edge effects of the patch.
    def white(side, samples=16, **changes):
        region = np.s_[side:356, side:356]
        return pl.render_white(reference_camera(**changes), samples=samples, region=region, progress=False).image

    sums = [white(156, focal_lengths=(f,)).mean(dtype=np.float64) for f in (2.0, 1.2)]
    assert sums[0] == pytest.approx(sums[1], rel=0.01)
    # With the aperture opened up, micro images overlap: the white image rises above one cell's solid angle.
    one, narrow = hexagon_solid_angle(0.217, 1.7), white(256, 64, stop=2.0)
    assert white(256, 64, stop=10.0).max() > 1.8 * one
    assert narrow.max() < 1.001 * one and np.mean(narrow == 0) > 0.5


def test_impossible_arguments_are_refused_before_anything_runs():
    crowded = dataclasses.replace(
        reference_camera(shape=(4, 4)), microlenses=pl.MicrolensArray(pitch=1e-5, focal_lengths=(1e-3,))
    )
    for arguments, message in (
        ({"samples": 0}, "samples is 0; it must be at least 1"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**64}, "at most 18446744073709551615"),
        ({"replicates": 0}, "replicates is 0"),
        ({"threads": 0}, "threads is 0"),
        ({"region": np.s_[0.0:2.0, 0:2]}, "whole numbers"),
        ({"camera": crowded}, "each pixel sees about"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.render_white(**{"camera": reference_camera(), "samples": 1, "progress": False, **arguments})


BLOCK = pl.box((4, 4, 4), center=(0, 0, -402), material=pl.Lambertian(0.7))


def seen_on_a_floor(half, lights=(), background=1.0, place=None):
    """A block on a floor in a wide view, in a place of the world."""
    camera = conventional(5.0, 8, 0.4)
    meshes = [pl.quad((-half, -half, -404), (2 * half, 0, 0), (0, 2 * half, 0), material=pl.Lambertian(0.7)), BLOCK]
    if place is not None:
        camera, meshes = camera.posed(place, place - [0, 0, 1]), [mesh.translated(*place) for mesh in meshes]
    return pl.render(pl.Scene(meshes, lights, background), camera, samples=256, progress=False)


def test_light_does_not_depend_on_how_far_the_floor_goes_on():
    # Under a lamp 2 mm above it: what the camera sees does not change with the size of the floor, whose coordinates
    # along itself must not enter the distance by which shadow rays leave it. The same random numbers: only rays within
    # float32 rounding of an edge are decided otherwise.
    lamp = pl.QuadLight((10, 0, -402), (0, 10, 0), (10, 0, 0), radiance=100.0)
    seen = [seen_on_a_floor(half, [lamp], 0.5).image.mean(dtype=np.float64) for half in (500.0, 1e5, 1e7)]
    np.testing.assert_allclose(seen[1:], seen[0], rtol=2e-3)


def test_camera_and_scene_far_from_the_origin_see_the_same():
    far = 1e9
    here, there = seen_on_a_floor(500.0), seen_on_a_floor(500.0, place=np.array([far, -far, 0.5 * far]))
    assert there.image.mean() == pytest.approx(here.image.mean(), rel=2e-3)
    np.testing.assert_allclose(there.depth, here.depth, atol=8 * far * np.finfo(float).eps)


def brute_force_irradiance(camera, x, n=400_000):
    """Projected solid angle of the lens as seen from (x, 0) on the sensor: uniform points on the plane of its rim."""
    lens, z = camera.lens, camera.z_sensor
    last = lens.elements[-1]
    plane = lens.vertices[-1] + min(0.0, float(last.sag(last.semi_diameter)))
    half = 1.05 * last.semi_diameter
    points = np.random.default_rng(5).uniform(-half, half, (n, 2))
    along = np.column_stack([points, np.full(n, plane)]) - [x, 0.0, z]
    passed = lens.trace_reverse(pl.RayBundle(np.tile([x, 0.0, z], (n, 1)), along)).status == pl.RayStatus.OK
    weight = (z - plane) ** 2 / np.sum(along**2, axis=1) ** 2
    light = np.where(passed, weight, 0.0) * (2 * half) ** 2
    return light.mean(), light.std() / math.sqrt(n)


def test_steep_rear_surfaces_are_seen_to_their_rim():
    # The Topogon's last surface is a deep cap: from far off the axis, light that passes near its rim crosses the plane
    # of its vertex far outside the semi-diameter.
    lens = pl.load_lens("topogon-100mm-f6.3")
    camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(1, 241), pixel_pitch=1.0), stop_to_microlenses=95.1)
    for x in (60.0, 85.0):
        column = round(-x + 120)
        shot = pl.render_white(camera, samples=4096, region=np.s_[:, column : column + 1], progress=False)
        expected, error = brute_force_irradiance(camera, x)
        joint = math.hypot(error, float(shot.standard_error[0, 0, 0]))
        # Within a pixel of 1 mm the irradiance is linear to 2e-3.
        assert abs(shot.image[0, 0, 0] - expected) < 4 * joint + 2e-3 * expected, x


def test_fast_spherical_microlenses_lose_no_light_to_the_bounds(monkeypatch):
    # f/1.4 plano-convex lenses, strongly aberrated: pixels between the micro images are fed by rays whose ideal
    # counterparts miss the pupil. Widening all margins must not change the image.
    model = pl.optics.MicrolensModel.SPHERICAL
    camera = reference_camera(0.3, 17.1, focal_lengths=(0.3,), model=model, thickness=0.2)
    settings = {"region": np.s_[100:108, 0:8], "progress": False}
    shot = pl.render_white(camera, samples=1024, **settings)
    margins, widened = region_bounds.aberration_margins, []
    monkeypatch.setattr(
        region_bounds, "aberration_margins", lambda *given: widened.append(0) or [3 * m for m in margins(*given)]
    )
    # Another camera: what has been found for the first one is not used again.
    other = dataclasses.replace(camera, wavelength=camera.wavelength + 1e-9)
    wide = pl.render_white(other, samples=4096, seed=1, **settings)
    assert widened
    joint = np.square(np.hypot(shot.standard_error, wide.standard_error), dtype=np.float64).sum()
    assert abs(float((shot.image - wide.image).sum(dtype=np.float64))) < 4 * math.sqrt(joint)
