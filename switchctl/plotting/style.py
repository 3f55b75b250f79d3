"""The look of every picture: palette, axes, legends.

A mode keeps its colour and line style, by its index, in every figure; schedules are black.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend as MatplotlibLegend
from matplotlib.lines import Line2D

from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.validation import whole_number

# Okabe and Ito's palette without black and yellow, continued from Tol's muted one; told apart by line style as well.
COLOURS = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7",
    "#56B4E9", "#882255", "#999933", "#332288", "#777777",
)  # fmt: skip
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)), (0, (8, 2, 1, 2, 1, 2)))
SCHEDULE_DASHES: tuple[Any, ...] = ("-", (0, (3, 1)), (0, (1, 1)), (0, (4, 1, 1, 1)))
_PLACES = ("above", *MatplotlibLegend.codes)
SHOWN = 1e-4  # pictures end where W2 has fallen to this fraction of its start

Legend = Any  # python-control's legend_loc: a place, False for none, or None for the default


def mode_style(index: int) -> dict[str, Any]:
    """Colour and line style of a mode, by its index."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def one_axes(ax: Any, title: Any, legend_loc: Any, size: tuple[float, float] = (6.4, 4.2)) -> Axes:
    """Return the axes given, or those of a new figure; nothing is drawn where an argument is wrong."""
    check_title(title)
    if isinstance(legend_loc, str):
        if legend_loc not in _PLACES:
            raise ValueError(f"legend_loc is {legend_loc!r}; expected False or one of {', '.join(_PLACES)}")
    elif legend_loc is not None and legend_loc is not False:
        raise TypeError(f"legend_loc must be a string such as 'upper right', or False for none, not {legend_loc!r}")
    if ax is None:
        return plt.subplots(figsize=size, layout="constrained")[1]
    flat = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    if len(flat) != 1 or not isinstance(flat[0], Axes):
        raise ValueError(f"ax must be one matplotlib Axes; got {ax!r:.200}")
    if flat[0].name != "rectilinear":
        raise ValueError(f"ax has {flat[0].name} coordinates; expected plain ones, as of plt.subplots()")
    if flat[0].get_figure(root=True) is None:
        raise ValueError("ax was removed from its figure; give one that stands in a figure")
    return flat[0]


def check_title(title: Any) -> None:
    """Refuse what is no title."""
    if title is not None and not isinstance(title, str):
        raise TypeError(f"title must be a string, not {title!r}")


def split_axes(ax: Axes, rows: int) -> tuple[Axes, Axes]:
    """Give the lower part of an axes to a second one of so many rows of text, that shares its time axis."""
    figure, cell = figure_of(ax), ax.get_subplotspec()
    height = ax.get_position().height * figure.get_figheight()
    share = min(0.45, rows * 1.25 * plt.rcParams["font.size"] / 72 / height)
    if cell is None:
        left, bottom, width, height = ax.get_position().bounds
        ax.set_position((left, bottom + height * share, width, height * (1 - share)))
        return ax, figure.add_axes((left, bottom, width, height * (share - 0.03)), sharex=ax)
    parts = cell.subgridspec(2, 1, height_ratios=(1 - share, share), hspace=0.05)
    ax.set_subplotspec(parts[0])
    return ax, figure.add_subplot(parts[1], sharex=ax)


def figure_of(ax: Axes) -> Figure:
    """Return the figure that an axes stands in."""
    figure = ax.get_figure(root=True)
    assert figure is not None  # an axes that can be drawn on has a figure
    return figure


def steps_shown(w2s: Sequence[Array], stop: int | None) -> int:
    """Steps to show: those asked for, or until each W2 is a small fraction of its start."""
    longest = max(map(len, w2s))
    if stop is not None:
        return min(whole_number(stop, "stop"), longest)
    shown = 10
    for w2 in w2s:
        above = np.flatnonzero(w2 > SHOWN * w2[0])
        shown = max(shown, (above[-1] if len(above) else 0) + 2)
    return min(shown, longest)


def finish(ax: Axes, handles: list[Any], title: str, legend_loc: Legend) -> ControlPlot:
    """Add title and legend, and wrap up."""
    legend = None
    if legend_loc == "above":
        columns = _columns(
            [len(handle.get_label()) for handle in handles], ax.get_position().width * figure_of(ax).get_figwidth()
        )
        place: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": columns}
        legend = ax.legend(handles=handles, title=title or None, frameon=False, fontsize="small", **place)
    else:
        if title:
            ax.set_title(title, fontsize="medium")
        if legend_loc:
            legend = ax.legend(handles=handles, loc=legend_loc, fontsize="small", framealpha=0.9)
    lines = np.empty((1, 1), dtype=object)
    lines[0, 0] = [handle for handle in handles if isinstance(handle, Line2D)] or handles
    return ControlPlot(lines, np.array([[ax]]), ax.figure, legend=legend)


def _columns(lengths: list[int], width: float) -> int:
    """Columns of a legend with labels of these lengths that fit a width in inches; it is filled column by column."""
    em = plt.rcParams["font.size"] * 0.83 / 72
    for columns in range(len(lengths), 1, -1):
        widths = [max(part) * 0.6 * em + 4.5 * em for part in np.array_split(lengths, columns)]
        if sum(widths) <= width:
            return columns
    return 1


def legend_place(legend_loc: Legend, default: str) -> Legend:
    """Return the place asked for, a default where none was, or False."""
    return default if legend_loc is None else legend_loc


def positive(w2: np.ndarray) -> np.ndarray:
    """Leave out what a log axis can't show."""
    return np.where((w2 > 1e-280) & (w2 < 1e280), w2, np.nan)


def time_label(modes: ModeSet) -> str:
    """Label the time axis."""
    return "step k" if modes.dt is True else "time (s)"


def wrapped(label: str) -> str:
    """Break a long label before its settings."""
    return plain(label.replace("(", "\n(", 1) if len(label) > 18 else label)


def plain(text: str) -> str:
    """Text as it stands: no dollar begins a formula."""
    return text.replace("$", r"\$")


def require(data: Any, kind: type | tuple[type, ...], picture: str) -> None:
    """Refuse to draw what a picture is not of."""
    if not isinstance(data, kind):
        kinds = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
        raise TypeError(f"{picture} draws a {kinds}, not a {type(data).__name__}")
