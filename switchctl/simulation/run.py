"""One run of a plant under switched digital controllers."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from switchctl.closed_loop import ClosedLoops, digital
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods import Method
from switchctl.methods.boundary import started
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.moments import root as factor
from switchctl.result import Schedule
from switchctl.rules import Rules
from switchctl.simulation.computer import Computer
from switchctl.simulation.plants import Plant, Stopped
from switchctl.simulation.replay import lasting
from switchctl.simulation.response import Run
from switchctl.simulation.surroundings import OperatingPoint, generator, limits, noise_root, start
from switchctl.simulation.surroundings import operating_point as _operating_point
from switchctl.validation import flag, whole_number

_ATOL = 1e-10


def simulate(
    plant: Any,
    modes: ClosedLoops,
    method: Method | Schedule,
    x0: Any,
    steps: int,
    *,
    rules: Rules | SwitchingGraph | None = None,
    saturation: Any = None,
    delay: bool = False,
    noise: Any = None,
    operating_point: Any = None,
    domain: Callable[[Array], float] | None = None,
    seed: Any = 0,
    rtol: float = 1e-8,
    atol: float | None = None,
) -> Run:
    """Run a plant, nonlinear or not, under the switched digital controllers of its loops.

    The controllers run at the samples and their output is held between them, while the plant's equations are
    integrated. What the modes only approximate is all there: the plant's nonlinearity, actuator limits, a computation
    delay, measurement noise.

    At sample k, with ``(x_e, u_e)`` the operating point, ``y_e`` the plant's output there and v the noise, mode i is
    decided from ``z = (x - x_e, zeta)`` (of modes with an estimator, from the estimate and how uncertain it is) and,
    with `Controllers` in the place of the equations,

    ``u = limit(u_e + output_i(zeta, x - x_e, y + v - y_e))`` and
    ``zeta+ = updated_i(zeta, x - x_e, y + v - y_e, u - u_e)``,

    so that controllers which track the one that acts follow what the actuator can do of it. The controllers are not
    told of a delay: zeta+ takes the u of this sample, the plant that of the sample before (at first u_e).

    Parameters
    ----------
    plant : control.NonlinearIOSystem or control.StateSpace
        Continuous, integrated by the Runge-Kutta method of order 5(4) of `scipy.integrate.solve_ivp`; or sampled with
        the modes' period. Its states, inputs and outputs are those of the plant that the loops were closed with.
    modes : ClosedLoops
        The loops, from ``close_loops(.., discretize="plant")``.
    method : Method or Schedule
        What decides: a method at every sample, from the state; or a schedule of these modes, replayed, its tail
        repeated.
    x0 : array_like, shape (n,), or Gaussian
        The plant's state at the start, or its distribution, from which one is drawn; or of the whole state, with the
        controllers' after the plant's, which otherwise begin as the loops say.
    steps : int
        Number of sampling periods.
    rules : Rules or SwitchingGraph, optional
        For a method, what limits or prices switching; a schedule has its own.
    saturation : (low, high), optional
        The least and the greatest input, numbers or arrays of shape (q,); infinite where there is no limit.
    delay : bool, optional
        Whether the input computed at a sample acts one sample later.
    noise : array_like, shape (p, p), or False, optional
        Covariance of white noise on what the controllers measure of the plant's output. By default the noise that the
        modes know: on the output, and on the plant's state at the samples; False for none at all. (Without an
        estimator, a controller fed by the state and the method see the state itself.)
    operating_point : (array_like, array_like), optional
        State and input that the loops were linearised about, as `control.find_operating_point` returns them; the origin
        by default. Shapes (n,) and (q,), or (n, steps + 1) and (q, steps) for a trajectory to be followed.
    domain : callable, optional
        A function of the plant's state, positive inside the domain that its equations are meant for; a run that leaves
        it stops there.
    seed : int, optional
        Of the initial state and the noise.
    rtol, atol : float, optional
        Relative and absolute tolerance of the integration. By default the absolute one is 1e-10 times the greatest
        state at the start, or 1e-10 where that is zero or above 1.

    Returns
    -------
    Run
        A `control.TimeResponseData` over the samples 0 .. N. At the last one nothing is decided: inputs and index are
        those of the step before. A run that can't go on (it leaves its domain, the plant's function raises or is not
        finite there, Ctrl-C) holds everything until then, and its ``status`` says so. What such a function raises in
        the first period because it is written wrongly (a name that isn't there, a wrong type or index) is raised.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind, such as modes given as matrices.
    ValueError
        If shapes or periods don't fit, the loops were closed in continuous time, the schedule is of other modes, or a
        value is out of range; or in the first period, if nothing can be decided or an algebraic loop isn't solved.

    Examples
    --------
    >>> def pendulum(t, x, u, params):
    ...     return [x[1], np.sin(x[0]) + u[0]]
    >>> plant = control.nlsys(pendulum, inputs=1, states=["angle", "rate"], outputs=2, name="pendulum")
    >>> linear = plant.linearize([0, 0], [0])
    >>> modes = close_loops(linear, {"stiff": [[20, 6]], "soft": [[3, 2]]}, dt=0.05)
    >>> simulate(plant, modes, Rollout(), [1.0, 0.0], steps=100, saturation=(-5, 5))
    Run: 101 samples, from 0 to 5
    ├── plant     pendulum
    ├── W2        1 -> 3.06187e-09
    ├── switches  5
    ├── use       stiff 26.0 %, soft 74.0 %
    └── ends      completed
    """
    loops = digital(modes)
    steps, random = whole_number(steps, "steps"), generator(seed)
    held = Plant(plant, loops, domain, rtol, _ATOL if atol is None else atol)
    q, p = held.system.ninputs, held.system.noutputs
    reference = _operating_point(operating_point, loops.plant_states, q, steps)
    _check_operating_point(held, reference, limits(saturation, q), operating_point is not None)
    delay, own = flag(delay, "delay"), noise is None
    root = noise_root(loops.measurement_noise if own else None if noise is False else noise, loops)
    disturbed = [factor(W) for W in loops.process_noise] if own and loops.process_noise is not None else None
    x, zeta = start(x0, loops, reference.at(0)[0], random)
    if atol is None:
        held.atol *= min(1.0, float(np.abs(x).max()) or 1.0)
    computer = Computer(
        held,
        loops,
        *_decisions(method, loops, rules, steps),
        zeta,
        reference=reference,
        saturation=limits(saturation, q),
        delay=delay,
        noise=lambda: np.zeros(p) if root is None else root @ random.standard_normal(p),
    )
    record, status = _Record(x, zeta), "completed"
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for k in tqdm(range(steps), "simulate", unit="step", delay=2, leave=False):
                if not held.margin(x) > 0:
                    raise Stopped("domain(x) is not positive")
                record.act(*computer.sample(k, x))
                mode, _, applied = record.acts[-1]
                x = held.advance(k * loops.dk, x, applied)
                if disturbed is not None:
                    x = x + disturbed[mode] @ random.standard_normal(len(x))
                record.arrive(x, computer.zeta)
    except KeyboardInterrupt:
        if not record.acts:
            raise
        status = INTERRUPTED
    except Stopped as stopped:
        status = f"{stopped.what} at {_time(loops, len(record.states) - 1, stopped.after)}: {stopped}"
    except Exception as error:
        if len(record.states) == 1:
            raise
        status = f"stopped at {_time(loops, len(record.states) - 1, 0.0)}: {type(error).__name__}: {error}"
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return record.response(held, loops, reference, status)


class _Record:
    """What a run has come to."""

    def __init__(self, x: Array, zeta: Array) -> None:
        self.states, self.n = [np.concatenate([x, zeta])], len(x)
        self.acts: list[tuple[int, Array, Array]] = []

    def act(self, mode: int, output: Array, applied: Array) -> None:
        """Note what acts from the latest sample on."""
        self.acts.append((mode, output, applied))

    def arrive(self, x: Array, zeta: Array) -> None:
        """Note the next sample's state."""
        self.states.append(np.concatenate([x, zeta]))

    def response(self, plant: Plant, modes: ClosedLoops, reference: OperatingPoint, status: str) -> Run:
        """The response until now; at a sample at which nothing acts yet, the input and the index before go on."""
        k, n = len(self.states) - 1, self.n
        modes_taken, outputs, inputs = map(list, zip(*self.acts, strict=True)) if self.acts else ([], [], [])
        index = [float(mode) for mode in modes_taken]
        if len(inputs) == k:
            inputs.append(inputs[-1] if inputs else np.full(plant.system.ninputs, np.nan))
            index.append(index[-1] if index else np.nan)
            try:
                outputs.append(plant.output(k * modes.dk, self.states[-1][:n], inputs[-1]))
            except Stopped:
                outputs.append(np.full(plant.system.noutputs, np.nan))
        states = np.array(self.states).T
        away = [state[:n] - reference.at(j)[0] for j, state in enumerate(self.states)]
        assert modes.controllers is not None
        return Run(
            np.arange(k + 1, dtype=float) * modes.dk,
            np.vstack([np.array(outputs).T, index]),
            states,
            np.array(inputs).T,
            sequence=np.array(modes_taken, dtype=np.intp),
            w2=np.sum(np.square(away), axis=1),
            status=status,
            names=modes.names,
            labels={
                "output_labels": [*plant.system.output_labels, "index"],
                "state_labels": [*plant.system.state_labels, *modes.controllers.states],
                "input_labels": plant.system.input_labels,
                "sysname": plant.system.name,
                "title": f"{plant.system.name} under switched controllers",
            },
        )


def _check_operating_point(plant: Plant, reference: OperatingPoint, low_high: Any, given: bool) -> None:
    """Refuse one that no controller can hold: its input out of reach, or not an equilibrium."""
    (low, high), (x_e, u_e) = low_high, reference.at(0)
    if reference.inputs.ndim == 1 and not ((low <= u_e) & (u_e <= high)).all():
        raise ValueError(
            f"saturation is ({low.tolist()}, {high.tolist()}), and the input at the operating point, {u_e.tolist()}, "
            "is beyond it"
        )
    if given and reference.states.ndim == 1 and reference.inputs.ndim == 1:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                moved = float(np.abs(plant.advance(0.0, x_e, u_e) - x_e).max())
            except Stopped as stopped:
                raise ValueError(f"at operating_point, {stopped}; give the one that the plant is for") from None
        if not moved <= 1e-3 * max(1.0, float(np.abs(x_e).max())):
            raise ValueError(
                f"operating_point is no equilibrium: in one period the state moves by {moved:.3g} from it; "
                "control.find_operating_point finds one"
            )


def replayed(schedule: Schedule, modes: ModeSet, steps: int) -> Array:
    """The modes of a schedule's first steps."""
    own = schedule.modes
    if own is not modes and not (own.names == modes.names and np.array_equal(own.A, modes.A)):
        raise ValueError(
            f"the schedule is of other modes ({', '.join(own.names)}) than these ({', '.join(modes.names)})"
        )
    return lasting(schedule, steps).sequence[:steps]


def _decisions(
    method: Any, modes: ClosedLoops, rules: Rules | SwitchingGraph | None, steps: int
) -> tuple[Callable[[Array], int], int]:
    """What names the mode at each sample, by the whole state, and the mode before the first."""
    if isinstance(method, Schedule):
        if rules is not None:
            raise ValueError("rules are for a method; a schedule was made under its own, so leave them out")
        sequence = iter(replayed(method, modes, steps).tolist())
        return (lambda z: next(sequence)), int(method.graph.last_mode[0])
    if not isinstance(method, Method):
        raise TypeError(f"method must be a Method such as Rollout(), or a Schedule, not {method!r}")
    graph = graph_under(modes, rules)
    scheduler = started(method, graph)
    scheduler.steps = steps
    return partial(scheduler.step, cov=modes.error_covariance), int(graph.last_mode[0])


def _time(modes: ModeSet, k: int, after: float) -> str:
    return f"step {k}" if modes.dt is True else f"{k * modes.dk + after:.6g} s"
