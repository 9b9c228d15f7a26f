"""Seidel sums: the limit of exact rays, laws of scale, stop shift, reversal and symmetry.

Sums of surfaces are products of some ten rounded numbers; where they cancel in the lens, tolerances count from the
largest. What a tolerance has beyond that is said where it stands.
"""

import dataclasses
import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.aberrations import SeidelSums, seidel_sums
from plenoptic.aiming import aimed_rays
from plenoptic.optics.lens.elements import opened
from plenoptic.optics.lens.trace import traced_part

GAUSS = pl.load_lens("double-gauss-100mm-f2")
GLASS = pl.ConstantMedium(1.6)
WATER = pl.ConstantMedium(1.333)
ASPHERIC = pl.LensStack(
    [pl.Surface(45.0, 6.0, GLASS, semi_diameter=14.0, conic=-0.7, aspheric=(1e-4, 2e-6, -1e-9)),
     pl.Surface(-200.0, 9.0, semi_diameter=14.0, conic=2.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0), pl.Surface(-50.0, semi_diameter=14.0, conic=-3.0)],
    name="aspheric",
)  # fmt: skip
IN_WATER = pl.LensStack(
    [pl.Surface(60.0, 6.0, pl.ConstantMedium(1.9), semi_diameter=14.0, conic=-0.7),
     pl.Surface(-300.0, 9.0, WATER, semi_diameter=14.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0), pl.Surface(-50.0, 0.0, WATER, semi_diameter=14.0)],
    name="in water", ambient=WATER,
)  # fmt: skip
CASSEGRAIN = pl.LensStack(
    [pl.CircularStop(50.0), pl.Surface(-400.0, 140.0, pl.optics.MIRROR, semi_diameter=52.0, conic=-1.0),
     pl.Surface(180.0, 0.0, pl.optics.MIRROR, semi_diameter=20.0, conic=-4.0)], name="Cassegrain",
)  # fmt: skip
MANGIN = pl.LensStack(
    [pl.CircularStop(10.0, thickness=5.0), pl.Surface(-120.0, 8.0, pl.ConstantMedium(1.5), semi_diameter=14.0),
     pl.Surface(-180.0, 8.0, pl.optics.MIRROR, semi_diameter=14.0, aspheric=(0.0, 1e-7)),
     pl.Surface(120.0, semi_diameter=14.0)], name="Mangin",
)  # fmt: skip
BUNDLED = [*map(pl.load_lens, pl.lens_names())]
# Without discs in the middle of stops, which shade rays near the axis.
LENSES = [dataclasses.replace(lens, elements=opened(lens.elements)) for lens in BUNDLED]
LENSES += [CASSEGRAIN, MANGIN, ASPHERIC, IN_WATER]


def close(found, expected, table, tolerance=1e-12) -> bool:
    """Whether five sums agree, within what the largest contributions of their surfaces allow."""
    return bool(np.all(np.abs(found - expected) <= tolerance * np.abs(table).max(axis=0)))


PUPIL = np.array([[0.0, 1.0], [0.0, -0.7], [1.0, 0.0], [0.6, 0.6], [-0.5, 0.3], [0.0, 0.0]])


