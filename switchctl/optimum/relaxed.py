"""Relaxed dynamic programming: a value function of few quadratics, and how far it may be above the optimum.

With finitely many P at every choice, ``V_v(S) = min_P tr(P S) + constant``. Each P is what some way on costs, so the
run that takes, at each choice, the move of least cost and value costs at most V. And where ``V_v(S) <= f c_e(S) +
V_w(S_e)`` on every move e from v to w, of cost c_e, V is at most f times the optimum, for every S. That holds for a
move and a P at its head if and only if a convex combination of the P at v is below ``f Q_e + A_e' P A_e`` (and so for
the constants): a small semidefinite program. (B. Lincoln and A. Rantzer, Relaxing dynamic programming, IEEE
Transactions on Automatic Control 51, 2006, prune by such inequalities.)
"""

import heapq
import time
from typing import NamedTuple

import numpy as np
from scipy import sparse
from tqdm import tqdm

from switchctl.continuation import Continuations, Plan
from switchctl.moments import Array, svec, transform
from switchctl.optimum.decisions import Decisions, Move
from switchctl.optimum.programs import solution, solver

_ROUNDING = 1e-9  # what is taken off the guarantee for rounding in the P themselves


class Values(NamedTuple):
    """The quadratics at a choice, in scaled states and per dk: matrices, constants, and the ways on they are of."""

    P: Array
    constants: Array
    plans: list[Plan]


class _Pair(NamedTuple):
    """A move from a choice and then one of the quadratics at its head."""

    u: int
    number: int
    quadratic: int


