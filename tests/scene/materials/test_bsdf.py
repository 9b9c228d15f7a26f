"""What materials do with light: reciprocity, energy, and directions drawn as often as their density says.

Directions are in the frame of the front here, z < 0 behind it; `bsdf` has z on the side of the viewer.
"""

import cmath
import itertools
import math

import mpmath
import numpy as np
import pytest
from scene_helpers import smith, towards

import plenoptic as pl

COPPER = (0.27 + 3.41j, 0.68 + 2.63j, 1.32 + 2.29j)
OPAQUE = {
    "lambertian": pl.Lambertian((0.8, 0.5, 0.2)),
    "rough diffuse": pl.materials.RoughDiffuse(0.9, roughness=0.7),
    "rough mirror": pl.Conductor(0.9, alpha=0.3),
    "rough metal": pl.Conductor(alpha=0.15, index=COPPER),
    "very rough metal": pl.Conductor(alpha=0.9, index=1.5 + 0.8j),
    "plastic": pl.MetallicRoughness((0.8, 0.5, 0.2), 0.0, 0.45),
    "between": pl.MetallicRoughness((0.8, 0.5, 0.2), 0.4, 0.6),
    "gilded": pl.MetallicRoughness((1.0, 0.8, 0.3), 1.0, 0.8),
    "car paint": pl.MetallicRoughness((0.7, 0.1, 0.1), 0.8, 0.5, clearcoat=1.0, clearcoat_roughness=0.3),
    "varnished wood": pl.MetallicRoughness((0.6, 0.4, 0.2), 0.0, 0.9, clearcoat=0.6, clearcoat_roughness=0.5),
}
CLEAR = {
    "rough glass": pl.Dielectric(1.5, alpha=0.3),
    "very rough glass": pl.Dielectric(1.5, alpha=0.8),
    "rough bubble": pl.Dielectric(1.0, alpha=0.25, exterior=1.33),
}
ROUGH = OPAQUE | CLEAR
WHITE = {
    "lambertian": pl.Lambertian(1.0),
    "rough diffuse": pl.materials.RoughDiffuse(1.0, roughness=0.3),
    "rougher diffuse": pl.materials.RoughDiffuse(1.0, roughness=1.0),
    "plastic": pl.MetallicRoughness(1.0, 0.0, 0.5),
    "polished plastic": pl.MetallicRoughness(1.0, 0.0, 0.05),
    "matt plastic": pl.MetallicRoughness(1.0, 0.0, 1.0),
    "mirror": pl.Conductor(),
    "glass": pl.Dielectric(1.5),
    "diamond": pl.Dielectric(2.42),
    "water under glass": pl.Dielectric(1.33, exterior=1.5),
    "pane": pl.materials.ThinGlass(1.5),
}
ANGLES_DEG = (0.0, 30.0, 60.0, 80.0, 89.0, 89.9)


def points(n):
    """(n, 3): a lattice (Korobov's, odd generator, so that each column holds every k / n once), shifted by half."""
    assert n & (n - 1) == 0, "a power of two, prime to odd generators"
    generator = [1, 1_540_483_477 % n | 1, 1_013_904_223 % n | 1]
    return (np.arange(n)[:, None] * np.array(generator) % n + 0.5) / n


def evaluated(material, viewer, light):
    """(n, C) values, (n,) densities."""
    viewer = np.broadcast_to(viewer, light.shape)
    front = viewer[:, 2] > 0
    side = np.where(front[:, None], 1.0, [1.0, 1.0, -1.0])
    made = {s: pl.bsdf.evaluate(material, viewer * side, light * side, front=s) for s in np.unique(front).tolist()}
    before, behind = made.get(True, made.get(False)), made.get(False, made.get(True))
    return np.where(front[:, None], before.value, behind.value), np.where(front, before.density, behind.density)


def drawn(material, viewer, u):
    """(n, 3) directions, (n, C) weights, (n,) densities for one viewer, (1, 3)."""
    front = bool(viewer[0, 2] > 0)
    side = np.array([1.0, 1.0, 1.0 if front else -1.0])
    direction, weight, density = pl.bsdf.draw(material, viewer * side, u, front=front)
    return direction * side, weight, density


