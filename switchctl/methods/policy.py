"""A policy: a value function of few quadratics, used online, with a guarantee for every initial state."""

from dataclasses import dataclass, field

import numpy as np

from switchctl.continuation import Plan, shortest
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import Method, Scheduler
from switchctl.methods.least import least_cost
from switchctl.modes import ModeSet
from switchctl.moments import Array, svec

Table = tuple[list[Plan], Array, Array]


@dataclass(frozen=True, repr=False, eq=False)
class Policy(Method):
    """Take, at every choice, the move whose cost and value after it are least; `Optimal.policy` makes one.

    The value is the least of a few quadratics, ``V(S) = min_P tr(P S)``, one set at each node of the switching graph
    with a choice. From any initial state the policy costs at most V(S_0), and V is at most ``factor`` times the
    optimum.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and rules that it is for.
    tables : dict of int to (ways, rows, constants)
        By node of the graph with a choice, for each move and quadratic after it: the way on that costs so much, as
        modes taken once and those repeated for ever; the cost as a row for ``svec(S)`` and a constant, per dk.
    factor : float
        The guarantee; infinite where the time was up before one was proven.
    status : str
        "done", or "interrupted" by Ctrl-C.

    Raises
    ------
    ValueError
        From `start` and `schedule`, on other modes or rules.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> policy = Optimal(gap=0.05).policy(modes)
    >>> policy
    Policy(144 functionals, at most 1.051 times the optimum)
    >>> print(round(schedule(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), policy).cost, 4))
    14.4423
    """

    graph: SwitchingGraph
    tables: dict[int, Table] = field(repr=False)
    factor: float
    status: str = "done"

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        same = graph.modes is self.graph.modes and graph.rules == self.graph.rules
        if not same or graph.automaton_edges != self.graph.automaton_edges:
            raise ValueError(
                f"the policy is for {self.graph.modes.names} under {self.graph.rules!r}; make one for these modes and "
                f"rules by Optimal(..).policy(modes, rules), not to be started under {graph.rules!r}"
            )
        return _PolicyScheduler(self.graph, self.tables)

    def __repr__(self) -> str:
        count = sum(len(constants) for _, _, constants in self.tables.values())
        told = (
            f"at most {self.factor:.4g} times the optimum"
            if np.isfinite(self.factor)
            else "no guarantee in the time given"
        )
        return f"Policy({count} functionals, {told}{', interrupted' * (self.status != 'done')})"


class _PolicyScheduler(Scheduler):
    def __init__(self, graph: SwitchingGraph, tables: dict[int, Table]) -> None:
        super().__init__(graph)
        self.tables = tables

    def decide(self, S: Array) -> int:
        if self.node not in self.tables:
            return int(np.flatnonzero(self.allowed)[0])  # there is no choice
        lead, word = self._way(self.node, S)
        return (lead + word)[0]

    def _way(self, node: int, S: Array) -> Plan:
        """The way on that costs least, of those that the value is made of."""
        plans, rows, constants = self.tables[node]
        return plans[least_cost(rows @ svec(S) + constants)]

    def tail(self, S: Array) -> Plan:
        """What the value promises: the way on that it is the cost of."""
        S = self._moment(S)
        forced: list[int] = []
        node, graph = self.node, self.graph
        while node not in self.tables:
            forced.append(int((graph.successor[node] >= 0).argmax()))
            A = self.modes.A_after[graph.last_mode[node], forced[-1]]
            S, node = A @ S @ A.T, int(graph.successor[node, forced[-1]])
        lead, word = self._way(node, S)
        return shortest((*forced, *lead), word)
