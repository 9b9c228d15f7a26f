"""Zernike polynomials beside prysm's (B. Dube), and fits of wavefronts beside sums of those."""

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import ZernikeOrder, zernike

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
