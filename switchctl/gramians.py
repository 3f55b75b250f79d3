"""The kernel's cost matrices: what a mode or a word costs over a horizon, as one quadratic.

``sum_k tr(Q A^k S A'^k) = tr(G S)`` with the Gramian ``G = sum_k A'^k Q A^k``, so a cost over any horizon is
one linear functional of the second moment.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array, transform
from switchctl.schur import EPS, along, doubled, is_schur, majorant, rounded_sizes, scaled_norm, word_product

_ACCURACY = 1e-2  # a tail is returned only if its estimated relative error, pessimistic as a rule, is below this


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


def regrouped_gramians(A: Array, Q: Array, steps: int) -> Array:
    """``sum_{k < steps} A'^k Q A^k``, by thirds and not by doubling: another rounding, which tells how much it matters.

    Parameters
    ----------
    A, Q : arrays, shape (..., n, n)
        Modes and their stage weights.
    steps : int
        How many terms, at least 1.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> regrouped_gramians(np.array([[[0.5]]]), np.array([[[1.0]]]), 3)
    array([[[1.3125]]])
    """
    known = {1: (A, Q)}

    def over(count: int) -> tuple[Array, Array]:
        if count not in known:
            third = max(count // 3, 1)
            (first, G), (then, H) = over(third), over(count - third)
            known[count] = then @ first, G + transform(first, H)
        return known[count]

    return over(steps)[1]


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
    return word_tail(A[None], Q[None], (0,))


def word_tail(A: Array, Q: Array, word: tuple[int, ...]) -> Array | None:
    """What a word of modes repeated for ever costs, checked before it is returned.

    Doubling, ``P <- P + M' P M``, ``M <- M M`` from the cost P of a period and its product M, only adds positive
    semidefinite terms. The answer is checked by its residual, taken step by step (docs/theory.md, "Tails").

    Parameters
    ----------
    A, Q : arrays, shape (m, n, n)
        Modes and their positive semidefinite stage weights.
    word : tuple of int
        The modes of one period, first step first.

    Returns
    -------
    array, shape (n, n), or None
        None where the word's product is not Schur (see `is_schur`) on the states that the cost sees (see `seen`).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the estimated relative error of the diagonal of P exceeds 1e-2, or `is_schur` can't decide.

    Examples
    --------
    >>> A, Q = np.array([[[0.5]], [[1.0]]]), np.ones((2, 1, 1))
    >>> word_tail(A, Q, (1, 0))  # 1 + 1 + 1/4 + 1/4 + ..
    array([[2.66666667]])
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite proves nothing
        return _word_tail([A[mode] for mode in word], [Q[mode] for mode in word])


def _word_tail(steps: list[Array], weights: list[Array]) -> Array | None:
    period = along(steps, weights, np.zeros_like(weights[0]))[-1]
    if not np.isfinite(period).all():
        raise np.linalg.LinAlgError("the cost of a period exceeds the floating-point range: rescale the states")
    states = seen(word_product(steps), period)
    steps[-1] = np.where(states[:, None], steps[-1], 0.0)
    if not is_schur(*steps):
        return None
    M = word_product(steps)
    P = doubled(M, period)
    worth = along(steps, weights, P)
    D, sizes = rounded_sizes(steps, weights, worth)
    Z = majorant(steps, M, D, sizes)
    if Z is not None:
        error = 2 * (scaled_norm(worth[-1] - P, D) + len(M) * EPS) * np.diag(Z)
        if (error <= _ACCURACY * np.diag(P)).all():
            return P
    raise np.linalg.LinAlgError(
        f"the cost for ever cannot be computed to a relative error of {_ACCURACY} (spectral radius "
        f"{np.abs(np.linalg.eigvals(M)).max():.12g}, greatest entry {np.abs(P).max():.3g}): rescale the states"
    )
