import pickle

import pytest

from plenoptic import errors

KINDS = [errors.InvalidValueError, errors.PrescriptionError, errors.SceneError, errors.FileError]


@pytest.mark.parametrize("kind", KINDS)
def test_every_error_is_caught_as_the_packages_own(kind):
    assert issubclass(kind, errors.PlenopticError)


def test_errors_are_also_what_python_calls_them():
    assert issubclass(errors.PrescriptionError, ValueError)
    assert issubclass(errors.SceneError, ValueError)
    assert issubclass(errors.FileError, OSError)


@pytest.mark.parametrize("kind", KINDS)
def test_the_sentence_survives_pickling(kind):
    sentence = "radius is 0 mm; it must not be 0"
    assert str(pickle.loads(pickle.dumps(kind(sentence)))) == sentence
