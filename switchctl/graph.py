"""The switching graph: which modes may follow which pasts, and what a switch costs."""

from collections.abc import Hashable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from switchctl.contradiction import contradiction
from switchctl.edges import Edge
from switchctl.limits import NODES, TooManyNodes, find, indices, limits
from switchctl.memory import Automaton, Memory, explore, longest_runs
from switchctl.modes import ModeSet, require_modes
from switchctl.moments import Array
from switchctl.rules import ContradictionError, Rules
from switchctl.tables import Summary
from switchctl.validation import frozen, listed, shown, whole_number

if TYPE_CHECKING:
    import networkx
    from control import ControlPlot


class SwitchingGraph(Summary):
    """Modes under switching rules: the nodes are what must be remembered, the edges the moves allowed.

    Only what can be reached is kept, and only moves after which the run can go on for ever. Without rules it is one
    node.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    rules : Rules, optional
        What limits or prices switching; nothing by default.

    Attributes
    ----------
    modes : ModeSet
        The modes.
    rules : Rules
        The rules.
    successor : int array, shape (nodes, m)
        The node after a step in each mode, or -1 where it is not allowed. The run starts in node 0.
    last_mode : int array, shape (nodes,)
        The mode before, or -1 where there was none or it makes no difference.
    switch_cost, switch_cost_per_w2 : arrays, shape (m + 1, m)
        What a switch costs, fixed and for each unit of W2; the row is the mode before (the last one, -1, for none).
    price : array, shape (m,)
        Running price of each mode above the cheapest.
    resource_use : array, shape (m,), or None
        What a step in each mode uses of the budget.

    Raises
    ------
    ValueError
        If the rules don't fit the modes, contradict each other (`ContradictionError`), or would need more than 100,000
        nodes.
    KeyError, IndexError
        If a rule names a mode that is not there.

    Examples
    --------
    >>> modes = ModeSet([[[0.5]], [[0.9]]], names=["fast", "slow"])
    >>> SwitchingGraph(modes, Rules(min_dwell=3, switch_cost=0.1))
    SwitchingGraph: 7 nodes, 10 edges
    ├── rules  Rules(min_dwell=3, switch_cost=0.1)
    ├── fast   5 edges, may be held for ever
    └── slow   5 edges, may be held for ever
    """

    def __init__(self, modes: ModeSet, rules: Rules | None = None) -> None:
        self._build(modes, rules, None, None)

    @classmethod
    def from_edges(
        cls,
        modes: ModeSet,
        edges: Iterable[tuple[Hashable, Hashable, Any]],
        rules: Rules | None = None,
        *,
        start: Hashable = None,
    ) -> "SwitchingGraph":
        """Write the moves by hand, as an automaton; rules may limit and price them further.

        Parameters
        ----------
        modes : ModeSet
            The modes.
        edges : iterable of (from, to, mode)
            The moves: nodes are whatever hashable names you like, modes are given by name or index. From a node, one
            edge a mode at most.
        rules : Rules, optional
            As for `SwitchingGraph`.
        start : hashable, optional
            The first node; by default the one that the first edge leaves.

        Returns
        -------
        SwitchingGraph

        Raises
        ------
        ValueError
            If there is no edge, two edges leave one node in one mode, start is no node, or a run can't go on for ever.
        TypeError
            If an edge is not a triple or a node is not hashable.

        Examples
        --------
        >>> modes = ModeSet([[[0.5]], [[0.9]]], names=["serve 1", "serve 2"])
        >>> SwitchingGraph.from_edges(modes, [("a", "b", "serve 1"), ("b", "a", "serve 2"), ("b", "b", "serve 1")])
        SwitchingGraph: 2 nodes, 3 edges
        ├── serve 1  2 edges, may be held for ever
        └── serve 2  1 edge
        """
        require_modes(modes)
        automaton: dict[tuple[Hashable, int], Hashable] = {}
        for number, edge in enumerate(listed(edges, "edges", "moves (from, to, mode)", NODES * len(modes))):
            if isinstance(edge, str) or not isinstance(edge, Sequence) or len(edge) != 3:
                raise TypeError(f"edges[{number}] is {edge!r}; expected (from, to, mode)")
            tail, head, mode = edge[0], edge[1], find(modes, edge[2], f"edges[{number}]")
            for node in (tail, head):
                if not isinstance(node, Hashable) or node != node:
                    raise TypeError(f"edges[{number}] has the node {shown(node)}; a node must be hashable, and no NaN")
            if automaton.setdefault((tail, mode), head) != head:
                raise ValueError(
                    f"edges[{number}]: another edge leaves {tail!r} in mode {modes.names[mode]!r} for "
                    f"{automaton[tail, mode]!r}; a node has one edge a mode"
                )
        if not automaton:
            raise ValueError("edges is empty; give at least one move (from, to, mode)")
        if start is None:
            start = next(iter(automaton))[0]
        elif not isinstance(start, Hashable) or start not in {tail for tail, _ in automaton}:
            raise ValueError(f"start is {shown(start)}, which no edge leaves")
        graph = cls.__new__(cls)
        graph._build(modes, rules, automaton, start)
        return graph

    def _build(self, modes: ModeSet, rules: Rules | None, automaton: Automaton | None, place: Hashable) -> None:
        require_modes(modes)
        rules = Rules() if rules is None else rules
        if not isinstance(rules, Rules):
            raise TypeError(f"rules must be Rules(..), not {rules!r}")
        self.modes, self.rules = modes, rules
        self._automaton, self._place = automaton, place
        found = limits(modes, rules)  # refused here if the times of availability alone are too many
        self.switch_cost, self.switch_cost_per_w2 = frozen(found.switch_cost), frozen(found.switch_cost_per_w2)
        self.price = frozen(found.price - found.price.min())
        self.resource_use = None if found.use is None else frozen(np.array([float(x * found.unit) for x in found.use]))
        try:
            self._memory = Memory(found, automaton, place)
            successor, states = explore(self._memory)
        except TooManyNodes as error:
            less = "a shorter window, a smaller limit, shorter dwell times or times of availability, or fewer switches"
            raise TooManyNodes(f"the graph of {rules!r} {error}, the most there may be; give it {less}") from None
        runs = longest_runs(successor)
        if np.isfinite(runs[0]):
            raise ContradictionError(contradiction(modes, rules, automaton, place))
        kept = np.flatnonzero(np.isinf(runs))
        place_of = np.full(len(runs) + 1, -1)  # its last entry, -1, stands for a move that is not allowed
        place_of[kept] = np.arange(len(kept))
        self.successor = frozen(place_of[successor[kept]])
        self._states = [states[v] for v in kept]
        self.last_mode = frozen(np.array([state.last for state in self._states], dtype=np.intp))

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.modes, self.rules, self._automaton, self._place)

    def __len__(self) -> int:
        return len(self.successor)

    @cached_property
    def free(self) -> bool:
        """Whether every mode may follow every past."""
        return len(self) == 1 and bool((self.successor >= 0).all())

    @cached_property
    def holds(self) -> Array:
        """How many steps in a row each mode may be taken from each node, shape (nodes, m); infinite without end."""
        V, m = self.successor.shape
        steps = np.zeros((V + 1, m))
        steps[:V] = self.successor >= 0
        jump = np.vstack([self.successor, np.full((1, m), -1)])  # the last row, -1, is nowhere
        columns = np.arange(m)
        for _ in range(V.bit_length()):
            steps, jump = steps + steps[jump, columns], jump[jump, columns]
        steps[steps > V] = np.inf
        return frozen(steps[:V])

    @property
    def start_mode(self) -> int:
        """The mode before the first step; -1 for none."""
        start = self._memory.limits.start
        return -1 if start is None else start[0]

    @property
    def window(self) -> int | None:
        """The steps of the budget's window; None where it is the whole run."""
        return self._memory.limits.window

    @property
    def automaton_edges(self) -> list[tuple[Any, Any, str]] | None:
        """The edges given to `from_edges`, from the first node on, with its nodes numbered; None without."""
        if self._automaton is None:
            return None
        places = dict.fromkeys(
            [self._place, *(place for (tail, _), head in self._automaton.items() for place in (tail, head))]
        )
        number = {place: i for i, place in enumerate(places)}
        names = self.modes.names
        edges = [(number[tail], number[head], names[mode]) for (tail, mode), head in self._automaton.items()]
        return sorted(edges, key=lambda edge: edge[0] != 0)

    def label(self, node: int) -> str:
        """What a node remembers, in words.

        Parameters
        ----------
        node : int
            The node.

        Returns
        -------
        str

        Raises
        ------
        TypeError, IndexError
            If there is none.
        """
        return self._memory.label(self._states[self._node(node)], self.modes.names)

    def _node(self, node: Any) -> int:
        """The number of a node, checked."""
        if (number := whole_number(node, "node", 0)) < len(self):
            return number
        raise IndexError(f"node is {number}; the graph has {len(self)} nodes, counted from 0")

    def edges(self) -> Iterator[Edge]:
        """Every move, by node and mode.

        Yields
        ------
        Edge
        """
        modes = self.modes
        for v, i in np.argwhere(self.successor >= 0):
            before = self.last_mode[v]
            Q = modes.dk * modes.Q_after[before, i] + self.switch_cost_per_w2[before, i] * modes.distance
            constant = float(modes.dk * self.price[i] + self.switch_cost[before, i])
            yield Edge(int(v), int(self.successor[v, i]), int(i), modes.A_after[before, i], Q, constant)

    def walk(self, sequence: Iterable[int], node: int = 0) -> NDArray[np.intp]:
        """The nodes along a sequence of modes.

        Parameters
        ----------
        sequence : sequence of int, length N
            The modes, by index.
        node : int, optional
            Where to begin; the start by default.

        Returns
        -------
        int array, shape (N + 1,)

        Raises
        ------
        ValueError
            If the rules forbid a step; the message says which.
        TypeError, LookupError
            If there is no such mode or node.
        """
        nodes = [self._node(node)]
        for k, mode in enumerate(indices(self.modes, sequence, "sequence")):
            head = int(self.successor[nodes[-1], mode])
            if head < 0:
                raise ValueError(f"step {k}: {self.refusal(nodes[-1], mode)}")
            nodes.append(head)
        return np.array(nodes, dtype=np.intp)

    @property
    def least_dwells(self) -> list[int]:
        """The least dwell time of each mode, in steps."""
        return self._memory.limits.min_dwell

    def refusal(self, node: int, mode: int) -> str:
        """Say why a mode can't be taken.

        Parameters
        ----------
        node, mode : int
            A node, and a mode that the rules don't allow there.

        Returns
        -------
        str

        Raises
        ------
        ValueError
            If the rules allow it.
        TypeError, KeyError, IndexError
            If there is no such node or mode.
        """
        node, mode, names = self._node(node), find(self.modes, mode, "mode"), self.modes.names
        if self.successor[node, mode] >= 0:
            raise ValueError(f"mode {names[mode]!r} is allowed at node {node} ({self.label(node)}); nothing refuses it")
        ways = ", ".join(names[i] for i in np.flatnonzero(self.successor[node] >= 0))
        return f"mode {names[mode]!r} is not allowed by {self.rules!r} ({self.label(node)}); the way on is by {ways}"

    def to_networkx(self) -> "networkx.MultiDiGraph":
        """Return the graph for networkx, which must be installed.

        Returns
        -------
        networkx.MultiDiGraph
            Nodes are numbered and have a ``label``; edges have ``mode`` (its name), ``index`` and ``constant``.
        """
        import networkx

        graph = networkx.MultiDiGraph()
        graph.add_nodes_from((v, {"label": self.label(v)}) for v in range(len(self)))
        graph.add_edges_from(
            (e.tail, e.head, {"mode": self.modes.names[e.mode], "index": e.mode, "constant": e.constant})
            for e in self.edges()
        )
        return graph

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw nodes and moves; see `switchctl.plotting.plot_graph` for the keywords.

        Parameters
        ----------
        **keywords : ax, title, legend_loc
            As for `plot_graph`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_graph

        return plot_graph(self, **keywords)

    def _facts(self) -> list[tuple[str, str]]:
        counts: list[int] = (self.successor >= 0).sum(axis=0).tolist()
        for_ever = [bool(np.isinf(steps).any()) for steps in self.holds.T]
        facts = [("rules", repr(self.rules))] if self.rules != Rules() else []
        for name, count, held in zip(self.modes.names, counts, for_ever, strict=True):
            facts.append((name, f"{count} edge{'s' * (count != 1)}" + ", may be held for ever" * held))
        return facts

    def _heading(self) -> str:
        V, E = len(self), int((self.successor >= 0).sum())
        return f"SwitchingGraph: {V} node{'s' * (V > 1)}, {E} edge{'s' * (E > 1)}"


def _rebuilt(modes: ModeSet, rules: Rules, automaton: Automaton | None, place: Hashable) -> SwitchingGraph:
    graph = SwitchingGraph.__new__(SwitchingGraph)
    graph._build(modes, rules, automaton, place)
    return graph


def graph_under(modes: ModeSet, rules: Rules | SwitchingGraph | None) -> SwitchingGraph:
    """The graph of modes under rules, or the graph given in their place, which must be of the same modes."""
    graph = rules if isinstance(rules, SwitchingGraph) else SwitchingGraph(modes, rules)
    if graph.modes is not modes:
        raise ValueError("rules is a SwitchingGraph of other modes; give schedule that graph's .modes")
    return graph


def as_graph(modes: ModeSet | SwitchingGraph) -> SwitchingGraph:
    """The graph given, or that of modes without rules."""
    if not isinstance(modes, ModeSet | SwitchingGraph):
        raise TypeError(
            "modes must be a ModeSet (of matrices: ModeSet(matrices)) or a SwitchingGraph(modes, rules), "
            f"not a {type(modes).__name__}"
        )
    return modes if isinstance(modes, SwitchingGraph) else SwitchingGraph(modes)
