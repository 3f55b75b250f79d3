"""Several methods side by side, with every single mode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods import Constant, Method, single_mode_costs
from switchctl.methods.boundary import initial_state, require_method
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet
from switchctl.moments import Array, constant_w2
from switchctl.result import Schedule
from switchctl.rules import Rules
from switchctl.scheduling import schedule
from switchctl.tables import html_table, text_table
from switchctl.validation import SETTINGS, listed, shown

if TYPE_CHECKING:
    from control import ControlPlot

_HEADER = ["", "spectral radius", "cost", "of best single", "peak W2", "switches"]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Schedules of several methods beside every single mode. `compare` makes one.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    schedules : dict of Schedule
        By label.
    status : str
        "done", or "interrupted" by Ctrl-C.

    Raises
    ------
    TypeError, ValueError
        If something is of the wrong kind, there is no schedule, or one is of other modes.
    """

    modes: ModeSet
    x0: Gaussian
    schedules: dict[str, Schedule]
    status: str = "done"

    def __post_init__(self) -> None:
        initial_state(self.modes, self.x0)
        if not isinstance(self.schedules, Mapping) or not self.schedules:
            raise TypeError(f"schedules must be a dict of at least one schedule, not {shown(self.schedules)}")
        for label, result in self.schedules.items():
            if not isinstance(label, str) or not isinstance(result, Schedule):
                raise TypeError(f"schedules[{label!r}] is {shown(result)}; expected a Schedule under a text")
            if result.modes is not self.modes:
                raise ValueError(f"schedules[{label!r}] is of other modes; compare schedules of the same")
        object.__setattr__(self, "schedules", dict(self.schedules))

    @property
    def steps(self) -> int:
        """The steps of the longest schedule."""
        return max(map(len, self.schedules.values()))

    @property
    def single_costs(self) -> Array:
        """Cost of each mode held for ever, shape (m,); under the rules, where all schedules have the same."""
        return single_mode_costs(self._graph, self.x0)

    @cached_property
    def _graph(self) -> SwitchingGraph:
        """The rules of all schedules, or none where they differ."""
        first, *others = (schedule.graph for schedule in self.schedules.values())
        return SwitchingGraph(self.modes) if any(graph is not first for graph in others) else first

    @property
    def single_w2(self) -> Array:
        """W2 of each mode held from the start, shape (m, steps)."""
        modes, x0 = self.modes, self.x0
        if modes.noisy:
            return np.array([Schedule(modes, x0, [i] * self.steps).w2 for i in range(len(modes))])
        return constant_w2(modes.A, x0.second_moment, self.steps, modes.plant_states)

    def rows(self) -> list[dict[str, Any]]:
        """Return one record for each single mode and each schedule.

        Returns
        -------
        list of dict
            With label, spectral radius (None for a schedule), cost, ratio (to the best single mode; None where no
            mode is Schur), peak (greatest W2) and switches.
        """
        costs = self.single_costs
        best = costs.min() if np.isfinite(costs).any() else None
        alone = [self._alone(mode, w2, bool(np.isfinite(costs[mode]))) for mode, w2 in enumerate(self.single_w2)]
        singles = zip(self.modes.names, self.modes.spectral_radii, costs, alone, strict=True)
        entries: list[tuple[Any, ...]] = [(name, float(radius), cost, *found) for name, radius, cost, found in singles]
        entries += [(label, None, s.cost, s.w2.max(), len(s.switches)) for label, s in self.schedules.items()]
        return [
            {
                "label": label,
                "spectral radius": radius,
                "cost": float(cost),
                "ratio": float(cost / best) if best else None,
                "peak": float(peak),
                "switches": switches,
            }
            for label, radius, cost, peak, switches in entries
        ]

    def _alone(self, mode: int, w2: Array, allowed: bool) -> tuple[float, int]:
        """Peak W2 and switches of a single mode, under the rules where they allow it."""
        graph = self._graph
        if graph.free or not allowed:
            return float(w2.max()), 0
        result = schedule(self.modes, self.x0, Constant(mode), self.steps, graph)
        return float(result.w2.max()), len(result.switches)

    def _heading(self) -> list[str]:
        proven = any(schedule.lower_bound is not None for schedule in self.schedules.values())
        return [*_HEADER, "gap"] if proven else _HEADER

    def _cells(self) -> list[list[str]]:
        gaps = {label: f"{s.gap:.1e}" for label, s in self.schedules.items() if s.gap is not None}
        return [
            [
                row["label"],
                "" if row["spectral radius"] is None else f"{row['spectral radius']:.6g}",
                f"{row['cost']:.6g}",
                "" if row["ratio"] is None or not np.isfinite(row["ratio"]) else f"{100 * row['ratio']:.2f} %",
                f"{row['peak']:.6g}",
                str(row["switches"]),
                *([gaps.get(row["label"], "")] if gaps else []),
            ]
            for row in self.rows()
        ]

    def __repr__(self) -> str:
        return text_table(self._heading(), self._cells()) + f"\n{self.status}" * (self.status != "done")

    def _repr_html_(self) -> str:
        return html_table(self._heading(), self._cells(), f"Comparison over {self.steps} steps and the tail after them")

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw W2 of every single mode and of the schedules; see `switchctl.plotting.plot_w2` for the keywords.

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

    def plot_area(self, **keywords: Any) -> "ControlPlot":
        """Draw the costs as bars; see `switchctl.plotting.plot_area` for the keywords.

        Parameters
        ----------
        **keywords : ax, title, legend_loc
            As for `plot_area`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_area

        return plot_area(self, **keywords)


def compare(
    modes: ModeSet,
    x0: Gaussian,
    methods: Method | Sequence[Method] | Mapping[str, Method],
    steps: int | None = None,
    rules: Rules | SwitchingGraph | None = None,
) -> Comparison:
    """Run several methods on the same modes and initial state, beside every single mode.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    methods : Method, sequence of Method, or dict
        What to run; a dict labels them, otherwise they are labelled by their settings.
    steps : int, optional
        As for `schedule`.
    rules : Rules or SwitchingGraph, optional
        As for `schedule`; the same for all, and for the single modes.

    Returns
    -------
    Comparison
        Interrupted by Ctrl-C, with the schedules so far and marked so; one that is cut short is labelled so.

    Raises
    ------
    TypeError, ValueError
        As `schedule` does; ValueError if there is no method or a label is also the name of a mode.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> compare(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), {"T = 20": RecedingHorizon(20), "rollout": Rollout()})
             spectral radius     cost  of best single  peak W2  switches
    -------  ---------------  -------  --------------  -------  --------
    fast                 0.8   104.93        527.41 %  20.8309         0
    calm                0.97  19.8952        100.00 %     2.02         0
    T = 20                    16.2132         81.49 %     2.02         1
    rollout                   14.4423         72.59 %     2.02         1
    """
    if isinstance(methods, Method):
        methods = [methods]
    if not isinstance(methods, Mapping):
        methods = listed(methods, "methods", "methods", SETTINGS)
    for method in methods.values() if isinstance(methods, Mapping) else methods:
        require_method(method)
    pairs = methods.items() if isinstance(methods, Mapping) else [(repr(method), method) for method in methods]
    labelled = dict(pairs)
    if not labelled:
        raise ValueError("methods is empty; give at least one method")
    if len(labelled) < len(pairs):
        labels = [label for label, _ in pairs]
        twice = next(label for label in labelled if labels.count(label) > 1)
        raise ValueError(f"methods holds two that read {twice}; give a dict with a label for each")
    x0 = initial_state(modes, x0)
    for label in labelled:
        if not isinstance(label, str):
            raise TypeError(f"methods is labelled with {label!r}; labels are strings")
        if label in modes.names:
            raise ValueError(f"methods labels one {label!r}, which is the name of a mode; choose another label")
    graph = graph_under(modes, rules)
    schedules: dict[str, Schedule] = {}
    try:
        for label, method in labelled.items():
            result = schedule(modes, x0, method, steps, graph)
            interrupted = result.status == INTERRUPTED
            schedules[f"{label} ({INTERRUPTED})" if interrupted else label] = result
            if interrupted:
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        if not schedules:
            raise
        return Comparison(modes, x0, schedules, INTERRUPTED)
    return Comparison(modes, x0, schedules)
