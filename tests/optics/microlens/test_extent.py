"""Arrays of finite extent: the same light as with opaque lenses beyond, and no lens beyond anywhere."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import camera_with, refused, white

import plenoptic as pl

EXTENT = (1.1, 0.7)
SHAPE = (160, 200)
"""Pixels of 0.01 mm: 2 by 1.6 mm, wider than the array."""
FULL = {"shape": SHAPE, "b": 2.0, "stop": 4.25}
WALLED = {"shape": SHAPE, "walls": pl.optics.Walls.OPAQUE}
ROUND = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.7, pl.optics.Gaps.CLEAR)
GLASS = {"model": pl.optics.MicrolensModel.SPHERICAL, "index": 1.5}
TURNED = ((pl.CameraPart.MICROLENSES, (0.05, -0.02, 0.0), (0.0, 0.0, 0.3)),)
KINDS = {
    "hexagonal": FULL,
    "square, overlapping": {"shape": SHAPE, "lattice": pl.Lattice.SQUARE},
    "rectangular": FULL | {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.217, 0.3)},
    "types": FULL | {"focal_lengths": (1.7, 2.0, 2.4)},
    "turned": FULL | {"moved": TURNED},
    "turned glass": FULL | GLASS | {"moved": TURNED},
    "clear gaps": FULL | {"aperture": ROUND},
    "walls": WALLED,
    "pinholes": FULL | {"model": pl.optics.MicrolensModel.PINHOLE},
    "imperfect": FULL | {"imperfections": pl.MicrolensImperfections(0.002, 0.002, 0.01, seed=3)},
}


def is_inside(array, index, extent=EXTENT):
    """Lenses whose centres lie in the extent, by the lattice's formula; none of the tests lies on its border."""
    return (np.abs(index @ array.basis) <= 0.5 * np.array(extent)).all(axis=1)


def with_opaque_lenses(camera, extent=EXTENT):
    """Camera whose lenses beyond the extent are opaque one by one, in place of the extent."""
    array = camera.microlenses
    lenses = array.lenses((-4.0, -4.0), (4.0, 4.0))
    deviations = None if array.imperfections is None else array.imperfections.deviations(lenses.index)
    opaque = pl.optics.MicrolensDeviations(
        lenses.index,
        shift=None if deviations is None else deviations.shift,
        decentre=None if deviations is None else deviations.decentre,
        focal_length_factor=1.0 / (lenses.power * np.array(array.focal_lengths)[lenses.type]),
        transmission=np.where(is_inside(array, lenses.index, extent), lenses.transmission, 0.0),
    )
    return dataclasses.replace(camera, microlenses=dataclasses.replace(array, imperfections=opaque))


def with_extent(camera, extent=EXTENT):
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, extent=extent))


def test_beyond_the_extent_it_is_as_dark_as_behind_opaque_lenses():
    for name, kind in KINDS.items():
        camera = camera_with(**kind)
        ended, opaque = white(with_extent(camera)), white(with_opaque_lenses(camera), seed=1)
        error = np.hypot(ended.standard_error, opaque.standard_error).astype(float)
        difference = ended.image.astype(float) - opaque.image
        # The same pixels are dark, but for those that see a sliver of a lens which few samples meet.
        dark, other = ended.image[..., 0] == 0, opaque.image[..., 0] == 0
        assert 0.2 < dark.mean() < 0.95, name
        assert (ended.image + opaque.image)[dark != other].sum() < 1e-3 * ended.image.sum(), name
        sums = abs(difference.sum()) <= 5 * np.linalg.norm(error) + 1e-6 * ended.image.sum()
        assert sums, (name, difference.sum(), np.linalg.norm(error))
        bright = error > 0
        assert np.sqrt(np.mean((difference[bright] / error[bright]) ** 2)) < 2.5, name


def test_pixels_that_see_only_lenses_of_the_extent_keep_their_bits():
    camera = camera_with(**FULL)
    whole, ended = white(camera), white(with_extent(camera))
    kept = ended.image[..., 0] > 0
    assert 0.05 < kept.mean() < 0.8
    np.testing.assert_array_equal(ended.image[70:90, 90:110], whole.image[70:90, 90:110])
    # Images of a plenoptic 1.0 camera hardly overlap.
    assert np.mean(ended.image[kept] == whole.image[kept]) > 0.9


def test_a_wide_extent_is_none():
    camera = camera_with(**FULL)
    np.testing.assert_array_equal(white(with_extent(camera, (50.0, 50.0))).image, white(camera).image)


