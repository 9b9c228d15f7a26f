import subprocess
import sys

LOADS = """
import sys
HEAVY = {
    *("mpmath", "numba", "llvmlite", "trimesh", "embreex", "OpenImageIO", "matplotlib", "PIL", "tqdm", "scipy"),
    *("batoid", "zarr", "xarray", "pandas", "dask", "distributed"),
}

def loaded():
    return HEAVY & {name.partition('.')[0] for name in sys.modules}

import plenoptic as pl
assert not loaded(), f"importing the package loads {loaded()}"

import numpy as np
repr(pl.Exposure(np.ones((2, 2, 1))))
assert not loaded(), f"an exposure loads {loaded()}"

camera = pl.PlenopticCamera(
    pl.load_lens('double-gauss-100mm-f2'), microlenses=None, sensor=pl.Sensor(shape=(2, 2), pixel_pitch=0.01),
    stop_to_microlenses=123.3, microlenses_to_sensor=0.0)
pl.render_white(camera, samples=8, progress=False)
assert 'numba' in loaded() and not {'plenoptic.scene.scene', 'plenoptic.truth.kernels'} & set(sys.modules)
"""


def test_nothing_is_loaded_before_it_is_needed():
    done = subprocess.run([sys.executable, "-c", LOADS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
