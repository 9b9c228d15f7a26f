import math
import pickle

import pytest

import plenoptic as pl
from plenoptic.scene.file_cameras import View


def test_a_view_is_a_value():
    view = View("a", (0, 0, 1), (0, 0, 0), vertical_field_of_view=0.5)
    assert view == View("a", [0, 0, 1], [0, 0, 0], vertical_field_of_view=0.5) != View("a", (0, 0, 1), (0, 0, 0))
    assert pickle.loads(pickle.dumps(view)) == view and not view.position.flags.writeable
    for change, said in (
        ({"look_at": (0, 0, 1)}, "look_at is the position"),
        ({"up": (0, 0, 2)}, "along the view"),
        ({"up": (0, 0, 0)}, "along the view"),
        ({"position": (0, math.nan, 1)}, "position.*finite"),
        ({"vertical_field_of_view": math.pi}, "below pi"),
        ({"vertical_field_of_view": 0.0}, "above 0"),
        ({"aspect_ratio": -1.0}, "aspect_ratio is -1"),
        ({"name": 3}, "name is 3"),
    ):
        given = {"name": "a", "position": (0, 0, 1), "look_at": (0, 0, 0), "up": (0, 1, 0)} | change
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            View(**given)
