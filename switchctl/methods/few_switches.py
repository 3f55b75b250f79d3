"""The optimum with few switches: all instants and modes, compared at once."""

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from switchctl.continuation import Plan
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import InfiniteCostError, Method, Scheduler
from switchctl.methods.least import TIE
from switchctl.methods.orbits import Orbit, held_nodes
from switchctl.methods.planning import PlanningScheduler, StepCosts
from switchctl.methods.prediction import CEILING
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.optimum.minorants import lower_bounds
from switchctl.validation import whole_number
from switchctl.values import Value, refuse_average, require_criterion, word_value

_CHUNK = 256
_NEGLIGIBLE = 1e-13


@dataclass(frozen=True, repr=False)
class FewSwitches(Method):
    """The schedule of least cost among those with at most so many switches, which end in one mode for ever.

    Instants and modes are free. With prefix moments ``S_k`` of the first block and suffix costs
    ``X_jl(t) = sum_{s<t} A_j'^s Q_j A_j^s + A_j'^t P_l A_j^t`` of a second block of t steps and a last mode, a
    schedule with two switches costs ``c_k + tr(X_jl(t) S_k)``: all instants are one matrix product. With more
    switches, the first blocks are branched over, and a branch is cut where its cost and a lower bound of what follows
    exceed the best known.

    It plans at its first sample, which may take seconds, and doesn't look at later ones. Ctrl-C ends the search with
    the best schedule so far, whose ``status`` is "interrupted".

    Parameters
    ----------
    max_switches : int
        The most switches; ``Rules(max_switches=..)`` may allow fewer. Each beyond two multiplies the work by the number
        of instants worth trying, often a few hundred.

    Raises
    ------
    ValueError
        If max_switches is negative; from `start` and `schedule`, if no mode can be held for ever at finite cost
        within so many switches.

    Notes
    -----
    An instant is left out only where what follows it is below 1e-13 of the cost, where the cost has passed the best
    known, or after 100,000 steps of one mode.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> schedule(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), FewSwitches(1)).switches
    (Switch(step=12, before=1, after=0),)
    """

    max_switches: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "max_switches", whole_number(self.max_switches, "max_switches", 0))

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        refuse_average(graph.modes, "FewSwitches")
        require_criterion(graph.modes)
        return _FewSwitchesScheduler(graph, self.max_switches)


class _Block(NamedTuple):
    """A mode held from a node: the nodes, moments and costs so far after k = 0, 1, .. steps."""

    nodes: NDArray[np.intp]
    moments: Array
    costs: Array


