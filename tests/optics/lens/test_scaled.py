"""Lenses of another size: all lengths scale, and angles, f-numbers and the prescription's form stay."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import optical_path, spot_diagram
from plenoptic.errors import InvalidValueError

EPS = np.finfo(float).eps
FACTORS = (0.37, 12.0)


def kinds():
    """The bundled lenses, and some that have the members which those lack."""
    lenses = {name: pl.load_lens(name) for name in pl.lens_names()}
    gauss = lenses["double-gauss-100mm-f2"]
    first, *others = gauss.elements
    terms = {
        "zernike": pl.optics.ZernikeSag((0.0, 0.0, 0.0, 1e-3, 5e-3, -2e-3), 25.0),
        "biconic": pl.optics.BiconicSag(900.0, -400.0, 0.3, 0.1),
        "odd powers": pl.optics.OddPowerSag((1e-6, -1e-9)),
    }
    for name, term in terms.items():
        shaped = dataclasses.replace(first, conic=-0.2, aspheric=(1e-5, 2e-8, -3e-12), freeform=term)
        lenses[name] = dataclasses.replace(gauss, elements=(shaped, *others))
    lenses["moved"] = gauss.moved(2, shift=(0.3, -0.2, 0.1), tilt=(0.02, -0.01, 0.0)).moved(7, tilt=(0, 0.03, 0))
    stops = {
        "polygon": pl.PolygonStop(6, 9.0, 0.2, blade_radius=15.0),
        "star": pl.StarStop(5, 9.0, 4.0, 0.1),
        "mask": pl.optics.MaskStop([[1.0, 0.0, 0.5], [1.0, 1.0, 0.0]], 9.0),
        "ring": pl.optics.RingStop(9.0, 3.0),
    }
    lenses |= {name: gauss.with_stop(stop) for name, stop in stops.items()}
    glass = pl.ConstantMedium(1.5)
    lenses["beyond the equator"] = pl.LensStack(
        [
            pl.CircularStop(1.0, thickness=1.0),
            pl.Surface(5.1, 7.0, glass, semi_diameter=5.1 / math.sqrt(1.7), conic=0.7, depth=3.2),
            pl.Surface(-5.1, semi_diameter=5.1, depth=5.3),
        ]
    )
    lenses["ellipsoid up to its equator"] = pl.LensStack(
        [
            pl.CircularStop(1.0, thickness=1.0),
            pl.Surface(5.1, 3.0, glass, semi_diameter=5.1 / math.sqrt(1.7), conic=0.7),
            pl.Surface(-5.1, semi_diameter=5.1),
        ]
    )
    fields = [(0.0, 0.0), (0.0, 3.0)]
    of_finite_object = pl.optics.Specification(fields, (550.0,), z_object=-300.0, z_image=140.0, stop_semi_diameter=9.0)
    lenses["specified"] = dataclasses.replace(gauss, specification=of_finite_object)
    return lenses


LENSES = kinds()


def rays_into(lens: pl.LensStack, n: int = 200) -> pl.RayBundle:
    """Rays from 30 mm in front of a lens through its entrance pupil, and some beside it."""
    random = np.random.default_rng(3)
    size = 1.2 * pl.paraxial.cardinal_points(lens).entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-size, size, (n, 2)), np.full(n, lens.vertices[0] - 30.0)])
    return pl.RayBundle(origin, np.column_stack([random.normal(0, 0.02, (n, 2)), np.ones(n)]))


def test_rays_and_their_optical_paths_scale():
    for name, lens in LENSES.items():
        rays = rays_into(lens)
        out, path = optical_path(lens, rays)
        extent = 30.0 + np.abs(lens.vertices).max()
        for factor in FACTORS:
            scaled = lens.scaled(factor)
            other, other_path = optical_path(scaled, pl.RayBundle(factor * rays.origin, rays.direction))
            # A ray within rounding of a rim may fall to either side.
            assert np.count_nonzero(out.status != other.status) <= 1, name
            passed = (out.status == 0) & (other.status == 0)
            assert passed.sum() > 10, name
            # Rounding of the scaled prescription and of some twenty refractions, magnified by them.
            bound = 2e4 * EPS
            assert np.abs(other.direction - out.direction)[passed].max() < bound, name
            assert np.abs(other.origin / factor - out.origin)[passed].max() < bound * extent, name
            assert np.abs(other_path / factor - path)[passed].max() < bound * extent, name
            np.testing.assert_array_equal(other.weight[passed], out.weight[passed], err_msg=name)


def test_gaussian_optics_scale_and_f_numbers_stay():
    for name, lens in LENSES.items():
        points = pl.paraxial.cardinal_points(lens)
        for factor in FACTORS:
            scaled = lens.scaled(factor)
            other = pl.paraxial.cardinal_points(scaled)
            for field in dataclasses.fields(points):
                a, b = getattr(points, field.name), getattr(other, field.name)
                unit = 1.0 if field.name in ("f_number", "pupil_magnification", "wavelength") else factor
                unit = 1.0 / factor if field.name == "power" else unit
                size = abs(points.efl) if unit == factor else abs(a)
                assert a == b if math.isinf(a) else abs(b / unit - a) <= 1e-12 * max(size, abs(a)), (name, field.name)
            assert np.abs(scaled.vertices / factor - lens.vertices).max() <= 1e-14 * lens.length + 1e-300, name


def test_spot_diagrams_scale():
    for name in ("double-gauss-100mm-f2", "asphere-15mm-f0.9", "zernike"):
        lens = LENSES[name]
        spot = spot_diagram(lens, field=(0.0, 0.05), rays=256)
        for factor in FACTORS:
            other = spot_diagram(lens.scaled(factor), field=(0.0, 0.05), rays=256)
            # Rounding of heights, some 1e4 eps of the image distance as for rays.
            bound = 2e4 * EPS * abs(spot.z_image)
            assert abs(other.rms_radius / factor - spot.rms_radius) < bound, name
            assert np.abs(other.centroid / factor - spot.centroid).max() < bound, name


def test_the_way_back_leads_to_the_lens():
    for name, lens in LENSES.items():
        # A power of two has no rounding.
        assert lens.scaled(4.0).scaled(0.25) == lens, name
        back = lens.scaled(0.37).scaled(1 / 0.37)
        for a, b in zip(lens.elements, back.elements, strict=True):
            assert type(a) is type(b)
            for length in ("thickness", "semi_diameter", "radius", "depth", "blade_radius", "inner_semi_diameter"):
                if getattr(a, length, None) is not None:
                    assert getattr(b, length) == pytest.approx(getattr(a, length), rel=1e-15 * 4), (name, length)


def test_rims_on_an_equator_stay_there():
    for factor in np.linspace(0.1, 3.0, 100).tolist():
        for name in ("beyond the equator", "ellipsoid up to its equator"):
            first = LENSES[name].scaled(factor).elements[1]
            assert first.semi_diameter == pytest.approx(factor * LENSES[name].elements[1].semi_diameter, rel=1e-15)


def test_heights_of_a_specification_scale_and_angles_stay():
    specified = LENSES["specified"].scaled(2.0).specification
    assert specified.fields.tolist() == [[0.0, 0.0], [0.0, 6.0]]
    assert (specified.z_object, specified.z_image, specified.stop_semi_diameter) == (-600.0, 280.0, 18.0)
    assert specified.wavelengths == (550.0,)
    assert specified.entrance_pupil_diameter is None
    far = LENSES["mirror-1000mm-f7.5"]
    scaled = far.scaled(2.0).specification
    assert np.array_equal(scaled.fields, far.specification.fields)
    assert (scaled.z_object, scaled.image_radius) == (-math.inf, math.inf)


def test_a_focal_length_may_stand_for_the_factor():
    for name in ("double-gauss-100mm-f2", "mirror-1000mm-f7.5"):
        assert pl.paraxial.cardinal_points(LENSES[name].scaled(focal_length=35.0)).efl == pytest.approx(35, rel=1e-12)


def test_what_gives_no_lens_is_refused():
    lens = LENSES["singlet-100mm-f4"]
    afocal = dataclasses.replace(lens, elements=[*lens.elements[:-2], pl.Surface(math.inf, semi_diameter=5.0)])
    for stack, arguments, message in (
        (lens, {}, "needs a factor or a focal_length"),
        (lens, {"factor": 2.0, "focal_length": 50.0}, "not both"),
        (lens, {"factor": 0.0}, "factor is 0"),
        (lens, {"factor": math.nan}, "factor is nan"),
        (lens, {"factor": -1.0}, "factor is -1"),
        (lens, {"factor": 1e7}, "at most|to 1e"),
        (lens, {"focal_length": -50.0}, "same sign"),
        (lens, {"focal_length": math.inf}, "finite"),
        (afocal, {"focal_length": 50.0}, "finite"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            stack.scaled(**arguments)
