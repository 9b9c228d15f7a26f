"""Transmission of lenses: closed forms of a plate and a doublet, energy, both directions, and the tables of kernels."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.analysis.transmission import light_balance
from plenoptic.optics.lens.lens_record import lens_record, radiometric_lens_record
from plenoptic.optics.lens.trace import trace_part

GLASS, CROWN, FLINT = pl.ConstantMedium(1.6), pl.ConstantMedium(1.5), pl.ConstantMedium(1.7)
BARE, SINGLE = pl.optics.Coating(), pl.optics.SingleLayer()
METALLIC = pl.optics.Coating([(pl.ConstantMedium(1.38), 92.0), (pl.optics.FilmMaterial(3.18, 3.33), 3.0)])
TABLES = 4e-7
"""Error of linear interpolation in a table of one surface by the squared cosine, for angles up to 60 degrees: h^2 / 8
times a second derivative of up to 3, h = 1 / 1024."""


def plate(thickness=10.0, medium=GLASS, coating=BARE):
    faces = [pl.Surface(math.inf, thickness, medium, semi_diameter=500.0, coating=coating)]
    return pl.LensStack([*faces, pl.Surface(math.inf, semi_diameter=500.0, coating=coating), pl.CircularStop(500.0)])


def fan(angles):
    directions = np.column_stack([np.sin(angles), np.zeros(len(angles)), np.cos(angles)])
    return pl.RayBundle(np.tile([0.0, 0.0, -20.0], (len(angles), 1)), directions)


def fresnel(n, angle):
    """Transmittances s and p of bare glass (Born & Wolf, 1.5.3): products of sines of both angles."""
    refracted = np.arcsin(np.sin(angle) / n)
    s = np.sin(2 * angle) * np.sin(2 * refracted) / np.sin(angle + refracted) ** 2
    return s, s / np.cos(angle - refracted) ** 2


def test_a_plate_transmits_as_two_surfaces_and_its_glass_do():
    angles = np.radians([1e-3, 20.0, 45.0, 60.0, 75.0])
    once = 0.5 * sum(fresnel(1.6, angles))
    rays = fan(angles)
    np.testing.assert_allclose(light_balance(plate(), rays).transmitted, once**2, rtol=1e-12)
    traced = plate().trace(rays).weight
    np.testing.assert_allclose(traced[:4], once[:4] ** 2, atol=2 * TABLES)
    assert traced[4] == pytest.approx(once[4] ** 2, abs=2e-5)
    absorbing = pl.optics.AbsorbingGlass(GLASS, [500.0, 600.0], [0.5, 0.8])
    through = 10.0 / np.sqrt(1.0 - (np.sin(angles) / 1.6) ** 2)
    alpha = np.interp(587.6, [500.0, 600.0], -np.log([0.5, 0.8]) / 10.0)
    balance = light_balance(plate(medium=absorbing), rays)
    np.testing.assert_allclose(balance.transmitted, once**2 * np.exp(-alpha * through), rtol=1e-12)
    np.testing.assert_allclose(balance.absorbed, once * (1.0 - np.exp(-alpha * through)), rtol=1e-11)
    ratio = plate(medium=absorbing).trace(rays).weight / traced
    np.testing.assert_allclose(ratio, np.exp(-alpha * through), rtol=1e-12)


def test_glass_of_any_depth():
    """exp(-depth) to 256 roundings of its 256th root, and no light at all behind more than 64."""
    axial = pl.RayBundle([[0.0, 0.0, -10.0]], [[0.0, 0.0, 1.0]])
    for depth in (1e-9, 1e-3, 0.5, 3.0, 20.0, 60.0, 1e6):
        dark = pl.optics.AbsorbingGlass(GLASS, [587.6], [math.exp(-1.0)], thickness=1.0)
        light = plate(depth, dark).trace(axial).weight[0] / plate(depth).trace(axial).weight[0]
        assert light == pytest.approx(math.exp(-min(depth, 64.0)), rel=256 * 2.0**-52)


def test_a_cemented_doublet_on_its_axis():
    """4 n n' / (n + n')^2 at each of three surfaces, Fresnel's formulas at 40 degrees; nothing without a coating."""
    elements = [
        pl.Surface(60.0, 5.0, CROWN, semi_diameter=10.0),
        pl.Surface(-50.0, 2.0, FLINT, semi_diameter=10.0),
        pl.Surface(-200.0, semi_diameter=10.0),
        pl.CircularStop(9.0),
    ]
    lens = pl.LensStack(elements)
    axial_light = math.prod(4 * a * b / (a + b) ** 2 for a, b in ((1.0, 1.5), (1.5, 1.7), (1.7, 1.0)))
    axial = pl.RayBundle([[0.0, 0.0, -10.0]], [[0.0, 0.0, 1.0]])
    bare = pl.optics.coated(lens, BARE)
    assert [element.coating for element in bare.elements[:3]] == [BARE, None, BARE]
    assert bare.trace(axial).weight[0] == pytest.approx(axial_light, rel=1e-14)
    assert lens.trace(axial).weight[0] == 1.0
    assert bare.with_model(pl.LensModel.THIN).trace(axial).weight[0] == 1.0
    half_percent = pl.optics.coated(lens, pl.optics.Reflectance(0.005))
    cement = 4 * 1.5 * 1.7 / 3.2**2
    assert half_percent.trace(axial).weight[0] == pytest.approx(0.995**2 * cement, rel=1e-14)
    plane = [dataclasses.replace(each, radius=math.inf) for each in elements[:3]]
    angle, expected = math.radians(40.0), 1.0
    for ratio in (1.5, 1.7 / 1.5, 1.0 / 1.7):
        expected *= 0.5 * sum(fresnel(ratio, angle))
        angle = math.asin(math.sin(angle) / ratio)
    cemented = pl.optics.coated(pl.LensStack([*plane, elements[3]]), BARE)
    direction = fan([math.radians(40.0)]).direction
    tilted = pl.RayBundle([[0.0, 0.0, 0.0]], direction)
    assert cemented.trace(tilted).weight[0] == pytest.approx(expected, abs=3 * TABLES)
    assert light_balance(cemented, tilted).transmitted[0] == pytest.approx(expected, rel=1e-12)
    assert lens.transmission(0.02) == bare.transmission(0.02) == pytest.approx(axial_light, rel=1e-3)


