"""The verb: run a method along the predicted moments."""

from typing import Any

import numpy as np
from control import ControlDimension

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods import Method
from switchctl.methods.boundary import initial_state, require_method, require_target, started
from switchctl.methods.prediction import INTERRUPTED, predict
from switchctl.modes import ModeSet
from switchctl.moments import Array, moment_factor
from switchctl.result import Schedule
from switchctl.rules import Rules
from switchctl.storage import affordable
from switchctl.validation import positive_semidefinite, real_array, whole_number
from switchctl.values import require_criterion

_BYTES = 32  # a step: its mode, in a list and an array, its W2 and its cost


def schedule(
    modes: ModeSet,
    x0: Gaussian,
    method: Method,
    steps: int | None = None,
    rules: Rules | SwitchingGraph | None = None,
    *,
    terminal: Any = None,
    target: Gaussian | None = None,
) -> Schedule:
    """Decide which mode acts at each step, by a method run along the predicted moments.

    This is the running scheduler, `Method.start`, fed with the predicted mean and covariance; online it makes the same
    decisions.

    Parameters
    ----------
    modes : ModeSet
        The modes, from `close_loops` or `ModeSet`.
    x0 : Gaussian
        The uncertain initial state.
    method : Method
        How to decide, e.g. ``RecedingHorizon(horizon=50)``.
    steps : int, optional
        Number of steps. By default, until W2 has fallen to 1e-12 of its start, with a ceiling of 100,000 steps (or
        W2 grown to 1e12 times its start).
    rules : Rules or SwitchingGraph, optional
        What limits or prices switching; nothing by default. They hold for the run, which never ends: for the steps
        listed and for the tail that follows them.
    terminal : array_like, shape (n, n), optional
        For a run that ends after ``steps``: a positive semidefinite weight M of the state there, which costs
        ``dk * tr(M S_N)``; of the plant's states or of all. By default the run goes on for ever.
    target : Gaussian, optional
        A distribution that the plant's state is to have: W2 is then the squared Wasserstein distance to it, and the
        cost ``dk`` times its sum over the ``steps`` and the state after them. For `Constant`, `PointwiseMinimum` and
        `RecedingHorizon` with a finite horizon. (A point to be reached is no target but another origin: see
        `Gaussian.about`.)

    Returns
    -------
    Schedule
        Its ``status`` says why it ends. Interrupted by Ctrl-C, the steps decided so far, or those of the best sequence
        found so far.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If dimensions differ, steps is not a positive whole number, the rules contradict each other or the modes, the
        method cannot work with these modes and rules, or W2 leaves the floating-point range.
    FloatingPointError
        If the cost of a mode leaves the floating-point range.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> x0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    >>> schedule(modes, x0, RecedingHorizon(horizon=20)).switches
    (Switch(step=8, before=1, after=0),)
    >>> schedule(modes, x0, RecedingHorizon(horizon=20), rules=Rules(min_dwell=10)).switches
    (Switch(step=10, before=1, after=0),)
    """
    x0 = initial_state(modes, x0)
    require_method(method)
    steps = None if steps is None else whole_number(steps, "steps")
    affordable(_BYTES * (steps or 0), f"a schedule of {steps} steps", "ask for fewer steps")
    graph, M = graph_under(modes, rules), None
    if target is not None:
        _check_target(modes, method, target, steps, terminal)
    elif modes.cost == "average" and steps is None:
        raise ValueError(
            "with cost='average' a run doesn't come to an end by itself; say how many steps to list, steps=N: enough "
            "for its end to repeat a word of modes, whose average is the cost"
        )
    elif terminal is None:
        require_criterion(modes)
    else:
        M = _terminal(modes, terminal, steps)
    scheduler = started(method, graph)
    scheduler.steps, scheduler.initial, scheduler.terminal = steps, x0.second_moment, M
    scheduler.target = target
    sequence, lengthened, F, status = predict(scheduler, moment_factor(x0.mean, x0.cov), steps)
    lead, word = scheduler.tail(F @ F.T) if M is None and target is None else ((), ())
    if modes.cost == "average" and (repeated := _period(sequence)):
        lead, word = (), repeated
    whole = M is None or len(sequence) == steps  # of a shorter run that ends, the bound of the whole says nothing
    return Schedule(
        modes,
        x0,
        sequence,
        word,
        repr(method),
        INTERRUPTED if INTERRUPTED == status or scheduler.interrupted else scheduler.status or status,
        tuple(lengthened),
        lead,
        graph,
        scheduler.statistics,
        scheduler.lower_bound if whole else None,
        M,
        target,
    )


def _period(sequence: list[int]) -> tuple[int, ...]:
    """The word that the end of a sequence repeats, for half of it at least; none if there is none."""
    late = np.array(sequence[len(sequence) // 2 :])
    for period in range(1, len(late) // 3 + 1):
        if (late[period:] == late[:-period]).all():
            return tuple(late[-period:].tolist())
    return ()


def _check_target(modes: ModeSet, method: Method, target: Any, steps: int | None, terminal: Any) -> None:
    require_target(modes, target)
    if not method.evaluates:
        raise ValueError(
            f"{method!r} needs costs that are linear in the second moment, and the distance to a Gaussian target is "
            "not; use RecedingHorizon, or the second-moment distance to the target's mean, x0.about(target.mean)"
        )
    if steps is None:
        raise ValueError("target is for a run that ends; say when, steps=N")
    if terminal is not None or modes.cost == "average":
        what = "a terminal weight" if terminal is not None else "cost='average'"
        raise ValueError(f"target takes the place of the cost at the end, so it doesn't go with {what}")


def _terminal(modes: ModeSet, value: Any, steps: int | None) -> Array:
    """The weight of the state at the end of a run that ends."""
    if steps is None:
        raise ValueError("terminal is the weight of the state at the end of a run; say when it ends, steps=N")
    if modes.cost == "average":
        raise ValueError("terminal is for a run that ends, and cost='average' for one that goes on for ever")
    n, p = len(modes.distance), modes.plant_states
    M = real_array(value, "terminal")
    if M.shape not in ((n, n), (p, p)):
        plant = f", or {(p, p)} for those of the plant" if p < n else ""
        raise ControlDimension(f"terminal has shape {M.shape}; the modes have {n} states, so expected {(n, n)}{plant}")
    whole = np.zeros((n, n))
    whole[: len(M), : len(M)] = positive_semidefinite(M, "terminal")
    return whole
