"""Local search: any method's schedule made better, step by step and block by block."""

import math
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from switchctl.continuation import Plan, lasting
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import InfiniteCostError, Method, Scheduler
from switchctl.methods.boundary import started
from switchctl.methods.least import TIE
from switchctl.methods.planning import PlanningScheduler, StepCosts
from switchctl.methods.prediction import INTERRUPTED, predict
from switchctl.methods.rollout import Rollout
from switchctl.modes import ModeSet
from switchctl.moments import Array, moment_factor
from switchctl.values import Value, refuse_average, word_value

_WORTH = 1e-7  # a move must gain this fraction of the cost ..
_ROUNDS = 1000  # of sweeps and moves at most
_POSITIONS = 1500  # .. and is looked for at so many instants at most
_BLOCKS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144)  # lengths of the blocks tried, with the least dwell times


@dataclass(frozen=True, repr=False)
class Refine(Method):
    """Improve another method's schedule by local search, under the same rules.

    In turns, until neither helps: *sweeps*, a backward pass of costs-to-go and a forward pass that chooses each mode
    anew against them, as long as one gains; and the best *move*: the schedule up to some step, a block of one mode,
    and the schedule again from some step on, which shifts a switch, inserts, removes or shortens whole blocks. Every
    cost is that of a complete schedule, to the end of time, so it never increases.

    It plans at its first sample, which may take seconds, and doesn't look at later ones. It may end short of the
    optimum. Ctrl-C ends the search with the best schedule so far, whose ``status`` is "interrupted".

    Parameters
    ----------
    base : Method, optional
        Where to start; `Rollout` by default.

    Raises
    ------
    TypeError
        If base is not a method.
    ValueError
        When running, if base's schedule costs infinitely much.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> x0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    >>> print(*(round(schedule(modes, x0, method).cost, 4) for method in (Constant("fast"), Refine(Constant("fast")))))
    104.93 14.4423
    """

    base: Method = Rollout()  # noqa: RUF009  immutable

    def __post_init__(self) -> None:
        if not isinstance(self.base, Method):
            raise TypeError(f"base must be a Method such as Rollout(), not {self.base!r}")

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        refuse_average(graph.modes, "Refine")
        return _RefineScheduler(graph, started(self.base, graph))


class _Run(NamedTuple):
    """A schedule: its modes up to the word, the vectors and the costs so far at each step, and what it costs in all."""

    path: NDArray[np.intp]
    moments: Array
    costs: Array
    total: float


class _Suffixes(NamedTuple):
    """What the schedule costs from each step t = 0 .. N on, as rows for the vector at t.

    The switch at t is left out, since it depends on what comes before: the vector is that after it. ``follows[t, v]``
    says whether the rules allow the rest from t on at node v.
    """

    modes: NDArray[np.intp]
    P: Array
    follows: NDArray[np.bool_]


class _RefineScheduler(PlanningScheduler):
    def __init__(self, graph: SwitchingGraph, base: Scheduler) -> None:
        super().__init__(graph)
        self.base = base

    def search(self, S: Array) -> Plan:
        self.base.reset()
        F = moment_factor(np.zeros(len(S)), S)
        self.base.steps, self.base.terminal = self.steps, self.terminal
        sequence, _, F, status = predict(self.base, F, None if self.terminal is None else self.steps)
        lead, word = self.base.tail(F @ F.T) if self.terminal is None else ((), ())
        if self.terminal is not None and status == INTERRUPTED:
            raise KeyboardInterrupt  # a part of a run that ends is no plan
        if self.base.interrupted or status == INTERRUPTED:
            self.interrupted = True
            return (*sequence, *lead), word
        local = LocalSearch(self.graph, S, (*sequence, *lead), word, self.terminal)
        local.improve()
        self.interrupted = local.interrupted
        self.statistics = {"start": self.modes.dk * local.start, "sweeps": local.sweeps, "moves": local.moves}
        return tuple(local.run.path.tolist()), word


