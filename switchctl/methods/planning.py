"""Schedulers that plan the whole run at its first sample, and then follow the plan."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from switchctl.continuation import Plan, shortest
from switchctl.graph import SwitchingGraph
from switchctl.methods.base import Scheduler
from switchctl.moments import Array, moment_maps, svec


class StepCosts:
    """What steps and switches cost, per dk, on ``svec(S)``.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes, and what switches cost.

    Attributes
    ----------
    maps : array, shape (m, d, d)
        A step of each mode, on ``svec(S)`` after the switch to it.
    stages, distance : arrays, shapes (m, d) and (d,)
        The stage weights and W2 as rows for ``svec(S)``.
    fixed, by_w2 : arrays, shape (m + 1, m)
        What a switch costs, per dk.
    """

    def __init__(self, graph: SwitchingGraph) -> None:
        modes = graph.modes
        self.maps, self.stages = moment_maps(modes.A), svec(modes.Q)
        self.distance = svec(modes.distance)
        self._activation = None if modes.activation is None else moment_maps(modes.activation)
        self.fixed, self.by_w2 = graph.switch_cost / modes.dk, graph.switch_cost_per_w2 / modes.dk

    def switch(self, before: Any, mode: Any, s: Array) -> Any:
        """Cost per dk of a switch.

        Parameters
        ----------
        before, mode : int, or arrays and slices of them
            The modes.
        s : array, shape (d,) or (k, d)
            The moment at the switch, or several.

        Returns
        -------
        float or array
        """
        return self.fixed[before, mode] + self.by_w2[before, mode] * (s @ self.distance)

    def arrive(self, before: int | NDArray[np.intp], mode: int, s: Array) -> Array:
        """The moment after a switch, or the moments: ``before`` and ``s`` may have a row each."""
        maps = self._activation
        if maps is None:
            return s
        return _row_by_row(before, s, lambda j, rows: rows if j < 0 else rows @ maps[j, mode].T)

    def arrivals(self, before: int, s: Array) -> Array:
        """The moment after a switch to each mode, shape (m, d)."""
        if self._activation is None or before < 0:
            return np.broadcast_to(s, (len(self.maps), len(s)))
        return self._activation[before] @ s

    def enter(self, mode: int, after: int | NDArray[np.intp], P: Array) -> Array:
        """Rows for what begins with a switch, from rows for what follows; ``after`` and ``P`` may have a row each."""
        maps = self._activation
        if maps is not None:
            P = _row_by_row(after, P, lambda i, rows: rows @ maps[mode, i])
        return P + self.by_w2[mode, after][..., None] * self.distance


def _row_by_row(modes: int | NDArray[np.intp], rows: Array, function: Callable[[int, Array], Array]) -> Array:
    """A function of a mode and rows, where all rows have one mode or each has its own."""
    if np.ndim(modes) == 0:
        return function(int(modes), rows)
    result = np.empty_like(rows)
    for mode in np.unique(modes).tolist():
        result[modes == mode] = function(mode, rows[modes == mode])
    return result


class PlanningScheduler(Scheduler):
    """A scheduler that plans once, for the moments of its first sample, and doesn't look at later ones."""

    @abstractmethod
    def search(self, S: Array) -> Plan:
        """Plan a run from the start of the graph.

        Parameters
        ----------
        S : array, shape (n, n)
            The second moment at the start.

        Returns
        -------
        lead, word : tuples of int
            The modes taken once, and those repeated for ever after; none of these where the run ends.
        """

    def forget(self) -> None:  # noqa: D102
        self.plan: Plan | None = None
        self.k = 0

    def recover(self, sequence: Sequence[int]) -> None:  # noqa: D102
        super().recover(sequence)
        self.k = len(sequence)

    def decide(self, S: Array) -> int:  # noqa: D102
        if self.plan is None:
            self.plan = self.search(S)
        lead, word = self.plan
        k, self.k = self.k, self.k + 1
        return lead[k] if k < len(lead) else word[(k - len(lead)) % len(word)]

    def tail(self, S: Array) -> Plan:  # noqa: D102
        assert self.plan is not None  # a schedule has a step
        lead, word = self.plan
        if not word:
            return (), ()
        turn = max(self.k - len(lead), 0) % len(word)
        return shortest(lead[self.k :], word[turn:] + word[:turn])
