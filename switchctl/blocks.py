"""Running methods as blocks of python-control: sampled systems whose memory is their state."""

from collections.abc import Sequence
from typing import Any

import control
import numpy as np

from switchctl.closed_loop import ClosedLoops, digital
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods import Method, Scheduler
from switchctl.methods.boundary import require_method, started
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.rules import Rules
from switchctl.validation import flag, real_array


def scheduler_system(
    method: Method,
    modes: ModeSet,
    *,
    rules: Rules | SwitchingGraph | None = None,
    covariance: bool = False,
    name: str = "scheduler",
) -> control.NonlinearIOSystem:
    """Make a running method a block of python-control: the state's moments in, the controller index out.

    The block's state is the scheduler's memory, all zero at the start, so that its outputs may be asked for as often
    and in whatever order python-control likes.

    Parameters
    ----------
    method : Method
        How to decide.
    modes : ModeSet
        The modes.
    rules : Rules or SwitchingGraph, optional
        What limits or prices switching; nothing by default.
    covariance : bool, optional
        Whether the covariance of the state is an input too; by default the state is known.
    name : str, optional
        The block's name.

    Returns
    -------
    control.NonlinearIOSystem
        Inputs: the mean of the state, named as the modes' states ("_" for "."), then the covariance row by row,
        "P[0,0]", "P[0,1]", .., as python-control's estimators name it. Output: "index".

    Raises
    ------
    TypeError
        If the method is not a method.
    ValueError
        If the method can't work with these modes and rules; from the block, if an input is not finite, the covariance
        is no covariance, or the state is none that the block has made.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], states=["p", "v"], dt=0.1)
    >>> block = scheduler_system(RecedingHorizon(horizon=20), modes)
    >>> block.input_labels, block.output_labels, block.dt
    (['p', 'v'], ['index'], 0.1)
    >>> means = np.array([[1.0, 0.9, 1.0], [1.0, 0.8, 0.0]])
    >>> control.input_output_response(block, np.arange(3) * 0.1, means).outputs[0].tolist()
    [1.0, 1.0, 0.0]
    """
    scheduler = _started(method, modes, rules)
    n = modes.A.shape[-1]
    entries = [f"P[{i},{j}]" for i in range(n) for j in range(n)] if flag(covariance, "covariance") else []
    return _system(_Deciding(scheduler, n), [*modes.states, *entries], [], [], scheduler, name)


def switched_controller(
    method: Method,
    modes: ClosedLoops,
    *,
    rules: Rules | SwitchingGraph | None = None,
    name: str = "controller",
) -> control.NonlinearIOSystem:
    """Make all controllers and the method that switches them one block of python-control: measurements in, u out.

    Connected by `control.interconnect` to the sampled plant, without a change of sign, it does at each sample what a
    `Schedule` predicts; connected to another plant, a nonlinear one or one with disturbances, it reacts to that. Its
    inputs and outputs have the names of the plant's signals. In python-control both sides of a loop are
    sampled; to run the continuous plant between the samples, use `simulate`.

    Parameters
    ----------
    method : Method
        How to decide.
    modes : ClosedLoops
        From ``close_loops(.., discretize="plant")``.
    rules : Rules or SwitchingGraph, optional
        What limits or prices switching; nothing by default.
    name : str, optional
        The block's name.

    Returns
    -------
    control.NonlinearIOSystem
        Inputs: the plant's state, which the method needs, each entry under the name of the plant's output that puts it
        out as it is, or under its own name; then the plant's other outputs, where a controller measures them. With an
        estimator in the modes: the plant's outputs. Outputs: the plant's inputs, and "index". State: those of the
        controllers, with the estimate, and the scheduler's memory. All zero means the start; what the controllers'
        states hold there is added to what ``close_loops(.., initial=..)`` gives them, or, where the state isn't
        measured, is where they start.

    Raises
    ------
    TypeError
        If the method is not a method, or the modes are none that `close_loops` made.
    ValueError
        If the loops were closed in continuous time, the method can't work with these modes and rules, an estimator
        would need an output with feedthrough, or signals of the plant share a name; from the block, if an input is not
        finite or the state is none that the block has made.

    Notes
    -----
    An output with feedthrough is no input of the block, since python-control doesn't solve loops without a delay: the
    block takes it from the state, ``C x + D u``, and solves for u.

    Examples
    --------
    >>> plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, outputs=["angle", "rate"], name="axis")
    >>> modes = close_loops(plant, {"stiff": [[40, 10]], "soft": [[1, 1]]}, dt=0.01)
    >>> controller = switched_controller(RecedingHorizon(horizon=100, hold=10), modes)
    >>> loop = control.interconnect([modes.plant, controller], inputs=[], outputs=["angle", "rate", "u[0]", "index"])
    >>> response = control.input_output_response(loop, np.arange(12) * 0.01, X0=[[1.0, 2.0], 0])
    >>> response.outputs[3].tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]
    """
    modes = digital(modes)
    assert modes.plant is not None and modes.controllers is not None
    scheduler = _started(method, modes, rules)
    if modes.estimate_states:
        if modes.plant.D.any():
            raise ValueError(
                "the estimator is fed by an output with feedthrough, which python-control can't connect without a "
                "delay; run the loop by simulate"
            )
        inputs, C = modes.plant.output_labels, np.eye(modes.plant.noutputs)
    else:
        inputs, C = _measured(modes.plant, modes.controllers.by_output)
    running = _Controlling(scheduler, modes, C)
    return _system(running, inputs, modes.plant.input_labels, modes.controllers.states, scheduler, name)


