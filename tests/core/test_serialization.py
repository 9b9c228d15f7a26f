import enum
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import plenoptic
from plenoptic.core.files.serialization import describe, restore
from plenoptic.core.values import frozen_array, set_field, value
from plenoptic.errors import FileError, InvalidValueError


class Weave(enum.IntEnum):
    PLAIN = 0
    TWILL = 1


@value
class Cloth:
    weave: Weave
    threads: np.ndarray
    parts: tuple = ()
    area: float = 0.0

    def __post_init__(self):
        set_field(self, "threads", frozen_array(self.threads, name="threads", shape=(None, 2)))
        if self.area < 0:
            raise InvalidValueError(f"area is {self.area}; it must be at least 0")


class NotAValue:
    made = 0

    def __init__(self, **_):
        NotAValue.made += 1


@pytest.fixture
def public(monkeypatch):
    """Two kinds of values and a plain class, as if this package made them public."""
    for kind in (Weave, Cloth, NotAValue):
        monkeypatch.setattr(kind, "__module__", "plenoptic.cloth")
        monkeypatch.setattr(plenoptic, kind.__name__, kind, raising=False)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text()


@given(st.recursive(scalars, lambda inner: st.lists(inner, max_size=4).map(tuple)))
def test_plain_values_come_back_exactly(given_value):
    again = restore(describe(given_value))
    assert repr(again) == repr(given_value)  # unlike ==, tells -0.0 from 0.0, 1 from 1.0, and finds nan the same


def test_numbers_and_arrays_come_back_exactly():
    for number in (0.1, -0.0, 5e-324, 1.7976931348623157e308, math.inf, -math.inf, math.nan):
        again = np.float64(restore(describe(number)))
        assert again.view(np.uint64) == np.float64(number).view(np.uint64), number
    for array in (
        np.array([[1.5, -0.0, np.inf], [np.nan, 0.1, -np.inf]]),
        np.array([0.1, 1e38, np.nan], dtype=np.float32),
        np.array(7),
        np.zeros((0, 3)),
        np.array([True, False]),
        np.array([0, 2**64 - 1], dtype=np.uint64),
        np.arange(6, dtype=np.int8).reshape(3, 2).T,
    ):
        again = restore(describe(array))
        assert again.dtype == array.dtype and again.shape == array.shape, array
        assert again.tobytes() == array.tobytes(), array
    # Scalars of NumPy become Python's.
    assert restore(describe((np.float64(0.1), np.int32(3), np.bool_(True)))) == (0.1, 3, True)


def test_values_and_enums_come_back(public):
    cloth = Cloth(Weave.TWILL, [[0.1, np.nan]], parts=(None, Cloth(Weave.PLAIN, [[1, 2]]), "é"), area=math.inf)
    text = describe(cloth)
    again = restore(text)
    assert again == cloth and type(again.weave) is Weave and not again.threads.flags.writeable

    def refuse(constant):
        raise AssertionError(constant)

    assert text.isascii()
    json.loads(text, parse_constant=refuse)  # strict
    # A value is found wherever it is public.
    pane = plenoptic.materials.ThinGlass()
    assert not hasattr(plenoptic, "ThinGlass") and restore(describe(pane)) == pane
    # Renamed members of enums in older files.
    assert restore('{"enum": ["Caustics", "LEFT_OUT"]}') is plenoptic.rendering.Caustics.EXCLUDE
    with pytest.raises(FileError, match="'Pane' is no value of this package"):
        restore(describe(pane).replace("ThinGlass", "Pane"))


def test_what_cannot_be_described(request):
    with pytest.raises(InvalidValueError, match="Cloth cannot be described in a file: it is no public value"):
        describe(Cloth(Weave.PLAIN, [[1, 2]]))
    request.getfixturevalue("public")
    for thing in (object(), {1: 2}, [1], 1j, np.array([1j]), np.array(["a"]), Cloth, len):
        with pytest.raises(InvalidValueError, match="cannot be described in a file"):
            describe(thing)


def test_what_cannot_be_restored(public):
    values = ['"Unknown", {}', '"NotAValue", {}', '"__class__", {}', '"errors.FileError", {}', '["Cloth"], {}']
    values += ['"Cloth", 5', '"Cloth", {}', '"Cloth", {"colour": 1}']
    enums = ['["Weave", "SATIN"]', '["Cloth", "PLAIN"]', '"Weave"']
    arrays = [("object", [1], [1]), ("float64", [2], [1]), ("int8", [1], [300])]
    for text in (
        *("not json", "{}", '{"float": "inf", "enum": []}', '{"object": 1}', "[" * 100_000),
        *(f'{{"value": [{inside}]}}' for inside in values),
        *(f'{{"enum": {inside}}}' for inside in enums),
        *(json.dumps({"array": dict(zip(("dtype", "shape", "values"), array, strict=True))}) for array in arrays),
    ):
        constructed = NotAValue.made
        with pytest.raises(FileError, match="a description cannot be understood"):
            restore(text)
        assert NotAValue.made == constructed, text
    # A value that cannot be says why.
    text = describe(Cloth(Weave.PLAIN, [[1, 2]], area=1.0)).replace("1.0}", "-1.0}")
    with pytest.raises(FileError, match="area is -1.0; it must be at least 0"):
        restore(text)


def test_entries_about_a_value_must_be_json(tmp_path):
    for about in ("text", 3, [], {1: "a"}, {"a": object()}, {"a": float("nan")}, {"a": {1, 2}}):
        with pytest.raises(InvalidValueError, match="^about is .*; it must be a mapping of names to"):
            plenoptic.package.save_value(plenoptic.Sensor((4, 4), 0.01), tmp_path / "value.json", about=about)
    assert not any(tmp_path.iterdir())
