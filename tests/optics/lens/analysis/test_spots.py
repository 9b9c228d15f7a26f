"""Spot diagrams and ray fans: perfect lenses, third-order theory, and counting rays without any aiming."""

import math

import numpy as np
import pytest

from plenoptic import CircularStop, ConstantMedium, LensModel, LensStack, PolygonStop, RayBundle, Surface, load_lens
from plenoptic.aberrations import ray_fan, spot_diagram
from plenoptic.errors import InvalidValueError
from plenoptic.optics import MaskStop
from plenoptic.optics.lens.analysis.best_focus import working_f_number
from plenoptic.optics.lens.analysis.spot_diagram import AIRY
from plenoptic.optics.lens.gaussian import paraxial
from plenoptic.optics.lens.pupil.beam import REPLICATES
from plenoptic.optics.lens.trace import trace_part

GAUSS = load_lens("double-gauss-100mm-f2")
PERFECT = [GAUSS.with_model(LensModel.PARAXIAL), GAUSS.with_model(LensModel.THIN)]


def plano_convex(stop: float) -> LensStack:
    """Focal length 100, spherical aberration, iris in front."""
    front = Surface(50.0, 4.0, ConstantMedium(1.5), semi_diameter=20.0)
    return LensStack([CircularStop(stop, thickness=1.0), front, Surface(math.inf, semi_diameter=20.0)])


def test_a_perfect_lens_has_points_for_spots_and_flat_fans():
    efl = paraxial.cardinal_points(GAUSS).efl
    for lens in PERFECT:
        for z, field in ((-math.inf, (0.0, 0.1)), (-404.0, (10.0, -30.0)), (-1e6, (0.0, 0.0))):
            spot = spot_diagram(lens, field=field, z_object=z, rays=1024)
            # Some 20 roundings of lengths of 130 mm; an origin 1e6 mm away has the digits of that, and slopes of 1e-4
            # of it.
            assert spot.geometric_radius < 20 * 2.0**-52 * (1e5 if z == -1e6 else 130.0), (lens.model, z)
            assert spot.fraction == pytest.approx(1.0, rel=1e-14), (lens.model, z)
            assert spot.centroid == pytest.approx(spot.chief[0], abs=1e-10), (lens.model, z)
        assert spot_diagram(lens, field=0.2).chief[0] == pytest.approx([0.0, -efl * math.tan(0.2)], abs=1e-12)
        fan = ray_fan(lens, field=(3.0, -20.0), z_object=-404.0, points=9)
        assert np.abs(fan.tangential).max() < 1e-12 and np.abs(fan.sagittal).max() < 1e-12


def wide_beam(angle: float, half: float, n: int) -> RayBundle:
    """An evenly filled beam in which only the lens chooses."""
    along = np.array([0.0, -math.sin(angle), math.cos(angle)])
    x, y = np.random.default_rng(5).uniform(-half, half, (n, 2)).T
    origin = np.column_stack([x, y * along[2], -y * along[1]]) - 100.0 * along
    return RayBundle(origin, np.broadcast_to(along, (n, 3)))


def behind_iris(lens: LensStack, rays: RayBundle) -> RayBundle:
    """Rays of which those before the iris lose none."""
    iris = lens.iris_index
    return trace_part(lens, trace_part(lens, rays, 0, iris - 1, clipping=False), iris, iris)


def test_against_rays_that_are_not_aimed():
    """A wide, evenly filled beam in which only the lens chooses: the same spot, and the same vignetting."""
    n, batches = 1 << 18, 16
    for field, z in (((0.0, 0.2), -math.inf), ((20.0, 60.0), -404.0)):
        spot = spot_diagram(GAUSS, field=field, z_object=z, rays=1 << 15)
        if math.isinf(z):
            rays = wide_beam(0.2, 45.0, n)
        else:
            rng = np.random.default_rng(5)
            # Direction cosines around those of the axis point at the front: uniform, as a Lambertian patch sends them.
            l, m = rng.uniform(-0.14, 0.06, n), rng.uniform(-0.27, 0.0, n)
            rays = RayBundle(np.broadcast_to([*field, z], (n, 3)), np.column_stack([l, m, np.sqrt(1 - l * l - m * m)]))
        out = GAUSS.trace(rays)
        met = out.at_z(spot.z_image)[:, :2].reshape(batches, -1, 2)
        rms = [math.sqrt(float(np.nanvar(part, axis=0).sum())) for part in met]
        brute, error = np.mean(rms), np.std(rms, ddof=1) / math.sqrt(batches)
        assert error < 0.01 * brute
        # A batch of 2^14 wide rays has some 3000 that pass; the bias of its standard deviation is some 1 / 3000.
        allowed = 4 * math.hypot(error, spot.rms_radius_error) + 1e-3 * brute
        assert spot.rms_radius == pytest.approx(brute, abs=allowed), field
        reached = np.count_nonzero(behind_iris(GAUSS, rays).status == 0)
        fraction = np.count_nonzero(out.status == 0) / reached
        binomial = math.sqrt(fraction * (1 - fraction) / reached)
        assert 0.3 < fraction < 0.9
        assert spot.fraction == pytest.approx(fraction, abs=4 * math.hypot(binomial, spot.fraction_error)), field


