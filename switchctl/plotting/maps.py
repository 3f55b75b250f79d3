"""Pictures without a time axis: areas, ellipses in the phase plane, a sweep as a heat map, a trade-off."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.colors import TwoSlopeNorm
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import MaxNLocator

from switchctl.comparison import Comparison
from switchctl.methods import single_mode_costs
from switchctl.modes import ModeSet
from switchctl.plotting.style import (
    COLOURS,
    Legend,
    finish,
    legend_place,
    mode_style,
    one_axes,
    plain,
    require,
    steps_shown,
    wrapped,
)
from switchctl.result import Schedule
from switchctl.sweeping import Sweep
from switchctl.trade_offs import TradeOff
from switchctl.validation import number

_ELLIPSES = 16


def plot_area(
    comparison: Comparison, *, ax: Any = None, title: str | None = None, legend_loc: Legend = None
) -> ControlPlot:
    """Draw the cost of every single mode and of the schedules as bars (figure b of the paper).

    A cost that is not finite (a mode or a tail that is not Schur) has no bar, and is marked so.

    Parameters
    ----------
    comparison : Comparison
        What to draw.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; none by default.
    legend_loc : str or False, optional
        Place of a legend; none by default, since every bar is named.

    Returns
    -------
    control.ControlPlot

    Examples
    --------
    >>> from switchctl.plotting import plot_area
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_area(compare(modes, x0, [Rollout()])).axes.shape
    (1, 1)
    """
    require(comparison, Comparison, "plot_area")
    ax = one_axes(ax, title, legend_loc)
    rows = comparison.rows()
    finite = [row["cost"] for row in rows if np.isfinite(row["cost"])]
    top = max(finite, default=0.0) or 1.0
    m = len(comparison.modes)
    bars = []
    for place, row in enumerate(rows):
        colour = COLOURS[place % len(COLOURS)] if place < m else "black"
        drawn = row["cost"] if np.isfinite(row["cost"]) else 0.0
        bars += ax.barh(place, drawn, color=colour, height=0.7, label=plain(row["label"]))
        told = f"{row['cost']:.4g}" if np.isfinite(row["cost"]) else "infinite"
        ax.text(drawn + 0.01 * top, place, told, va="center", fontsize="small")
    ax.set_yticks(range(len(rows)), [wrapped(row["label"]) for row in rows])
    ax.invert_yaxis()
    ax.set_xlim(0, 1.15 * top)
    parts = [schedule.cost_parts for schedule in comparison.schedules.values()]
    area = (comparison.modes.Q == comparison.modes.distance).all()
    area = area and not any(part.switching or part.running for part in parts)
    ax.set_xlabel(f"total {'area of $W^2$' if area else 'cost'} ({_cost_unit(comparison.modes)})")
    ax.spines[["top", "right"]].set_visible(False)
    return finish(ax, bars, title or "", legend_loc or False)


def plot_ellipses(
    schedule: Schedule,
    *,
    states: tuple[int | str, int | str] = (0, 1),
    probability: float = 0.95,
    stop: int | None = None,
    ax: Any = None,
    title: str | None = None,
    legend_loc: Legend = None,
) -> ControlPlot:
    """Draw covariance ellipses marching to the origin in the plane of two states, coloured by the active mode.

    Parameters
    ----------
    schedule : Schedule
        What to draw.
    states : pair of int or str, optional
        The two states, by index or name.
    probability : float, optional
        Probability that the state is inside an ellipse.
    stop : int, optional
        Steps to show; by default until W2 has fallen to 1e-4 of its start. At most 16 ellipses are drawn, evenly spaced
        in the distance that the state goes.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; the method by default.
    legend_loc : str or False, optional
        Place of the legend, or False for none.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    ValueError
        If there are not two different states of the modes, or the probability is not between 0 and 1.

    Examples
    --------
    >>> from switchctl.plotting import plot_ellipses
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_ellipses(schedule(modes, x0, Rollout())).axes.shape
    (1, 1)
    """
    require(schedule, Schedule, "plot_ellipses")
    pair = _state_pair(schedule.modes, states)
    if not 0 < number(probability, "probability") < 1:
        raise ValueError(f"probability is {probability}; expected a number strictly between 0 and 1")
    stop = steps_shown([schedule.w2], stop)
    ax = one_axes(ax, title, legend_loc)
    mean, cov = schedule.mean[pair, :stop], schedule.cov[:stop][:, pair][:, :, pair]
    lines = ax.plot(*mean, color="black", lw=0.8, marker=".", ms=3, zorder=3, label="mean")
    eigenvalues, vectors = np.linalg.eigh(cov)
    radius = np.sqrt(-2 * np.log1p(-probability))
    angle = np.linspace(0, 2 * np.pi, 100)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)])
    outlines = mean.T[:, :, None] + (vectors * np.sqrt(np.maximum(eigenvalues, 0))[:, None, :]) @ circle
    # Evenly spaced in the distance that the state goes towards its target.
    distance = np.sqrt(np.sum(mean**2, axis=0) + np.trace(cov, axis1=1, axis2=2))
    travelled = np.abs(np.diff(distance, prepend=distance[0])).cumsum()
    for k in np.unique(np.searchsorted(travelled, np.linspace(0, travelled[-1], _ELLIPSES))):
        colour = mode_style(schedule.sequence[k])["color"]
        ax.add_patch(Polygon(outlines[k].T, facecolor=(colour, 0.12), edgecolor=colour, lw=1.1))
    ax.autoscale_view()
    ax.plot(0, 0, "+", color="black", ms=10)
    ax.set_xlabel(f"{plain(schedule.modes.states[pair[0]])} (state units)")
    ax.set_ylabel(f"{plain(schedule.modes.states[pair[1]])} (state units)")
    ax.grid(True, alpha=0.3)
    used = np.unique(schedule.sequence[:stop])
    handles = [Patch(color=mode_style(i)["color"], label=plain(schedule.modes.names[i])) for i in used]
    place = legend_place(legend_loc, "best")
    return finish(ax, [*lines, *handles], schedule.method if title is None else title, place)


def plot_sweep(sweep: Sweep, *, ax: Any = None, title: str | None = None, legend_loc: Legend = None) -> ControlPlot:
    """Draw the cost over horizons and holds as a heat map, in per cent of the best single mode.

    Parameters
    ----------
    sweep : Sweep
        What to draw.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; the best single mode and its cost by default.
    legend_loc : False, optional
        A heat map has no legend but its colour bar; False leaves that out.

    Returns
    -------
    control.ControlPlot

    Examples
    --------
    >>> from switchctl.plotting import plot_sweep
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_sweep(sweep(modes, x0, [1, 5], [1, 2])).axes.shape
    (1, 1)
    """
    require(sweep, Sweep, "plot_sweep")
    ax = one_axes(ax, title, legend_loc)
    percent = 100 * sweep.relative
    spread = max(float(np.nanmax(np.abs(percent[np.isfinite(percent)] - 100), initial=0.0)), 0.1)
    norm = TwoSlopeNorm(100, 100 - spread, 100 + spread)
    mesh = ax.pcolormesh(np.ma.masked_invalid(percent), cmap="PuOr_r", norm=norm, edgecolors="white", lw=1)
    for (row, column), value in np.ndenumerate(percent):
        dark = np.isfinite(value) and abs(value - 100) > 0.6 * spread
        told = f"{value:.1f}" if np.isfinite(value) else "-"
        ax.text(
            column + 0.5,
            row + 0.5,
            told,
            ha="center",
            va="center",
            fontsize="small",
            color="white" if dark else "black",
        )
    ax.set_xticks(np.arange(len(sweep.holds)) + 0.5, map(str, sweep.holds))
    ax.set_yticks(np.arange(len(sweep.horizons)) + 0.5, ["∞" if T == np.inf else str(T) for T in sweep.horizons])
    ax.tick_params(length=0)
    ax.set_xlabel("hold (steps)")
    ax.set_ylabel("horizon T (steps)")
    if legend_loc is not False:
        ax.figure.colorbar(mesh, ax=ax, label="cost (% of the best single mode)")
    default = f"100 % is {plain(sweep.best_single.name)} alone, {sweep.best_single_cost:.5g}"
    return finish(ax, [], default if title is None else title, False)


def plot_trade_off(
    trade_off: TradeOff, *, ax: Any = None, title: str | None = None, legend_loc: Legend = None
) -> ControlPlot:
    """Draw what a rule costs: the cost of the state against the number of switches, the dwell time or the use.

    Each point is a setting of the rule; switch costs and limits are written beside it.

    Parameters
    ----------
    trade_off : TradeOff
        What to draw.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; none by default.
    legend_loc : str or False, optional
        Place of the legend, or False for none.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    ValueError
        If no setting has a schedule of finite cost.

    Examples
    --------
    >>> from switchctl.plotting import plot_trade_off
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_trade_off(trade_off(modes, x0, over="min_dwell", values=[1, 2])).axes.shape
    (1, 1)
    """
    require(trade_off, TradeOff, "plot_trade_off")
    over, modes = trade_off.over, trade_off.modes
    rows = [row for row in trade_off.rows() if row["state"] is not None and np.isfinite(row["state"])]
    rows = [row for row in rows if over != "switch_cost" or np.isfinite(row["switches"])]
    if not rows:
        raise ValueError("no setting has a schedule of finite cost, so there is nothing to draw")
    x = [row["switches"] if over == "switch_cost" else row["value"] for row in rows]
    y = [row["state"] for row in rows]
    ax = one_axes(ax, title, legend_loc)
    lines = ax.plot(x, y, color="black", marker="o", lw=1.4, label="under the rule")
    single = single_mode_costs(modes, trade_off.x0)
    if np.isfinite(single).any():
        best = int(single.argmin())
        style = {"color": mode_style(best)["color"], "ls": "--", "lw": 1.2}
        lines.append(ax.axhline(single[best], label=f"{plain(modes.names[best])} alone, without rules", **style))
    if over == "switch_cost":
        at: dict[float, list[float]] = {}
        for row in rows:
            at.setdefault(row["switches"], []).append(row["value"])
        height = dict(zip(x, y, strict=True))
        for switches, values in at.items():
            told = f"{values[0]:.3g}" if len(values) == 1 else f"{values[0]:.3g} to {values[-1]:.3g}"
            style = {"textcoords": "offset points", "fontsize": "small", "rotation": 30}
            ax.annotate(told, (switches, height[switches]), (4, 6), **style)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    unit = "steps" if trade_off.rules.time_unit == "step" else "s"
    if over == "min_dwell" and min(x) > 0 and max(x) > 20 * min(x):
        ax.set_xscale("log")
        ax.set_xticks(x, [f"{value:g}" for value in x])
        ax.minorticks_off()
    labels = {
        "switch_cost": "switches (beside each point: the cost of one)",
        "min_dwell": f"least dwell time ({unit})",
        "budget": "limit of the budget (units of use)",
    }
    ax.set_xlabel(labels[over])
    ax.set_ylabel(f"cost of the state ({_cost_unit(modes)})")
    ax.grid(True, alpha=0.3)
    ax.margins(x=0.08, y=0.12)
    return finish(ax, lines, title or "", legend_place(legend_loc, "best"))


def _state_pair(modes: ModeSet, states: Sequence[int | str]) -> list[int]:
    n, given = len(modes.states), [] if isinstance(states, str) or not isinstance(states, Iterable) else list(states)
    pair = [modes.states.index(s) if isinstance(s, str) and s in modes.states else s for s in given]
    numbers = all(isinstance(s, int | np.integer) and not isinstance(s, bool) and 0 <= s < n for s in pair)
    if len(pair) != 2 or not numbers or pair[0] == pair[1]:
        raise ValueError(
            f"states is {states!r}; expected two different ones of {', '.join(modes.states)}, or their indices"
        )
    return [int(s) for s in pair]


def _cost_unit(modes: ModeSet) -> str:
    area = (modes.Q == modes.distance).all()
    return ("state units$^2$" if area else "weighted units") + ("" if modes.dt is True else " · s")
