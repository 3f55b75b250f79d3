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
from switchctl.validation import positive_semidefinite, whole_number
from switchctl.values import Value

_PLANS = 8  # that a scheduler keeps


class StepCosts:
    """What steps and switches cost, per dk, on vectors ``weight * (svec(S), 1)``.

    The weight is what a cost at that step counts, so that noise, constants and a discount are entries like the others.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes, and what switches cost.

    Attributes
    ----------
    maps : array, shape (m, d + 1, d + 1)
        A step of each mode, after the switch to it.
    stages, distance : arrays, shapes (m, d + 1) and (d + 1,)
        What a sample costs, and W2, as rows.
    fixed, by_w2 : arrays, shape (m + 1, m)
        What a switch costs, per dk.
    """

    def __init__(self, graph: SwitchingGraph) -> None:
        modes = graph.modes
        with np.errstate(over="ignore"):
            maps = moment_maps(modes.A)
        if not np.isfinite(maps).all():
            great = modes.names[int((~np.isfinite(maps)).any(axis=(1, 2)).argmax())]
            raise FloatingPointError(
                f"a step of mode {great!r} takes second moments beyond the floating-point range (greatest entry "
                f"{np.abs(modes[great].A).max():.3g}); scale the states, or leave that mode out"
            )
        self.maps = modes.discount * _affine(maps, svec(modes.W))
        self.stages = np.column_stack([svec(modes.Q), graph.price + modes.offset])
        self.distance = np.append(svec(modes.distance), 0.0)
        self.fixed, self.by_w2 = graph.switch_cost / modes.dk, graph.switch_cost_per_w2 / modes.dk
        self._activation = None
        if modes.activation is not None:
            E = moment_maps(modes.activation)
            self._activation = _affine(E, np.zeros(E.shape[:-1]))

    def moment(self, S: Array) -> Array:
        """The vector of a second moment at the first step."""
        return np.append(svec(S), 1.0)

    def row(self, value: Value) -> Array:
        """A value as a row."""
        return np.append(svec(value.P), value.constant)

    def switch(self, before: Any, mode: Any, s: Array) -> Any:
        """Cost of a switch.

        Parameters
        ----------
        before, mode : int, or arrays and slices of them
            The modes.
        s : array, shape (d + 1,) or (k, d + 1)
            The vector at the switch, or several.

        Returns
        -------
        float or array
        """
        return self.fixed[before, mode] * s[..., -1] + self.by_w2[before, mode] * (s @ self.distance)

    def arrive(self, before: int | NDArray[np.intp], mode: int, s: Array) -> Array:
        """The vector after a switch, or the vectors: ``before`` and ``s`` may have a row each."""
        maps = self._activation
        if maps is None:
            return s
        return _row_by_row(before, s, lambda j, rows: rows if j < 0 else rows @ maps[j, mode].T)

    def arrivals(self, before: int, s: Array) -> Array | None:
        """The vector after a switch to each mode, shape (m, d + 1); None where switches leave it as it is."""
        return None if self._activation is None or before < 0 else self._activation[before] @ s

    def enter(self, mode: int, after: int | NDArray[np.intp], P: Array) -> Array:
        """Rows for what begins with a switch, from rows for what follows; ``after`` and ``P`` may have a row each."""
        maps = self._activation
        if maps is not None:
            P = _row_by_row(after, P, lambda i, rows: rows @ maps[mode, i])
        P = P + self.by_w2[mode, after][..., None] * self.distance
        P[..., -1] += self.fixed[mode, after]
        return P


def _affine(K: Array, w: Array) -> Array:
    """The matrices [[K, w], [0, 1]]."""
    maps = np.zeros((*K.shape[:-2], K.shape[-1] + 1, K.shape[-1] + 1))
    maps[..., :-1, :-1], maps[..., :-1, -1], maps[..., -1, -1] = K, w, 1.0
    return maps


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
        self.first = np.zeros_like(self.modes.A[0])  # the moment that the plan is for
        self.plans: dict[bytes, Plan] = {}  # those made lately, by that

    def remembered(self) -> Sequence[float]:  # noqa: D102
        return self.k, *self.first[np.tril_indices(len(self.first))].tolist()

    def recall(self, values: Sequence[float]) -> None:  # noqa: D102
        k, *entries = self._numbers(values)
        lower, steps = np.zeros_like(self.first), whole_number(k, "values[0]", 0)
        lower[np.tril_indices(len(lower))] = entries
        first = positive_semidefinite(lower + np.tril(lower, -1).T, "the second moment in values")
        self.plan, self.k, self.first = self._planned(first) if steps else None, steps, first
        if self.interrupted:
            raise KeyboardInterrupt  # a part of a search is not the plan that was followed

    def _planned(self, first: Array) -> Plan:
        """The plan for a moment, made once: whoever takes the scheduler back and forth must not wait for it again."""
        key = first.tobytes()
        if key in self.plans:
            return self.plans[key]
        node, self.node = self.node, 0
        try:
            plan = self.search(first)
        finally:
            self.node = node
        if not self.interrupted:
            self.plans = dict([*self.plans.items(), (key, plan)][-_PLANS:])
        return plan

    def recover(self, sequence: Sequence[int]) -> None:  # noqa: D102
        super().recover(sequence)
        self.k = len(sequence)

    def decide(self, S: Array) -> int:  # noqa: D102
        if self.plan is None:
            first = (S + S.T) / 2 + 0.0  # without signed zeros, so that numbers tell it to the bit
            self.plan, self.first = self._planned(first), first
        lead, word = self.plan
        k, self.k = self.k, self.k + 1
        return lead[k] if k < len(lead) else word[(k - len(lead)) % len(word)]

    def tail(self, S: Array) -> Plan:  # noqa: D102
        if self.plan is None:
            raise ValueError("no step has been taken, so nothing is planned; call tail after step")
        lead, word = self.plan
        if not word:
            return (), ()
        turn = max(self.k - len(lead), 0) % len(word)
        return shortest(lead[self.k :], word[turn:] + word[:turn])
