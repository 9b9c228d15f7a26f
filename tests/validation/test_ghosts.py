"""Ghosts beside batoid (M. Jarvis, J. Meyers et al.): its surfaces in the order of the light, two as mirrors."""

import numpy as np
import pytest

import plenoptic as pl

batoid = pytest.importorskip("batoid", reason="the extra `validation` installs it")
import in_batoid  # noqa: E402

pytestmark = pytest.mark.validation


def trace_in_batoid(lens, rays, turns, z_sensor):
    """Points and directions behind the last element."""
    indices, last = lens.indices(587.6).tolist(), len(lens.elements) - 1
    first, second = turns
    order = [(k, 1) for k in range(first + 1)] + [(k, -1) for k in range(first - 1, second - 1, -1)]
    order += [(k, 1) for k in range(second + 1, last + 1)]
    for step, (k, way) in enumerate(order):
        turns_back = step in (first, 2 * first - second)
        if k > last:
            batoid.reflect(batoid.Plane(), rays, coordSys=batoid.CoordSys(np.array([0.0, 0.0, z_sensor])))
        elif isinstance(lens.elements[k], pl.Surface):
            shape = in_batoid._shape_of(lens.elements[k])
            place = in_batoid._coordinates(lens.elements[k], float(lens.vertices[k]))
            media = [batoid.ConstMedium(indices[k]), batoid.ConstMedium(indices[k + 1])][::way]
            if turns_back:
                batoid.reflect(shape, rays, coordSys=place)
            else:
                batoid.refract(shape, rays, *media, coordSys=place)
    place = rays.coordSys
    origin = np.column_stack([rays.x, rays.y, rays.z]) @ place.rot.T + place.origin
    velocity = np.column_stack([rays.vx, rays.vy, rays.vz]) @ place.rot.T
    return origin, indices[-1] * velocity


@pytest.mark.parametrize("name", ["double-gauss-100mm-f2", "cooke-triplet-50mm-f5", "heliar-254mm-f5"])
def test_rays_of_each_pair_arrive_at_the_same_points(name):
    lens = pl.load_lens(name)
    z_sensor = 1.02 * pl.paraxial.cardinal_points(lens).rear_focus
    ghosts = lens.ghosts(z_image=z_sensor, sensor=0.4, rays=32)
    random, a = np.random.default_rng(3), lens.elements[0].semi_diameter
    origin = np.column_stack([random.uniform(-a, a, (400, 2)), np.full(400, lens.vertices[0] - 20.0)])
    direction = np.column_stack([random.uniform(-0.1, 0.1, (400, 2)), np.ones(400)])
    rays, arrivals = pl.RayBundle(origin, direction), 0
    for k in range(len(ghosts)):
        stack = ghosts.stack(k)
        shift = np.array([0.0, 0.0, stack.vertices[0] - lens.vertices[0]])
        ours = stack.trace(pl.RayBundle(rays.origin + shift, rays.direction))
        turns = int(ghosts.first[k]), int(ghosts.second[k])
        points, directions = trace_in_batoid(lens, in_batoid.rays_of(rays), turns, z_sensor)
        passes = ours.status == 0
        end = (0.0, 0.0, stack.vertices[-1] - lens.vertices[-1])
        # The last element may be a stop, a plane that batoid's rays have not reached.
        t = ((ours.origin - end)[:, 2] - points[:, 2]) / directions[:, 2]
        np.testing.assert_allclose(
            (ours.origin - end)[passes], (points + t[:, None] * directions)[passes], rtol=0, atol=1e-9, err_msg=turns
        )
        np.testing.assert_allclose(ours.direction[passes], directions[passes], rtol=0, atol=1e-10)
        arrivals += np.count_nonzero(passes)
    assert arrivals > 500
