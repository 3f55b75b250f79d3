"""The plant of a run: what it does between two samples, and where it stops."""

from collections.abc import Callable
from typing import Any

import control
import numpy as np
from scipy.integrate import solve_ivp

from switchctl.closed_loop import ClosedLoops
from switchctl.moments import Array
from switchctl.sampling import finite_named, same_period
from switchctl.validation import number

_LEAST_RTOL = 100 * np.finfo(float).eps
_MISTAKES = (NameError, AttributeError, TypeError, LookupError)  # of whoever wrote the function, wherever the state is
_PATIENCE = 100  # evaluations that may fail between two samples; each makes the step five times shorter


class Stopped(Exception):
    """A run can't go on: why, and how many seconds after the sample."""

    def __init__(self, reason: str, after: float = 0.0, what: str = "left its domain") -> None:
        super().__init__(reason)
        self.after, self.what = after, what


class Plant:
    """A plant between two samples, its input held.

    Parameters
    ----------
    system : control.NonlinearIOSystem
        Continuous, or sampled with the period of the modes.
    modes : ClosedLoops
        The loops whose place it takes.
    domain : callable or None
        Positive for the states that it is meant for.
    rtol, atol : float
        Tolerances of the integration.
    """

    def __init__(
        self, system: Any, modes: ClosedLoops, domain: Callable[[Array], float] | None, rtol: Any, atol: Any
    ) -> None:
        self.system = fitting(system, modes)
        self.domain, self.period = domain, modes.dk
        self.rtol, self.atol = _tolerance(rtol, "rtol"), _tolerance(atol, "atol")
        self.rate = self.system.dynamics
        if isinstance(system, control.StateSpace):
            A, B = np.array(system.A), np.array(system.B)
            self.rate = lambda t, x, u: A @ x + B @ u
        self._first_step = self.period
        if domain is not None and not callable(domain):
            raise TypeError(f"domain must be a function of the state, positive inside, not {domain!r}")

    def output(self, t: float, x: Array, u: Array) -> Array:
        """The output, of shape (p,), finite."""
        y = _told("output", self.system.output, t, x, u)
        if y.shape != (self.system.noutputs,):
            raise control.ControlDimension(
                f"the plant's output function returns {len(y)} numbers; expected {self.system.noutputs}"
            )
        return y

    def margin(self, x: Array) -> float:
        """How far inside its domain a state is; NaN is outside."""
        if self.domain is None:
            return 1.0
        margin = np.asarray(self.domain(np.array(x)))
        if margin.ndim or margin.dtype.kind not in "biuf":
            raise TypeError(f"domain returns {margin.tolist()!r}; expected a number, positive inside the domain")
        return -1.0 if np.isnan(margin) else float(margin)

    def advance(self, t: float, x: Array, u: Array) -> Array:
        """The state at the next sample."""
        if self.system.dt != 0:
            return self._shaped(_told("update function", self.rate, t, x, u))
        failures = 0
        latest: Stopped | None = None  # unless the plant's function was evaluated since

        def rate(after: float, state: Array) -> Array:
            nonlocal failures, latest
            if latest is not None and not np.isfinite(state).all():  # of a step that is given up
                return np.full(len(x), np.nan)
            try:
                value = _told("derivative", self.rate, t + after, state, u)
            except Stopped as stopped:
                failures, latest = failures + 1, stopped
                if failures > _PATIENCE:
                    raise Stopped(str(stopped), after, stopped.what) from None
                return np.full(len(x), np.nan)  # a shorter step may stay inside
            latest = None
            return self._shaped(value)

        def leaves(after: float, state: Array) -> float:
            return self.margin(state)

        leaves.terminal, leaves.direction = True, -1  # type: ignore[attr-defined]
        found = solve_ivp(
            rate,
            (0.0, self.period),
            x,
            rtol=self.rtol,
            atol=self.atol,
            first_step=self._first_step,
            events=None if self.domain is None else leaves,
        )
        if latest is not None:
            raise Stopped(str(latest), found.t[-1], latest.what)
        if found.status == 1:
            raise Stopped("domain(x) is not positive any more", found.t[-1])
        if found.status < 0 or not np.isfinite(found.y[:, -1]).all():
            raise Stopped(found.message, found.t[-1], "the integration failed")
        self._first_step = float(np.diff(found.t).max())
        return found.y[:, -1]

    def _shaped(self, rate: Array) -> Array:
        if rate.shape != (self.system.nstates,):
            raise control.ControlDimension(
                f"the plant's update function returns {len(rate)} numbers; expected {self.system.nstates}"
            )
        return rate


def _told(what: str, function: Callable[..., Any], *arguments: Any) -> Array:
    """What a function of the plant returns, or why that is nothing to go on with."""
    try:
        value = function(*(np.array(argument) for argument in arguments))  # copies, which it may change
        if np.iscomplexobj(value):
            raise ValueError("it is complex")
        value = np.asarray(value, dtype=float)
    except _MISTAKES as error:
        error.add_note(f"in the plant's {what}, at t = {arguments[0]:g} and x = {arguments[1].tolist()}")
        raise
    except Exception as error:
        raise Stopped(f"the plant's {what} raised {type(error).__name__}: {error}", what="stopped") from None
    if not np.isfinite(value).all():
        raise Stopped(f"the plant's {what} is not finite")
    return value


def fitting(system: Any, modes: ClosedLoops) -> Any:
    """The plant, if it can take the place of the one that the loops were closed with."""
    if not isinstance(system, control.NonlinearIOSystem):
        hint = "; control.ss makes one of a transfer function" if isinstance(system, control.TransferFunction) else ""
        raise TypeError(f"plant must be a NonlinearIOSystem or StateSpace, not a {type(system).__name__}{hint}")
    linear = modes.plant
    assert linear is not None
    own = (system.nstates, system.ninputs, system.noutputs)
    wanted = (linear.nstates, linear.ninputs, linear.noutputs)
    if own != wanted:
        raise control.ControlDimension(
            "plant has {} states, {} inputs and {} outputs; ".format(*map(str, own))
            + "the loops were closed with one of {}, {} and {}".format(*wanted)
            + f" (outputs {', '.join(linear.output_labels)})"
        )
    for what in ("state", "input", "output"):
        names, expected = (getattr(of, f"{what}_labels") for of in (system, linear))
        if names != expected and sorted(names) == sorted(expected):
            raise ValueError(
                f"plant has the {what}s {', '.join(names)}; the loops were closed with {', '.join(expected)}, the same "
                "in another order: give them one order"
            )
    if system.dt is None or system.dt is False:
        raise ValueError(f"plant.dt is {system.dt}; say whether it is continuous (dt=0) or sampled (its period)")
    if isinstance(system, control.StateSpace):
        finite_named(system, "plant")
    if system.dt == 0 and modes.dt is True:
        raise ValueError("plant is continuous, but the modes have no sampling period; close the loops with dt=..")
    if system.dt != 0 and not same_period(system.dt, modes.dt):
        raise ValueError(
            f"plant is sampled with dt = {system.dt}, and the modes with dt = {modes.dt}; expected the same period, "
            "or a continuous plant"
        )
    return system


def _tolerance(value: Any, name: str) -> float:
    tolerance = number(value, name)
    if not 0 < tolerance < np.inf:
        raise ValueError(f"{name} is {value!r}; expected a positive number")
    if name == "rtol" and not _LEAST_RTOL <= tolerance < 1:
        raise ValueError(f"rtol is {value!r}; expected at least {_LEAST_RTOL:.3g}, rounding, and less than 1")
    return tolerance
