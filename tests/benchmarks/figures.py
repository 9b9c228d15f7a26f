"""What rough surfaces lose, by angle and roughness: a table of docs/validation.md."""

import sys
from pathlib import Path

import numpy as np
from table import Table

import plenoptic as pl

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / name) for name in ("scene", "scene/materials")]
import test_bsdf as bsdf  # noqa: E402

ALPHAS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
ANGLES_DEG = (0.0, 60.0, 84.0)
MEAN_OVER = 128


def tables(*, quick):
    metal, glass = ([f"{name}, {a:.0f} degrees" for a in ANGLES_DEG] for name in ("metal", "glass"))
    drawn = 1 << (12 if quick else 17)
    remark = f"Per cent of all light, by {drawn} drawn directions each. The mean is weighed by the cosine."
    rows = [(alpha, *losses(alpha, drawn)) for alpha in ALPHAS[:: 3 if quick else 1]]
    yield Table("What rough surfaces lose", ("alpha", *metal, "mean", *glass), rows, [remark])


def losses(alpha, n):
    """Per cent: of metal by angles and on average, of glass by angles."""

    def lost(material, angles, n):
        return [100 * (1 - float(bsdf.returned(material, bsdf.towards(angle), n)[0][0])) for angle in angles]

    metal, glass = pl.Conductor(alpha=alpha), pl.Dielectric(1.5, alpha=alpha)
    angles = np.degrees(np.arccos(np.sqrt((np.arange(MEAN_OVER) + 0.5) / MEAN_OVER)))
    mean = float(np.mean(lost(metal, angles, n // 16)))
    return *lost(metal, ANGLES_DEG, n), mean, *lost(glass, ANGLES_DEG, n)