def index_at(material, direction):
    """Refractive index on the side that directions point to."""
    if not isinstance(material, pl.Dielectric):
        return np.ones(len(direction))
    return np.where(direction[:, 2] > 0, material.exterior, material.index)


def returned(material, viewer, n=1 << 13):
    """(C,), (C,): share of the power that a surface gives back, and its standard error over 16 batches.

    Transmitted radiance has changed with the square of the index, which is taken back.
    """
    direction, weight, _ = drawn(material, viewer, points(n))
    ratio = np.where(np.isfinite(direction[:, 2]), index_at(material, direction) / index_at(material, viewer), 0.0)
    batches = (weight * ratio[:, None] ** 2).reshape(16, n // 16, -1).mean(axis=1)
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / 4


def test_light_goes_both_ways():
    # f(a, b) = f(b, a); across a surface f / n^2 is what is symmetric, n on the side of the viewer (E. Veach, PhD
    # thesis, Stanford 1997, p. 140). Sums of some ten products: a few hundred eps, and cosines down to 1e-3.
    a, b = np.random.default_rng(7).normal(size=(2, 500, 3))
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    kept = (np.abs(a[:, 2]) > 1e-3) & (np.abs(b[:, 2]) > 1e-3)
    a, b = a[kept], b[kept]
    same_side = a[:, 2] * b[:, 2] > 0
    for name, material in ROUGH.items():
        there = evaluated(material, a, b)[0] / np.abs(b[:, 2:]) / index_at(material, a)[:, None] ** 2
        back = evaluated(material, b, a)[0] / np.abs(a[:, 2:]) / index_at(material, b)[:, None] ** 2
        np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-12, err_msg=name)
        assert (there[same_side] > 0).mean() > 0.9
        assert there[~same_side].any() == (name in CLEAR)


def refined(low, high, middle, width, n=24):
    """(n + 1,) places from low to high, dense within a width of the middle: a hyperbolic sine of equal steps."""
    t = np.linspace(math.asinh((low - middle) / width), math.asinh((high - middle) / width), n + 1)
    places = middle + width * np.sinh(t)
    places[[0, -1]] = low, high
    return places


def bins_about(material, viewer):
    """Edges in z, below and above the horizon, and in azimuth, dense where a smooth surface would send light."""
    z = float(viewer[0, 2])
    eta = index_at(material, viewer)[0] / index_at(material, -viewer)[0]
    refracted = math.sqrt(max(1 - eta * eta * (1 - z * z), 0.0))
    mirrored, through = (z, -refracted) if z > 0 else (-refracted, z)[::-1]
    low, high = min(mirrored, through), max(mirrored, through)
    edges = np.concatenate([refined(-1, 0, low, 0.05), refined(0, 1, high, 0.05)[1:]])
    # Refraction ends where facets stand upright, and with a jump.
    if abs(upright := -z * eta) < 1:
        edges = np.unique(np.append(edges, upright))
    return edges, refined(0, 2 * math.pi, math.pi, 0.25)


def nodes(edges, order):
    """(n, order) places and weights of Gauss-Legendre quadrature between n + 1 edges."""
    x, w = np.polynomial.legendre.leggauss(order)
    half = 0.5 * np.diff(edges)[:, None]
    return 0.5 * (edges[:-1, None] + edges[1:, None]) + half * x, half * w


def expected_in_bins(material, viewer, z_edges, azimuth_edges):
    """Integral of the density over each bin, by quadrature."""
    (z, wz), (az, waz) = nodes(z_edges, 6), nodes(azimuth_edges, 6)
    z, az = np.broadcast_arrays(z[:, :, None, None], az)
    s = np.sqrt(1 - z * z)
    light = np.stack([s * np.cos(az), s * np.sin(az), z], axis=-1).reshape(-1, 3)
    density = evaluated(material, viewer, light)[1].reshape(z.shape)
    return np.einsum("ij,ijkl,kl->ik", wz, density, waz)


VIEWS_DEG = (3.0, 40.0, 75.0, 88.0, 140.0, 100.0)
PARTS = pytest.mark.parametrize("others", [False, pytest.param(True, marks=pytest.mark.slow)])
"""A quick choice of cases, and all others."""