class RelaxedValues:
    """Quadratics at every choice, grown until the factor is small enough.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves, all met, of a run that goes on for ever.

    Attributes
    ----------
    values : dict of int to Values
        By choice.
    factor : float
        The value is at most so many times the optimum, for every second moment.
    """

    def __init__(self, decisions: Decisions) -> None:
        self.decisions, self.factor, self.interrupted = decisions, np.inf, False
        ways = Continuations(decisions.graph)
        self.values: dict[int, Values] = {}
        for u, (_, v) in enumerate(decisions.places):
            numbers = np.flatnonzero(ways.finite[:, v]).tolist()
            found = [ways.value(v, number) for number in numbers]
            P = decisions.scaled_cost(np.array([value.P for value in found]).reshape(-1, decisions.n, decisions.n))
            plans = [ways.path(v, number) for number in numbers]
            self.values[u] = Values(P, np.array([value.constant for value in found]), plans)
        self.size = sum(len(values.P) for values in self.values.values())

    def grow(self, wanted: float, most: int, deadline: float) -> None:
        """Add the quadratic that is wanted most, again and again; Ctrl-C ends it with the factor proven so far.

        Parameters
        ----------
        wanted : float
            The factor to reach.
        most : int
            The most quadratics in all.
        deadline : float
            When to stop, on the clock of `time.perf_counter`.
        """
        # A factor can only fall as quadratics are added, so the greatest of old ones is the only one to compute anew.
        waiting = [(-np.inf, pair) for u in self.values for pair in self._pairs_from(u)]
        heapq.heapify(waiting)
        known: dict[_Pair, int] = {}
        try:
            with tqdm(desc="policy", unit="quadratic", delay=2, leave=False) as progress:
                while waiting:
                    if time.perf_counter() > deadline:  # old factors can only be too great
                        self.factor = -waiting[0][0] * (1 + _ROUNDING)
                        break
                    factor, pair = -waiting[0][0], waiting[0][1]
                    if known.get(pair) != len(self.values[pair.u].P):
                        known[pair] = len(self.values[pair.u].P)
                        heapq.heapreplace(waiting, (-self._needed(pair), pair))
                        continue
                    self.factor = factor * (1 + _ROUNDING)
                    progress.set_postfix(factor=f"{self.factor:.6g}", refresh=False)
                    if self.factor <= wanted or self.size >= most:
                        break
                    heapq.heappop(waiting)
                    for new in self._add(pair):
                        heapq.heappush(waiting, (-np.inf, new))
                    progress.update()
        except KeyboardInterrupt:
            self.interrupted = True

    def _pairs_from(self, u: int) -> list[_Pair]:
        moves = self.decisions.moves(u)
        return [_Pair(u, i, q) for i, move in enumerate(moves) for q in range(len(self.values[move.head].P))]

    def _add(self, pair: _Pair) -> list[_Pair]:
        """Take the pair itself as a quadratic; the pairs that come with it."""
        u, (P, constant) = pair.u, self._worth(pair, 1.0)
        values = self.values[u]
        place = len(values.P)
        move = self._move(pair)
        lead, word = self.values[move.head].plans[pair.quadratic]
        plans = [*values.plans, (move.word + lead, word)]
        self.values[u] = Values(np.concatenate([values.P, P[None]]), np.append(values.constants, constant), plans)
        self.size += 1
        found = []
        for tail in self.values:
            moves = self.decisions.moves(tail)
            found += [_Pair(tail, i, place) for i, move in enumerate(moves) if move.head == u]
        return found

    def _move(self, pair: _Pair) -> Move:
        return self.decisions.moves(pair.u)[pair.number]

    def _worth(self, pair: _Pair, factor: float) -> tuple[Array, float]:
        """``f Q + A' P A``, and the same of the constants."""
        move = self._move(pair)
        values = self.values[move.head]
        P = factor * move.Q + transform(move.A, values.P[pair.quadratic])
        return P, float(factor * move.constant + values.constants[pair.quadratic])

    def _needed(self, pair: _Pair) -> float:
        """The least factor for which a convex combination of the quadratics is below; infinite if none is found."""
        P, constants, _ = self.values[pair.u]
        move = self._move(pair)
        head, constant = self._worth(pair, 0.0)
        root = np.linalg.inv(np.linalg.cholesky(move.Q))  # in units where Q is the identity
        below, above = root @ P @ root.T, root @ head @ root.T
        single = [
            max(1.0, float(np.linalg.eigvalsh(p - above)[-1]), _ratio(float(k), constant, move.constant))
            for p, k in zip(below, constants, strict=True)
        ]
        least = min(single)
        if least == 1.0 or len(P) == 1:
            return least
        weights = _combination(below, above, constants - constant, move.constant)
        if weights is not None:
            mixed = np.tensordot(weights, below, 1) - above
            margin = 1e-13 * (float(np.abs(below).max()) + float(np.abs(above).max())) * len(above)
            factor = max(
                float(np.linalg.eigvalsh(mixed)[-1]) + margin,
                _ratio(float(weights @ constants), constant, move.constant),
            )
            least = min(least, max(1.0, factor))
        return least


def _ratio(here: float, ahead: float, paid: float) -> float:
    """The least factor f with ``here <= f paid + ahead``, constants all."""
    if here - ahead <= 1e-12 * here:
        return 1.0
    return (here - ahead) / paid if paid > 0 else np.inf


def _combination(below: Array, above: Array, excess: Array, constant: float) -> Array | None:
    """Weights a with the least f such that ``sum_p a_p P_p <= f I + M`` and ``a . excess <= f constant``."""
    clarabel = solver()

    r, n, _ = below.shape
    # variables (a, f); a >= 0, sum a = 1, and f I + M - sum a P semidefinite
    rows = [
        np.append(np.ones(r), 0.0)[None],
        np.column_stack([-np.eye(r), np.zeros(r)]),
        np.append(excess, -constant)[None],
        np.column_stack([svec(below).T, -svec(np.eye(n))]),
    ]
    b = np.concatenate([[1.0], np.zeros(r), [0.0], svec(above)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(r + 1), clarabel.PSDTriangleConeT(n)]
    found = solution(np.append(np.zeros(r), 1.0), sparse.csc_matrix(np.concatenate(rows)), b, cones)
    if found is None:
        return None
    weights = np.maximum(found[:r], 0.0)
    return weights / weights.sum() if weights.sum() > 0.5 else None
