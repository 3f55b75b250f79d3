"""From a python-control plant and its controllers to modes."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import control
import numpy as np
from scipy.linalg import expm

from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.validation import positive_semidefinite, real_array, sampling_period

_DEFAULT_PERIOD = 0.01  # s


def close_loops(
    plant: control.StateSpace | control.TransferFunction,
    controllers: Mapping[str, Any] | Sequence[Any],
    dt: float | None = None,
    discretize: Literal["plant", "closed_loop"] = "plant",
    *,
    Q: Any = None,
    R: Any = None,
) -> ModeSet:
    """Close the loop of one plant with each of several controllers: the modes.

    The two orders of sampling differ, and both are meant. ``"plant"`` is what a digital controller does: the
    plant is sampled by zero-order hold, and the gain closes the loop at the samples, ``A_i = Ad - Bd K_i``.
    ``"closed_loop"`` is what the paper's second example does: the loop is closed in continuous time and then
    sampled exactly, ``A_i = expm((A - B K_i) dt)``.

    Parameters
    ----------
    plant : control.StateSpace or control.TransferFunction
        Continuous or sampled. A transfer function is realised by `control.ss`; gain arrays, weights, the initial
        state and W2 are then in the states of that realisation. A nonlinear plant has to be linearised first,
        ``plant.linearize(x, u)``.
    controllers : dict or sequence
        One entry a mode, named by the dict (or "C0", "C1", ..). A gain array of shape (inputs, states) means
        ``u = -K x``, the sign of `control.lqr`. A static `StateSpace` or `TransferFunction` means what
        `control.feedback` means by it: ``u = -K y`` with ``y = C x + D u``; where its number of inputs fits the
        states and not the outputs of the plant, it is fed by the state.
    dt : float, optional
        Sampling period in seconds. By default 0.01 for a continuous plant and its own for a sampled one.
    discretize : {"plant", "closed_loop"}, optional
        The order of sampling and closing the loop.
    Q : array_like, shape (n, n), optional
        Weight of the state in the cost, symmetric positive semidefinite; the identity by default.
    R : array_like, shape (inputs, inputs), optional
        Weight of the control effort ``u' R u``, symmetric positive semidefinite; none by default. The stage
        weight of mode i is ``Q_i = Q + K_i' R K_i``.

    Returns
    -------
    ModeSet
        With the state feedback that each controller amounts to in ``.gains``.

    Raises
    ------
    TypeError
        If the plant or a controller is of another kind (nonlinear, dynamic, a response, ..).
    ValueError
        If shapes don't fit, an entry is not finite, timebases differ, or a loop is ill-posed (``I + K D``
        singular).

    Examples
    --------
    >>> plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, name="axis")
    >>> gains = {"stiff": [[40, 10]], "soft": [[1, 1]]}
    >>> close_loops(plant, gains, dt=0.01)
    ModeSet: 2 modes, 2 states, dt = 0.01 s
    ├── 0  stiff  spectral radius 0.949737
    └── 1  soft   spectral radius 0.995013
    """
    if discretize not in ("plant", "closed_loop"):
        raise ValueError(f"discretize is {discretize!r}; expected 'plant' or 'closed_loop'")
    plant = _state_space(plant)
    names, entries = _entries(controllers)
    period = _period(plant, dt, entries)
    gains = np.stack([_gain(plant, entry, name, period) for name, entry in zip(names, entries, strict=True)])
    if plant.dt != 0 and discretize == "closed_loop":
        raise ValueError(
            f"the plant is already sampled (dt = {plant.dt}), so its loops can't be closed in continuous time; "
            "use discretize='plant' or give the continuous plant"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        if discretize == "closed_loop":
            modes = expm((plant.A - plant.B @ gains) * float(period))
        else:
            sampled = control.sample_system(plant, float(period), method="zoh") if plant.dt == 0 else plant
            modes = sampled.A - sampled.B @ gains
    if not np.isfinite(modes).all():
        raise ValueError(f"sampling with dt = {period} s overflows; choose a shorter period")
    n = plant.nstates
    weight = np.eye(n) if Q is None else _weight(Q, "Q", n)
    if R is not None:
        effort = _weight(R, "R", plant.ninputs)
        weight = weight + np.swapaxes(gains, -1, -2) @ effort @ gains
    return ModeSet(modes, names, period, Q=weight, gains=gains, states=plant.state_labels)


def _weight(value: Any, name: str, n: int) -> Array:
    """A symmetric positive semidefinite matrix; a number will do for one by one."""
    return positive_semidefinite(real_array([[value]] if np.ndim(value) == 0 else value, name, (n, n)), name)


def _state_space(plant: Any) -> control.StateSpace:
    if isinstance(plant, control.TransferFunction):
        try:
            plant = control.ss(plant)
        except control.ControlMIMONotImplemented:
            raise ValueError(
                "plant is a transfer function with several inputs or outputs, which python-control can't realise "
                "without slycot; give it as a StateSpace"
            ) from None
    if not isinstance(plant, control.StateSpace):
        hint = ""
        if isinstance(plant, control.NonlinearIOSystem):
            hint = "; linearise it about an equilibrium first: plant.linearize(x_equilibrium, u_equilibrium)"
        raise TypeError(f"plant must be a StateSpace or TransferFunction, not a {type(plant).__name__}{hint}")
    for name in "ABCD":
        real_array(getattr(plant, name), f"plant.{name}")
    if plant.nstates == 0 or plant.ninputs == 0:
        raise control.ControlDimension(
            f"plant has {plant.nstates} states and {plant.ninputs} inputs; expected at least one of each"
        )
    if plant.dt is None or plant.dt is False:
        raise ValueError(f"plant.dt is {plant.dt}; say whether the plant is continuous (dt=0) or sampled (its period)")
    return plant


def _period(plant: control.StateSpace, dt: Any, controllers: list[Any]) -> float | bool:
    """The sampling period of the modes: the plant's, the argument's or, where neither tells, a controller's."""
    given = None if dt is None else sampling_period(dt)
    if plant.dt == 0:
        if given is True:
            raise ValueError("dt is True, but the plant is continuous; expected a sampling period in seconds")
        return _DEFAULT_PERIOD if given is None else given
    own = sampling_period(plant.dt, "plant.dt")
    if own is True and given in (None, True):
        told = (getattr(controller, "dt", None) for controller in controllers)
        return next((sampling_period(dt) for dt in told if dt not in (None, True, 0)), True)
    if given is None or _same_period(own, given):
        return given if own is True and given is not None else own
    raise ValueError(f"dt is {given} s, but the plant is sampled with dt = {own} s; expected the same, or no dt")


