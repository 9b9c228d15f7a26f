"""Fit the dispersion of `ModelGlass` to the bundled catalogues; prints its coefficients and its errors.

    python docs/fit_model_glass.py

The two functions of V_d that scale the second and third power of Buchdahl's coordinate are parabolas in 1 / V_d, from
the indices of the makers' glasses at 25 wavelengths of 365 to 1014 nm (within the range of each), with weights that
make the sum of absolute deviations least (iteratively reweighted least squares).
"""

from __future__ import annotations

import numpy as np

from plenoptic.optics.glass.bundled import MAKERS, bundled_glasses
from plenoptic.optics.glass.media import C_LINE, D_LINE, F_LINE, ModelGlass, abbe_number, chromatic_coordinate

WAVELENGTHS = np.unique(np.concatenate((np.linspace(365.1, 1013.9, 20), (404.6561, 435.8343, F_LINE, D_LINE, C_LINE))))
FLOOR = 2e-5
"""Deviations below this count alike."""


def real_glasses() -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names, n_d, V_d and (glasses, wavelengths) indices, nan outside the range of a glass."""
    names, nd, vd, indices = [], [], [], []
    for maker in MAKERS:
        catalogue = bundled_glasses(maker)
        for entry in catalogue.entries:
            medium, (low, high) = catalogue[entry.name], entry.wavelength_range
            names.append(f"{maker} {entry.name}")
            nd.append(medium.index(D_LINE))
            vd.append(abbe_number(medium))
            indices.append([medium.index(w) if low <= w <= high else np.nan for w in WAVELENGTHS])
    return names, np.array(nd), np.array(vd), np.array(indices)


def fitted(nd: np.ndarray, vd: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """(2, 3) coefficients: of the second and third power, by powers of 1 / V_d."""
    w = np.array([chromatic_coordinate(wavelength) for wavelength in WAVELENGTHS])
    f, c = chromatic_coordinate(F_LINE), chromatic_coordinate(C_LINE)
    dispersion = (nd - 1.0) / vd
    # Without dispersion between F and C: what a power of the coordinate adds beside its linear part.
    shapes = [w**k - w * (f**k - c**k) / (f - c) for k in (2, 3)]
    columns = [np.outer(dispersion * vd**-i, shape) for shape in shapes for i in range(3)]
    matrix = np.stack([column.ravel() for column in columns], axis=1)
    target = (indices - nd[:, None] - np.outer(dispersion, w / (f - c))).ravel()
    known = np.isfinite(target)
    matrix, target = matrix[known], target[known]
    weights = np.ones(len(target))
    for _ in range(30):
        solution = np.linalg.lstsq(matrix * weights[:, None], target * weights, rcond=None)[0]
        weights = 1.0 / np.sqrt(np.maximum(np.abs(matrix @ solution - target), FLOOR))
    return solution.reshape(2, 3)


def main() -> None:
    """Print the coefficients, and the errors of the model glasses as the package makes them."""
    names, nd, vd, indices = real_glasses()
    print(f"{len(names)} glasses; coefficients of 1, 1 / V, 1 / V^2:\n{fitted(nd, vd, indices)}")
    models = [ModelGlass(a, b) for a, b in zip(nd, vd, strict=True)]
    errors = np.array([[model.index(w) for w in WAVELENGTHS] for model in models]) - indices
    for low, high in ((365, 1014), (400, 700), (435, 660)):
        within = (low <= WAVELENGTHS) & (high >= WAVELENGTHS)
        worst = np.nanmax(np.abs(errors[:, within]), axis=1)
        print(
            f"{low} to {high} nm, largest error of a glass: median {np.median(worst):.1e}, "
            f"95 % below {np.percentile(worst, 95):.1e}, worst {worst.max():.1e} ({names[int(worst.argmax())]})"
        )


if __name__ == "__main__":
    main()
