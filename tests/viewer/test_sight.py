"""Chief rays as a polynomial: it sees points where `project` does."""

import dataclasses
import sys
from pathlib import Path

import numpy as np

import plenoptic as pl
from plenoptic.viewer.sight import sight

sys.path.insert(0, str(Path(__file__).parent))
from looking import camera_of

CAMERA = camera_of(300, 300, focal_lengths=(2.0,))
POINTS = np.array([[0.0, 0.0, -404.0], [3.0, -2.0, -380.0], [-4.0, 3.0, -450.0], [2.0, 4.0, -404.0]])


def test_points_are_seen_where_project_sees_them():
    pinholes = dataclasses.replace(CAMERA.microlenses, model=pl.optics.MicrolensModel.PINHOLE)
    for name, camera in (
        ("as designed", CAMERA),
        ("tilted sensor", CAMERA.moved(pl.CameraPart.SENSOR, tilt=(0.01, 0.02, 0.1))),
        ("displaced lens", CAMERA.moved(pl.CameraPart.LENS, shift=(0.3, 0.0, 0.1), tilt=(0.01, 0.0, 0.0))),
        ("Keplerian", dataclasses.replace(CAMERA, microlenses_to_sensor=2.3)),
        ("pinholes", dataclasses.replace(CAMERA, microlenses=pinholes)),
    ):
        found = sight(camera, pl.microlens_centres(camera), np.array([380.0, 404.0, 450.0]))
        assert found is not None and found.error < 0.02, name
        seen = pl.project(camera, POINTS)
        seen = seen.selected(seen.passes)
        centres = pl.microlens_centres(camera, margin=1.0)
        place = {tuple(index): k for k, index in enumerate(centres.index.tolist())}
        rows = [k for k, index in enumerate(seen.index.tolist()) if tuple(index) in place]
        on_array = centres.on_array[[place[tuple(seen.index[k])] for k in rows]]
        # A step of Newton's from where they are leads nowhere else.
        off = found.beside(POINTS[seen.point[rows]], seen.pixel[rows], on_array)
        assert len(rows) > 60 and np.abs(off).max() < 0.1, name


def test_there_is_none_without_microlenses_or_points():
    centres = pl.microlens_centres(CAMERA)
    bare = dataclasses.replace(CAMERA, microlenses=None, microlenses_to_sensor=0.0)
    assert sight(bare, centres, np.array([404.0])) is None and sight(CAMERA, centres, np.empty(0)) is None
