import itertools
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

EPS = np.finfo(float).eps
Model, Side = pl.optics.MicrolensModel, pl.optics.ConvexSide
NAMED_IN = {"optics/microlens/models.py", "optics/microlens/array.py"}
"""The registry, and the default of arrays."""


def array_of(model, side=Side.SCENE):
    index = 100.0 if model.is_flat else 1.5
    return pl.MicrolensArray(0.2, (2.0,), model=model, thickness=0.1, index=index, convex_side=side)


def test_no_other_file_tells_models_apart():
    package = Path(pl.__file__).parent
    rooms = [path for path in package.rglob("*.py") if path.relative_to(package).parts[0] not in ("study", "command")]
    naming = {path.relative_to(package).as_posix() for path in rooms if "MicrolensModel." in path.read_text("utf-8")}
    assert naming == NAMED_IN


def test_depths_add_up_to_the_glass_and_rays_along_the_axis_are_not_displaced():
    points, slopes = np.array([[0.1, -0.2], [0.0, 0.3]]), np.zeros((2, 2))
    for model, side in itertools.product(Model, Side):
        array = array_of(model, side)
        depths = model.refraction.depths(array)
        assert min(depths) >= 0, (model, side)
        assert sum(depths) == pytest.approx(array.thickness if model.is_plate else 0.0, rel=4 * EPS), (model, side)
        assert depths.separation == array.principal_separation, (model, side)
        for rear in (False, True):
            np.testing.assert_array_equal(model.refraction.shift_chief_rays(array, points, slopes, 550.0, rear), points)