class Slope:
    """Medium whose index is 1.5 at 587.5618 nm and changes linearly, defined from a wavelength on."""

    def __init__(self, per_nm, n=1.5, shortest=0.0):
        self.per_nm, self.n, self.shortest = per_nm, n, shortest

    def index(self, wavelength):
        if wavelength < self.shortest:
            raise pl.errors.InvalidValueError("no index")
        return self.n + self.per_nm * (wavelength - 587.5618)


INFRARED = Slope(1e-4, 1.505, shortest=600.0)
FILMS = [(pl.optics.FilmMaterial(2.0, 1.5), 15.0), (pl.ConstantMedium(1.38), 120.0)]
ORDERS = {True: pl.optics.Coating(FILMS), False: pl.optics.Coating(FILMS[::-1])}


@pytest.mark.parametrize(
    ("front", "behind", "from_front"),
    [
        (CROWN, CROWN, True),
        (CROWN, Slope(1e-4), True),
        (Slope(1e-4), CROWN, True),
        (CROWN, Slope(-1e-4, 1.505), True),
        (Slope(-1e-4, 1.505), CROWN, False),
        (CROWN, INFRARED, True),
        (INFRARED, CROWN, False),
    ],
)
def test_films_of_a_surface_have_one_order_at_all_wavelengths(front, behind, from_front):
    """Indices cross, or are the same: light from behind meets the films reversed, and no wavelength turns them."""
    face = pl.Surface(math.inf, 1.0, behind, semi_diameter=9.0, coating=ORDERS[True])
    lens = pl.LensStack([face, pl.CircularStop(5.0)], front_medium=front, rear_medium=behind)
    for nm in (700.0,) if INFRARED in (front, behind) else (480.0, 700.0):
        for reverse in (False, True):
            n_from, n_to = (medium.index(nm) for medium in ((behind, front) if reverse else (front, behind)))
            # Films in the order in which light meets them are described from the medium of the lower index.
            meets_in_order = from_front != reverse
            expected = pl.optics.surface_powers(ORDERS[meets_in_order == (n_from <= n_to)], n_from, n_to, 1.0, nm)
            z = 2.0 if reverse else -1.0
            rays = pl.RayBundle([[0.0, 0.0, z]], [[0.0, 0.0, -1.0 if reverse else 1.0]], nm)
            balance = light_balance(lens, rays, reverse=reverse)
            assert balance.reflected[0] == pytest.approx(float(expected.reflectance), rel=1e-12)
            assert balance.transmitted[0] == pytest.approx(float(expected.transmittance), rel=1e-12)
            traced = (lens.trace_reverse if reverse else lens.trace)(rays).weight[0]
            assert traced == pytest.approx(float(expected.transmittance), rel=1e-12)


