"""Representative rays: they exist wherever light is, start on the pixel, and agree with dense rays."""

import dataclasses
import itertools
import signal

import numpy as np
import pytest
from camera_helpers import camera_with

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels, pixel_centres
from plenoptic.images import PixelState
from plenoptic.rendering.schedule import tile_jobs
from plenoptic.truth.channels import NO_MICROLENS, Truth
from plenoptic.truth.representative_rays import representative_rays

CORNER, MIDDLE = np.s_[0:24, 0:24], np.s_[244:268, 244:268]


def camera_of(stop, b=1.7, aperture=1.0, sensor=None, **array):
    stop, plain = pl.CircularStop(stop) if isinstance(stop, float) else stop, pl.camera.example_camera()
    return dataclasses.replace(
        plain,
        lens=plain.lens.with_stop(stop),
        microlenses=dataclasses.replace(plain.microlenses, **array),
        sensor=sensor or dataclasses.replace(plain.sensor, pixel_aperture=(aperture, aperture)),
        microlenses_to_sensor=b,
    )


def ring(semi_diameter):
    y, x = np.mgrid[-1:1:64j, -1:1:64j]
    return pl.optics.MaskStop(np.where(np.hypot(x, y) < 0.8, 0.0, 1.0), semi_diameter)


def rays_of(record, pixels):
    return representative_rays(record, pixels, illuminated_pixels(record, pixels, np.arange(len(pixels))))


def tilted(camera):
    leaning = camera.moved(pl.CameraPart.SENSOR, tilt=(0.02, -0.01, 0.3))
    return leaning.moved(pl.CameraPart.LENS, shift=(0.5, -0.3, 0.2), tilt=(0.01, -0.02, 0.3))


def two_rims(camera):
    """Light passes what two round stops have in common, which is pointed."""
    lens = camera.lens.inserted(pl.CircularStop(4.99), 0.001)
    return dataclasses.replace(camera, lens=lens.moved(camera.lens.iris + 1, shift=(6.0, 0.0, 0.0)))


UNEVEN = pl.MicrolensImperfections(pitch_jitter=0.004, decentre=0.004, seed=3)
CAMERAS = {
    **{f"{b} {stop}": camera_with(b, stop) for b in (2.0, 1.7) for stop in (5.0, 2.3, 1.5, 1.0, 0.5, 0.2, 0.1)},
    "blades": camera_with(2.0, pl.PolygonStop(blades=6, semi_diameter=1.0)),
    "star": camera_with(2.0, pl.StarStop(points=8, semi_diameter=1.0, inner_semi_diameter=0.3)),
    "ring": camera_with(2.0, ring(0.2)),
    "tilted": tilted(camera_with(stop=1.0)),
    "small pixels": camera_with(2.0, 0.5, pixels={"pixel_aperture": (0.5, 0.5)}),
    "irregular": camera_with(stop=0.5, imperfections=UNEVEN),
    "multi-focus": camera_with(stop=1.0, focal_lengths=(1.7, 2.0, 2.4), lattice=pl.Lattice.SQUARE),
    "two rims": two_rims(camera_with(2.0, 5.0)),
    "wide open": camera_with(0.45, 17.1, focal_lengths=(0.45,), shape=(5000, 5000)),
    "thick": camera_with(2.0, 1.0, model=pl.optics.MicrolensModel.SPHERICAL),
}

QUICK = ["2.0 0.1", "1.7 2.3", "star", "tilted", "irregular", "multi-focus", "wide open", "thick"]

OTHERS = [name for name in CAMERAS if name not in QUICK]


@pytest.mark.parametrize("names", [QUICK, pytest.param(OTHERS, marks=pytest.mark.slow)], ids=["quick", "others"])
def test_every_illuminated_pixel_has_truth(names):
    # Up to 100 % of lit pixels had none: no light reaches their centres.
    for name, region in itertools.product(names, (CORNER, MIDDLE)):
        camera = CAMERAS[name]
        # Of a pixel that one path in 100 reaches, 1024 miss the light once in 3e4.
        white = pl.render_white(camera, samples=1024, replicates=2, region=region, progress=False).image[..., 0]
        truth = pl.ground_truth(pl.shapes.white_plane(), camera, region=region)
        lit = white > 0.01 * white.max()
        assert lit.any()
        assert np.isfinite(truth.depth[lit]).all(), name
        assert (truth.microlens[lit] != NO_MICROLENS).all(), name
        assert (truth.state[lit] == PixelState.SEEN).all(), name
        # What bounds call dark is.
        assert not white[truth.state == PixelState.DARK].any(), name


