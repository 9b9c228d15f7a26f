"""Cameras behind windows: projection, ground truth and report against rays by Snell's law; tanks of glass and water."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, in_world, white

import plenoptic as pl

GLASS, WATER = pl.glass("N-BK7"), pl.glass("water")
D = 587.6
N_WATER, N_GLASS = WATER.index(D), GLASS.index(D)
LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
FLAT = pl.optics.window(LENS, 10.0, GLASS, distance=30.0, outside=WATER)
TILTED = pl.optics.window(LENS, 10.0, GLASS, distance=30.0, tilt=(0.15, -0.08), outside=WATER)
DOME = pl.optics.window(LENS, 6.0, GLASS, distance=40.0, radius=90.0, tilt=(0.05, 0.1), outside=WATER)


def traced(lens, start, direction, last=None):
    """Rays through the spheres and planes of a lens by Snell's law, to element `last`: points and directions."""
    n = lens.indices(D)
    start, direction = np.array(start, dtype=float), np.array(direction, dtype=float)
    for k, (element, z) in enumerate(zip(lens.elements, lens.vertices, strict=True)):
        turn = np.eye(3) if element.placement is None else element.placement.rotation
        vertex = np.array([0.0, 0.0, z]) + (0.0 if element.placement is None else element.placement.shift)
        p, d = (start - vertex) @ turn, direction @ turn
        c = element.curvature if isinstance(element, pl.Surface) else 0.0
        p = p - (p[:, 2] / d[:, 2])[:, None] * d
        f, g = c * (p**2).sum(axis=1), d[:, 2] - c * (p * d).sum(axis=1)
        p = p + (f / (g + np.sqrt(g**2 - c * f)))[:, None] * d
        if isinstance(element, pl.Surface):
            normal, ratio = np.array([0.0, 0.0, 1.0]) - c * p, n[k] / n[k + 1]
            cosine = (d * normal).sum(axis=1)
            d = ratio * d + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine)[:, None] * normal
        start, direction = p @ turn.T + vertex, d @ turn.T
        if k == last:
            break
    return start, direction


def aimed(lens, points, targets, z, last=None):
    """Directions from points (n, 3) of rays that pass (x, y) of the plane z behind the lens, by Newton's method."""
    slopes = points[:, :2] / (points[:, 2:] - pl.paraxial.cardinal_points(lens, D).entrance_pupil)

    def landing(slopes):
        direction = np.column_stack([slopes, np.ones(len(slopes))])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        origin, way = traced(lens, points, direction, last)
        return origin[:, :2] + ((z - origin[:, 2]) / way[:, 2])[:, None] * way[:, :2], direction

    step = 1e-7
    for _ in range(12):
        there = landing(slopes)[0]
        columns = [(landing(slopes + step * np.eye(2)[i])[0] - landing(slopes - step * np.eye(2)[i])[0]) / (2 * step)
                   for i in range(2)]  # fmt: skip
        slopes = slopes - np.linalg.solve(np.stack(columns, axis=-1), (there - targets)[..., None])[..., 0]
    assert np.abs(landing(slopes)[0] - targets).max() < 1e-10
    return landing(slopes)[1]


def points_in_view(camera, *places):
    """Points whose images lie near (x, y) of the array, in mm: behind a tilted window they are aside."""
    x, y, z = np.array(places).T
    ends = np.column_stack([x, y, np.full(len(x), camera.stop_to_microlenses)])
    pupil = np.array([0.0, 0.0, pl.paraxial.cardinal_points(camera.lens).exit_pupil])
    rays = camera.lens.trace_reverse(pl.RayBundle.through(ends, pupil - ends, D))
    return np.concatenate([rays.selected(np.arange(len(x)) == k).at_z(z[k]) for k in range(len(x))])


def focused(lens, z=-700.0, before=11.0, **changes):
    image = pl.paraxial.image_position(lens, z)
    return camera_with(shape=(400, 400), lens=lens, to_array=image - before, **changes)


@pytest.mark.parametrize("lens", [FLAT, TILTED, DOME])
def test_projections_through_windows_are_where_rays_by_snells_law_land(lens):
    pose = pl.Pose.look_at((30.0, -20.0, 10.0), target=(300.0, 50.0, -100.0))
    camera = dataclasses.replace(focused(lens), pose=pose)
    local = points_in_view(camera, (0, 0, -700), (1.5, -1.2, -650), (-1, 1.4, -720), (0.5, 0.2, -2000))
    projection = pl.project(camera, in_world(camera, local), rays=1 << 10, progress=False)
    rows = projection.selected(np.isfinite(projection.position[:, 0]))
    assert len(rows) > 100 and (np.bincount(rows.point) > 10).all()
    centre = rows.index @ camera.microlenses.basis
    z, b = camera.stop_to_microlenses, camera.microlenses_to_sensor
    direction = aimed(lens, local[rows.point], centre, z)
    _, way = traced(lens, local[rows.point], direction)
    expected = centre + b * way[:, :2] / way[:, 2:]
    miss = np.abs(rows.position - expected).max() / camera.sensor.pixel_pitch
    assert miss < 1e-6, miss


