"""The kernel's cost matrices: what a mode or a word costs over a horizon, as one quadratic.

``sum_k tr(Q A^k S A'^k) = tr(G S)`` with the Gramian ``G = sum_k A'^k Q A^k``, so a cost over any horizon is
one linear functional of the second moment.
"""

import numpy as np

from switchctl.moments import Array

_ACCURACY = 1e-3  # a tail is returned only if its relative error is provably below this
_DOUBLINGS = 45


def _transform(M: Array, G: Array) -> Array:
    """``M' G M``, symmetrised."""
    product = np.swapaxes(M, -1, -2) @ G @ M
    return (product + np.swapaxes(product, -1, -2)) / 2


def horizon_gramians(A: Array, Q: Array, horizon: int) -> Array:
    """``G(T) = sum_{k=0..T} A'^k Q A^k`` of every mode, by doubling in O(n^3 log T).

    Parameters
    ----------
    A, Q : arrays, shape (..., n, n)
        Modes and their stage weights.
    horizon : int
        T, so T + 1 terms.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> horizon_gramians(np.array([[[0.5]]]), np.array([[[1.0]]]), 2)
    array([[[1.3125]]])
    """
    G, power = Q, A  # of 1 term
    for bit in bin(horizon + 1)[3:]:
        G, power = G + _transform(power, G), power @ power
        if bit == "1":
            G, power = Q + _transform(A, G), power @ A
    return G


def is_schur(A: Array) -> bool:
    """Whether a mode is Schur stable: whether its powers contract within 2^44 steps.

    Eigenvalues alone can't tell near the unit circle: they are off by eps^(1/k) for a defective pole of order k.

    Parameters
    ----------
    A : array, shape (n, n)
        The mode.

    Returns
    -------
    bool
        A spectral radius within about 1e-13 of 1 counts as 1.

    Raises
    ------
    numpy.linalg.LinAlgError
        If rounding hides the answer: the powers don't contract, though the eigenvalues are well inside the unit
        circle (transient growth beyond 1e8).

    Examples
    --------
    >>> is_schur(np.array([[0.5, 100.0], [0.0, 0.9]])), is_schur(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    (True, False)
    """
    M = A
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            if np.linalg.norm(M) < 0.5:
                return True
            M = M @ M
    radius = np.abs(np.linalg.eigvals(A)).max()
    if radius < 1 - 1e-6:
        raise np.linalg.LinAlgError(
            f"whether the mode is Schur is undecided: its eigenvalues are inside the unit circle (spectral radius "
            f"{radius:.6g}), but its powers grow so much in between that rounding hides it; rescale the states"
        )
    return False


def tail(A: Array, Q: Array) -> Array | None:
    """The Lyapunov solution ``P = Q + A' P A``: the mode's cost matrix for ever, checked before it is returned.

    Doubling, ``P <- P + M' P M``, ``M <- M M`` from ``P = Q``, ``M = A``, only adds positive semidefinite
    terms. The answer is then checked: with ``X = I + A' X A`` and the residual ``R = Q + A' P A - P``, the error
    of P is at most ``||R|| ||X||``.

    Parameters
    ----------
    A, Q : arrays, shape (n, n)
        The mode and its positive semidefinite stage weight.

    Returns
    -------
    array, shape (n, n), or None
        None where the mode is not Schur (see `is_schur`).

    Raises
    ------
    numpy.linalg.LinAlgError
        If P could not be computed to a relative error of 1e-3, or `is_schur` can't decide.

    Examples
    --------
    >>> tail(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    >>> tail(np.array([[1.0]]), np.array([[3.0]])) is None
    True
    """
    if not is_schur(A):
        return None
    weights = np.stack([Q, np.eye(len(A))])
    G, M = weights, A
    while np.linalg.norm(M) > 1e-20:
        G, M = G + _transform(M, G), M @ M
    residual_P, residual_X = np.linalg.norm(weights + _transform(A, G) - G, 2, axis=(1, 2))
    P, X = G
    # X itself is within a factor of two where its own residual is below 1/2.
    if not (residual_X < 0.5 and residual_P * 2 * np.linalg.norm(X, 2) <= _ACCURACY * np.linalg.norm(P, 2)):
        raise np.linalg.LinAlgError(
            f"the cost for ever cannot be computed to a relative error of {_ACCURACY} (spectral radius "
            f"{np.abs(np.linalg.eigvals(A)).max():.12g}, greatest entry {np.abs(P).max():.3g}); use a finite horizon"
        )
    return P


def word_tail(A: Array, Q: Array, word: tuple[int, ...]) -> Array | None:
    """The cost matrix of a word of modes repeated for ever, by one periodic Lyapunov solve.

    Parameters
    ----------
    A, Q : arrays, shape (m, n, n)
        Modes and their stage weights.
    word : tuple of int
        The modes of one period, first step first.

    Returns
    -------
    array, shape (n, n), or None
        None where the word's product is not Schur.

    Examples
    --------
    >>> A, Q = np.array([[[0.5]], [[1.0]]]), np.ones((2, 1, 1))
    >>> word_tail(A, Q, (1, 0))  # 1 + 1 + 1/4 + 1/4 + ..
    array([[2.66666667]])
    """
    period, product = np.zeros_like(Q[0]), np.eye(A.shape[-1])
    for mode in reversed(word):
        period = Q[mode] + _transform(A[mode], period)
        product = product @ A[mode]
    return tail(product, period)