def test_a_fisheye_is_filled_and_few_rays_are_wasted():
    for angle in (0.0, 0.7, 1.4):
        spot = spot_diagram(load_lens("fisheye-100mm-f8"), field=(0.0, angle), rays=4096)
        assert spot.fraction > 0.99, angle
        # The margin of 1 % and the polygon of 48 sides cost 2.2 % of the area, its ellipse-like shape little more.
        assert len(spot.x) > 0.95 * 4096, angle


def test_same_seed_same_bits_also_of_several_wavelengths():
    one, same, other = (spot_diagram(GAUSS, field=(0, 0.1), seed=seed) for seed in (3, 3, 4))
    assert one == same and hash(one) == hash(same) and one != other
    with pytest.raises(ValueError, match="read-only"):
        one.x[0] = 1.0
    lines = (486.1, 587.6, 656.3)
    spot = spot_diagram(GAUSS, field=(0, 0.1), wavelength=lines, rays=512)
    assert spot.wavelengths == lines and spot.chief.shape == (3, 2)
    assert spot.weight.sum() == pytest.approx(1.0, rel=1e-13)
    for i, line in enumerate(lines):
        alone = spot_diagram(GAUSS, field=(0, 0.1), wavelength=line, rays=512, z_image=spot.z_image)
        assert np.array_equal(spot.x[spot.colour == i], alone.x)
        assert np.array_equal(spot.chief[i], alone.chief[0])
    assert spot.airy_radius == pytest.approx(AIRY * 486.1e-6 * working_f_number(GAUSS, wavelength=486.1))
    assert spot.z_image == paraxial.image_position(GAUSS, -math.inf, 486.1)


def test_third_order_spherical_aberration_grows_with_the_cube_of_the_aperture():
    small, large = (spot_diagram(plano_convex(h), rays=1 << 13) for h in (1.0, 2.0))
    # The next order changes the ratio by some 4 times its share, (h / R)^2 = 1.6e-3 of the larger one.
    assert large.rms_radius / small.rms_radius == pytest.approx(8.0, rel=0.01)
    # a rho^3 over the disc has RMS a / 2; the largest of 8000 rays lies within 1e-3 of the rim, its cube 3e-3.
    assert small.rms_radius == pytest.approx(0.5 * small.geometric_radius, rel=0.005)
    fan = ray_fan(plano_convex(1.0))
    # The aberration of fifth order is (h / R)^2 = 4e-4 of that of third order, with a factor of a few.
    cube = fan.tangential[0, -1, 1] * fan.pupil**3
    assert fan.tangential[0, :, 1] == pytest.approx(cube, abs=3e-3 * abs(cube[-1]))
    # Undercorrected: the marginal ray crosses the axis before the paraxial focus.
    assert cube[-1] < 0


def test_a_hexagonal_stop():
    lens = PERFECT[0].with_stop(PolygonStop(blades=6, semi_diameter=10.0))
    spot = spot_diagram(lens, z_image=paraxial.cardinal_points(lens).rear_focus + 2.0, rays=1 << 14)
    # Polar moment of a hexagon with corners at R: 5/8 sqrt(3) R^4, its area 3/2 sqrt(3) R^2.
    expected = 2.0 / (2 * working_f_number(lens)) * math.sqrt(5 / 12)
    assert spot.rms_radius == pytest.approx(expected, abs=5 * spot.rms_radius_error)
    assert spot.fraction == pytest.approx(1.0, rel=1e-14) and len(spot.x) > 0.9 * (1 << 14)


