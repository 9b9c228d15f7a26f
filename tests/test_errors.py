import pickle

import numpy as np
import pytest

import plenoptic as pl
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


def test_what_is_no_path_no_flag_and_no_number_is_refused(tmp_path):
    image = np.ones((2, 2, 1))
    for call, kind in (
        (lambda: pl.Exposure.load(None), pl.errors.FileError),
        (lambda: pl.Exposure(image).save(5), pl.errors.FileError),
        (lambda: pl.images.read_linear(None), pl.errors.FileError),
        (lambda: pl.Emissive(1.0, two_sided="no"), pl.errors.InvalidValueError),
        (lambda: pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 1, 0), two_sided=[1]), pl.errors.InvalidValueError),
        (lambda: pl.Mesh(np.eye(3), [[0, 1, 2]], name=[]), pl.errors.InvalidValueError),
        (lambda: pl.Scene(meshes=np.array(1.0)), pl.errors.InvalidValueError),
        (lambda: pl.RayBundle(np.zeros((1, 3)), [[0, 0, 1.0]], weight=[np.nan]), pl.errors.InvalidValueError),
        (lambda: pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), index="x"), pl.errors.InvalidValueError),
        (lambda: pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), index=None), pl.errors.InvalidValueError),
    ):
        with pytest.raises(kind):
            call()
