"""Switching rules: what limits or prices a change of controller."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from numbers import Integral
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from switchctl.validation import number, real_array, shown, whole_number


class ContradictionError(ValueError):
    """Rules that no run can obey together."""


class _Record:
    """Copying, comparing and printing of immutable records."""

    def __reduce__(self) -> tuple[Any, ...]:
        told = {name: dict(value) if isinstance(value, Mapping) else value for name, value in vars(self).items()}
        return partial(type(self), **told), ()

    def __hash__(self) -> int:
        return hash(repr(self))

    def told(self, name: str) -> str:
        """A field as one would write it."""
        value = getattr(self, name)
        return repr(dict(value) if isinstance(value, Mapping) else value)

    def __repr__(self) -> str:
        changed = [f.name for f in fields(self) if getattr(self, f.name) != f.default]  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(f'{name}={self.told(name)}' for name in changed)})"


@dataclass(frozen=True, kw_only=True, repr=False)
class Budget(_Record):
    """A resource that the modes use: processor time, energy, network slots.

    Parameters
    ----------
    use : dict, sequence or number
        What a step in each mode uses, at least 0: by name or index (modes not named use nothing), in order, or the same
        for all. Decimal numbers are added exactly: three times 0.1 fit into 0.3.
    limit : number
        The most that may be used.
    window : int, optional
        The limit holds in any so many consecutive steps (in seconds under ``Rules(time_unit="s")``, rounded up to
        steps). By default it is the total of the whole run, which never ends: a mode that uses something can't be held
        for ever then.

    Raises
    ------
    ValueError
        If a use or the limit is negative or not finite, or the window is not positive.
    TypeError
        If one is not a number.

    Examples
    --------
    >>> Budget(use={"high": 2}, limit=40)
    Budget(use={'high': 2.0}, limit=40.0)
    """

    __hash__ = _Record.__hash__

    use: Any
    limit: float
    window: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "use", _per_mode(self.use, "use", _at_least_zero))
        object.__setattr__(self, "limit", _at_least_zero(self.limit, "limit"))
        if self.window is not None:
            seconds = number(self.window, "window")
            object.__setattr__(self, "window", int(seconds) if isinstance(self.window, Integral) else seconds)
        if self.window is not None and not 0 < self.window < math.inf:
            raise ValueError(f"window is {self.window!r}; expected a positive time, or None for the whole run")


@dataclass(frozen=True, kw_only=True, repr=False)
class Rules(_Record):
    """What limits or prices switching; every method honours it.

    Values for each mode are a number for all modes, a dict by name or index (modes not named are free), or a sequence.

    Parameters
    ----------
    min_dwell : int, dict or sequence, optional
        Least number of steps a mode is held once taken; one by default. A dwell cut by a schedule's last step goes on
        in its tail.
    max_dwell : int, dict or sequence, optional
        Greatest number of steps in a row; no limit (`math.inf`) by default.
    transitions : dict or matrix, optional
        Which mode may follow which: a dict from each mode to those it may be left for, or a matrix of booleans, rows
        "from". Staying is no transition: `max_dwell` limits that, and the diagonal has no meaning. All by default.
    switch_cost : number or matrix, optional
        Cost of a switch, or of each (rows "from", no meaning on the diagonal), in the unit of `Schedule.cost`. A run
        that never stops switching then costs infinitely much; ``switch_cost_per_w2`` fades with the state.
    switch_cost_per_w2 : number or matrix, optional
        Cost of a switch for each unit of W2 at that step, added to ``switch_cost``.
    price : number, dict or sequence, optional
        Running price of each mode, part of the stage cost: a step costs ``dk * (tr(Q S) + price)``, so that with a
        period it is a price per second. Only what exceeds the cheapest mode's price counts, since a run has no end; a
        run that pays more for ever costs infinitely much.
    max_switches : int, optional
        Greatest number of switches in the whole run.
    budget : Budget, optional
        A resource that must last.
    start : (mode, age), optional
        The mode active before the first step, and for how long it has been. By default there was none: the first mode
        is no switch, and its dwell begins with the run.
    allowed : dict, optional
        When each mode named is available: a list of intervals (from, to), counted from the run's start, the end not
        included; `math.inf` for no end. A step must lie wholly within an interval.
    allowed_period : int, optional
        The intervals repeat after this time.
    time_unit : {"step", "s"}, optional
        The unit of all times: dwells, the window of the budget, the age, the intervals. Seconds are rounded to whole
        steps towards the stricter rule; an age and a period must be whole steps.

    Raises
    ------
    ValueError
        If a value is out of range or two rules contradict each other (`ContradictionError`). What depends on the modes
        (their names, dt, whether any run can obey) is checked where rules meet modes: `SwitchingGraph`, `schedule`.
    TypeError
        If a value is of the wrong kind.

    Examples
    --------
    >>> Rules(min_dwell=5, switch_cost=0.1, start=("low", 3))
    Rules(min_dwell=5, switch_cost=0.1, start=('low', 3))
    >>> Rules(min_dwell={"high": 0.05}, time_unit="s")
    Rules(min_dwell={'high': 0.05}, time_unit='s')
    """

    __hash__ = _Record.__hash__

    min_dwell: Any = None
    max_dwell: Any = math.inf
    transitions: Any = None
    switch_cost: Any = 0.0
    switch_cost_per_w2: Any = 0.0
    price: Any = 0.0
    max_switches: int | None = None
    budget: Budget | None = None
    start: tuple[Any, Any] | None = None
    allowed: Any = None
    allowed_period: Any = None
    time_unit: Literal["step", "s"] = "step"

    def __post_init__(self) -> None:
        if not isinstance(self.time_unit, str) or self.time_unit not in ("step", "s"):
            raise ValueError(f"time_unit is {shown(self.time_unit)}; expected 'step' or 's'")
        values: dict[str, Any] = {
            "max_dwell": _per_mode(self.max_dwell, "max_dwell", partial(self._time, endless=True)),
            "switch_cost": _number_or_matrix(self.switch_cost, "switch_cost"),
            "switch_cost_per_w2": _number_or_matrix(self.switch_cost_per_w2, "switch_cost_per_w2"),
            "price": _per_mode(self.price, "price", _at_least_zero),
        }
        if self.min_dwell is not None:
            values["min_dwell"] = _per_mode(self.min_dwell, "min_dwell", self._time)
        if self.transitions is not None:
            values["transitions"] = _transitions(self.transitions)
        if self.max_switches is not None:
            values["max_switches"] = whole_number(self.max_switches, "max_switches", 0)
        if self.start is not None:
            values["start"] = self._start()
        if self.allowed is not None:
            values["allowed"] = self._intervals()
        if self.allowed_period is not None:
            if self.allowed is None:
                raise ValueError("allowed_period is given without allowed; say when each mode is available")
            values["allowed_period"] = self._time(self.allowed_period, "allowed_period")
        if self.budget is not None:
            if not isinstance(self.budget, Budget):
                raise TypeError(f"budget must be a Budget(use=.., limit=..), not {self.budget!r}")
            if self.budget.window is not None and self.time_unit == "step":
                window = self._time(self.budget.window, "the budget's window")
                values["budget"] = replace(self.budget, window=window)
        for name, value in values.items():
            object.__setattr__(self, name, value)
        low, high = self.min_dwell, self.max_dwell
        if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
            raise ContradictionError(f"min_dwell = {low} and max_dwell = {high} contradict each other")

    def _time(self, value: Any, name: str, *, endless: bool = False, least: int = 1) -> float:
        """Check a time: whole steps, or seconds."""
        if endless and isinstance(value, float) and value == math.inf:
            return value
        if self.time_unit == "step":
            if isinstance(value, float) and 0 < value < math.inf and value % 1:
                raise ValueError(f"{name} is {value!r}; expected a whole number of steps, or seconds and time_unit='s'")
            return whole_number(value, name, least)
        seconds = number(value, name)
        if not 0 <= seconds < math.inf or (seconds == 0 and least > 0):
            raise ValueError(f"{name} is {value!r} s; expected a {'positive' if least else 'non-negative'} finite time")
        return seconds

    def _start(self) -> tuple[Any, float]:
        if isinstance(self.start, str | bytes) or not isinstance(self.start, Sequence) or len(self.start) != 2:
            raise TypeError(f"start must be a pair (mode, age), not {self.start!r}")
        return _mode(self.start[0], "start"), self._time(self.start[1], "the age in start")

    def _intervals(self) -> Mapping[Any, Any]:
        if not isinstance(self.allowed, Mapping):
            raise TypeError(f"allowed must be a dict from modes to lists of intervals, not {self.allowed!r}")
        _not_empty(self.allowed, "allowed")
        intervals: dict[Any, tuple[tuple[float, float], ...]] = {}
        for mode, given in self.allowed.items():
            name = f"allowed[{mode!r}]"
            try:
                pairs = [(begin, end) for begin, end in given]
            except (TypeError, ValueError):
                raise TypeError(f"{name} must be a list of intervals (from, to), not {given!r}") from None
            times = [
                (self._time(begin, name, least=0), self._time(end, name, endless=True, least=0)) for begin, end in pairs
            ]
            for begin, end in times:
                if begin >= end:
                    raise ValueError(f"{name} holds the interval ({begin}, {end}), which is empty")
            intervals[_mode(mode, "allowed")] = tuple(times)
        return MappingProxyType(intervals)


def _at_least_zero(value: Any, name: str) -> float:
    checked = number(value, name)
    if not 0 <= checked < math.inf:
        raise ValueError(f"{name} is {value!r}; expected a finite number, at least 0")
    return checked


def _mode(value: Any, name: str) -> str | int:
    """A mode named by a rule: its name or index; which exist is not known yet."""
    value = getattr(value, "name", value)
    if isinstance(value, str):
        return value
    return whole_number(value, f"the mode in {name}", -(2**31))


def _not_empty(value: Any, name: str) -> None:
    if len(value) == 0:
        raise ValueError(f"{name} is empty; leave it out if it sets no rule")


def _per_mode(value: Any, name: str, check: Callable[[Any, str], float]) -> Any:
    """A number, or numbers by mode: a read-only dict or a tuple."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        _not_empty(value, name)
        return MappingProxyType({_mode(m, name): check(v, f"{name}[{m!r}]") for m, v in value.items()})
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        _not_empty(value, name)
        return tuple(check(v, f"{name}[{i}]") for i, v in enumerate(value))
    return check(value, name)