def test_a_finite_object_is_lambertian():
    """Even in direction cosines: sin^2 of the angle with the axis is uniform up to that of the rim of a near stop."""
    lens = LensStack([CircularStop(20.0, thickness=1.0), Surface(math.inf, semi_diameter=50.0)], model=LensModel.NONE)
    spot = spot_diagram(lens, z_object=-30.0, z_image=0.0, rays=1 << 14)
    r2 = spot.x**2 + spot.y**2
    sin2 = np.sort(r2 / (r2 + 900.0))
    uniform = sin2 / (400.0 / 1300.0)
    # Kolmogorov's distance of n independent points is below 1.63 / sqrt(n) in 99 % of cases, and of even ones smaller.
    assert np.abs(uniform - (np.arange(len(sin2)) + 0.5) / len(sin2)).max() < 1.63 / math.sqrt(len(sin2))


def test_the_error_is_honest():
    """Out of focus the spot is the stop, and scatters by its error."""
    lens = PERFECT[0].with_stop(CircularStop(10.0))
    z = paraxial.cardinal_points(lens).rear_focus + 2.0
    radius = 2.0 / (2 * working_f_number(lens))
    large = spot_diagram(lens, z_image=z, rays=1 << 13)
    assert large.geometric_radius == pytest.approx(radius, rel=2e-3) and large.rms_radius_error < 1e-3 * radius
    spots = [spot_diagram(lens, z_image=z, rays=512, seed=seed) for seed in range(60)]
    scores = np.array([(spot.rms_radius - radius / math.sqrt(2)) / spot.rms_radius_error for spot in spots])
    # Student's t with 31 degrees of freedom has variance 31/29 and kurtosis 3.2: 60 squares have an error of 0.2.
    assert 0.4 < np.mean(scores**2) < 1.9 and np.abs(scores).max() < 4.5
    # Each stated variance is off by sqrt(2 / 31) = 0.25, known to a tenth of that; from 8 replicates, by 0.53.
    stated = np.array([spot.rms_radius_error**2 for spot in spots])
    assert stated.std(ddof=1) / stated.mean() < 0.35


@pytest.mark.filterwarnings("ignore:no light")
def test_no_light_is_no_error():
    for angle in (1.2, 2.0):
        spot = spot_diagram(GAUSS, field=(0.0, angle), wavelength=(500.0, 600.0))
        assert len(spot.x) == 0 and spot.fraction == 0.0
        numbers = spot.rms_radius, spot.geometric_radius, *spot.centroid, spot.rms_radius_error
        assert np.isnan(numbers).all(), angle
        assert repr(spot) == f"<SpotDiagram: 0 rays from (0, {angle:g}) rad on z = 102.473 mm, RMS radius nan um>"
    few = spot_diagram(GAUSS, rays=1)
    assert len(few.x) <= REPLICATES and few.rms_radius > 0


