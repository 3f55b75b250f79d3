"""The least of several costs."""

import math

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array
from switchctl.validation import shown

TIE = 1e-12
"""A challenger replaces the best so far only if its cost is below ``best * (1 - TIE)``."""


def least_cost(costs: Array, allowed: NDArray[np.bool_] | None = None) -> int:
    """Position of the least cost; of costs that tie, the first (see `TIE`).

    Parameters
    ----------
    costs : array, shape (r,)
        One cost a candidate, candidates in index order.
    allowed : bool array, shape (r,), optional
        Which candidates may be chosen; all by default.

    Returns
    -------
    int

    Raises
    ------
    FloatingPointError
        If the cost of an allowed candidate is not finite.
    TypeError, ValueError
        If costs are no row of numbers, or none may be chosen.

    Examples
    --------
    >>> least_cost(np.array([2.0, 1.0, 1.0 - 1e-15]))
    1
    """
    costs = np.asarray(costs)
    if costs.ndim != 1 or costs.dtype.kind not in "biuf":
        raise TypeError(f"costs must be a row of real numbers, one a candidate, not {shown(costs)}")
    if allowed is not None and (np.shape(allowed) != costs.shape or np.asarray(allowed).dtype != bool):
        raise ValueError(f"allowed must hold {len(costs)} booleans, one a candidate, not {shown(allowed)}")
    best, best_cost = -1, 0.0
    for position, cost in enumerate(costs.tolist()):
        if allowed is not None and not allowed[position]:
            continue
        if not math.isfinite(cost):
            raise FloatingPointError(
                f"the cost of candidate {position} is {cost}: it exceeds the floating-point range; "
                "use a shorter horizon or scale the state"
            )
        if best < 0 or cost < best_cost * (1 - TIE):
            best, best_cost = position, cost
    if best < 0:
        raise ValueError("costs has no candidate that is allowed; there must be one to choose")
    return best
