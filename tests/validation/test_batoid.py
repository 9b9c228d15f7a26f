"""Lens tracing beside batoid (M. Jarvis, J. Meyers et al.), which was written independently."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl

pytest.importorskip("batoid", reason="the extra `validation` installs it")
import in_batoid  # noqa: E402

pytestmark = pytest.mark.validation


def assert_same(lens, n=20_000, distance=300.0, **tolerance):
    """Of rays from a square in front of the lens towards its paraxial entrance pupil and a little beyond."""
    random = np.random.default_rng(1)
    points = pl.paraxial.cardinal_points(lens)
    reach = 1.2 * points.entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-20, 20, (n, 2)), np.full(n, lens.vertices[0] - distance)])
    target = np.column_stack([random.uniform(-reach, reach, (n, 2)), np.full(n, points.entrance_pupil)])
    in_batoid.assert_same(lens, pl.RayBundle(origin, target - origin), at_least=0.2, **tolerance)


# batoid turns the axis at mirrors, which are unfolded here: these are held against optiland in test_zemax_files.
@pytest.mark.parametrize("name", [name for name in pl.lens_names() if not name.startswith("mirror")])
def test_the_same_rays_arrive_at_the_same_points(name):
    assert_same(pl.load_lens(name))


def shaped(changes):
    """The double Gauss with other shapes for some of its surfaces."""
    lens = pl.load_lens("double-gauss-100mm-f2")
    elements = [dataclasses.replace(element, **changes.get(i, {})) for i, element in enumerate(lens.elements)]
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


@pytest.mark.parametrize("front, rear", [(1.333, 1.0), (1.0, 1.336), (1.333, 1.336)])
@pytest.mark.parametrize("name", ["cooke-triplet-50mm-f5", "heliar-254mm-f5", "double-gauss-100mm-f2"])
def test_media_in_front_and_behind_bend_the_same_rays_alike(name, front, rear):
    lens = pl.load_lens(name)
    last = max(i for i, element in enumerate(lens.elements) if isinstance(element, pl.Surface))
    media = [pl.ConstantMedium(front), pl.ConstantMedium(rear)]
    elements = list(lens.elements)
    elements[last] = dataclasses.replace(elements[last], medium=media[1])
    lens = dataclasses.replace(lens, elements=elements, front_medium=media[0], rear_medium=media[1], specification=None)
    assert_same(lens, distance=30.0, tolerance=1e-12)
