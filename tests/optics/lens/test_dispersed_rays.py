"""Rays with wavelengths of their own: each goes exactly as all do at its wavelength."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.lens.kernels.trace import fill_traced
from plenoptic.optics.lens.lens_record import lens_record

WAVELENGTHS = np.array([450.0, 486.1, 546.1, 587.6, 656.3])
GAUSS = pl.load_lens("double-gauss-100mm-f2")


def shaped() -> pl.LensStack:
    elements = list(GAUSS.elements)
    elements[0] = dataclasses.replace(elements[0], conic=-0.3)
    elements[3] = dataclasses.replace(elements[3], aspheric=(0.0, 1e-7))
    return dataclasses.replace(GAUSS, elements=tuple(elements))


FRONT = pl.Surface(-120.0, 8.0, pl.glass("N-BK7"), semi_diameter=16.0)
BACK = pl.Surface(-180.0, 8.0, pl.optics.MIRROR, semi_diameter=16.0)
MANGIN = pl.LensStack([pl.CircularStop(12.0, thickness=5.0), FRONT, BACK, pl.Surface(120.0, semi_diameter=16.0)])

LENSES = {"double gauss": GAUSS, "conic and asphere": shaped(), "Mangin mirror": MANGIN}
LENSES |= {"moved": shaped().moved(2, shift=(0.1, 0.0, 0.0), tilt=(0.0, 0.01, 0.0))}
LENSES |= {"paraxial": GAUSS.with_model(pl.LensModel.PARAXIAL), "thin": GAUSS.with_model(pl.LensModel.THIN)}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "moved")) for name in LENSES])
def test_dispersed_rays_are_monochrome_rays_together(name: str):
    for reverse in (True, False):
        lens, rng = LENSES[name], np.random.default_rng(3)
        n = 4 * BLOCK
        z = float(lens.vertices[-1]) + 60.0 if reverse else float(lens.vertices[0]) - 400.0
        start = np.column_stack([rng.uniform(-5, 5, (n, 2)), np.full(n, z)])
        aim = np.column_stack([rng.uniform(-12, 12, (n, 2)), np.zeros(n)])
        direction = (aim - start) / np.linalg.norm(aim - start, axis=1)[:, None]
        rows = np.zeros((8, n))
        rows[:3], rows[3:6], rows[6] = start.T, direction.T, 1.0
        blocks = np.ascontiguousarray(rows.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        waves = rng.integers(0, len(WAVELENGTHS), n)
        together = blocks.copy()
        fill_traced(together.reshape(-1), lens_record(lens, WAVELENGTHS, reverse=reverse), waves)
        passed = 0
        for number, wavelength in enumerate(WAVELENGTHS):
            alone = blocks.copy()
            record = lens_record(lens, float(wavelength), reverse=reverse)
            if lens.model is not pl.LensModel.EXACT:
                # Ideal lenses have their principal planes and pupils where the first wavelength has them.
                first = lens_record(lens, float(WAVELENGTHS[0]), reverse=reverse)
                first.rows["curvature"] = record.rows["curvature"]
                record = first
            fill_traced(alone.reshape(-1), record, None)
            mine = (waves == number).reshape(-1, BLOCK)
            a, b = together.transpose(1, 0, 2)[:, mine], alone.transpose(1, 0, 2)[:, mine]
            assert np.array_equal(a[7], b[7]), (name, reverse)
            good = a[7] == 0
            passed += int(good.sum())
            # The same formulas, compiled twice: fused differently in places, so that some units of rounding of
            # coordinates up to 100 mm and of angles remain, and what the asphere's iteration leaves.
            assert np.abs(a[:6, good] - b[:6, good]).max() < 1e-12, (name, reverse)
        assert passed > n // 10, (name, reverse)
