"""Renderings of fuzzed scenes by fuzzed cameras, and what must hold for each."""

import dataclasses
import warnings

import fuzzed_cameras
import fuzzed_scenes
import numpy as np
from fuzzed_numbers import chance, length, uniform
from honesty import counts_of

import plenoptic as pl
from plenoptic.truth.channels import CHANNELS, NO_MICROLENS

UNKNOWN = {name: kind.void for name, kind in CHANNELS.items()}
"""What stands for nothing in each array of the ground truth."""


@dataclasses.dataclass
class Case:
    """A call of `render`, or of `render_white` where there is no scene."""

    scene: pl.Scene | None
    camera: pl.PlenopticCamera
    options: dict

    def render(self):
        if self.scene is None:
            return pl.render_white(self.camera, progress=False, **self.options)
        return pl.render(self.scene, self.camera, progress=False, **self.options)


def some_cases(rnd, *, count, common=False):
    """Cases with the same camera, whose bounds take longest; for each, or for all, maybe the error that refuses it."""
    try:
        camera, scale = fuzzed_cameras.a_camera(rnd, common=common)
    except pl.PlenopticError as error:
        return [error]
    return [a_case(rnd, camera, scale, common=common) for _ in range(count)]


def a_case(rnd, camera, scale, *, common):
    try:
        options = some_options(rnd, camera.sensor.shape)
        if chance(rnd, 10):
            return Case(None, camera, options)
        kinds = fuzzed_scenes.COMMON if common else list(fuzzed_scenes.Kind)
        scene, kind = fuzzed_scenes.a_scene(rnd, camera, scale, kinds)
        if kind not in fuzzed_scenes.COLOURED:
            camera = dataclasses.replace(camera, sensitivity=None)
        return Case(scene, camera, options | more_options(rnd))
    except pl.PlenopticError as error:
        return error


def some_options(rnd, shape):
    """Options of `render` and `render_white`."""
    options = {"samples": rnd.randint(1, 40), "replicates": rnd.randint(1, 10), "seed": rnd.choice([0, 1, 2**64 - 1])}
    options |= {"sampler": rnd.choice(list(pl.rendering.Sampler)), "threads": rnd.choice([1, 1, 1, 2])}
    if chance(rnd, 4):
        row, column = rnd.randint(0, shape[0] - 1), rnd.randint(0, shape[1] - 1)
        options["region"] = np.s_[row : row + rnd.randint(1, 4), column:]
    if chance(rnd, 4):
        options["tile_side"] = rnd.randint(1, 9)
    if chance(rnd, 6):
        options["target_error"] = length(rnd, 0.1)
        options["replicates"] = rnd.randint(7, 10)  # 7 are too few
        options["samples"] = rnd.randint(1, 400)
    elif chance(rnd, 20):
        options["time_limit"] = uniform(rnd, 1e-6, 0.1)
        options["samples"] = rnd.choice([None, rnd.randint(1, 400)])
    return options


def more_options(rnd):
    """Options that `render` alone has."""
    return {
        "max_bounces": rnd.randint(0, 6),
        "caustics": rnd.choice(list(pl.rendering.Caustics)),
        "clamp": length(rnd, 1.0, spread=3.0) if chance(rnd, 4) else None,
        "truth": pl.Truth(rnd.randint(0, pl.Truth.ALL)),
    }


def check_refusal(error):
    """An error is a sentence: it says what is wrong in words."""
    assert len(str(error).split()) >= 4, repr(error)


def check_case(case, *, again):
    """The laws. Returns the exposure, or None where the package refused to make one."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)  # the package's own
        try:
            plan = pl.plan(case.scene, case.camera)
            shot = case.render()
        except pl.PlenopticError as error:
            check_refusal(error)
            return None
        assert len(str(plan).splitlines()) == len(pl.rendering.Stage)
        assert "Exposure" in repr(shot)
        check_image(case, shot)
        check_paths(case, shot)
        if shot.truth is not None:
            check_truth(shot.truth, counts_of(shot) > 0)
        if again and case.options.get("time_limit") is None:
            check_repeated(case, shot)
    return shot


def check_repeated(case, shot):
    """The same bits again; and no pixel is darker without a clamp, which only takes light away."""
    other = case.render()
    np.testing.assert_array_equal(shot.image, other.image)
    np.testing.assert_array_equal(shot.standard_error, other.standard_error)
    assert shot.truth == other.truth
    if case.options.get("clamp") is not None and case.options.get("target_error") is None:
        free = dataclasses.replace(case, options=case.options | {"clamp": None}).render()
        # float32
        assert (shot.image <= free.image * (1 + 1e-6)).all()


def check_image(case, shot):
    """Finite; not negative; errors that are known where there are two replicates."""
    assert np.isfinite(shot.image).all()
    assert (shot.image >= 0).all()  # all the sensitivities here are
    counts = counts_of(shot)
    if shot.standard_error is None:
        assert min(case.options["replicates"], shot.samples) < 2
    else:
        unknown = np.isinf(shot.standard_error).any(axis=-1)
        assert (counts[unknown] < 2).all()
        assert (shot.standard_error >= 0).all()


def check_paths(case, shot):
    """Every path has gone through the lens or is lost, none was dropped, and what ended it was asked for."""
    stats = shot.stats
    # Blocks of 8 x 8 pixels that the region cuts are rendered whole where errors are pooled.
    rows, columns = shot.image.shape[:2]
    assert stats.paths <= shot.samples * (rows + 14) * (columns + 14)
    assert stats.paths == stats.paths_through_lens + sum(count for *_, count in stats.lost)
    assert stats.nonfinite == 0
    asked = (
        "target_error" if stats.stopped_by is pl.rendering.StopReason.TARGET_MISSED else stats.stopped_by.name.lower()
    )
    assert case.options.get(asked) is not None
    if not stats.paths_through_lens:
        assert not shot.image.any()


def check_truth(truth, seen):
    """Finite or what stands for nothing, and in agreement with each other; nan where nothing was looked at."""
    arrays = truth.arrays()
    for name, array in arrays.items():
        assert array.dtype.kind != "f" or np.isnan(array[~seen]).all(), name
    found = {name: array[seen] for name, array in arrays.items()}
    for name, array in found.items():
        if array.dtype.kind == "f" and name not in ("virtual_depth", "disparity"):
            known = np.isfinite(array)
            assert np.array_equal(array[~known], np.full((~known).sum(), UNKNOWN[name]), equal_nan=True), name
    if "distance" in found:
        assert (found["distance"] >= 0).all()
    if "normal" in found:
        lengths = np.linalg.norm(found["normal"], axis=-1)
        # float64: some roundings.
        np.testing.assert_allclose(lengths[np.isfinite(lengths)], 1.0, rtol=1e-12)
    for name in ("object", "material", "microlens_type"):
        assert name not in found or (found[name] >= -1).all()
    met = [np.isfinite(a).reshape(len(a), -1).all(axis=-1) for n, a in found.items() if n in GEOMETRY and a.size]
    met += [found[name] >= 0 for name in ("object", "material") if name in found and found[name].size]
    assert all(np.array_equal(met[0], one) for one in met[1:])
    if "microlens" in found:
        unlit = (found["microlens"] == NO_MICROLENS).all(axis=-1)
        np.testing.assert_array_equal(unlit, found["microlens_type"] == -1)
    for name in ("virtual_depth", "disparity"):
        if name in found and met:
            assert np.isnan(found[name][~met[0]]).all(), name


GEOMETRY = ("depth", "distance", "position", "normal")
