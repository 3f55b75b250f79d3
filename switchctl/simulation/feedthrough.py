"""The algebraic loop of a plant whose output depends on its input at once."""

from collections.abc import Callable

import numpy as np

from switchctl.moments import Array

_RESIDUAL = 1e-9


def closed_input(asked: Callable[[Array], Array], loop: Array, guess: Array, limit: Callable[[Array], Array]) -> Array:
    """The input that a controller asks for, having measured the output that this very input makes.

    It solves ``w = asked(limit(w))``. Of a linear plant within its limits that is one linear equation; beyond, its
    solution is where `scipy.optimize.root` starts.

    Parameters
    ----------
    asked : callable
        What the controller asks for, by the input that acts while it measures.
    loop : array, shape (q, q)
        The negative derivative of `asked`, ``K D``, D the feedthrough of the linearised plant.
    guess : array, shape (q,)
        Where the loop is linearised.
    limit : callable
        The actuator's limits.

    Returns
    -------
    array, shape (q,)

    Raises
    ------
    ValueError
        If no solution is found.
    """
    w = guess + np.linalg.solve(np.eye(len(guess)) + loop, asked(guess) - guess)

    def residual(w: Array) -> Array:
        return w - asked(limit(w))

    def left(w: Array) -> float:
        return float(np.abs(residual(w)).max() / (1 + np.abs(w).max()))

    if left(w) <= 1e-3 * _RESIDUAL:
        return w
    from scipy.optimize import root

    found = np.asarray(root(residual, w, tol=1e-13).x)
    if not left(found) <= _RESIDUAL:
        raise ValueError(
            f"the algebraic loop through the plant's feedthrough was not solved: {left(found):.2g} is left, relative "
            "to the input; measure outputs without feedthrough, or let the input act one sample later (delay=True)"
        )
    return found
