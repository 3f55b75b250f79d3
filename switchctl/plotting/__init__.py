"""Every picture, in one look. Each function returns python-control's `ControlPlot`.

All take python-control's ``title`` and, but for the page of `plot_report`, ``ax`` and ``legend_loc`` (False for no
legend).
"""

from switchctl.plotting.graphs import plot_graph
from switchctl.plotting.maps import plot_area, plot_ellipses, plot_sweep, plot_trade_off
from switchctl.plotting.proofs import plot_bounds, plot_tree
from switchctl.plotting.reports import plot_report
from switchctl.plotting.samples import plot_monte_carlo
from switchctl.plotting.signals import plot_schematic, plot_switching, plot_w2

__all__ = [
    "plot_area",
    "plot_bounds",
    "plot_ellipses",
    "plot_graph",
    "plot_monte_carlo",
    "plot_report",
    "plot_schematic",
    "plot_sweep",
    "plot_switching",
    "plot_trade_off",
    "plot_tree",
    "plot_w2",
]
