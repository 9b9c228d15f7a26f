import numpy as np
import pytest

import plenoptic as pl
from plenoptic.scene.shapes.still_life import still_life


@pytest.fixture(scope="module")
def scene():
    return still_life()


def only(scene, kind, wanted=lambda material: True):
    (mesh,) = [mesh for mesh in scene.meshes if isinstance(mesh.material, kind) and wanted(mesh.material)]
    return mesh


def things(scene):
    return {
        "vase": only(scene, pl.MetallicRoughness),
        "block": only(scene, pl.materials.RoughDiffuse),
        "gold": only(scene, pl.Conductor, lambda material: material.alpha > 0),
        "mirror": only(scene, pl.Conductor, lambda material: material.alpha == 0),
        "glass": only(scene, pl.Dielectric),
        "red": only(scene, pl.Lambertian, lambda material: np.ptp(material.albedo) > 0.5),
    }


def test_it_has_surfaces_of_every_kind_where_the_camera_sees_them(scene):
    for mesh in things(scene).values():
        low, high = mesh.bounds
        # 15.6 mm are seen at z = -404, in proportion elsewhere.
        assert (np.abs([low[:2], high[:2]]).max(axis=1) < 7.8 * high[2] / -404 + 0.5).all()
        assert -420 < low[2] < high[2] < -385
    # It tells left from right and up from down.
    place = {name: mesh.bounds.mean(axis=0) for name, mesh in things(scene).items()}
    assert place["vase"][0] < -1 < 1 < place["red"][0] and place["red"][1] < place["vase"][1]
    assert place["glass"][0] < place["gold"][0] < place["mirror"][0] and place["block"][1] < place["gold"][1]
    (light,) = scene.lights
    assert light.center[0] < 0 < light.center[1]


def test_nothing_is_hidden(scene):
    camera = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
        sensor=pl.Sensor(shape=(48, 48), pixel_pitch=5.12 / 48),
        stop_to_microlenses=134.6,
    ).focused_at(z=-404)
    truth = pl.ground_truth(scene, camera, truth=pl.Truth.OBJECT)
    assert set(range(len(scene.meshes))) <= set(np.unique(truth.object).tolist())