class _FewSwitchesScheduler(StepCosts, PlanningScheduler):
    """All costs are per dk."""

    def __init__(self, graph: SwitchingGraph, max_switches: int) -> None:
        StepCosts.__init__(self, graph)
        PlanningScheduler.__init__(self, graph)
        allowed = graph.rules.max_switches
        self.max_switches = max_switches if allowed is None else min(max_switches, allowed)
        modes = self.modes
        self.orbits = [Orbit(K) for K in self.maps]
        values = [None if P is None else word_value(graph, (i,)) for i, P in enumerate(modes.tails)]
        nothing = Value(np.zeros_like(modes.distance), 0.0)
        self.tails = np.stack([self.row(value or nothing) for value in values])
        final = [value is not None for value in values]
        self.final = np.isinf(graph.holds) & final  # which mode may be held for ever at finite cost from a node
        self.suffixes: dict[tuple[int, int], Array] = {}
        if fewest_switches(graph, self.final) > max_switches:
            raise InfiniteCostError(
                f"FewSwitches({max_switches}) ends in a mode held for ever at finite cost, and {graph.rules!r} and the "
                f"modes leave none after at most {max_switches} switches"
            )

    @cached_property
    def bounds(self) -> Array:
        """What goes on from a moment costs at least ``max_j bounds[j] . s``."""
        A, Q = self.modes.every_step
        rows = lower_bounds(np.sqrt(self.modes.discount) * A, Q)
        return np.column_stack([rows, np.zeros(len(rows))])

    def search(self, S: Array) -> Plan:
        if self.terminal is not None:
            raise ValueError(
                "FewSwitches plans a run for ever; for one that ends use Optimal, or Refine(RecedingHorizon(..))"
            )
        self.best, self.compared = np.inf, 0
        self.blocks: list[tuple[int, int]] = []  # modes and steps, the last one for ever
        graph, s, before = self.graph, self.moment(S), self.graph.start_mode
        firsts = np.flatnonzero(graph.successor[0] >= 0).tolist()
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                for switches in range(self.max_switches + 1):  # the best with fewer cuts branches of the next round
                    self.used_up = switches == 0  # whether some schedule has so many; else none has more
                    for i in firsts:
                        left = switches - (before >= 0 and i != before)
                        if left >= 0:
                            self._explore(0, i, self.arrive(before, i, s), self.switch(before, i, s), left, ())
                    if not self.used_up:
                        break
        except KeyboardInterrupt:
            if not self.blocks:
                raise
            self.interrupted = True
        self.statistics = {"schedules compared": self.compared}
        return tuple(mode for mode, steps in self.blocks for _ in range(steps)), (self.blocks[-1][0],)

    def _offer(self, costs: Array) -> int | None:
        """Compare schedules, those not allowed at inf, with the best known: the place of a better one, if any."""
        self.compared += int(np.isfinite(costs).sum())
        place = int(np.nanargmin(costs)) if np.isfinite(costs).any() else None
        tie = TIE * abs(self.best) if np.isfinite(self.best) else 0.0
        if place is None or not costs.flat[place] < self.best - tie:
            return None
        self.best = float(costs.flat[place])
        return place

    def _worth(self, costs: Array, moments: Array) -> NDArray[np.bool_]:
        """Which prefixes may lead to something better than the best known."""
        return costs + (moments @ self.bounds.T).max(axis=1) < self.best

    def _explore(self, node: int, i: int, s: Array, cost: float, left: int, past: Any) -> None:
        """All schedules that go on with mode i and have so many switches left."""
        if self.final[node, i] and self._offer(np.array([cost + self.tails[i] @ s])) is not None:
            self.blocks = [*past, (i, 0)]
        if left == 0:
            self.used_up = True
            return
        block = self._hold(node, i, s, cost)
        others = [j for j in range(len(self.modes)) if j != i]
        steps = np.arange(1, len(block.costs))
        self.used_up = self.used_up or (left <= 2 and bool(others))
        for j in others:
            costs, nodes = block.costs[1:] + self.switch(i, j, block.moments[1:]), block.nodes[1:]
            moments = self.arrive(i, j, block.moments[1:])
            ends = np.where(self.final[nodes, j], costs + moments @ self.tails[j], np.inf)
            if (k := self._offer(ends)) is not None:
                self.blocks = [*past, (i, k + 1), (j, 0)]
            going = (self.graph.successor[nodes, j] >= 0) & self._worth(costs, moments)
            if left == 2:
                self._two_blocks(i, j, steps[going], nodes[going], moments[going], costs[going], past)
            elif left > 2:
                for k in tqdm(np.flatnonzero(going), desc="few switches", unit="instant", delay=2, leave=False):
                    if self._worth(costs[k : k + 1], moments[k : k + 1])[0]:
                        self._explore(int(nodes[k]), j, moments[k], costs[k], left - 1, (*past, (i, int(k) + 1)))

    def _hold(self, node: int, i: int, s: Array, cost: float) -> _Block:
        """A mode held for as long as a switch may be worth while."""
        length = _CHUNK
        while True:
            nodes = held_nodes(self.graph, node, i, length)
            moments = self.orbits[i].from_(s, len(nodes) - 1)
            stage = moments[:-1] @ self.stages[i]
            costs = np.concatenate([[0.0], np.cumsum(stage)]) + cost
            finite = np.isfinite(costs) & np.isfinite(moments).all(axis=1)
            over = ~finite | ~self._worth(np.where(finite, costs, np.inf), np.where(finite[:, None], moments, 0.0))
            # Held for ever, it costs as much as anything that can come when nothing is left.
            gone = self.final[nodes, i] & (moments @ self.tails[i] <= _NEGLIGIBLE * costs)
            end = int((over | gone).argmax()) if (over | gone).any() else len(costs)
            if end < len(costs) or len(nodes) <= length or length >= CEILING:
                return _Block(nodes[:end], moments[:end], costs[:end])
            length = min(4 * length, CEILING)

    def _suffix(self, j: int, last: int) -> Array:
        """Rows: mode j for t = 1 .. steps and then the last mode for ever."""
        if (j, last) not in self.suffixes:
            d = len(self.distance)
            affine = np.zeros((d + 1, d + 1))
            affine[:d, :d], affine[:d, d], affine[d, d] = self.orbits[j].square(0).T, self.stages[j], 1.0
            end = np.zeros(d) if last < 0 else self.enter(j, last, self.tails[last])
            self.suffixes[j, last] = Orbit(affine).from_(np.append(end, 1.0), _CHUNK)[1:, :d]
        return self.suffixes[j, last]

    def _two_blocks(
        self, i: int, j: int, first: NDArray[np.intp], nodes: NDArray[np.intp], moments: Array, costs: Array, past: Any
    ) -> None:
        """Mode i for ``first`` steps, j for t steps, each last mode for ever: every pair of instants at once."""
        graph = self.graph
        lasts = [last for last in range(len(self.modes)) if last != j]
        done = 0
        while len(first) and done < CEILING:
            after = np.zeros((len(first), _CHUNK), dtype=np.intp)  # the node after t steps of j; -1 for none
            for step in range(0 if graph.free else _CHUNK):
                nodes = after[:, step] = np.where(nodes >= 0, graph.successor[nodes, j], -1)
            for last in lasts:
                allowed = (after >= 0) & self.final[after, last]
                if allowed.any():
                    ends = moments @ self._suffix(j, last).T + costs[:, None]
                    if (place := self._offer(np.where(allowed, ends, np.inf))) is not None:
                        row, column = divmod(place, _CHUNK)
                        self.blocks = [*past, (i, int(first[row])), (j, done + column + 1), (last, 0)]
            done += _CHUNK
            costs = costs + moments @ self._suffix(j, -1)[-1]
            moments = moments @ self.orbits[j].square(_CHUNK.bit_length() - 1).T
            gone = self.final[nodes, j] & (moments @ self.tails[j] <= _NEGLIGIBLE * costs)
            going = (nodes >= 0) & np.isfinite(costs) & ~gone
            going[going] &= self._worth(costs[going], moments[going])
            first, nodes, moments, costs = first[going], nodes[going], moments[going], costs[going]


def fewest_switches(graph: SwitchingGraph, final: NDArray[np.bool_]) -> float:
    """The fewest switches after which a final mode can be held."""
    first = (0, graph.start_mode)
    switches, queue = {first: 0}, deque([first])
    while queue:
        node, before = queue.popleft()
        for mode in np.flatnonzero(graph.successor[node] >= 0).tolist():
            so_far = switches[node, before] + int(before >= 0 and mode != before)
            head = (int(graph.successor[node, mode]), mode)
            if so_far < switches.get(head, np.inf):
                switches[head] = so_far
                (queue.appendleft if mode == before else queue.append)(head)
    ends = (count + int(b >= 0 and not final[v, b]) for (v, b), count in switches.items() if final[v].any())
    return min(ends, default=np.inf)