def test_chief_rays_without_microlenses_pass_the_centre_of_the_iris():
    camera = bare_camera(TILTED, z=pl.paraxial.image_position(TILTED, -700.0), shape=(400, 400), pitch=0.05)
    local = points_in_view(camera, (0, 0, -700), (8, -9, -650), (-7, 4, -900))
    projection = pl.project(camera, local, rays=1 << 10, progress=False)
    iris = TILTED.iris_index
    direction = aimed(TILTED, local, np.zeros((3, 2)), 0.0, last=iris)
    origin, way = traced(TILTED, local, direction)
    there = origin + ((camera.stop_to_microlenses - origin[:, 2]) / way[:, 2])[:, None] * way
    assert np.abs(projection.position - there[:, :2]).max() < 1e-6 * camera.sensor.pixel_pitch


def plane(z, tilt_deg=0.0, size=4e3, **how):
    return (
        pl.quad((-size / 2, -size / 2, 0), (size, 0, 0), (0, size, 0), **how)
        .rotated_deg((0, 1, 0), tilt_deg)
        .translated(z=z)
    )


def test_truth_behind_a_window_is_the_first_hit_and_its_optical_distance():
    channels = pl.Truth.DEPTH | pl.Truth.POSITION | pl.Truth.OBJECT | pl.Truth.MICROLENS | pl.Truth.OPTICAL_DISTANCE
    # A body between window and lens is not seen: rays begin at the window.
    scene = pl.Scene([pl.quad((-50, -50, -29.0), (100, 0, 0), (0, 100, 0)), plane(-700.0, 20.0), plane(-900.0)])
    small = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.1)
    for lens in (FLAT, TILTED, DOME):
        camera = focused(lens, aperture=small)
        truth = pl.ground_truth(scene, camera, truth=channels, progress=False)
        centres = pl.microlens_centres(camera, progress=False)
        near = np.rint(centres.pixel).astype(int)
        inside = ((near > 20) & (near < 380)).all(axis=1)
        row, column = near[inside].T
        assert len(row) > 100 and (truth.object[row, column] == 1).all()
        assert np.array_equal(truth.microlens[row, column], centres.index[inside])
        points = truth.position[row, column]
        assert np.abs(points[:, 2] + truth.depth[row, column]).max() < 1e-9
        # The ray of such a pixel passes the centre of its microlens; forward, from the point, it meets the pixel.
        z, b = camera.stop_to_microlenses, camera.microlenses_to_sensor
        centre = truth.microlens[row, column] @ camera.microlenses.basis
        direction = aimed(lens, points, centre, z)
        _, way = traced(lens, points, direction)
        landing = camera.sensor.pixel_of(centre + b * way[:, :2] / way[:, 2:])
        assert np.abs(landing - near[inside]).max() < 1e-6
        start, _ = traced(lens, points, direction, last=0)
        length = np.linalg.norm(points - start, axis=1)
        assert np.abs(truth.optical_distance[row, column] - N_WATER * length).max() < 1e-7
        assert truth.optical_distance[row, column].min() > N_WATER * 500.0
    air = pl.ground_truth(pl.Scene([plane(-700.0)]), focused(LENS), truth=channels, progress=False)
    hit = np.isfinite(air.depth)
    front = float(LENS.vertices[0])
    assert hit.any() and (air.optical_distance[hit] >= air.depth[hit] + front - 2.0).all()
    assert np.isinf(air.optical_distance[~hit]).all()
    assert pl.ground_truth(scene, camera, progress=False).optical_distance is None


