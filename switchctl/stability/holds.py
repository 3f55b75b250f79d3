"""How long the constrained receding horizon may have to hold a mode."""

import numpy as np

from switchctl.graph import SwitchingGraph

_LONGEST = 100_000  # steps, as in methods/receding_horizon.py
_BLOCK = 256
_MARGIN = 1e-9
_EPS = np.finfo(float).eps


def longest_hold(graph: SwitchingGraph, hold: int, decrease: float) -> tuple[int, float] | None:
    """The most steps between updates that the constraint can ask for, and what W2 may grow by on the way.

    Parameters
    ----------
    graph : SwitchingGraph
        The graph, all of whose modes are Schur.
    hold : int
        The usual steps.
    decrease : float
        The constraint.

    Returns
    -------
    tuple of int and float, or None
        None where it is not found within 100,000 steps.
    """
    modes, last = graph.modes, _LONGEST + hold
    m, n, _ = modes.A.shape
    block = np.empty((m, _BLOCK, n, n))
    block[:, 0] = np.eye(n)
    for k in range(1, _BLOCK):
        block[:, k] = modes.A @ block[:, k - 1]
    jump = (modes.A @ block[:, -1])[:, None]
    lasting = np.isinf(graph.holds) & ((graph.price + modes.offset) == 0)
    norms = np.empty((m, last + _BLOCK))
    for done in range(0, last, _BLOCK):
        norms[:, done : done + _BLOCK] = np.linalg.norm(block, 2, axis=(-2, -1))
        known = norms[:, : done + _BLOCK]
        if not np.isfinite(known).all():
            return None
        contracted = known <= 1 - _MARGIN  # from then on every power is below an earlier one
        if contracted.any(axis=1).all() and hold + contracted.argmax(axis=1).max() < known.shape[1]:
            rounding = (
                4 * n * _EPS * known.shape[1] * known.max() ** 2 * float(np.linalg.norm(modes.A, 2, (1, 2)).max())
            )
            squares = (known + rounding) ** 2
            bound = (1 - decrease) * (1 - _MARGIN) / max(1.0, float(squares[:, hold:].max()))
            met = squares[:, hold:] <= bound
            longest = np.where(met.any(axis=1), hold + met.argmax(axis=1), np.inf)
            worst = np.where(lasting, longest, np.inf).min(axis=1).max()
            if np.isfinite(worst):
                return int(worst), float(squares.max())
        block = block @ jump
    return None
