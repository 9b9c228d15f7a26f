"""Lens tracing beside batoid (M. Jarvis, J. Meyers et al.), which was written independently."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl

batoid = pytest.importorskip("batoid", reason="the extra `validation` installs it")
pytestmark = pytest.mark.validation

TOLERANCE = 1e-9
"""mm. Both programs err by some 1e-12 mm; batoid's sphere formula loses digits on flat surfaces."""


def batoid_optic(lens):
    """The same surfaces, semi-diameters, round stops and places, in mm."""
    indices = lens.indices(587.6)
    items = []
    for i, (z, element) in enumerate(zip(lens.vertices, lens.elements, strict=True)):
        about = {
            "obscuration": batoid.ObscNegation(batoid.ObscCircle(element.semi_diameter)),
            "name": str(i),
            "coordSys": coordinates(element, float(z)),
            "inMedium": batoid.ConstMedium(float(indices[i])),
            "outMedium": batoid.ConstMedium(float(indices[i + 1])),
        }
        if isinstance(element, pl.Surface):
            items.append(batoid.RefractiveInterface(shape_of(element), **about))
        else:
            items.append(batoid.Baffle(batoid.Plane(), **about))
    return batoid.CompoundOptic(items, name="lens")


def coordinates(element, z):
    placed = element.placement or pl.optics.Placement()
    return batoid.CoordSys(np.array([0.0, 0.0, z]) + placed.shift, np.ascontiguousarray(placed.rotation))


def shape_of(surface):
    if surface.aspheric:
        assert surface.aspheric[0] == 0, "batoid's coefficients begin with r^4"
        conic = surface.conic if surface.conic != -1 else -1 + 1e-12  # it begins at the conic, and divides by 1 + k
        return batoid.Asphere(surface.radius, conic, np.array(surface.aspheric[1:]))
    if surface.conic == -1:  # batoid's Quadric divides by 1 + k
        return batoid.Paraboloid(surface.radius)
    if surface.conic:
        return batoid.Quadric(surface.radius, surface.conic)
    return batoid.Plane() if np.isinf(surface.radius) else batoid.Sphere(surface.radius)


def rays_into(lens, n=20_000):
    """Rays from a square in front of the lens towards its paraxial entrance pupil and a little beyond."""
    random = np.random.default_rng(1)
    points = pl.paraxial.cardinal_points(lens)
    reach = 1.2 * points.entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-20, 20, (n, 2)), np.full(n, lens.vertices[0] - 300.0)])
    target = np.column_stack([random.uniform(-reach, reach, (n, 2)), np.full(n, points.entrance_pupil)])
    return pl.RayBundle(origin, target - origin)


def assert_same(lens):
    rays = rays_into(lens)
    ours = lens.trace(rays)
    theirs = batoid.RayVector(*rays.origin.T.copy(), *rays.direction.T.copy(), wavelength=587.6e-9)
    batoid_optic(lens).trace(theirs)
    arrived = ours.status == pl.RayStatus.OK
    assert arrived.mean() > 0.2
    lost = np.asarray(theirs.vignetted | theirs.failed)
    # A ray within rounding of a rim may be judged either way.
    assert np.mean(lost == arrived) < 1e-3
    both = arrived & ~lost
    # Their rays end in the axes of the last element.
    place = theirs.coordSys
    last = np.column_stack([theirs.x, theirs.y, theirs.z])[both] @ place.rot.T + place.origin
    np.testing.assert_allclose(ours.origin[both], last, atol=TOLERANCE, rtol=0)
    # batoid's velocities have the length 1 / n, which is 1 in the air behind the lens.
    velocity = np.column_stack([theirs.vx, theirs.vy, theirs.vz])[both] @ place.rot.T
    np.testing.assert_allclose(ours.direction[both], velocity, atol=TOLERANCE / 10, rtol=0)


# batoid turns the axis at mirrors, which are unfolded here: these are held against optiland in test_zemax_files.
@pytest.mark.parametrize("name", [name for name in pl.lens_names() if not name.startswith("mirror")])
def test_the_same_rays_arrive_at_the_same_points(name):
    assert_same(pl.load_lens(name))


def shaped(changes):
    """The double Gauss with other shapes for some of its surfaces."""
    lens = pl.load_lens("double-gauss-100mm-f2")
    elements = list(lens.elements)
    for i, fields in changes.items():
        elements[i] = dataclasses.replace(elements[i], **fields)
    return dataclasses.replace(lens, elements=elements)


@pytest.mark.parametrize(
    "changes",
    [
        {0: {"conic": -1.0}, 2: {"conic": -3.0}, 8: {"conic": 1.5}},
        {0: {"conic": 0.5, "aspheric": (0.0, 2e-7, -1e-10)}, 9: {"aspheric": (0.0, -1e-6, 3e-9, 1e-12)}},
        {4: {"conic": -0.3, "aspheric": (0.0, 1e-5, 1e-8, -1e-11)}, 8: {"conic": 2.0}},
    ],
)
def test_conics_and_aspheres_bend_the_same_rays_alike(changes):
    assert_same(shaped(changes))


@pytest.mark.parametrize("which", [2, slice(0, 5), 5, [6, 7, 8]])
def test_elements_out_of_place_bend_the_same_rays_alike(which):
    lens = shaped({9: {"aspheric": (0.0, -1e-6)}, 7: {"conic": -0.7}})
    assert_same(lens.moved(which, shift=(0.7, -0.4, 0.2), tilt=(0.02, -0.05, 0.4)))
