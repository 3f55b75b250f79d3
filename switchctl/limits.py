"""Rules brought to the modes: names become indices, seconds become steps."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from control import ControlDimension
from numpy.typing import NDArray

from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.rules import ContradictionError, Rules
from switchctl.validation import GREATEST, listed

NODES = 100_000
"""A graph that would have more nodes is refused .."""
USES = 2_000_000
""".. or whose nodes would remember more uses of a budget in all."""


class TooManyNodes(ValueError):
    """The rules ask to remember too much."""


@dataclass(frozen=True)
class Limits:
    """Rules in whole steps, for modes by index.

    Uses and the limit of the budget are whole multiples of ``unit``, so that adding them is exact; ``available`` has a
    row for each phase of time, the last of which stays in force unless they repeat.
    """

    min_dwell: list[int]
    max_dwell: list[float]
    transitions: NDArray[np.bool_]
    max_switches: int | None
    use: list[int] | None
    limit: int
    unit: Fraction
    window: int | None
    available: NDArray[np.bool_] | None
    periodic: bool
    start: tuple[int, int] | None
    switch_cost: Array
    switch_cost_per_w2: Array
    price: Array
    activates: bool

    @property
    def remembers_mode(self) -> bool:
        """Whether the mode before makes a difference."""
        return bool(
            max(self.min_dwell) > 1
            or np.isfinite(self.max_dwell).any()
            or not self.transitions.all()
            or self.max_switches is not None
            or self.switch_cost.any()
            or self.switch_cost_per_w2.any()
            or self.activates
        )


def limits(modes: ModeSet, rules: Rules) -> Limits:
    """Bring rules to the modes."""
    steps = _Steps(modes, rules)
    low = [1] * len(modes)
    if rules.min_dwell is not None:
        low = [max(1, int(x)) for x in _by_mode(modes, rules.min_dwell, "min_dwell", 1, steps.up)]
    high = _by_mode(modes, rules.max_dwell, "max_dwell", math.inf, steps.down)
    for name, least, most in zip(modes.names, low, high, strict=True):
        if most < 1:
            raise ValueError(f"max_dwell of {name!r} is shorter than a step of {modes.dt:g} s; it must hold one")
        if least > most:
            raise ContradictionError(
                f"min_dwell = {least} and max_dwell = {most} steps contradict each other for {name!r}"
            )
    start = None
    if rules.start is not None:
        start = (find(modes, rules.start[0], "start"), steps.whole(rules.start[1], "the age in start"))
        if start[1] > high[start[0]]:
            raise ContradictionError(
                f"start = ({modes.names[start[0]]!r}, {start[1]}) and max_dwell = {high[start[0]]} steps contradict "
                "each other: the mode has been held for longer than it may be"
            )
    return Limits(
        low,
        high,
        _transitions(modes, rules.transitions),
        rules.max_switches,
        *_budget(modes, rules, steps),
        _available(modes, rules, steps),
        rules.allowed_period is not None,
        start,
        _pair_costs(modes, rules.switch_cost, "switch_cost"),
        _pair_costs(modes, rules.switch_cost_per_w2, "switch_cost_per_w2"),
        np.array(_by_mode(modes, rules.price, "price", 0.0)),
        modes.activation is not None,
    )


def find(modes: ModeSet, mode: Any, name: str) -> int:
    """Index of a mode that a rule names."""
    try:
        return modes.index(mode)
    except (LookupError, TypeError) as error:
        raise type(error)(f"{name}: {error.args[0]}") from None


def indices(modes: ModeSet, sequence: Any, name: str, what: str = "modes") -> list[int]:
    """Indices of a sequence of modes, given by index or by name."""
    return [find(modes, mode, f"{name}[{k}]") for k, mode in enumerate(listed(sequence, name, what))]


def _by_mode(
    modes: ModeSet, value: Any, name: str, default: float, convert: Callable[[float], float] = float
) -> list[Any]:
    """One number a mode, from a number, a dict or a sequence."""
    m = len(modes)
    if isinstance(value, Mapping):
        told = {find(modes, mode, name): convert(entry) for mode, entry in value.items()}
        if len(told) < len(value):
            raise ValueError(f"{name} tells one mode twice: {list(value)}")
        return [told.get(i, default) for i in range(m)]
    if isinstance(value, tuple):
        if len(value) != m:
            raise ValueError(f"{name} has {len(value)} entries; expected {m}, one for each mode")
        return [convert(entry) for entry in value]
    return [convert(value)] * m


def _pair_costs(modes: ModeSet, value: Any, name: str) -> Array:
    """Costs of switches by the mode before and after, zero on the diagonal and in a last row for no mode before."""
    m = len(modes)
    if isinstance(value, tuple) and np.shape(value) != (m, m):
        raise ControlDimension(f"{name} has shape {np.shape(value)}; expected {(m, m)}, rows for the mode before")
    costs = np.zeros((m + 1, m))
    costs[:m] = value
    costs[np.arange(m), np.arange(m)] = 0.0
    return costs


class _Steps:
    """Times in whole steps."""

    def __init__(self, modes: ModeSet, rules: Rules) -> None:
        self.seconds = rules.time_unit == "s"
        if self.seconds and modes.dt is True:
            raise ValueError("time_unit is 's', but the modes have no sampling period; give times in steps, or dt")
        self.dt = modes.dk

    def count(self, time: float) -> float:
        if not self.seconds or math.isinf(time):
            return time
        steps = time / self.dt
        if steps > GREATEST:
            raise ValueError(f"a time of {time:g} s is more than {GREATEST} steps of {self.dt:g} s; leave it out")
        return float(round(steps)) if abs(steps - round(steps)) <= 1e-9 * max(1.0, steps) else steps

    def up(self, time: float) -> int:
        return math.ceil(self.count(time))

    def down(self, time: float) -> float:
        steps = self.count(time)
        return steps if math.isinf(steps) else math.floor(steps)

    def whole(self, time: float, name: str) -> int:
        steps = self.count(time)
        if steps != int(steps) or (steps == 0 and time > 0):
            raise ValueError(f"{name} is {time:g} s; expected a multiple of the sampling period, {self.dt:g} s")
        return int(steps)


def _transitions(modes: ModeSet, value: Any) -> NDArray[np.bool_]:
    m = len(modes)
    if value is None:
        return np.ones((m, m), dtype=bool)
    if isinstance(value, tuple):
        if np.shape(value) != (m, m):
            raise ControlDimension(f"transitions has shape {np.shape(value)}; expected {(m, m)}, rows 'from'")
        matrix = np.array(value, dtype=bool)
    else:
        matrix = np.zeros((m, m), dtype=bool)
        told = {find(modes, mode, "transitions"): targets for mode, targets in value.items()}
        for i, name in enumerate(modes.names):
            if i not in told:
                raise ValueError(f"transitions says nothing of mode {name!r}; give it [] if it may not be left")
            matrix[i, [find(modes, target, "transitions") for target in told[i]]] = True
    return matrix | np.eye(m, dtype=bool)


def _budget(modes: ModeSet, rules: Rules, steps: _Steps) -> tuple[list[int] | None, int, Fraction, int | None]:
    budget = rules.budget
    if budget is None:
        return None, 0, Fraction(1), None
    # As decimals are written, so that three times 0.1 fit into 0.3.
    exact = [Fraction(repr(x)) for x in _by_mode(modes, budget.use, "use", 0.0)]
    limit = Fraction(repr(budget.limit))
    unit = Fraction(1, math.lcm(limit.denominator, *(x.denominator for x in exact)))
    window = None if budget.window is None else max(1, steps.up(budget.window))
    return [int(x / unit) for x in exact], int(limit / unit), unit, window


def _available(modes: ModeSet, rules: Rules, steps: _Steps) -> NDArray[np.bool_] | None:
    if rules.allowed is None:
        return None
    intervals = {
        find(modes, mode, "allowed"): [(steps.up(begin), steps.down(end)) for begin, end in given]
        for mode, given in rules.allowed.items()
    }
    ends = [end for given in intervals.values() for pair in given for end in pair if not math.isinf(end)]
    phases = int(max(ends, default=0)) + 1
    if rules.allowed_period is not None:
        phases = steps.whole(rules.allowed_period, "allowed_period")
        late = [end for given in intervals.values() for _, end in given if end > phases]
        if late:
            raise ValueError(
                f"an interval of allowed ends at step {late[0]}, after allowed_period = {phases} steps; split it there"
            )
    if phases > NODES:
        raise TooManyNodes(f"allowed tells {phases:,} steps apart; a switching graph has at most {NODES:,} nodes")
    available = np.ones((phases, len(modes)), dtype=bool)
    for mode, given in intervals.items():
        available[:, mode] = False
        for begin, end in given:
            available[int(begin) : None if math.isinf(end) else int(end), mode] = True
    return available
