"""The controllers of one plant in one piece: what runs on the digital computer beside the plant."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import control
import numpy as np

from switchctl.inactive import (
    Inactive,
    TrackingNoise,
    check_initial,
    inactive_behaviour,
    initial_map,
    tracking_gain,
    tracking_noise,
)
from switchctl.moments import Array
from switchctl.sampling import Sampling, realised, same_period, sampled
from switchctl.storage import affordable
from switchctl.validation import frozen, real_array


class Controller(NamedTuple):
    """One controller: ``xi+ = F xi + G y``, ``u = -(H xi + D y)``, or fed by the plant's state in the place of y.

    ``noise`` is what its tracking gain is designed for.
    """

    name: str
    F: Array
    G: Array
    H: Array
    D: Array
    by_state: bool
    states: tuple[str, ...]
    noise: TrackingNoise | None
    given_sampled: bool = False

    @property
    def label(self) -> str:
        """How errors call it."""
        return f"controllers[{self.name!r}]"


@dataclass(frozen=True, eq=False)
class Controllers:
    """All controllers as one linear system that is told which of them acts.

    Its state zeta holds every controller's own, and the estimate of an observer where there is one. With controller i
    active,

    ``u = -(Hz_i zeta + Hx_i x + Hy_i y)`` and ``zeta+ = F_i zeta + Gx_i x + Gy_i y + Gu_i u``;

    where i takes over from j, ``zeta`` first becomes ``E_ji zeta + Ex_ji x``. x is the plant's state and y its output,
    ``C x + D u`` for a linear plant.

    Attributes
    ----------
    F, Gx, Gy, Gu : arrays, shapes (m, z, z), (m, z, n), (m, z, p) and (m, z, q)
        The state equation.
    Hz, Hx, Hy : arrays, shapes (m, q, z), (m, q, n) and (m, q, p)
        The output equation.
    E, Ex : arrays, shapes (m, m, z, z) and (m, m, z, n)
        Activation, by the controller before and after.
    initial : array, shape (z, n)
        zeta at the start as a function of the plant's state.
    names, states : tuples of str
        Of the controllers, and of the entries of zeta.
    """

    F: Array
    Gx: Array
    Gy: Array
    Gu: Array
    Hz: Array
    Hx: Array
    Hy: Array
    E: Array
    Ex: Array
    initial: Array
    names: tuple[str, ...]
    states: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in "F Gx Gy Gu Hz Hx Hy E Ex initial".split():
            frozen(getattr(self, name))

    @property
    def by_state(self) -> bool:
        """Whether they measure the plant's state."""
        return any(part.any() for part in (self.Gx, self.Hx, self.Ex))

    @property
    def by_output(self) -> bool:
        """Whether they measure the plant's output."""
        return bool(self.Gy.any() or self.Hy.any())

    def activated(self, before: int, mode: int, zeta: Array, x: Array) -> Array:
        """The state with which a controller begins to act, given the one that acted before (-1: none)."""
        if before < 0 or before == mode:
            return zeta
        return self.E[before, mode] @ zeta + self.Ex[before, mode] @ x

    def output(self, mode: int, zeta: Array, x: Array, y: Array) -> Array:
        """What the active controller asks for, u."""
        return -(self.Hz[mode] @ zeta + self.Hx[mode] @ x + self.Hy[mode] @ y)

    def updated(self, mode: int, zeta: Array, x: Array, y: Array, u: Array) -> Array:
        """The state at the next sample."""
        return self.F[mode] @ zeta + self.Gx[mode] @ x + self.Gy[mode] @ y + self.Gu[mode] @ u


def controller(
    plant: control.StateSpace, given: Any, name: str, period: float | bool, how: Sampling, continuous: bool
) -> Controller:
    """Read one controller: an array of gains, or a system, sampled unless the loop is to be closed in continuous time.

    Parameters
    ----------
    plant : control.StateSpace
        The plant.
    given : array_like, control.StateSpace or control.TransferFunction
        The controller.
    name : str
        Its name.
    period : float or True
        The sampling period of the modes.
    how : str, or (str, float)
        How it is sampled if it is continuous.
    continuous : bool
        Whether it is to stay continuous.

    Returns
    -------
    Controller
    """
    label, n, p, q = f"controllers[{name!r}]", plant.nstates, plant.noutputs, plant.ninputs
    if not isinstance(given, control.InputOutputSystem):
        if isinstance(given, tuple) and len(given) == 3 and np.ndim(given[0]) == 2:
            raise TypeError(f"{label} is a tuple of three, as control.lqr returns (K, S, E); pass K, its first entry")
        gain = np.atleast_2d(real_array(given, label))
        if gain.shape != (q, n):
            raise control.ControlDimension(
                f"{label} has shape {gain.shape}; expected {(q, n)}: the plant has {q} inputs and {n} states"
            )
        return Controller(name, np.zeros((0, 0)), np.zeros((0, n)), np.zeros((q, 0)), gain, True, (), None)
    if not isinstance(given, control.StateSpace | control.TransferFunction):
        raise TypeError(
            f"{label} must be a gain array, a StateSpace or a TransferFunction, not a {type(given).__name__}"
        )
    if given.noutputs != q or given.ninputs not in (p, n):
        raise control.ControlDimension(
            f"{label} has {given.ninputs} inputs and {given.noutputs} outputs; expected {p} inputs (the plant's "
            f"outputs; or {n}, its states) and {q} outputs (the plant's inputs)"
        )
    system = realised(given, label)
    noise = None
    if system.nstates:
        system, noise = _in_time(plant, system, label, period, how, continuous)
    else:
        _check_timebase(plant, system, label, period)
    states = tuple(f"{name}.{state}" for state in system.state_labels)
    return Controller(name, system.A, system.B, system.C, system.D, system.ninputs != p, states, noise, bool(given.dt))


