"""What a method is: an immutable record of settings that starts a running scheduler."""

import math
from abc import ABC, abstractmethod
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from control import ControlDimension
from numpy.typing import NDArray

from switchctl.gaussian import Gaussian
from switchctl.modes import ModeSet
from switchctl.moments import Array, second_moment
from switchctl.validation import positive_semidefinite, real_array

TIE = 1e-12
"""A challenger replaces the best so far only if its cost is below ``best * (1 - TIE)``."""


def least_cost(costs: Array, allowed: NDArray[np.bool_] | None = None) -> int:
    """Position of the least cost; of costs that tie, the first (see `TIE`).

    Parameters
    ----------
    costs : array, shape (r,)
        One cost a candidate, candidates in index order.
    allowed : bool array, shape (r,), optional
        Which candidates may be chosen; all by default.

    Returns
    -------
    int

    Raises
    ------
    FloatingPointError
        If the cost of an allowed candidate is not finite.

    Examples
    --------
    >>> least_cost(np.array([2.0, 1.0, 1.0 - 1e-15]))
    1
    """
    best, best_cost = -1, 0.0
    for position, cost in enumerate(costs.tolist()):
        if allowed is not None and not allowed[position]:
            continue
        if not math.isfinite(cost):
            raise FloatingPointError(
                f"the cost of candidate {position} is {cost}: it exceeds the floating-point range; "
                "use a shorter horizon or scale the state"
            )
        if best < 0 or cost < best_cost * (1 - TIE):
            best, best_cost = position, cost
    return best


class Scheduler(ABC):
    """A running method: told the state's moments once a sample, it names the mode to use.

    Parameters
    ----------
    modes : ModeSet
        The modes to choose from. The constructor ends with `reset`.
    """

    lengthened: int = 0
    """Steps added to the hold begun at this sample to meet a stability constraint."""

    def __init__(self, modes: ModeSet) -> None:
        self.modes = modes
        self.reset()

    @abstractmethod
    def decide(self, S: Array) -> int:
        """Choose the mode for one step.

        Parameters
        ----------
        S : array, shape (n, n)
            The current second moment, which `step` has checked.

        Returns
        -------
        int
            Index of the mode.
        """

    def reset(self) -> None:  # noqa: B027  a scheduler without memory has nothing to forget
        """Forget the past: the next sample is the first."""

    def tail(self, S: Array) -> tuple[int, ...] | None:
        """Name the word of modes that follows a schedule's last step, repeated for ever.

        Parameters
        ----------
        S : array, shape (n, n)
            The second moment after the last step.

        Returns
        -------
        tuple of int, or None
            None (unless a method knows better) for the last mode, held.
        """
        return None

    def step(self, mean: Any, cov: Any = None) -> int:
        """Choose the mode for the coming sample, from the state's mean and covariance; call it once a sample.

        Parameters
        ----------
        mean : array_like, shape (n,)
            Mean of the state (or the measured state).
        cov : array_like, shape (n, n), optional
            Its covariance; zero by default: the state is known.

        Returns
        -------
        int
            Index of the mode.

        Raises
        ------
        ValueError
            If a shape doesn't fit, an entry is not finite, or cov is not symmetric positive semidefinite.
            Nothing is decided then, and the next call continues as if this one hadn't been.
        FloatingPointError
            If the second moment or a cost exceeds the floating-point range.
        """
        n = self.modes.A.shape[-1]
        mean = real_array(mean, "mean", (n,))
        cov = np.zeros((n, n)) if cov is None else positive_semidefinite(real_array(cov, "cov", (n, n)), "cov")
        with np.errstate(over="ignore", invalid="ignore"):
            S = second_moment(mean, cov)
            if not np.isfinite(S).all():
                raise FloatingPointError("the second moment exceeds the floating-point range; scale the state")
            return self.modes.index(self.decide(S))


class Method(ABC):
    """A way to schedule: settings, fixed once made. Methods are interchangeable in `schedule` and `compare`."""

    @abstractmethod
    def start(self, modes: ModeSet) -> Scheduler:
        """Start the running scheduler.

        Parameters
        ----------
        modes : ModeSet
            The modes to choose from.

        Returns
        -------
        Scheduler
        """

    def __repr__(self) -> str:
        """Name the settings that differ from their defaults."""
        defaults: dict[str, Any] = {field.name: field.default for field in fields(self)} if is_dataclass(self) else {}
        changed = {name: getattr(self, name) for name, default in defaults.items() if getattr(self, name) != default}
        told = [f"{name}={getattr(value, '__qualname__', repr(value))}" for name, value in changed.items()]
        return f"{type(self).__name__}({', '.join(told)})"


def check_state(modes: ModeSet, x0: Gaussian) -> None:
    """Refuse an initial state that is not one Gaussian of the modes' dimension."""
    if not isinstance(modes, ModeSet):
        raise TypeError(f"modes must be a ModeSet (see close_loops), not a {type(modes).__name__}")
    if not isinstance(x0, Gaussian):
        raise TypeError(
            f"x0 must be a Gaussian, not a {type(x0).__name__}; a state known exactly has cov = np.zeros((n, n))"
        )
    n = modes.A.shape[-1]
    if x0.mean.shape != (n,):
        raise ControlDimension(f"x0 has a mean of shape {x0.mean.shape}; the modes have {n} states, so expected ({n},)")