@PARTS
def test_directions_are_drawn_as_often_as_their_density_says(others):
    # Pearson's chi-square over some 1100 bins, those with fewer than 10 expected draws taken together. What is
    # drawn and leads nowhere (weight 0 below a horizon) counts in a bin of its own, where the density is 0. All tests
    # of this kind together fail by chance once in 1000 seeds.
    some = [(name, VIEWS_DEG[k]) for i, name in enumerate(ROUGH) for k in (i % 4, 4 + i % 2)]
    for name, angle_deg in itertools.product(ROUGH, VIEWS_DEG):
        if ((name, angle_deg) in some) == others:
            continue
        material, viewer, n = ROUGH[name], towards(angle_deg), 20_000
        direction, weight, _ = drawn(material, viewer, np.random.default_rng(11).random((n, 3)))
        z_edges, azimuth_edges = bins_about(material, viewer)
        expected = n * expected_in_bins(material, viewer, z_edges, azimuth_edges).ravel()
        alive = (weight > 0).any(axis=1)
        azimuth = np.arctan2(direction[:, 1], direction[:, 0]) % (2 * math.pi)
        found = np.histogram2d(direction[alive, 2], azimuth[alive], [z_edges, azimuth_edges])[0].ravel()
        expected, found = np.append(expected, n - expected.sum()), np.append(found, n - found.sum())
        assert expected.min() > -1e-3 * n  # the density integrates to 1 at most: what quadrature leaves is below 1e-3
        large = expected >= 10
        expected = np.append(expected[large], max(expected[~large].sum(), 1e-9))
        found = np.append(found[large], found[~large].sum())
        if expected[-1] < 10:
            assert found[-1] < 40
            expected, found = expected[:-1], found[:-1]
        chi_square, freedom = float(((found - expected) ** 2 / expected).sum()), len(expected) - 1
        assert freedom > 19
        # The chance of at least this.
        chance = float(mpmath.gammainc(freedom / 2, chi_square / 2, mpmath.inf, regularized=True))
        assert chance > 1e-3 / (len(ROUGH) * len(VIEWS_DEG)), (name, angle_deg)


def test_weights_are_values_over_densities():
    polished = {"polished mirror": pl.Conductor(0.9, alpha=1e-3)}
    for (name, material), angle_deg in itertools.product((ROUGH | polished).items(), (3.0, 75.0, 140.0)):
        viewer = towards(angle_deg, 20.0)
        direction, weight, density = drawn(material, viewer, np.random.default_rng(3).random((2000, 3)))
        alive = (weight > 0).any(axis=1)
        assert alive.mean() > 0.5, (name, angle_deg)
        np.testing.assert_allclose(np.linalg.norm(direction[alive], axis=1), 1.0, rtol=1e-12)
        value, again = evaluated(material, viewer, direction[alive])
        # Half vectors found again from directions, cosines down to 1e-4 or so: 1e-6 is what is left of eps at worst.
        np.testing.assert_allclose(again, density[alive], rtol=1e-6, err_msg=name)
        np.testing.assert_allclose(weight[alive] * density[alive, None], value, rtol=1e-6, atol=1e-12, err_msg=name)


def test_no_surface_gives_back_more_than_it_gets():
    # 4 standard errors; where directions are exact there is no error but rounding.
    for name, angle_deg, side in itertools.product(ROUGH, ANGLES_DEG, (1, -1)):
        share, error = returned(ROUGH[name], side * towards(angle_deg, 10.0))
        assert np.all(share <= 1 + 4 * error + 1e-9), (name, side, angle_deg, share, error)


def test_what_absorbs_nothing_loses_nothing():
    for name, angle_deg, side in itertools.product(WHITE, ANGLES_DEG, (1, -1)):
        share, error = returned(WHITE[name], side * towards(angle_deg, 10.0))
        assert np.all(share <= 1 + 4 * error + 1e-9), (name, side, angle_deg, share, error)
        assert np.all(share >= 1 - 4 * error - 1e-6), (name, side, angle_deg, share, error)


def reflected_by_quadrature(material, viewer, width):
    """Integrals of value and density over the directions before the front, places dense about the mirror's."""
    edges = refined(0, 1, viewer[0, 2], 0.3 * width, n=64), refined(0, 2 * math.pi, math.pi, 0.5 * width, n=64)
    z, wz, azimuth, wa = (part.ravel() for some in edges for part in nodes(some, 8))
    sine = np.sqrt(1 - z * z)[:, None]
    light = np.stack(np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), z[:, None]), axis=-1)
    value, density = evaluated(material, viewer, light.reshape(-1, 3))
    shape = light.shape[:2]
    return wz @ value[:, 0].reshape(shape) @ wa, wz @ density.reshape(shape) @ wa