def test_rays_start_at_the_centre_or_inside_the_sensitive_area():
    for name in ("2.0 0.1", "1.7 1.0", "star", "small pixels", "tilted"):
        record = camera_record(CAMERAS[name])
        pixels = pixel_centres(record, (0, 24), (0, 24))
        off = rays_of(record, pixels).starts - pixels
        sides = record.sensor.pixel.within(np.eye(2))
        # In parts of the sides, which are turned with the sensor.
        parts = np.abs(off @ np.linalg.inv(sides))
        assert parts.any() and parts.max() <= 0.5 and (parts == 0).all(axis=1).any(), name


def test_states_tell_the_dark_from_the_background():
    ball = pl.Scene([pl.sphere(0.7, center=(0.0, 0.0, -404.0), segments=(64, 32))])
    region = np.s_[220:290, 220:290]
    truth = pl.ground_truth(ball, camera_with(stop=1.0), region=region)
    empty = pl.ground_truth(None, camera_with(stop=1.0), region=region, truth=Truth.STATE)
    counts = np.bincount(truth.state.ravel(), minlength=4) / truth.state.size
    assert counts[PixelState.DARK] > 0.5 and counts[PixelState.UNKNOWN] < 0.1
    assert counts[PixelState.EMPTY] > 0.02 and counts[PixelState.SEEN] > 0.005
    np.testing.assert_array_equal(truth.state == PixelState.SEEN, np.isfinite(truth.depth))
    # Without a scene, what is lit meets nothing.
    lit = truth.state >= PixelState.EMPTY
    np.testing.assert_array_equal(empty.state, np.where(lit, PixelState.EMPTY, truth.state))
    np.testing.assert_array_equal(lit, truth.microlens_type >= 0)


def test_pixels_that_were_not_computed_are_unknown(monkeypatch):
    original = tile_jobs.render_tile

    def interrupted(*arguments, **named):
        signal.raise_signal(signal.SIGINT)
        return original(*arguments, **named)

    monkeypatch.setattr(tile_jobs, "render_tile", interrupted)
    camera = camera_of(5.0, sensor=pl.Sensor((32, 32), 0.01))
    with pytest.warns(pl.errors.BudgetWarning):
        shot = pl.render(pl.shapes.white_plane(), camera, samples=2, truth=Truth.STATE, threads=1, progress=False)
    assert shot.interrupted and (shot.truth.state == PixelState.UNKNOWN).all()


@pytest.mark.parametrize("stop", [5.0, 0.1])
def test_object_shares_equal_those_of_rendered_light(stop):
    # Of two half planes one shines: what it sends is its share, or what the other one leaves. 64 points of a pixel
    # are within 0.06 or so of 4096; the plane is out of focus, so that its edge is many pixels wide.
    bright = pl.quad((0, -400, -500), (400, 0, 0), (0, 800, 0), material=pl.Emissive(1.0))
    dark = pl.quad((-400, -400, -500), (400, 0, 0), (0, 800, 0), material=pl.Lambertian(0.5))
    camera, region = camera_with(stop=stop), np.s_[248:264, 240:272]
    truth = pl.ground_truth(pl.Scene([bright, dark]), camera, region=region, truth=Truth.OBJECT | Truth.OBJECT_SHARE)
    shot = pl.render(pl.Scene([bright, dark]), camera, samples=4096, region=region, truth=Truth.NONE, progress=False)
    light = pl.render_white(camera, samples=4096, region=region, progress=False).image[..., 0]
    lit = (light > 0.01 * light.max()) & (truth.object >= 0)
    fraction = (shot.image.mean(axis=-1) / np.where(lit, light, 1.0))[lit]
    off = truth.object_share[lit] - np.where(truth.object[lit] == 0, fraction, 1 - fraction)
    assert np.isfinite(off).all() and ((fraction > 0.02) & (fraction < 0.98)).mean() > 0.02
    # Behind a small stop some 16 paths arrive of either.
    assert np.sqrt(np.mean(off**2)) < (0.03 if stop == 5.0 else 0.1)
    assert np.isnan(truth.object_share[truth.object < 0]).all()


def test_object_shares_behind_layers():
    # Layers before the object take their opacity of its light; it leaves what it lacks of opacity to others behind.
    def layer(z, opacity, color=0.5):
        material = pl.MetallicRoughness(color, opacity=opacity)
        return pl.quad((-400, -400, z), (800, 0, 0), (0, 800, 0), material=material)

    for opacities, number, share in (
        ((0.3, 1.0), 1, 0.7),
        ((0.3, 0.2, 1.0), 2, 0.7 * 0.8),
        ((0.7, 1.0), 0, 0.7),
        ((0.2, 0.6, 1.0), 1, 0.8 * 0.6),
        ((0.4,), -1, np.nan),
    ):
        scene = pl.Scene([layer(-500 - 20 * k, opacity) for k, opacity in enumerate(opacities)])
        wanted = Truth.OBJECT | Truth.OBJECT_SHARE
        truth = pl.ground_truth(scene, camera_with(stop=5.0), region=np.s_[250:254, 250:254], truth=wanted)
        assert (truth.object == number).all(), opacities
        assert truth.object_share == pytest.approx(np.full((4, 4), share), abs=1e-12, nan_ok=True), opacities


