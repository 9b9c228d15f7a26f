import copy
import dataclasses
import enum
import math
import pickle

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.values import (
    broadcast,
    choice,
    finite,
    frozen_array,
    length_in_mm,
    number,
    positions,
    positive,
    read_only,
    set_field,
    value,
    whole,
)
from plenoptic.errors import InvalidValueError


@value
class Plate:
    corners: np.ndarray
    index: float = 1.5
    label: str | None = None

    def __post_init__(self):
        set_field(self, "corners", frozen_array(self.corners, name="corners", shape=(None, 2)))


class Side(enum.IntEnum):
    LEFT = 0
    RIGHT = 1


@value
class Named:
    name: str

    def __repr__(self):
        return f"<{self.name}>"


def plate(**changes):
    return Plate(**{"corners": [[0, 1], [2, np.nan]], **changes})


def test_equal_values_are_equal_and_hash_alike():
    assert plate() == plate() and hash(plate()) == hash(plate())
    assert len({plate(), plate(), plate(index=1.6)}) == 2
    for change in ({"corners": [[0, 1]]}, {"corners": [[0, 1], [2, 3]]}, {"index": 1.6}, {"label": "x"}):
        assert plate() != plate(**change) and plate() != dataclasses.replace(plate(), **change), change
    positive_zero, negative_zero = Plate([[0.0, 1]]), Plate([[-0.0, 1]])
    assert positive_zero == negative_zero and hash(positive_zero) == hash(negative_zero)
    assert plate() != Named("plate") and plate() != "plate"
    assert choice(1, Side, "side") is choice(Side.RIGHT, Side, "side") is Side.RIGHT


def test_arrays_are_read_only_copies():
    corners = np.zeros((1, 2))
    value = Plate(corners)
    corners[0, 0] = 7
    assert value.corners[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        value.corners[0, 0] = 1
    view = read_only(corners)
    assert corners.flags.writeable and not view.flags.writeable and np.shares_memory(corners, view)


def test_copies_are_equal_and_stay_read_only():
    for copied in [copy.copy, copy.deepcopy, lambda made: pickle.loads(pickle.dumps(made))]:
        again = copied(plate())
        assert again == plate() and hash(again) == hash(plate()) and not again.corners.flags.writeable, copied
        with pytest.raises(dataclasses.FrozenInstanceError):
            again.index = 2.0


def test_repr_is_short_and_leaves_defaults_out():
    assert repr(plate()) == "Plate(corners=[[0.0, 1.0], [2.0, nan]])"
    assert repr(plate(label="left")) == "Plate(corners=[[0.0, 1.0], [2.0, nan]], label='left')"
    assert repr(plate(corners=np.zeros((5, 2)))) == "Plate(corners=<5 x 2 float64>)"
    assert repr(plate(corners=np.zeros((0, 2)))) == "Plate(corners=<0 x 2 float64>)"
    assert repr(plate(corners=[[-0.0, 0.1 + 0.2], [486.09999999999997, math.inf]])) == (
        "Plate(corners=[[0.0, 0.3], [486.1, inf]])"
    )
    assert repr(plate(label=(-0.0, [0.1 + 0.2]))) == "Plate(corners=[[0.0, 1.0], [2.0, nan]], label=(0.0, [0.3]))"
    assert repr(Named("left")) == "<left>"


def test_what_cannot_be_is_named():
    for check, sentence in [
        (lambda: finite(np.inf, "gap"), "gap is inf; it must be finite"),
        (lambda: finite("wide", "gap"), "gap is 'wide'; it must be a number"),
        (lambda: finite(10**400, "gap"), "gap is 1000.*; it must be a number"),
        (lambda: positive(0, "pitch", "mm"), "pitch is 0 mm; it must be above 0"),
        (lambda: whole(True, "samples", at_least=1), "samples is True; it must be a whole number"),
        (lambda: whole(0, "samples", at_least=1), "samples is 0; it must be at least 1"),
        (lambda: frozen_array([1, 2], name="axis", shape=(3,)), r"axis has shape \(2,\); it must have shape \(3,\)"),
        (lambda: frozen_array([1], name="a", shape=("rows", 3)), r"a has shape \(1,\); it must have shape \(rows, 3\)"),
        (lambda: number(None, "z"), "z is None; it must be a number"),
        (lambda: choice("left", Side, "side"), "side is 'left'; it must be Side.LEFT or Side.RIGHT"),
        (lambda: choice([], Side, "side"), r"side is \[\]; it must be Side.LEFT or Side.RIGHT"),
        (lambda: frozen_array(["a"], name="axis", shape=(1,)), "axis is not an array of numbers"),
        (lambda: frozen_array([300], name="mask", shape=(1,), dtype=np.uint8), "mask must hold whole numbers, from 0"),
        (lambda: frozen_array([1j], name="axis", shape=(1,)), "axis is not an array of numbers: .* complex128"),
        (lambda: frozen_array([None], name="axis", shape=(1,)), "an item of axis is None; it must be a number"),
        (lambda: frozen_array([[1], [2, 3]], name="axis", shape=(1,)), "axis is not an array of numbers"),
        (lambda: frozen_array([1.0, 2**63], name="axis", shape=(2,), dtype=np.int64), "axis must hold whole numbers"),
        (lambda: whole(np.uint64(2**64 - 1), "rows", at_least=1), "rows is 18446744073709551615; it must be at most"),
        (lambda: whole(np.timedelta64(5, "s"), "rows", at_least=1), "rows is .*; it must be a whole number"),
        (lambda: length_in_mm(1e-300, "pitch"), "pitch is 1e-300 mm; it must be from 1e-15 to 1e\\+15 mm"),
        (lambda: positions([0, 1e38, 0], name="shift", shape=(3,)), "shift holds 1e\\+38 mm, which is not finite"),
        (lambda: broadcast(x=[1, 2], y=[1, 2, 3]), r"the shapes of x \(2,\) and y \(3,\) do not fit"),
    ]:
        with pytest.raises(InvalidValueError, match=sentence):
            check()


def test_members_of_choices_are_numbered_without_a_gap():
    enums = [getattr(room, name) for room in (pl.optics, pl.sensor) for name in dir(room) if not name.startswith("_")]
    kinds = [kind for kind in enums if isinstance(kind, enum.EnumType) and issubclass(kind, enum.IntEnum)]
    assert len(kinds) >= 12
    for kind in [*kinds, pl.LensModel, pl.RayStatus]:
        first, *_ = numbers = [int(member) for member in kind]
        assert numbers == list(range(first, first + len(kind))) and first in (0, 1), kind
