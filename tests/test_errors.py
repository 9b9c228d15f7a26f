import pickle

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import errors

KINDS = [errors.InvalidValueError, errors.PrescriptionError, errors.SceneError, errors.FileError]


def test_every_error_is_the_packages_own_and_pythons_and_survives_pickling():
    sentence = "radius is 0 mm; it must not be 0"
    for kind in KINDS:
        assert issubclass(kind, errors.PlenopticError)
        assert str(pickle.loads(pickle.dumps(kind(sentence)))) == sentence
    assert issubclass(errors.PrescriptionError, ValueError) and issubclass(errors.SceneError, ValueError)
    assert issubclass(errors.FileError, OSError)


def test_what_is_no_path_no_flag_and_no_number_is_refused():
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
