"""Schedule: the answer, and everything that follows from it."""

import csv
import io
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from switchctl.continuation import lasting
from switchctl.files import FormatError, read_sealed, write_document, write_text
from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph
from switchctl.limits import indices
from switchctl.methods.boundary import initial_state, require_target
from switchctl.modes import ModeSet
from switchctl.moments import Array, moment_factor, trajectory
from switchctl.plain import VERSION, plain_schedule, read_schedule
from switchctl.predicted import factors_along, predicted, squared_distances
from switchctl.result_checks import lengthened_holds, numbers_by_name, require_kinds
from switchctl.result_text import facts, heading
from switchctl.switches import Switch, switches_of
from switchctl.tables import Summary
from switchctl.tail_costs import CostParts, tail_parts
from switchctl.validation import frozen, number, positive_semidefinite, real_array, whole_number
from switchctl.values import require_criterion

if TYPE_CHECKING:
    import pandas
    from control import ControlPlot


@dataclass(frozen=True, eq=False, repr=False)
class Schedule(Summary):
    """Which mode acts at each step, and what follows from it. `switchctl.schedule` makes one.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    sequence : sequence of int, length N
        The mode of each step, by index.
    tail : tuple of int, optional
        The word of modes that follows the last step, repeated for ever; by default the last mode, held.
    method : str, optional
        What made the schedule.
    status : str, optional
        Why it ends where it does.
    lengthened : sequence of (int, int), optional
        The updates at which a stability constraint lengthened the hold: the step, and the steps added.
    lead : tuple of int, optional
        Modes taken once, between the last step and the tail's word; none by default.
    graph : SwitchingGraph, optional
        The rules; by default there are none. A sequence against the rules is refused.
    statistics : dict, optional
        What a search that made the schedule reports: numbers by name.
    lower_bound : float, optional
        What every schedule for these modes, rules and initial state costs at least, where it is proven.
    terminal : array_like, shape (n, n), optional
        For a run that ends after the last step: the weight M of the state there. It then has no tail.
    target : Gaussian, optional
        For a run that ends, too: the distribution of the plant's state that W2 is the distance to.

    Raises
    ------
    TypeError, ValueError, KeyError, IndexError
        If something is of the wrong kind, no mode, empty, against the rules, or a lower bound above the cost.

    Notes
    -----
    The one cost convention of the package: ``cost = dk * (sum_{k=0}^{N-1} tr(Q_sk S_k) + tr(P S_N))``, with P the
    cost matrix of what follows the last step; it is infinite where the tail is not Schur. ``dk`` is dt, or 1 where dt
    carries no period. Under rules the costs of switches and ``dk`` times the running price of each step, above the
    cheapest mode's, are added: `cost_parts`. Arrays over time have one entry a step, for the state at its beginning.

    Examples
    --------
    >>> modes = ModeSet([[[0.5]], [[0.9]]], dt=0.1)
    >>> Schedule(modes, Gaussian([1.0], [[0.0]]), [1, 1, 0])
    Schedule: 3 steps (0.3 s)
    ├── cost      0.26848  (with A0 held after the last step)
    ├── W2        1 -> 0.164025
    ├── switches  1 (A1 -> A0 at step 2)
    └── use       A0 33.3 %, A1 66.7 %
    """

    modes: ModeSet
    x0: Gaussian
    sequence: Any
    tail: tuple[int, ...] = ()
    method: str = ""
    status: str = ""
    lengthened: tuple[tuple[int, int], ...] = ()
    lead: tuple[int, ...] = ()
    graph: SwitchingGraph = None  # type: ignore[assignment]
    statistics: Mapping[str, float] = field(default_factory=dict)
    lower_bound: float | None = None
    terminal: Any = None
    target: Gaussian | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "x0", initial_state(self.modes, self.x0))
        sequence = np.array(indices(self.modes, self.sequence, "sequence"), dtype=np.intp)
        if len(sequence) == 0:
            raise ValueError("sequence is empty; a schedule has at least one step")
        tail = tuple(indices(self.modes, self.tail, "tail"))
        require_kinds(self)
        if self.target is not None:
            require_target(self.modes, self.target)
            if tail or self.lead or self.terminal is not None:
                raise ValueError(
                    "a schedule with a target ends after its steps; it has no tail, no lead, no terminal weight"
                )
        elif self.terminal is None:
            tail = tail or (int(sequence[-1]),)
        else:
            M = real_array(self.terminal, "terminal", self.modes.A.shape[1:])
            object.__setattr__(self, "terminal", frozen(positive_semidefinite(M, "terminal")))
            if tail or self.lead:
                raise ValueError("a schedule with a terminal weight ends after its steps; it has no tail and no lead")
        if self.lower_bound is not None:
            object.__setattr__(self, "lower_bound", number(self.lower_bound, "lower_bound"))
        if self.graph is None:
            object.__setattr__(self, "graph", SwitchingGraph(self.modes))
        elif self.graph.modes is not self.modes:
            raise ValueError("graph is of other modes; give the schedule that graph's .modes")
        lead = tuple(indices(self.modes, self.lead, "lead"))
        if not self.graph.free:
            last = int(self.graph.walk([*sequence.tolist(), *lead])[-1])
            if tail and not lasting(self.graph, tail)[last]:
                words = " ".join(self.modes.names[mode] for mode in tail)
                raise ValueError(f"the tail can't repeat {words!r} for ever under {self.graph.rules!r}")
        object.__setattr__(self, "sequence", frozen(sequence))
        object.__setattr__(self, "lead", lead)
        object.__setattr__(self, "statistics", numbers_by_name(self.statistics))
        object.__setattr__(self, "tail", tail)
        object.__setattr__(self, "lengthened", lengthened_holds(self.lengthened))
        if self.lower_bound is not None and self.lower_bound > self.cost * (1 + 1e-9):
            raise ValueError(f"the schedule's lower_bound {self.lower_bound} is above its cost {self.cost}")

    def __reduce__(self) -> tuple[Any, ...]:
        rest = (self.x0, self.sequence, self.tail, self.method, self.status, self.lengthened, self.lead)
        # A copy is checked and read-only too, and has the modes of its graph.
        last = dict(self.statistics), self.lower_bound, self.terminal, self.target
        return _rebuilt, (type(self), self.graph, rest, last)

    def __len__(self) -> int:
        return len(self.sequence)

    @cached_property
    def _run(self) -> tuple[Array, Array, Gaussian]:
        """W2 and stage cost of each step, and the Gaussian after the last."""
        F = moment_factor(self.x0.mean, self.x0.cov)
        w2, stage, final = predicted(self.modes, self._before, self.sequence, F, self.target)
        return frozen(w2), frozen(stage), final

    @property
    def time(self) -> Array:
        """Time of each step in seconds (or its number, where the modes carry no period), shape (N,)."""
        return np.arange(len(self), dtype=float) * self.modes.dk

    @property
    def w2(self) -> Array:
        """Squared Wasserstein distance of the plant's state to the origin, ``tr S_k``, or the target, shape (N,)."""
        return self._run[0]

    @property
    def _before(self) -> NDArray[np.intp]:
        """The mode before each step; -1 for none."""
        return np.concatenate([self.graph.last_mode[:1], self.sequence[:-1]])

    @cached_property
    def mean(self) -> Array:
        """Mean of the state, shape (n, N): time runs along the last axis, as in python-control."""
        steps = zip(self._before[:-1], self.sequence[:-1], strict=True)
        return frozen(trajectory(self.modes.A_after, steps, self.x0.mean[:, None])[:, :, 0].T)

    @cached_property
    def cov(self) -> Array:
        """Covariance of the state, shape (N, n, n)."""
        F = moment_factor(self.x0.mean, self.x0.cov)
        factors = list(factors_along(self.modes, self._before[:-1], self.sequence[:-1], F))
        roots = np.array(factors)[:, :, 1:]
        return frozen(roots @ np.swapaxes(roots, -1, -2))

    @property
    def final(self) -> Gaussian:
        """The state after the last step."""
        return self._run[2]

    @property
    def final_w2(self) -> float:
        """W2 after the last step."""
        if self.target is None:
            return float(np.sum(self.modes.distance * self.final.second_moment))
        F = moment_factor(self.final.mean, self.final.cov)
        return float(squared_distances(self.modes, F[None], self.target)[0])

    @cached_property
    @np.errstate(over="ignore", invalid="ignore")
    def _parts(self) -> tuple[CostParts, CostParts]:
        """The cost of the steps and of what follows them."""
        graph, modes, (w2, stage, final), before = self.graph, self.modes, self._run, self._before
        weight = modes.discount ** np.arange(len(self))
        switching = graph.switch_cost[before, self.sequence] + graph.switch_cost_per_w2[before, self.sequence] * w2
        paid = stage if self.target is not None else stage + modes.offset[self.sequence]
        each = modes.dk * paid, switching, modes.dk * graph.price[self.sequence]
        steps, last = CostParts(*(float(weight @ part) for part in each)), modes.discount ** len(self)
        if not np.isfinite(steps).all():
            raise FloatingPointError("the cost exceeds the floating-point range; scale the weights")
        if self.target is not None:
            return steps, CostParts(float(last * modes.dk * self.final_w2), 0.0, 0.0)
        if self.terminal is not None:
            return steps, CostParts(float(last * modes.dk * np.sum(self.terminal * final.second_moment)), 0.0, 0.0)
        require_criterion(modes)
        tail = tail_parts(graph, int(self.sequence[-1]), self.lead, self.tail, final.second_moment)
        return (CostParts(0, 0, 0), tail) if modes.cost == "average" else (steps, CostParts(*(last * x for x in tail)))

    @property
    def tail_cost(self) -> float:
        """Cost of what follows the last step; infinite where the tail is not Schur, or pays a price for ever.

        Of a run that ends there, ``dk * tr(M S_N)``.
        """
        return float(sum(self._parts[1]))

    @property
    def cost_parts(self) -> CostParts:
        """What the state, switches and the running price cost to the end of time; their sum is `cost`."""
        return CostParts(*(float(a + b) for a, b in zip(*self._parts, strict=True)))

    @cached_property
    def cost(self) -> float:
        """``dk * sum_k tr(Q S_k)`` to the end of time, with switches and prices (see Notes for the convention)."""
        with np.errstate(over="ignore", invalid="ignore"):
            steps, after = self._parts
            cost = float(sum(self.cost_parts))
        if np.isnan(cost) or not np.isfinite(steps).all() or (np.isinf(cost) and np.isfinite(after).all()):
            raise FloatingPointError("the cost exceeds the floating-point range; scale the state or the weights")
        return cost

    @property
    def gap(self) -> float | None:
        """How far the cost may be above the optimum, ``1 - lower_bound / cost``; None where nothing is proven."""
        if self.lower_bound is None:
            return None
        return max(0.0, 1 - self.lower_bound / self.cost) if self.cost > 0 else 0.0

    @property
    def resource_use(self) -> Array | None:
        """What each step uses of the budget, shape (N,); None where the rules have no budget."""
        use = self.graph.resource_use
        return None if use is None else use[self.sequence]

    def area(self, start: int = 0, stop: int | None = None) -> float:
        """Area under W2 over a range of steps: ``dk * sum_{k=start}^{stop-1} W2(k)``, the paper's finite sum.

        Parameters
        ----------
        start, stop : int, optional
            The steps, half-open as in Python; the whole schedule by default.

        Returns
        -------
        float

        Raises
        ------
        ValueError
            If there are no such steps.
        """
        stop = len(self) if stop is None else whole_number(stop, "stop", 0)
        start = whole_number(start, "start", 0)
        if not start <= stop <= len(self):
            raise ValueError(f"start = {start}, stop = {stop}; expected 0 <= start <= stop <= {len(self)}")
        return float(self.modes.dk * self.w2[start:stop].sum())

    @cached_property
    def switches(self) -> tuple[Switch, ...]:
        """Every change of mode, also from the rules' start: its step, the mode before and the mode after."""
        return switches_of(self.sequence, self.graph.start_mode)

    @property
    def dwell_times(self) -> NDArray[np.intp]:
        """Lengths in steps of the runs of one mode, first to last (the last is cut by the schedule's end)."""
        return np.diff([*self.run_starts, len(self)]).astype(np.intp)

    @property
    def run_starts(self) -> NDArray[np.intp]:
        """The steps at which the runs of one mode begin, the first of them 0."""
        return np.concatenate([[0], np.flatnonzero(np.diff(self.sequence)) + 1])

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the schedule as a table with one row a step: k, time, index, name, w2. Needs pandas.

        Returns
        -------
        pandas.DataFrame
            Indexed by k.
        """
        import pandas

        names = [self.modes.names[mode] for mode in self.sequence]
        columns = {"time": self.time, "index": self.sequence, "name": names, "w2": self.w2}
        return pandas.DataFrame(columns, index=pandas.RangeIndex(len(self), name="k"))

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write one row a step: k, time, index, name, w2.

        Parameters
        ----------
        path : path-like
            The file to write.

        Returns
        -------
        pathlib.Path
        """
        text = io.StringIO()
        writer = csv.writer(text)
        writer.writerow(["k", "time", "index", "name", "w2"])
        rows = zip(self.time.tolist(), self.sequence.tolist(), self.w2.tolist(), strict=True)
        writer.writerows([k, t, mode, self.modes.names[mode], w2] for k, (t, mode, w2) in enumerate(rows))
        return write_text(path, text.getvalue())

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the schedule, with its modes and initial state, as versioned JSON.

        Parameters
        ----------
        path : path-like
            The file to write.

        Returns
        -------
        pathlib.Path
        """
        return write_document(path, "schedule", VERSION, plain_schedule(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a schedule that `save` wrote.

        Parameters
        ----------
        path : path-like
            The file to read.

        Returns
        -------
        Schedule

        Raises
        ------
        FormatError
            If the file is not a schedule of this version, was changed after it was written, or contradicts itself.
        """
        document = read_sealed(path, "schedule", VERSION)
        try:
            schedule = cls(*read_schedule(document))
            stored = document["cost"]
            if stored is not None and not np.isclose(schedule.cost, number(stored, "cost"), rtol=1e-6, atol=0):
                raise ValueError(f"it states the cost {stored}, its sequence costs {schedule.cost}")
        except (LookupError, TypeError, ValueError, ArithmeticError, RecursionError) as error:
            raise FormatError(f"{path} is a damaged schedule: {error}") from None
        return schedule

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw W2 with the active mode under it; see `switchctl.plotting.plot_w2` for the keywords.

        Parameters
        ----------
        **keywords : stop, ax, title, legend_loc
            As for `plot_w2`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_w2

        return plot_w2(self, **keywords)

    _heading, _facts = heading, facts


def _rebuilt(kind: Callable[..., Schedule], graph: SwitchingGraph, rest: Any, last: Any) -> Schedule:
    return kind(graph.modes, *rest, graph, *last)
