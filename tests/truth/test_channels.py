"""Ground truth as a value: channels, void values, and names in files."""

import dataclasses
import operator
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.truth.channels import CHANNELS, NO_MICROLENS, GroundTruth, Truth, truth_names
from plenoptic.truth.truth_arrays import available_truth, empty_truth, file_comment, file_planes, truth_from_planes
from plenoptic.truth.truth_stages import PixelStages


def everything(rows=2, columns=3):
    rng = np.random.default_rng(5)
    arrays = {name: rng.uniform(-5, 5, (rows, columns, *kind.shape)) for name, kind in CHANNELS.items()}
    return GroundTruth(**{name: np.rint(a) if CHANNELS[name].dtype is np.int32 else a for name, a in arrays.items()})


def test_all_is_everything_and_each_array_has_a_kind_of_it():
    union = reduce(operator.or_, (kind.flag for kind in CHANNELS.values()))
    single_flags = [flag for flag in Truth if flag.value.bit_count() == 1]  # before Python 3.11 ALL is one of them too
    by_name = Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY | Truth.OPTICAL_DISTANCE | Truth.TRANSMITTANCE
    assert union == Truth.ALL | by_name == Truth(sum(single_flags))
    assert not Truth.ALL & by_name  # many rays a pixel, and what is known in air, for those who ask
    # Requested arrays are made.
    requested = Truth.NORMAL | Truth.MICROLENS
    arrays = empty_truth(requested, (4, 5))
    assert {name: (a.shape, a.dtype) for name, a in arrays.items()} == {
        "normal": ((4, 5, 3), np.float64),
        "microlens": ((4, 5, 2), np.int32),
        "microlens_type": ((4, 5), np.int32),
    }
    assert np.isnan(arrays["normal"]).all() and (arrays["microlens"] == NO_MICROLENS).all()
    assert GroundTruth(**arrays).kinds == requested
    assert empty_truth(Truth.NONE, (4, 5)) == {}
    bare = Truth.INCIDENCE_ANGLE | Truth.STATE
    assert available_truth(Truth.ALL, meshes=True, microlenses=True) == Truth.ALL
    assert available_truth(Truth.ALL, meshes=False, microlenses=True) == bare | Truth.MICROLENS
    assert available_truth(Truth.ALL, meshes=False, microlenses=False) == bare
    bare = available_truth(Truth.ALL, meshes=True, microlenses=False)
    assert bare == Truth.ALL & ~(Truth.MICROLENS | Truth.VIRTUAL_DEPTH | Truth.DISPARITY)
    assert truth_names(Truth.VIRTUAL_DEPTH | Truth.DEPTH) == "depth, virtual depth"


def test_impossible_arrays_are_refused_and_views_have_the_inverse_disparity():
    for arrays, sentence in (
        ({}, "a ground truth has no array; give it at least one, such as depth"),
        ({"depth": np.ones(3)}, r"depth has shape \(3,\); it must have shape \(rows, columns\)"),
        ({"depth": np.ones((2, 3)), "normal": np.ones((2, 2, 3))}, r"normal has shape \(2, 2, 3\)"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=sentence):
            GroundTruth(**arrays)
    # Disparity of views is that of microlenses upside down.
    truth = GroundTruth(disparity=[[2.0, -0.5, np.inf, np.nan]])
    np.testing.assert_array_equal(truth.view_disparity, [[0.5, -2.0, 0.0, np.nan]])
    assert GroundTruth(depth=[[1.0]]).view_disparity is None


def test_channels_survive_image_files():
    truth = everything()
    channels = file_planes(truth)
    assert len(channels) == sum(int(np.prod(kind.shape)) for kind in CHANNELS.values())
    assert all(plane.shape == (2, 3) for plane in channels.values())
    assert truth_from_planes(channels) == truth
    assert truth_from_planes({"depth.Z": truth.depth, "truth.normal.X": truth.depth}) == GroundTruth(depth=truth.depth)
    assert truth_from_planes({"Y": truth.depth}) is None
    for name in channels:
        assert name.rsplit(".", 1)[0] in file_comment(truth)
    # Single precision, in which files keep it, has the number of no microlens.
    assert int(np.float32(NO_MICROLENS)) == NO_MICROLENS == np.iinfo(np.int32).min
    # Files from before a channel have the others.
    del channels["truth.incidence_angle"]
    older = truth_from_planes(channels)
    assert older.kinds == truth.kinds & ~Truth.INCIDENCE_ANGLE
    assert older == dataclasses.replace(truth, incidence_angle=None)


def test_every_channel_names_what_fills_it_and_is_in_the_documents():
    text = (Path(__file__).parents[2] / "docs" / "conventions.md").read_text(encoding="utf-8")
    for name, channel in CHANNELS.items():
        assert callable(getattr(PixelStages, f"fill_{name}"))
        shape = ", ".join(["H", "W", *map(str, channel.shape)])
        meaning = f"{channel.meaning}, {channel.unit}" if channel.unit else channel.meaning
        void = "`NO_MICROLENS`" if channel.void == NO_MICROLENS else f"{channel.void:g}"
        files = ", ".join(f"`{plane}`" for plane in channel.in_files)
        kind = f"({shape}) {np.dtype(channel.dtype)}"
        assert f"| {channel.flag.name} | `{name}` | {kind} | {meaning} | {void} | {files} |\n" in text