def random_rays(lens, n=500, seed=1):
    """Rays that pass the lens and rays that are clipped, from an area in front of it."""
    random, points = np.random.default_rng(seed), pl.paraxial.cardinal_points(lens)
    size = 1.5 * points.entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-40, 40, (n, 2)), np.full(n, lens.vertices[0] - 400.0)])
    target = np.column_stack([random.uniform(-size, size, (n, 2)), np.full(n, points.entrance_pupil)])
    return pl.RayBundle(origin, target - origin)


def odd_lens():
    """An asphere, a freeform surface, a tilted conic, a film in air, an absorbing glass and metal in a coating."""
    absorbing = pl.optics.AbsorbingGlass(FLINT, [500.0, 700.0], [0.6, 0.8])
    sag = pl.optics.ZernikeSag((0.0, 0.0, 0.0, 0.02, 0.03), 25.0)
    return pl.LensStack(
        [
            pl.Surface(80.0, 8.0, CROWN, semi_diameter=20.0, aspheric=(0.0, 1e-7), coating=METALLIC),
            pl.Surface(-150.0, 3.0, absorbing, semi_diameter=20.0, freeform=sag),
            pl.Surface(-300.0, 4.0, semi_diameter=20.0, coating=SINGLE, conic=-2.0),
            pl.optics.MaskStop([[0.5, 1.0], [0.25, 1.0]], 20.0, thickness=5.0),
            pl.Surface(200.0, 6.0, GLASS, semi_diameter=22.0, coating=SINGLE, conic=0.5),
            pl.Surface(-90.0, 3.0, semi_diameter=22.0),
            pl.Surface(math.inf, 0.0, semi_diameter=24.0, coating=pl.optics.Reflectance([0.1, 0.3], angles=[0.0, 0.5])),
        ]
    ).moved(4, tilt=(0.05, 0.02, 0.0))


def mirror_lens():
    return pl.LensStack(
        [
            pl.CircularStop(30.0, thickness=150.0),
            pl.Surface(-400.0, 100.0, pl.optics.MIRROR, semi_diameter=35.0, coating=pl.optics.Reflectance(0.1)),
            pl.Surface(-500.0, 5.0, GLASS, semi_diameter=30.0, coating=SINGLE),
            pl.Surface(-90.0, semi_diameter=30.0),
        ]
    ).moved(1, tilt=(0.02, 0.0, 0.0))


