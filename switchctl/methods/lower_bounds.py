"""What every switching sequence costs at least, as quadratics.

``V_0(S) = 0``, and ``V_{t+1}(S) = min_i tr(Q_i S) + V_t(A_i S A_i')`` is the least cost of t + 1 steps, below that of
any run for ever. If ``tr(L S) <= V_t(S)`` and ``L+ <= Q_i + A_i' L A_i`` for every i, then ``tr(L+ S) <= V_{t+1}(S)``.
"""

import numpy as np

from switchctl.gramians import transform
from switchctl.moments import Array, svec

_ROUNDS = 1000


def lower_bounds(A: Array, Q: Array) -> Array:
    """Rows L_j with ``max_j L_j . svec(S) <= sum_k tr(Q S_k)`` for every switching sequence.

    Parameters
    ----------
    A, Q : arrays, shape (m, n, n)
        Modes and their stage weights.

    Returns
    -------
    array, shape (r, n (n + 1) / 2)
        A margin for rounding is taken off.
    """
    bounds, L = [], np.zeros_like(A[0])
    for t in range(1, _ROUNDS + 1):
        each = Q + transform(A, L)
        last, L = L, each[0]
        for X in each[1:]:
            L = _minorant(L, X)
        done = np.linalg.norm(L - last) <= 1e-6 * np.linalg.norm(L)
        if t & (t - 1) == 0 or done or t == _ROUNDS:
            bounds.append(L - 1e-12 * np.linalg.norm(L) * np.eye(len(L)))
        if done:
            break
    return svec(np.stack(bounds))


def _minorant(X: Array, Y: Array) -> Array:
    """A greatest matrix below two positive semidefinite ones, least where both are least in common coordinates."""
    weights, vectors = np.linalg.eigh(X + Y)
    seen = weights > 1e-14 * weights[-1]
    root = vectors[:, seen] * np.sqrt(weights[seen])  # X + Y = root root'
    inverse = vectors[:, seen] / np.sqrt(weights[seen])
    shares, turn = np.linalg.eigh(inverse.T @ X @ inverse)  # those of Y are 1 - shares
    both = root @ turn
    return (both * np.clip(np.minimum(shares, 1 - shares), 0, None)) @ both.T
