"""Upper bounds on what goes on from a choice: ways to go on for ever, each a quadratic.

Each mode held as soon as it may be, and every short walk of moves that returns to its choice, repeated for ever, by one
periodic Lyapunov solve for all of them at once. Of a run that ends: each mode held to its end.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from switchctl.continuation import Continuations, Plan
from switchctl.gramians import seen
from switchctl.moments import Array, moment_maps, smat, svec, transform
from switchctl.optimum.decisions import Decisions, Move

_WALKS = 256
_CHOICES = 64  # of larger graphs, only single modes (or the cycles of Continuations) are tried
_KEPT = 12
_SAMPLES = 200
_LONGEST = 12
_LONGEST_WORD = 48
_BEAM = 400


class Ends(NamedTuple):
    """The ways on from a choice: rows for ``svec(S)``, constants, and what `UpperBounds.plan` knows them by."""

    rows: Array
    constants: Array
    keys: list[Any]


class UpperBounds:
    """A bank of ways on at every choice.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves.
    terminal : array, shape (n, n), optional
        The cost of the state at the end of a run that ends, in scaled states.
    """

    def __init__(self, decisions: Decisions, terminal: Array | None = None) -> None:
        self.decisions, self.terminal = decisions, terminal
        self._ends: dict[int, Ends] = {}
        self._held: dict[tuple[int, int, int], tuple[Array, float]] = {}
        self._walks = terminal is None and decisions.reachable(_CHOICES)

    @cached_property
    def continuations(self) -> Continuations:
        """Each mode held as soon as it may be."""
        return Continuations(self.decisions.graph)

    def ends(self, u: int) -> Ends:
        """All ways on known at a choice, of finite cost."""
        if u not in self._ends:
            self._ends[u] = self._ending(u) if self.terminal is not None else self._endless(u)
        return self._ends[u]

    def best(self, u: int, s: Array) -> tuple[float, Plan] | None:
        """The way on that costs least, per dk, and its modes; None where none is known."""
        rows, constants, keys = self.ends(u)
        if not keys:
            return None
        costs = rows @ s + constants
        return float(costs.min()), self.plan(u, keys[int(costs.argmin())])

    def reference(self, s: Array) -> Array:
        """The cost matrix of the way on from the start that costs least, made definite."""
        rows, constants, _ = self.ends(0)
        P = smat(rows[int((rows @ s + constants).argmin())])
        return P + 1e-6 * np.diag(P).max() * np.eye(len(P))

    def plan(self, u: int, key: Any) -> Plan:
        """The modes of a way on from a choice."""
        k, v = self.decisions.places[u]
        if isinstance(key, tuple):
            return key
        if self.terminal is None:
            return self.continuations.path(v, key)
        return tuple(mode for mode, _ in self._hold(k, v, key)), ()

    def add(self, u: int, numbers: list[int]) -> None:
        """Add the walk of the moves with these numbers, which returns to its choice, repeated for ever."""
        walk, at = _start(self.decisions.n), u
        for number in numbers:
            move = self.decisions.moves(at)[number]
            walk, at = walk.then(number, move), move.head
        known, found = self.ends(u), self._repeated([walk])
        rows, constants = np.concatenate([known.rows, found.rows]), np.concatenate([known.constants, found.constants])
        self._ends[u] = Ends(rows, constants, known.keys + found.keys)

    def look_further(self) -> bool:
        """Find a way on from the start where `ends` knows none: by longer words, or from a choice further on."""
        if not self._walks:
            return False
        leads = {0: _start(self.decisions.n)}
        for u in leads_in_turn(self.decisions, leads):
            if len(self.ends(u).keys):
                return self._lead(leads[u], u)
        found = contracting_walk(self.decisions)
        if found is None:
            return False
        u, numbers = found
        self.add(u, numbers)
        return self._lead(leads[u], u)

    def _lead(self, walk: "_Walk", u: int) -> bool:
        """Make the ways on from a choice ways on from the start."""
        rows, constants, keys = self.ends(u)
        move_map = moment_maps(walk.A)
        plans = [self.plan(u, key) for key in keys]
        ways = [(walk.word + lead, word) for lead, word in plans]
        self._ends[0] = Ends(svec(walk.Q) + rows @ move_map, constants + walk.constant, ways)
        return bool(keys)

    def _endless(self, u: int) -> Ends:
        decisions, v = self.decisions, self.decisions.places[u][1]
        found = self._repeated(self._closed(u)) if self._walks else Ends(_nothing(decisions), np.zeros(0), [])
        if decisions.graph.free and not decisions.graph.price.any():
            return found  # every mode is a walk
        ways = self.continuations
        keys = np.flatnonzero(ways.finite[:, v]).tolist()
        values = [ways.value(v, number) for number in keys]
        P = np.array([value.P for value in values]).reshape(-1, decisions.n, decisions.n)
        rows = np.concatenate([svec(decisions.scaled_cost(P)), found.rows])
        constants = np.concatenate([[value.constant for value in values], found.constants])
        return Ends(rows, constants, keys + found.keys)

    def _closed(self, u: int) -> list["_Walk"]:
        """The shortest walks from a choice back to it without constant costs, none of them another one repeated."""
        decisions = self.decisions
        closed: list[_Walk] = []
        walks = [(_start(decisions.n), u)]
        while walks and len(walks[0][0].numbers) < _LONGEST:
            walks = [
                (walk.then(number, move), move.head)
                for walk, at in walks
                for number, move in enumerate(decisions.moves(at))
                if move.constant == 0 and number not in decisions.repeats(at)
            ]
            if len(closed) + len(walks) > _WALKS:
                break
            closed += [walk for walk, at in walks if at == u and _primitive(walk.numbers)]
        return closed

    def _repeated(self, walks: list["_Walk"]) -> Ends:
        """What walks that return cost, repeated for ever: those that contract."""
        n = self.decisions.n
        A, Q = (np.array([walk[part] for walk in walks]).reshape(-1, n, n) for part in (1, 2))
        P, finite = repeated_costs(A, Q)
        kept = np.flatnonzero(finite)
        return Ends(svec(P[kept]), np.zeros(len(kept)), [((), walks[i].word) for i in kept])

    def _ending(self, u: int) -> Ends:
        """Each mode held to the end, as far as the rules allow; of a run that has ended, its terminal cost."""
        values = [self._held_cost(*self.decisions.places[u], mode) for mode in range(len(self.decisions.graph.modes))]
        constants = np.array([constant for _, constant in values])
        return Ends(svec(np.array([P for P, _ in values])), constants, list(range(len(values))))

    def _hold(self, k: int, v: int, mode: int) -> Iterator[tuple[int, int]]:
        """The modes and nodes of a run to its end that holds a mode where the rules allow it."""
        successor = self.decisions.graph.successor
        for _ in range(k, self.decisions.steps or 0):
            taken = mode if successor[v, mode] >= 0 else int((successor[v] >= 0).argmax())
            yield taken, v
            v = int(successor[v, taken])

    def _held_cost(self, k: int, v: int, mode: int) -> tuple[Array, float]:
        """What such a run costs, by the part of it already known."""
        decisions, graph, terminal = self.decisions, self.decisions.graph, self.terminal
        assert terminal is not None
        steps, value = [], (terminal, 0.0)
        for at, (taken, node) in enumerate(self._hold(k, v, mode), k):
            if (at, node, mode) in self._held:
                value = self._held[at, node, mode]
                break
            steps.append((at, node, taken))
        for at, node, taken in reversed(steps):
            before = int(graph.last_mode[node])
            A = decisions.scaled_step(graph.modes.A_after[before, taken])
            P = decisions.step_weight(before, taken) + transform(A, value[0])
            value = self._held[at, node, mode] = P, decisions.step_constant(before, taken) + value[1]
        return value

    def useful(self, u: int, s: Array) -> Ends:
        """The few ways on that are best for some moment that a run may come to."""
        rows, constants, keys = self.ends(u)
        if len(keys) <= _KEPT:
            return Ends(rows, constants, keys)
        generator = np.random.default_rng(0)
        factor = generator.standard_normal((_SAMPLES, self.decisions.n, 1))
        moments = np.concatenate([s[None] / np.linalg.norm(s), svec(factor @ np.swapaxes(factor, 1, 2))])
        for A in self.decisions.A:
            moved = A @ factor
            moments = np.concatenate([moments, svec(moved @ np.swapaxes(moved, 1, 2))])
        wins = np.bincount((moments @ rows.T + constants).argmin(axis=1), minlength=len(keys))
        kept = np.sort(np.argsort(-wins, kind="stable")[:_KEPT])
        return Ends(rows[kept], constants[kept], [keys[i] for i in kept])


def repeated_costs(A: Array, Q: Array) -> tuple[Array, Array]:
    """Lyapunov solutions ``P = Q + A' P A`` of many at once, by doubling, and which of them are finite and checked."""
    states = seen(A, Q)
    A = A * (states[:, :, None] & states[:, None, :])
    P, M = Q.copy(), A.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(40):
            P, M = P + transform(M, P), M @ M
            size = np.abs(M).max(axis=(1, 2), initial=0.0)
            if (~(size < 1e8) | (size < 1e-12)).all():
                break
        error = np.linalg.norm(Q + transform(A, P) - P, axis=(1, 2))
        finite = (size < 1e-12) & (error <= 1e-9 * np.linalg.norm(P, axis=(1, 2)))
    return P, finite


