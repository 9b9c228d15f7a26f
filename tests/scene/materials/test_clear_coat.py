"""The clear coat of `MetallicRoughness`: by formulas written anew, by light that is followed through layers, by energy.

That it is reciprocal and drawn as its density says is tested for all materials in `test_bsdf`.
"""

import itertools
import math

import numpy as np
from scene_helpers import smith, towards

import plenoptic as pl

GOLD = (1.0, 0.77, 0.34)
COATED = {
    "varnished white": pl.MetallicRoughness(1.0, 0.0, 0.5, clearcoat=1.0),
    "matt varnish on white": pl.MetallicRoughness(1.0, 0.0, 0.3, clearcoat=1.0, clearcoat_roughness=0.6),
    "half varnished": pl.MetallicRoughness(0.5, 0.0, 0.8, clearcoat=0.5, clearcoat_roughness=0.2),
    "car paint": pl.MetallicRoughness(0.9, 1.0, 0.5, clearcoat=1.0, clearcoat_roughness=0.1),
    "polished metal": pl.MetallicRoughness(1.0, 1.0, 0.2, clearcoat=1.0, clearcoat_roughness=0.3),
    "mixture": pl.MetallicRoughness(0.7, 0.4, 0.6, clearcoat=0.8, clearcoat_roughness=0.4),
    "black": pl.MetallicRoughness(0.0, 0.0, 0.5, clearcoat=1.0, clearcoat_roughness=0.25),
}


def dot(a, b):
    return (a * b).sum(axis=-1)


def schlick(normal, cosine):
    return normal + (1 - normal) * (1 - cosine) ** 5


def facets(o, alpha, u):
    """Normals of GGX that are seen from directions o (Dupuy and Benyoub 2023), by pairs of numbers."""
    s = o * [alpha, alpha, 1.0]
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    z = (1 - u[:, 1]) * (1 + s[..., 2]) - s[..., 2]
    r, a = np.sqrt(np.clip(1 - z * z, 0, 1)), 2 * np.pi * u[:, 0]
    h = (np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1) + s) * [alpha, alpha, 1.0]
    return h / np.linalg.norm(h, axis=-1, keepdims=True)


def reflected(o, roughness, u):
    """What a layer of reflectance 0.04 reflects of light from directions o: directions, and shares of the light."""
    alpha = max(roughness**2, 1e-3)
    h = facets(o, alpha, u)
    cosine = np.clip(dot(o, h), 0, 1)
    i = 2 * cosine[:, None] * h - o
    above = i[:, 2] > 0
    safe = np.where(above[:, None], i, [0.0, 0.0, 1.0])
    first = 1 + smith(o[:, 2], alpha)
    share = schlick(0.04, cosine) * first / (first + smith(safe[:, 2], alpha))
    return i, np.where(above, share, 0.0)


def grid(n):
    middle = (np.arange(n) + 0.5) / n
    return np.stack([part.ravel() for part in np.meshgrid(middle, middle)], axis=1)


def passes(cosines, roughness):
    """What a layer lets pass, from directions at some cosines: by quadrature, without the tables of the package."""
    found = []
    for cosine in np.ravel(cosines):
        o = np.broadcast_to([math.sqrt(1 - cosine * cosine), 0.0, cosine], (40 * 40, 3))
        found.append(1 - reflected(o, roughness, grid(40))[1].mean())
    return np.reshape(found, np.shape(cosines))


