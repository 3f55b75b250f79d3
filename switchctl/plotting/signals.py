"""Pictures over time: W2, the switching signal, the reason to switch."""

from itertools import cycle
from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from switchctl.comparison import Comparison
from switchctl.moments import Array, constant_w2
from switchctl.plotting.style import (
    SCHEDULE_DASHES,
    Legend,
    finish,
    legend_place,
    mode_style,
    one_axes,
    plain,
    positive,
    require,
    split_axes,
    steps_shown,
    time_label,
    wrapped,
)
from switchctl.result import Schedule


def plot_w2(
    data: Schedule | Comparison,
    *,
    stop: int | None = None,
    ax: Any = None,
    title: str | None = None,
    legend_loc: Legend = None,
) -> ControlPlot:
    """Draw W2 of every single mode and of the schedules, the active mode under it (figure a of the paper).

    Parameters
    ----------
    data : Schedule or Comparison
        What to draw.
    stop : int, optional
        Steps to show; by default until W2 of every schedule has fallen to 1e-4 of its start.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default. The lower part becomes the band of the active mode.
    title : str, optional
        Title (over the legend, where that is above the axes); none by default.
    legend_loc : str or False, optional
        Place of the legend, or False for none; above the axes by default.

    Returns
    -------
    control.ControlPlot
        Its axes are W2 and, below it, the active mode.

    Examples
    --------
    >>> from switchctl.plotting import plot_w2
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_w2(schedule(modes, x0, Rollout())).axes.shape
    (2, 1)
    """
    require(data, (Schedule, Comparison), "plot_w2")
    schedules = data.schedules if isinstance(data, Comparison) else {data.method or "schedule": data}
    modes = data.modes
    stop = steps_shown([schedule.w2 for schedule in schedules.values()], stop)
    one = len(schedules) == 1
    rows = len(modes) if one else sum(wrapped(s).count("\n") + 1 for s in schedules)
    ax, band = split_axes(one_axes(ax, title, legend_loc, (6.4, 3.8 + 0.16 * rows)), rows)
    t = np.arange(stop) * modes.dk
    single = _single_w2(next(iter(schedules.values())), stop)
    lines = [
        ax.semilogy(t, positive(w2), lw=1.4, label=plain(name), **mode_style(i))[0]
        for i, (name, w2) in enumerate(zip(modes.names, single, strict=True))
    ]
    for dash, (label, schedule) in zip(cycle(SCHEDULE_DASHES), schedules.items(), strict=False):
        w2 = positive(schedule.w2[:stop])
        lines += ax.semilogy(t[: len(w2)], w2, color="black", lw=2.2, linestyle=dash, label=plain(label), zorder=3)
    drawn = positive(np.concatenate([schedule.w2[:stop] for schedule in schedules.values()]))
    if np.isfinite(drawn).any():  # an unstable mode may leave the picture
        bottom, top = ax.get_ylim()
        ax.set_ylim(max(bottom, np.nanmin(drawn) / 100), min(top, np.nanmax(drawn) * 1e3))
    ax.set_ylabel(r"$W^2$ (state units$^2$)")
    ax.tick_params(labelbottom=False)
    ax.grid(True, which="major", alpha=0.3)
    if one:
        _draw_signal(band, next(iter(schedules.values())), stop)
    else:
        _draw_strips(band, schedules, stop)
    band.set_xlabel(time_label(modes))
    plot = finish(ax, lines, title or "", legend_place(legend_loc, "above"))
    plot.axes = np.array([[ax], [band]])
    return plot


def plot_switching(
    schedule: Schedule,
    *,
    stop: int | None = None,
    ax: Any = None,
    title: str | None = None,
    legend_loc: Legend = None,
) -> ControlPlot:
    """Draw the switching signal alone: one row a mode, filled while it is active.

    Parameters
    ----------
    schedule : Schedule
        What to draw.
    stop : int, optional
        Steps to show; by default until W2 has fallen to 1e-4 of its start.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; the method by default.
    legend_loc : str or False, optional
        Place of a legend; none by default, since every row is named.

    Returns
    -------
    control.ControlPlot

    Examples
    --------
    >>> from switchctl.plotting import plot_switching
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_switching(schedule(modes, x0, Rollout())).axes.shape
    (1, 1)
    """
    require(schedule, Schedule, "plot_switching")
    stop = steps_shown([schedule.w2], stop)
    ax = one_axes(ax, title, legend_loc, (6.4, 0.9 + 0.32 * len(schedule.modes)))
    _draw_signal(ax, schedule, stop)
    ax.set_xlabel(time_label(schedule.modes))
    ax.set_ylabel("mode")
    handles = [Patch(color=mode_style(i)["color"], label=plain(name)) for i, name in enumerate(schedule.modes.names)]
    return finish(ax, handles, schedule.method if title is None else title, legend_loc or False)