class _Walk(NamedTuple):
    """Moves one after the other: their numbers, their map, their cost, their modes, and what they pay besides."""

    numbers: list[int]
    A: Array
    Q: Array
    word: tuple[int, ...]
    constant: float

    def then(self, number: int, move: Move) -> "_Walk":
        cost = self.Q + self.A.T @ move.Q @ self.A
        return _Walk(
            [*self.numbers, number], move.A @ self.A, cost, self.word + move.word, self.constant + move.constant
        )


def _start(n: int) -> _Walk:
    return _Walk([], np.eye(n), np.zeros((n, n)), (), 0.0)


def leads_in_turn(decisions: Decisions, leads: dict[int, _Walk]) -> Iterator[int]:
    """The choices, nearest to the start first; ``leads`` gets the walk to each."""
    queue = list(leads)
    for u in queue:
        yield u
        for number, move in enumerate(decisions.moves(u)):
            if move.head not in leads:
                leads[move.head] = leads[u].then(number, move)
                queue.append(move.head)


def contracting_walk(decisions: Decisions, costing: bool = False) -> tuple[int, list[int]] | None:
    """A walk that returns to its choice and contracts: a beam search for small products.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves.
    costing : bool, optional
        Whether it may take moves of constant cost.

    Returns
    -------
    u, numbers : int and list of int, or None
        The choice and the moves; None where none was found, which proves nothing.
    """
    n = decisions.n
    walks = [(u, u, _start(n)) for u in range(len(decisions.places))]
    for _ in range(_LONGEST_WORD):
        walks = [
            (u, move.head, _Walk([*walk.numbers, number], move.A @ walk.A, walk.Q, walk.word + move.word, 0.0))
            for u, at, walk in walks
            for number, move in enumerate(decisions.moves(at))
            if costing or move.constant == 0
        ]
        if not walks:
            break
        products = np.array([walk.A for _, _, walk in walks])
        steps = np.array([len(walk.word) for _, _, walk in walks])
        with np.errstate(over="ignore", divide="ignore"):
            size = np.log(np.linalg.norm(products, axis=(1, 2))) / steps
        kept = np.argsort(size, kind="stable")[:_BEAM]  # what is not a number comes last
        kept = kept[size[kept] < np.inf]  # a product that vanishes has -inf
        walks, products = [walks[i] for i in kept], products[kept]
        radii = np.abs(np.linalg.eigvals(products)).max(axis=1)
        for i in np.argsort(radii, kind="stable"):
            u, at, walk = walks[i]
            if radii[i] >= 1 - 1e-6:
                break
            if u == at:
                return u, walk.numbers
    return None


def _primitive(numbers: list[int]) -> bool:
    length = len(numbers)
    return all(numbers != numbers[:p] * (length // p) for p in range(1, length) if length % p == 0)


def _nothing(decisions: Decisions) -> Array:
    return np.zeros((0, len(decisions.identity)))
