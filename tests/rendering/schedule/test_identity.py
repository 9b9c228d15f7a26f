"""Identities that distinguish renders, equal in every process."""

import dataclasses
import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.files.digest import digest
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite
from plenoptic.rendering.schedule.identity import differences, identity


def camera(**changes):
    return dataclasses.replace(pl.camera.example_camera(), **{"sensor": pl.Sensor((8, 8), 0.010), **changes})


def rich_scene(*, colour=0.25, radiance=2.0, texel=0.5, place=3.0, corner=0.0):
    """The record of a scene with a bit of all that there can be."""
    texture = pl.Texture(np.full((2, 2, 3), texel, dtype=np.float32))
    quad = pl.quad((corner, 0, -400), (9, 0, 0), (0, 9, 0), material=pl.Lambertian(texture))
    glass = pl.sphere(2.0, center=(0, 0, -300), material=pl.Dielectric(1.5))
    many = pl.scene.Instances(pl.box(1.0, material=pl.Lambertian(colour)), [np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    point = pl.lights.PointLight((place, 0, -100), intensity=3.0)
    lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (4, 4), radiance=5)
    return pl.Scene([quad, glass, many], [point, lamp], pl.EnvironmentMap(np.full((2, 4, 3), radiance))).tables()


def test_identities_are_the_same_in_every_process():
    rich = rich_scene(), camera(sensitivity=pl.sensitivities.colour_camera())
    one = identity(*rich, seed=1)
    assert all(isinstance(text, str) and len(text) <= 80 for text in one.values())
    assert one == identity(rich_scene(), rich[1], seed=1) == identity(*pickle.loads(pickle.dumps(rich)), seed=1)
    code = "import json, pickle, sys; from plenoptic.rendering.schedule.identity import identity; "
    code += "print(json.dumps(identity(*pickle.load(sys.stdin.buffer), seed=1)))"
    environment = {**os.environ, "PYTHONHASHSEED": "1"}  # sets and hashes have another order there
    process = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(rich), env=environment, capture_output=True
    )
    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout) == one


def test_another_scene_is_another_identity():
    one, none = identity(rich_scene(), camera()), identity(None, camera())
    changes = {"colour": np.nextafter(0.25, 1), "radiance": 2.5, "texel": 0.75, "place": np.nextafter(3.0, 4)}
    for name, value in [*changes.items(), ("corner", 1e-300), ("corner", -0.0)]:
        assert list(differences(one, identity(rich_scene(**{name: value}), camera()))) == ["another scene"], name
    assert list(differences(one, none)) == ["another scene"] == list(differences(none, one))


CAMERAS = {
    "lens": pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.5)),
    "sensor": pl.Sensor(shape=(8, 9), pixel_pitch=0.010),
    "microlenses": pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0, 2.1)),
    "pose": pl.Pose(np.eye(3), (0, 0, 1)),
    "lens_placement": pl.optics.Placement(shift=(0, 0.1, 0)),
    "blemishes": (Blemishes(BlemishSite.SENSOR, start=[(0, 0)], end=[(0, 0)], radius=[0.1], transmission=[0.25]),),
    "sensitivity": pl.sensitivities.colour_camera(),
}


def test_another_camera_is_another_identity():
    one = identity(None, camera())
    for name, part in CAMERAS.items():
        assert list(differences(one, identity(None, camera(**{name: part})))) == [f"another camera.{name}"]
    # Its lengths are named.
    other = identity(None, camera(stop_to_microlenses=123.25, wavelength=550.0))
    assert list(differences(one, other)) == [
        "camera.stop_to_microlenses 123.3, not 123.25",
        "camera.wavelength 587.6, not 550.0",
    ]


class Water:
    """A medium of a user, which cannot be described in a file."""

    def __init__(self, n):
        self.n = n

    def index(self, wavelength):
        return self.n + 1e-4 * (wavelength == 486.0)


def test_media_of_users_count_by_their_indices():
    def wet(n, **changes):
        first, *rest_of_lens = camera().lens.elements
        lens = pl.LensStack([dataclasses.replace(first, medium=Water(n)), *rest_of_lens])
        return identity(None, camera(lens=lens, **changes))

    assert wet(1.63) == wet(1.63)
    assert list(differences(wet(1.63), wet(1.64))) == ["another camera.lens"]
    # Their indices count at all wavelengths of the camera.
    lines = pl.sensor.Sensitivity.lines((640.0, 550.0, 486.0))
    assert wet(1.63, sensitivity=lines)["camera.lens"] != wet(1.63)["camera.lens"]


def test_digests_tell_apart_what_looks_alike():
    zeros = np.zeros(4)
    values = [
        *(zeros, zeros.reshape(2, 2), zeros.astype(np.int64), zeros[:2], -zeros, zeros.astype(np.complex128)[:2]),
        *(0, 0.0, -0.0, False, None, "", "0", "None", (), (0,), (0, ()), ((0,), ()), ("a", "b"), ("ab", ""), ("ab",)),
        *(
            pl.rendering.Sampler.SOBOL,
            pl.rendering.Caustics.INCLUDE,
            pl.lights.PointLight((0, 0, 0), 1.0),
            pl.optics.AIR,
        ),
    ]
    assert len({digest(value) for value in values}) == len(values)
    # How numbers lie in memory is not part of them.
    assert digest(np.arange(6.0).reshape(2, 3).T) == digest(np.arange(6.0).reshape(2, 3).T.astype(">f8", order="C"))


def test_facts_are_texts():
    facts = {"seed": np.int64(3), "clamp": None, "region": (0, 8, 0, 4), "sampler": pl.rendering.Sampler.RANDOM}
    facts |= {"error": 0.1, "far": (1.0, (2, np.zeros(3))), "settings": pl.rendering.RenderSettings(max_bounces=2)}
    texts = identity(None, camera(), **facts)
    expected = {"seed": "3", "clamp": "None", "region": "(0, 8, 0, 4)", "sampler": "RANDOM", "error": "0.1"}
    expected |= {"settings.max_bounces": "2", "settings.caustics": "INCLUDE", "settings.clamp": "None"}
    expected |= {
        "settings.sampler": "SOBOL",
        "settings.ghosts": "None",
        "far": texts["far"],
        "plenoptic": pl.__version__,
    }
    assert {name: text for name, text in texts.items() if "camera" not in name and name != "scene"} == expected
    assert texts["far"].startswith("sha256:")


def test_facts_that_cannot_be_told_apart_are_refused():
    with pytest.raises(pl.errors.InvalidValueError, match="an? object has no digest"):
        identity(None, camera(), other=(object(),))
    with pytest.raises(pl.errors.InvalidValueError, match="leave out checkpoint="):
        identity(None, camera(), settings=dataclasses.make_dataclass("Own", [("x", object)])(object()))
