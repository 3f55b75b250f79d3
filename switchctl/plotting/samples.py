"""Pictures of samples: the mean over many runs against the prediction."""

from itertools import cycle
from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from switchctl.moments import Array
from switchctl.plotting.style import (
    SCHEDULE_DASHES,
    Legend,
    finish,
    legend_place,
    one_axes,
    plain,
    positive,
    require,
    split_axes,
    steps_shown,
    time_label,
    wrapped,
)
from switchctl.simulation import MonteCarlo

# Greys: colours are those of modes, and schedules are black.
_BAND: dict[str, Any] = {"color": "0.82", "lw": 0}
_MEAN: dict[str, Any] = {"color": "0.45", "lw": 1.6}
_FILL = 0.42  # of the distance between strips, on either side


def plot_monte_carlo(
    result: MonteCarlo,
    *,
    stop: int | None = None,
    ax: Any = None,
    title: str | None = None,
    legend_loc: Legend = None,
) -> ControlPlot:
    """Draw the W2 that schedules predict with the mean over samples, and below how far the two are apart.

    Parameters
    ----------
    result : MonteCarlo
        What to draw.
    stop : int, optional
        Steps to show; by default until the W2 of every schedule has fallen to 1e-4 of its start.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default. The lower part becomes a strip for each schedule: the mean and its band
        relative to the prediction. Where runs have stopped before, the mean is of the others, and dotted.
    title : str, optional
        Title (over the legend, where that is above the axes); none by default.
    legend_loc : str or False, optional
        Place of the legend, or False for none; above the axes by default.

    Returns
    -------
    control.ControlPlot
        Its axes are W2 and, below it, the strips.

    Examples
    --------
    >>> from switchctl.plotting import plot_monte_carlo
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_monte_carlo(monte_carlo(schedule(modes, x0, Rollout()), 100)).axes.shape
    (2, 1)
    """
    require(result, MonteCarlo, "plot_monte_carlo")
    shown = steps_shown(list(result.predicted), stop)
    rows = 4 * len(result.labels)
    ax, strips = split_axes(one_axes(ax, title, legend_loc, (6.4, 3.6 + 0.16 * rows)), rows)
    t, (low, high) = result.time[:shown], result.band
    whole = result.counted == result.samples
    lines = []
    for i, (label, dash) in enumerate(zip(result.labels, cycle(SCHEDULE_DASHES), strict=False)):
        curves = [positive(values[i, :shown]) for values in (result.predicted, result.mean, low, high)]
        predicted, mean, bottom, top = curves
        ax.fill_between(t, np.where(np.isnan(bottom), 1e-300, bottom), top, **_BAND)
        _draw_mean(ax, t, mean, whole[i, :shown])
        lines += ax.semilogy(t, predicted, color="black", lw=1.6, linestyle=dash, label=f"$W^2$, {plain(label)}")
    drawn = positive(np.stack([result.predicted[:, :shown], result.mean[:, :shown]]))
    if np.isfinite(drawn).any():
        ax.set_ylim(np.nanmin(drawn) / 2, np.nanmax(drawn) * 2)
    ax.set_ylabel(r"$\|x\|^2$ (state units$^2$)")
    ax.tick_params(labelbottom=False)
    ax.grid(True, which="major", alpha=0.3)
    _draw_strips(strips, result, shown)
    strips.set_xlabel(time_label(result.modes))
    measured = ax.plot([], [], label=f"mean of {result.samples:,} samples", **_MEAN)
    handles = [*lines, *measured, Patch(label=f"its {100 * result.confidence:g} % band", **_BAND)]
    plot = finish(ax, handles, title or "", legend_place(legend_loc, "above"))
    plot.axes = np.array([[ax], [strips]])
    return plot


def _draw_mean(ax: Axes, t: Array, mean: Array, whole: Array) -> None:
    """A mean over time: solid while it is of all runs, dotted after."""
    ax.plot(t, np.where(whole, mean, np.nan), **_MEAN)
    if not whole.all():
        ax.plot(t, np.where(whole, np.nan, mean), linestyle=":", **_MEAN)


def _draw_strips(ax: Axes, result: MonteCarlo, shown: int) -> None:
    """One row a schedule: the mean and its band relative to the prediction, all on one scale."""
    t, whole = result.time[:shown], result.counted == result.samples
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = [(values / result.predicted - 1)[:, :shown] for values in (result.mean, *result.band)]
    scale = _round_up(np.nanmax(np.abs(parts), initial=0.0, where=np.isfinite(parts)))
    for i in range(len(result.labels)):
        mean, low, high = (i - _FILL * np.clip(part[i] / scale, -1, 1) for part in parts)
        ax.fill_between(t, low, high, **_BAND)
        ax.axhline(i, color="black", lw=1.0)
        _draw_mean(ax, t, mean, whole[i, :shown])
    places = np.arange(len(result.labels))
    ax.set_yticks(places, [wrapped(label) for label in result.labels], fontsize="x-small")
    ax.set_ylim(len(places) - 0.5, -0.5)
    ax.set_xlim(0, shown * result.modes.dk)
    edges = np.concatenate([places - _FILL, places + _FILL])
    told = [f"+{100 * scale:g} %"] * len(places) + [f"−{100 * scale:g} %"] * len(places)
    right = ax.secondary_yaxis("right")
    right.set_yticks(edges, told, fontsize="x-small")
    right.set_ylabel("mean / $W^2$ − 1", fontsize="x-small")
    ax.grid(True, axis="x", alpha=0.3)


def _round_up(value: Any) -> float:
    """The next of 1, 2, 5, 10, .. from a tenth of a per cent, at most one."""
    powers = 10.0 ** np.arange(-3, 1)
    steps = np.unique(np.outer(powers, [1, 2, 5]).clip(max=1.0))
    return float(steps[min(int(np.searchsorted(steps, value)), len(steps) - 1)])
