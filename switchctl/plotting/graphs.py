"""Pictures of switching graphs."""

from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch

from switchctl.graph import SwitchingGraph
from switchctl.moments import Array
from switchctl.plotting.style import Legend, finish, legend_place, mode_style, one_axes, plain, require

_NODES = 60


def plot_graph(
    graph: SwitchingGraph, *, ax: Any = None, title: str | None = None, legend_loc: Legend = None
) -> ControlPlot:
    """Draw a switching graph: its nodes, from the start to the right, and the moves in the colours of their modes.

    Parameters
    ----------
    graph : SwitchingGraph
        What to draw, with 60 nodes at most.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; none by default.
    legend_loc : str or False, optional
        Place of the legend, or False for none; above the axes by default.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    ValueError
        If the graph has more nodes.

    Examples
    --------
    >>> from switchctl.plotting import plot_graph
    >>> graph = SwitchingGraph(ModeSet([[[0.5]], [[0.9]]]), Rules(min_dwell=2))
    >>> plot_graph(graph).axes.shape
    (1, 1)
    """
    require(graph, SwitchingGraph, "plot_graph")
    if len(graph) > _NODES:
        raise ValueError(
            f"the graph has {len(graph):,} nodes, a picture shows at most {_NODES}; graph.to_networkx() hands it to "
            "other programs"
        )
    place = _places(graph)
    columns, rows = np.ptp(place, axis=0) + 1
    ax = one_axes(ax, title, legend_loc, (max(4.0, 1.1 + 1.15 * columns), max(2.4, 0.9 + 1.25 * rows)))
    ax.set_axis_off()
    ax.set_xlim(place[:, 0].min() - 0.6, place[:, 0].max() + 0.6)
    ax.set_ylim(place[:, 1].min() - 0.6, place[:, 1].max() + 0.7)
    lowest = place[:, 1].min()
    parallel: dict[tuple[int, int], int] = {}
    for edge in graph.edges():
        ends = (edge.tail, edge.head)
        number = parallel[ends] = parallel.get(ends, -1) + 1
        _draw_edge(ax, place[edge.tail], place[edge.head], edge.mode, number, place[edge.tail, 1] == lowest < 0)
    for v, (x, y) in enumerate(place):
        words = graph.label(v).replace(" for ", "\n").replace(", ", "\n")
        face = "#DDDDDD" if v == 0 else "white"
        box = {"boxstyle": "round,pad=0.35", "facecolor": face, "edgecolor": "black", "linewidth": 0.8}
        ax.text(x, y, plain(words), ha="center", va="center", fontsize="x-small", bbox=box, zorder=3)
    names = graph.modes.names
    handles = [Line2D([], [], lw=1.4, label=plain(name), **mode_style(i)) for i, name in enumerate(names)]
    return finish(ax, handles, title or "", legend_place(legend_loc, "above"))


def _places(graph: SwitchingGraph) -> Array:
    """Columns by the fewest steps from the start, rows by the mode before, more where some would coincide."""
    column = {0: 0}
    for v in range(len(graph)):  # nodes are numbered in the order in which they are reached
        for head in graph.successor[v]:
            if head >= 0:
                column.setdefault(int(head), column[v] + 1)
    lanes: dict[tuple[int, int], list[int]] = {}
    for v in range(len(graph)):
        lanes.setdefault((int(graph.last_mode[v]), column[v]), []).append(v)
    place = np.empty((len(graph), 2))
    base = 0
    for mode in sorted({mode for mode, _ in lanes}):
        deep = max(len(nodes) for (lane, _), nodes in lanes.items() if lane == mode)
        for (lane, x), nodes in lanes.items():
            if lane == mode:
                for number, v in enumerate(nodes):
                    place[v] = x, -(base + number)
        base += deep
    if graph.last_mode[0] < 0 and (graph.last_mode >= 0).any():
        place[0, 1] = place[1:, 1].mean()  # the start stands between the modes
    return place


def _draw_edge(ax: Axes, tail: Array, head: Array, mode: int, number: int, below: bool) -> None:
    """Draw an arrow: parallel ones bend more and more, one that stays is a loop above or below its node."""
    style = mode_style(mode) | {"lw": 1.2, "arrowstyle": "-|>", "mutation_scale": 9, "zorder": 2, "shrinkA": 16}
    style["shrinkB"] = 0 if (tail == head).all() else 16
    if (tail == head).all():
        side, wider = (-1 if below != (number % 2 == 1) else 1), 0.05 * (number // 2)
        ends = [tail + np.array([x, 0.15 * side]) for x in (-0.12 - wider, 0.12 + wider)]
        bend = f"arc3,rad={-side * (1.2 + 0.3 * (number // 2))}"
        style["shrinkA"] = 0
    else:
        # Forward and back bend to different sides; long ones pass the nodes between.
        distance = np.abs(head - tail).max()
        ends, far = [tail, head], 0.12 if distance <= 1 else min(0.25, 0.9 / distance)
        bend = f"arc3,rad={far + 0.15 * number}"
    (x0, y0), (x1, y1) = ends
    ax.add_patch(FancyArrowPatch((x0, y0), (x1, y1), connectionstyle=bend, **style))
