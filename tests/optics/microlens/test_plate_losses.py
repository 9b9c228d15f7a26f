"""Light that plates of microlenses take: plane plates in closed form, rays by plain formulas, files."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import microlens_path
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.microlens_record import MICROLENS, SensorPlane, array_record
from plenoptic.optics.microlens.model_records import ArrayCrossing
from plenoptic.optics.microlens.plate_losses import add_losses, axial_transmission

Model, Side = pl.optics.MicrolensModel, pl.optics.ConvexSide
BARE, SINGLE = pl.optics.Coating(), pl.optics.SingleLayer()
GLASS = pl.optics.AbsorbingGlass(pl.ModelGlass(1.62, 36.4), [400.0, 700.0], [0.2, 0.9], thickness=0.1)
WATER = pl.ConstantMedium(1.33)
WAVES = (587.6, 480.0, 650.0)
TABLES = 1e-6
"""Error of linear interpolation in the tables of both sides up to 60 degrees: h^2 / 8 times a second derivative of up
to 3 of bare glass or a single layer, h = 1 / 1024, twice; and a third of that again."""


def plates(side=Side.SCENE, focal_lengths=(0.42,), coating=SINGLE, medium=GLASS, **changes):
    """Plates as fast as f/2."""
    fields = {"model": Model.SPHERICAL, "convex_side": side, "coating": coating, "medium": medium, **changes}
    return pl.MicrolensArray(**({"pitch": 0.2, "focal_lengths": focal_lengths} | fields))


def fresnel(n, angle):
    """Transmittance of bare glass for unpolarised light (Born & Wolf, 1.5.3)."""
    refracted = np.arcsin(np.sin(angle) / n)
    s = np.sin(2 * angle) * np.sin(2 * refracted) / np.sin(angle + refracted) ** 2
    return 0.5 * (s + s / np.cos(angle - refracted) ** 2)


def loss_of(array, power, origin, direction, nm, outside=1.0):
    """Light (n,) that a plate on the axis transmits of rays in front of it, towards +z: one ray at a time."""
    n, t = array.index_at(nm), array.thickness
    radius = math.copysign((array.index - 1.0) / power, 1.0 if array.convex_side is Side.SCENE else -1.0)
    light = np.empty(len(origin))
    for i, (p, d) in enumerate(zip(origin, direction, strict=True)):
        light[i], start = 1.0, None
        for k, vertex in enumerate((0.0, t)):
            centre, normal = np.array([0.0, 0.0, vertex + radius]), np.array([0.0, 0.0, 1.0])
            if (k == 0) is (array.convex_side is Side.SCENE):
                along, square = (p - centre) @ d, (p - centre) @ (p - centre) - radius**2
                root = math.sqrt(along**2 - square)
                p = p + d * min((-along - root, -along + root), key=lambda s: abs(p[2] + s * d[2] - vertex))  # noqa: B023
                normal = (centre - p) / radius
            else:
                p = p + d * (vertex - p[2]) / d[2]
            before, behind = (outside, outside * n) if k == 0 else (outside * n, outside)
            mu, cosine = before / behind, float(normal @ d)
            light[i] *= pl.optics.surface_powers(array.coating, before, behind, min(cosine, 1.0), nm).transmittance
            d = mu * d + (math.sqrt(1.0 - mu**2 * (1.0 - cosine**2)) - mu * cosine) * normal
            start = p if k == 0 else start
        if isinstance(array.medium, pl.optics.AbsorbingGlass):
            light[i] *= math.exp(-array.medium.attenuation(nm) * float(np.linalg.norm(p - start)))
    return light


def reverse_rays(array, waves, lenslets=None, outside=pl.optics.AIR):
    """Aimed samples through the lens on the axis, in reverse: points, directions, weights and status, without losses
    and with them. Rays cross the array up to 0.1 mm off the axis at up to 26 degrees, the curved side at up to 60.
    """
    random, distance = np.random.default_rng(4), 0.4
    fields = np.zeros((8, BLOCK))
    fields[0:2] = random.uniform(-0.07, 0.07, (2, BLOCK))
    fields[3:5] = random.uniform(-0.14, 0.14, (2, BLOCK))
    fields[6] = 1.0
    origin = {"turn": np.eye(2), "origin": np.zeros(2), "reach": 1.0, "margin": 0.0, "wavelengths": WAVES}
    record, results = array_record(array, **origin), []
    for each in (record, add_losses(record, array, WAVES, outside)):
        blocks = fields.copy().reshape(-1)
        array.model.refraction.to_lens(blocks, lenslets, ArrayCrossing(each, SensorPlane(distance, None), 0.0), waves)
        results.append(blocks.reshape(8, BLOCK))
    return results


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("reverse", [False, True])
def test_weak_curvature_is_a_plane_plate(side, reverse):
    """Fresnel's formulas twice and Beer's law: between nodes of the table to its error, at nodes to rounding, to which
    1e-10, the slope of the sphere of radius 1e9 mm, adds nothing.
    """
    nodes = np.arccos(np.sqrt(np.array([1020, 900, 512, 256, 70]) / 1024))
    for angles, tolerance in ((nodes, 1e-9), (np.radians([3.0, 20.0, 45.0, 59.0]), TABLES)):
        slopes = np.column_stack([np.sin(angles), np.zeros(len(angles)), np.cos(angles) * (-1.0 if reverse else 1.0)])
        rays = pl.RayBundle(np.array([0.0, 0.0, 0.05]) - slopes, slopes)
        array = plates(side, (2e9,), BARE, pl.ConstantMedium(1.5), pitch=(9.0, 9.0), lattice=pl.Lattice.RECTANGULAR)
        clear = microlens_path(array, rays, reverse=reverse)[0].weight
        np.testing.assert_allclose(clear, fresnel(1.5, angles) ** 2, rtol=0, atol=tolerance)
        dark = dataclasses.replace(array, medium=dataclasses.replace(GLASS, medium=pl.ConstantMedium(1.5)))
        through = 0.1 / np.sqrt(1.0 - (np.sin(angles) / 1.5) ** 2)
        expected = np.exp(-GLASS.attenuation(587.6) * through)
        weight = microlens_path(dark, rays, reverse=reverse)[0].weight
        np.testing.assert_allclose(weight / clear, expected, rtol=1e-9)
        assert (microlens_path(dataclasses.replace(array, coating=None), rays, reverse=reverse)[0].weight == 1.0).all()


LENSLETS = {"alike": None, "listed": (1.0 / 0.42, 1.0 / 0.6)}


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("powers", LENSLETS.values(), ids=LENSLETS)
@pytest.mark.parametrize("outside", [pl.optics.AIR, WATER], ids=["air", "water"])
def test_rays_of_fast_lenses_lose_what_plain_formulas_state(side, powers, outside):
    """In reverse, at the camera's wavelength and at those of paths; rays are the same but for rounding."""
    array, lenslets, n = plates(side), None, np.arange(BLOCK)
    if powers is not None:
        lenslets = np.zeros(BLOCK, MICROLENS)
        lenslets["power"], lenslets["transmission"], lenslets["row"] = np.take(powers, n % 2), 0.5, -1
    for waves in (None, n % 2):
        plain, weak = reverse_rays(array, None if waves is None else waves.astype(np.int64), lenslets, outside)
        np.testing.assert_allclose(np.delete(weak, 6, 0), np.delete(plain, 6, 0), rtol=0, atol=1e-14)
        passing = plain[7] == 0
        direction = -plain[3:6].T
        # z is from the front principal plane; from the first vertex it is that much more.
        origin = plain[:3].T + np.array([0.0, 0.0, array.model.refraction.depths(array).front]) - direction
        expected = np.empty(BLOCK)
        for k in np.flatnonzero(passing):
            nm = WAVES[0 if waves is None else int(waves[k]) + 1]
            power = 1.0 / 0.42 if lenslets is None else float(lenslets["power"][k])
            expected[k] = loss_of(array, power, origin[k : k + 1], direction[k : k + 1], nm, outside.index(nm))[0]
        assert passing.sum() > 40 and np.ptp(expected[passing]) > 0.02
        np.testing.assert_allclose((weak[6] / plain[6])[passing], expected[passing], rtol=0, atol=TABLES)


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("focal_lengths", [(0.42,), (0.42, 0.6)])
def test_both_directions_lose_the_same(side, focal_lengths):
    """Rays of `fill_plano_convex` turned around, through the kernels of light that travels forwards."""
    array = plates(side, focal_lengths)
    lenslets = None
    if len(focal_lengths) > 1:
        lenslets = np.zeros(BLOCK, MICROLENS)
        lenslets["power"], lenslets["transmission"], lenslets["row"] = 1.0 / 0.42, 1.0, -1
    plain, weak = reverse_rays(array, None, lenslets)
    passing = np.flatnonzero((plain[7] == 0) & (np.abs(plain[:2]).max(axis=0) < 0.07))
    direction = -plain[3:6].T[passing]
    origin = plain[:3].T[passing] + np.array([0.0, 0.0, array.model.refraction.depths(array).front])
    rays = pl.RayBundle(origin - 0.3 * direction, direction)
    there = microlens_path(array, rays)[0]
    both = there.status == 0
    turned = pl.RayBundle(there.origin + there.direction, -there.direction).selected(both)
    back = microlens_path(array, turned, reverse=True)[0]
    assert both.sum() > 30
    lost = (weak[6] / plain[6])[passing]
    np.testing.assert_allclose(there.weight[both], lost[both], rtol=1e-10)
    np.testing.assert_allclose(back.weight, lost[both], rtol=1e-10)


