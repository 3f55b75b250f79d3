"""A running scheduler fed with the moments it predicts itself."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from switchctl.methods.base import Scheduler
from switchctl.moments import Array
from switchctl.predicted import factors_along, next_factor, overflow

CONVERGED = 1e-12
"""Without a number of steps, a prediction ends when W2 has fallen to this fraction of its start .."""
CEILING = 100_000
""".. or after this many steps, or when W2 has grown to 1 / CONVERGED of its start."""
INTERRUPTED = "interrupted"
"""The status of what Ctrl-C cut short."""


class Prediction(NamedTuple):
    """The mode of each step, the holds lengthened, the moment factor after the last step, and why it ends there."""

    sequence: list[int]
    lengthened: list[tuple[int, int]]
    F: Array
    status: str


def predict(scheduler: Scheduler, F: Array, steps: int | None) -> Prediction:
    """Run a scheduler along the predicted moments.

    Parameters
    ----------
    scheduler : Scheduler
        A scheduler at its first sample.
    F : array, shape (n, n + 1)
        The initial moment factor.
    steps : int, optional
        Number of steps; until convergence by default.

    Returns
    -------
    Prediction
        Interrupted by Ctrl-C, the steps decided so far.

    Raises
    ------
    ValueError
        If W2 leaves the floating-point range.
    """
    sequence: list[int] = []
    lengthened: list[tuple[int, int]] = []
    modes, before = scheduler.modes, scheduler.graph.last_mode[0]
    plant, weight = modes.plant_states, 1.0
    first, start = F, np.sum(F[:plant] ** 2) + np.sum(modes.distance * modes.W.max(axis=0))
    # W2 of the plant alone may pass through zero while controllers' states are not; then it must stay there.
    settling = 0 if plant == len(F) else 2 * len(F)
    small = 0
    status = "number of steps reached" if steps is not None else "ceiling of steps reached"
    try:
        for k in _counted(CEILING if steps is None else steps):
            with np.errstate(over="ignore", invalid="ignore"):
                if scheduler.target is not None:
                    scheduler.moment_factor = F
                mode = scheduler.take(F @ F.T)
            if scheduler.lengthened:
                lengthened.append((k, scheduler.lengthened))
            sequence.append(mode)
            with np.errstate(over="ignore", invalid="ignore"):
                F = next_factor(modes, before, mode, F)
                w2, before = np.vdot(F[:plant], F[:plant]), mode
            if not np.isfinite(w2) or (settling and not np.isfinite(F).all()):
                raise ValueError(overflow(modes, F, k) + (f"; ask for at most {k} steps" if k else ""))
            weight *= modes.discount
            start = max(start, w2) if k < settling else start
            small = small + 1 if w2 <= CONVERGED * start else 0
            if steps is None and (small > settling or weight <= CONVERGED):
                status = "converged" if small > settling else "discounted to nothing"
                break
            if steps is None and k >= settling and w2 * CONVERGED >= start:
                status = "diverged"
                break
    except KeyboardInterrupt:
        if not sequence:
            raise
        status = INTERRUPTED
        scheduler.recover(sequence)  # it may have been a step ahead
        *_, F = factors_along(modes, [scheduler.graph.last_mode[0], *sequence[:-1]], sequence, first)
    return Prediction(sequence, lengthened, F, status)


def _counted(steps: int) -> Iterator[int]:
    """The steps, with a progress bar from the second on: the first may be a long search with a bar of its own."""
    yield 0
    yield from tqdm(range(1, steps), "schedule", steps, initial=1, unit="step", delay=2, leave=False)
