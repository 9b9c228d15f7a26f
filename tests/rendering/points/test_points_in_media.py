"""Particles in a medium: Beer-Lambert on the way to the first surface, against rendered spheres; colours."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, the_lens

import plenoptic as pl
from plenoptic.rendering.points.particle_media import depth_in_bodies, particle_media
from plenoptic.rendering.points.particle_scene import particle_scene

BARE = bare_camera(shape=(128, 128), pitch=0.08)
POINTS = pl.Points([(0.0, 0.0, -404.0), (1.5, 1.0, -380.0), (-2.0, 0.5, -440.0)], intensity=[1e-2, 2e-2, 3e-2])


def water(absorption, scattering=0.0):
    return pl.Scene(medium=pl.materials.Medium(absorption, scattering), points=POINTS)


def weights_in(scene, camera=BARE, points=POINTS):
    return pl.rendering.point_weights(points, camera, scene=scene, rays=1 << 13, progress=False)


def test_light_falls_exponentially_with_the_path_to_the_front_of_the_lens():
    """A small pupil: all rays have nearly the path of the one through its centre, up to the first surface."""
    lens = the_lens(0.1)
    camera, point = bare_camera(lens, shape=(128, 128), pitch=0.5), np.array([60.0, -35.0, -404.0])
    points, loss = pl.Points([point], intensity=1.0), 2e-3
    clear = weights_in(None, camera, points)
    dim = weights_in(pl.Scene(points=points, medium=pl.materials.Medium(0.5 * loss, 0.5 * loss)), camera, points)
    radius, vertex = lens.elements[0].radius, float(lens.vertices[0])
    towards = np.array([0.0, 0.0, pl.paraxial.cardinal_points(lens, 587.6).entrance_pupil]) - point
    towards /= np.linalg.norm(towards)
    from_centre = point - np.array([0.0, 0.0, vertex + radius])
    b, c = towards @ from_centre, from_centre @ from_centre - radius**2
    path = -b - math.sqrt(b * b - c)
    # The pupil's aberration displaces the ray, and its size spreads paths by 0.1 mm * 0.17: below 0.05 mm in all.
    # The plane in front of the first surface is 1.9 mm before it at this height.
    assert abs(-math.log(dim.light[0] / clear.light[0]) / loss - path) < 0.05
    assert (dim.pixel == clear.pixel).all()


@pytest.mark.parametrize(
    ("model", "bounded"), [(pl.LensModel.EXACT, False), (pl.LensModel.THIN, True), (pl.LensModel.PARAXIAL, False)]
)
def test_a_small_sphere_in_a_medium_is_rendered_alike(model, bounded):
    camera, centre, radius = bare_camera(the_lens(model=model), shape=(64, 64), pitch=0.3), (10.0, 5.0, -300.0), 2.0
    medium = pl.materials.Medium((5e-3, 5e-3, 5e-3))
    points = pl.Points([centre], intensity=3.0 * math.pi * radius**2, diameter=2 * radius)
    ball = pl.sphere(radius, material=pl.Emissive(3.0)).translated(*centre)
    around = {"medium": medium}
    if bounded:
        tank = pl.box((80, 60, 240), center=(0, 0, -230), material=pl.Dielectric(1.0, medium=medium))
        around = {"meshes": [tank]}
    surfaces = pl.Scene([ball, *around.get("meshes", [])], medium=around.get("medium"))
    shot = pl.render(surfaces, camera, samples=1024, progress=False)
    clear = pl.render(pl.Scene([ball]), camera, samples=1024, progress=False)
    image, _ = weights_in(pl.Scene(points=points, **around), camera, points).image()
    bright, _ = weights_in(None, camera, points).image()
    # Both renders, and both traces, have the same rays. Rays to the sphere end before its centre: by 4 r / (3 pi) .. r.
    rendered, traced = (
        math.log(b.sum(dtype=float) / a.sum(dtype=float)) for a, b in ((shot.image, clear.image), (image, bright))
    )
    assert 0.005 * 0.5 * radius < traced - rendered < 0.005 * radius, (traced, rendered)


def test_colours_of_a_medium_are_those_of_grey_ones():
    losses = (1e-3, 2e-3, 4e-3)
    coloured = weights_in(water(losses))
    image, error = coloured.image()
    clear = weights_in(None)
    assert image.shape == (128, 128, 3)
    for k, loss in enumerate(losses):
        grey = weights_in(water(0.0, loss))
        one, one_error = grey.image()
        assert (coloured.pixel == grey.pixel).all() and (grey.weight < clear.weight).all()
        assert np.allclose(image[..., k], one[..., 0], rtol=1e-6, atol=0)
        assert np.allclose(error[..., k], one_error[..., 0], rtol=1e-5, atol=1e-12 * error.max())
    lines = dataclasses.replace(BARE, sensitivity=pl.sensor.Sensitivity.lines((650.0, 550.0, 450.0)))
    bright, dim = (weights_in(scene, lines).weight.sum(axis=0, dtype=float) for scene in (None, water(losses)))
    # Pupils differ little with wavelength; paths from the particles to the lens, 360 to 420 mm, weigh by their light.
    assert np.allclose(
        np.log(bright / dim) / losses, -math.log(grey.light.sum() / clear.light.sum()) / losses[2], rtol=2e-2
    )
    responses = dataclasses.replace(BARE, sensitivity=pl.sensitivities.colour_camera())
    bright, dim = (weights_in(scene, responses).weight.sum(axis=0, dtype=float) for scene in (None, water(losses)))
    red, green, blue = np.log(bright / dim)
    assert 0.36 < red < green < blue < 1.7


def test_renders_in_a_medium_show_particles_and_surfaces():
    medium = pl.materials.Medium((1e-3, 2e-3, 4e-3))
    scene = pl.Scene([pl.quad((-50, -50, -450), (100, 0, 0), (0, 100, 0), material=pl.Emissive(0.2))], medium=medium)
    both, alone = (
        pl.render(s, BARE, samples=4, progress=False) for s in (dataclasses.replace(scene, points=POINTS), scene)
    )
    image, error = weights_of_render(scene)
    assert np.allclose(both.image, alone.image + image, rtol=1e-6, atol=0)
    assert np.allclose(both.standard_error, np.hypot(alone.standard_error, error), rtol=1e-6, atol=0)
    only = pl.render(pl.Scene(points=POINTS, medium=medium), BARE, samples=4, progress=False)
    assert only.image.shape == (128, 128, 3) and np.allclose(only.image, image, rtol=1e-6, atol=0)
    assert pl.plan(pl.Scene(points=POINTS, medium=medium), BARE) is not None


def weights_of_render(scene):
    return pl.rendering.point_weights(POINTS, BARE, scene=scene, progress=False).image()


def test_a_light_sheet_is_weakened_from_its_start_to_each_particle():
    positions = [(x, 0.0, -404.0) for x in (-4.0, -1.0, 2.0)]
    losses, start = np.array([1e-2, 3e-2, 9e-2]), -2.0
    sheet = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=2.0, irradiance=1e3, start=start)
    points = pl.Points(positions, diameter=0.1, sheet=sheet)
    lit = points.intensities((0.0, 0.0, 0.0))
    shining = pl.Points(positions, diameter=0.1, intensity=1.0)
    coloured = weights_in(pl.Scene(points=points, medium=pl.materials.Medium(tuple(losses))), points=points)
    image, _ = coloured.image()
    for k, loss in enumerate(losses):
        scene = pl.Scene(points=points, medium=pl.materials.Medium(0.0, loss))
        weights, unweakened = weights_in(scene, points=points), weights_in(scene, points=shining)
        # Both have the same rays; weights hold the loss, and intensities are those without a medium.
        expected = np.exp(-loss * np.array([0.0, 1.0, 4.0]))
        assert np.allclose(weights.light / unweakened.light, expected, rtol=1e-12)
        assert lit[0] == 0 < lit[1] and (weights.intensity[:, 0] == lit).all()
        assert np.allclose(image[..., k], weights.image()[0][..., 0], rtol=1e-5, atol=0)


def body(medium, size, center=(0.0, 0.0, -404.0), index=1.0):
    """A box of a medium, whose surface refracts nothing at the index of its surroundings."""
    return pl.box(size, center=center, material=pl.Dielectric(index, exterior=index, medium=medium))


def length_in_box(starts, ends, box):
    """Lengths (n,) of segments in an axis-aligned box (2, 3), by clipping them at its planes."""
    offset = ends - starts
    planes = (box[:, None] - starts) / offset
    first, last = planes.min(axis=0).max(axis=1), planes.max(axis=0).min(axis=1)
    return np.maximum(np.clip(last, 0, 1) - np.clip(first, 0, 1), 0.0) * np.linalg.norm(offset, axis=1)


def test_depths_of_nested_bodies_are_those_of_lengths_in_boxes():
    media = [pl.materials.Medium(loss) for loss in (0.01, 0.03, 0.2)]
    outer, inner, far = body(media[0], (20, 30, 40)), body(media[1], 8.0, (3, 2, -398)), body(None, 5.0, (0, 40, -404))
    copies = pl.scene.Instances(
        body(media[2], 1.0, (0, 0, 0)),
        [[[2, 0, 0, x], [0, 3, 0, 0], [0, 0, -4, -404], [0, 0, 0, 1]] for x in (-5.0, 30.0)],
    )
    scene = pl.Scene([far, inner, copies, outer], medium=pl.materials.Medium(0.002), points=POINTS)
    found = particle_media(scene, np.zeros(3))
    rng = np.random.default_rng(3)
    starts = rng.uniform((-60, -60, -340), (60, 60, -300), (5000, 3))
    # Half of the rays end within one of the small bodies or just beside it.
    ends = rng.uniform((-15, -20, -430), (40, 50, -380), (5000, 3))
    ends[::2] = rng.choice([(0, 40, -404), (3, 2, -398), (-5, 0, -404), (30, 0, -404)], 2500)
    ends[::2] += rng.normal(size=(2500, 3))
    depth = depth_in_bodies(found, found.extinction, (starts, ends), found.at_lens)
    first = np.array([[-6.0, -1.5, -406.0], [-4.0, 1.5, -402.0]])
    lengths = [
        length_in_box(starts, ends, box)
        for box in (far.bounds, inner.bounds, first, first + np.array([35.0, 0, 0]), outer.bounds)
    ]
    in_far, in_inner, in_first, in_second, in_outer = lengths
    total = np.linalg.norm(ends - starts, axis=1)
    expected = 0.03 * in_inner + 0.2 * (in_first + in_second) + 0.01 * (in_outer - in_inner - in_first)
    expected += 0.002 * (total - in_outer - in_far - in_second)
    assert all((length > 0).sum() > 10 for length in lengths)
    # Corners of instances are rounded to float32 for the order of hits alone; distances are float64.
    assert np.abs(depth / expected[:, None] - 1).max() < 1e-9


def test_a_body_around_all_is_the_medium_of_the_scene():
    medium = pl.materials.Medium(1e-3, (1e-3, 2e-3, 3e-3))
    inside = weights_in(pl.Scene([body(medium, 2000.0)], points=POINTS))
    unbounded = weights_in(pl.Scene(points=POINTS, medium=medium))
    both = weights_in(pl.Scene([body(medium, (30, 30, 100))], points=POINTS, medium=medium))
    for weights in (inside, both):
        assert (weights.pixel == unbounded.pixel).all()
        assert np.allclose(weights.weight, unbounded.weight, rtol=1e-6, atol=0)


@pytest.mark.parametrize("index", [1.0, 1.33])
def test_particles_in_a_tank_lose_light_up_to_its_face(index):
    """By Beer and Lambert. The pupil is small; what hides particles within the tank still does."""
    camera, point, loss = (
        bare_camera(the_lens(0.1), shape=(128, 128), pitch=0.5),
        np.array([[60.0, -35.0, -404.0]]),
        5e-3,
    )
    points = pl.Points(point, intensity=1.0)
    tank = body(pl.materials.Medium(0.0, loss), (200, 200, 64), index=index)
    clear, dim = (weights_in(pl.Scene(meshes, points=points), camera, points) for meshes in ((), [tank]))
    pupil = np.array([0.0, 0.0, pl.paraxial.cardinal_points(the_lens(0.1), 587.6).entrance_pupil])
    # 32 mm to the face, along the axis; the pupil's aberration and size change the slope by 0.1 mm / 400 mm.
    path = 32.0 * np.linalg.norm(pupil - point) / (pupil[2] + 404.0)
    assert abs(-math.log(dim.light[0] / clear.light[0]) / (loss * path) - 1) < 1e-4
    screen = pl.quad((-50, -100, -380), (150, 0, 0), (0, 200, 0))
    assert not weights_in(pl.Scene([tank, screen]), camera, points).light.any()
    glass = pl.sphere(10.0, center=point[0], material=pl.Dielectric(1.5))
    with pytest.raises(pl.errors.SceneError, match="inside a body of glass"):
        weights_in(pl.Scene([tank, glass]), camera, points)


@pytest.mark.parametrize(
    ("start", "paths"), [(None, (6.0, 9.0, 10.0)), (-14.0, (6.0, 9.0, 10.0)), (-7.0, (3.0, 6.0, 7.0))]
)
def test_a_light_sheet_is_weakened_by_the_bodies_that_it_crosses(start, paths):
    """From the face of a tank at x = -10, or from its start within the tank, to particles in and behind it."""
    loss = np.array([0.02, 0.05, 0.1])
    sheet = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=2.0, irradiance=1e3, start=start)
    points = pl.Points([(x, 0.0, -404.0) for x in (-4.0, -1.0, 5.0)], diameter=0.1, sheet=sheet)
    tank = body(pl.materials.Medium(tuple(loss)), (10.0, 20.0, 20.0), (-5.0, 0.0, -404.0))
    medium = None if start is None else pl.materials.Medium(0.001)
    traced = particle_scene(points, BARE, pl.Scene([tank], points=points, medium=medium), 0)
    lit = points.intensities((0.0, 0.0, 0.0))
    outside = np.array([0.0, 0.0, 5.0]) if start == -7.0 else np.array([4.0, 4.0, 9.0])
    depth = np.multiply.outer(paths, loss) + (0.0 if start is None else 0.001 * outside[:, None])
    assert lit.all() and np.allclose(traced.sheet_lengths @ traced.media.extinction, depth, rtol=1e-9)


SPECTRAL = dataclasses.replace(
    bare_camera(the_lens(0.1), shape=(64, 64), pitch=0.5), sensitivity=pl.sensitivities.colour_camera()
)


def light_left(points, losses):
    """Light of each channel of `SPECTRAL` in a medium over that without it, of rays along the axis."""
    medium = pl.Scene(points=points, medium=pl.materials.Medium(losses))
    dim, clear = (weights_in(scene, SPECTRAL, points).image()[0].sum(axis=(0, 1)) for scene in (medium, None))
    return dim / clear


def light_left_by_quadrature(colour, losses, length):
    """Integrals over the wavelength of response, spectrum and the loss by Beer and Lambert."""
    wavelengths = np.linspace(350.0, 800.0, 4501)
    basis, response = pl.sensor.rgb_basis(wavelengths), SPECTRAL.sensitivity.at(wavelengths)
    light = response * (basis @ colour)[:, None]
    return (light * np.exp(-length * (basis @ losses))[:, None]).sum(axis=0) / light.sum(axis=0)


def path_to_lens(z):
    return float(SPECTRAL.lens.vertices[0]) - z


def test_the_light_of_a_sheet_fades_at_each_wavelength_with_the_whole_path():
    """From the start of the sheet to the lens: not as products of colours, which are 7 % more in red."""
    losses, length = (2e-3, 5e-4, 1e-5), 800.0
    sheet = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=2.0, irradiance=1e3, start=-length)
    found = light_left(pl.Points([(0.0, 0.0, -404.0)], diameter=0.1, sheet=sheet), losses)
    expected = light_left_by_quadrature(np.ones(3), losses, length + path_to_lens(-404.0))
    assert np.allclose(found, expected, rtol=3e-3), found / expected - 1


@pytest.mark.parametrize("losses", [(5e-2, 3e-3, 5e-2), (1e-3, 4e-3, 1e-3), (2e-3, 5e-4, 1e-5)])
def test_dense_colours_of_a_medium_are_integrals_over_the_wavelength(losses):
    """Within each of 16 passbands, too, by whose mean loss the light of the first is 5 % too dim.

    Two wavelengths a passband leave 1.3 %, four 0.3 %. The pupil differs by 0.3 % between the ends of the spectrum,
    which a single ray does not know, and paths to the lens do by 1e-5.
    """
    colour = (1.0, 0.5, 0.2)
    found = light_left(pl.Points([(0.0, 0.0, -404.0)], intensity=[colour]), losses)
    expected = light_left_by_quadrature(np.array(colour), losses, path_to_lens(-404.0))
    assert np.allclose(found, expected, rtol=6e-3), found / expected - 1
