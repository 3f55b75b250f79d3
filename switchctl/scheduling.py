"""The verb: run a method along the predicted moments."""

import numpy as np
from tqdm import tqdm

from switchctl.gaussian import Gaussian
from switchctl.methods import Method
from switchctl.methods.base import check_state
from switchctl.modes import ModeSet
from switchctl.moments import moment_factor
from switchctl.result import Schedule
from switchctl.validation import whole_number

CONVERGED = 1e-12
"""Without a number of steps, a schedule ends when W2 has fallen to this fraction of its start .."""
CEILING = 100_000
""".. or after this many steps, or when W2 has grown to 1 / CONVERGED of its start."""
INTERRUPTED = "interrupted"
"""The status of a schedule that Ctrl-C cut short."""


def schedule(modes: ModeSet, x0: Gaussian, method: Method, steps: int | None = None) -> Schedule:
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

    Returns
    -------
    Schedule
        Its ``status`` says why it ends. Interrupted by Ctrl-C, the steps decided so far.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If dimensions differ, steps is not a positive whole number, the method cannot work with these modes, or W2
        leaves the floating-point range.
    FloatingPointError
        If the cost of a mode leaves the floating-point range.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> x0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    >>> schedule(modes, x0, RecedingHorizon(horizon=20)).switches
    (Switch(step=8, before=1, after=0),)
    """
    check_state(modes, x0)
    if not isinstance(method, Method):
        raise TypeError(f"method must be a Method such as RecedingHorizon(horizon=50), not {method!r}")
    limit = CEILING if steps is None else whole_number(steps, "steps")
    scheduler = method.start(modes)
    sequence: list[int] = []
    lengthened: list[tuple[int, int]] = []
    F = moment_factor(x0.mean, x0.cov)
    start = np.vdot(F, F)
    status = "number of steps reached"
    try:
        for k in tqdm(range(limit), desc="schedule", unit="step", delay=2, leave=False):
            with np.errstate(over="ignore", invalid="ignore"):
                mode = modes.index(scheduler.decide(F @ F.T))
            if scheduler.lengthened:
                lengthened.append((k, scheduler.lengthened))
            sequence.append(mode)
            with np.errstate(over="ignore"):
                F = modes.A[mode] @ F
                w2 = np.vdot(F, F)
            if not np.isfinite(w2):
                raise ValueError(
                    f"W2 exceeds the floating-point range after step {k}; ask for at most {k} steps, or use a method "
                    "that keeps the state bounded"
                )
            if steps is None and w2 <= CONVERGED * start:
                status = "converged"
                break
            if steps is None and w2 >= start / CONVERGED:
                status = "diverged"
                break
        else:
            status = "ceiling of steps reached" if steps is None else status
    except KeyboardInterrupt:
        if not sequence:
            raise
        status = INTERRUPTED
    tail = scheduler.tail(F @ F.T) or ()
    return Schedule(modes, x0, np.array(sequence), tail, repr(method), status, tuple(lengthened))
