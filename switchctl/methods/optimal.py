"""The optimum, with proof: branch and bound over all switching sequences."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from switchctl.continuation import Plan, shortest, wander
from switchctl.graph import SwitchingGraph, as_graph, graph_under
from switchctl.methods.base import InfiniteCostError, Method, Scheduler
from switchctl.methods.least import TIE
from switchctl.methods.planning import PlanningScheduler
from switchctl.methods.policy import Policy
from switchctl.methods.prediction import CEILING, CONVERGED, INTERRUPTED
from switchctl.methods.refine import LocalSearch, Refine
from switchctl.modes import ModeSet
from switchctl.moments import Array, svec, transform
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.relaxed import RelaxedValues
from switchctl.optimum.search import Search
from switchctl.rules import Rules
from switchctl.validation import number, whole_number
from switchctl.values import require_definite_weights, require_plain_total

OPTIMAL = 1e-9
"""A proven gap of at most this fraction of the cost is called optimal."""
NOT_STABILISED = "no stabilising sequence found"
_FIRST = 0.5
_HARD = 5000  # moments in a rung from which on local search comes first
_UNROLLED = 3000
_CHOICES = 200
_SINGULAR = 1e-10  # share of the greatest weight
_INSTEAD = "; use Rollout, Refine, FewSwitches or RecedingHorizon"
_SLOWEST = 1.1
_STEEP = 1.2  # a rung whose tolerance is less by more than this factor is left ..
_MANY = 1_000_000  # .. after so many moments and 8 times those of the last, for one between


class Rung(NamedTuple):
    """What is known after a rung of the search, as `Optimal` tells its callback.

    Parameters
    ----------
    tolerance : float
        What the rung was searched with, a fraction of the cost.
    cost, lower_bound : float
        The least cost found and what is proven, in the unit of `Schedule.cost`.
    gap : float
        How far they are apart, a fraction of the cost.
    nodes : int
        Moments seen.
    seconds : float
        The time since the search began.
    """

    tolerance: float
    cost: float
    lower_bound: float
    gap: float
    nodes: int
    seconds: float


@dataclass(frozen=True, repr=False, eq=False)
class Optimal(Method):
    """The least cost of all switching sequences, for ever or over a finite horizon, with a proof how near it is.

    Branch and bound. A prefix of c so far that has come to the moment S is given up where
    ``c + max_j tr(L_j S) >= (1 - tolerance) J``: J is the least cost found, and the L_j are lower bounds of whatever
    follows, ``L <= Q_i + A_i' L A_i`` for every mode, each the best for some moment (a semidefinite program). The
    search is run with one tolerance after the other, from one half down to the gap; a run that ends proves that no
    sequence costs less than ``(1 - tolerance) J``. All bounds hold in spite of rounding (docs/theory.md, "The
    optimum").

    It plans at its first sample, and doesn't look at later ones. The schedule has its proven ``lower_bound`` and
    ``gap``; its ``status`` is "optimal" (the gap is at most 1e-9), "gap reached", "time limit", "memory limit",
    "precision limit" (rounding hides the rest), "interrupted" or "no stabilising sequence found". A run that ends is
    asked for by ``schedule(.., steps=N, terminal=M)``; with ``steps`` alone the schedule lists the first steps of a run
    for ever. It is for total costs without noise.

    Parameters
    ----------
    gap : float, optional
        The gap to prove, as a fraction of the cost.
    time_limit : float, optional
        Seconds after which the best sequence is returned with the gap proven so far.
    memory_limit : float, optional
        Bytes that the search may take.
    callback : callable, optional
        Called after each rung with a `Rung`.

    Raises
    ------
    TypeError, ValueError
        If a setting is of the wrong kind or value; from `start` and `schedule`, if there is noise or a discount.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> best = schedule(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), Optimal(gap=1e-6))
    >>> print(best.status, best.switches, round(best.cost, 4), round(best.lower_bound, 4))
    gap reached (Switch(step=12, before=1, after=0),) 14.4423 14.4422

    Five steps, with W2 after the last one counted too:

    >>> x0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    >>> short = schedule(modes, x0, Optimal(gap=1e-6), steps=5, terminal=np.eye(2))
    >>> short.sequence.tolist(), round(short.cost, 4)
    ([1, 1, 1, 1, 1], 7.8449)
    """

    gap: float = 1e-3
    time_limit: float = 60.0
    memory_limit: float = 2e9
    callback: Callable[[Rung], None] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, reason in (
            ("gap", "a fraction of the cost; 0 can't be proven in floating point, 1e-9 can"),
            ("time_limit", "seconds"),
            ("memory_limit", "bytes"),
        ):
            value = number(getattr(self, name), name)
            if not value > 0 or (name == "gap" and value >= 1):
                bounds = "between 0 and 1" if name == "gap" else "above 0"
                raise ValueError(f"{name} is {value!r}; expected a number {bounds}, {reason}")
            object.__setattr__(self, name, value)
        if self.callback is not None and not callable(self.callback):
            raise TypeError(f"callback must be callable, not {self.callback!r}")

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        require_plain_total(graph.modes, "Optimal", _INSTEAD)
        return _OptimalScheduler(graph, self)

    def policy(self, modes: ModeSet, rules: Rules | SwitchingGraph | None = None, quadratics: int = 100) -> Policy:
        """Make a feedback law whose cost is within a proven factor of the optimum from every initial state.

        Relaxed dynamic programming: a value function of few quadratics, to which the one that is wanted most is added
        until the factor is ``1 / (1 - gap)``, there are enough, or the time is up (docs/theory.md, "The policy").

        Parameters
        ----------
        modes : ModeSet
            The modes; their stage weights must be positive definite.
        rules : Rules or SwitchingGraph, optional
            What limits or prices switching; nothing by default.
        quadratics : int, optional
            The most quadratics in all.

        Returns
        -------
        Policy
            A method like the others; its ``factor`` is the guarantee. Interrupted by Ctrl-C, with the quadratics so
            far, the factor proven so far, and marked so.

        Raises
        ------
        ValueError
            If there is noise or a discount, a stage weight is singular, a switch loses some of the state, the graph
            has more than 200 nodes with a choice, or no way on of finite cost is known at one of them.
        """
        quadratics = whole_number(quadratics, "quadratics")
        graph = graph_under(modes, rules)
        require_plain_total(modes, "a policy", _INSTEAD)
        decisions = Decisions(graph)
        if not decisions.reachable(_CHOICES):
            raise ValueError(f"{graph.rules!r} needs more than {_CHOICES} nodes with a choice, too many for a policy")
        require_definite_weights(modes, "a policy", _SINGULAR)
        weights = np.linalg.eigvalsh(modes.Q_after)
        singular = weights[..., 0] <= _SINGULAR * weights[..., -1]
        if singular.any():
            i, j = (modes.names[k] for k in np.argwhere(singular)[0])
            raise ValueError(
                f"a policy is for switches that keep the whole state, and that from {i!r} to {j!r} loses some of it "
                "(ModeSet.activation); inactive='track', 'hold' or 'run' keeps it"
            )
        values = RelaxedValues(decisions)
        if any(len(known.P) == 0 for known in values.values.values()):
            raise ValueError("a policy starts from ways on of finite cost, and at some node of the graph none is known")
        for u, known in values.values.items():
            if known.constants.min() > 0 and decisions.constant_ahead(u) == 0:
                raise ValueError(
                    "at some node a run may go on for ever and pay no more for switches or in prices, but only by "
                    "switching for ever; a policy starts from modes that are held"
                )
        values.grow(1 / (1 - self.gap), quadratics, time.perf_counter() + self.time_limit)
        tables = {}
        for u, (_, node) in enumerate(decisions.places):
            rows, constants, plans = [], [], []
            for move in decisions.moves(u):
                P, later, ways = values.values[move.head]
                rows.append(svec(decisions.plain_cost(move.Q + transform(move.A, P))))
                constants.append(later + move.constant)
                plans += [(move.word + lead, word) for lead, word in ways]
            tables[node] = plans, np.concatenate(rows), np.concatenate(constants)
        return Policy(graph, tables, values.factor, INTERRUPTED if values.interrupted else "done")


class _OptimalScheduler(PlanningScheduler):
    def __init__(self, graph: SwitchingGraph, settings: Optimal) -> None:
        super().__init__(graph)
        self.settings = settings

    def search(self, S: Array) -> Plan:
        if not (np.any(S) or self.graph.price.any() or self.graph.switch_cost.any()):
            self.lower_bound, self.status = 0.0, "optimal"
            return self._any(S)
        if self.initial is not None:
            S = self.initial
        with np.errstate(over="ignore"):
            size = float(np.sum(S**2) ** 2)
        if not size < math.inf or (size == 0 and S.any()):
            what = "small" if size == 0 else "great"
            raise FloatingPointError(f"the second moment is too {what} to be searched with; scale the state")
        begun = time.perf_counter()
        self.S, self.deadline = S, begun + self.settings.time_limit
        self.refining = 0.0  # seconds
        decisions = Decisions(self.graph, None if self.terminal is None else self.steps)
        terminal = None if self.terminal is None else decisions.scaled_cost(self.terminal)
        found = Search.prepared(decisions, decisions.scaled(S), terminal, self.settings.memory_limit)
        if found is None:
            if self.graph.price.any() or self.graph.switch_cost.any():
                raise InfiniteCostError(
                    f"Optimal needs a way to go on at finite cost, and under {self.graph.rules!r} none was found"
                )
            self.lower_bound, self.status = 0.0, NOT_STABILISED
            return self._any(S)
        rungs = 0
        try:
            rungs = self._climb(found, begun)
        except KeyboardInterrupt:
            self.interrupted, self.status = True, INTERRUPTED
        dk = self.modes.dk
        self.lower_bound = dk * min(found.bound, found.cost)
        self.statistics = {
            "nodes": found.nodes,
            "rungs": rungs,
            "bounds": found.lower.count,
            "seconds": time.perf_counter() - begun,
            "seconds of bounds": found.lower.seconds,
            "seconds of refine": self.refining,
        }
        assert found.plan is not None
        return found.plan

    def _climb(self, found: Search, begun: float) -> int:
        """Rung after rung, with less tolerance each, until the gap is proven."""
        wanted, dk = self.settings.gap, self.modes.dk
        tolerance, rungs, refined = max(_FIRST, wanted), 0, None
        last = 1.0, 1  # the tolerance of the last rung, and its moments
        with tqdm(desc="optimum", unit="moment", unit_scale=True, delay=2, leave=False) as progress:

            def told() -> None:
                gap = _gap(found)
                progress.set_postfix(gap=f"{gap:.1e}", cost=f"{dk * found.cost:.8g}", refresh=False)
                progress.update(found.nodes - progress.n)

            while True:
                before = found.nodes
                early = refined is None
                most = _HARD if early else math.inf if tolerance > last[0] / _STEEP else _MANY + 8 * last[1]
                status = found.rung(tolerance, self.deadline, told, most)
                if status == "too many" and early:
                    refined = self._refine(found)
                    continue
                if status == "too many":
                    tolerance = math.sqrt(tolerance * last[0])
                    continue
                rungs += status == "closed"
                gap = _gap(found)
                if self.settings.callback is not None:
                    spent = time.perf_counter() - begun
                    self.settings.callback(Rung(tolerance, dk * found.cost, dk * found.bound, gap, found.nodes, spent))
                if status != "closed" or gap <= wanted or tolerance <= wanted:
                    break  # beyond the tolerance wanted, only rounding is between the bounds
                seen = found.nodes - before
                if refined is not None and found.plan != refined:
                    refined = self._refine(found)
                # Moments grow as a power of 1 / tolerance: the next rung is to take about four times as many.
                power = math.log(max(seen / last[1], 1)) / math.log(last[0] / tolerance)
                factor = 16.0 if seen < 3000 else 4 ** (1 / max(power, 0.3))
                last = tolerance, seen
                tolerance = max(tolerance / max(factor, _SLOWEST), wanted * (1 - 1e-3))
        short = "precision limit" if status == "closed" else status
        self.status = "optimal" if gap <= OPTIMAL else "gap reached" if gap <= wanted else short
        return rungs

    def _refine(self, found: Search) -> Plan:
        """Improve the best sequence found by local search; of a run that ends, also the beginning of one for ever."""
        begun = time.perf_counter()
        assert found.plan is not None
        starts = [found.plan] if self.terminal is None else [found.plan, *self._beginnings()]
        for lead, word in starts:
            repeated = -(-max(self._length(lead, word) - len(lead), 1) // len(word)) if word else 0
            local = LocalSearch(self.graph, self.S, lead + word * repeated, word, self.terminal)
            local.improve(self.deadline)
            path = tuple(local.run.path.tolist())
            if local.run.total < found.cost * (1 - TIE):
                found.cost, found.plan = local.run.total, shortest(path, word) if word else (path, ())
            if local.interrupted:
                raise KeyboardInterrupt
        self.refining += time.perf_counter() - begun
        return found.plan

    def _beginnings(self) -> list[Plan]:
        """The first steps of a refined run for ever, where there is one of finite cost."""
        try:
            refined = Refine().start(self.graph)
            assert isinstance(refined, PlanningScheduler)
            lead, word = refined.search(self.S)
        except ValueError:
            return []
        if refined.interrupted:
            raise KeyboardInterrupt
        assert self.steps is not None
        return [(tuple([*lead, *word * self.steps][: self.steps]), ())]

    def _length(self, lead: tuple[int, ...], word: tuple[int, ...]) -> int:
        """The steps after which next to nothing is left."""
        S, k, before, distance = self.S, 0, self.graph.last_mode[0], self.modes.distance
        start = np.sum(distance * S)
        while k < min(len(lead) + _UNROLLED, CEILING) and not np.sum(distance * S) <= CONVERGED * start:
            mode = lead[k] if k < len(lead) else word[(k - len(lead)) % len(word)]
            A = self.modes.A_after[before, mode]
            S, k, before = A @ S @ A.T, k + 1, mode
        return max(k, len(lead))

    def _any(self, S: Array) -> Plan:
        """Some way to go on, where they all cost nothing, or infinitely much."""
        if self.terminal is not None:
            lead, word = wander(self.graph, 0)
            return tuple((lead + word * (self.steps or 1))[: self.steps]), ()
        return self.cheapest_way(S) or wander(self.graph, 0)


def _gap(found: Search) -> float:
    return max(0.0, 1 - found.bound / found.cost) if found.cost > 0 else 0.0
