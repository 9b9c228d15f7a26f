import numpy as np

import plenoptic as pl


def test_nothing_is_hidden():
    scene = pl.still_life()
    camera = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
        sensor=pl.Sensor(shape=(48, 48), pixel_pitch=5.12 / 48),
        stop_to_microlenses=134.6,
    ).focused_at(z=-404)
    truth = pl.ground_truth(scene, camera, truth=pl.Truth.OBJECT)
    assert set(range(len(scene.meshes))) <= set(np.unique(truth.object).tolist())
    kinds = {type(mesh.material) for mesh in scene.meshes}
    assert kinds >= {pl.MetallicRoughness, pl.materials.RoughDiffuse, pl.Conductor, pl.Dielectric, pl.Lambertian}