def test_the_axis():
    array = plates(medium=GLASS)
    n, nm = GLASS.index(550.0), 550.0
    for outside in (pl.optics.AIR, WATER):
        around = outside.index(nm)
        side = pl.optics.surface_powers(SINGLE, around, around * n, 1.0, nm).transmittance
        expected = float(side) ** 2 * GLASS.internal_transmittance(nm, 0.1)
        assert axial_transmission(array, nm, outside) == pytest.approx(expected, rel=1e-12)
    assert axial_transmission(dataclasses.replace(array, coating=None), nm) is None


def test_films_lie_from_outside_to_the_glass_at_all_wavelengths():
    """A medium whose index falls below that around it: light meets the films in the same order."""

    class Falling:
        def index(self, wavelength):
            return 1.2 + 2e-3 * (wavelength - 587.6)

    films = pl.optics.Coating([(pl.optics.FilmMaterial(2.0, 1.5), 15.0), (pl.ConstantMedium(1.38), 120.0)])
    array = plates(coating=films, medium=Falling(), focal_lengths=(2.0,))
    for nm in (587.6, 450.0):
        inside = 2.0 * Falling().index(nm)
        reversed_films = dataclasses.replace(films, layers=films.layers[::-1]) if inside < 2.0 else films
        once = pl.optics.surface_powers(reversed_films, 2.0, inside, 1.0, nm).transmittance
        assert axial_transmission(array, nm, pl.ConstantMedium(2.0)) == pytest.approx(float(once) ** 2, rel=1e-12)


@pytest.mark.parametrize("model", [Model.THIN, Model.PINHOLE, Model.FLAT_HIGH_INDEX])
def test_models_without_surfaces_are_refused(model):
    with pytest.raises(pl.errors.InvalidValueError, match=f"coating is given for {model.name} microlenses"):
        pl.MicrolensArray(0.2, (2.0,), model=model, index=100.0, coating=SINGLE)
    with pytest.raises(pl.errors.PrescriptionError, match="coating is 0.5"):
        plates(coating=0.5)


@pytest.mark.parametrize("coating", [SINGLE, BARE, pl.optics.Reflectance([0.1, 0.2], [400.0, 700.0])])
def test_files_keep_the_coating(coating, tmp_path):
    array = plates(coating=coating)
    pl.package.save_value(array, tmp_path / "array.json")
    assert pl.package.load_value(tmp_path / "array.json") == array
    assert dataclasses.replace(array, coating=None) != array
