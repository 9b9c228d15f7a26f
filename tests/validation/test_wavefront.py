"""Optical path differences beside rayoptics (M. Hayford), ray by ray, with the same reference sphere."""

import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
from in_rayoptics import LENSES, WAVELENGTH, model  # noqa: E402

tracing = pytest.importorskip("rayoptics.raytr.trace", reason="the extra `validation` installs it")

Z_OBJECT, FIELD = -2500.0, 40.0
"""mm: rayoptics has objects at infinity at a large distance, which rounds."""

pytestmark = [pytest.mark.validation, pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)]


@pytest.mark.parametrize("part", [0.0, 0.7, 1.0])
def test_path_differences(lens, part):
    """Rays through 0.7 of the opening, which pass. Hopkins' formulas, theirs, leave some 1e-4 of the difference."""
    made = model(lens, part * FIELD, Z_OBJECT)
    place, wave, focus = made["optical_spec"].lookup_fld_wvl_focus(1)
    stop, theirs = [], []
    for point in 0.7 * pl.aiming.square_grid(8):
        ray, _, _, difference = tracing.trace_with_opd(made, np.array(point), place, wave, focus)
        stop.append(ray[made["seq_model"].stop_surface][0][:2])
        theirs.append(difference / (1e-6 * WAVELENGTH))
    pupil = np.array(stop) / lens.stop.semi_diameter
    # Its heights are those of rays that rise towards the lens.
    where = {"field": (0.0, -part * FIELD), "z_object": Z_OBJECT, "wavelength": WAVELENGTH}
    ours = pl.aberrations.wavefront(lens, pupil=pupil, **where)
    kept = [np.flatnonzero((pupil == at).all(axis=1))[0] for at in ours.pupil]
    theirs = np.array(theirs)[kept]
    assert len(kept) > 20
    np.testing.assert_allclose(ours.opd, theirs, rtol=0, atol=1e-3 + 3e-4 * np.abs(theirs).max())