def by_formula(material, o, i):
    """(n,): f cos of a coated material, as its documentation describes it."""
    base, metallic, roughness = material.base, material.metallic, material.roughness
    fraction, coat_roughness = material.clearcoat, material.clearcoat_roughness

    def lobe(normal, rough):
        alpha = max(rough**2, 1e-3)
        h = (o + i) / np.linalg.norm(o + i, axis=-1, keepdims=True)
        d = alpha**2 / (np.pi * (h[:, 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
        return schlick(normal, dot(o, h)) * d / (4 * o[:, 2] * (1 + smith(o[:, 2], alpha) + smith(i[:, 2], alpha)))

    def coat(cosines):
        return 1 - fraction * (1 - passes(cosines, coat_roughness))

    # Mean of what passes both layers over the cosine-weighted hemisphere, by Gauss-Legendre in the root of the cosine.
    x, w = np.polynomial.legendre.leggauss(24)
    r = 0.5 * (x + 1)
    mean = (0.5 * w * 4 * r**3 * coat(r * r) * passes(r * r, roughness)).sum()
    to_o, to_i = coat(o[:, 2]), coat(i[:, 2])
    both = to_o * to_i * passes(o[:, 2], roughness) * passes(i[:, 2], roughness) / mean
    below = lobe(0.04 + metallic * (base - 0.04), roughness) * np.minimum(to_o, to_i)
    matt = (1 - metallic) * base * both * i[:, 2] / np.pi
    return fraction * lobe(0.04, coat_roughness) + below + matt


def test_it_is_what_its_formula_says():
    o, i = np.random.default_rng(5).normal(size=(2, 60, 3))
    o, i = (np.abs(v) / np.linalg.norm(v, axis=1, keepdims=True) for v in (o, i))
    # Half of the pairs near the mirror's direction, where lobes are.
    i[::2] = o[::2] * [-1, -1, 1] + 0.03 * i[::2]
    i /= np.linalg.norm(i, axis=1, keepdims=True)
    # Tables are linear between their nodes, and their quadrature has as many points: 1 % at cosines above 0.05.
    kept = (o[:, 2] > 0.05) & (i[:, 2] > 0.05)
    for name, material in COATED.items():
        found = pl.bsdf.evaluate(material, o, i).value[:, 0]
        np.testing.assert_allclose(found[kept], by_formula(material, o[kept], i[kept]), rtol=0.01, err_msg=name)


def given_back(material, o):
    """(C,): share of the light that a material gives back, by directions that it draws: one for each cell of a grid.

    Weights lie between 0 and 3 and are smooth but where one lobe follows the other, in 512 cells of 65536: 4 standard
    errors are 1e-3.
    """
    jitter = (np.random.default_rng(1).random((256 * 256, 2)) - 0.5) / 256
    u = np.column_stack([grid(256) + jitter, np.full(256 * 256, 0.5)])
    return pl.bsdf.draw(material, o, u).weight.mean(axis=0)


def test_white_stays_white_under_a_coat_and_no_light_is_made():
    whites = [
        pl.MetallicRoughness(1.0, 0.0, roughness, clearcoat=1.0, clearcoat_roughness=coat)
        for roughness, coat in ((0.05, 0.3), (0.5, 0.0), (1.0, 0.3), (1.0, 1.0), (0.05, 1.0))
    ]
    for material, angle_deg in itertools.product([*whites, *COATED.values()], (0.0, 60.0, 80.0, 88.0)):
        least = 0.99 if material in whites else 0.0
        assert least <= given_back(material, towards(angle_deg)).max() <= 1 + 1e-3, (material, angle_deg)
    # Without a coat nothing changes.
    o, i = np.abs(np.random.default_rng(3).normal(size=(2, 100, 3)))
    bare = pl.MetallicRoughness(GOLD, 0.5, 0.4)
    thin = pl.MetallicRoughness(GOLD, 0.5, 0.4, clearcoat=1e-12, clearcoat_roughness=0.7)
    assert pl.Scene([pl.box(1, material=bare)]).tables().bsdf.extra_shares is None
    beside = pl.Scene([pl.box(1, material=bare), pl.box(2, material=thin)]).tables().bsdf
    assert beside.extra_shares.tolist() == [[0.0, 0.0], [1e-12, 0.7]]
    np.testing.assert_allclose(pl.bsdf.evaluate(thin, o, i).value, pl.bsdf.evaluate(bare, o, i).value, rtol=1e-9)


def test_textures_give_the_numbers_of_the_coat():
    # Texels are float32, and so are these numbers: the images have the same bits.
    def image(clearcoat, roughness):
        material = pl.MetallicRoughness(0.5, 0.8, 0.5, clearcoat=clearcoat, clearcoat_roughness=roughness)
        floor = pl.quad((-20, -20, -404), (40, 0, 0), (0, 40, 0), material=material)
        lamp = pl.QuadLight.facing((0, 30, -380), (0, 0, -404), (9, 9), radiance=5.0)
        camera = pl.PlenopticCamera(pl.no_lens(1.0), pl.Sensor((16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
        return pl.render(pl.Scene([floor], [lamp], 0.5), camera, samples=4, progress=False).image

    def texture(number):
        return pl.Texture(np.full((2, 2, 1), number))

    numbers = image(0.75, 0.25)
    np.testing.assert_array_equal(image(texture(0.75), texture(0.25)), numbers)
    np.testing.assert_array_equal(image(texture(0.75), 0.25), numbers)
    assert not np.array_equal(image(0.75, 0.5), numbers) and not np.array_equal(image(0.0, 0.25), numbers)