def miss_and_third_order(lens: pl.LensStack, z_object: float, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Where exact rays miss the Gaussian image, and what the sums say of it, (n, 2) each, in mm."""
    small = lens.with_stop(pl.CircularStop(lens.stop.semi_diameter * scale))
    field = scale * (0.3 if math.isinf(z_object) else 90.0)
    sums = seidel_sums(small, field=field, z_object=z_object)
    (w040, w131, w222, w220, w311), (x, y) = sums.wavefront, PUPIL.T
    square = x * x + y * y
    slope_x = 4 * w040 * square * x + 2 * w131 * x * y + 2 * w220 * x
    slope_y = 4 * w040 * square * y + w131 * (square + 2 * y * y) + 2 * (w222 + w220) * y + w311
    rays = aimed_rays(small, field=(0.0, field), z_object=z_object, pupil=PUPIL)
    out = traced_part(small, rays, 0, len(small.elements) - 1, clipping=False)
    far = math.isinf(z_object)
    efl, m = pl.paraxial.cardinal_points(small).efl, pl.paraxial.magnification(small, z_object)
    ideal = -efl * math.tan(field) if far else m * field
    found = out.at_z(pl.paraxial.image_position(small, z_object))[:, :2] - [0.0, ideal]
    return found, np.column_stack([slope_x, slope_y]) / sums.aperture


def test_exact_rays_tend_to_the_third_order():
    for lens, z_object in itertools.product(LENSES, (-math.inf, -300.0)):
        if lens.name[:7] in ("fisheye", "mirror-"):
            # The sixth element of the fisheye meets objects at 300 mm; what its mirror lens leaves is of the seventh
            # order here.
            continue
        found = [miss_and_third_order(lens, z_object, scale) for scale in (0.1, 0.05)]
        remainders = [np.abs(exact - third).max() for exact, third in found]
        # All signs and factors are right if what is left is of the fifth order: half the aperture and field, a 32nd.
        # The seventh order disturbs that by some (0.1)^2 times coefficients of about 10.
        assert remainders[0] / remainders[1] == pytest.approx(32.0, rel=0.1), (lens.name, z_object)
        assert remainders[1] < 0.1 * np.abs(found[1][1]).max(), (lens.name, z_object)


def test_transverse_aberrations_are_those_of_the_rim():
    exact, third = miss_and_third_order(ASPHERIC, -300.0, 0.05)
    small = ASPHERIC.with_stop(pl.CircularStop(ASPHERIC.stop.semi_diameter * 0.05))
    spherical, coma, tangential, sagittal, distortion = seidel_sums(small, field=4.5, z_object=-300.0).transverse
    # The first ray goes through the top of the iris, the third through its side, the last through its centre.
    assert spherical + coma + tangential + distortion == pytest.approx(third[0, 1], rel=1e-13)
    assert spherical + sagittal == pytest.approx(third[2, 0], rel=1e-13)
    assert distortion == pytest.approx(third[5, 1], rel=1e-13)
    assert exact == pytest.approx(third, rel=0.05, abs=1e-6)


@settings(max_examples=30)
@given(shift=st.floats(-6.0, 8.0), field=st.floats(0.01, 0.4), far=st.booleans())
def test_stop_shift(shift, field, far):
    """Welford, chapter 8: with chief' = chief + E marginal for a stop that passes the same axial beam elsewhere."""
    z_object = -math.inf if far else -700.0
    size = field if far else 700.0 * field
    i = GAUSS.iris_index
    marginal = pl.paraxial.marginal_ray(GAUSS, z_object)
    elements = list(GAUSS.elements)
    elements[i - 1] = dataclasses.replace(elements[i - 1], thickness=elements[i - 1].thickness - shift)
    elements[i] = pl.CircularStop(float(marginal.height[i] - shift * marginal.angle[i]), elements[i].thickness + shift)
    moved, moved_object = pl.LensStack(elements), z_object + shift
    old = pl.paraxial.chief_ray(GAUSS, size, z_object)
    new = pl.paraxial.chief_ray(moved, size, moved_object)
    e = (new.height[0] - old.height[0]) / marginal.height[0]
    before = seidel_sums(GAUSS, field=size, z_object=z_object).table
    s1, s2, s3, s4, s5 = before.T
    expected = np.column_stack(
        [s1, s2 + e * s1, s3 + 2 * e * s2 + e * e * s1, s4, s5 + e * (3 * s3 + s4) + 3 * e * e * s2 + e**3 * s1]
    )
    # E is known to the rounding of heights of some 10 mm: its powers are of the order of 1.
    parts = [np.abs(s).max() for s in before.T]
    scale = max(parts) * max(1.0, abs(e)) ** 3
    assert np.all(np.abs(seidel_sums(moved, field=size, z_object=moved_object).table - expected) <= 1e-12 * scale)


def test_the_way_back_has_the_same_aberrations():
    z_object, field = -300.0, 20.0
    there = seidel_sums(ASPHERIC, field=field, z_object=z_object)
    gaps = [*(e.thickness for e in ASPHERIC.elements[-2::-1]), 0.0]
    backwards: list[pl.Surface | pl.CircularStop] = []
    for i, (old, gap) in enumerate(zip(ASPHERIC.elements[::-1], gaps, strict=True)):
        new = dataclasses.replace(old, thickness=gap)
        if isinstance(new, pl.Surface):
            signs = {"radius": -new.radius, "aspheric": [-a for a in new.aspheric]}
            new = dataclasses.replace(new, medium=ASPHERIC.gap_media[len(gaps) - 1 - i], **signs)
        backwards.append(new)
    image = pl.paraxial.image_position(ASPHERIC, z_object)
    size = field * pl.paraxial.magnification(ASPHERIC, z_object)
    back = seidel_sums(pl.LensStack(backwards), field=size, z_object=-image)
    assert close(back.table[::-1], there.table, there.table)


def test_the_petzval_sum_and_distortion_as_the_other_sums_have_it():
    """Welford's first form: S_V = (S_III + S_IV) Abar / A of each spherical surface."""
    for lens in LENSES:
        sums, below = (seidel_sums(lens, field=field) for field in (0.1, -0.1))
        invariant = pl.paraxial.lagrange_invariant(pl.paraxial.marginal_ray(lens), pl.paraxial.chief_ray(lens, 0.1))
        curvature = np.array([getattr(e, "vertex_curvature", 0.0) for e in lens.elements])
        # Behind a mirror the index counts as negative.
        mirrors = [getattr(e, "medium", None) == pl.optics.MIRROR for e in lens.elements]
        step = np.where(mirrors, -1, 1) / lens.indices()[1:] - 1 / lens.indices()[:-1]
        assert sums.petzval == pytest.approx(-(invariant**2) * curvature * step, rel=1e-13), lens.name
        assert sums.total[3] == pytest.approx(sums.petzval.sum(), rel=1e-12), lens.name
        # Those of odd order change signs with the field.
        assert np.array_equal(sums.table * [1, -1, 1, 1, -1], below.table), lens.name
        elements = list(lens.elements)
        for i, e in enumerate(elements):
            if isinstance(e, pl.Surface):
                size = min(e.semi_diameter, abs(e.radius))
                elements[i] = dataclasses.replace(e, conic=0.0, aspheric=(), semi_diameter=size)
        sums = seidel_sums(dataclasses.replace(lens, elements=elements), field=0.2)
        bent = np.abs(sums.coma) > 1e-6 * np.abs(sums.coma).max()
        expected = ((sums.astigmatism + sums.petzval) * sums.coma)[bent] / sums.spherical[bent]
        assert sums.distortion[bent] == pytest.approx(expected, rel=1e-9, abs=1e-13), lens.name


def test_sums_are_values_that_show_a_table():
    sums = seidel_sums(GAUSS, field=0.2)
    assert pickle.loads(pickle.dumps(sums)) == sums == seidel_sums(GAUSS, field=0.2)
    assert not sums.spherical[GAUSS.iris_index]
    head, names, *rows, total = repr(sums).splitlines()
    assert head == "SeidelSums at 587.6 nm, mm"
    assert names.split() == ["element", "spherical", "coma", "astigmatism", "petzval", "distortion"]
    surfaces = [i for i, e in enumerate(GAUSS.elements) if isinstance(e, pl.Surface)]
    assert [int(row.split()[0]) for row in rows] == surfaces
    shown = np.array([list(map(float, row.split()[1:])) for row in [*rows, total]])
    # Five significant digits.
    assert shown == pytest.approx(np.vstack([sums.table[surfaces], sums.total]), rel=6e-5)
    assert len({len(line) for line in (names, *rows, total)}) == 1


def test_impossible_questions_are_refused():
    n = np.zeros(3)
    for call, message in (
        (lambda: seidel_sums(GAUSS, field=math.nan), "field is nan"),
        (lambda: seidel_sums(GAUSS, field=1.6), "less than pi / 2"),
        (lambda: seidel_sums(GAUSS, field=0.1, z_object=5.0), "must lie in front of the first element"),
        (lambda: seidel_sums(GAUSS, field=0.1, z_object=math.nan), "z_object is nan"),
        (lambda: seidel_sums("lens", field=0.1), "lens is a str; give a LensStack"),
        (lambda: seidel_sums(GAUSS, field=0.1, wavelength=100.0), "100"),
        (lambda: SeidelSums(n, np.zeros(2), n, n, n, -0.1, 587.6), "coma has shape"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()