def test_white_matt_surfaces_reflect_all_by_quadrature():
    # Independent of how directions are drawn. Grooves have an edge where the light stands as high as the viewer.
    matt = [pl.materials.RoughDiffuse(1.0, 0.3), pl.materials.RoughDiffuse(1.0, 1.0)]
    for material, angles in ((pl.Lambertian(1.0), (75.0,)), *((rough, (0.0, 55.0, 85.0, 89.5)) for rough in matt)):
        for angle_deg in angles:
            reflected, drawn_at_all = reflected_by_quadrature(material, towards(angle_deg), 0.3)
            assert reflected == pytest.approx(1, abs=1e-4), (material, angle_deg)
            assert drawn_at_all == pytest.approx(1, abs=1e-6), (material, angle_deg)


@PARTS
def test_white_plastic_reflects_all_by_quadrature(others):
    # What base and layer share is balanced by a table, and what lies between its rows by a straight line. Of the
    # directions drawn for the highlight some would lead below the horizon.
    rough, angles = (0.0, 0.05, 0.12, 0.33, 0.5, 1.0), (55.0, 85.0, 0.0, 75.0, 89.5, 88.0)
    for roughness, angle_deg in itertools.product(rough, angles):
        if (rough.index(roughness) == angles.index(angle_deg)) == others:
            continue
        plastic = pl.MetallicRoughness(1.0, 0.0, roughness)
        reflected, drawn_at_all = reflected_by_quadrature(plastic, towards(angle_deg), max(roughness**2, 1e-3))
        assert reflected == pytest.approx(1, abs=2e-3), (roughness, angle_deg)
        assert 0.5 < drawn_at_all < 1 + 2e-3, (roughness, angle_deg)


def facets(viewer, alpha, n=512):
    """(n^2, 3) normals of facets as often as area shows them from above, and how much of each the viewer sees.

    Integrals over D cos become those over the unit square: tan^2 = alpha^2 u / (1 - u).
    """
    u, v = np.meshgrid(*[(np.arange(n) + 0.5) / n] * 2)
    z = 1 / np.sqrt(1 + alpha**2 * u / (1 - u))
    s = np.sqrt(1 - z * z)
    normal = np.stack([s * np.cos(2 * math.pi * v), s * np.sin(2 * math.pi * v), z], axis=-1).reshape(-1, 3)
    return normal, np.maximum(normal @ viewer[0], 0) / (normal[:, 2] * viewer[0, 2])


def test_rough_glass_loses_what_leaves_its_first_facet_for_another():
    # E(v) = integral over facets of D (v m) / cos v: Fresnel's share reflected, 1 / (1 + Lambda_v + Lambda_l) of it
    # seen where the mirrored direction l rises, and of the rest 1 / (1 + Lambda_v) / (1 + Lambda_l) where the refracted
    # direction falls. 512^2 midpoints, kinks at both horizons: 1e-3.
    glass, ice = pl.Dielectric(1.5, alpha=0.3), pl.Dielectric(1.2, alpha=0.7, exterior=1.7)
    for material, angle_deg in ((glass, 0.0), (glass, 75.0), (glass, 110.0), (ice, 45.0), (ice, 110.0), (ice, 150.0)):
        there = towards(angle_deg)
        eta = index_at(material, -there)[0] / index_at(material, there)[0]
        viewer = np.abs(there)
        normal, seen = facets(viewer, material.alpha)
        cosine = np.clip(normal @ viewer[0], 0, 1)
        inner = np.sqrt(np.maximum(1 - (1 - cosine**2) / eta**2, 0))
        s = (cosine - eta * inner) / np.maximum(cosine + eta * inner, 1e-12)
        p = (eta * cosine - inner) / np.maximum(eta * cosine + inner, 1e-12)
        share = np.where(inner > 0, 0.5 * (s * s + p * p), 1.0)
        up = 2 * cosine * normal[:, 2] - viewer[0, 2]
        down = (cosine / eta - inner) * normal[:, 2] - viewer[0, 2] / eta
        of_viewer = smith(viewer[0, 2], material.alpha)
        kept_up = (up > 0) / (1 + of_viewer + smith(np.where(up > 0, up, 1.0), material.alpha))
        kept_down = (down < 0) / (1 + of_viewer) / (1 + smith(np.where(down < 0, down, 1.0), material.alpha))
        expected = np.mean(seen * (share * kept_up + (1 - share) * kept_down))
        found, error = returned(material, there)
        assert abs(found[0] - expected) < 4 * error[0] + 2e-3, (angle_deg, found, expected)
        assert expected < 1