LENSES = {
    "double Gauss": pl.optics.coated(pl.load_lens("double-gauss-100mm-f2"), SINGLE),
    "fisheye": pl.optics.coated(pl.load_lens("fisheye-100mm-f8"), METALLIC),
    "odd": odd_lens(),
    "mirror": mirror_lens(),
    "mirror behind glass": pl.LensStack(
        [
            pl.CircularStop(20.0, thickness=5.0),
            pl.Surface(
                -80.0,
                10.0,
                pl.optics.AbsorbingGlass(CROWN, [500.0, 700.0], [0.5, 0.6]),
                semi_diameter=25.0,
                coating=pl.optics.Coating(),
            ),
            pl.Surface(-120.0, 10.0, pl.optics.MIRROR, semi_diameter=25.0, coating=pl.optics.Reflectance(0.1)),
            pl.Surface(80.0, semi_diameter=25.0),
        ]
    ),
}


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_energy_tables_and_both_directions(lens):
    """All light of each ray is transmitted, reflected, absorbed or vignetted; kernels agree; light goes both ways."""
    rays = random_rays(lens)
    behind, balance = lens.trace(rays), light_balance(lens, rays)
    passes = behind.status == 0
    assert 0.05 < passes.mean() < 0.98
    total = balance.transmitted + balance.reflected + balance.absorbed + balance.vignetted
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    for part in (balance.transmitted, balance.reflected, balance.absorbed, balance.vignetted):
        assert part.min() > -1e-12
    assert balance.reflected[passes].min() > 0.001 and (balance.vignetted[passes] < 0.8).all()
    np.testing.assert_allclose(behind.weight, balance.transmitted, atol=TABLES * len(lens.elements))
    back = lens.trace_reverse(pl.RayBundle(behind.origin[passes], -behind.direction[passes]))
    np.testing.assert_allclose(back.weight, behind.weight[passes], rtol=1e-12)
    reverse = light_balance(lens, pl.RayBundle(behind.origin[passes], -behind.direction[passes]), reverse=True)
    np.testing.assert_allclose(reverse.transmitted, balance.transmitted[passes], rtol=1e-11)


@pytest.mark.parametrize(
    ("thickness", "single", "mean"), [(1e3, 5e-7, 1.6e-7), (1e4, 6e-5, 3.6e-6), (1e5, 8e-3, 1.7e-4)]
)
def test_tables_of_thick_films_err_as_the_documents_state(thickness, single, mean):
    film = pl.optics.Coating([(pl.ConstantMedium(1.46), thickness)])
    lens = pl.optics.coated(pl.load_lens("double-gauss-100mm-f2"), film)
    x, y = np.random.default_rng(0).uniform(-20.0, 20.0, (2000, 2)).T
    rays = pl.RayBundle(np.column_stack([x, y, np.full(2000, -100.0)]), np.tile([0.0, 0.15, 1.0], (2000, 1)), 550.0)
    traced, exact = lens.trace(rays), light_balance(lens, rays).transmitted
    errors = (traced.weight - exact)[traced.status == 0]
    assert 0.5 * single < np.abs(errors).max() < 1.1 * single
    assert abs(errors.mean()) / exact[traced.status == 0].mean() < 1.1 * mean


def test_every_ray_has_the_losses_of_its_wavelength():
    from plenoptic.core.kernels.ray_blocks import BLOCK, WEIGHT
    from plenoptic.optics.lens.analysis.conditioning import blocks_of
    from plenoptic.optics.lens.kernels.trace import fill_through_lens

    glasses = [pl.optics.AbsorbingGlass(pl.glass(name), [400.0, 700.0], [0.5, 0.9]) for name in ("N-BK7", "SF6")]
    lens = pl.LensStack(
        [
            pl.Surface(60.0, 8.0, glasses[0], semi_diameter=20.0, coating=SINGLE),
            pl.Surface(-50.0, 3.0, glasses[1], semi_diameter=20.0),
            pl.Surface(-200.0, semi_diameter=20.0, coating=SINGLE),
            pl.CircularStop(15.0),
        ]
    )
    wavelengths, rays = np.array([450.0, 550.0, 650.0]), random_rays(lens, n=BLOCK)
    waves = np.arange(BLOCK) % 3
    blocks = blocks_of(rays)
    fill_through_lens(blocks, radiometric_lens_record(lens, wavelengths, reverse=False), waves)
    for k, wavelength in enumerate(wavelengths.tolist()):
        alone = lens.trace(pl.RayBundle(rays.origin, rays.direction, wavelength)).weight
        np.testing.assert_allclose(blocks[WEIGHT : WEIGHT + BLOCK][waves == k], alone[waves == k], rtol=1e-7)
    assert np.ptp(alone[alone > 0]) > 1e-4


