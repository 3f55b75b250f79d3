"""How fast second moments grow or fall at most and at least, each with a witness.

``T* P <= upper^2 P`` with P positive definite bounds every moment from above; ``T* H >= lower^2 H`` with a state x for
which ``x' H x > 0`` shows one that grows that fast (docs/theory.md). Both are found in floating point, and returned
only where the inequalities hold in spite of rounding.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from switchctl.moments import Array
from switchctl.stability.moment_operator import MomentOperator, Move
from switchctl.tables import Summary
from switchctl.validation import frozen

Verdict = Literal["stable", "unstable", "undecided"]

_EPS = np.finfo(float).eps
_LEAST = float(np.finfo(float).tiny)  # what underflows is less
_FINEST, _COARSER = 1e-13, 4.0  # the gaps tried between a bound and the estimate, as a fraction


def verdict(lower: float, upper: float) -> Verdict:
    """Whether states vanish, given bounds of their growth by a step."""
    return "stable" if upper < 1 else "unstable" if lower >= 1 else "undecided"


class Stationary(NamedTuple):
    """What process noise keeps the state at: how often each node is visited, and the second moment there.

    A node that is not visited in the long run has the share 0 and, here, the moment 0.

    Parameters
    ----------
    share : array, shape (nodes,)
        How often each node is visited, of 1.
    given : array, shape (nodes, n, n)
        The second moment when it is.
    """

    share: Array
    given: Array

    @property
    def total(self) -> Array:
        """The second moment whatever the node, the mean over time."""
        return np.einsum("v,vij->ij", self.share, self.given)


@dataclass(frozen=True, eq=False, repr=False)
class GrowthRate(Summary):
    """Bounds of the rate at which second moments grow or fall: in the long run ``tr S(k)`` goes as ``rate^(2k)``.

    The rate is the square root of the spectral radius of the moments' operator: of a mode its spectral radius, of a
    word that of its product per step.

    Parameters
    ----------
    of : str
        What is switched how.
    lower, upper : float
        The bounds: ``lower <= rate <= upper``.
    moves : tuple of Move
        The moves, with tail, head, mode, weight and A each.
    P : array, shape (nodes, n, n)
        The witness of the upper bound: positive definite, and ``sum_e p_e A_e' P_head A_e <= upper^2 P_tail`` over the
        moves from each node.
    H : array, shape (nodes, n, n)
        The witness of the lower bound: symmetric, and ``sum_e p_e A_e' H_head A_e >= lower^2 H_tail``.
    start : tuple of int and array, shape (n,)
        A node v and a state x with ``x' H_v x > 0``: from there, moments grow at ``lower`` at least.
    stationary : Stationary or None
        With process noise, where the moments fall without it: what they settle at.

    Examples
    --------
    >>> from switchctl.stability import schur_stability
    >>> rate, = schur_stability(ModeSet([[[0.5, 1.0], [0.0, 0.25]]]))
    >>> rate.verdict, rate.lower <= 0.5 <= rate.upper, round(rate.upper, 9)
    ('stable', True, 0.5)
    """

    of: str
    lower: float
    upper: float
    moves: tuple[Move, ...] = field(repr=False)
    P: Array = field(repr=False)
    H: Array = field(repr=False)
    start: tuple[int, Array] = field(repr=False)
    stationary: Stationary | None = None

    @property
    def verdict(self) -> Verdict:
        """Mean-square stability: "stable", "unstable" (moments don't fall to zero from every state) or "undecided"."""
        return verdict(self.lower, self.upper)

    @property
    def word(self) -> tuple[int, ...]:
        """The modes along the moves, in their order: of a word, its modes."""
        return tuple(move.mode for move in self.moves)

    def _facts(self) -> list[tuple[str, str]]:
        nodes, moves = len(self.P), len(self.moves)
        facts = [
            ("of", self.of),
            ("rate", f"between {self.lower:.9g} and {self.upper:.9g} per step"),
            ("graph", f"{nodes} node{'s' * (nodes > 1)}, {moves} move{'s' * (moves > 1)}"),
        ]
        if self.stationary is not None:
            facts.append(("stationary", f"second moment of trace {np.trace(self.stationary.total):.6g}"))
        return facts

    def _heading(self) -> str:
        return f"GrowthRate: {self.verdict}"


def growth_rate(of: str, moves: Sequence[Move], nodes: int, noise: tuple[Array, Array] | None = None) -> GrowthRate:
    """Bound the growth of moments over a graph.

    Parameters
    ----------
    of : str
        What is switched how.
    moves : sequence of Move
        The moves.
    nodes : int
        How many nodes there are.
    noise : tuple of arrays, shapes (nodes,) and (nodes, n, n), optional
        How often each node is visited, and the covariance of the noise added on arrival there, times that.

    Returns
    -------
    GrowthRate
    """
    operator = MomentOperator(moves, nodes)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        unit, step = operator.units()
        scaled = operator.rescaled(unit, step)
        each = np.broadcast_to(np.eye(scaled.n), (nodes, scaled.n, scaled.n))
        ceiling = float(np.linalg.eigvalsh(scaled.before(each)).max()) * (1 + 1e-9) + _LEAST
        upper, P = _upper(scaled, each, ceiling) if operator.A.any() else (0.0, np.array(each))
        lower, H, (node, x) = _lower(scaled, each, ceiling)
        upper, lower = (float(np.ldexp(bound, step)) for bound in (upper, lower))
        upper = float(np.nextafter(upper, np.inf)) if upper < _LEAST and operator.A.any() else upper
        lower = float(np.nextafter(lower, 0.0)) if not _LEAST <= lower < np.inf else lower
        stationary = None
        if noise is not None and upper < 1:
            stationary = _stationary(operator, *noise)
        middle = (unit.max() + unit.min()) // 2  # of the range of what the witnesses hold
        P, H = (np.ldexp(X, 2 * middle - unit - unit[:, None]) for X in (P, H))
        x = np.ldexp(x, unit - middle)
    return GrowthRate(of, lower, upper, tuple(moves), frozen(P), frozen(H), (node, frozen(x)), stationary)


def transient(moves: Sequence[Move], nodes: int, rate: float) -> float:
    """A number c with ``tr S(k) <= c rate^(2k) tr S(0)``, whatever the state and node at the start.

    Parameters
    ----------
    moves : sequence of Move
        The moves.
    nodes : int
        How many nodes there are.
    rate : float
        A rate above that of the moves.

    Returns
    -------
    float
        Infinite where rounding hides it.
    """
    operator = MomentOperator(moves, nodes)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        P = -operator.solve(rate**2, np.broadcast_to(np.eye(operator.n), (nodes, operator.n, operator.n)))
        if not (np.isfinite(P).all() and falls(operator, P, rate**2)):
            return np.inf
        eigenvalues = np.linalg.eigvalsh(P)
    least = float(eigenvalues.min()) - 8 * operator.n * _EPS * float(eigenvalues.max())
    return float(eigenvalues.max()) / least * (1 + 1e-9) if least > 0 else np.inf


def _upper(operator: MomentOperator, each: Array, ceiling: float) -> tuple[float, Array]:
    """The least of some numbers for which ``(g - T*) P = R`` has a positive definite solution, for an R above zero."""
    for g in _above(operator.radius, ceiling):
        R = each
        for _ in range(2):
            P = _normalised(-operator.solve(g, R))
            diagonal = np.einsum("vii->vi", P)
            if not (np.isfinite(P).all() and (diagonal > 0).all()):
                break
            if falls(operator, P, g):
                return float(np.nextafter(np.sqrt(g), np.inf)), P
            R = each * np.exp2(np.round(np.log2(diagonal)))[:, None]  # in units in which P is balanced
    return float(np.nextafter(np.sqrt(ceiling), np.inf)), np.array(each)


def _lower(operator: MomentOperator, each: Array, ceiling: float) -> tuple[float, Array, tuple[int, Array]]:
    """The greatest of some numbers for which ``(T* - g) H = R`` has a solution with a positive direction."""
    for g in _below(operator.radius, ceiling):
        R = each
        for _ in range(2):
            H = _normalised(operator.solve(g, R))
            diagonal = np.abs(np.einsum("vii->vi", H))
            if not (np.isfinite(H).all() and diagonal.all()):
                break
            values, vectors = np.linalg.eigh(H)
            node = int(values[:, -1].argmax())
            x = vectors[node, :, -1]
            slack = 8 * len(x) * _EPS * float(np.abs(x) @ np.abs(H[node]) @ np.abs(x))
            if x @ H[node] @ x > slack and rises(operator, H, g):
                return float(np.nextafter(np.sqrt(g), 0.0)), H, (node, x)
            R = each * np.exp2(np.round(np.log2(diagonal)))[:, None]
    return 0.0, np.array(each), (0, np.eye(operator.n)[0])


def _above(radius: float, ceiling: float) -> Iterator[float]:
    gap = _FINEST
    while gap < 1:
        yield radius * (1 + gap)
        gap *= _COARSER
    g = max(2 * radius, 1e-40 * ceiling)
    while g < ceiling:
        yield g
        g *= 8


def _below(radius: float, ceiling: float) -> Iterator[float]:
    gap = _FINEST
    while gap < 1 and radius > 1e-40 * ceiling:
        yield radius * (1 - gap)
        gap *= _COARSER


def _normalised(X: Array) -> Array:
    """The same times a power of two that makes its greatest entry about 1."""
    greatest = np.abs(X).max()
    return np.ldexp(X, -int(np.frexp(greatest)[1])) if np.isfinite(greatest) else X


def falls(operator: MomentOperator, P: Array, g: float) -> bool:
    """Whether P is positive definite and ``T* P <= g P``, in spite of rounding."""
    return definite(P, np.zeros_like(P)) and definite(g * P - operator.before(P), _rounding(operator, P, g))


def rises(operator: MomentOperator, H: Array, g: float) -> bool:
    """Whether ``T* H >= g H``, in spite of rounding."""
    return definite(operator.before(H) - g * H, _rounding(operator, H, g))


def _rounding(operator: MomentOperator, P: Array, g: float) -> Array:
    """What ``g P - T* P`` may be wrong by, entry by entry, with room for a bound's square that is rounded too."""
    terms = 2 * operator.n + len(operator.tails) + 16
    return terms * _EPS * (operator.size(P) + g * np.abs(P)) + terms * operator.n * _LEAST


def definite(X: Array, wrong: Array) -> bool:
    """Whether symmetric matrices, whose entries may be wrong by so much, are positive definite: not so if in doubt.

    Parameters
    ----------
    X, wrong : arrays, shape (..., n, n)
        The matrices, and bounds of their errors.

    Returns
    -------
    bool
    """
    n, diagonal = X.shape[-1], np.diagonal(X, axis1=-2, axis2=-1)
    if not (np.isfinite(X).all() and np.isfinite(wrong).all() and (diagonal > 0).all()):
        return False
    unit = np.exp2(np.round(np.log2(diagonal) / 2))
    X, wrong = (M / unit[..., :, None] / unit[..., None, :] for M in (X, wrong))
    allowance = np.linalg.norm(wrong, axis=(-2, -1)) + 4 * n * _EPS * np.linalg.norm(X, axis=(-2, -1))
    return bool(np.isfinite(X).all() and (np.linalg.eigvalsh(X)[..., 0] > allowance).all())


def _stationary(operator: MomentOperator, share: Array, noise: Array) -> Stationary:
    """``S = T S + noise``, divided by how often each node is visited."""
    S = -operator.reversed().solve(1.0, noise)
    often = share[:, None, None] > 0
    return Stationary(frozen(share), frozen(np.divide(S, share[:, None, None], out=np.zeros_like(S), where=often)))
