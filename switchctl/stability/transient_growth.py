"""How large a state gets while one mode is held: the greatest of the norms ``||A^k||_2``, over all k."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.gramians import tail
from switchctl.moments import Array
from switchctl.stability.growth import Verdict

_ACCURACY = 1e-9
_INTERVALS = 2048  # of steps, that are looked into at once
_DOUBLINGS = 47
_FIRST = 512  # steps looked at one by one
_FAST, _WEIGHT = 5, 1e5  # what falls so many times as fast as the slowest gets a weight: it is soon over
_SEEN = 10  # doublings, for a mode not known to be stable
_ROUNDING = 1e-9  # room for it in a bound


class TransientGrowth(NamedTuple):
    """The transient growth of a mode; see `transient_growth`.

    Parameters
    ----------
    lower, upper : float
        Bounds of the greatest ``||A^k||_2``; infinite where the powers grow without end. As a rule they are equal but
        for a relative 1e-9.
    step : int or None
        The k at which it is ``lower``; None where it is infinite.
    """

    lower: float
    upper: float
    step: int | None

    def __str__(self) -> str:
        between = f"{self.lower:.6g}", f"{self.upper:.6g}"
        return between[0] if between[0] == between[1] else " to ".join(between)


def transient_growth(A: Array, stability: Verdict) -> TransientGrowth:
    """Find the greatest ``||A^k||_2``, k = 0, 1, ..: the most that a state grows while the mode is held.

    A branch and bound over intervals of steps. After step a of an interval of L steps, the norms are at most
    ``||A^a||`` times the greatest of L powers, and ``||T^-1|| ||T A^a||`` for a T in whose norm A never grows: of a
    Lyapunov function, or of eigenvectors. The first power below 1 ends the search: later ones are products of it and
    those before.

    Parameters
    ----------
    A : array, shape (n, n)
        The mode.
    stability : {"stable", "unstable", "undecided"}
        Whether it is Schur stable (see `schur_stability`). Where that is undecided so is the upper bound, infinite.

    Returns
    -------
    TransientGrowth
        What is proven is so up to the rounding of the powers.

    Examples
    --------
    >>> from switchctl.stability.transient_growth import transient_growth
    >>> print(transient_growth(np.array([[0.5, 9.0], [0.0, 0.5]]), "stable"))
    9.02769
    """
    if stability == "unstable":
        return TransientGrowth(np.inf, np.inf, None)
    with np.errstate(over="ignore", invalid="ignore"):  # powers that are not finite never fall below 1
        return _searched(A, stability)


def _searched(A: Array, stability: Verdict) -> TransientGrowth:
    """The branch and bound."""
    norms, powers = _norms(A), [A]  # A^(2^i)
    while len(powers) <= (_DOUBLINGS if stability == "stable" else _SEEN) and not np.linalg.norm(powers[-1], 2) < 1:
        powers.append(powers[-1] @ powers[-1])
    ceilings = [1.0]  # of the norms of the first 2^i powers
    for power in powers[:-1]:
        later = min(float(np.linalg.norm(power, 2)) * ceilings[-1], float(_envelope(norms, power)))
        ceilings.append(max(ceilings[-1], later * (1 + _ROUNDING)))
    starts, M = np.zeros(1, dtype=np.int64), np.eye(len(A))[None]
    first = power_norms(A, np.arange(_FIRST))
    step = int(np.argmax(first > first.max() / (1 + _ACCURACY)))
    best, dropped = float(first[step]), 0.0
    for i in reversed(range(len(powers) - 1)):
        starts, M = np.concatenate([starts, starts + 2**i]), np.concatenate([M, M @ powers[i]])
        size = np.linalg.norm(M, 2, axis=(1, 2))
        if size.max() > best * (1 + _ACCURACY):
            best, step = float(size.max()), int(starts[size.argmax()])
        bounds = np.minimum(size * ceilings[i], _envelope(norms, M)) * (1 + _ROUNDING)
        kept = np.flatnonzero(bounds > best * (1 + 2 * _ROUNDING))
        if len(kept) > _INTERVALS:
            order = kept[np.argsort(-size[kept], kind="stable")]
            kept, dropped = order[:_INTERVALS], max(dropped, float(bounds[order[_INTERVALS:]].max()))
        starts, M = starts[kept], M[kept]
        if not len(starts):
            break
    finished = stability == "stable" and float(np.linalg.norm(powers[-1], 2)) < 1
    return TransientGrowth(best, max(best, dropped) if finished else np.inf, step)


def power_norms(A: Array, steps: NDArray[np.integer]) -> Array:
    """``||A^k||_2`` at given steps.

    Parameters
    ----------
    A : array, shape (n, n)
        The mode.
    steps : int array, shape (N,)
        The k.

    Returns
    -------
    array, shape (N,)
        Infinite, or not a number, where a power exceeds the floating-point range.
    """
    M, power = np.tile(np.eye(len(A)), (len(steps), 1, 1)), A
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(int(steps.max()).bit_length()):
            M = np.where((steps >> i & 1).astype(bool)[:, None, None], M @ power, M)
            power = power @ power
    sizes = np.full(len(M), np.inf)
    finite = np.isfinite(M).all(axis=(1, 2))
    sizes[finite] = np.linalg.norm(M[finite], 2, axis=(1, 2))
    return sizes


def _norms(A: Array) -> list[tuple[Array, float]]:
    """Some T in whose norm ``||T x||_2`` the mode never grows, and the norms of their inverses."""
    candidates: list[Any] = []
    values, vectors = np.linalg.eig(A)
    radius = float(np.abs(values).max())
    try:
        weight = tail(A / np.sqrt(radius), np.eye(len(A))) if 0 < radius < 1 else None
        if weight is not None:
            candidates.append(np.linalg.cholesky(weight).T)
    except np.linalg.LinAlgError:
        pass
    if np.linalg.cond(vectors) < 1e8:
        fast = np.abs(values) < radius**_FAST
        candidates += [np.where(fast, weight, 1.0)[:, None] * np.linalg.inv(vectors) for weight in (1.0, _WEIGHT)]
    found = []
    for T in candidates:
        back: Array = np.linalg.inv(T)
        if np.linalg.norm(T @ A @ back, 2) < 1:
            found.append((T, float(np.linalg.norm(back, 2))))
    return found


def _envelope(norms: list[tuple[Array, float]], M: Array) -> Array:
    """A bound of the norm of M and of all later powers."""
    bounds = [back * np.linalg.norm(T @ M, 2, axis=(-2, -1)) for T, back in norms]
    return np.min(bounds, axis=0) if bounds else np.full(M.shape[:-2], np.inf)
