"""Pictures of a proof: bounds closing over the time of a search, and the tree of prefixes it had to look at."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from switchctl.certificates import Certificate
from switchctl.methods import Rung
from switchctl.plotting.style import COLOURS, Legend, finish, legend_place, mode_style, one_axes, require

_PREFIXES = 2000


def plot_bounds(
    rungs: Sequence[Rung], *, ax: Any = None, title: str | None = None, legend_loc: Legend = None
) -> ControlPlot:
    """Draw how the least cost found and the proven lower bound close in on each other over the time of a search.

    Both as fractions of the last cost: how far the cost found is above the last bound, and the bound below the last
    cost.

    Parameters
    ----------
    rungs : sequence of Rung
        What `Optimal` told its callback.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; none by default.
    legend_loc : str or False, optional
        Place of the legend; False for none.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    TypeError
        If rungs are not what the callback was told, one at least.

    Examples
    --------
    >>> from switchctl.plotting import plot_bounds
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> rungs = []
    >>> found = schedule(modes, x0, Optimal(gap=0.05, callback=rungs.append))
    >>> plot_bounds(rungs).axes.shape
    (1, 1)
    """
    rungs = list(rungs) if isinstance(rungs, Sequence) else [rungs]
    if not rungs or not all(isinstance(rung, Rung) for rung in rungs):
        raise TypeError("plot_bounds draws a list of Rung, one at least: what Optimal(callback=rungs.append) collects")
    ax, last = one_axes(ax, title, legend_loc), rungs[-1]
    seconds = [rung.seconds for rung in rungs]
    lines = []
    for label, colour, distances in (
        ("least cost found, above the last bound", COLOURS[3], [rung.cost - last.lower_bound for rung in rungs]),
        ("proven bound, below the last cost", COLOURS[0], [last.cost - rung.lower_bound for rung in rungs]),
    ):
        shown = np.maximum(np.array(distances) / last.cost, 1e-16)
        lines += ax.step(seconds, shown, color=colour, label=label, where="post", marker="o", markersize=4)
    ax.set(xlabel="time of the search (s)", ylabel="fraction of the cost", yscale="log")
    if seconds[-1] > 10 * seconds[0]:
        ax.set_xscale("log")
    ax.grid(True, alpha=0.3)
    ax.text(0.02, 0.04, f"{last.nodes:,} moments seen", transform=ax.transAxes, fontsize="small")
    return finish(ax, lines, title or "", legend_place(legend_loc, "best"))


def plot_tree(
    certificate: Certificate, *, ax: Any = None, title: str | None = None, legend_loc: Legend = None
) -> ControlPlot:
    """Draw the prefixes of a certificate: every run begins with one, and there it is given up for a lower bound.

    Parameters
    ----------
    certificate : Certificate
        The certificate, of at most 2000 prefixes.
    ax : matplotlib axes, optional
        Where to draw; a new figure by default.
    title : str, optional
        Title; none by default.
    legend_loc : str or False, optional
        Place of the legend; False for none.

    Returns
    -------
    control.ControlPlot

    Raises
    ------
    ValueError
        If the tree has more prefixes.

    Examples
    --------
    >>> from switchctl.certificates import certify
    >>> from switchctl.plotting import plot_tree
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> plot_tree(certify(schedule(modes, x0, PointwiseMinimum()), gap=0.05)).axes.shape
    (1, 1)
    """
    require(certificate, Certificate, "plot_tree")
    if certificate.kind != "optimum":
        raise ValueError(f"plot_tree draws certificates of a schedule; this one is of kind {certificate.kind!r}")
    data, witness = certificate.document["data"], certificate.document["witness"]
    if len(witness["tree"]) > _PREFIXES:
        raise ValueError(f"the tree has {len(witness['tree']):,} prefixes; a picture shows {_PREFIXES:,} at most")
    ax = one_axes(ax, title, legend_loc)
    edges, ends = _drawn(data["moves"], {int(v) for v in witness["bounds"][0]}, witness["tree"])
    for mode in range(len(data["A"])):
        parts = [edge for edge in edges if edge[0] == mode]
        x = np.array([[a, b, np.nan] for _, a, b, _, _ in parts]).ravel()
        y = np.array([[a, b, np.nan] for *_, a, b in parts]).ravel()
        if len(parts):
            ax.plot(x, y, linewidth=1.2, **mode_style(mode))
    ax.plot(*np.array(ends).T, "o", markersize=2.5, color="black", linestyle="none")
    ax.set(xlabel="step", yticks=[])
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.spines[["left", "right", "top"]].set_visible(False)
    used = sorted({edge[0] for edge in edges})
    handles = [Line2D([], [], label=data["names"][mode], **mode_style(mode)) for mode in used]
    handles.append(Line2D([], [], marker="o", markersize=2.5, color="black", linestyle="none", label="given up"))
    return finish(ax, handles, title or "", legend_place(legend_loc, "best"))


def _drawn(
    moves: list[Any], chosen: set[int], tree: list[int]
) -> tuple[list[tuple[Any, ...]], list[tuple[int, float]]]:
    """Edges as (mode, step, next step, height, next height), and the places where prefixes end."""
    tokens, ends = iter(tree), []
    nodes: list[list[Any]] = [[0, 0, None, None]]  # node, step, parent, mode; then the height
    children: list[list[int]] = [[]]
    order, stack = [], [0]
    while stack:
        place = stack.pop()
        order.append(place)
        v, step = nodes[place][:2]
        if not moves[v] or (v in chosen and next(tokens) != -1):
            ends.append(place)
            continue
        for mode, head in moves[v]:
            children[place].append(len(nodes))
            nodes.append([head, step + 1, place, mode])
            children.append([])
        stack += reversed(children[place])
    height = dict(zip(ends, np.arange(len(ends), dtype=float), strict=True))
    for place in reversed(order):
        if children[place]:
            height[place] = float(np.mean([height[child] for child in children[place]]))
    edges = [
        (mode, step - 1, step, height[parent], height[place])
        for place, (_, step, parent, mode) in enumerate(nodes)
        if parent is not None
    ]
    return edges, [(nodes[place][1], height[place]) for place in ends]
