"""Rollout: one step of any mode, then the best single mode for ever."""

from dataclasses import dataclass

import numpy as np

from switchctl.continuation import Plan, as_rows
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import InfiniteCostError, Method, Scheduler
from switchctl.methods.constant import require_schur
from switchctl.methods.least import least_cost
from switchctl.modes import ModeSet
from switchctl.moments import Array, svec
from switchctl.values import require_criterion


@dataclass(frozen=True, repr=False)
class Rollout(Method):
    """Take, at every sample, the mode whose one step followed by the best single mode for ever costs least.

    With the Lyapunov solutions P_q the choice is the i that minimises
    ``min_q tr((Q_i + A_i' P_q A_i) S)``. It costs no more than the best single mode, whatever the initial state, and
    is mean-square stable without a constraint where every stage weight is positive definite, as by default
    (docs/theory.md has the proofs; with a singular weight, states that the cost doesn't see may grow). One mode at
    least must be Schur; under rules that let none be held for ever, a cycle of modes takes its place.

    Raises
    ------
    ValueError
        From `start` and `schedule`, if no mode is Schur, or rules leave no way on at finite cost.

    Examples
    --------
    >>> modes = ModeSet([[[0.9, 5.0], [0.0, 0.5]], [[0.95, 0.0], [0.0, 0.9]]])
    >>> scheduler = Rollout().start(modes)
    >>> scheduler.step([0.0, 1.0]), scheduler.step([1.0, 0.0])
    (1, 0)
    """

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        require_criterion(graph.modes)
        if graph.free:
            require_schur(graph.modes, "Rollout")
        return _RolloutScheduler(graph)


class _RolloutScheduler(Scheduler):
    def __init__(self, graph: SwitchingGraph) -> None:
        super().__init__(graph)
        self.tables: dict[int, tuple[list[int], Array, Array]] = {}
        self._table()

    def _table(self) -> tuple[list[int], Array, Array]:
        """Each mode allowed followed by each way on: the mode, and the cost as a row for svec(S) and a constant."""
        if self.node not in self.tables:
            ways, moves, values = self.continuations, [], []
            for i in np.flatnonzero(self.allowed).tolist():
                head = int(self.graph.successor[self.node, i])
                for number in ways.table(head)[0]:
                    moves.append(i)
                    values.append(ways.before(self.node, i, ways.value(head, number)))
            if not values:
                raise InfiniteCostError(
                    f"Rollout needs a way to go on at finite cost, and under {self.graph.rules!r} none was found"
                )
            self.tables[self.node] = moves, *as_rows(self.graph, values)
        return self.tables[self.node]

    def decide(self, S: Array) -> int:
        moves, rows, constants = self._table()
        return moves[least_cost(rows @ svec(S) + constants)]

    def tail(self, S: Array) -> Plan:
        return self.cheapest_way(S) or super().tail(S)