class LocalSearch(StepCosts):
    """A schedule for one initial moment, made better by sweeps and moves; all costs are per dk.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes, and the moves that the rules allow.
    S : array, shape (n, n)
        The second moment at the start.
    path, word : tuples of int
        The schedule: the modes taken once, one at least, and those repeated for ever after.
    terminal : array, shape (n, n), optional
        For a run that ends with the path, where there is no word: the weight of the state there. Only sweeps are made.

    Attributes
    ----------
    run : _Run
        The best schedule found.
    start : float
        What it cost before.
    sweeps, moves : int
        Those that made it better.
    interrupted : bool
        Whether Ctrl-C ended the search.

    Raises
    ------
    InfiniteCostError
        If the schedule costs infinitely much.
    """

    def __init__(
        self,
        graph: SwitchingGraph,
        S: Array,
        path: tuple[int, ...],
        word: tuple[int, ...],
        terminal: Array | None = None,
    ) -> None:
        super().__init__(graph)
        self.graph, self.S, self.word = graph, S, word
        least = {int(low) for low in graph.least_dwells if low <= _POSITIONS}
        self.lengths = sorted({*_BLOCKS, *least})
        self.ends = terminal is not None
        value = word_value(graph, word) if terminal is None else Value(terminal, 0.0)
        if value is None:
            raise InfiniteCostError(
                "the schedule to refine costs infinitely much, so nothing can be compared with it; base it on a method "
                "that ends at finite cost: in a mode held for ever or, under rules that make it switch, in a cycle"
            )
        self.word_P = self.row(value)
        self.run = self._run(np.array(path, dtype=np.intp))
        self.start, self.sweeps, self.moves, self.interrupted = self.run.total, 0, 0, False

    def improve(self, deadline: float = math.inf) -> None:
        """Search until nothing helps, or Ctrl-C or the deadline come.

        Parameters
        ----------
        deadline : float, optional
            When to stop, on the clock of `time.perf_counter`.
        """
        run = self.run
        try:
            with tqdm(desc="refine", unit="round", delay=2, leave=False) as progress:
                rest, sweeping, failed = self._suffixes(run.path), True, 0
                while failed < 2 and progress.n < _ROUNDS:
                    if time.perf_counter() > deadline:
                        break
                    if not sweeping and self.ends:
                        break
                    found, gain = self._run(self._sweep(run, rest) if sweeping else self._move(run, rest)), 0.0
                    if found.total < run.total - TIE * abs(run.total):
                        self.sweeps, self.moves = self.sweeps + sweeping, self.moves + (not sweeping)
                        gain = run.total - found.total
                        run = self.run = found
                        rest = self._suffixes(run.path)
                    sweeping, failed = (True, 0) if gain > _WORTH * abs(run.total) else (not sweeping, failed + 1)
                    progress.set_postfix(cost=f"{self.graph.modes.dk * run.total:.8g}", refresh=False)
                    progress.update()
        except KeyboardInterrupt:
            self.interrupted = True

    def _run(self, path: NDArray[np.intp]) -> _Run:
        """The forward evaluation."""
        moments, costs = np.empty((len(path) + 1, len(self.distance))), np.zeros(len(path) + 1)
        moments[0], before = self.moment(self.S), self.graph.last_mode[0]
        for k, mode in enumerate(path.tolist()):
            s = self.arrive(before, mode, moments[k])
            costs[k + 1] = costs[k] + self.stages[mode] @ s + self.switch(before, mode, moments[k])
            moments[k + 1], before = self.maps[mode] @ s, mode
        s, end = moments[-1], 0.0
        if not self.ends:
            s, end = self.arrive(before, self.word[0], s), self.switch(before, self.word[0], s)
        return _Run(path, moments, costs, float(costs[-1] + end + self.word_P @ s))

    def _suffixes(self, path: NDArray[np.intp]) -> _Suffixes:
        """The backward pass."""
        graph, N = self.graph, len(path)
        modes = np.append(path, path[-1] if self.ends else self.word[0])
        P = np.empty((N + 1, len(self.distance)))
        follows = np.empty((N + 1, len(graph)), dtype=bool)
        P[N], follows[N] = self.word_P, True if self.ends else lasting(graph, self.word)
        for t in range(N - 1, -1, -1):
            mode, after = modes[t], modes[t + 1]
            P[t] = self.stages[mode] + self.enter(mode, after, P[t + 1]) @ self.maps[mode]
            heads = graph.successor[:, mode]
            follows[t] = (heads >= 0) & follows[t + 1, heads]
        return _Suffixes(modes, P, follows)

    def _sweep(self, run: _Run, rest: _Suffixes) -> NDArray[np.intp]:
        """The forward pass: each mode chosen anew against the cost of what follows; the present one wins a tie."""
        graph, chosen = self.graph, run.path.copy()
        after = rest.modes[1:], rest.P[1:]
        table = np.stack([self.stages[i] + self.enter(i, *after) @ K for i, K in enumerate(self.maps)], axis=1)
        node, before, s = 0, graph.last_mode[0], run.moments[0]
        for k, present in enumerate(run.path.tolist()):
            arrived = self.arrivals(before, s)
            ahead = table[k] @ s if arrived is None else np.einsum("ij,ij->i", table[k], arrived)
            costs = ahead + self.switch(before, slice(None), s)
            heads = graph.successor[node]
            costs[(heads < 0) | ~rest.follows[k + 1, heads]] = np.inf
            best = int((costs <= costs.min() * (1 + TIE)).argmax())  # a product may round equal rows differently
            mode = best if costs[best] < costs[present] * (1 - TIE) else present
            chosen[k], node, before, s = (
                mode,
                int(heads[mode]),
                mode,
                self.maps[mode] @ (s if arrived is None else arrived[mode]),
            )
        return chosen

    def _move(self, run: _Run, rest: _Suffixes) -> NDArray[np.intp]:
        """The best of: the schedule up to step k, a block of one mode, the schedule from step t on."""
        graph, (path, moments, costs, total) = self.graph, run
        nodes = graph.walk(path)
        before = np.append(graph.last_mode[:1], path)
        left = int((total - costs > _WORTH * total).sum())  # a change after so many steps gains too little
        if left == 0:
            return path
        k = self._positions(path, left)
        t = np.append(k[k > 0], len(path))
        follows = np.vstack([rest.follows[t].T, np.zeros((1, len(t)), dtype=bool)])  # the last row, -1, is nowhere
        best, found = total, path
        for i in range(len(self.maps)):
            P = self.enter(i, rest.modes[t], rest.P[t])
            prefixes = costs[k] + self.switch(before[k], i, moments[k])
            begun, heads = self.arrive(before[k], i, moments[k]), nodes[k]
            for shorter, length in pairwise([0, *self.lengths]):
                for _ in range(length - shorter):
                    P = self.stages[i] + P @ self.maps[i]
                    heads = np.where(heads >= 0, graph.successor[heads, i], -1)
                if (heads < 0).all():
                    break
                candidates = begun @ P.T + prefixes[:, None]
                if not graph.free:
                    candidates[~follows[heads]] = np.inf
                place = int(candidates.argmin())
                if candidates.flat[place] < best:
                    best, (row, column) = candidates.flat[place], divmod(place, len(t))
                    found = np.concatenate([path[: k[row]], np.full(length, i), path[t[column] :]])
        return found

    def _positions(self, path: NDArray[np.intp], left: int) -> NDArray[np.intp]:
        """Where to cut: every step, or in long schedules those evenly spread and the switches."""
        evenly = np.linspace(0, left - 1, min(left, _POSITIONS)).astype(np.intp)
        switches = np.flatnonzero(np.diff(path)) + 1
        return np.unique(np.concatenate([evenly, switches[switches < left][:_POSITIONS]]))
