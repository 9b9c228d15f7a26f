"""A few rays by kernels as Python against the compiled ones."""

import numpy as np

import plenoptic as pl
from plenoptic.optics.lens.analysis.few_rays import few_reverse_rays


def _towards(lens, slopes):
    z = float(lens.vertices[-1]) + 80.0
    origin = np.column_stack([np.full(len(slopes), 1.0), np.full(len(slopes), 2.0), np.full(len(slopes), z)])
    return origin, np.column_stack([0.4 * slopes, slopes, -np.ones(len(slopes))])


_GAUSS = pl.load_lens("double-gauss-100mm-f2")
_TILTED = _GAUSS.moved(3, shift=(0.2, -0.1, 0.0), tilt=(0.01, -0.02, 0.0))
_ASPHERE = pl.LensStack(
    [pl.CircularStop(8.0, thickness=5.0),
     pl.Surface(40.0, semi_diameter=10.0, thickness=6.0, medium=pl.glass("N-BK7"), conic=-0.6, aspheric=(0.0, 2e-6)),
     pl.Surface(-200.0, semi_diameter=10.0)]
)  # fmt: skip


_SHAPED = _GAUSS.with_stop(pl.StarStop(points=5, semi_diameter=9.0, inner_semi_diameter=4.0))


def test_rays_are_those_of_the_compiled_tracer():
    for lens in (*map(pl.load_lens, pl.lens_names()), _TILTED, _ASPHERE, _SHAPED):
        origin, direction = _towards(lens, np.linspace(-0.25, 0.25, 21))
        points, found = few_reverse_rays(lens, origin, direction, 587.6)
        unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        traced = lens.with_model(pl.LensModel.EXACT).trace_reverse(pl.RayBundle(origin, unit, 587.6))
        passed = traced.status == 0
        assert passed.any(), lens.name
        np.testing.assert_array_equal(np.isfinite(found).all(axis=1), passed)
        # The compiler may fuse multiply and add, and here rays go back to the origin of the axes before each element.
        size = max(element.semi_diameter for element in lens.elements)
        np.testing.assert_allclose(points[passed, -1], traced.origin[passed], rtol=0, atol=1e-11 * size)
        np.testing.assert_allclose(found[passed], traced.direction[passed], rtol=0, atol=1e-11)


def test_lost_rays_end_on_what_ends_them():
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(2.0))
    points, direction = few_reverse_rays(lens, *_towards(lens, np.array([0.0, 0.2])), 587.6)
    assert np.isfinite(direction[0]).all() and np.isnan(direction[1]).all()
    ended = int(np.isfinite(points[1]).all(axis=1).sum()) - 1
    assert 0 < ended < len(lens.elements) and np.isnan(points[1, ended + 1 :]).all()
    free, onward = few_reverse_rays(lens, *_towards(lens, np.array([0.02])), 587.6, clipping=False)
    assert np.isfinite(free).all() and np.isfinite(onward).all()
