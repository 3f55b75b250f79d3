"""The picture of a report: four panels on one page."""

from textwrap import fill
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from switchctl.moments import Array
from switchctl.plotting.style import check_title, finish, mode_style, plain, positive, require, time_label
from switchctl.stability import Report
from switchctl.stability.dwell_time import held
from switchctl.stability.transient_growth import power_norms

_FALLEN = 0.05  # norms are drawn until they have fallen to this
_STEPS = 1000  # drawn, at most
_LONGEST = 2**40
_NUMBERS = 10  # modes up to which the cells of pairs hold numbers
_BOX = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
_OUTLINES = {"unstable": ("not stable", "-"), "undecided": ("undecided", (0, (2, 1)))}


def plot_report(report: Report, *, title: str | None = None) -> ControlPlot:
    """Draw a report: spectral radii, transient growth, which modes destabilise each other, and dwell times.

    Parameters
    ----------
    report : Report
        What to draw.
    title : str, optional
        Title; none by default.

    Returns
    -------
    control.ControlPlot
        Its axes are (2, 2).

    Examples
    --------
    >>> from switchctl.plotting import plot_report
    >>> from switchctl.stability import report
    >>> from switchctl.models import five_mode
    >>> plot_report(report(five_mode.modes(), time_limit=1)).axes.shape
    (2, 2)
    """
    require(report, Report, "plot_report")
    check_title(title)
    m = len(report.modes)
    size = (9.6, 2 * max(3.2, 1.6 + 0.22 * m))
    figure, axes = plt.subplots(2, 2, figsize=size, layout="constrained", width_ratios=(1, 1.1))
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.1)
    lines = np.empty((2, 2), dtype=object)
    for place, draw in (((0, 0), _radii), ((0, 1), _transients), ((1, 0), _pairs), ((1, 1), _dwell_times)):
        handles = draw(report, axes[place])
        lines[place] = finish(axes[place], handles, "", "above" if handles else False).lines[0, 0]
    if title:
        figure.suptitle(title)
    return ControlPlot(lines, axes, figure)


def _radii(report: Report, ax: Axes) -> list[Any]:
    """Bars from the unit circle, to the left of modes that are stable, and the joint spectral radius."""
    modes, joint = report.modes, report.joint_spectral_radius
    radii = modes.spectral_radii
    _bars(report, ax, radii - 1, 1.0)
    ends = [1.0, *radii.tolist()]
    handles: list[Any] = [ax.axvline(1, color="black", lw=1.2, ls=":", label="unit circle")]
    if joint is not None:
        ends += [joint.lower, joint.upper if joint.upper < 2 * max(joint.lower, 1) else joint.lower]
        between = f"{joint.lower:.4g}", f"{joint.upper:.4g}"
        where = "" if report.graph.free else " under the rules"
        told = f"joint spectral radius{where}, {between[0] if between[0] == between[1] else ' to '.join(between)}"
        ax.axvspan(joint.lower, joint.upper, color="black", alpha=0.2, lw=0, zorder=0.5)
        handles.append(ax.axvline(joint.lower, color="black", lw=1.6, label=told))
    for i, radius in enumerate(radii.tolist()):
        side: dict[str, Any] = {"xytext": (-5, 0), "ha": "right"} if radius < 1 else {"xytext": (5, 0), "ha": "left"}
        side |= {"textcoords": "offset points", "va": "center", "fontsize": "x-small", "bbox": _BOX}
        ax.annotate(f"{radius:.5g}", (radius, i), **side)
    width = max(max(ends) - min(ends), 1e-3)
    left, right = (0.3 if (radii < 1).any() else 0.05), (0.3 if (radii >= 1).any() else 0.08)
    ax.set_xlim(min(ends) - left * width, max(ends) + right * width)
    ax.ticklabel_format(axis="x", useOffset=False)
    ax.locator_params(axis="x", nbins=6)
    ax.set_xlabel("spectral radius (growth per step)")
    return handles


def _transients(report: Report, ax: Axes) -> list[Any]:
    """The norms of the powers of each mode, with their greatest."""
    modes, growths = report.modes, report.transient_growth
    stop = _shown(report)
    k = np.unique(np.linspace(0, stop, min(stop + 1, _STEPS)).round().astype(np.int64))
    lines, top = [], 1.0
    for i, (name, A) in enumerate(zip(modes.names, modes.A, strict=True)):
        norms = positive(power_norms(A, k))
        lines += ax.plot(k * modes.dk, norms, lw=1.4, label=plain(name), **mode_style(i))
        growth = None if growths is None else growths[i]
        if growth is not None and growth.step is not None and growth.step <= stop:
            ax.plot(growth.step * modes.dk, growth.lower, "o", ms=4, color=mode_style(i)["color"])
            top = max(top, growth.lower)
    ax.set(yscale="log", xlabel=time_label(modes), ylabel=r"$\|A^k\|_2$", xlim=(0, stop * modes.dk))
    ax.set_ylim(_FALLEN, max(2 * top, 10 if growths is None or any(g.step is None for g in growths) else 0))
    ax.axhline(1, color="black", lw=0.6, zorder=1)
    ax.grid(True, alpha=0.3)
    return [*lines, Line2D([], [], ls="none", marker="o", ms=4, color="black", label="greatest")]


