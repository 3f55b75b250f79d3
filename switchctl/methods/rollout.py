"""Rollout: one step of any mode, then the best single mode for ever."""

from dataclasses import dataclass

import numpy as np

from switchctl.methods.base import Method, Scheduler, least_cost
from switchctl.methods.constant import require_schur
from switchctl.modes import ModeSet
from switchctl.moments import Array, svec


@dataclass(frozen=True, repr=False)
class Rollout(Method):
    """Take, at every sample, the mode whose one step followed by the best single mode for ever costs least.

    With the Lyapunov solutions P_q the choice is the i that minimises
    ``min_q tr((Q_i + A_i' P_q A_i) S)``. It costs no more than the best single mode, whatever the initial state, and
    is mean-square stable without a constraint where every stage weight is positive definite, as by default
    (docs/theory.md has the proofs; with a singular weight, states that the cost doesn't see may grow). One mode at
    least must be Schur.

    Raises
    ------
    ValueError
        From `start` and `schedule`, if no mode is Schur.

    Examples
    --------
    >>> modes = ModeSet([[[0.9, 5.0], [0.0, 0.5]], [[0.95, 0.0], [0.0, 0.9]]])
    >>> scheduler = Rollout().start(modes)
    >>> scheduler.step([0.0, 1.0]), scheduler.step([1.0, 0.0])
    (1, 0)
    """

    def start(self, modes: ModeSet) -> Scheduler:  # noqa: D102
        require_schur(modes, "Rollout")
        return _RolloutScheduler(modes)


class _RolloutScheduler(Scheduler):
    def __init__(self, modes: ModeSet) -> None:
        super().__init__(modes)
        self.tail_modes = np.flatnonzero(modes.schur)
        tails = np.stack([P for P in modes.tails if P is not None])
        A = modes.A[:, None]
        one_step = modes.Q[:, None] + np.swapaxes(A, -1, -2) @ tails @ A  # (i, q): Q_i + A_i' P_q A_i
        self.table = svec(one_step).reshape(-1, svec(tails).shape[-1])
        self.tail_table = svec(tails)

    def decide(self, S: Array) -> int:
        return least_cost(self.table @ svec(S)) // len(self.tail_modes)

    def tail(self, S: Array) -> tuple[int, ...]:
        return (int(self.tail_modes[least_cost(self.tail_table @ svec(S))]),)