def traced(camera, start, cross):
    """Rays from a point of the sensor through points (n, 2) of the array, and the thin microlenses there, by hand."""
    array, b = camera.microlenses, camera.microlenses_to_sensor
    cell = array.nearest(cross)
    index = np.rint(cell @ np.linalg.inv(array.basis)).astype(int)
    kinds = array.type_pattern
    kind = kinds[index[:, 0] % kinds.shape[0], index[:, 1] % kinds.shape[1]]
    slope = (cross - start) / b + (cross - cell) / np.asarray(array.focal_lengths)[kind][:, None] * -1.0
    direction = np.column_stack([slope, -np.ones(len(cross))])
    points = np.column_stack([cross, np.full(len(cross), camera.stop_to_microlenses)])
    return camera.lens.trace_reverse(pl.RayBundle(points, direction)), index


def dense_rays(camera, rng, row, column, count):
    """Depths at which rays of one pixel meet two planes, and the microlenses that they pass."""
    pitch, aperture = camera.sensor.pixel_pitch, camera.sensor.pixel_aperture
    start = camera.sensor.centre_of(row, column) + (rng.random((count, 2)) - 0.5) * pitch * np.asarray(aperture)
    # The image of a stop of 5 mm, and of the cells beside it, is no wider than two pitches.
    cross = camera.sensor.centre_of(row, column) + (rng.random((count, 2)) - 0.5) * 4 * 0.217
    rays, index = traced(camera, start, cross)
    passed = rays.weight > 0
    return np.where(rays.at_z(-350.0)[:, 0] > 0, 350.0, 450.0)[passed], index[passed]


@pytest.mark.parametrize("stop", [5.0, 2.3, 0.2])
def test_rays_pass_the_illuminated_centroid(stop):
    camera = camera_of(stop)
    record = camera_record(camera)
    rays = rays_of(record, pixel_centres(record, (100, 228), (0, 512)))
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-0.127, 0.127, 255)]), axis=-1).reshape(-1, 2)
    off, strips = [], []
    for k in np.random.default_rng(3).permutation(np.flatnonzero(~rays.lost))[:24]:
        cell = rays.cells[k, :2]
        bundle, index = traced(camera, rays.starts[k], cell + grid)
        in_cell = (index == np.rint(cell @ np.linalg.inv(camera.microlenses.basis))).all(axis=1)
        lit = (cell + grid)[in_cell & (bundle.weight > 0)]
        if len(lit) < 300:
            continue  # a micrometre is no small part of it
        off.append(np.hypot(*(rays.aims[k] - lit.mean(axis=0))))
        # The region of a point is bounded by tangents, 1 % of what a pixel sees outside their circle, a third of
        # it on average, and by margins on both sides of 0.2 % of what a group of 4 x 4 pixels sees. What is seen moves
        # 6.1 times as far as the point (by thin lenses). Such a strip at its rim moves a centroid by half the strip's
        # width where the lit part is a rectangle, and by less than all of it at its tips.
        half, aside = 0.5 * np.ptp(lit, axis=0).max(), 6.1 * 0.01 * np.sqrt(0.5)
        strips.append(0.01 / 3 * (half + aside) + 2 * 0.002 * (half + 4 * aside))
    assert len(off) > 16
    assert np.sqrt(np.mean(np.square(off))) < np.sqrt(np.mean(np.square(strips)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["1.7 5.0", "2.0 5.0", "1.7 2.3", "1.7 0.2", "multi-focus", "small pixels", "star"])
def test_representative_rays_agree_with_dense_rays(name):
    camera = CAMERAS[name]
    near = pl.quad((0, -2000, -350), (2000, 0, 0), (0, 4000, 0))
    far = pl.quad((-2000, -2000, -450), (4000, 0, 0), (0, 4000, 0))
    truth = pl.ground_truth(pl.Scene([near, far]), camera, region=np.s_[:128, :])
    rng = np.random.default_rng(1)
    hit_pixels = np.argwhere(truth.state == PixelState.SEEN)
    traced_depths = []
    for row, column in rng.permutation(hit_pixels)[:60]:
        if len(traced_depths) == 16:
            break
        for _ in range(20):
            depth, index = dense_rays(camera, rng, row, column, 20_000)
            if len(depth) >= 5:
                break
        if not len(depth):
            continue  # too little light for so few rays
        traced_depths.append((index == truth.microlens[row, column]).all(axis=1).mean())
        assert depth.min() - 1e-9 <= truth.depth[row, column] <= depth.max() + 1e-9
        assert traced_depths[-1] > 0
    assert len(traced_depths) == 16 and np.median(traced_depths) > 0.5