def _shown(report: Report) -> int:
    """Steps until the slowest mode that vanishes has fallen; where none does, until all have grown."""
    ends = []
    for A, radius in zip(report.modes.A, report.modes.spectral_radii, strict=True):
        k = np.unique(np.geomspace(1, _LONGEST, 400).astype(np.int64))
        norms = power_norms(A, k)
        out = (norms > _FALLEN) if radius < 1 else (norms < 1 / _FALLEN)
        last = int(np.flatnonzero(out).max(initial=-1))
        if radius < 1 and last + 1 < len(k):
            ends.append(int(k[last + 1]))
    return max(max(ends, default=50), 10)


def _pairs(report: Report, ax: Axes) -> list[Any]:
    """A heat map centred at 1, with outlines where a pair is not stable."""
    names, found = [plain(name) for name in report.modes.names], report.pairs
    if found is None:
        return _told(ax, report.reasons["pairs"], "growth per step of the worst alternation of two modes")
    m = len(names)
    spread = min(max(float(np.nanmax(np.abs(found.lower - 1), initial=0.0)), 0.01), 1.0)
    norm = TwoSlopeNorm(1, 1 - spread, 1 + spread)
    extend = "max" if np.nanmax(found.lower, initial=0.0) > 2 else "neither"
    mesh = ax.pcolormesh(np.ma.masked_invalid(found.lower), cmap="PuOr_r", norm=norm, edgecolors="white", lw=1)
    handles = {}
    for (i, j), value in np.ndenumerate(found.lower):
        verdict = found.verdicts[i][j]
        if m <= _NUMBERS:
            dark = np.isfinite(value) and abs(value - 1) > 0.6 * spread
            style: dict[str, Any] = {"ha": "center", "va": "center", "color": "white" if dark else "black"}
            places = 4 if m <= 6 else 2
            told = "-" if np.isnan(value) else f"{value:.{places}f}" if value < 10 else f"{value:.{places}g}"
            ax.text(j + 0.5, i + 0.5, told, fontsize="small" if m <= 6 else "x-small", **style)
        if verdict in _OUTLINES:
            label, dashes = _OUTLINES[verdict]
            ax.add_patch(Rectangle((j + 0.06, i + 0.06), 0.88, 0.88, fill=False, ec="black", lw=1.8, ls=dashes))
            handles[label] = Patch(facecolor="none", edgecolor="black", lw=1.8, ls=dashes, label=label)
    ax.set_xticks(np.arange(m) + 0.5, names, rotation=90 if m * max(map(len, names)) > 40 else 0, fontsize="small")
    ax.set_yticks(np.arange(m) + 0.5, names, fontsize="small")
    ax.tick_params(length=0)
    ax.invert_yaxis()
    ax.set(xlabel="mode", ylabel="mode")
    bar = ax.figure.colorbar(mesh, ax=ax, extend=extend)
    bar.set_label("growth per step of the worst\nalternation found of two modes", fontsize="small")
    return list(handles.values())


def _dwell_times(report: Report, ax: Axes) -> list[Any]:
    """Bars of each mode's own, with lines at that of all modes and at the average one."""
    modes = report.modes
    label = "dwell time " + ("(steps)" if modes.dt is True else "(s)")
    unit = modes.dk
    all_alike, own, average = report.dwell_time, report.dwell_times, report.average_dwell_time
    if all_alike is None and own is None and average is None:
        word = report.stabilising_word
        told = "" if word is None else f"\n\nfound: {held(word.word, modes.names)} repeated for ever"
        return _told(ax, report.reasons["dwell_time"] + told, label)
    steps: Array = np.full(len(modes), np.nan) if own is None else np.array(own.dwell, dtype=float)
    _bars(report, ax, steps * unit, 0.0)
    for i, d in enumerate(steps.tolist()):
        words = "not known" if np.isnan(d) else f"{d:g} step{'s' * (d > 1)}"
        style: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": "x-small", "bbox": _BOX}
        ax.annotate(words, (0, i), (6, 0), **style)
    handles: list[Any] = []
    ends = [float(np.nanmax(steps, initial=1.0))]
    for found, name, dashes in (
        (all_alike, "all modes alike", "-"),
        (average, "on average", "--"),
    ):
        if found is not None and np.isfinite(found.upper):
            told = f"{found.upper:.4g} step{'s' * (found.upper != 1)}"
            handles.append(ax.axvline(found.upper * unit, color="black", lw=1.6, label=f"{name}, {told}", ls=dashes))
            ends.append(float(found.upper))
    joint = report.joint_spectral_radius
    if report.graph.free and joint is not None and joint.verdict == "stable":
        handles.append(Line2D([], [], ls="none", label="arbitrary switching is stable"))
    ax.set_xlim(0, 1.08 * max(ends) * unit)
    ax.set_xlabel(label)
    return handles


def _bars(report: Report, ax: Axes, widths: Array, left: float) -> None:
    """One bar a mode."""
    m = len(widths)
    ax.barh(range(m), widths, left=left, color=[mode_style(i)["color"] for i in range(m)], height=0.7)
    ax.set_yticks(range(m), [plain(name) for name in report.modes.names], fontsize="small")
    ax.set_ylim(m - 0.4, -0.6)
    ax.grid(True, axis="x", alpha=0.3)
    ax.set_axisbelow(True)


def _told(ax: Axes, why: str, label: str) -> list[Line2D]:
    """Words where there is nothing to draw."""
    told = "\n".join(fill(part, 44) for part in why.split("\n"))
    ax.text(0.5, 0.5, plain(told), transform=ax.transAxes, ha="center", va="center", fontsize="small")
    ax.set(xticks=[], yticks=[], xlabel=label)
    return []
