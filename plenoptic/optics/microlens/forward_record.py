"""Record of a microlens array for kernels that trace light of one wavelength forwards."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.microlens_record import (
    ArrayRecord,
    LatticeIndex,
    LatticeRecord,
    LensTable,
    array_record,
)


def forward_record(
    array: MicrolensArray, *, turn: Floats, origin: Floats, reach: float, wavelength: float
) -> ArrayRecord:
    """`array_record` for forward light: powers at the wavelength, and lenses found by their lattice index."""
    record = array_record(array, turn=turn, origin=origin, reach=reach, margin=0.0, wavelengths=(wavelength,))
    if record.power_factors is not None:
        record = _scale_powers(record, float(record.power_factors[0]))
    if record.lens_table is not None and record.lens_table.cells is None:
        record = record._replace(
            lens_table=record.lens_table._replace(lattice_index=_index_table(record.lattice, record.lens_table))
        )
    return record


def differs_forward(record: ArrayRecord) -> bool:
    """True if lenses differ, do not fill their cells, or end at an extent."""
    return record.differs or not record.opening.fills or record.lattice.extent is not None


def _scale_powers(record: ArrayRecord, factor: float) -> ArrayRecord:
    """Scale the powers of lenses from 587.6 nm to the camera's wavelength."""
    lens_table = record.lens_table
    if lens_table is not None:
        lenses = lens_table.lenses.copy()
        lenses["power"] *= factor
        lens_table = lens_table._replace(lenses=lenses)
    lattice = record.lattice._replace(powers=record.lattice.powers * factor)
    return record._replace(lattice=lattice, lens_table=lens_table, power_factors=None)


def _index_table(lattice: LatticeRecord, lens_table: LensTable) -> LatticeIndex:
    """Table of the rows of lenses by their lattice index."""
    points = np.column_stack([lens_table.lenses["cell_x"], lens_table.lenses["cell_y"]])
    index = np.rint((points - lattice.origin) @ lattice.inverse).astype(np.int64)
    corner = index.min(axis=0)
    rows = np.full(index.max(axis=0) - corner + 1, -1, dtype=np.int64)
    rows[tuple((index - corner).T)] = np.arange(len(index))
    return LatticeIndex(corner, rows)
