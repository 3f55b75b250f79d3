"""The kernel's cost matrices: what a mode or a word costs over a horizon, as one quadratic.

``sum_k tr(Q A^k S A'^k) = tr(G S)`` with the Gramian ``G = sum_k A'^k Q A^k``, so a cost over any horizon is
one linear functional of the second moment.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array

_ACCURACY = 1e-2  # a tail is returned only if its estimated relative error, pessimistic as a rule, is below this
_DOUBLINGS = 60
_EPS = float(np.finfo(float).eps)


def transform(M: Array, G: Array) -> Array:
    """``M' G M``, symmetrised: what a cost matrix G is worth before a step M.

    Parameters
    ----------
    M, G : arrays, shape (..., n, n)
        A mode (or a power of one), and a symmetric matrix.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> transform(np.array([[0.5]]), np.array([[4.0]]))
    array([[1.]])
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


def is_schur(*steps: Array) -> bool:
    """Whether a mode, or a word of modes repeated for ever, is Schur stable.

    Each irreducible part of it is decided by discs around its computed eigenvalues or by a Lyapunov function
    (docs/theory.md, "Schur").

    Parameters
    ----------
    *steps : arrays, shape (n, n)
        The mode, or the modes of the word, first step first.

    Returns
    -------
    bool
        A spectral radius between 1 - 1e-12 and 1 may count as 1.

    Raises
    ------
    numpy.linalg.LinAlgError
        If rounding hides the answer.

    Examples
    --------
    >>> is_schur(np.array([[0.5, 100.0], [0.0, 0.9]])), is_schur(np.array([[0.0, 1.0], [-1.0, 0.0]]))
    (True, False)
    """
    leads = np.any([A != 0 for A in steps], axis=0) | np.eye(len(steps[0]), dtype=bool)
    for _ in range(len(leads).bit_length()):
        leads = leads @ leads
    parts = {tuple(np.flatnonzero(row)) for row in leads & leads.T}
    verdicts = [_part_is_schur([A[np.ix_(part, part)] for A in steps]) for part in parts]
    if None in verdicts and False not in verdicts:
        radius = np.abs(np.linalg.eigvals(_product(steps))).max()
        raise np.linalg.LinAlgError(
            "whether the mode is Schur is undecided: rounding hides it, for its powers grow before they shrink, or "
            f"a multiple pole is near the unit circle (spectral radius about {radius:.6g}); rescale the states"
        )
    return False not in verdicts


def _part_is_schur(steps: list[Array]) -> bool | None:
    """What discs around the eigenvalues, or a Lyapunov function, prove; None where neither does."""
    M = _product(steps)
    if len(M) == 1:
        return bool(abs(M[0, 0]) < 1 - 1e-14 * len(steps))
    lower, upper = _radii(steps, M)
    if (upper < 1).all():
        return True
    beyond = ~((lower < lower[:, None]) & (upper >= lower[:, None])).any(axis=1)  # no disc is partly nearer to zero
    if (beyond & (lower > 1 - 1e-12)).any():
        return False
    D = np.eye(len(M))
    for _ in range(2):  # the second time in units that fit each state
        if _majorant(steps, M, D, D) is not None:
            return True
        D = np.diag(np.diag(_doubled(M, D)))
    return False if _some_beyond(steps, M) else None


@np.errstate(over="ignore", invalid="ignore")
def _some_beyond(steps: list[Array], M: Array) -> bool:
    """Whether the mean of some eigenvalues near each other has modulus 1, so that not all of them are less.

    Rounding moves a multiple eigenvalue much and such a mean little: by the perturbation times the norm of the projector
    on their invariant subspace, whose complement the other eigenvectors span.
    """
    (values, V), (lefts, W) = np.linalg.eig(M), np.linalg.eig(M.T)
    size = np.abs(_product([np.abs(A) for A in steps]))
    for near, count in product(values[np.abs(values) > 1 - 1e-4], range(2, len(M) + 1)):
        far, left_far = np.abs(values - near).argsort()[count:], np.abs(lefts - near).argsort()[count:]
        U = np.linalg.qr(W[:, left_far].conj(), mode="complete")[0][:, len(M) - count :]
        Z = np.linalg.qr(V[:, far], mode="complete")[0][:, len(M) - count :]
        B = U.conj().T @ M @ U
        wrong = np.linalg.norm(M @ U - U @ B) + len(steps) * len(M) * _EPS * np.linalg.norm(size)
        projector = 1 / np.linalg.svd(Z.conj().T @ U, compute_uv=False).min()
        if abs(np.trace(B)) / count - 2 * wrong * projector > 1 - 1e-12:
            return True
    return False