class _Deciding:
    """What `scheduler_system` does in a sample."""

    def __init__(self, scheduler: Scheduler, n: int) -> None:
        self.scheduler, self.n = scheduler, n

    def sample(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        """The outputs, and the state at the next sample."""
        mean, cov = inputs[: self.n], inputs[self.n :]
        self.scheduler.memory = state
        mode = self.scheduler.step(mean, cov.reshape(self.n, self.n) if len(cov) else None)
        return np.array([float(mode)]), self.scheduler.memory

    def update(self, t: float, state: Array, inputs: Array, params: Any) -> Array:
        """The update function of python-control."""
        return self.sample(state, inputs)[1]

    def output(self, t: float, state: Array, inputs: Array, params: Any) -> Array:
        """The output function of python-control."""
        return self.sample(state, inputs)[0]


class _Controlling(_Deciding):
    """What `switched_controller` does in a sample; the plant's output without feedthrough is C times the inputs."""

    def __init__(self, scheduler: Scheduler, modes: ClosedLoops, C: Array) -> None:
        super().__init__(scheduler, modes.plant_states)
        assert modes.plant is not None and modes.controllers is not None
        self.modes, self.controllers, self.C, self.D = modes, modes.controllers, C, modes.plant.D
        self.loops = np.eye(len(self.D.T)) + self.controllers.Hy @ self.D

    def sample(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        scheduler, controllers = self.scheduler, self.controllers
        state, inputs = real_array(state, "state"), real_array(inputs, "inputs")
        zeta, scheduler.memory = np.split(state, [len(controllers.states)])
        y, before, estimated = self.C @ inputs, scheduler.last, self.modes.estimate_states
        x = np.zeros(self.n) if estimated else inputs[: self.n]
        if before < 0:
            zeta, before = zeta + controllers.initial @ x, int(scheduler.graph.last_mode[0])
        known = zeta[len(zeta) - self.n :] if estimated else x
        mode = scheduler.step(np.concatenate([known, zeta]), self.modes.error_covariance)
        zeta = controllers.activated(before, mode, zeta, x)
        with np.errstate(over="ignore", invalid="ignore"):
            u = np.linalg.solve(self.loops[mode], controllers.output(mode, zeta, x, y))
            zeta = controllers.updated(mode, zeta, x, y + self.D @ u, u)
        if not (np.isfinite(u).all() and np.isfinite(zeta).all()):
            raise FloatingPointError("the controllers' output or state exceeds the floating-point range")
        return np.append(u, mode), np.concatenate([zeta, scheduler.memory])


def _started(method: Method, modes: ModeSet, rules: Rules | SwitchingGraph | None) -> Scheduler:
    """The scheduler of a block."""
    require_method(method)
    return started(method, graph_under(modes, rules))


def _measured(plant: control.StateSpace, by_output: bool) -> tuple[list[str], Array]:
    """The names of the signals measured, and the plant's output without feedthrough as a matrix of them."""
    n, labels = plant.nstates, plant.output_labels
    seen: dict[int, str] = {}  # the states that are outputs
    others = []
    for k in np.flatnonzero(~plant.D.any(axis=1)).tolist():
        i = int(plant.C[k].argmax())
        if np.array_equal(plant.C[k], np.eye(n)[i]):
            seen.setdefault(i, labels[k])
        elif by_output:
            others.append(k)
    C = np.zeros((plant.noutputs, n + len(others)))
    C[:, :n] = plant.C
    C[others] = np.eye(n + len(others))[n:]
    return [*(seen.get(i, plant.state_labels[i]) for i in range(n)), *(labels[k] for k in others)], C


def _system(
    running: _Deciding,
    inputs: Sequence[str],
    outputs: Sequence[str],
    states: Sequence[str],
    scheduler: Scheduler,
    name: str,
) -> control.NonlinearIOSystem:
    """The block."""
    if not isinstance(name, str) or not name:
        raise TypeError(f"name must be a non-empty string, not {name!r}")
    inputs = [label.replace(".", "_") for label in inputs]  # python-control lets only states have dots
    outputs = [*outputs, "index"]
    signals = [*inputs, *outputs]
    for label in signals:
        if signals.count(label) > 1:
            raise ValueError(
                f"two signals of the block would be called {label!r}: {', '.join(signals)}; rename states, inputs or "
                "outputs of the plant"
            )
    memory = [f"memory[{i}]" for i in range(len(scheduler.memory))]
    return control.nlsys(
        running.update,
        running.output,
        inputs=inputs,
        outputs=outputs,
        states=[*states, *memory],
        dt=scheduler.modes.dt,
        name=name,
    )