def test_light_that_travels_forwards_ends_at_the_extent():
    for name, kind in KINDS.items():
        if name == "pinholes":  # no ray from a point meets one
            continue
        camera = camera_with(**kind)
        points = [(0.0, 0.0, -404.0), (1.5, -1.0, -404.0)]
        ended, opaque = (
            pl.camera.landing_points(each, points, rays=1 << 12)
            for each in (with_extent(camera), with_opaque_lenses(camera))
        )
        passed = opaque.weight > 0
        assert 0 < passed.mean() < 1, name
        index = opaque.index[passed]
        assert np.array_equal(ended.index, index) and is_inside(camera.microlenses, ended.index).all(), name
        # Lens tables and lattices round differently.
        assert np.abs(ended.position - opaque.position[passed]).max() < 1e-9, name
        assert ended.weight == pytest.approx(opaque.weight[passed], rel=1e-9), name


def test_no_list_has_lenses_beyond():
    for name in ("hexagonal", "square, overlapping", "turned", "types", "imperfect"):
        camera = with_extent(camera_with(**KINDS[name]))
        array, without = camera.microlenses, camera_with(**KINDS[name]).microlenses
        expected = without.lenses((-9.0, -9.0), (9.0, 9.0))
        inside = is_inside(array, expected.index)
        lenses = array.lenses((-math.inf, -math.inf), (math.inf, math.inf))
        np.testing.assert_array_equal(lenses.index, expected.index[inside], err_msg=name)
        np.testing.assert_array_equal(lenses.axis, expected.axis[inside], err_msg=name)
        for method in (pl.CentreMethod.CHIEF_RAY, pl.CentreMethod.CENTROID):
            centres = pl.microlens_centres(camera, method)
            assert len(centres) == inside.sum() and is_inside(array, centres.index).all(), name
        seen = pl.project(camera, [(0.0, 0.0, -404.0), (2.5, 1.0, -404.0), (-2.5, -1.0, -404.0)])
        all_seen = pl.project(
            camera_with(**KINDS[name]), [(0.0, 0.0, -404.0), (2.5, 1.0, -404.0), (-2.5, -1.0, -404.0)]
        )
        belongs = is_inside(array, all_seen.index)
        np.testing.assert_array_equal(seen.index, all_seen.index[belongs], err_msg=name)
        assert not belongs.all()
        nearest = array.nearest(expected.design)
        assert np.array_equal(np.isfinite(nearest).all(axis=1), inside), name


def test_views_truth_and_reports_end_at_the_extent():
    camera = camera_with(**(FULL | {"shape": (512, 512), "lattice": pl.Lattice.SQUARE}))
    ended = with_extent(camera, (3.0, 2.1))
    shots = [pl.render_white(each, samples=16, progress=False) for each in (camera, ended)]
    fields = [pl.lightfield.decode(shot, shot, views=3) for shot in shots]
    # 13 x 9 lenses of 0.217 mm have their centres in 3 x 2.1 mm.
    assert fields[1].views.shape[2:4] == (9, 13) and fields[0].views.shape[2] > 13
    assert ended.report().microlenses == 117
    fit = ended.fitted_to(shots[1])
    # As well as the array without an end; the dark frame would displace images by some pixels.
    assert fit.residual < 0.02 and abs(fit.pitch_ratio - 1.0) < 1e-4
    region = np.s_[120:190, 100:200]
    found, before = (
        pl.ground_truth(pl.check_scene(), each, truth=pl.Truth.MICROLENS, region=region).microlens
        for each in (ended, camera)
    )
    belongs = (found > -(2**31)).all(axis=-1)
    assert 0.05 < belongs.mean() < 0.95
    assert (np.abs(found[belongs] @ ended.microlenses.basis) <= (1.5, 1.05)).all()
    # Where images do not overlap, pixels keep their microlens.
    assert (found[belongs] == before[belongs]).all(axis=-1).mean() > 0.95


def test_waves_end_at_the_extent():
    camera = camera_with(b=2.0, stop=1.0, shape=SHAPE, lattice=pl.Lattice.SQUARE)
    point = (1.2, 0.0, -420.0)
    spread = [pl.wave.point_spread(each, point) for each in (camera, with_extent(camera, (0.6, 0.6)))]
    opaque = pl.wave.point_spread(with_opaque_lenses(camera, (0.6, 0.6)), point)
    light = [float(np.sum(each.image)) for each in (*spread, opaque)]
    assert 0.05 * light[0] < light[1] < 0.95 * light[0]
    # The grid ends with the lenses, so that light beyond it differs: some 1e-3, as `error` states.
    assert light[1] == pytest.approx(light[2], rel=2e-3)


def test_what_is_no_extent_is_refused():
    for extent, message in (((1.0,), "two lengths"), (1.0, "two lengths"), ((1.0, 0.0), "extent along y")):
        with refused(message):
            pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), extent=extent)
    with refused("FREE"):
        pl.MicrolensArray(0.2, (2.0,), pl.Lattice.FREE, centres=[(0.0, 0.0)], extent=(1.0, 1.0))