def test_searches_have_no_losses():
    lens = LENSES["double Gauss"]
    assert lens_record(lens, 587.6, reverse=True).losses is None
    record = radiometric_lens_record(lens, 587.6, reverse=True)
    assert record.losses is not None and record.part(0, 3).losses is None
    assert radiometric_lens_record(pl.load_lens("double-gauss-100mm-f2"), 587.6, reverse=True).losses is None
    plain = pl.load_lens("double-gauss-100mm-f2")
    fields = [0.0, 0.2]
    coated, uncoated = (pl.aberrations.vignetting(each, fields, grid=32) for each in (lens, plain))
    assert coated.fraction.tolist() == uncoated.fraction.tolist()


def test_transmission_is_the_ratio_of_irradiances():
    lens, plain = LENSES["double Gauss"], pl.load_lens("double-gauss-100mm-f2")
    light, ideal = (
        pl.aberrations.relative_illumination(each, [0.0, 0.2], grid=64).projected_solid_angle for each in (lens, plain)
    )
    np.testing.assert_allclose(pl.aberrations.transmission(lens, [0.0, 0.2]), light / ideal, atol=TABLES * 11)
    assert lens.transmission(0.2) == pl.aberrations.transmission(lens, [0.2])[0]
    assert pl.optics.coated(plain, BARE).transmission() == plain.transmission() == pytest.approx(0.587, abs=5e-4)


def polarised_transmittance(lens, rays):
    """Transmittance of unpolarised light whose two polarisations are followed from surface to surface, (n,)."""
    index, before = lens.indices(rays.wavelength), rays
    first = np.cross(rays.direction, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1)[:, None]
    fields = np.stack([first, np.cross(rays.direction, first)], axis=1)
    for i, element in enumerate(lens.elements):
        after = trace_part(lens, before, i, i)
        if isinstance(element, pl.Surface):
            incident, refracted = before.direction, after.direction
            normal = index[i + 1] * refracted - index[i] * incident
            normal /= np.linalg.norm(normal, axis=1)[:, None]
            s = np.cross(incident, normal)
            s /= np.linalg.norm(s, axis=1)[:, None]
            cosine = np.abs((normal * incident).sum(axis=1))
            powers = pl.optics.surface_powers(element.coating, index[i], index[i + 1], cosine, rays.wavelength)
            parts = []
            for passed, ahead, behind in (
                (powers.transmittance_s, s, s),
                (powers.transmittance_p, np.cross(s, incident), np.cross(s, refracted)),
            ):
                amplitude = np.sqrt(passed)[:, None] * (fields * ahead[:, None]).sum(axis=2)
                parts.append(amplitude[:, :, None] * behind[:, None])
            fields = sum(parts)
        before = after
    return 0.5 * (fields**2).sum(axis=(1, 2))


