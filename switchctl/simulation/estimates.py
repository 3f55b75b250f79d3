"""MonteCarlo: what samples say of the predicted W2."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.tables import Summary

if TYPE_CHECKING:
    from control import ControlPlot

_ROUNDING = 1e-9  # of a prediction: what a mean of equal numbers may be off by


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(Summary):
    """The mean of ``||x||^2`` over samples, beside the W2 that schedules predict for it. `monte_carlo` makes one.

    Arrays have a row for each schedule, and one entry a step along the last axis, for the state at its beginning.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    labels : tuple of str, length s
        Of the schedules.
    predicted : array, shape (s, N)
        W2.
    mean, standard_error : arrays, shape (s, N)
        Of ``||x||^2``, the distance to the operating point, over the runs counted; NaN where none or one is left, and
        infinite beyond the floating-point range.
    counted : int array, shape (s, N)
        The runs behind each mean: all, less those that have stopped before that step.
    stops : tuple of (int, str), for each schedule
        The samples whose runs stopped early, each with when and why.
    samples : int
        How many were done.
    asked : int
        How many were asked for; more than were done where Ctrl-C came between.
    confidence : float
        Of the band, at each step by itself.
    plant : str
        The name of the plant that was simulated; empty for the modes themselves.
    """

    modes: ModeSet
    labels: tuple[str, ...]
    predicted: Array
    mean: Array
    standard_error: Array
    counted: NDArray[np.intp]
    stops: tuple[tuple[tuple[int, str], ...], ...]
    samples: int
    asked: int
    confidence: float
    plant: str = ""

    @property
    def time(self) -> Array:
        """Time of each step in seconds (or its number, where the modes carry no period), shape (N,)."""
        return np.arange(self.mean.shape[1], dtype=float) * self.modes.dk

    @property
    def band(self) -> tuple[Array, Array]:
        """The confidence band of the mean, its lower and upper edge, shape (s, N) each.

        It is the normal approximation, mean plus and minus so many standard errors, at each step by itself: the steps
        of a run depend on each other, so a prediction that is off is off for many steps in a row.
        """
        half = NormalDist().inv_cdf((1 + self.confidence) / 2) * self.standard_error
        with np.errstate(invalid="ignore"):
            return self.mean - half, self.mean + half

    @property
    def inside(self) -> Array:
        """The fraction of steps at which the prediction is inside the band, shape (s,).

        Only steps that no run has stopped before count: after that, the mean is of those that went on.
        """
        (low, high), slack = self.band, _ROUNDING * self.predicted + np.finfo(float).tiny
        within = (low - slack <= self.predicted) & (self.predicted <= high + slack)
        whole = self.counted == self.samples
        return np.array([within[i, whole[i]].mean() for i in range(len(self.labels))])

    @property
    def left(self) -> NDArray[np.intp]:
        """How many runs stopped early, shape (s,)."""
        return np.array([len(stops) for stops in self.stops], dtype=np.intp)

    @property
    def status(self) -> str:
        """Whether all samples were done, "completed", or Ctrl-C came between, "interrupted"."""
        return "completed" if self.samples == self.asked else INTERRUPTED

    def _facts(self) -> Sequence[tuple[str, str]]:
        told = [("runs of", f"{self.plant}, simulated" if self.plant else "the modes")]
        whole = np.count_nonzero(self.counted == self.samples, axis=1).tolist()
        for label, inside, steps, stops in zip(self.labels, self.inside, whole, self.stops, strict=True):
            of = f"the {steps} step{'s' * (steps > 1)} before a run stopped" if stops else "steps"
            told.append((label, f"W2 inside the {100 * self.confidence:g} % band at {100 * inside:.1f} % of {of}"))
            if stops:
                sample, why = stops[0]
                told.append(("", f"{len(stops)} runs stopped early, and the mean goes on without them"))
                told.append(("", f"sample {sample} {why}"))
        cut = "" if self.samples == self.asked else f" after {self.samples} of {self.asked} samples"
        return [*told, ("ends", self.status + cut)]

    def _heading(self) -> str:
        steps = self.mean.shape[1]
        duration = "" if self.modes.dt is True else f" ({steps * self.modes.dk:g} s)"
        return f"MonteCarlo: {self.samples} samples, {steps} step{'s' * (steps > 1)}{duration}"

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw W2 and the mean with its band; see `switchctl.plotting.plot_monte_carlo` for the keywords.

        Parameters
        ----------
        **keywords : ax, title, legend_loc
            As for `plot_monte_carlo`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_monte_carlo

        return plot_monte_carlo(self, **keywords)


class Tally:
    """Count, mean and norm of the deviations at each step, gathered block by block.

    The deviations are from the block's mean, and blocks are merged by the formula of Chan, Golub and LeVeque (The
    American Statistician 37, 1983), so that no digits are lost where the deviations are small. Their squares are never
    formed, so that they don't leave the floating-point range before the deviations themselves.

    Parameters
    ----------
    steps : int
        The steps.
    """

    def __init__(self, steps: int) -> None:
        self.count = np.zeros(steps, dtype=np.intp)
        self.mean, self.spread = np.zeros(steps), np.zeros(steps)

    def add(self, count: Any, mean: Array, spread: Array) -> None:
        """Merge a block, described by the same three."""
        total = self.count + count
        share = count / np.maximum(total, 1)
        with np.errstate(over="ignore", invalid="ignore"):
            away = mean - self.mean
            between = np.abs(away) * np.sqrt(self.count * share)
            self.spread = np.hypot(np.hypot(self.spread, spread), between)
            self.mean, self.count = np.where(np.isfinite(away), self.mean + away * share, np.inf), total

    def __add__(self, other: "Tally") -> "Tally":
        both = Tally(len(self.count))
        both.count, both.mean, both.spread = self.count, self.mean, self.spread
        both.add(other.count, other.mean, other.spread)
        return both

    def add_runs(self, w2: Array) -> None:
        """Merge runs, shape (runs, steps); NaN after a run has stopped."""
        there = ~np.isnan(w2)
        count = there.sum(axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            mean = (np.where(there, w2, 0.0) / np.maximum(count, 1)).sum(axis=0)
            self.add(count, mean, norm(np.where(there, w2 - mean, 0.0)))

    def estimates(self) -> tuple[Array, Array]:
        """The mean and its standard error; NaN where there are too few to tell, infinite beyond the range."""
        spread = np.where(np.isfinite(self.mean), self.spread, np.inf)
        freedom = np.where(self.count > 1, self.count - 1, np.nan)
        return np.where(self.count > 0, self.mean, np.nan), spread / np.sqrt(freedom) / np.sqrt(
            np.maximum(self.count, 1)
        )


def norm(columns: Array) -> Array:
    """The Euclidean norm of each column, in the range where the squares of its entries are not."""
    greatest = np.abs(columns).max(axis=0)
    unit = np.where(greatest > 0, greatest, 1.0)
    return np.asarray(unit * np.sqrt(np.sum((columns / unit) ** 2, axis=0)))
