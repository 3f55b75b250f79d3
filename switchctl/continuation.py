"""Ways for a run to go on for ever from every node of a switching graph, and what they cost.

For each mode that may be held for ever: the shortest way to a node where it may be, and then that mode. Where no such
way costs finitely much: the shortest cycles of the graph instead.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from switchctl.graph import SwitchingGraph
from switchctl.moments import Array, svec
from switchctl.values import Value, before_step, switched, word_value

_CYCLES = 32
_TIE = 1e-12

Nodes = NDArray[np.intp]

Plan = tuple[tuple[int, ...], tuple[int, ...]]
"""How a run goes on: the modes taken once, and the word repeated for ever after."""


class Way(NamedTuple):
    """One way on: the mode it takes next from each node (-1: it doesn't lead there), and its end.

    From the nodes of ``ends`` it repeats a word for ever, which costs ``value`` after the switch to its first mode;
    None where that is not finite.
    """

    policy: Nodes
    ends: NDArray[np.bool_]
    value: Value | None


class Continuations:
    """The ways on from each node of a switching graph, and their costs.

    Parameters
    ----------
    graph : SwitchingGraph
        The graph.
    """

    def __init__(self, graph: SwitchingGraph) -> None:
        self.graph = graph
        self._values: dict[tuple[int, int], Value] = {}
        self._tables: dict[int, tuple[list[int], Array, Array]] = {}
        self.held: dict[int, int] = {}  # the way to each mode's hold, by number
        self.ways = self._holding()
        self.finite = self._finite()
        if not self.finite[:, 0].any():
            self.ways += self._cycling()
            self.finite = self._finite()

    def _finite(self) -> NDArray[np.bool_]:
        """Which ways lead on at finite cost, shape (ways, nodes)."""
        nowhere = np.zeros(len(self.graph), bool)
        defined = [way.policy >= 0 if way.value is not None else nowhere for way in self.ways]
        return np.array(defined).reshape(-1, len(self.graph))

    def _worth(self, v: int) -> list[int]:
        """The ways from a node that costs are to be compared of: where costs are averages, those of the least."""
        numbers = np.flatnonzero(self.finite[:, v]).tolist()
        rates = [value.rate for number in numbers if (value := self.ways[number].value)]
        return [number for number, rate in zip(numbers, rates, strict=True) if rate <= min(rates) * (1 + _TIE)]

    def _holding(self) -> list[Way]:
        graph = self.graph
        ways: list[Way] = []
        for mode in range(len(graph.modes)):
            policy, ends = way_to_hold(graph, mode)
            if ends.any():
                self.held[mode] = len(ways)
                finite = graph.modes.tails[mode] is not None
                ways.append(Way(policy, ends, word_value(graph, (mode,)) if finite else None))
        return ways

    def _cycling(self) -> list[Way]:
        """The shortest cycles through some nodes, evenly spread; where modes tie, the first or one after the other."""
        graph = self.graph
        ways: list[Way] = []
        V = len(graph)
        nodes_through = np.unique(np.linspace(0, V - 1, min(V, _CYCLES)).astype(int)).tolist()
        for u, in_turn in product(nodes_through, (False, True)):
            ends = np.arange(V) == u
            policy, distance = _towards(graph, ends, in_turn)
            there = np.where(graph.successor[u] >= 0, distance[graph.successor[u]], np.inf)
            if np.isinf(there).all():
                continue
            policy[u] = there.argmin()
            word = tuple(_walk(graph, policy, u)[0])
            ways.append(Way(policy, ends, word_value(graph, word)))
        return ways

    def before(self, v: int, mode: int, value: Value) -> Value:
        """What a step in a mode from a node and then a way of known value cost."""
        return switched(self.graph, v, mode, before_step(self.graph, mode, value))

    def value(self, v: int, number: int) -> Value:
        """What a way (by its number) that is finite there costs from a node, with the switch to it."""
        way, path = self.ways[number], []
        while (number, v) not in self._values and not way.ends[v]:
            path.append(v)
            v = int(self.graph.successor[v, way.policy[v]])
        if (number, v) not in self._values:
            assert way.value is not None
            self._values[number, v] = switched(self.graph, v, int(way.policy[v]), way.value)
        value = self._values[number, v]
        for v in reversed(path):
            value = self._values[number, v] = self.before(v, int(way.policy[v]), value)
        return value

    def table(self, v: int) -> tuple[list[int], Array, Array]:
        """The finite ways from a node: their numbers, and their costs as rows for ``svec(S)`` and constants."""
        if v not in self._tables:
            numbers = self._worth(v)
            self._tables[v] = numbers, *as_rows(self.graph, [self.value(v, number) for number in numbers])
        return self._tables[v]

    def path(self, v: int, number: int) -> Plan:
        """The modes of a way from a node: those taken once, and the word repeated for ever after."""
        return policy_path(self.graph, self.ways[number].policy, v)


def wander(graph: SwitchingGraph, v: int) -> Plan:
    """Some way to go on for ever, at whatever cost: always the first mode allowed."""
    return policy_path(graph, (graph.successor >= 0).argmax(axis=1), v)


def policy_path(graph: SwitchingGraph, policy: Nodes, v: int) -> Plan:
    """The modes of a policy on the nodes from one of them."""
    modes, begin = _walk(graph, policy, v)
    return shortest(tuple(modes[:begin]), tuple(modes[begin:]))


def _walk(graph: SwitchingGraph, policy: Nodes, v: int) -> tuple[list[int], int]:
    """The modes that a policy takes from a node until a node returns, and the step at which that was first left."""
    seen: dict[int, int] = {}
    modes: list[int] = []
    while v not in seen:
        seen[v] = len(modes)
        modes.append(int(policy[v]))
        v = int(graph.successor[v, modes[-1]])
    return modes, seen[v]


def as_rows(graph: SwitchingGraph, values: Sequence[Value]) -> tuple[Array, Array]:
    """Values as rows for ``svec(S)``, and constants."""
    n = graph.modes.A.shape[-1]
    P = np.array([value.P for value in values]).reshape(-1, n, n)
    return svec(P), np.array([value.constant for value in values])


def shortest(lead: tuple[int, ...], word: tuple[int, ...]) -> Plan:
    """The same modes, a lead and a word repeated for ever, told as briefly as can be."""
    for period in range(1, len(word) + 1):
        if len(word) % period == 0 and word == word[:period] * (len(word) // period):
            word = word[:period]
            break
    while lead and lead[-1] == word[-1]:
        lead, word = lead[:-1], word[-1:] + word[:-1]
    return lead, word


def lasting(graph: SwitchingGraph, word: tuple[int, ...]) -> NDArray[np.bool_]:
    """From which nodes a word of modes may be repeated for ever."""
    jump = np.append(np.arange(len(graph)), -1)  # the last entry, -1, is nowhere
    for mode in word:
        jump = np.where(jump >= 0, graph.successor[jump, mode], -1)
    for _ in range(len(graph).bit_length()):
        jump = jump[jump]
    return jump[:-1] >= 0


def way_to_hold(graph: SwitchingGraph, mode: int) -> tuple[Nodes, NDArray[np.bool_]]:
    """The shortest way to where a mode may be held for ever, and its hold: by node; and where it may be held."""
    ends = np.isinf(graph.holds[:, mode])
    policy = np.full(len(graph), mode) if ends.all() else _towards(graph, ends)[0]
    policy[ends] = mode
    return policy, ends


def _towards(graph: SwitchingGraph, ends: NDArray[np.bool_], in_turn: bool = False) -> tuple[Nodes, Array]:
    """The first mode of the shortest way to some nodes, and its steps, from each node.

    Of several modes the first, or one after the other as the steps count down.
    """
    successor = graph.successor
    V = len(successor)
    tails, modes = np.nonzero(successor >= 0)
    sources = np.flatnonzero(ends)
    heads = np.concatenate([successor[tails, modes], np.full(len(sources), V)])  # node V stands behind all ends
    moves = csr_array((np.ones(len(heads)), (heads, np.concatenate([tails, sources]))), shape=(V + 1, V + 1))
    steps = dijkstra(moves, indices=V, unweighted=True)  # type: ignore[call-overload]
    distance = np.concatenate([steps[:V] - 1, [np.inf]])
    closer = (distance[successor] == distance[:V, None] - 1) & np.isfinite(distance[:V, None])
    if in_turn:
        count = np.maximum(closer.sum(axis=1), 1)
        wanted = np.where(np.isfinite(distance[:V]), distance[:V], 0).astype(np.intp) % count
        closer &= closer.cumsum(axis=1) == wanted[:, None] + 1
    return np.where(closer.any(axis=1), closer.argmax(axis=1), -1), distance[:V]
