"""What every switching sequence costs at least, as quadratics.

``V_0(S) = 0``, and ``V_{t+1}(S) = min_i tr(Q_i S) + V_t(A_i S A_i')`` is the least cost of t + 1 steps, below that of
any run for ever. If ``tr(L S) <= V_t(S)`` and ``L+ <= Q_i + A_i' L A_i`` for every i, then ``tr(L+ S) <= V_{t+1}(S)``.
"""

from functools import reduce

import numpy as np

from switchctl.moments import Array, svec, transform

_ROUNDS = 1000
_WORDS = 1024
_SEEN = 1e-9  # directions of less weight, in units of the states, count as unseen
_NEGATIVE = 1e-3  # margins may make L a little indefinite; beyond this they grow and the bounds so far must do


def lower_bounds(A: Array, Q: Array) -> Array:
    """Rows L_j with ``max_j L_j . svec(S) <= sum_k tr(Q S_k)`` for every switching sequence.

    Parameters
    ----------
    A, Q : arrays, shape (m, n, n)
        Modes and their stage weights.

    Returns
    -------
    array, shape (r, n (n + 1) / 2)
        Margins for rounding are taken off.
    """
    bounds, L = [np.zeros_like(A[0])], np.zeros_like(A[0])
    for t in range(1, _ROUNDS + 1):
        each = [below(Q[i], A[i], L) for i in range(len(A))]
        last, L = L, reduce(minorant, each)
        d = _scales(np.abs(L))
        if np.linalg.eigvalsh(L / np.outer(d, d))[0] < -_NEGATIVE:
            break
        done = np.linalg.norm(L - last) <= 1e-6 * np.linalg.norm(L)
        if t & (t - 1) == 0 or done or t == _ROUNDS:
            bounds.append(L)
        if done:
            break
    return svec(np.stack(bounds))


def definite_minorant(A: Array, Q: Array) -> Array | None:
    """A positive definite matrix below what any few steps cost; None where none is found.

    Parameters
    ----------
    A, Q : arrays, shape (m, n, n)
        Modes and their stage weights.

    Returns
    -------
    array, shape (n, n), or None
        Every run costs at least ``tr(M S)``, and more steps than any number of windows cost are left with nothing.
    """
    each = [np.zeros_like(A[0])]
    for _ in range(_WORDS):  # one mode has one word of each length
        if len(each) * len(A) > _WORDS:
            break
        each = [below(Q[i], A[i], L) for i in range(len(A)) for L in each]
        mean = np.mean(each, axis=0)
        if not (np.isfinite(mean).all() and (np.diag(mean) > 0).all()):
            continue
        mean = mean / np.outer(_scales(mean), _scales(mean))
        if np.linalg.eigvalsh(mean)[0] > _SEEN:
            root = np.linalg.inv(np.linalg.cholesky(mean)) / _scales(np.mean(each, axis=0))
            least = float(np.linalg.eigvalsh(root @ np.array(each) @ root.T).min()) - _SEEN
            if least > 0:
                return least * np.mean(each, axis=0)
    return None


def below(Q: Array, A: Array, L: Array) -> Array:
    """``Q + A' L A``, less a bound of the rounding in it.

    A symmetric error with entries up to B is below ``diag(sum_j B_ij d_j / d_i)`` for every d > 0.
    """
    B = 4 * (len(A) + 2) * np.finfo(float).eps * (np.abs(A).T @ np.abs(L) @ np.abs(A) + np.abs(Q))
    d = _scales(B)
    return Q + transform(A, L) - np.diag((B @ d) / d)


def minorant(X: Array, Y: Array) -> Array:
    """A great matrix below two others: least where both are least in common coordinates, and checked."""
    d = _scales(np.abs(X) + np.abs(Y))
    X, Y = X / np.outer(d, d), Y / np.outer(d, d)
    weights, vectors = np.linalg.eigh(X + Y)
    seen = weights > 1e-12 * weights[-1]
    root = vectors[:, seen] * np.sqrt(weights[seen])  # X + Y = root root'
    inverse = vectors[:, seen] / np.sqrt(weights[seen])
    shares, turn = np.linalg.eigh(inverse.T @ X @ inverse)  # those of Y are 1 - shares
    both = root @ turn
    L = (both * np.minimum(shares, 1 - shares)) @ both.T
    L = (L + L.T) / 2
    above = max(0.0, *(-np.linalg.eigvalsh(other - L)[0] for other in (X, Y)))
    rounding = 16 * len(X) ** 2 * np.finfo(float).eps * (1 + np.abs(L).max())
    return (L - (above + rounding) * np.eye(len(L))) * np.outer(d, d)


def _scales(X: Array) -> Array:
    """Units of the states in which the diagonal is 1."""
    diagonal = np.sqrt(np.diag(X))
    return np.where(diagonal > 0, diagonal, max(float(diagonal.max()), 1.0) * 1e-150)
