"""Zernike polynomials beside prysm's (B. Dube), and fits of wavefronts beside sums of those."""

import numpy as np
import pytest
from in_rayoptics import LENSES

import plenoptic as pl
from plenoptic.aberrations import ZernikeOrder, wavefront, zernike

polynomials = pytest.importorskip("prysm.polynomials", reason="the extra `validation` installs it")

pytestmark = pytest.mark.validation


def theirs(term, x, y, order):
    place = polynomials.noll_to_nm(term) if order is ZernikeOrder.NOLL else polynomials.fringe_to_nm(term)
    if (order, term) == (ZernikeOrder.FRINGE, 37):
        place = (12, 0)  # Arizona's; prysm goes on with (6, 6)
    return polynomials.zernike_nm(*place, np.hypot(x, y), np.arctan2(y, x), norm=order is ZernikeOrder.NOLL)


@pytest.mark.parametrize("order", ZernikeOrder)
def test_polynomials(order):
    x, y = pl.aiming.square_grid(20).T
    for term in range(1, 92 if order is ZernikeOrder.NOLL else 38):
        np.testing.assert_allclose(
            zernike(term, x, y, order=order), theirs(term, x, y, order), atol=1e-10, err_msg=str(term)
        )


@pytest.mark.parametrize("part", [0.0, 0.7, 1.0])
@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)
def test_coefficients(lens, part):
    """To 1e-6 waves, and 1e-9 of the largest difference."""
    found = wavefront(lens, field=(0.0, part * 40.0), z_object=-2500.0, pupil=pl.aiming.square_grid(32))
    for order in ZernikeOrder:
        fit = found.zernike(37, order=order)
        table = np.stack([theirs(j, *found.pupil.T, order) for j in range(1, 38)], axis=1)
        expected = np.linalg.lstsq(table, found.opd, rcond=None)[0]
        np.testing.assert_allclose(fit.coefficients, expected, rtol=0, atol=1e-6 + 1e-9 * np.abs(found.opd).max())
