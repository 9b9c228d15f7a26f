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


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("model", Model)
def test_depths_add_up_to_the_glass(model, side):
    array = array_of(model, side)
    depths = model.rules.depths(array)
    assert min(depths) >= 0
    assert sum(depths) == pytest.approx(array.thickness if model.is_plate else 0.0, rel=4 * EPS)
    assert depths.separation == array.principal_separation


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("model", Model)
def test_rays_along_the_axis_are_not_displaced(model, side):
    points, slopes = np.array([[0.1, -0.2], [0.0, 0.3]]), np.zeros((2, 2))
    for rear in (False, True):
        found = model.rules.displaced(array_of(model, side), points, slopes, 550.0, rear)
        np.testing.assert_array_equal(found, points)


@pytest.mark.parametrize("model", Model)
def test_rules_say_what_the_enumeration_says(model):
    assert (model.focuses, model.is_plate, model.is_flat) == (
        model is not Model.PINHOLE,
        model in (Model.FLAT_HIGH_INDEX, Model.SPHERICAL),
        model is Model.FLAT_HIGH_INDEX,
    )
    assert model.rules.is_thin == (model is Model.THIN)
