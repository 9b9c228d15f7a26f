"""Covariance of fitted unknowns from the residuals: the sandwich estimate, clustered.

Errors of a corner may be alike in all micro images that show it, or in the whole frame, and those of centres in their
neighbourhood: residuals are summed over such clusters before they are squared. Sums over board points and frames
are corrected for the part of the errors that the fit takes up (R. M. Bell and D. F. McCaffrey, Survey Methodology
28 (2002), 169).
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import Parameter
from plenoptic.calibration.fitting.solve import (
    CornerGroups,
    Evaluation,
    Problem,
    State,
    cell_products,
    cells_of,
    centres_of,
    curvature,
    normal_equations,
    prior_precision,
    weight,
)
from plenoptic.core.values import Floats

_BLOCK = 8.0
"""Side in pitches of the blocks of micro images whose centres form a cluster."""
_BLOCK_RATIO = 1.6
"""Mean ratio of variances above which neighbouring centres count as correlated."""
_FLIPS = 199
"""Random signs of the parts of clusters; clusters count as correlated by chance in one of 200 calibrations."""
_MIN_FRAMES = 6
"""Least number of frames of which variances between frames can be told."""
_MAX_LEVERAGE, _JITTER = 0.95, 1e-10


def information(problem: Problem, at: Evaluation) -> Floats:
    """Half the second derivatives of the cost by all unknowns, (unknowns, unknowns)."""
    weights = curvature(at.corners), curvature(at.centres)
    return normal_equations(problem, cells_of(problem), at, weights)[0]


def inverse(matrix: Floats) -> Floats:
    """Inverse of a symmetric positive matrix whose unknowns have different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.asarray(
        np.linalg.pinv(matrix * scale[:, None] * scale, rcond=1e-14, hermitian=True) * scale[:, None] * scale
    )


class ErrorCluster(enum.IntEnum):
    """Part of the observations within which errors of corners are alike.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [cluster.name for cluster in pl.calibration.ErrorCluster]
    ['CORNER', 'BOARD_POINT', 'FRAME']
    """

    CORNER = 0
    """None: each corner in each micro image has its own error."""
    BOARD_POINT = 1
    """Images of a point of the board in a frame."""
    FRAME = 2
    """All corners of a frame, as if its pose were not rigid or the lens not that of the model."""


class Spread(NamedTuple):
    """Covariance (unknowns, unknowns) of the fitted unknowns, and the clusters of its errors."""

    covariance: Floats
    cluster: ErrorCluster


def clustered_covariance(problem: Problem, at: Evaluation) -> Spread:
    """Covariance of all unknowns at the minimum, by the smallest clusters that leave no correlation between them."""
    cells, n_free = cells_of(problem), problem.n_free
    bread = inverse(information(problem, at))
    meat = np.diag(prior_precision(problem))
    meat[:n_free, :n_free] += _centre_products(problem, at)
    independent = np.zeros_like(meat)
    np.add.at(independent, (cells.unknowns[:, :, None], cells.unknowns[:, None, :]), cell_products(cells, _pulls(at)))
    independent *= at.corners.size / max(at.corners.size - problem.unknowns, 1)
    best = Spread(bread @ (meat + independent) @ bread, ErrorCluster.CORNER)
    points = _point_clusters(problem, cells, at, bread)
    clusters = [(ErrorCluster.BOARD_POINT, points), (ErrorCluster.FRAME, _frame_clusters(problem, cells, at, bread))]
    for cluster, sums in clusters if problem.frames >= _MIN_FRAMES else clusters[:1]:
        if _have_correlation(sums, bread[:n_free], best.covariance[:n_free, :n_free]):
            scores = np.zeros((len(sums), problem.unknowns))
            for score, each in zip(scores, sums, strict=True):
                score[each.unknowns] = each.parts.sum(axis=0)
            best = Spread(bread @ (meat + scores.T @ scores) @ bread, cluster)
    return best


class _Cluster(NamedTuple):
    """Cluster of residuals: derivatives (m, k) of the loss of its parts by the unknowns (k,), with its leverage."""

    unknowns: NDArray[np.int64]
    parts: Floats


def _have_correlation(clusters: list[_Cluster], bread: Floats, covariance: Floats) -> bool:
    """True if the sums of the clusters' parts are larger than with random signs of the parts.

    They are weighed by their effect on the parameters, in units of the covariance (n, n) of these; the bread (n,
    unknowns) is the change of the parameters by a derivative of the loss.
    """
    scale = 1.0 / np.sqrt(np.diag(covariance))
    eigenvalues, axes = np.linalg.eigh(covariance * scale[:, None] * scale)
    used = eigenvalues > _JITTER * eigenvalues[-1]
    effect = (axes[:, used] / np.sqrt(eigenvalues[used])).T @ (bread * scale[:, None])
    rng, total = np.random.default_rng(0), np.zeros(_FLIPS + 1)
    for cluster in clusters:
        changes = cluster.parts @ effect[:, cluster.unknowns].T
        signs = np.concatenate([np.ones((1, len(changes))), rng.choice([-1.0, 1.0], (_FLIPS, len(changes)))])
        total += np.sum((signs @ changes) ** 2, axis=1)
    return bool(total[0] > total[1:].max())