def fresnel(cosine, index):
    """(R_s, R_p) of a surface to a medium of the (complex) index; M. Born and E. Wolf, sections 1.5.2 and 14.2."""
    inner = cmath.sqrt(1 - (1 - cosine**2) / index**2)
    s = (cosine - index * inner) / (cosine + index * inner)
    p = (index * cosine - inner) / (index * cosine + inner)
    return abs(s) ** 2, abs(p) ** 2


def reflected_share(material, viewer, n=1 << 14):
    """Power that stays on the side of the viewer; every column of the points holds each k / n once: 1 / n."""
    direction, weight, _ = drawn(material, viewer, points(n))
    return float(np.mean(weight[:, 0] * (direction[:, 2] * viewer[0, 2] > 0)))


def test_any_incidence_on_glass_panes_and_metals():
    for angle_deg in (0.0, 20.0, 50.0, math.degrees(math.atan(1.5)), 70.0, 85.0, 89.9):  # the fourth one is Brewster's
        viewer = towards(angle_deg)
        one = sum(fresnel(viewer[0, 2], 1.5)) / 2
        # An absolute index does not matter, only the ratio. Both surfaces of a pane, to and fro: R + T^2 R / (1 - R^2)
        # = 2 R / (1 + R).
        for material, expected in (
            (pl.Dielectric(1.5), one),
            (pl.Dielectric(2.25, exterior=1.5), one),
            (pl.materials.ThinGlass(1.5), 2 * one / (1 + one)),
        ):
            assert reflected_share(material, viewer) == pytest.approx(expected, abs=2**-13), (material, angle_deg)
        _, weight, density = drawn(pl.Conductor(0.9, index=COPPER), viewer, points(16))
        expected = [0.45 * sum(fresnel(viewer[0, 2], n)) for n in COPPER]
        np.testing.assert_allclose(weight, np.tile(expected, (16, 1)), rtol=1e-9)
        assert np.all(density == math.inf)


def test_light_inside_glass_is_reflected_totally_beyond_the_critical_angle():
    critical = math.degrees(math.asin(1 / 1.5))
    for angle_deg in (critical + 0.01, 60.0, 89.0, critical - 0.1, 30.0):
        expected = sum(fresnel(math.cos(math.radians(angle_deg)), 1 / 1.5)) / 2
        assert (expected > 1 - 1e-12) == (angle_deg > critical)
        share = reflected_share(pl.Dielectric(1.5), -towards(angle_deg))
        assert share == pytest.approx(expected, abs=1e-12 if angle_deg > critical else 2**-13)


def test_snell_and_mirrors():
    material, pane = pl.Dielectric(1.5, exterior=1.2), pl.materials.ThinGlass(1.5, transmittance=0.5)
    for angle_deg in (0.0, 35.0, 80.0, 100.0, 150.0):
        viewer = towards(angle_deg, 130.0)
        mirrored = viewer[0] * [-1, -1, 1]
        direction, weight, _ = drawn(pl.Conductor(0.7), viewer, points(16))
        np.testing.assert_allclose(direction, np.tile(mirrored, (16, 1)), atol=1e-15)
        np.testing.assert_allclose(weight, 0.7, rtol=1e-15)
        direction, weight, density = drawn(material, viewer, points(256))
        assert np.all(density == math.inf)
        stays = direction[:, 2] * viewer[0, 2] > 0
        np.testing.assert_allclose(direction[stays], np.tile(mirrored, (stays.sum(), 1)), atol=1e-15)
        here, there = index_at(material, viewer)[0], index_at(material, -viewer)[0]
        # n sin = n' sin', on the other side of the normal; radiance has changed by (n / n')^2 on its way.
        refracted = np.tile(-viewer[0, :2] * here / there, ((~stays).sum(), 1))
        np.testing.assert_allclose(direction[~stays, :2], refracted, atol=1e-14)
        np.testing.assert_allclose(weight[~stays], (here / there) ** 2, rtol=1e-9)
        np.testing.assert_allclose(weight[stays], 1.0, rtol=1e-9)
        direction, weight, _ = drawn(pane, viewer, points(256))
        stays = direction[:, 2] * viewer[0, 2] > 0
        np.testing.assert_allclose(direction[~stays], np.tile(-viewer[0], ((~stays).sum(), 1)), atol=1e-15)
        one = sum(fresnel(abs(viewer[0, 2]), 1.5)) / 2
        assert weight[~stays].sum() / 256 == pytest.approx(0.5 * (1 - one) / (1 + one), abs=2**-7)
    # Exact directions have no value that could be hit by chance.
    light = towards(30.0, 180.0)
    for material in (pl.Conductor(), pl.Dielectric(1.5), pl.materials.ThinGlass()):
        values, density = evaluated(material, towards(30.0), np.concatenate([light, -light, towards(31.0, 180.0)]))
        assert not values.any() and not density.any()


