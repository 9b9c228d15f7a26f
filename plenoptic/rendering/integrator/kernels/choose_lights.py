"""Choice of one of several drawn lights by its contribution: importance resampling.

J. Talbot, D. Cline and P. Egbert, Importance resampling for global illumination, EGSR 2005,
doi:10.2312/EGWR/EGSR05/139-146.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.sobol import random_number
from plenoptic.core.numba.jit import kernel

_CHOICE = np.uint64(313)
FACTOR = 0
_U, _V, _LOT, _SUM, _KEPT, _CHOSEN_U, _CHOSEN_V = range(1, 8)
CHOICE_ROWS = 8
"""Rows of a choice: the factor of the chosen light; random numbers of the first one and of the choice; sum of the
contributions, that of the chosen light, and its random numbers."""


@kernel
def begin_choice(choice, interactions):
    """Keep the random numbers by which lights are drawn."""
    random = interactions.random
    for i in range(interactions.path.size):
        choice[_U, i], choice[_V, i] = random[0, i], random[1, i]
        choice[_LOT, i] = random_number(interactions.key[i], interactions.number[i], _CHOICE)
        choice[_SUM, i], choice[_KEPT, i] = 0.0, 0.0
        choice[_CHOSEN_U, i], choice[_CHOSEN_V, i] = random[0, i], random[1, i]


@kernel
def set_candidate(choice, interactions, k, count):
    """Set the random numbers of candidate k: each of `count` comes from another part of the table of lights."""
    random = interactions.random
    for i in range(interactions.path.size):
        v = choice[_V, i] + k / count
        random[0, i], random[1, i] = (k + choice[_U, i]) / count, v - math.floor(v)


@kernel
def add_candidate(choice, interactions, shadow, n_lit):
    """Take a candidate in proportion to its contribution, of those until now, if nothing occludes it.

    `shadow` holds `n_lit` contributions; interactions without one are left out.
    """
    random, radiance, lit = interactions.random, shadow.radiance, 0
    for i in range(interactions.path.size):
        contribution = 0.0
        if lit < n_lit and shadow.path[lit] == interactions.path[i]:
            for c in range(radiance.shape[1]):
                contribution = max(contribution, radiance[lit, c])
            lit += 1
        choice[_SUM, i] += contribution
        chance = contribution / choice[_SUM, i] if contribution > 0.0 else 0.0
        lot = choice[_LOT, i]
        if lot < chance:
            choice[_LOT, i], choice[_KEPT, i] = lot / chance, contribution
            choice[_CHOSEN_U, i], choice[_CHOSEN_V, i] = random[0, i], random[1, i]
        else:
            choice[_LOT, i] = (lot - chance) / (1.0 - chance) if chance < 1.0 else lot


@kernel
def end_choice(choice, interactions, count):
    """Set the random numbers of the chosen light, and its factor: the mean contribution over its own."""
    random = interactions.random
    for i in range(interactions.path.size):
        kept = choice[_KEPT, i]
        random[0, i], random[1, i] = choice[_CHOSEN_U, i], choice[_CHOSEN_V, i]
        choice[FACTOR, i] = choice[_SUM, i] / (count * kept) if kept > 0.0 else 0.0
