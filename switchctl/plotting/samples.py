"""Pictures of samples: the mean over many runs against the prediction."""

from itertools import cycle, islice
from typing import Any

import numpy as np
from control import ControlPlot
from matplotlib.axes import Axes
from matplotlib.patches import Patch

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
    time_label,
    wrapped,
)
from switchctl.simulation import MonteCarlo
from switchctl.validation import whole_number

_SHOWN = 1e-4  # pictures end where W2 has fallen to this fraction of its start
_BAND = {"color": "#56B4E9", "alpha": 0.6, "lw": 0}
_MEAN = "#0072B2"


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
        Its axes are W2 and, below it, a strip for each schedule.
    """
    require(result, MonteCarlo, "plot_monte_carlo")
    raise NotImplementedError
