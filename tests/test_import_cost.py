import json
import subprocess
import sys

HEAVY = {
    "mpmath",
    "numba",
    "llvmlite",
    "trimesh",
    "embreex",
    "OpenImageIO",
    "matplotlib",
    "PIL",
    "tqdm",
    "scipy",
    "batoid",
    "zarr",
    "xarray",
    "pandas",
    "dask",
    "distributed",
}


def loaded_by(code):
    listing = f"{code}\nimport json, sys\nprint(json.dumps(sorted({{name.partition('.')[0] for name in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_importing_the_package_loads_nothing_heavy():
    assert not loaded_by("import plenoptic") & HEAVY


def test_an_exposure_needs_neither_kernels_nor_libraries():
    code = "import numpy as np, plenoptic as pl; repr(pl.Exposure(np.ones((2, 2, 1))))"
    assert not loaded_by(code) & HEAVY


def test_a_white_image_needs_nothing_of_scenes():
    code = (
        "import sys, plenoptic as pl\n"
        "camera = pl.PlenopticCamera(pl.load_lens('double-gauss-100mm-f2'), microlenses=None, "
        "sensor=pl.Sensor(shape=(2, 2), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=0.0)\n"
        "pl.render_white(camera, samples=8, progress=False)\n"
        "assert 'plenoptic.scene.scene' not in sys.modules and 'plenoptic.truth.kernels' not in sys.modules"
    )
    loaded_by(code)
