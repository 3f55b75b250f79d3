"""What a switching rule costs: one rule, several settings."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from tqdm import tqdm

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph
from switchctl.limits import TooManyNodes
from switchctl.methods import Method, Refine
from switchctl.methods.base import InfiniteCostError
from switchctl.methods.boundary import initial_state, require_method
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet
from switchctl.result import Schedule
from switchctl.rules import ContradictionError, Rules
from switchctl.scheduling import schedule
from switchctl.tables import html_table, text_table
from switchctl.validation import SETTINGS, listed, number, shown, whole_number

if TYPE_CHECKING:
    from control import ControlPlot

Over = Literal["switch_cost", "min_dwell", "budget"]

_SHARES = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # switch costs, of the cost without
_DWELLS = (1, 2, 5, 10, 20, 50, 100)  # steps
_FACTORS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)  # of the budget's limit


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Schedules under one rule in several settings. `trade_off` makes one.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    rules : Rules
        The other rules.
    over : str
        The rule.
    values : tuple of float
        Its settings: a cost, a time in the unit of the rules, or a limit.
    schedules : tuple of Schedule or None
        One a setting; None where no run obeys, none of finite cost was found, or the switching graph would have too
        many nodes.
    status : str
        "done", or "interrupted" by Ctrl-C.
    """

    modes: ModeSet
    x0: Gaussian
    rules: Rules
    over: Over
    values: tuple[float, ...]
    schedules: tuple[Schedule | None, ...]
    status: str = "done"

    def rows(self) -> list[dict[str, Any]]:
        """Return one record for each setting.

        Returns
        -------
        list of dict
            With value, cost, state (its part without switches and prices), switches (in the whole run, which may be
            inf), dwell (shortest of the run, in steps) and use (of the budget in the whole run, None without one);
            None for all but value where there is no schedule.
        """
        return [{"value": value, **_record(result)} for value, result in zip(self.values, self.schedules, strict=True)]

    def _table(self) -> tuple[list[str], list[list[str]]]:
        """Header and cells; columns that hold nothing are left out."""
        told = {"value": self.over.replace("_", " "), "state": "of which state", "dwell": "shortest dwell"}
        rows = self.rows()
        keys = [key for key in rows[0] if key == "value" or any(row[key] is not None for row in rows)]
        cells = [["-" if row[key] is None else f"{row[key]:.6g}" for key in keys] for row in rows]
        return [told.get(key, key) for key in keys], cells

    def __repr__(self) -> str:
        return text_table(*self._table()) + f"\n{self.status}" * (self.status != "done")

    def _repr_html_(self) -> str:
        return html_table(*self._table(), f"What {self.over} costs")

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw the cost of the state against switches, dwell or use; see `switchctl.plotting.plot_trade_off`.

        Parameters
        ----------
        **keywords : ax, title, legend_loc
            As for `plot_trade_off`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_trade_off

        return plot_trade_off(self, **keywords)


def _record(result: Schedule | None) -> dict[str, Any]:
    if result is None:
        return dict.fromkeys(("cost", "state", "switches", "dwell", "use"))
    run = np.array([*result.sequence, *result.lead, *result.tail, *result.tail])
    changes = np.flatnonzero(np.diff(run)) + 1
    new = result.graph.start_mode != result.sequence[0]  # whether the first dwell begins with the run
    dwells = np.diff([0, *changes] if new else changes)
    for_ever = len(set(result.tail)) > 1
    use, tail = result.graph.resource_use, np.array(result.tail)
    return {
        "cost": result.cost,
        "state": result.cost_parts.state,
        "switches": np.inf if for_ever else len(changes) + int(new and result.graph.start_mode >= 0),
        "dwell": int(dwells.min()) if len(dwells) else np.inf,
        "use": None if use is None else np.inf if use[tail].any() else float(use[run].sum()),
    }


