"""Where a run has a choice, and the moves from one choice to the next.

A step that the rules force is taken together with the one before it: a dwell time of 50 steps is one move. Moments are
``svec(S)`` of states scaled by powers of two, which is exact.

Moments are rounded down in the Loewner order: a move takes from the moment what its rounding may have added, ``slip *
||s||`` times the identity. What is lost so at some step, a moment w of trace at most ``2 n slip ||s||``, would have
cost at least ``tr(L w)`` further on, for every lower bound L (docs/theory.md, "The optimum"); so errors need not be
followed: ``guard`` times that trace, taken from the cost, is enough where ``L >= -guard I``.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from switchctl.gramians import horizon_gramians
from switchctl.graph import SwitchingGraph
from switchctl.moments import Array, moment_maps, svec

_LONGEST = 64
_ACCURATE = 1e-12
_ROUNDING = np.finfo(float).eps


class Move(NamedTuple):
    """Steps up to the next choice: ``s+ = K s``, at the cost ``q . s + constant`` per dk, by the modes of a word."""

    word: tuple[int, ...]
    A: Array
    Q: Array
    K: Array
    q: Array
    constant: float
    head: int
    slip: float
    cost_slip: float


class Decisions:
    """The choices of a switching graph, numbered as they are met; the run starts at number 0.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and the moves allowed.
    steps : int, optional
        The length of a run that ends; without, it goes on for ever.

    Attributes
    ----------
    scale : array, shape (n,)
        Powers of two: the scaled state is ``scale * x``.
    A, Q : arrays, shape (r, n, n)
        All steps that a run may take, and their weights, in scaled states.
    identity : array, shape (d,)
        ``svec(I)``.
    """

    def __init__(self, graph: SwitchingGraph, steps: int | None = None) -> None:
        self.graph, self.steps = graph, steps
        modes = graph.modes
        self.n = n = modes.A.shape[-1]
        self.identity = svec(np.eye(n))
        with np.errstate(over="ignore", invalid="ignore"):
            A, Q = modes.every_step
            seen = np.diag(horizon_gramians(A, Q, 2 * n).sum(axis=0))
        fit = np.isfinite(seen) & (seen > 0)
        self.scale = np.exp2(np.round(np.log2(np.where(fit, seen, 1.0)) / 2))
        self.A, self.Q = self.scaled_step(A), self.scaled_cost(Q)
        self.distance = self.scaled_cost(modes.distance)
        self.places: list[tuple[int, int]] = [(0, 0)]  # the steps taken (0 if endless) and the node of the graph
        self._numbers = {(0, 0): 0}
        self._moves: dict[int, list[Move]] = {}
        self._repeats: dict[int, set[int]] = {}
        self._forced, self._circling = _forced(graph)
        self._composed: dict[tuple[int, tuple[int, ...]], tuple[int, Array, Array, Array, Array, float, float]] = {}

    def scaled(self, S: Array) -> Array:
        """``svec`` of a second moment in scaled states."""
        return svec(S * np.outer(self.scale, self.scale))

    def scaled_step(self, A: Array) -> Array:
        """The matrix of a step (or several) in scaled states."""
        return A * self.scale[:, None] / self.scale

    def scaled_cost(self, P: Array) -> Array:
        """A cost matrix (or several) in scaled states."""
        return P / np.outer(self.scale, self.scale)

    def plain_cost(self, P: Array) -> Array:
        """Undo `scaled_cost`."""
        return P * np.outer(self.scale, self.scale)

    def step_weight(self, before: int, mode: int) -> Array:
        """What a step in a mode costs after another, as a weight of the scaled state, per dk."""
        graph = self.graph
        weight = self.scaled_cost(graph.modes.Q_after[before, mode])
        return weight + graph.switch_cost_per_w2[before, mode] / graph.modes.dk * self.distance

    def step_constant(self, before: int, mode: int) -> float:
        """What it costs besides."""
        graph = self.graph
        return float(graph.price[mode] + graph.switch_cost[before, mode] / graph.modes.dk)

    def ended(self, u: int) -> bool:
        """Whether a run ends there."""
        return self.steps is not None and self.places[u][0] == self.steps

    def moves(self, u: int) -> list[Move]:
        """The moves from a choice, in the order of their first modes; none where the run ends."""
        if u not in self._moves:
            k, v = self.places[u]
            ways = [] if self.ended(u) else np.flatnonzero(self.graph.successor[v] >= 0).tolist()
            self._moves[u] = [self._move(k, v, mode) for mode in ways]
        return self._moves[u]

    def repeats(self, u: int) -> set[int]:
        """The numbers of the moves from a choice that do what an earlier one does: modes that are equal."""
        if u not in self._repeats:
            moves = self.moves(u)
            self._repeats[u] = {
                number
                for number, move in enumerate(moves)
                for other in moves[:number]
                if (move.head, move.constant) == (other.head, other.constant)
                and np.array_equal(move.K, other.K)
                and np.array_equal(move.q, other.q)
            }
        return self._repeats[u]

    def reachable(self, limit: int) -> bool:
        """Meet every choice, up to so many; whether that was all."""
        u = 0
        while u < len(self.places) <= limit:
            self.moves(u)
            u += 1
        return u == len(self.places)

    def _move(self, k: int, v: int, mode: int) -> Move:
        graph, before = self.graph, int(self.graph.last_mode[v])
        word: list[int] = []
        nodes: list[int] = []
        paid = [0.0]
        while not word or (len(word) < _LONGEST and k + len(word) != self.steps and self._goes_on(v)):
            mode = int(graph.successor[v].argmax()) if word else mode
            last = int(graph.last_mode[v])
            paid.append(paid[-1] + self.step_constant(last, mode))
            v = int(graph.successor[v, mode])
            word.append(mode)
            nodes.append(v)
        length, A, Q, K, q, slip, cost_slip = self._compose(before, tuple(word))
        key = (k + length if self.steps is not None else 0, nodes[length - 1])
        if key not in self._numbers:
            self._numbers[key] = len(self.places)
            self.places.append(key)
        return Move(tuple(word[:length]), A, Q, K, q, paid[length], self._numbers[key], slip, cost_slip)

    def _goes_on(self, v: int) -> bool:
        """Whether a step from a node is taken together with the one before it."""
        return bool(self._forced[v] and (self.steps is not None or not (v == 0 or self._circling[v])))

    def chooses(self, u: int) -> bool:
        """Whether it is more than a place where a long word was cut."""
        return u == 0 or not self._goes_on(self.places[u][1])

    def _compose(self, before: int, word: tuple[int, ...]) -> tuple[int, Array, Array, Array, Array, float, float]:
        """The map and the cost of a word, or of its beginning that is accurate, and how far rounding may move them."""
        if (before, word) in self._composed:
            return self._composed[before, word]
        n, long = self.n, np.longdouble
        unit = 4 * n * float(np.finfo(long).eps)
        power, cost, length = np.eye(n, dtype=long), np.zeros((n, n), dtype=long), 0
        wrong, cost_wrong = np.zeros((n, n)), np.zeros((n, n))  # bounds of their errors, entry by entry
        for last, mode in zip((before, *word), word, strict=False):
            A = self.scaled_step(self.graph.modes.A_after[last, mode])
            size = np.abs(power).astype(float)
            errors = np.abs(A) @ (wrong + unit * size)
            product = A.astype(long) @ power
            if length > 0 and not np.linalg.norm(errors) <= _ACCURATE * float(np.linalg.norm(product)):
                break
            Q = self.step_weight(last, mode)
            weight = np.abs(Q)
            cost_wrong += size.T @ weight @ (2 * wrong + unit * size) + wrong.T @ weight @ wrong
            cost = cost + power.T @ Q.astype(long) @ power
            power, wrong, length = product, errors, length + 1
        A, Q = power.astype(float), ((cost + cost.T) / 2).astype(float)
        if length == 1:  # they are the mode's own
            wrong[:], cost_wrong[:] = 0.0, 0.0
        else:
            wrong += _ROUNDING * np.abs(A)
            cost_wrong += 2 * _ROUNDING * np.abs(Q)
        K, q = moment_maps(A), svec(Q)
        rounding, moved = 4 * (len(q) + 8) * _ROUNDING, float(np.linalg.norm(wrong))
        slip = rounding * float(np.linalg.norm(K)) + moved * (2 * float(np.linalg.norm(A)) + moved)
        cost_slip = rounding * float(np.linalg.norm(q)) + float(np.linalg.norm(cost_wrong))
        self._composed[before, word] = length, A, Q, K, q, slip, cost_slip
        return self._composed[before, word]

    @cached_property
    def constants(self) -> Array:
        """What every run from a node of the graph pays at least in constants, per dk, in so many steps or for ever.

        Shape (V,), or (steps + 1, V): by the steps taken.
        """
        graph = self.graph
        m = len(graph.modes)
        each = graph.price + graph.switch_cost[graph.last_mode[:, None], np.arange(m)] / graph.modes.dk
        each = np.where(graph.successor >= 0, each, np.inf)
        if self.steps is not None:
            least = np.zeros((self.steps + 1, len(graph)))
            if each[graph.successor >= 0].any():
                for k in range(self.steps - 1, -1, -1):
                    least[k] = (each + least[k + 1, graph.successor]).min(axis=1)
            return least * (1 - 1e-12)
        if not each[graph.successor >= 0].any():
            return np.zeros(len(graph))
        V = len(graph)
        tails, modes = np.nonzero(graph.successor >= 0)
        heads, paid = graph.successor[tails, modes], each[tails, modes]
        nothing = paid == 0
        free = csr_array((np.ones(nothing.sum()), (tails[nothing], heads[nothing])), shape=(V, V))
        _, part = connected_components(free, connection="strong")
        sizes = np.bincount(part)
        for_ever = sizes[part] > 1
        for_ever[tails[nothing & (tails == heads)]] = True
        # Node V stands behind the nodes from which a run may go on without paying; dijkstra drops edges of weight 0,
        # so each is longer by one unit, taken off again: a lower bound, of the fewest steps' worth at most.
        sources = np.flatnonzero(for_ever)
        tiny = 1e-15 * max(float(paid.max()), 1e-300)
        rows, columns = np.append(heads, np.full(len(sources), V)), np.append(tails, sources)
        order = np.argsort(-np.append(paid, np.zeros(len(sources))), kind="stable")  # of parallel edges the least
        weights = np.append(paid, np.zeros(len(sources)))[order] + tiny
        lightest = {(r, c): w for r, c, w in zip(rows[order].tolist(), columns[order].tolist(), weights, strict=True)}
        keys = np.array(list(lightest))
        back = csr_array((list(lightest.values()), (keys[:, 0], keys[:, 1])), shape=(V + 1, V + 1))
        distance = dijkstra(back, indices=V)[:V]  # type: ignore[call-overload]
        return np.maximum(distance - (V + 2) * tiny, 0.0) * (1 - 1e-12)

    def constant_ahead(self, u: int) -> float:
        """What every run from a choice pays at least in constants, per dk."""
        k, v = self.places[u]
        return float(self.constants[v] if self.steps is None else self.constants[k, v])

    def walk(self, numbers: list[int]) -> Iterator[Move]:
        """The moves with these numbers, one after the other from the start."""
        u = 0
        for number in numbers:
            move = self.moves(u)[number]
            yield move
            u = move.head


def _forced(graph: SwitchingGraph) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The nodes with one move, and those of them that come back to themselves without a choice."""
    forced = (graph.successor >= 0).sum(axis=1) == 1
    jump = np.append(np.where(forced, graph.successor.max(axis=1), -1), -1)  # the last entry, -1, is nowhere
    for _ in range(len(graph).bit_length()):
        jump = jump[jump]
    circling = np.zeros(len(graph) + 1, dtype=bool)
    circling[jump] = True
    return forced, circling[:-1]