def test_report_of_a_lens_behind_a_window():
    camera = focused(FLAT, z=-900.0)
    report = camera.report()
    assert "field in the front medium, corner to corner" in str(report)
    assert "viewpoints there, from axis to corner" in str(report)
    # The chief ray of the lens alone from the corner of the sensor, then Snell's law at the plane faces.
    stretch = 1.0 + camera.microlenses_to_sensor / report.exit_pupil_distance
    corner, z = np.array(camera.sensor.size[::-1]) / (2 * stretch), camera.stop_to_microlenses
    chief = pl.aiming.aimed_rays_reverse(LENS, image_point=tuple(corner), z_image=z, pupil=[[0.0, 0.0]])
    out = LENS.trace_reverse(chief)
    rear, front = FLAT.vertices[1], FLAT.vertices[0]
    tangent = math.hypot(*out.direction[0, :2]) / -out.direction[0, 2]
    height = math.hypot(*out.at_z(rear)[0, :2])
    sine = math.sin(math.atan(tangent))
    height += 10.0 * math.tan(math.asin(sine / N_GLASS))
    water = math.asin(sine / N_WATER)
    assert report.front_field == pytest.approx(2 * water, rel=1e-9)
    viewpoint, pupil = front + height / math.tan(water), pl.paraxial.cardinal_points(FLAT).entrance_pupil
    assert report.viewpoint_caustic == pytest.approx(abs(viewpoint - pupil), rel=1e-4)
    # A dome around the pupil leaves the lens's own.
    dome = focused(pl.optics.window(LENS, 6.0, GLASS, radius=90.0, outside=WATER), z=-900.0).report()
    assert 0 < 2 * dome.viewpoint_caustic < report.viewpoint_caustic
    tilted = focused(TILTED, z=-900.0).report()
    assert tilted.front_field == pytest.approx(report.front_field, rel=0.02)
    assert math.isfinite(tilted.viewpoint_caustic)
    for lens in (LENS, pl.optics.window(LENS, 10.0, GLASS, distance=30.0)):
        report = focused(lens).report()
        assert report.front_field is None and report.viewpoint_caustic is None and "front medium" not in str(report)
    # A window too small for the corner.
    narrow = pl.optics.window(LENS, 10.0, GLASS, distance=300.0, outside=WATER, semi_diameter=8.0)
    report = camera_with(shape=(400, 4000), lens=narrow).report()
    assert math.isnan(report.front_field) and math.isnan(report.viewpoint_caustic)


def test_pixels_whose_rays_are_totally_reflected_are_dark():
    wet = dataclasses.replace(LENS, front_medium=WATER)
    focus = pl.paraxial.cardinal_points(wet).rear_focus
    for tilt in (0.84, 1.2):  # the critical angle is 0.848
        lens = pl.optics.window(wet, 5.0, GLASS, distance=200.0, tilt=(tilt, 0.0), outside=pl.optics.AIR)
        camera = bare_camera(lens, z=focus + 3.0, shape=(32, 32), pitch=0.6)
        shot = white(camera)
        truth = pl.ground_truth(pl.Scene([plane(-3000.0, size=1e6)]), camera, progress=False)
        assert np.isfinite(shot.image).all() and np.isfinite(shot.standard_error).all()
        lit = shot.image[..., 0] > 0
        assert (truth.state[lit] == pl.images.PixelState.SEEN).all() and np.isfinite(truth.depth[lit]).all()
        assert 0.3 < lit.mean() < 0.9 if tilt == 0.84 else not lit.any() and np.isinf(truth.depth).all()
        projection = pl.project(camera, [(0.0, 0.0, -800.0), (0.0, 300.0, -800.0)], progress=False)
        assert np.isfinite(projection.light).all()


def tank(size, wall, z):
    """A closed tank of glass around water, with its front on the plane z."""
    centre = (0.0, 0.0, z - 0.5 * size)
    return [
        pl.box(size, center=centre, material=pl.Dielectric(N_GLASS)),
        pl.box(size - 2 * wall, center=centre, material=pl.Dielectric(N_WATER, exterior=N_GLASS)),
    ]


def test_rays_through_a_tank_of_glass_and_water_obey_snells_law():
    camera = bare_camera(LENS, z=pl.paraxial.image_position(LENS, -900.0), shape=(4, 4), pitch=3.0)
    wall, z, depth = 12.0, -500.0, 300.0
    target = pl.quad((-480, -480, z - wall - depth), (960, 0, 0), (0, 960, 0), material=pl.Emissive(1.0))
    for turned in (0.0, 25.0):
        scene = pl.Scene([body.rotated_deg((0, 1, 0), turned) for body in [*tank(1000.0, wall, z), target]])
        shot = pl.render(scene, camera, samples=4, max_bounces=8, seed=5, progress=False)
        paths = [(row, column, sample) for row in range(4) for column in range(4) for sample in range(4)]
        normal = np.array([math.sin(math.radians(turned)), 0.0, math.cos(math.radians(turned))])
        compared = 0
        for way in pl.replaying.replay_all(shot, scene, paths):
            if [meeting.place.object for meeting in way.bounces[:3]] != [0, 1, 2]:
                continue  # reflected
            ray = next(event for event in way.events if type(event).__name__ == "WorldRay")
            point, direction, n = np.asarray(ray.origin), np.asarray(ray.direction), 1.0
            for behind, offset, meeting in zip((N_GLASS, N_WATER, None), (z, z - wall, z - wall - depth), way.bounces,
                                               strict=False):  # fmt: skip
                point = point + (offset - point @ normal) / (direction @ normal) * direction
                assert np.abs(np.asarray(meeting.point) - point).max() < 1e-9
                if behind is None:
                    break
                across = (direction - (direction @ normal) * normal) * n / behind
                direction, n = across - math.sqrt(1.0 - across @ across) * normal, behind
            compared += 1
        assert compared > 30
