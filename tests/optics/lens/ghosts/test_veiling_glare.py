"""Veiling glare beside paths that reflect by chance at all surfaces, and its laws."""

import math

import mirror_trace
import numpy as np
import pytest

import plenoptic as pl

TRIPLET = pl.load_lens("cooke-triplet-50mm-f5")


def by_chance(lens, patch, *, sensor=None, most=2, n=400_000, seed=5):
    """Veiling glare index at the centre of the paraxial image of infinity, and its standard error."""
    random, z = np.random.default_rng(seed), pl.paraxial.cardinal_points(lens).rear_focus
    last = lens.elements[-1]
    # A disc in the plane of the last rim and vertex is seen from the sensor under these cosines.
    side = 1.05 * last.semi_diameter / math.hypot(z - lens.vertices[-1] - 3.0, last.semi_diameter)
    across = random.uniform(-side, side, (n, 2))
    direction = np.column_stack([across, -np.sqrt(1.0 - np.square(across).sum(axis=1))])
    origin = np.tile([0.0, 0.0, z], (n, 1))
    mirror = None if sensor is None else (z, sensor, np.array([0.0, 0.0, 1.0]))
    _, d, light, turns = mirror_trace.chance(lens, origin, direction, random, sensor=mirror, most=most)
    black = np.where(-d[:, 2] >= math.cos(patch), 0.0, light)
    index = black.sum() / light.sum()
    error = math.sqrt(np.square(black - index * light).sum()) / light.sum()
    return index, error, turns, light


@pytest.mark.parametrize("patch, sensor", [(0.02, None), (0.1, 0.3)])
def test_the_index_is_that_of_paths_that_reflect_by_chance(patch, sensor):
    expected, error, *_ = by_chance(TRIPLET, patch, sensor=sensor)
    glare = pl.aberrations.veiling_glare(TRIPLET, patch, sensor=sensor)
    assert error < 0.05 * expected
    assert abs(glare.index - expected) < 4 * math.hypot(error, glare.standard_error)


def test_four_reflections_add_little_to_two():
    """They bound the light that the table and the index leave out: by the factor of two more reflections."""
    *_, turns, light = by_chance(TRIPLET, 0.02, sensor=0.3, most=4)
    two, four = light[turns == 2].sum(), light[turns == 4].sum()
    assert 0 < four < 0.05 * two


def test_a_coating_weakens_glare_by_its_reflectance():
    """With constant reflectances, pairs are in proportion to the square of it, sums over paths apart."""
    one, ten = (
        pl.aberrations.veiling_glare(pl.optics.coated(TRIPLET, pl.optics.Reflectance(r)), 0.02) for r in (0.001, 0.01)
    )
    assert ten.index / one.index == pytest.approx(100.0, rel=0.03)
    bare = pl.aberrations.veiling_glare(TRIPLET, 0.02)
    layer = pl.aberrations.veiling_glare(pl.optics.coated(TRIPLET, pl.optics.SingleLayer()), 0.02)
    assert bare.index > 5 * layer.index > 0


def test_a_plate_has_no_glare_on_a_patch_that_fills_its_cone_and_only_glare_without():
    """Its faces are parallel: light of a ghost leaves in the direction of the image light."""
    plate = pl.LensStack(
        [
            pl.Surface(math.inf, thickness=4.0, medium=pl.ConstantMedium(1.5), semi_diameter=50.0),
            pl.Surface(math.inf, thickness=3.0, semi_diameter=50.0),
            pl.CircularStop(3.0),
        ]
    )
    edge = math.atan(3.0 / 30.0)
    assert pl.aberrations.veiling_glare(plate, 1.01 * edge, z_image=30.0).index == 0.0
    # Image light beside the patch counts: by the projected solid angle of each.
    half = pl.aberrations.veiling_glare(plate, 0.5 * edge, z_image=30.0)
    expected = 1.0 - (math.sin(0.5 * edge) / math.sin(edge)) ** 2
    assert half.index == pytest.approx(expected, abs=4 * half.standard_error + 1e-4)
    assert pl.aberrations.veiling_glare(plate, 1e-9, z_image=30.0).index == pytest.approx(1.0, abs=1e-9)


def test_finite_objects_have_patches_in_mm():
    """A patch of a far plane is one of angles."""
    far = pl.aberrations.veiling_glare(TRIPLET, 0.05)
    near = pl.aberrations.veiling_glare(
        TRIPLET, 1e6 * math.tan(0.05), z_object=-1e6, z_image=pl.paraxial.image_position(TRIPLET, -math.inf)
    )
    assert near.index == pytest.approx(far.index, rel=0.01)


def test_stated_errors_hold_over_24_seeds():
    reference = pl.aberrations.veiling_glare(TRIPLET, 0.03, field=(0.0, 0.1), rays=1 << 16, seed=1000)
    runs = [pl.aberrations.veiling_glare(TRIPLET, 0.03, field=(0.0, 0.1), rays=512, seed=seed) for seed in range(24)]
    z = np.array(
        [(run.index - reference.index) / math.hypot(run.standard_error, reference.standard_error) for run in runs]
    )
    # Student's t of 31 degrees of freedom; bounds of the mean of squares are chi-square's at 1e-3 for 24.
    assert np.abs(z).max() < 4.2
    assert abs(z.mean()) < 3.3 / math.sqrt(24)
    assert 0.33 < np.mean(z * z) < 2.2


def test_bad_input_is_answered_by_a_sentence():
    with pytest.raises(pl.errors.InvalidValueError, match="patch is 0; it must be above 0"):
        pl.aberrations.veiling_glare(TRIPLET, 0.0)
    with pytest.raises(pl.errors.InvalidValueError, match=r"no chief ray of \(0, 1\.2\) rad arrives"):
        pl.aberrations.veiling_glare(TRIPLET, 0.02, field=(0.0, 1.2))
    with pytest.raises(pl.errors.InvalidValueError, match="patch is 2 rad; for an object at infinity it must be below"):
        pl.aberrations.veiling_glare(TRIPLET, 2.0)
