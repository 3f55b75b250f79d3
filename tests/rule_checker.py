"""Whether a run obeys rules and what it costs, straight from what the rules mean, sharing no code with them."""

import math
from fractions import Fraction
from functools import cache
from itertools import groupby, pairwise

import numpy as np


def violations(modes, rules, sequence):
    """What a run that goes on after these steps, somehow, does against the rules so far."""
    sequence = [int(i) for i in sequence]
    start, age = start_of(modes, rules)
    runs = [(mode, len(list(steps))) for mode, steps in groupby(sequence)]
    if start is not None:
        if runs and runs[0][0] == start:
            runs[0] = (start, age + runs[0][1])
        else:
            runs.insert(0, (start, age))
    found = []

    least, most = _by_mode(modes, rules.min_dwell, 0), _by_mode(modes, rules.max_dwell, math.inf)
    for number, (mode, length) in enumerate(runs):
        if number < len(runs) - 1 and length < math.ceil(_steps(modes, rules, least[mode])):  # the last run is cut
            found.append(f"run {number} of mode {mode} lasts {length} steps, too short")
        if length > _steps(modes, rules, most[mode]):
            found.append(f"run {number} of mode {mode} lasts {length} steps, too long")
    if rules.transitions is not None:
        for (before, _), (after, _) in pairwise(runs):
            if not _follows(modes, rules.transitions, before, after):
                found.append(f"mode {after} follows mode {before}")
    if rules.max_switches is not None and len(runs) - 1 > rules.max_switches:
        found.append(f"{len(runs) - 1} switches")

    if rules.budget is not None:
        use, limit = [_exact(x) for x in _by_mode(modes, rules.budget.use, 0.0)], _exact(rules.budget.limit)
        used = [use[i] for i in sequence]
        if rules.budget.window is None:
            if sum(used) > limit:
                found.append(f"{sum(used)} used")
        else:
            window = math.ceil(_steps(modes, rules, rules.budget.window))
            past = [] if start is None else [use[start]] * age
            history = past + used
            for k in range(len(used)):
                end = len(past) + k + 1
                if sum(history[max(0, end - window) : end]) > limit:
                    found.append(f"too much used in the window that ends with step {k}")

    if rules.allowed is not None:
        step = _exact(modes.dt) if rules.time_unit == "s" else 1
        intervals = {
            _index(modes, mode): [(_exact(begin), _exact(end)) for begin, end in given]
            for mode, given in rules.allowed.items()
        }
        period = None if rules.allowed_period is None else int(_steps(modes, rules, rules.allowed_period))
        for k, mode in enumerate(sequence):
            time = (k if period is None else k % period) * step
            if mode in intervals and not any(begin <= time and time + step <= end for begin, end in intervals[mode]):
                found.append(f"mode {mode} at step {k}, when it is not available")
    return found


def true_parts(modes, x0, rules, sequence):
    """Cost of the state, of switches and of the running price over a finite sequence."""
    price, fixed, by_w2 = costs_of(modes, rules)
    before, _ = start_of(modes, rules)
    S = np.outer(x0.mean, x0.mean) + x0.cov
    state = switching = running = 0.0
    for mode in sequence:
        if before is not None and mode != before:
            switching += fixed[before, mode] + by_w2[before, mode] * np.trace(
                S[: modes.plant_states, : modes.plant_states]
            )
            if modes.activation is not None:
                S = modes.activation[before, mode] @ S @ modes.activation[before, mode].T
        state += modes.dk * np.vdot(modes.Q[mode], S)
        running += modes.dk * price[mode]
        S, before = modes.A[mode] @ S @ modes.A[mode].T, mode
    return state, switching, running


def true_cost(modes, x0, rules, sequence):
    return sum(true_parts(modes, x0, rules, sequence))


def costs_of(modes, rules):
    """The price of each mode above the cheapest, and the costs of switches, fixed and by W2."""
    m = len(modes.names)
    price = np.array(_by_mode(modes, rules.price, 0.0))
    fixed, by_w2 = (np.broadcast_to(np.asarray(c), (m, m)) for c in (rules.switch_cost, rules.switch_cost_per_w2))
    return price - price.min(), fixed, by_w2


def start_of(modes, rules):
    """The mode before the first step (None without) and its age in steps."""
    if rules.start is None:
        return None, 0
    return _index(modes, rules.start[0]), int(_steps(modes, rules, rules.start[1]))


def _index(modes, mode):
    return modes.names.index(mode) if isinstance(mode, str) else mode % len(modes.names)


def _by_mode(modes, value, free):
    m = len(modes.names)
    if value is None or isinstance(value, (int, float)):
        return [free if value is None else value] * m
    if isinstance(value, tuple):
        return list(value)
    values = [free] * m
    for mode, entry in value.items():
        values[_index(modes, mode)] = entry
    return values


def _follows(modes, transitions, before, after):
    if isinstance(transitions, tuple):
        return transitions[before][after]
    targets = next(given for mode, given in transitions.items() if _index(modes, mode) == before)
    return any(_index(modes, target) == after for target in targets)


@cache
def _exact(number):
    """A number as it is written in decimals, so that three times 0.1 is 0.3."""
    return number if math.isinf(number) else Fraction(repr(float(number)))


def _steps(modes, rules, time):
    if rules.time_unit == "step" or math.isinf(time):
        return time
    return _exact(time) / _exact(modes.dt)
