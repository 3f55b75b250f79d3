"""The receding horizon over many horizons and holds."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from switchctl.gaussian import Gaussian
from switchctl.methods import RecedingHorizon, best_single_mode, single_mode_costs
from switchctl.methods.boundary import initial_state
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import Mode, ModeSet
from switchctl.moments import Array
from switchctl.scheduling import schedule
from switchctl.tables import html_table, text_table
from switchctl.validation import SETTINGS, frozen, listed

if TYPE_CHECKING:
    from control import ControlPlot


@dataclass(frozen=True, eq=False)
class Sweep:
    """Cost of the receding horizon over horizons and holds. `sweep` makes one.

    Parameters
    ----------
    horizons, holds : tuple of int
        The settings.
    cost : array, shape (horizons, holds)
        NaN where an interrupted sweep did not come.
    best_single : Mode
        The best single mode.
    best_single_cost : float
        Its cost.
    """

    horizons: tuple[int | float, ...]
    holds: tuple[int, ...]
    cost: Array
    best_single: Mode
    best_single_cost: float

    @property
    def relative(self) -> Array:
        """Cost relative to the best single mode: below 1, switching helps (NaN where that costs nothing)."""
        return self.cost / (self.best_single_cost or np.nan)

    def _cells(self) -> list[list[str]]:
        return [[f"T = {T}", *(f"{cost:.6g}" for cost in row)] for T, row in zip(self.horizons, self.cost, strict=True)]

    def _header(self) -> list[str]:
        return ["cost", *(f"hold {hold}" for hold in self.holds)]

    def __repr__(self) -> str:
        best = f"best single mode: {self.best_single.name}, {self.best_single_cost:.6g}"
        return text_table(self._header(), self._cells()) + "\n" + best

    def _repr_html_(self) -> str:
        caption = f"Cost; best single mode {self.best_single.name}: {self.best_single_cost:.6g}"
        return html_table(self._header(), self._cells(), caption)

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw the cost relative to the best single mode as a heat map; see `switchctl.plotting.plot_sweep`.

        Parameters
        ----------
        **keywords : ax, title, legend_loc
            As for `plot_sweep`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_sweep

        return plot_sweep(self, **keywords)


def sweep(
    modes: ModeSet,
    x0: Gaussian,
    horizons: Iterable[int | float],
    holds: Iterable[int],
    decrease: float | None = None,
    steps: int | None = None,
) -> Sweep:
    """Cost of `RecedingHorizon` for every pair of a horizon and a hold.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    horizons, holds : sequence
        The settings to try.
    decrease : float, optional
        As for `RecedingHorizon`.
    steps : int, optional
        As for `schedule`.

    Returns
    -------
    Sweep
        Interrupted by Ctrl-C, with NaN where it did not come.

    Raises
    ------
    TypeError, ValueError
        As `RecedingHorizon` and `schedule` do; ValueError if there is nothing to try.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> sweep(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), horizons=[1, 20], holds=[1, 5])
    cost     hold 1   hold 5
    ------  -------  -------
    T = 1   14.7578  14.7578
    T = 20  16.2132   14.776
    best single mode: calm, 19.8952
    """
    x0 = initial_state(modes, x0)
    horizons = listed(horizons, "horizons", "settings to try", SETTINGS)
    holds = listed(holds, "holds", "settings to try", SETTINGS)
    if not (horizons and holds):
        raise ValueError("horizons and holds must each hold at least one setting")
    settings = [[RecedingHorizon(T, hold, decrease) for hold in holds] for T in horizons]
    best = best_single_mode(modes, x0)
    cost = np.full((len(settings), len(settings[0])), np.nan)
    try:
        with tqdm(total=cost.size, desc="sweep", unit="schedule", delay=2, leave=False) as progress:
            for row, methods in enumerate(settings):
                for column, method in enumerate(methods):
                    result = schedule(modes, x0, method, steps)
                    if result.status == INTERRUPTED:
                        raise KeyboardInterrupt
                    cost[row, column] = result.cost
                    progress.update()
    except KeyboardInterrupt:
        if np.isnan(cost).all():
            raise
    best_cost = float(single_mode_costs(modes, x0)[best.index])
    told: Any = tuple(row[0].horizon for row in settings)
    return Sweep(told, tuple(method.hold for method in settings[0]), frozen(cost), best, best_cost)