def _number_or_matrix(value: Any, name: str) -> Any:
    if isinstance(value, Mapping):
        raise TypeError(f"{name} must be a number or a matrix with a row for each mode before, not a dict")
    if np.ndim(value) == 0:
        return _at_least_zero(value, name)
    matrix = real_array(value, name, (None, None))
    if (matrix < 0).any():
        raise ValueError(f"{name} has an entry {matrix.min():g}; expected at least 0")
    return tuple(map(tuple, matrix.tolist()))


def _transitions(value: Any) -> Any:
    if not isinstance(value, Mapping):
        matrix = real_array(value, "transitions", (None, None))
        if not np.isin(matrix, (0, 1)).all():
            raise ValueError("transitions is a matrix of booleans; got other entries than 0 and 1")
        return tuple(tuple(x == 1 for x in row) for row in matrix.tolist())
    _not_empty(value, "transitions")
    targets: dict[Any, tuple[Any, ...]] = {}
    for mode, given in value.items():
        if isinstance(given, (str, bytes)) or not isinstance(given, Sequence):
            raise TypeError(f"transitions[{mode!r}] must be a list of modes, not {given!r}")
        targets[_mode(mode, "transitions")] = tuple(_mode(m, "transitions") for m in given)
    return MappingProxyType(targets)
