"""Tables and trees are kept for the scene that was compiled last, and for no other."""

import dataclasses
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.scene import cache
from plenoptic.scene.cache import prepared_scene

CAMERA = pl.PlenopticCamera(pl.no_lens(1.0), pl.Sensor((4, 4), pixel_pitch=0.5), stop_to_microlenses=10.0)


@pytest.fixture
def built(monkeypatch):
    """Of how many triangles trees have been built."""
    build, numbers = cache.build_intersector, []

    def counted(geometry, instances=None):
        numbers.append(len(geometry.triangles))
        return build(geometry, instances)

    monkeypatch.setattr(cache, "build_intersector", counted)
    return numbers


def scene(side=50.0):
    return pl.Scene([pl.box(side, material=pl.Emissive(1.0)).translated(z=-404)])


def rendered(scene):
    return pl.render(scene, CAMERA, samples=8, progress=False)


def test_a_scene_is_compiled_once_and_another_one_anew(built):
    one = scene()
    first, again = rendered(one), rendered(one)
    pl.ground_truth(one, CAMERA)
    pl.replay(again, one, pixel=(1, 2), sample=3)
    assert built == [12]
    assert first.image.any() and first.image.tobytes() == again.image.tobytes()
    # What is not asked for is not built.
    one = scene()
    assert pl.plan(one, CAMERA).runs(pl.rendering.Stage.INTERSECTION)
    assert prepared_scene(one).record.geometry is not None
    assert built == [12]
    # Another one is compiled even if it is equal.
    one = scene()
    images = [rendered(each).image for each in (one, scene(), one, scene(20.0))]
    assert built == [12] * 5
    assert images[0].tobytes() == images[1].tobytes() == images[2].tobytes() != images[3].tobytes()
    # A scene that is changed is another one.
    assert np.all(rendered(dataclasses.replace(one, background=2.0)).image >= images[0])


def test_it_goes_when_its_scene_goes():
    one = scene()
    kept = weakref.ref(prepared_scene(one))
    tree = weakref.ref(kept().intersector)
    assert prepared_scene(one) is kept()
    del one
    assert kept() is None and tree() is None
    # And when another one comes.
    one, other = scene(), scene()
    kept = weakref.ref(prepared_scene(one))
    prepared_scene(other)
    assert kept() is None


def test_threads_with_scenes_of_their_own_do_not_disturb_each_other():
    sides = [20.0, 30.0, 40.0, 50.0]
    alone = [rendered(scene(side)).image.tobytes() for side in sides]
    with ThreadPoolExecutor(4) as pool:
        found = pool.map(lambda side: [rendered(scene(side)).image.tobytes() for _ in range(5)], sides)
        assert list(found) == [5 * [image] for image in alone]