def _same_period(a: float | bool, b: float | bool) -> bool:
    """Whether two discrete timebases agree; True, a period not told, agrees with any."""
    return a is True or b is True or bool(np.isclose(a, b, rtol=1e-9, atol=0))


def _entries(controllers: Any) -> tuple[list[str], list[Any]]:
    if isinstance(controllers, Mapping):
        names, entries = list(controllers), list(controllers.values())
    elif isinstance(controllers, Sequence) and not isinstance(controllers, str):
        names, entries = [f"C{i}" for i in range(len(controllers))], list(controllers)
    else:
        raise TypeError(f"controllers must be a dict or a list of controllers, not a {type(controllers).__name__}")
    if not entries:
        raise ValueError("controllers is empty; give at least one controller")
    return names, entries


def _gain(plant: control.StateSpace, controller: Any, name: str, period: float | bool) -> Array:
    """The state feedback ``u = -K x`` that a static controller amounts to."""
    label = f"controllers[{name!r}]"
    if not isinstance(controller, control.InputOutputSystem):
        if isinstance(controller, tuple) and len(controller) == 3 and np.ndim(controller[0]) == 2:
            raise TypeError(f"{label} is a tuple of three, as control.lqr returns (K, S, E); pass K, its first entry")
        gain = np.atleast_2d(real_array(controller, label))
        if gain.shape != (plant.ninputs, plant.nstates):
            raise control.ControlDimension(
                f"{label} has shape {gain.shape}; expected {(plant.ninputs, plant.nstates)}: the plant has "
                f"{plant.ninputs} inputs and {plant.nstates} states"
            )
        return gain
    if isinstance(controller, control.TransferFunction) and controller.issiso():
        controller = control.ss(controller)
    if not isinstance(controller, control.StateSpace):
        raise TypeError(f"{label} must be a gain array or a static StateSpace, not a {type(controller).__name__}")
    if controller.nstates > 0:
        raise TypeError(
            f"{label} has {controller.nstates} states; expected a static controller: a gain array or a StateSpace "
            "without states"
        )
    _check_timebase(plant, controller, label, period)
    D = real_array(controller.D, f"{label}.D")
    if controller.noutputs != plant.ninputs or controller.ninputs not in (plant.noutputs, plant.nstates):
        raise control.ControlDimension(
            f"{label} has {controller.ninputs} inputs and {controller.noutputs} outputs; expected {plant.noutputs} "
            f"inputs (the plant's outputs) and {plant.ninputs} outputs (the plant's inputs)"
        )
    if controller.ninputs != plant.noutputs:
        return D
    # u = -D (C x + D_plant u), so (I + D D_plant) u = -D C x
    loop = np.eye(plant.ninputs) + D @ plant.D
    size = 1 + np.linalg.norm(D, 2) * np.linalg.norm(plant.D, 2)  # of what cancels where the loop is ill-posed
    condition = size / max(np.linalg.norm(loop, -2), np.finfo(float).tiny)
    if not condition < 1e12:
        raise ValueError(
            f"the loop of {label} is ill-posed: I + K D, D the plant's feedthrough, is singular to working accuracy "
            f"(condition number {condition:.3g}); change the gain or the feedthrough"
        )
    return np.linalg.solve(loop, D @ plant.C)


def _check_timebase(plant: control.StateSpace, controller: Any, label: str, period: float | bool) -> None:
    """A controller with a timebase must run in the plant's, or at the sampling period of the modes."""
    dt = controller.dt
    if dt is None or (dt == 0 and plant.dt == 0):
        return
    if dt == 0 or not _same_period(dt, period):
        raise ValueError(
            f"{label} has dt = {dt}, but the modes are sampled with dt = {period}; expected the same timebase "
            "(a static controller may leave its dt unset)"
        )