def _pulls(at: Evaluation) -> Floats:
    """Derivatives (n, 2, k) of half the loss of each corner by its unknowns."""
    return np.asarray(at.corner_slope * (weight(at.corners) * at.corners)[:, :, None])


def _cell_information(cells: CornerGroups, at: Evaluation) -> Floats:
    return cell_products(cells, at.corner_slope * np.sqrt(curvature(at.corners))[:, :, None])


def _point_clusters(problem: Problem, cells: CornerGroups, at: Evaluation, bread: Floats) -> list[_Cluster]:
    """Corners of each board point in each frame."""
    pulls = _pulls(at)
    padded = np.concatenate([pulls, np.zeros((1, *pulls.shape[1:]))])
    parts = padded[cells.rows].reshape(len(cells.rows), -1, pulls.shape[2])
    covariance = bread[cells.unknowns[:, :, None], cells.unknowns[:, None, :]]
    parts = _correct_leverage(parts, _cell_information(cells, at), covariance)
    return [_Cluster(*each) for each in zip(cells.unknowns, parts, strict=True)]


def _frame_clusters(problem: Problem, cells: CornerGroups, at: Evaluation, bread: Floats) -> list[_Cluster]:
    """Board points of each frame."""
    pulls, information_of_cells = _pulls(at), _cell_information(cells, at)
    padded = np.concatenate([pulls.sum(axis=1), np.zeros((1, pulls.shape[2]))])
    scores = padded[cells.rows].sum(axis=1)
    frame = (cells.unknowns[:, problem.n_free] - problem.n_free) // 6
    clusters = []
    for number in range(problem.frames):
        rows = frame == number
        used, place = np.unique(cells.unknowns[rows], return_inverse=True)
        place = place.reshape(int(rows.sum()), -1)
        parts, matrix = np.zeros((len(place), len(used))), np.zeros((len(used), len(used)))
        np.put_along_axis(parts, place, scores[rows], axis=1)
        np.add.at(matrix, (place[:, :, None], place[:, None, :]), information_of_cells[rows])
        corrected = _correct_leverage(parts[None], matrix[None], bread[np.ix_(used, used)][None])
        clusters.append(_Cluster(used, corrected[0]))
    return clusters


def _centre_products(problem: Problem, at: Evaluation) -> Floats:
    """Sum (parameters, parameters) of the products of the centres' scores, over blocks if these are correlated.

    A microlens beside its place in the lattice is so at all focus settings: scores are summed over these.
    """
    pulls = np.einsum("mij,mi->mj", at.centre_slope, weight(at.centres) * at.centres)
    products = []
    for clusters in (problem.centre_grid.round(6), np.floor(problem.centre_grid / _BLOCK)):
        _, cluster = np.unique(clusters, axis=0, return_inverse=True)
        sums = np.zeros((int(cluster.max(initial=-1)) + 1, problem.n_free))
        np.add.at(sums, cluster.ravel(), pulls)
        products.append(sums.T @ sums)
    independent, together = products
    # Parameters on which no centre depends have no share.
    rank = float(np.trace(inverse(independent) @ independent))
    ratio = float(np.trace(inverse(independent) @ together)) / max(rank, 1.0)
    return together if ratio > _BLOCK_RATIO else independent


def _correct_leverage(score: Floats, group_information: Floats, part: Floats) -> Floats:
    """Scores (c, m, k) of parts of clusters corrected for the leverage of their residuals.

    With the part V of the covariance and the part M of the information that belong to a cluster, V = L L^T, the score
    s becomes L^-T (1 - L^T M L)^(-1/2) L^T s.
    """
    scale = np.sqrt(np.diagonal(part, axis1=1, axis2=2))
    ratio = part / (scale[:, :, None] * scale[:, None, :])
    lower = scale[:, :, None] * np.linalg.cholesky(ratio + _JITTER * np.eye(part.shape[1]))
    upper = lower.transpose(0, 2, 1)
    leverage, axes = np.linalg.eigh(upper @ group_information @ lower)
    factor = 1.0 / np.sqrt(1.0 - np.clip(leverage, 0.0, _MAX_LEVERAGE)) - 1.0
    along = axes.transpose(0, 2, 1) @ upper @ score.transpose(0, 2, 1)
    extra = np.linalg.solve(upper, axes @ (factor[:, :, None] * along))
    return np.asarray(score + extra.transpose(0, 2, 1))


def pupil_sensitivity(problem: Problem, state: State, at: Evaluation) -> Floats:
    """Change (unknowns,) of the fitted unknowns per mm of the exit pupil's position, which is not fitted."""
    _, slope = centres_of(problem, state.parameters)
    by_pupil = slope[:, :, Parameter.EXIT_PUPIL] / problem.sigma[1] * curvature(at.centres)
    mixed = np.zeros(problem.unknowns)
    mixed[: problem.n_free] = np.einsum("mij,mi->j", at.centre_slope, by_pupil)
    return np.asarray(-inverse(information(problem, at)) @ mixed)