@np.errstate(over="ignore", invalid="ignore")
def _radii(steps: list[Array], M: Array) -> tuple[Array, Array]:
    """Of Gershgorin's discs around the eigenvalues of a product: how near to zero and how far from it they reach.

    In the basis V of the computed eigenvectors, the product is L, diagonal, but for ``V^-1 (M V - V L)``.
    """
    eigenvalues, V = np.linalg.eig(M)
    try:
        W = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return np.zeros(len(M)), np.full(len(M), np.inf)
    moved = [V]
    for A in steps:
        moved.append(A @ moved[-1])
    left, rounding = W, np.abs(W) @ (np.abs(V) * np.abs(eigenvalues))
    for A, X in zip(reversed(steps), reversed(moved[:-1]), strict=True):
        left, rounding = left @ A, rounding + np.abs(left) @ (np.abs(A) @ np.abs(X))
    off = np.abs(W @ (moved[-1] - V * eigenvalues)) + len(M) * _EPS * rounding
    unit = np.where(np.abs(eigenvalues) > 0.999, 1e6, 1.0)  # of the eigenvectors: it makes the discs that matter small
    wrong = np.max(np.abs(W @ V - np.eye(len(M))) @ unit / unit)  # the inverse
    radius = off @ unit / unit / (1 - wrong) if wrong < 0.5 else np.full(len(M), np.inf)
    known = np.isfinite(np.abs(eigenvalues) + radius)
    return np.where(known, np.abs(eigenvalues) - radius, 0.0), np.where(known, np.abs(eigenvalues) + radius, np.inf)


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
    period = _along(steps, weights, np.zeros_like(weights[0]))[-1]
    if not np.isfinite(period).all():
        raise np.linalg.LinAlgError("the cost of a period exceeds the floating-point range: rescale the states")
    states = seen(_product(steps), period)
    for k in reversed(range(len(steps))):
        steps[k] = np.where(states[:, None], steps[k], 0.0)
        states = (np.diag(weights[k]) > 0) | (steps[k] != 0).any(axis=0)
    if not is_schur(*steps):
        return None
    M = _product(steps)
    P = _doubled(M, period)
    worth = _along(steps, weights, P)
    D, sizes = _sizes(steps, weights, worth)
    Z = _majorant(steps, M, D, sizes)
    if Z is not None:
        error = 2 * (_scaled_norm(worth[-1] - P, D) + len(M) * _EPS) * np.diag(Z)
        if (error <= _ACCURACY * np.diag(P)).all():
            return P
    raise np.linalg.LinAlgError(
        f"the cost for ever cannot be computed to a relative error of {_ACCURACY} (spectral radius "
        f"{np.abs(np.linalg.eigvals(M)).max():.12g}, greatest entry {np.abs(P).max():.3g}): rescale the states"
    )


def _product(steps: Sequence[Array]) -> Array:
    """What steps make together, the first one on the right."""
    M = steps[0]
    for A in steps[1:]:
        M = A @ M
    return M


def _along(steps: Sequence[Array], weights: Sequence[Array], P: Array) -> list[Array]:
    """What P is worth after some steps, before the last of them, .., and before them all, with their weights."""
    worth = [P]
    for A, Q in zip(reversed(steps), reversed(weights), strict=True):
        worth.append(Q + transform(A, worth[-1]))
    return worth


def _sizes(steps: Sequence[Array], weights: Sequence[Array], worth: Sequence[Array]) -> tuple[Array, Array]:
    """How great the terms are that rounding acts on in `_along`, at the first step and in all, as worth before them."""
    D = sizes = np.zeros_like(worth[0])
    for A, Q, later, P in zip(reversed(steps), reversed(weights), worth[:-1], worth[1:], strict=True):
        D = np.diag(np.diag(np.abs(A).T @ np.abs(later) @ np.abs(A) + np.abs(Q) + np.abs(P)))
        sizes = D + transform(A, sizes)
    return D, sizes


def _majorant(steps: Sequence[Array], M: Array, D: Array, sizes: Array) -> Array | None:
    """``Z = sizes + M' Z M``, at most half of it missing; None where that can't be shown.

    As sizes is D (diagonal) or more, this proves the word Schur on the states of D.
    """
    Z = _doubled(M, sizes)
    if not np.isfinite(Z).all():
        return None
    none = [np.zeros_like(M)] * len(steps)
    worth = _along(steps, none, Z)
    rounding = len(M) * _EPS * _scaled_norm(_sizes(steps, none, worth)[1], D)
    shown = _scaled_norm(sizes + worth[-1] - Z, D) + rounding < 0.5
    return Z if shown and np.linalg.eigvalsh(_scaled(Z, D)).min() > -1e-3 else None


def _scaled(R: Array, D: Array) -> Array:
    """``D^(-1/2) R D^(-1/2)``, D diagonal; where D_ii is zero, so is R."""
    root = np.sqrt(np.diag(D))
    scale = np.outer(root, root)
    return np.divide(R, scale, out=np.zeros_like(R), where=scale > 0)


def _scaled_norm(R: Array, D: Array) -> float:
    scaled = _scaled(R, D)
    return float(np.linalg.norm(scaled, 2)) if np.isfinite(scaled).all() else np.inf


def _doubled(M: Array, Q: Array) -> Array:
    """``sum_k M'^k Q M^k`` of a Schur mode, by doubling until the power vanishes; of others anything, NaN perhaps."""
    G = Q
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            if np.linalg.norm(M) < 1e-20:
                break
            G, M = G + transform(M, G), M @ M
    return G