def trade_off(
    modes: ModeSet,
    x0: Gaussian,
    rules: Rules | None = None,
    over: Over = "switch_cost",
    values: Iterable[float] | None = None,
    method: Method | None = None,
) -> TradeOff:
    """Schedule under one rule in several settings, the other rules being as given.

    Each schedule found is also tried under every other setting that allows it, and the cheapest kept: so the cost
    never falls when the rule is tightened, although a method may not find the optimum.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    rules : Rules, optional
        The rules, of which one is varied; over a budget they must have one.
    over : {"switch_cost", "min_dwell", "budget"}, optional
        The rule: the cost of every switch, the least dwell time of every mode, or the limit of the budget.
    values : sequence of float, optional
        Its settings. By default switch costs up to a tenth of the cost without, dwells of 1 to 100 steps, and up to
        four times the budget's limit.
    method : Method, optional
        How to schedule; `Refine` by default.

    Returns
    -------
    TradeOff
        Interrupted by Ctrl-C, with the settings so far, and marked so.

    Raises
    ------
    TypeError, ValueError
        As `Rules` and `schedule` do; ValueError if there is no setting, or no budget to vary. A setting under which no
        run is possible, or whose switching graph would have too many nodes, is no error.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> trade_off(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), over="min_dwell", values=[1, 20, 40])
    min dwell     cost  of which state  switches  shortest dwell
    ---------  -------  --------------  --------  --------------
    1          14.4423         14.4423         1              12
    20         15.8208         15.8208         1              20
    40          18.647          18.647         1              40
    """
    x0 = initial_state(modes, x0)
    if rules is not None and not isinstance(rules, Rules):
        raise TypeError(f"rules must be Rules(..), of which one is varied, not a {type(rules).__name__}")
    rules, method = Rules() if rules is None else rules, Refine() if method is None else method
    require_method(method)
    told = _values(modes, x0, rules, over, values, method)
    found: list[Schedule | None] = []
    best, status = None, INTERRUPTED
    try:
        for value in tqdm(told, desc="trade-off", unit="schedule", delay=2, leave=False):
            found.append(_attempt(modes, x0, method, rules, over, value))
            if found[-1] is not None and found[-1].status == INTERRUPTED:
                raise KeyboardInterrupt
        best, status = [_cheapest(own, found) for own in found], "done"
    except KeyboardInterrupt:
        if not found:
            raise
    return TradeOff(modes, x0, rules, over, tuple(told[: len(found)]), tuple(best or found), status)


def _values(
    modes: ModeSet, x0: Gaussian, rules: Rules, over: str, values: Iterable[float] | None, method: Method
) -> list[float]:
    if not isinstance(over, str) or over not in ("switch_cost", "min_dwell", "budget"):
        raise ValueError(f"over is {shown(over)}; expected 'switch_cost', 'min_dwell' or 'budget'")
    if over == "budget" and rules.budget is None:
        raise ValueError("over is 'budget', but the rules have none; give Rules(budget=Budget(..)) to vary its limit")
    if values is not None:
        told = [number(value, f"values[{k}]") for k, value in enumerate(listed(values, "values", "settings", SETTINGS))]
        if not told:
            raise ValueError("values is empty; give at least one setting")
        if over == "min_dwell" and rules.time_unit == "step":
            return [whole_number(value, f"values[{k}]") for k, value in enumerate(told)]
        return told
    if over == "switch_cost":
        free = schedule(modes, x0, method, rules=replace(rules, switch_cost=0.0))
        if free.status == INTERRUPTED:
            raise KeyboardInterrupt
        return [float(f"{share * free.cost:.2g}") for share in _SHARES]
    if over == "min_dwell":
        return [steps if rules.time_unit == "step" else steps * modes.dk for steps in _DWELLS]
    assert rules.budget is not None
    return [factor * rules.budget.limit for factor in _FACTORS]


def _attempt(modes: ModeSet, x0: Gaussian, method: Method, rules: Rules, over: str, value: float) -> Schedule | None:
    """The schedule under one setting; None where no run obeys."""
    try:
        change: Any = replace(rules.budget, limit=value) if over == "budget" and rules.budget else value
        graph = SwitchingGraph(modes, replace(rules, **{over: change}))
    except (ContradictionError, TooManyNodes):
        return None
    try:
        return schedule(modes, x0, method, rules=graph)
    except InfiniteCostError:
        return None


def _cheapest(own: Schedule | None, found: list[Schedule | None]) -> Schedule | None:
    """The cheapest of all schedules found that the rules of one allow."""
    if own is None:
        return None
    best = own
    for other in found:
        if other is None or other is own:
            continue
        try:
            tried = replace(own, sequence=other.sequence, lead=other.lead, tail=other.tail, lengthened=())
        except ValueError:  # against the rules
            continue
        if tried.cost < best.cost:
            best = tried
    return best
