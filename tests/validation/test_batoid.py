"""Lens tracing beside batoid (M. Jarvis, J. Meyers et al.), which was written independently."""

import numpy as np
import pytest

import plenoptic as pl

batoid = pytest.importorskip("batoid", reason="the extra `validation` installs it")
pytestmark = pytest.mark.validation

TOLERANCE = 1e-9
"""mm. Both programs err by some 1e-12 mm; batoid's sphere formula loses digits on flat surfaces."""


def batoid_optic(lens):
    """The same surfaces, semi-diameters and round stops, in mm."""
    indices = lens.indices(587.6)
    items = []
    for i, (z, element) in enumerate(zip(lens.vertices, lens.elements, strict=True)):
        about = {
            "obscuration": batoid.ObscNegation(batoid.ObscCircle(element.semi_diameter)),
            "name": str(i),
            "coordSys": batoid.CoordSys([0.0, 0.0, float(z)]),
            "inMedium": batoid.ConstMedium(float(indices[i])),
            "outMedium": batoid.ConstMedium(float(indices[i + 1])),
        }
        if isinstance(element, pl.Surface):
            shape = batoid.Plane() if np.isinf(element.radius) else batoid.Sphere(element.radius)
            items.append(batoid.RefractiveInterface(shape, **about))
        else:
            items.append(batoid.Baffle(batoid.Plane(), **about))
    return batoid.CompoundOptic(items, name="lens")


def rays_into(lens, n=20_000):
    """Rays from a square in front of the lens towards its paraxial entrance pupil and a little beyond."""
    random = np.random.default_rng(1)
    points = pl.paraxial.cardinal_points(lens)
    reach = 1.2 * points.entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-20, 20, (n, 2)), np.full(n, lens.vertices[0] - 300.0)])
    target = np.column_stack([random.uniform(-reach, reach, (n, 2)), np.full(n, points.entrance_pupil)])
    return pl.RayBundle(origin, target - origin)


@pytest.mark.parametrize("name", pl.lens_names())
def test_the_same_rays_arrive_at_the_same_points(name):
    lens = pl.load_lens(name)
    rays = rays_into(lens)
    ours = lens.trace(rays)
    theirs = batoid.RayVector(*rays.origin.T.copy(), *rays.direction.T.copy(), wavelength=587.6e-9)
    optic = batoid_optic(lens)
    optic.trace(theirs)
    arrived = ours.status == pl.RayStatus.OK
    assert arrived.mean() > 0.2
    lost = np.asarray(theirs.vignetted | theirs.failed)
    # A ray within rounding of a rim may be judged either way.
    assert np.mean(lost == arrived) < 1e-3
    both = arrived & ~lost
    last = np.column_stack([theirs.x, theirs.y, theirs.z])[both]
    if theirs.coordSys.origin[2] != 0.0:
        last = last + theirs.coordSys.origin
    np.testing.assert_allclose(ours.origin[both], last, atol=TOLERANCE, rtol=0)
    # batoid's velocities have the length 1 / n, which is 1 in the air behind the lens.
    velocity = np.column_stack([theirs.vx, theirs.vy, theirs.vz])[both]
    np.testing.assert_allclose(ours.direction[both], velocity, atol=TOLERANCE / 10, rtol=0)
