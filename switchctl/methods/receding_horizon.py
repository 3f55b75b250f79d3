"""The paper's method: a constant mode over a horizon, held, then chosen again."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import Method, Scheduler
from switchctl.methods.horizon_costs import HorizonCosts
from switchctl.methods.least import TIE, least_cost
from switchctl.methods.towards import towards
from switchctl.modes import ModeSet
from switchctl.moments import Array, svec, transform
from switchctl.validation import number, whole_number

_LONGEST = 100_000  # steps of a lengthened hold

Horizon = int | float | Sequence[int | float] | Callable[[int], int | float]


@dataclass(frozen=True, repr=False)
class RecedingHorizon(Method):
    r"""The receding horizon of Lee and Bhattacharya (DSCC 2014).

    At the update time t_j choose the mode whose cost over ``k = t_j .. t_j + T`` is least,

    .. math:: \min_\sigma \sum_{k=t_j}^{t_j+T} \operatorname{tr}(Q_\sigma S_{\sigma}(k)) \quad\text{subject to}\quad
              W_\sigma^2(t_{j+1}) \le (1 - \text{decrease})\, W^2(t_{j-1})

    (with the default weight Q = I the summand is W2, as in the paper), and hold it until ``t_{j+1} = t_j + hold``.
    Where no mode satisfies the constraint, the hold is lengthened step by step until one does: it exists, because
    every mode is Schur. ``W2(t_0)`` stands for the missing ``W2(t_{-1})``, and after a disturbance, a W2(t_j) that the
    mode held before can't have made, W2(t_j) itself. The constraint makes the switched system mean-square stable
    (Theorem 1 of the paper). A decision is one small matrix-vector product, whatever the horizon; one that has to
    lengthen its hold takes some microseconds more for each step it tries, of at most 100,000. An infinite horizon
    without the constraint costs no more than the best single mode.

    Parameters
    ----------
    horizon : int, inf, sequence or callable
        T in steps, at least 1. `math.inf` compares the modes by their cost for ever. A sequence gives T for the
        updates j = 0, 1, .. (its last entry stays in force); a callable gives it as a function of j.
    hold : int, optional
        Steps between updates; 1 by default: decide at every sample.
    decrease : float, optional
        The stability constraint, between 0 and 1. None (default) leaves it out.

    Raises
    ------
    ValueError
        If a setting is out of range; from `start` and `schedule`, if a mode is not Schur where the constraint needs
        it, or none is where the horizon is infinite; when running, if no hold of up to 100,000 steps meets the
        constraint.
    TypeError
        If a setting is not a number.

    Examples
    --------
    >>> modes = ModeSet([[[0.9, 5.0], [0.0, 0.5]], [[0.95, 0.0], [0.0, 0.9]]])
    >>> scheduler = RecedingHorizon(horizon=10).start(modes)
    >>> scheduler.step([0.0, 1.0]), scheduler.step([1.0, 0.0])
    (1, 0)
    """

    horizon: Horizon
    hold: int = 1
    decrease: float | None = None
    evaluates: ClassVar[bool] = True

    def __post_init__(self) -> None:
        horizon = self.horizon.tolist() if isinstance(self.horizon, np.ndarray) else self.horizon
        if isinstance(horizon, Sequence) and not isinstance(horizon, (str, bytes)):
            if len(horizon) == 0:
                raise ValueError("horizon is an empty sequence; give at least one T")
            horizon = tuple(_checked(T, f"horizon[{j}]") for j, T in enumerate(horizon))
        elif not callable(horizon):
            horizon = _checked(horizon, "horizon")  # type: ignore[arg-type]
        object.__setattr__(self, "horizon", horizon)
        object.__setattr__(self, "hold", whole_number(self.hold, "hold"))
        if self.hold > _LONGEST:
            raise ValueError(f"hold is {self.hold}; expected at most {_LONGEST:,} steps")
        if self.decrease is not None:
            object.__setattr__(self, "decrease", number(self.decrease, "decrease"))
            if not 0 < self.decrease < 1:
                raise ValueError(f"decrease is {self.decrease}; expected a number strictly between 0 and 1, or None")

    def at(self, j: int) -> int | float:
        """T at the j-th update.

        Parameters
        ----------
        j : int
            Number of the update, from 0.

        Returns
        -------
        int or inf

        Raises
        ------
        TypeError, ValueError
            If j is no whole number from 0, or the callable gives no horizon.
        """
        j = whole_number(j, "j", 0)
        if callable(self.horizon):
            return _checked(self.horizon(j), f"horizon({j})")
        if isinstance(self.horizon, tuple):
            return self.horizon[min(j, len(self.horizon) - 1)]
        return self.horizon  # type: ignore[return-value]

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        if self.decrease is not None:
            self._check_constraint(graph)
        return _RecedingHorizonScheduler(graph, self)

    def _check_constraint(self, graph: SwitchingGraph) -> None:
        modes, needs = graph.modes, f"decrease={self.decrease} needs"
        if modes.noisy:
            raise ValueError(f"{needs} modes without noise, which keeps W2 from falling for ever; leave out decrease")
        if not modes.schur.all():
            name = modes.names[int(np.argmin(modes.schur))]
            raise ValueError(
                f"{needs} every mode to be Schur, and {name!r} has spectral radius "
                f"{modes[name].spectral_radius:.6g}; drop that mode, or leave out decrease"
            )
        held = np.isinf(graph.holds).any(axis=1)
        if not held.all():
            raise ValueError(
                f"{needs} a mode that may be held for ever, whatever was done before, and {graph.rules!r} may leave "
                f"none ({graph.label(int(np.argmin(held)))}); relax them, or leave out decrease"
            )


def _checked(T: int | float, name: str) -> int | float:
    return math.inf if isinstance(T, float) and T == math.inf else whole_number(T, name)


class _RecedingHorizonScheduler(Scheduler):
    def __init__(self, graph: SwitchingGraph, method: RecedingHorizon) -> None:
        super().__init__(graph)
        self.method = method
        if method.decrease is not None:
            self.after_hold = np.linalg.matrix_power(self.modes.A, method.hold)
            # Row i dotted with svec(S) is W2 after mode i has been held for the usual number of steps.
            self.w2_after_hold = svec(transform(self.after_hold, self.modes.distance))
            self.counts_all = self.modes.plant_states == len(self.modes.distance)
        self.costs = HorizonCosts(self, method.hold)
        self.costs.at(self.node, method.at(0))  # an impossible horizon is refused at the start, not at the first sample

    def forget(self) -> None:
        self.j = 0  # number of the coming update
        self.plan: list[int] = []  # the modes until then
        self.last_w2, self.growth = 0.0, 0.0  # W2(t_{j-1}), and how much of it the mode held since may have made

    def remembered(self) -> Sequence[float]:
        if self.method.decrease is None:
            coming = [mode + 1 for mode in self.plan]
            return (self.j, *coming, *[0] * (self.method.hold - 1 - len(coming)))
        return self.j, len(self.plan), self.last_w2, self.growth

    def recall(self, values: Sequence[float]) -> None:
        j, *rest = self._numbers(values)
        updates = whole_number(j, "values[0]", 0)
        if self.method.decrease is not None:
            steps = whole_number(rest[0], "values[1]", 0)
            if steps > _LONGEST or min(rest[1:]) < 0 or (steps and self.last < 0):
                raise ValueError(f"values are {values}; expected at most {_LONGEST:,} steps left, W2 and its growth")
            self.j, self.plan, self.last_w2, self.growth = updates, [self.last] * steps, rest[1], rest[2]
            return
        coming = [whole_number(mode, f"values[{k}]", 0) for k, mode in enumerate(rest, 1)]
        plan = [mode - 1 for mode in coming if mode]
        if max(coming, default=0) > len(self.modes) or any(coming[len(plan) :]):
            raise ValueError(f"values are {values}; expected the modes to come, counted from 1, and then zeros")
        self.j, self.plan = updates, plan

    def decide(self, S: Array) -> int:
        self.lengthened = 0
        if not self.plan or (self.method.decrease is None and not self.costs.moves[self.node, self.plan[0]]):
            self._update(S)
        mode, *self.plan = self.plan  # a new list: a step that is undone has the old one
        return mode

    def _update(self, S: Array) -> None:
        T = self.method.at(self.j)
        if self.target is not None:
            F = self.moment_factor
            assert F is not None
            if self.method.decrease is not None:
                raise ValueError("decrease is a constraint on the distance to the origin; leave it out with a target")
            plans = self.costs.plans(self.node, T)
            costs = towards(self.graph, self.node, plans, F, self.target)
            self.plan = list(plans[least_cost(costs)][: self.method.hold])
            self.j += 1
            return
        candidates = self.costs.at(self.node, T)
        costs = candidates.rows @ svec(S) + candidates.constants
        if self.method.decrease is None:
            self.plan = list(candidates.plans[least_cost(costs)])
        else:
            w2 = float(np.sum(self.modes.distance * S))
            # More than the held mode can have made of W2(t_{j-1}) is a disturbance: W2(t_j) is then a new W2(t_0).
            past = self.last_w2 if w2 <= self.growth * self.last_w2 else w2
            modes = [plan[0] for plan in candidates.plans]
            longest = np.zeros(len(self.modes))
            longest[modes] = self.graph.holds[self.node, modes]
            allowed, hold = self._stabilising(self._begun(S), (1 - self.method.decrease) * past, longest)
            mode = modes[least_cost(costs, allowed[modes])]
            held = (
                self.after_hold[mode] if hold == self.method.hold else np.linalg.matrix_power(self.modes.A[mode], hold)
            )
            before = self.graph.last_mode[self.node]
            if self.modes.activation is not None and before >= 0:
                held = held @ self.modes.activation[before, mode]
            self.last_w2, self.growth = w2, float(np.linalg.norm(held, 2)) ** 2 * (1 + 1e-9)
            if not self.counts_all:  # states that W2 doesn't count have their part: four times as much is a disturbance
                expected = float(np.sum(self.modes.distance * (held @ S @ held.T)))
                self.growth = 4 * expected / w2 if w2 > 0 else 0.0
            self.lengthened = hold - self.method.hold
            self.plan = [mode] * hold
        self.j += 1

    def _begun(self, S: Array) -> Array:
        """The second moment after the switch to each mode, shape (m, n, n)."""
        before, E = self.graph.last_mode[self.node], self.modes.activation
        if E is None or before < 0:
            return np.broadcast_to(S, self.modes.A.shape)
        return E[before] @ S @ np.swapaxes(E[before], -1, -2)

    def _stabilising(self, S: Array, bound: float, longest: Array) -> tuple[NDArray[np.bool_], int]:
        """The modes with ``W2(t_{j+1}) <= bound``, and the shortest hold from the usual on that has any."""
        hold = self.method.hold
        # Rounding never decides; and below the smallest normal number a moment may stick.
        bound = max(bound * (1 + TIE), np.finfo(float).tiny)
        allowed = (np.sum(self.w2_after_hold * svec(S), axis=1) <= bound) & (longest >= hold)
        if allowed.any():
            return allowed, hold
        A, moments = self.modes.A, self.after_hold @ S @ np.swapaxes(self.after_hold, -1, -2)
        while not allowed.any():
            hold += 1
            if hold > _LONGEST:
                raise ValueError(
                    f"decrease={self.method.decrease}: no mode meets the constraint within {_LONGEST} steps; choose a "
                    "smaller decrease, or drop the slowest modes"
                )
            moments = A @ moments @ np.swapaxes(A, -1, -2)
            w2 = np.sum(self.modes.distance * moments, axis=(-2, -1))
            if not np.isfinite(w2).all():
                raise FloatingPointError("W2 exceeds the floating-point range in a lengthened hold; scale the state")
            allowed = (w2 <= bound) & (longest >= hold)
        return allowed, hold