def plot_schematic(
    schedule: Schedule,
    *,
    stop: int | None = None,
    ax: Any = None,
    title: str | None = None,
    legend_loc: Legend = None,
) -> ControlPlot:
    """Draw why to switch, the paper's schematic, with the true curves of a schedule that switches once or more.

    The W2 of the mode before the first switch and of the mode after it, each held from the start, and the schedule,
    which takes first the one and then the other.

    Parameters
    ----------
    schedule : Schedule
        With at least one switch.
    stop : int, optional
        Steps to show; by default four times those before the first switch.
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
        If the schedule never switches.

    Examples
    --------
    >>> from switchctl.plotting import plot_schematic
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_schematic(schedule(modes, x0, FewSwitches(1))).axes.shape
    (1, 1)
    """
    require(schedule, Schedule, "plot_schematic")
    switches = [switch for switch in schedule.switches if switch.step > 0]
    if not switches:
        raise ValueError("the schedule never switches, so there is nothing to show; give one with a switch")
    modes, first = schedule.modes, switches[0]
    stop = min(4 * first.step + 2, len(schedule)) if stop is None else steps_shown([schedule.w2], stop)
    ax = one_axes(ax, title, legend_loc)
    t = np.arange(stop) * modes.dk
    single = _single_w2(schedule, stop)
    lines = [
        ax.plot(t, single[i], lw=1.4, label=f"{plain(modes.names[i])} alone", **mode_style(i))[0]
        for i in (first.after, first.before)
    ]
    w2 = schedule.w2[:stop]
    lines += ax.plot(t, w2, color="black", lw=2.4, label="switched", zorder=3)
    for k in np.unique(np.linspace(0, max(stop - 2, 0), 7).astype(int)[1:-1] if stop > 2 else []).astype(int):
        arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2.4, "mutation_scale": 16}
        ax.annotate("", (t[k + 1], w2[k + 1]), (t[k], w2[k]), arrowprops=arrow)
    switch = first.step * modes.dk
    ax.axvline(switch, color="black", lw=0.8, ls=":")
    ax.annotate("$t_k$", (switch, 0), (4, 4), xycoords=("data", "axes fraction"), textcoords="offset points")
    ax.set_xlabel(time_label(modes))
    ax.set_ylabel(r"$W^2$ (state units$^2$)")
    ax.set_ylim(bottom=0)
    ax.spines[["top", "right"]].set_visible(False)
    return finish(ax, lines, title or "", legend_place(legend_loc, "best"))


def _draw_signal(ax: Axes, schedule: Schedule, stop: int) -> None:
    """One row a mode, filled while the mode is active."""
    dk = schedule.modes.dk
    starts = schedule.run_starts
    starts, lengths = starts[starts < stop], schedule.dwell_times[: np.count_nonzero(starts < stop)]
    lengths = np.minimum(starts + lengths, stop) - starts
    for i, name in enumerate(schedule.modes.names):
        runs = [(dk * a, dk * b) for a, b in zip(starts, lengths, strict=True) if schedule.sequence[a] == i]
        ax.broken_barh(runs, (i - 0.4, 0.8), color=mode_style(i)["color"], label=plain(name))
    ax.set_yticks(range(len(schedule.modes)), [plain(name) for name in schedule.modes.names], fontsize="small")
    ax.set_ylim(len(schedule.modes) - 0.5, -0.5)
    ax.set_xlim(0, stop * dk)
    ax.grid(True, axis="x", alpha=0.3)
    ax.set_axisbelow(True)


def _draw_strips(ax: Axes, schedules: dict[str, Schedule], stop: int) -> None:
    """One row a schedule, coloured by the active mode."""
    for place, schedule in enumerate(schedules.values()):
        dk, starts = schedule.modes.dk, schedule.run_starts
        runs = [(dk * a, dk * b) for a, b in zip(starts, schedule.dwell_times, strict=True)]
        ax.broken_barh(runs, (place - 0.4, 0.8), color=[mode_style(schedule.sequence[a])["color"] for a in starts])
    ax.set_yticks(range(len(schedules)), [wrapped(label) for label in schedules], fontsize="x-small")
    ax.set_ylim(len(schedules) - 0.5, -0.5)
    ax.set_xlim(0, stop * dk)


def _single_w2(schedule: Schedule, stop: int) -> Array:
    """W2 of each mode held from the start, where the schedule's own rules are left aside."""
    modes, x0 = schedule.modes, schedule.x0
    if schedule.target is None and not modes.noisy:
        return constant_w2(modes.A, x0.second_moment, stop, modes.plant_states)
    return np.array([Schedule(modes, x0, [i] * stop, target=schedule.target).w2 for i in range(len(modes))])