def test_lambertian_is_albedo_cosine_over_pi_on_the_viewers_side():
    light = np.concatenate([towards(t, p) for t in (0.0, 60.0, 89.0, 91.0, 180.0) for p in (0.0, 70.0)])
    for angle_deg in (20.0, 70.0):
        cosine = np.maximum(light[:, 2:], 0.0)
        for material in (pl.Lambertian((0.8, 0.5, 0.2)), pl.materials.RoughDiffuse((0.8, 0.5, 0.2), roughness=0.0)):
            values, density = evaluated(material, towards(angle_deg), light)
            np.testing.assert_allclose(values, cosine * [0.8, 0.5, 0.2] / math.pi, rtol=1e-12, atol=1e-17)
        values, density = evaluated(pl.Lambertian(0.8), towards(angle_deg), light)
        np.testing.assert_allclose(density, cosine[:, 0] / math.pi, rtol=1e-12, atol=1e-17)


def microfacet(viewer, light, alpha):
    """D G / (4 cos_v) of GGX with height-correlated shadowing: value of a rough mirror, in independent words."""
    half = viewer + light
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    d = alpha**2 / (math.pi * (half[:, 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    g = 1 / (1 + smith(viewer[:, 2], alpha) + smith(light[:, 2], alpha))
    return d * g / (4 * viewer[:, 2]), np.sum(viewer * half, axis=1)


def test_rough_metals_are_what_the_formula_says():
    light = np.concatenate([towards(t, p) for t in (5.0, 40.0, 46.0, 85.0) for p in (90.0, 175.0, 180.0)])
    viewer, base = np.tile(towards(45.0), (len(light), 1)), np.array([1.0, 0.8, 0.3])
    for alpha in (1e-3, 0.01, 0.1, 0.64):
        lobe, cosine = microfacet(viewer, light, alpha)
        values, _ = evaluated(pl.Conductor(0.9, alpha=alpha, index=COPPER), viewer, light)
        expected = [[0.45 * sum(fresnel(c, n)) * part for n in COPPER] for c, part in zip(cosine, lobe, strict=True)]
        np.testing.assert_allclose(values, expected, rtol=1e-8)
        values, _ = evaluated(pl.MetallicRoughness(tuple(base), 1.0, math.sqrt(alpha)), viewer, light)
        schlick = base + (1 - base) * (1 - cosine[:, None]) ** 5
        np.testing.assert_allclose(values, schlick * lobe[:, None], rtol=1e-8)


def test_grazing_and_exact_directions_stay_finite():
    tiny = np.array([[1.0, 0.0, 1e-12], [1.0, 0.0, -1e-12], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    corners = np.array(list(itertools.product((0.0, 1 - 2**-32), repeat=3)))
    for material, viewer in itertools.product((ROUGH | WHITE).values(), tiny):
        direction, weight, density = drawn(material, viewer[None], corners)
        alive = (weight > 0).any(axis=1)
        assert np.isfinite(weight).all() and not np.isnan(density).any(), material
        assert np.isfinite(direction[alive]).all(), material
        values, density = evaluated(material, viewer[None], tiny)
        assert np.isfinite(values).all() and np.isfinite(density).all(), material
