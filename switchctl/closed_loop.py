"""From a python-control plant and its controllers to modes."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import control
import numpy as np

from switchctl import mode_checks
from switchctl.controllers import Controllers, assembled, controller
from switchctl.estimation import error_covariance, filter_gain
from switchctl.feedback import Loops, blocks, closed, sampled_loops, waiting
from switchctl.inactive import Inactive
from switchctl.modes import Cost, ModeSet
from switchctl.moments import Array
from switchctl.sampling import (
    Sampling,
    common_period,
    finite_named,
    plant_system,
    recipe,
    sampled,
    sampled_noise,
    sampling_method,
)
from switchctl.validation import frozen, matrix_or_number, real_array, semidefinite

_DEFAULT_PERIOD = 0.01  # s
_TOLD = ("controllers", "process_noise", "measurement_noise", "error_covariance")


class ClosedLoops(ModeSet):
    """Modes that know the plant and the controllers they were made of; `close_loops` makes them.

    Parameters
    ----------
    matrices, names, dt, **keywords : see `ModeSet`
        As for `ModeSet`.
    plant, controllers, process_noise, measurement_noise, error_covariance : see below
        The attributes.

    Attributes
    ----------
    plant : control.StateSpace or None
        The sampled plant; None where the loops were closed in continuous time.
    controllers : Controllers or None
        What runs beside it at the samples.
    process_noise : array, shape (m, n, n), or None
        Covariance of the process noise on the plant's state in a step, by mode.
    measurement_noise : array, shape (p, p), or None
        The covariance V.
    error_covariance : array, shape (n, n), or None
        Of the plant's state given the estimate, in the steady state of the filter, where there is one: what to tell
        `Scheduler.step` besides the estimate.

    Raises
    ------
    TypeError, ValueError
        If the plant, the controllers or the noise are not what they should be; else as `ModeSet`.
    """

    plant: control.StateSpace | None
    controllers: Controllers | None
    process_noise: Array | None
    measurement_noise: Array | None
    error_covariance: Array | None

    def __init__(
        self,
        matrices: Any,
        names: Any,
        dt: float | bool,
        *,
        plant: control.StateSpace | None,
        controllers: Controllers | None,
        process_noise: Array | None = None,
        measurement_noise: Array | None = None,
        error_covariance: Array | None = None,
        **keywords: Any,
    ) -> None:
        super().__init__(matrices, names, dt, **keywords)
        for name, told, kind in (("plant", plant, control.StateSpace), ("controllers", controllers, Controllers)):
            if told is not None and not isinstance(told, kind):
                raise TypeError(f"{name} must be a {kind.__name__} or None, not a {type(told).__name__}")
        if plant is not None:
            plant = control.StateSpace(plant)
            finite_named(plant, "plant")
            if plant.nstates != self.plant_states:
                raise control.ControlDimension(f"plant has {plant.nstates} states; expected {self.plant_states}")
            for matrix in "ABCD":
                frozen(getattr(plant, matrix))
        object.__setattr__(self, "plant", plant)
        object.__setattr__(self, "controllers", controllers)
        noises = {"process_noise": process_noise, "measurement_noise": measurement_noise}
        for name, value in {**noises, "error_covariance": error_covariance}.items():
            object.__setattr__(self, name, None if value is None else frozen(real_array(value, name)))

    def __reduce__(self) -> tuple[Any, ...]:
        rebuild, arguments = super().__reduce__()
        told = {name: getattr(self, name) for name in _TOLD}
        made = None if self.plant is None else recipe(self.plant)
        return partial(_rebuilt, partial(rebuild, **told), made), arguments


def _rebuilt(rebuild: Any, plant: Callable[[], Any] | None, *arguments: Any) -> Any:
    return rebuild(*arguments, plant=None if plant is None else plant())


def close_loops(
    plant: control.StateSpace | control.TransferFunction,
    controllers: Mapping[str, Any] | Sequence[Any],
    dt: float | None = None,
    discretize: Literal["plant", "closed_loop"] = "plant",
    *,
    Q: Any = None,
    R: Any = None,
    sampling: Sampling | Mapping[str, Sampling] = "tustin",
    inactive: Inactive | Mapping[str, Inactive] = "track",
    initial: Any = "zero",
    W: Any = None,
    V: Any = None,
    estimator: Any = None,
    cost: Cost = "total",
) -> "ClosedLoops":
    """Close the loop of one plant with each of several controllers: the modes.

    The two orders of sampling differ, and both are meant. ``"plant"`` is what a digital controller does: the
    plant is sampled by zero-order hold, and the controller closes the loop at the samples, ``A_i = Ad - Bd K_i``.
    ``"closed_loop"`` is what the paper's second example does: the loop is closed in continuous time and then
    sampled exactly, ``A_i = expm((A - B K_i) dt)``.

    Controllers may have states of their own. The state of the modes is then the plant's and, after it, that of every
    controller, and the modes say what each controller does while another one acts (``inactive``). What happens to its
    state when it takes over is no part of a mode but of the switch: ``ModeSet.activation``.

    Parameters
    ----------
    plant : control.StateSpace or control.TransferFunction
        Continuous or sampled. A transfer function is realised by `control.ss`; gain arrays, weights, the initial
        state and W2 are then in the states of that realisation. A nonlinear plant has to be linearised first,
        ``plant.linearize(x, u)``.
    controllers : dict or sequence
        One entry a mode, named by the dict (or "C0", "C1", ..). A gain array of shape (inputs, states) means
        ``u = -K x``, the sign of `control.lqr`. A `StateSpace` or `TransferFunction` C means what `control.feedback`
        means by it: ``u = -C y`` with ``y = C x + D u``; where its number of inputs fits the states and not the
        outputs of the plant, it is fed by the state.
    dt : float, optional
        Sampling period in seconds. By default 0.01 for a continuous plant and its own for a sampled one.
    discretize : {"plant", "closed_loop"}, optional
        The order of sampling and closing the loop.
    Q : array_like, shape (n, n), optional
        Weight of the plant's state in the cost (or of the whole state), symmetric positive semidefinite; the identity
        by default: controllers' states cost nothing.
    R : array_like, shape (inputs, inputs), optional
        Weight of the control effort ``u' R u``, symmetric positive semidefinite; none by default. The stage
        weight of mode i is ``Q_i = Q + K_i' R K_i``.
    sampling : str, (str, float), or dict of these by controller, optional
        How continuous controllers are sampled: a method of `control.sample_system`, "tustin" by default, or such a
        method with the frequency in rad/s at which it is to be exact, ``("tustin", 6.0)``.
    inactive : str, tuple, or dict of these by controller, optional
        What a controller does while it isn't active. ``"track"`` (default): an observer makes its state follow, so that
        its output would match the one that acts; it takes over without a jump, and its state can't run away. The gain
        may be given, ``("track", L)`` for ``xi+ = F xi + G y + L (-u - H xi - D y)``. ``"reset"``: it takes over from
        zero, or ``("reset", Z)`` from ``Z x``. ``"hold"``: its state stays as it was; ``"run"``: it goes on in
        parallel, fed by the plant.
    initial : str, array_like, or dict of these by controller, optional
        The controllers' states at the start, as a function of the plant's: ``"zero"`` (default), ``"settled"`` on the
        plant's output at the start, or a matrix.
    W : array_like, shape (n, n) or (m, n, n), optional
        Process noise on the plant's state, for all modes or one each: the intensity of white noise in the units of the
        state, squared, per second for a continuous plant, which is sampled exactly; the covariance per step for a
        sampled one. None by default.
    V : array_like, shape (outputs, outputs), optional
        Covariance of the measurement noise of a sample of y; none by default.
    estimator : "kalman" or array_like, shape (n, outputs), optional
        An estimator of the plant's state, for the controllers that are fed by it: the steady Kalman filter (as
        `control.dlqe`, in whatever units), or one with this gain, ``xe+ = A xe + B u + L (y - C xe - D u)``. Its
        estimate joins the state of the modes, so moments and costs know what it does. By default the state is measured.
    cost : "total", ("discounted", factor) or "average", optional
        What a cost for ever is, as for `ModeSet`. With noise the total is infinite, and a choice is asked for.

    Returns
    -------
    ClosedLoops
        A `ModeSet` with the feedback of the whole state that each controller amounts to in ``.gains``, and the sampled
        plant and controllers in ``.plant`` and ``.controllers``.

    Raises
    ------
    TypeError
        If the plant or a controller is of another kind (nonlinear, a response, ..).
    ValueError
        If shapes don't fit, an entry is not finite, timebases differ, a transfer function is improper, a tracking gain
        leaves its controller unstable, an estimate doesn't converge, noise is indefinite, or a loop is ill-posed
        (``I + K D`` singular, or nearly so).

    Examples
    --------
    >>> plant = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, name="axis", states=["angle", "rate"])
    >>> lead = control.tf([40, 40], [1, 10])
    >>> modes = close_loops(plant, {"stiff": [[40, 10]], "lead": lead}, dt=0.01)
    >>> modes
    ModeSet: 2 modes, 3 states, dt = 0.01 s
    ├── 0  stiff  spectral radius 0.949737
    └── 1  lead   spectral radius 0.98569
    >>> modes.states
    ('angle', 'rate', 'lead.x[0]')
    """
    if not isinstance(discretize, str) or discretize not in ("plant", "closed_loop"):
        raise ValueError(f"discretize is {discretize!r}; expected 'plant' or 'closed_loop'")
    plant, continuous = plant_system(plant), discretize == "closed_loop"
    names, entries = _entries(controllers)
    period = common_period(plant, dt, entries, _DEFAULT_PERIOD)
    if plant.dt != 0 and continuous:
        raise ValueError(
            f"the plant is already sampled (dt = {plant.dt}), so its loops can't be closed in continuous time; "
            "use discretize='plant' or give the continuous plant"
        )
    hows = [sampling_method(how) for how in _by_controller(sampling, names, "sampling")]
    if continuous and sampling != "tustin":
        raise ValueError(f"sampling is {sampling!r}, but loops closed in continuous time sample no controller")
    each = [
        controller(plant, entry, name, period, how, continuous)
        for name, entry, how in zip(names, entries, hows, strict=True)
    ]
    behaviours, starts = _by_controller(inactive, names, "inactive"), _by_controller(initial, names, "initial")
    for told, what in ((inactive, "inactive"), (initial, "initial"), (sampling, "sampling")):
        _refuse_for_static(told, what, each)
    noise = np.zeros((len(each), plant.nstates, plant.nstates))
    if W is not None:
        noise = mode_checks.noise(matrix_or_number(W, "W", plant.nstates), noise.shape)
    measured = None if V is None else semidefinite(V, "V", plant.noutputs)
    if continuous and not (V is None and estimator is None):
        raise ValueError("V and estimator are of samples; loops closed in continuous time have none")
    if plant.dt == 0 and not continuous:
        noise = np.stack([sampled_noise(plant.A, Wi, float(period)) for Wi in noise])
        plant = sampled(plant, float(period), "zoh", "the plant")
    L = None if estimator is None else filter_gain(plant, estimator, noise, measured)
    together = assembled(plant, each, behaviours, starts, continuous, L)
    if V is not None and not together.by_output:
        raise ValueError("V is the noise of the plant's output, and no controller or estimator measures it")
    loops, n, z = closed(plant, together), plant.nstates, len(together.states)
    A, entire = loops.A, np.zeros_like(loops.A)
    entire[:, :n, :n] = noise
    if measured is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            entire = entire + loops.noise @ measured @ np.swapaxes(loops.noise, -1, -2)
    if continuous:
        A, entire = sampled_loops(A, entire, float(period), list(waiting(n, each, behaviours)))
    if not (np.isfinite(A).all() and np.isfinite(entire).all()):
        raise ValueError(f"sampling with dt = {period} s overflows; choose a shorter period")
    weight, offset = _costs(Q, R, loops, n, measured)
    identity, nothing = np.eye(n), np.zeros((n, z))
    return ClosedLoops(
        A,
        names,
        period,
        Q=weight,
        gains=loops.gains,
        states=(*plant.state_labels, *together.states),
        plant_states=n,
        activation=blocks(np.broadcast_to(identity, (len(each), len(each), n, n)), nothing, together.Ex, together.E),
        initial=np.vstack([identity, together.initial]),
        estimate_states=0 if L is None else n,
        W=entire,
        offset=offset,
        cost=cost,
        plant=None if continuous else plant,
        controllers=None if continuous else together,
        process_noise=noise if noise.any() and not continuous else None,
        measurement_noise=measured,
        error_covariance=None if L is None else error_covariance(plant, L, noise, measured),
    )


def digital(modes: Any) -> ClosedLoops:
    """Loops with controllers that run at the samples."""
    if not isinstance(modes, ClosedLoops):
        plain = ": a plain ModeSet, as of a schedule read from a file, knows no plant and no controllers"
        raise TypeError(
            f"modes must be what close_loops returns, not a {type(modes).__name__}{plain * isinstance(modes, ModeSet)}"
        )
    if modes.controllers is None:
        raise ValueError(
            "these loops were closed in continuous time, so no controller runs at the samples; "
            'close them with discretize="plant"'
        )
    return modes


def _costs(Q: Any, R: Any, loops: Loops, n: int, measured: Array | None) -> tuple[Array, Array]:
    """The stage weights of the whole state, and what the effort that measurement noise makes costs in each mode."""
    m, size, q = len(loops.A), loops.A.shape[-1], loops.gains.shape[1]
    weight = np.zeros((size, size))
    weight[:n, :n] = np.eye(n)
    if Q is not None:
        told = matrix_or_number(Q, "Q", n)
        counted = size if told.shape == (size, size) else n
        weight[:counted, :counted] = semidefinite(told, "Q", counted)
    if R is None:
        return weight, np.zeros(m)
    effort = semidefinite(R, "R", q)
    offset = np.zeros(m)
    with np.errstate(over="ignore", invalid="ignore"):
        if measured is not None:
            offset = np.einsum("kij,jl,kml,im->k", loops.by_noise, measured, loops.by_noise, effort)
        weights = weight + np.swapaxes(loops.gains, -1, -2) @ effort @ loops.gains
    if not (np.isfinite(weights).all() and np.isfinite(offset).all()):
        raise ValueError("R: the cost of the effort, K' R K, exceeds the floating-point range; scale inputs or states")
    return weights, offset


def _entries(controllers: Any) -> tuple[list[str], list[Any]]:
    if isinstance(controllers, Mapping):
        names, entries = list(controllers), list(controllers.values())
    elif isinstance(controllers, Sequence) and not isinstance(controllers, str):
        names, entries = [f"C{i}" for i in range(len(controllers))], list(controllers)
    else:
        raise TypeError(f"controllers must be a dict or a list of controllers, not a {type(controllers).__name__}")
    if not entries:
        raise ValueError("controllers is empty; give at least one controller")
    for name in names:
        if not isinstance(name, str) or not name:
            raise TypeError(f"controllers has an entry named {name!r}; names must be non-empty strings")
    return names, entries


def _by_controller(value: Any, names: list[str], argument: str) -> list[Any]:
    """One entry for each controller, from one for all or a dict."""
    default = {"sampling": "tustin", "inactive": "track", "initial": "zero"}[argument]
    if not isinstance(value, Mapping):
        return [value] * len(names)
    for name in value:
        if name not in names:
            raise KeyError(f"{argument} names {name!r}, and the controllers are {', '.join(map(str, names))}")
    return [value.get(name, default) for name in names]


def _refuse_for_static(value: Any, argument: str, each: list[Any]) -> None:
    """A choice made for a controller without states would be ignored."""
    if isinstance(value, Mapping):
        for c in each:
            if c.name in value and len(c.F) == 0:
                raise ValueError(f"{argument} names {c.name!r}, which has no states of its own; leave it out")
            if argument == "sampling" and c.name in value and c.given_sampled:
                raise ValueError(f"sampling names {c.name!r}, which is sampled already; leave it out")
