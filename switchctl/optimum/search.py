"""Branch and bound over the prefixes of a run, depth first, many moments at once."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.continuation import Plan
from switchctl.moments import Array
from switchctl.optimum.decisions import Decisions, Move
from switchctl.optimum.lower import LowerBounds
from switchctl.optimum.prefixes import Indices, Stack, Tree
from switchctl.optimum.upper import Ends, UpperBounds

CHUNK = 16_384
_GROW = 5000  # moments between two bounds added, or twice as many after each that gained nothing
_BANK = 32
_TREE = 4_000_000  # moves remembered before those no longer needed are dropped
_TABLES = 2000
_BETTER = 1e-12
_ROUNDING = np.finfo(float).eps


class _Table(NamedTuple):
    """What a chunk at a choice is multiplied by: the bounds after each move, and what rounding may take from them."""

    known: int
    bounds: Array
    constants: Array
    slips: Array


class Search:
    """Branch and bound for one initial moment; all costs are per dk.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves.
    lower : LowerBounds
        What goes on costs at least.
    upper : UpperBounds
        What goes on may cost.
    s : array, shape (d,)
        The initial moment, scaled.
    memory : float
        Bytes that stacks and tree may take.

    Attributes
    ----------
    cost : float
        The least cost found, per dk; infinite before any.
    plan : tuple of tuples of int
        Its modes: those taken once, and those repeated for ever after.
    bound : float
        What every run costs at least, as proven so far.
    nodes : int
        Moments seen.
    """

    def __init__(
        self, decisions: Decisions, lower: LowerBounds, upper: UpperBounds, s: Array, memory: float = math.inf
    ) -> None:
        self.decisions, self.lower, self.upper, self.s, self.memory = decisions, lower, upper, s, memory
        self.cost, self.bound, self.nodes = math.inf, 0.0, 0
        self.plan: Plan | None = None
        self._tables: dict[int, _Table] = {}
        self._useful: dict[int, Ends] = {}
        self._diagonal = np.flatnonzero(decisions.identity)
        self._rounding = 4 * (len(s) + 8) * _ROUNDING  # of a product with a moment
        lowered = 8 * len(self._diagonal) * _ROUNDING * float(np.linalg.norm(s))  # S itself was rounded
        self._lowered = s - lowered * decisions.identity
        n = self._size = len(self._diagonal)
        self._begun = 2 * n * lower.guard * lowered
        self._since, self._wait = 0, _GROW
        if (found := upper.best(0, s)) is not None:
            self.cost, self.plan = found

    @classmethod
    def prepared(
        cls, decisions: Decisions, s: Array, terminal: Array | None = None, memory: float = math.inf
    ) -> "Search | None":
        """A search with its bounds, the first one for the initial moment; None where no way on of finite cost is known.

        Parameters
        ----------
        decisions, s, memory
            As for `Search`.
        terminal : array, shape (n, n), optional
            The cost of the state at the end of a run that ends, in scaled states.

        Returns
        -------
        Search or None
        """
        upper = UpperBounds(decisions, terminal)
        if not upper.ends(0).keys and not upper.look_further():
            return None
        lower = LowerBounds(decisions, upper.reference(s), terminal)
        lower.improve(0, s)
        return cls(decisions, lower, upper, s, memory)

    def rung(
        self, tolerance: float, deadline: float, told: Callable[[], None] = lambda: None, most: float = math.inf
    ) -> str:
        """Search all prefixes that may lead to less than ``cost * (1 - tolerance)``.

        Parameters
        ----------
        tolerance : float
            The fraction of the cost.
        deadline : float
            When to stop, on the clock of `time.perf_counter`.
        told : callable
            Called after each chunk.
        most : float
            Moments after which to give up.

        Returns
        -------
        str
            "closed": there is none, and ``bound`` says so; or "too many", "time limit", "memory limit".
        """
        root = Stack(len(self.s))
        root.push(self._lowered[None], np.full(1, -self._begun), np.zeros(1, dtype=np.int64))
        self._ended = math.inf
        stacks, tree, most, crowded_tree = {0: root}, Tree(), self.nodes + most, _TREE
        while True:
            u = max(stacks, key=lambda v: stacks[v].count)
            if stacks[u].count == 0:
                self.bound = max(self.bound, min(self.cost * (1 - tolerance), self._ended))
                return "closed"
            held = sum(stack.bytes for stack in stacks.values()) + 10 * len(tree.parent)
            if time.perf_counter() > deadline or held > self.memory:
                self._raise_bound(stacks, tolerance)
                return "memory limit" if held > self.memory else "time limit"
            if self.nodes > most:
                return "too many"
            crowded = held > self.memory / 4  # then fewer at once: depth first grows less
            chunk = stacks[u].pop(CHUNK // 32 if crowded else CHUNK)
            if tree.count > crowded_tree:
                stacks[u].push(*chunk)
                tree.keep(list(stacks.values()))
                crowded_tree = max(_TREE, 2 * tree.count)
                chunk = stacks[u].pop(len(chunk[0]))
            self._expand(u, chunk, stacks, tree, tolerance)
            told()

    def _expand(
        self, u: int, chunk: tuple[Array, Array, Indices], stacks: dict[int, Stack], tree: Tree, tolerance: float
    ) -> None:
        """Take every move from a chunk of prefixes, except where a bound says that it leads to nothing better."""
        moments, costs, places = chunk
        self.nodes += len(costs)
        moves, table = self.decisions.moves(u), self._table(u)
        size = np.sqrt(np.einsum("ij,ij->i", moments, moments))
        ahead = (table.bounds @ moments.T).reshape(len(moves), -1, len(costs)).max(axis=1)
        bounds = costs + ahead - table.slips[:, None] * size + table.constants[:, None]
        going = ~(bounds >= self.cost * (1 - tolerance))  # NaN decides nothing
        self._since += len(costs)
        if self._since > self._wait and self.lower.count < _BANK and going.any():
            self._since = 0
            self._wait *= 1 if self._grow(moves, moments, going) else 2
        for number, move in enumerate(moves):
            chosen = np.flatnonzero(going[number])
            if not len(chosen):
                continue
            begun, slipped = moments[chosen], size[chosen]
            after = begun @ move.K.T
            after[:, self._diagonal] -= (move.slip * slipped)[:, None]
            lost = 2 * self._size * self.lower.guard * move.slip + move.cost_slip
            paid = begun @ move.q - lost * slipped
            paid = (costs[chosen] + paid + move.constant) * (1 - 4 * _ROUNDING)
            kept = tree.add(places[chosen], number)
            self._offer(move.head, after, paid, kept, tree)
            if not self.decisions.ended(move.head):
                if move.head not in stacks:
                    stacks[move.head] = Stack(len(self.s))
                stacks[move.head].push(after, paid, kept)

    def _table(self, u: int) -> _Table:
        table = self._tables.get(u)
        if table is None or table.known != self.lower.count:
            if len(self._tables) >= _TABLES:
                self._tables.clear()
            moves = self.decisions.moves(u)
            bounds, slips = [], []
            for move in moves:
                L = self.lower.rows(move.head)
                bounds.append(move.q + L @ move.K)
                norms = np.linalg.norm(L, axis=1) * np.linalg.norm(move.K) + np.linalg.norm(move.q)
                slip = move.cost_slip + move.slip * np.linalg.norm(L, axis=1) * 4 * self._size + self._rounding * norms
                slips.append(slip.max())
            constants = np.array([move.constant + self.decisions.constant_ahead(move.head) for move in moves])
            constants[list(self.decisions.repeats(u))] = np.inf  # nothing better is found there
            table = _Table(self.lower.count, np.concatenate(bounds), constants, np.array(slips))
            self._tables[u] = table
        return table

    def _grow(self, moves: list[Move], moments: Array, going: NDArray[np.bool_]) -> bool:
        """Add the bound that is greatest for the prefix that came last, where the search is stuck, if it gains."""
        number, last = (int(place[-1]) for place in np.nonzero(going))
        move = moves[number]
        return self.lower.improve(move.head, move.K @ moments[last])

    def _offer(self, u: int, moments: Array, costs: Array, places: Indices, tree: Tree) -> None:
        """Try every way on after prefixes that end at a choice."""
        if u not in self._useful:
            self._useful[u] = self.upper.useful(u, self.s)
        rows, constants, keys = self._useful[u]
        if not keys:
            return
        totals = (rows @ moments.T + constants[:, None]).min(axis=0) + costs
        if self.decisions.ended(u):  # what costs less than its rounding lets us see is not above the threshold
            norm = self._rounding * float(np.linalg.norm(rows))
            self._ended = min(self._ended, float((totals - norm * np.linalg.norm(moments, axis=1)).min()))
        best = int(totals.argmin())
        if not totals[best] < self.cost * (1 - _BETTER):
            return
        numbers, s, cost = tree.path(int(places[best])), self.s, 0.0
        modes: list[int] = []
        for move in self.decisions.walk(numbers):
            cost, s = cost + float(move.q @ s) + move.constant, move.K @ s
            modes += move.word
        known = self.upper.best(u, s)
        assert known is not None
        way, (lead, word) = known
        if cost + way < self.cost * (1 - _BETTER):
            self.cost, self.plan = cost + way, (tuple(modes) + lead, word)

    def _raise_bound(self, stacks: dict[int, Stack], tolerance: float) -> None:
        """What is still open gives a bound too, where a rung stops short."""
        least = min(self.cost * (1 - tolerance), self._ended)
        for u, stack in stacks.items():
            L, ahead = self.lower.rows(u), self.decisions.constant_ahead(u)
            norm = self._rounding * float(np.linalg.norm(L, axis=1).max())
            for begin in range(0, stack.count, CHUNK):
                chosen = slice(begin, min(begin + CHUNK, stack.count))
                moments = stack.moments[chosen]
                slipped = norm * np.sqrt(np.einsum("ij,ij->i", moments, moments))
                least = min(least, float(((L @ moments.T).max(axis=0) + stack.costs[chosen] - slipped).min()) + ahead)
        self.bound = max(self.bound, least)
