"""Third-order aberrations: closed forms, stop shift, stigmatic surfaces, and the limit of exact rays."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.tracing import traced_part

EPS = np.finfo(float).eps
seidel_sums = pl.aberrations.seidel_sums
LENS = pl.load_lens("double-gauss-100mm-f2")


def thin_lens(focal_length: float, index: float, shape: float, stop: float, thickness: float = 0.0) -> pl.LensStack:
    """A thin lens with its iris at the lens; shape (c1 + c2) / (c1 - c2)."""
    difference = 1.0 / (focal_length * (index - 1))
    c1, c2 = 0.5 * difference * (shape + 1), 0.5 * difference * (shape - 1)
    r1, r2 = (1 / c if c else math.inf for c in (c1, c2))
    medium = pl.ConstantMedium(index)
    size = 0.2 * focal_length
    surfaces = [pl.Surface(r1, thickness, medium, semi_diameter=min(size, abs(r1)))]
    surfaces += [pl.Surface(r2, semi_diameter=min(size, abs(r2)))]
    return pl.LensStack([pl.CircularStop(stop), *surfaces])


@settings(max_examples=50, deadline=None)
@given(
    index=st.floats(1.3, 2.5),
    shape=st.floats(-3, 3),
    far=st.one_of(st.just(-math.inf), st.floats(-1e4, -150.0)),
    field=st.floats(0.01, 0.3),
)
def test_thin_lens(index, shape, far, field):
    # Welford, section 9.4, with the power K, height h, shape X, and conjugates Y: -1 for an object at infinity.
    f, h = 100.0, 5.0
    lens = thin_lens(f, index, shape, h)
    k, y_conjugate = 1 / f, -1.0
    if math.isfinite(far):
        u, u_behind = h / -far, h / -far - h * k
        y_conjugate = -(u_behind + u) / (u_behind - u)
    size = field if math.isinf(far) else field * -far
    sums = seidel_sums(lens, field=size, z_object=far)
    invariant = h * math.tan(field) if math.isinf(far) else h * size / -far
    n, x, y = index, shape, y_conjugate
    bracket = (n / (n - 1)) ** 2 + (n + 2) / (n * (n - 1) ** 2) * (x + 2 * (n**2 - 1) / (n + 2) * y) ** 2
    bracket -= n / (n + 2) * y**2
    spherical = h**4 * k**3 / 4 * bracket
    coma = -(h**2) * k**2 * invariant / 2 * ((n + 1) / (n * (n - 1)) * x + (2 * n + 1) / n * y)
    expected = np.array([spherical, coma, invariant**2 * k, invariant**2 * k / n, 0.0])
    # Differences of terms some (n / (n - 1))^2 (1 + x^2) times as large as the smallest sum.
    scale = np.array([h**4 * k**3, h**2 * k**2 * invariant, invariant**2 * k, invariant**2 * k, invariant**3 / h**2])
    # The sign of coma and distortion goes with that of the field, and Welford's X counts curvatures as here.
    found = sums.total * [1, np.sign(sums.total[1] * coma) or 1, 1, 1, 1]
    assert np.all(np.abs(found - expected) <= 1e-9 * scale * 100 * (1 + x * x) / (n - 1) ** 2)


def test_coma_of_a_thin_lens_changes_sign_at_its_aplanatic_shape():
    # (n + 1) / (n (n - 1)) X + (2 n + 1) / n Y = 0 has Y = 1 for an object at infinity here: X from the formula.
    n = 1.5
    x0 = (2 * n + 1) * (n - 1) / (n + 1)
    signs = [seidel_sums(thin_lens(100.0, n, x, 5.0), field=0.1).total[1] for x in (x0 - 0.2, x0 + 0.2, -x0)]
    at = seidel_sums(thin_lens(100.0, n, x0, 5.0), field=0.1).total[1]
    assert signs[0] * signs[1] < 0
    assert abs(at) < 1e-12 * abs(signs[2])


@pytest.mark.parametrize("name", pl.lens_names())
def test_petzval_sum_is_the_closed_form(name):
    lens = pl.load_lens(name)
    sums = seidel_sums(lens, field=0.1)
    marginal, chief = pl.paraxial.marginal_ray(lens), pl.paraxial.chief_ray(lens, 0.1)
    h = pl.paraxial.lagrange_invariant(marginal, chief)
    n = lens.indices()
    curvature = np.array([getattr(e, "curvature", 0.0) for e in lens.elements])
    assert sums.total[3] == pytest.approx(-h * h * np.sum(curvature * (1 / n[1:] - 1 / n[:-1])), rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(shift=st.floats(0.5, 8.0), field=st.floats(0.01, 0.4))
def test_stop_shift(shift, field):
    # With the iris elsewhere and the same axial beam, chief = chief + E marginal: S_I stays, S_II* = S_II + E S_I,
    # S_III* = S_III + 2 E S_II + E^2 S_I, S_IV stays, S_V* = S_V + E (3 S_III + S_IV) + 3 E^2 S_II + E^3 S_I.
    before = seidel_sums(LENS, field=field).total
    i = LENS.iris_index
    elements = list(LENS.elements)
    elements[i - 1] = dataclasses.replace(elements[i - 1], thickness=elements[i - 1].thickness - shift)
    marginal = pl.paraxial.marginal_ray(LENS)
    height = marginal.height[i] - shift * marginal.angle[i]
    elements[i] = pl.CircularStop(abs(float(height)), elements[i].thickness + shift)
    moved = pl.LensStack(elements)
    old, new = pl.paraxial.chief_ray(LENS, field), pl.paraxial.chief_ray(moved, field)
    e = (new.height[0] - old.height[0]) / marginal.height[0]
    s1, s2, s3, s4, s5 = before
    expected = [
        s1,
        s2 + e * s1,
        s3 + 2 * e * s2 + e * e * s1,
        s4,
        s5 + e * (3 * s3 + s4) + 3 * e * e * s2 + e**3 * s1,
    ]
    table = np.abs(seidel_sums(moved, field=field).table).sum(axis=0)
    assert np.all(np.abs(seidel_sums(moved, field=field).total - expected) <= 1e-11 * (table + table.max() * abs(e)))


@settings(max_examples=30, deadline=None)
@given(index=st.floats(1.2, 3.0), radius=st.floats(5.0, 500.0), stop=st.floats(0.01, 0.2))
def test_surfaces_of_descartes_have_no_spherical_aberration(index, radius, stop):
    # k = -1 / n^2 for light from infinity; the same surface as a sphere with an r^4 term is as good in third order.
    medium = pl.ConstantMedium(index)
    fourth = (-1 / index**2) / (8 * radius**3)
    for shape in ({"conic": -1 / index**2}, {"aspheric": (0.0, fourth)}):
        first = pl.Surface(radius, 0.1, medium, semi_diameter=0.5 * radius, **shape)
        lens = pl.LensStack([pl.CircularStop(stop * radius), first, pl.Surface(math.inf, semi_diameter=radius)])
        sphere = dataclasses.replace(first, conic=0.0, aspheric=())
        plain = seidel_sums(pl.LensStack([lens.elements[0], sphere, lens.elements[2]]), field=0.1)
        assert abs(seidel_sums(lens, field=0.1).spherical[1]) <= 64 * EPS * abs(plain.spherical[1])


def test_a_curvature_is_a_curvature_however_it_is_written():
    # c = 1 / R, or a plane with the r^2 term 1 / (2 R): a paraboloid, so a sphere with k = -1.
    def lens(**shape):
        first = pl.Surface(shape.pop("radius"), 4.0, pl.ConstantMedium(1.6), semi_diameter=8.0, **shape)
        return pl.LensStack([pl.CircularStop(4.0, 2.0), first, pl.Surface(-70.0, semi_diameter=8.0)])

    a = seidel_sums(lens(radius=50.0, conic=-1.0), field=0.2, z_object=-300.0)
    b = seidel_sums(lens(radius=math.inf, aspheric=(0.01,)), field=0.2, z_object=-300.0)
    assert a.table == pytest.approx(b.table, rel=1e-12, abs=1e-15)
    assert pl.paraxial.cardinal_points(lens(radius=50.0)).efl == pytest.approx(
        pl.paraxial.cardinal_points(lens(radius=math.inf, aspheric=(0.01,))).efl, rel=1e-14
    )


ASPHERIC = dataclasses.replace(
    LENS,
    elements=[
        dataclasses.replace(LENS.elements[0], conic=-0.6, aspheric=(1e-4, 2e-7)),
        *LENS.elements[1:10],
        dataclasses.replace(LENS.elements[10], conic=1.5, aspheric=(0.0, -4e-7)),
    ],
)


@pytest.mark.parametrize("lens", [LENS, ASPHERIC, pl.load_lens("singlet-100mm-f4")], ids=["spheres", "aspheres", "one"])
def test_exact_rays_tend_to_the_sums(lens):
    # Transverse aberrations are third order in aperture and field; what is left is fifth order: halving both divides
    # the relative difference by 4.
    plane = pl.paraxial.cardinal_points(lens).rear_focus
    efl = pl.paraxial.cardinal_points(lens).efl
    spherical, distortion = [], []
    for scale in (0.1, 0.05):
        small = lens.with_stop(pl.CircularStop(lens.stop.semi_diameter * scale))
        angle = math.radians(8) * scale
        sums = seidel_sums(small, field=angle)
        height = float(pl.paraxial.marginal_ray(small).height[0])
        # The exact ray at that height may pass beside the iris's rim.
        rays = pl.RayBundle([[0, height, lens.vertices[0] - 1]], [[0, 0, 1.0]])
        out = traced_part(small, rays, 0, len(lens.elements) - 1, clipping=False)
        spherical.append(out.at_z(plane)[0, 1] / sums.transverse[0] - 1)
        # The real chief ray; an object above the axis has its image below.
        chief = pl.aiming.chief_ray(small, field=(0.0, angle))
        image = lens.trace(chief).at_z(plane)[0, 1]
        distortion.append((image + efl * math.tan(angle)) / sums.transverse[4] - 1)
    for remainder in (spherical, distortion):
        assert abs(remainder[1]) < 0.02
        assert remainder[0] / remainder[1] == pytest.approx(4.0, abs=0.5)


def test_achromat_and_singlet_have_the_right_colour():
    # A thin singlet: f_C - f_F = f / V; of a thick one the back focus moves by nearly that.
    singlet = pl.load_lens("singlet-100mm-f4")
    shift = pl.aberrations.chromatic_shift(singlet)
    glass = next(e.medium for e in singlet.elements if isinstance(e, pl.Surface))
    f, c, d = (glass.index(w) for w in (486.1327, 656.2725, 587.5618))
    assert shift.axial == pytest.approx(pl.paraxial.cardinal_points(singlet).efl * (f - c) / (d - 1), rel=0.05)
    # The achromat bends blue and red alike, green and yellow a little more: its focus is nearest in between.
    achromat = pl.load_lens("achromat-100mm-f4.4")
    lines = np.arange(440.0, 701.0, 5.0)
    focus = pl.aberrations.chromatic_shift(achromat, wavelengths=lines, reference=540.0).focus
    nearest = lines[focus.argmin()]
    assert 480 < nearest < 600
    assert abs(pl.aberrations.chromatic_shift(achromat).axial) < 0.1 * shift.axial
    # Secondary spectrum: some f / 2000.
    assert focus[0] - focus.min() < 100 / 400


def test_sums_of_colour_are_the_shifts_of_the_focus():
    sums = pl.aberrations.colour_sums(LENS, field=0.1)
    aperture = seidel_sums(LENS, field=0.1).aperture
    shift = pl.aberrations.chromatic_shift(LENS, field=0.1)
    # First order in dn: the second differs by dn / n times it, some 2 % of single surfaces, which nearly cancel here.
    assert sums[:, 0].sum() / aperture**2 == pytest.approx(shift.axial, rel=0.1)
    near = pl.aberrations.colour_sums(LENS, field=0.1, wavelengths=(587.0, 587.5618, 588.0))
    narrow = pl.aberrations.chromatic_shift(LENS, field=0.1, wavelengths=(587.0, 587.5618, 588.0))
    assert near[:, 0].sum() / aperture**2 == pytest.approx(narrow.axial, rel=1e-3)
    # C_II is n'u' times the shift of the height, falling chief rays counted as they are.
    assert abs(near[:, 1].sum() / aperture) == pytest.approx(abs(narrow.lateral), rel=2e-3)


def test_marginal_and_chief_rays():
    marginal, chief = pl.paraxial.marginal_ray(LENS, -404.0), pl.paraxial.chief_ray(LENS, 10.0, -404.0)
    n = marginal.index
    # The invariant is the same in every gap; refraction and transfer keep it to a few eps of its terms.
    h = n[1:] * (marginal.angle[1:] * chief.height - chief.angle[1:] * marginal.height)
    assert h == pytest.approx(pl.paraxial.lagrange_invariant(marginal, chief), rel=1e-12)
    image = pl.paraxial.image_position(LENS, -404.0) - LENS.vertices[-1]
    assert marginal.height[-1] + image * marginal.angle[-1] == pytest.approx(0.0, abs=1e-12)
    scale = pl.paraxial.magnification(LENS, -404.0)
    assert chief.height[-1] + image * chief.angle[-1] == pytest.approx(10.0 * scale, rel=1e-12)
    before, behind = pl.paraxial.numerical_apertures(LENS, -404.0)
    assert before / behind == pytest.approx(abs(scale), rel=1e-12)


@given(scale=st.floats(-20, 20).filter(lambda m: abs(m) > 1e-3))
def test_conjugates_have_their_magnification(scale):
    z_object, z_image = pl.paraxial.conjugates(LENS, scale)
    assert pl.paraxial.magnification(LENS, z_object) == pytest.approx(scale, rel=1e-9)
    assert pl.paraxial.image_position(LENS, z_object) == pytest.approx(z_image, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pl.paraxial.conjugates(LENS, 0.0), "magnification is 0"),
        (lambda: pl.paraxial.marginal_ray(LENS, 5.0), "must lie in front of the first element"),
        (lambda: pl.paraxial.chief_ray(LENS, 1.6), "less than pi / 2"),
        (lambda: seidel_sums(LENS, field=math.nan), "field is nan"),
        (lambda: pl.aberrations.chromatic_shift(LENS, reference=500.0), "one of the wavelengths"),
        (lambda: pl.aberrations.colour_sums(LENS, field=0.1, wavelengths=(500.0,)), "must be three"),
    ],
)
def test_impossible_questions_are_refused(call, message):
    with pytest.raises(pl.InvalidValueError, match=message):
        call()