def _in_time(
    plant: control.StateSpace,
    system: control.StateSpace,
    label: str,
    period: float | bool,
    how: Sampling,
    continuous: bool,
) -> tuple[control.StateSpace, TrackingNoise]:
    """A controller with states, at the samples or in continuous time, and the noise for its tracking gain."""
    if system.dt is None or system.dt is False:
        raise ValueError(
            f"{label} has states and dt = {system.dt}; say whether it is continuous (dt=0) or sampled (its period)"
        )
    if continuous and system.dt != 0:
        raise ValueError(f"{label} is sampled (dt = {system.dt}), so its loop can't be closed in continuous time")
    if system.dt != 0:
        _check_timebase(plant, system, label, period)
        return system, tracking_noise(system.A, system.B, system.C)
    if period is True:
        raise ValueError(f"{label} is continuous, but the modes have no sampling period; give dt in seconds")
    at_samples = sampled(system, float(period), how, label)
    noise = tracking_noise(at_samples.A, at_samples.B, at_samples.C)
    if continuous:
        return system, TrackingNoise(noise.state / period, noise.output * period, False)
    return at_samples, noise


def _check_timebase(plant: control.StateSpace, system: control.StateSpace, label: str, period: float | bool) -> None:
    """A controller with a timebase must run in the plant's, or at the sampling period of the modes."""
    dt = system.dt
    if dt is None or (dt == 0 and plant.dt == 0):
        return
    if dt == 0 or not same_period(dt, period):
        raise ValueError(
            f"{label} has dt = {dt}, but the modes are sampled with dt = {period}; expected the same timebase "
            "(a static controller may leave its dt unset)"
        )


def assembled(
    plant: control.StateSpace,
    each: list[Controller],
    inactive: list[Inactive],
    initial: list[Any],
    continuous: bool,
    observer: Array | None = None,
) -> Controllers:
    """Put controllers together, each with what it does while inactive and how it starts.

    With the gain of an observer of the sampled plant, zeta ends with its estimate, which takes the place of the
    plant's state for those fed by it.

    In continuous time F, Gx, Gy and Gu are those of the derivative; what `close_loops` can't integrate (a reset) it
    makes good after sampling.
    """
    m, n, p, q = len(each), plant.nstates, plant.noutputs, plant.ninputs
    ends = np.cumsum([0, *(len(c.F) for c in each)])
    z = int(ends[-1]) + (0 if observer is None else n)
    affordable(
        3 * 8 * (m * (z + n)) ** 2, f"what switches among {m} controllers with {z} states in all do", "use fewer"
    )
    estimate = slice(ends[-1], z)
    F, Gu, Gx, Gy = np.zeros((m, z, z)), np.zeros((m, z, q)), np.zeros((m, z, n)), np.zeros((m, z, p))
    Hz, Hx, Hy = np.zeros((m, q, z)), np.zeros((m, q, n)), np.zeros((m, q, p))
    E, Ex = np.tile(np.eye(z), (m, m, 1, 1)), np.zeros((m, m, z, n))
    start = np.zeros((z, n))
    for j, c in enumerate(each):
        own = slice(ends[j], ends[j + 1])
        fed, read, reset = (Gx, Hx, Ex) if c.by_state else (Gy, Hy, Ex)
        if observer is not None:
            reset = E[..., estimate]
            if c.by_state:
                fed, read = F[..., estimate], Hz[..., estimate]
        F[j, own, own], fed[j, own], Hz[j, :, own], read[j] = c.F, c.G, c.H, c.D
        kind, matrix = inactive_behaviour(inactive[j], c.label)
        check_initial(initial[j], c.label)
        if len(c.F) == 0:
            continue
        if matrix is not None:
            what, wide = ("tracking gain", len(c.H)) if kind == "track" else ("reset", n)
            matrix = real_array(matrix, f"the {what} of {c.label}", (len(c.F), wide))
        if m == 1:  # it is never inactive
            kind = "run"
        others = np.arange(m) != j
        if observer is not None and c.by_state and not (isinstance(initial[j], str) and initial[j] == "zero"):
            raise ValueError(
                f"initial of {c.label} must be 'zero': it is fed by an estimate, and doesn't know the state"
            )
        start[own] = initial_map(initial[j], c.F, c.G if c.by_state else c.G @ plant.C, c.label, not continuous)
        if kind == "track":
            assert c.noise is not None
            L = tracking_gain(c.F, c.H, c.noise, matrix, c.label)
            F[others, own, own], fed[others, own], Gu[others, own] = c.F - L @ c.H, c.G - L @ c.D, -L
        elif kind == "run":
            F[others, own, own], fed[others, own] = c.F, c.G
        elif kind == "hold":
            F[others, own, own] = 0 * c.F if continuous else np.eye(len(c.F))
        else:
            E[others, j, own] = 0.0
            reset[others, j, own] = 0.0 if matrix is None else matrix
    states = sum((c.states for c in each), ())
    if observer is not None:  # xe+ = A xe + B u + L (y - C xe - D u)
        L = observer
        F[:, estimate, estimate], Gy[:, estimate], Gu[:, estimate] = plant.A - L @ plant.C, L, plant.B - L @ plant.D
        start[estimate] = np.eye(n)
        states += tuple(f"estimate.{state}" for state in plant.state_labels)
    return Controllers(F, Gx, Gy, Gu, Hz, Hx, Hy, E, Ex, start, tuple(c.name for c in each), states)