def test_what_is_no_spot():
    for change, message in (
        ({"field": (0.1,)}, "field is .0.1,.; it must be a pair"),
        ({"field": (0.0, math.nan)}, "field y is nan"),
        ({"z_object": math.inf}, "z_object is inf; it must be a position"),
        ({"z_object": 5.0}, "z_object is 5"),
        ({"z_image": math.inf}, "z_image is inf; it must be finite"),
        ({"rays": 0}, "rays is 0; it must be at least 1"),
        ({"seed": -1}, "seed is -1"),
        ({"wavelength": ()}, "wavelength is an empty sequence"),
        ({"wavelength": [500.0] * 300}, "wavelength has 300 entries"),
        ({"lens": "lens"}, "lens is a str; give a LensStack"),
        ({"lens": GAUSS.with_model(LensModel.NONE)}, r"LensModel\.NONE, which refracts no ray"),
        ({"lens": PERFECT[0], "z_object": paraxial.cardinal_points(GAUSS).front_focus}, "at infinity; give z_image"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            spot_diagram(**{"lens": GAUSS} | change)
    with pytest.raises(InvalidValueError, match="points is 1; it must be at least 2"):
        ray_fan(GAUSS, points=1)


def test_fans_have_the_symmetries_of_the_lens():
    on_axis, upright = ray_fan(GAUSS), ray_fan(GAUSS, field=(0.0, 0.12))
    turned = ray_fan(GAUSS, field=(0.12 * math.sin(0.7), 0.12 * math.cos(0.7)))
    (tangential,), (sagittal,), (x, y) = on_axis.tangential, on_axis.sagittal, upright.sagittal[0].T
    passes = np.isfinite(x) & np.isfinite(x[::-1])
    assert passes.sum() > 40 and np.nanmax(np.abs(y)) > 5e-4 and np.nanmax(np.abs(tangential[:, 0])) < 1e-12
    for found, expected in (
        (tangential[:, 1], -tangential[::-1, 1]),
        (tangential[:, 1], sagittal[:, 0]),
        (x[passes], -x[::-1][passes]),
        (y[passes], y[::-1][passes]),
        (turned.tangential, upright.tangential),
        (turned.sagittal, upright.sagittal),
    ):
        # Rays are aimed to 1e-9 mm of the iris, and aberrations change by at most 0.1 mm per mm there.
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_a_fan_lies_in_its_spot_and_shows_lateral_colour():
    colours = (587.6, 656.3)
    fan = ray_fan(GAUSS, field=(0.0, 0.05), wavelength=colours)
    spot = spot_diagram(GAUSS, field=0.05, wavelength=colours)  # a field may be y alone
    assert np.array_equal(fan.chief, spot.chief[0])
    assert fan.tangential[0, 32] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert fan.tangential[1, 32] == pytest.approx(spot.chief[1] - spot.chief[0], abs=1e-9)
    reach = np.nanmax(np.linalg.norm(fan.tangential - (spot.centroid - spot.chief[0]), axis=2))
    assert reach == pytest.approx(spot.geometric_radius, rel=0.1)
    # Rays through the rim of the iris pass.
    for stop in (1.0, 2.0, 5.0, 15.0):
        assert np.isfinite(ray_fan(GAUSS.with_stop(CircularStop(stop)), points=5).tangential).all(), stop


def masked(cells, size: float, lens: LensStack = GAUSS) -> LensStack:
    return lens.with_stop(MaskStop.of_cells(np.asarray(cells, dtype=float), size))


def test_out_of_focus_a_grey_spot_is_the_image_of_the_mask():
    """Columns of 1 and 1/2 and width a: the centroid of the light in the iris lies at x = -a / 6."""
    for lens in PERFECT:
        two = masked([[1.0, 0.5]], 10.0, lens)
        points = paraxial.cardinal_points(two)
        spot = spot_diagram(two, z_image=points.rear_focus + 2.0, rays=1 << 14)
        # Rays from infinity are as high at the principal plane as in the entrance pupil.
        height = -10.0 / 6.0 * points.entrance_pupil_semi_diameter / two.stop.semi_diameter
        # Sobol points in the square, cut once: some n^(-3/4) of 10 mm for n = 2^11 of a replicate.
        allowed = 0.03 * 2.0 / points.efl
        assert spot.centroid == pytest.approx([-height * 2.0 / points.efl, 0.0], abs=allowed), lens.model
        assert spot.fraction == pytest.approx(1.0, rel=1e-12), lens.model
        x2 = (1.0 + 0.5) / 1.5 * 100.0 / 3.0 - (10.0 / 6.0 * 2.0) ** 2 * 0.25
        y2 = 100.0 / 12.0
        scale = (height / (-10.0 / 6.0)) * 2.0 / points.efl
        assert spot.rms_radius == pytest.approx(scale * math.sqrt(x2 + y2), rel=2e-3), lens.model


def test_the_passing_part_of_a_grey_iris_is_that_of_its_light():
    field = 0.32
    rays = wide_beam(field, 20.0, 1 << 17)
    clear = spot_diagram(masked([[1.0], [1.0]], 10.0), field=field, rays=1 << 14)
    for cells in ([[0.1], [1.0]], [[1.0], [0.1]]):
        lens = masked(cells, 10.0)
        spot = spot_diagram(lens, field=field, rays=1 << 14)
        through, passing = behind_iris(lens, rays).weight, lens.trace(rays).weight
        # Each ray counts once: the error of the sum of its light less its part of what passes the iris.
        expected = passing.sum() / through.sum()
        error = math.sqrt(np.sum((passing - expected * through) ** 2)) / through.sum()
        assert error < 3e-3
        assert spot.fraction == pytest.approx(expected, abs=4 * math.hypot(error, spot.fraction_error)), cells
        # The rims cut one side: clear, it would be another part.
        assert abs(clear.fraction - spot.fraction) > 0.02, cells


def test_a_grey_stop_before_or_behind_the_iris_dims_what_passes_it():
    for plain in (GAUSS, masked([[1.0, 0.5]], 10.0)):
        expected = 0.25 * spot_diagram(plain, rays=1 << 12).fraction
        for z in (-40.0, 40.0):
            dimmed = plain.inserted(MaskStop.of_cells([[0.25]], 200.0), z)
            # The same rays, but for those that rounding moves across the edge of the iris: at most a few of 2^12.
            assert spot_diagram(dimmed, rays=1 << 12).fraction == pytest.approx(expected, rel=1e-3)
