"""The kernel's cost matrices: what a mode or a word costs over a horizon, as one quadratic.

``sum_k tr(Q A^k S A'^k) = tr(G S)`` with the Gramian ``G = sum_k A'^k Q A^k``, so a cost over any horizon is
one linear functional of the second moment.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array

_ACCURACY = 1e-2  # a tail is returned only if its estimated relative error, pessimistic as a rule, is below this
_DOUBLINGS = 47


def transform(M: Array, G: Array) -> Array:
    """``M' G M``, symmetrised: what a cost matrix G is worth before a step M.

    Parameters
    ----------
    M, G : arrays, shape (..., n, n)
        A mode (or a power of one), and a symmetric matrix.

    Returns
    -------
    array, shape (..., n, n)
    """
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
    return affine_gramians(A, Q, np.zeros_like(Q), np.zeros(Q.shape[:-2]), 1.0, horizon + 1).G


class Block(NamedTuple):
    """Some steps of each mode: the moment after them is ``A S A' + W``, and they cost ``tr(G S) + constant``.

    With a discount g, that moment is the one times g^t, as later costs count it.
    """

    A: Array
    G: Array
    W: Array
    constant: Array

    def then(self, later: "Block", weight: float) -> "Block":
        """These steps, after which costs count so much, and then some more."""
        W = transform(np.swapaxes(later.A, -1, -2), self.W) + weight * later.W
        constant = self.constant + weight * later.constant + np.sum(later.G * self.W, axis=(-2, -1))
        return Block(later.A @ self.A, self.G + transform(self.A, later.G), W, constant)


def affine_gramians(A: Array, Q: Array, W: Array, price: Array, discount: float, steps: int) -> Block:
    """What modes cost over so many steps, with process noise, a running price and a discount, by doubling.

    Parameters
    ----------
    A, Q, W : arrays, shape (m, n, n)
        Modes, their stage weights, and the covariance of their noise.
    price : array, shape (m,)
        The constant cost of a step.
    discount : float
        What a step's cost counts beside that of the one before; 1 for no discount.
    steps : int
        t, at least 1.

    Returns
    -------
    Block

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> affine_gramians(0.5 * one, one, 3 * one, np.zeros(1), 1.0, 3)[1:]  # 1 + 1/4 + 1/16; 3 (1 + 1/4) + 3
    (array([[[1.3125]]]), array([[[3.9375]]]), array([6.75]))
    """
    one = Block(np.sqrt(discount) * A, Q, discount * W, price)
    block, count = one, 1
    for bit in bin(steps)[3:]:
        block, count = block.then(block, discount**count), 2 * count
        if bit == "1":
            block, count = one.then(block, discount), count + 1
    return block


def is_schur(A: Array) -> bool:
    """Whether a mode is Schur stable: whether its powers contract within 2^47 steps.

    Where they don't, the eigenvalues must agree: rounding can make the powers of a mode with large transient growth
    diverge. It then also moves the eigenvalues (by eps^(1/k) for a defective one of order k), which shows when they are
    computed in other coordinates.

    Parameters
    ----------
    A : array, shape (n, n)
        The mode.

    Returns
    -------
    bool
        A spectral radius within about 1e-14 of 1 counts as 1.

    Raises
    ------
    numpy.linalg.LinAlgError
        If rounding hides the answer.

    Examples
    --------
    >>> is_schur(np.array([[0.5, 100.0], [0.0, 0.9]])), is_schur(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    (True, False)
    """
    M = A
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            rounding = len(A) * np.finfo(float).eps * np.linalg.norm(M) ** 2
            M = M @ M
            if np.linalg.norm(M) + rounding < 0.5:
                return True
    v = np.arange(1.0, len(A) + 1)
    mirror = np.eye(len(A)) - 2 * np.outer(v, v) / (v @ v)
    radii = np.abs(np.linalg.eigvals(np.stack([A, A.T, mirror @ A @ mirror]))).max(axis=-1)
    spread = np.ptp(radii)
    if radii.min() - 10 * spread > 1 or (spread < 1e-6 and radii.max() > 1 - 1e-5):
        return False
    raise np.linalg.LinAlgError(
        "whether the mode is Schur is undecided: its powers grow so much before they shrink that rounding hides it "
        f"(spectral radius {radii.min():.6g} to {radii.max():.6g}); rescale the states"
    )


def seen(A: Array, Q: Array) -> NDArray[np.bool_]:
    """Which states the cost sees, sooner or later: those with a weight, and those that move a state it sees.

    The others, such as the state of a controller that holds it while another one acts, may do what they like.

    Parameters
    ----------
    A, Q : arrays, shape (..., n, n)
        Modes and their positive semidefinite stage weights.

    Returns
    -------
    bool array, shape (..., n)

    Examples
    --------
    >>> seen(np.array([[0.5, 0.0], [1.0, 1.0]]), np.diag([1.0, 0.0]))
    array([ True, False])
    """
    states = np.diagonal(Q, axis1=-2, axis2=-1) > 0
    for _ in range(A.shape[-1]):
        states = states | ((A != 0) & states[..., :, None]).any(axis=-2)
    return states


def tail(A: Array, Q: Array) -> Array | None:
    """What a mode costs for ever, ``P = sum_k A'^k Q A^k = Q + A' P A``, checked before it is returned.

    Doubling, ``P <- P + M' P M``, ``M <- M M`` from ``P = Q``, ``M = A``, only adds positive semidefinite terms. The
    answer is checked by its residual (docs/theory.md, "Tails").

    Parameters
    ----------
    A, Q : arrays, shape (n, n)
        The mode and its positive semidefinite stage weight.

    Returns
    -------
    array, shape (n, n), or None
        None where the mode is not Schur (see `is_schur`) on the states that the cost sees (see `seen`).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the estimated relative error of the diagonal of P exceeds 1e-2, or `is_schur` can't decide.

    Examples
    --------
    >>> tail(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    >>> tail(np.array([[1.0]]), np.array([[3.0]])) is None
    True
    """
    states = np.ix_(*[np.flatnonzero(seen(A, Q))] * 2)
    whole, A, Q = np.zeros_like(Q), A[states], Q[states]
    if not is_schur(A):
        return None
    if len(A) == 0:
        return whole
    P = _doubled(A, Q)
    # D_ii is the size of what is added up in the residual R. |x' R x| <= r x' D x, with r the norm of R scaled by
    # D^(-1/2) on both sides; so the error of P is at most r Z, Z = D + A' Z A, and Z at most twice the computed one.
    D = np.diag(np.diag(np.abs(A).T @ np.abs(P) @ np.abs(A) + np.abs(P) + np.abs(Q)))
    Z = _doubled(A, D)
    r, r_Z = (_scaled_norm(weight + transform(A, G) - G, D) for weight, G in ((Q, P), (D, Z)))
    error = 2 * (r + len(A) * np.finfo(float).eps) * np.diag(Z)
    if not (r_Z < 0.5 and (error <= _ACCURACY * np.diag(P)).all()):
        raise np.linalg.LinAlgError(
            f"the cost for ever cannot be computed to a relative error of {_ACCURACY} (spectral radius "
            f"{np.abs(np.linalg.eigvals(A)).max():.12g}, greatest entry {np.abs(P).max():.3g}): rescale the states"
        )
    whole[states] = P
    return whole


def _scaled_norm(R: Array, D: Array) -> float:
    """The spectral norm of ``D^(-1/2) R D^(-1/2)``, D diagonal; where D_ii is zero, so is R."""
    scale = np.sqrt(np.outer(np.diag(D), np.diag(D)))
    return float(np.linalg.norm(np.divide(R, scale, out=np.zeros_like(R), where=scale > 0), 2))


def _doubled(A: Array, Q: Array) -> Array:
    """``sum_k A'^k Q A^k`` of a Schur mode, by doubling until the power vanishes."""
    G, M = Q, A
    while np.linalg.norm(M) > 1e-20:
        G, M = G + transform(M, G), M @ M
    return G


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
        period = Q[mode] + transform(A[mode], period)
        product = product @ A[mode]
    return tail(product, period)
