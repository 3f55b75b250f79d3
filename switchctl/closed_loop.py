"""From a python-control plant and its controllers to modes."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import control
import numpy as np

from switchctl.controllers import Controllers, assembled, controller
from switchctl.inactive import Inactive
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.sampling import Sampling, common_period, exact_step, plant_system, sampled
from switchctl.validation import positive_semidefinite, real_array

_DEFAULT_PERIOD = 0.01  # s
_ILL_POSED = 1e8


class ClosedLoops(ModeSet):
    """Modes that know the plant and the controllers they were made of; `close_loops` makes them.

    Attributes
    ----------
    plant : control.StateSpace or None
        The sampled plant; None where the loops were closed in continuous time.
    controllers : Controllers or None
        What runs beside it at the samples.
    """

    plant: control.StateSpace | None
    controllers: Controllers | None

    def __init__(
        self,
        matrices: Any,
        names: Any,
        dt: float | bool,
        *,
        plant: control.StateSpace | None,
        controllers: Controllers | None,
        **keywords: Any,
    ) -> None:
        super().__init__(matrices, names, dt, **keywords)
        object.__setattr__(self, "plant", None if plant is None else control.StateSpace(plant))
        object.__setattr__(self, "controllers", controllers)

    def __reduce__(self) -> tuple[Any, ...]:
        rebuild, arguments = super().__reduce__()
        return partial(rebuild, plant=self.plant, controllers=self.controllers), arguments


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
        leaves its controller unstable, or a loop is ill-posed (``I + K D`` singular, or nearly so).

    Examples
    --------
    >>> plant = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, name="axis", states=["angle", "rate"])
    >>> lead = control.tf([40, 40], [1, 10])
    >>> modes = close_loops(plant, {"stiff": [[40, 10]], "lead": lead}, dt=0.01)
    >>> modes
    ModeSet: 2 modes, 3 states, dt = 0.01 s
    ├── 0  stiff  spectral radius 0.986292
    └── 1  lead   spectral radius 0.98569
    >>> modes.states
    ('angle', 'rate', 'lead.x[0]')
    """
    if discretize not in ("plant", "closed_loop"):
        raise ValueError(f"discretize is {discretize!r}; expected 'plant' or 'closed_loop'")
    plant, continuous = plant_system(plant), discretize == "closed_loop"
    names, entries = _entries(controllers)
    period = common_period(plant, dt, entries, _DEFAULT_PERIOD)
    if plant.dt != 0 and continuous:
        raise ValueError(
            f"the plant is already sampled (dt = {plant.dt}), so its loops can't be closed in continuous time; "
            "use discretize='plant' or give the continuous plant"
        )
    hows = _by_controller(sampling, names, "sampling")
    each = [
        controller(plant, entry, name, period, how, continuous)
        for name, entry, how in zip(names, entries, hows, strict=True)
    ]
    behaviours, starts = _by_controller(inactive, names, "inactive"), _by_controller(initial, names, "initial")
    for told, what in ((inactive, "inactive"), (initial, "initial"), (sampling, "sampling")):
        _refuse_for_static(told, what, each)
    together = assembled(plant, each, behaviours, starts, continuous)
    if plant.dt == 0 and not continuous:
        plant = sampled(plant, float(period), "zoh", "the plant")
    A, gains = closed(plant, together)
    if continuous:
        A = np.stack([exact_step(Ai, float(period)) for Ai in A])
        A = _made_good(A, plant.nstates, each, behaviours)
    if not np.isfinite(A).all():
        raise ValueError(f"sampling with dt = {period} s overflows; choose a shorter period")
    n, z = plant.nstates, len(together.states)
    weight = np.zeros((n + z, n + z))
    weight[:n, :n] = np.eye(n)
    if Q is not None:
        given = real_array([[Q]] if np.ndim(Q) == 0 else Q, "Q")
        size = n + z if given.shape == (n + z, n + z) else n
        weight[:size, :size] = _weight(Q, "Q", size)
    if R is not None:
        weight = weight + np.swapaxes(gains, -1, -2) @ _weight(R, "R", plant.ninputs) @ gains
    identity, nothing = np.eye(n), np.zeros((n, z))
    return ClosedLoops(
        A,
        names,
        period,
        Q=weight,
        gains=gains,
        states=(*plant.state_labels, *together.states),
        plant_states=n,
        activation=_blocks(np.broadcast_to(identity, (len(each), len(each), n, n)), nothing, together.Ex, together.E),
        initial=np.vstack([identity, together.initial]),
        plant=None if continuous else plant,
        controllers=None if continuous else together,
    )


def closed(plant: control.StateSpace, controllers: Controllers) -> tuple[Array, Array]:
    """The loops of one plant with each controller: the matrices of the whole state, and the feedback ``u = -K z``."""
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    loop = np.eye(plant.ninputs) + controllers.Hy @ D
    for name, Hy, each in zip(controllers.names, controllers.Hy, loop, strict=True):
        # of what cancels where the loop is ill-posed
        size = 1 + np.linalg.norm(Hy, 2) * np.linalg.norm(D, 2)
        condition = size / max(np.linalg.norm(each, -2), np.finfo(float).tiny)
        if not condition < _ILL_POSED:
            raise ValueError(
                f"the loop of controllers[{name!r}] is ill-posed, or nearly so: I + K D, D the plant's feedthrough, "
                f"has condition number {condition:.3g} (at most {_ILL_POSED:.0e} is accepted); change the gain or "
                "the feedthrough"
            )
    gains = np.linalg.solve(loop, np.concatenate([controllers.Hx + controllers.Hy @ C, controllers.Hz], axis=2))
    m, z = len(gains), len(controllers.states)
    # x+ = A x + B u and zeta+ = F zeta + Gx x + Gy (C x + D u) + Gu u, with u = -K (x, zeta)
    open_loop = _blocks(
        np.broadcast_to(A, (m, *A.shape)), np.zeros((len(A), z)), controllers.Gx + controllers.Gy @ C, controllers.F
    )
    into = np.concatenate([np.broadcast_to(B, (m, *B.shape)), controllers.Gu + controllers.Gy @ D], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        return open_loop - into @ gains, gains


def _blocks(A: Array, B: Array, C: Array, D: Array) -> Array:
    """The matrices [[A, B], [C, D]], one for each of a batch."""
    B = np.broadcast_to(B, (*A.shape[:-2], *B.shape[-2:]))
    return np.concatenate([np.concatenate([A, B], axis=-1), np.concatenate([C, D], axis=-1)], axis=-2)


def _made_good(A: Array, n: int, each: list[Any], behaviours: list[Inactive]) -> Array:
    """What sampling a closed loop can't know or rounds: the states held, and those that wait for a reset at zero."""
    begin = n
    for j, c in enumerate(each):
        own = slice(begin, begin := begin + len(c.F))
        kind = behaviours[j] if isinstance(behaviours[j], str) else behaviours[j][0]
        if kind in ("hold", "reset"):
            others = np.arange(len(each)) != j
            A[others, own] = 0.0
            A[others, own, own] = np.eye(len(c.F)) * (kind == "hold")
    return A


def _weight(value: Any, name: str, n: int) -> Array:
    """A symmetric positive semidefinite matrix; a number will do for one by one."""
    return positive_semidefinite(real_array([[value]] if np.ndim(value) == 0 else value, name, (n, n)), name)


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
