"""Pictures of a proof: bounds closing over the time of a search, and the tree of prefixes it had to look at."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
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
    """Draw how the least cost found and the proven lower bound close in on each other, and the gap between them.

    Parameters
    ----------
    rungs : sequence of Rung
        What `Optimal` told its callback.
    ax : two matplotlib axes, optional
        Where to draw costs and gap; those of a new figure by default.
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
        If there is no rung, or there are not two axes.
    """
    if not rungs or not all(isinstance(rung, Rung) for rung in rungs):
        raise ValueError("rungs must be what Optimal(callback=rungs.append) collects, one Rung at least")
    if ax is None:
        ax = plt.subplots(2, 1, sharex=True, figsize=(6.4, 5.0), layout="constrained")[1]
    axes = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
    if len(axes) != 2:
        raise ValueError(f"ax must be two matplotlib axes, one for costs and one for the gap; got {ax!r}")
    costs, gaps = axes
    seconds = [rung.seconds for rung in rungs]
    style = {"where": "post", "marker": "o", "markersize": 4}
    lines = [
        costs.step(seconds, [rung.cost for rung in rungs], color=COLOURS[3], label="least cost found", **style)[0],
        costs.step(seconds, [rung.lower_bound for rung in rungs], color=COLOURS[0], label="proven bound", **style)[0],
    ]
    costs.set_ylabel("cost")
    gaps.step(seconds, [max(rung.gap, 1e-16) for rung in rungs], color="black", **style)
    gaps.set(xlabel="time of the search (s)", ylabel="gap", yscale="log")
    if seconds[-1] > 10 * seconds[0]:
        gaps.set_xscale("log")
    gaps.text(0.02, 0.06, f"{rungs[-1].nodes:,} moments seen", transform=gaps.transAxes)
    if legend_loc is not False:
        costs.legend(loc=legend_loc or "best")
    if title:
        costs.set_title(title)
    for axis in axes:
        axis.grid(True, alpha=0.3)
    return ControlPlot(np.array([lines], dtype=object), np.array(axes, dtype=object), costs.figure)


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
    """
    require(certificate, Certificate, "plot_tree")
    data, witness = certificate.document["data"], certificate.document["witness"]
    if len(witness["tree"]) > _PREFIXES:
        raise ValueError(f"the tree has {len(witness['tree']):,} prefixes; a picture shows {_PREFIXES:,} at most")
    ax = one_axes(ax)
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
