"""The verb: run a method along the predicted moments."""

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods import Method
from switchctl.methods.base import initial_state
from switchctl.methods.prediction import INTERRUPTED, predict
from switchctl.modes import ModeSet
from switchctl.moments import moment_factor
from switchctl.result import Schedule
from switchctl.rules import Rules
from switchctl.validation import whole_number


def schedule(
    modes: ModeSet,
    x0: Gaussian,
    method: Method,
    steps: int | None = None,
    rules: Rules | SwitchingGraph | None = None,
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
    if not isinstance(method, Method):
        raise TypeError(f"method must be a Method such as RecedingHorizon(horizon=50), not {method!r}")
    steps = None if steps is None else whole_number(steps, "steps")
    graph = graph_under(modes, rules)
    scheduler = method.start(graph)
    scheduler.steps, scheduler.initial = steps, x0.second_moment
    sequence, lengthened, F, status = predict(scheduler, moment_factor(x0.mean, x0.cov), steps)
    lead, word = scheduler.tail(F @ F.T)
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
        scheduler.lower_bound,
        scheduler.terminal,
    )