def test_light_is_polarised_little_on_its_way():
    """The documents state 2.0 % for bare lenses on their axis, and 0.05 % with a single layer."""
    lens = pl.load_lens("retrofocus-100mm-f1.9")
    pupil = np.random.default_rng(0).uniform(-1.0, 1.0, (600, 2))
    pupil = pupil[np.hypot(*pupil.T) < 0.98]
    errors = []
    for coating in (BARE, SINGLE):
        on = pl.optics.coated(lens, coating)
        rays = pl.aiming.aimed_rays(on, field=(0.0, 0.0), pupil=pupil)
        averaged = light_balance(on, rays).transmitted
        assert averaged.min() > 0.0
        errors.append(polarised_transmittance(on, rays).mean() / averaged.mean() - 1.0)
    assert 0.015 < errors[0] < 0.02 and 0.0 < errors[1] < 0.0005


def test_changes_keep_coatings():
    lens = LENSES["double Gauss"]
    assert [e.coating for e in lens.scaled(0.5).elements if isinstance(e, pl.Surface)].count(SINGLE) == 8
    assert lens.moved(0, tilt=(0.1, 0, 0)).elements[0].coating == SINGLE
    assert lens.with_stop(pl.CircularStop(5.0)).elements[0].coating == SINGLE
    assert pl.optics.coated(lens, None) == pl.load_lens("double-gauss-100mm-f2")
    assert repr(lens).endswith("64.08 mm long, 8 coatings>")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: pl.Surface(10.0, semi_diameter=1.0, coating=1.38),
            "coating is 1.38; it must be pl.optics.SingleLayer",
        ),
        (
            lambda: pl.Surface(10.0, medium=pl.optics.FilmMaterial(0.05, 3.9), semi_diameter=1.0),
            "medium is FilmMaterial.*, which absorbs within a wavelength; metals are the material of films, or mirrors",
        ),
        (
            lambda: pl.Surface(10.0, medium=pl.optics.MIRROR, semi_diameter=1.0, coating=SINGLE),
            "coating of a mirror is SingleLayer.*; it must be a pl.optics.Reflectance",
        ),
        (
            lambda: pl.optics.coated(plate(), pl.optics.Reflectance([0.1, 0.2], [400.0, 500.0])).trace(fan([0.0])),
            "wavelength 587.6 nm is outside 400 to 500 nm, where the reflectance is defined",
        ),
        (
            lambda: pl.optics.coated(plate(), pl.optics.SingleLayer(pl.optics.FilmMaterial(1.4, 0.0, [400.0]), 500.0)),
            "wavelength 500 nm is outside 400 to 400 nm, where a film material is defined",
        ),
        (lambda: pl.load_lens("double-gauss-100mm-f2").transmission(0.9), "no light of the field 0.9 rad passes"),
        (lambda: pl.optics.coated(plate(), "MgF2"), "coating is 'MgF2'"),
    ],
)
def test_wrong_input_is_answered_with_a_sentence(call, message):
    with pytest.raises(pl.errors.InvalidValueError, match=message):
        call()


def test_total_reflection_is_a_status():
    inside = dataclasses.replace(plate(), front_medium=GLASS)
    elements = (dataclasses.replace(inside.elements[0], medium=pl.optics.AIR), *inside.elements[1:])
    rays = inside_out = dataclasses.replace(inside, elements=elements).trace(fan(np.radians([30.0, 60.0])))
    assert rays.status.tolist() == [0, int(pl.RayStatus.TOTAL_REFLECTION)] and inside_out.weight[1] == 0.0


def test_zemax_files_refuse_coatings(tmp_path):
    with pytest.raises(pl.errors.PrescriptionError, match=r"element 0 has a coating, which cannot be written as .zmx"):
        pl.save_lens(LENSES["double Gauss"], tmp_path / "lens.zmx")


def test_zemax_files_warn_of_absorption(tmp_path):
    dark = pl.optics.AbsorbingGlass(GLASS, [400.0, 700.0], [0.5, 0.5], thickness=10.0)
    with pytest.warns(pl.errors.FileWarning, match=r"the absorption of the medium behind element 0 is left out"):
        pl.save_lens(plate(medium=dark, coating=None), tmp_path / "lens.zmx")
