"""The kernel's verdict whether a mode, or a word, is Schur stable, and how great the rounding is in what proves it."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from switchctl.moments import Array, transform

_DOUBLINGS = 60
EPS = float(np.finfo(float).eps)


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
        radius = np.abs(np.linalg.eigvals(word_product(steps))).max()
        raise np.linalg.LinAlgError(
            "whether the mode is Schur is undecided: rounding hides it, for its powers grow before they shrink, or "
            f"a multiple pole is near the unit circle (spectral radius about {radius:.6g}); rescale the states"
        )
    return False not in verdicts


def _part_is_schur(steps: list[Array]) -> bool | None:
    """What discs around the eigenvalues, or a Lyapunov function, prove; None where neither does."""
    M = word_product(steps)
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
        if majorant(steps, M, D, D) is not None:
            return True
        D = np.diag(np.fmax(np.diag(doubled(M, D)), 1.0))  # rounding may make it anything, NaN too
    return False if _some_beyond(steps, M) else None


@np.errstate(over="ignore", invalid="ignore")
def _some_beyond(steps: list[Array], M: Array) -> bool:
    """Whether the mean of some eigenvalues near each other has modulus 1, so that not all of them are less.

    Rounding moves a multiple eigenvalue much and such a mean little: by the perturbation times the norm of the
    projector on their invariant subspace. With c the mean, that is nearly the null space of ``(M - c I)^count``.
    """
    values = np.linalg.eigvals(M)
    rounding = len(steps) * len(M) * EPS * np.linalg.norm(word_product([np.abs(A) for A in steps]))
    for near, count in product(values[np.abs(values) > 1 - 1e-4], range(2, len(M) + 1)):
        mean = values[np.abs(values - near).argsort()[:count]].mean()
        left, _, right = np.linalg.svd(np.linalg.matrix_power(M - mean * np.eye(len(M)), count))
        Z, U = left[:, -count:], right[-count:].conj().T
        B = U.conj().T @ M @ U
        projector = 1 / np.linalg.svd(Z.conj().T @ U, compute_uv=False).min()
        wrong = (np.linalg.norm(M @ U - U @ B) + rounding) * projector
        if abs(np.trace(B)) / count - 2 * wrong > 1 - 1e-12:
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
    off = np.abs(W @ (moved[-1] - V * eigenvalues)) + len(M) * EPS * rounding
    unit = np.where(np.abs(eigenvalues) > 0.999, 1e6, 1.0)  # of the eigenvectors: it makes the discs that matter small
    wrong = np.max(np.abs(W @ V - np.eye(len(M))) @ unit / unit)  # the inverse
    radius = off @ unit / unit / (1 - wrong) if wrong < 0.5 else np.full(len(M), np.inf)
    known = np.isfinite(np.abs(eigenvalues) + radius)
    return np.where(known, np.abs(eigenvalues) - radius, 0.0), np.where(known, np.abs(eigenvalues) + radius, np.inf)


def word_product(steps: Sequence[Array]) -> Array:
    """What steps make together, the first one on the right."""
    M = steps[0]
    for A in steps[1:]:
        M = A @ M
    return M


def along(steps: Sequence[Array], weights: Sequence[Array], P: Array) -> list[Array]:
    """What P is worth after some steps, before the last of them, .., and before them all, with their weights."""
    worth = [P]
    for A, Q in zip(reversed(steps), reversed(weights), strict=True):
        worth.append(Q + transform(A, worth[-1]))
    return worth


def rounded_sizes(steps: Sequence[Array], weights: Sequence[Array], worth: Sequence[Array]) -> tuple[Array, Array]:
    """How great the terms are that rounding acts on in `along`, at the first step and in all, as worth before them."""
    D = sizes = np.zeros_like(worth[0])
    for A, Q, later, P in zip(reversed(steps), reversed(weights), worth[:-1], worth[1:], strict=True):
        D = np.diag(np.diag(np.abs(A).T @ np.abs(later) @ np.abs(A) + np.abs(Q) + np.abs(P)))
        sizes = D + transform(A, sizes)
    return D, sizes


def majorant(steps: Sequence[Array], M: Array, D: Array, sizes: Array) -> Array | None:
    """``Z = sizes + M' Z M``, at most half of it missing; None where that can't be shown.

    As sizes is D (diagonal) or more, this proves the word Schur on the states of D.
    """
    Z = doubled(M, sizes)
    if not np.isfinite(Z).all():
        return None
    none = [np.zeros_like(M)] * len(steps)
    worth = along(steps, none, Z)
    rounding = len(M) * EPS * scaled_norm(rounded_sizes(steps, none, worth)[1], D)
    shown = scaled_norm(sizes + worth[-1] - Z, D) + rounding < 0.5
    return Z if shown and np.linalg.eigvalsh(in_units(Z, D)).min() > -1e-3 else None


def in_units(R: Array, D: Array) -> Array:
    """``D^(-1/2) R D^(-1/2)``, D diagonal; where D_ii is zero, so is R."""
    root = np.sqrt(np.diag(D))
    scale = np.outer(root, root)
    return np.divide(R, scale, out=np.zeros_like(R), where=scale != 0)


def scaled_norm(R: Array, D: Array) -> float:
    """The spectral norm of ``D^(-1/2) R D^(-1/2)``; infinite beyond the floating-point range."""
    scaled = in_units(R, D)
    return float(np.linalg.norm(scaled, 2)) if np.isfinite(scaled).all() else np.inf


def doubled(M: Array, Q: Array) -> Array:
    """``sum_k M'^k Q M^k`` of a Schur mode, by doubling until the power vanishes; of others anything, NaN perhaps."""
    G = Q
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            if np.linalg.norm(M) < 1e-20:
                break
            G, M = G + transform(M, G), M @ M
    return G
