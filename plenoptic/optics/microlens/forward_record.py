"""A microlens array as the numbers that kernels read, for light of one wavelength that travels forwards."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.record import ArrayRecord, LatticeRecord, ListedRecord, NumbersRecord, array_record


def forward_record(
    array: MicrolensArray, *, turn: Floats, origin: Floats, reach: float, wavelength: float
) -> ArrayRecord:
    """Record as `array_record`, with powers at the wavelength and listed lenses found by their lattice index."""
    record = array_record(array, turn=turn, origin=origin, reach=reach, margin=0.0, wavelengths=(wavelength,))
    if record.power_factors is not None:
        record = _strengthened(record, float(record.power_factors[0]))
    if record.listed is not None and record.listed.cells is None:
        record = record._replace(listed=record.listed._replace(numbers=_numbers(record.lattice, record.listed)))
    return record


def differs_forward(record: ArrayRecord) -> bool:
    """True if lenses differ or do not fill their cells."""
    return record.differs or not record.opening.fills


def _strengthened(record: ArrayRecord, factor: float) -> ArrayRecord:
    """Lenses whose power at the camera's wavelength is not that at 587.6 nm."""
    listed = record.listed
    if listed is not None:
        lenses = listed.lenses.copy()
        lenses["power"] *= factor
        listed = listed._replace(lenses=lenses)
    lattice = record.lattice._replace(powers=record.lattice.powers * factor)
    return record._replace(lattice=lattice, listed=listed, power_factors=None)


def _numbers(lattice: LatticeRecord, listed: ListedRecord) -> NumbersRecord:
    """Index from lattice numbers to the rows of listed lenses."""
    points = np.column_stack([listed.lenses["cell_x"], listed.lenses["cell_y"]])
    index = np.rint((points - lattice.origin) @ lattice.inverse).astype(np.int64)
    corner = index.min(axis=0)
    rows = np.full(index.max(axis=0) - corner + 1, -1, dtype=np.int64)
    rows[tuple((index - corner).T)] = np.arange(len(index))
    return NumbersRecord(corner, rows)
