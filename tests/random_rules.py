"""Random rules of every kind, for random modes so fast that late switches don't matter."""

import math

import numpy as np
from random_cases import random_gaussian, random_modes

from switchctl import (
    Budget,
    ModeSet,
    Rules,
)

PERIODS = (0.1, 0.25, 0.3)  # s; as floats no multiple of them is exact


def per_mode(rng, m, draw):
    """Values for all modes: a number, a list, or a dict that leaves modes out."""
    form = rng.integers(3)
    if form == 0:
        return draw()
    if form == 1:
        return [draw() for _ in range(m)]
    return {f"A{i}" if rng.random() < 0.5 else int(i): draw() for i in some(rng, m)}


def some(rng, m):
    return rng.choice(m, rng.integers(1, m + 1), replace=False).tolist()


def min_dwell(rng, m):
    return {"min_dwell": per_mode(rng, m, lambda: int(rng.integers(1, 6)))}


def max_dwell(rng, m):
    longest = rng.choice(5, m) + 1
    if rng.random() < 0.8:  # a mode that may be held for ever
        return {"max_dwell": {int(i): int(longest[i]) for i in some(rng, m)[: m - 1]}}
    return {"max_dwell": longest.tolist()}


def transitions(rng, m):
    matrix = rng.random((m, m)) < 0.5
    if rng.random() < 0.5:
        return {"transitions": matrix}
    return {"transitions": {f"A{i}": np.flatnonzero(row).tolist() for i, row in enumerate(matrix)}}


def switch_cost(rng, m):
    if rng.random() < 0.5:
        return {"switch_cost": rng.exponential(0.5)}
    return {"switch_cost": rng.exponential(0.5, (m, m)) * (rng.random((m, m)) < 0.7)}


def switch_cost_per_w2(rng, m):
    return {"switch_cost_per_w2": rng.exponential(0.5, (m, m)) if rng.random() < 0.5 else rng.exponential(0.3)}


def price(rng, m):
    prices = rng.exponential(0.3, m)
    prices[some(rng, m)] = rng.choice([0.0, 0.1])
    return {"price": prices.tolist() if rng.random() < 0.7 else {int(i): prices[i] for i in some(rng, m)}}


def max_switches(rng, m):
    return {"max_switches": int(rng.integers(4))}


def uses(rng, m):
    values = rng.choice([0.1, 0.3, 0.7, 1.0], m)
    values[some(rng, m)[: m - 1]] = 0.0
    if rng.random() < 0.2:
        return {int(i): values[i] for i in some(rng, m)}
    return values.tolist()


def budget(rng, m):
    return {"budget": Budget(use=uses(rng, m), limit=rng.choice([0.2, 0.3, 0.6]))}


def budget_window(rng, m):
    use = rng.choice([0.0, 0.1, 0.3, 0.7], m).tolist()
    return {"budget": Budget(use=use, limit=rng.choice([0.3, 0.6, 0.9]), window=int(rng.integers(1, 6)))}


def start(rng, m):
    rule = (min_dwell, max_dwell, budget_window, switch_cost, transitions)[rng.integers(5)]
    return rule(rng, m) | {"start": (int(rng.integers(m)), int(rng.integers(1, 5)))}


def allowed(rng, m):
    times = {}
    for i in some(rng, m):
        ends = sorted(rng.choice(11, 4, replace=False).tolist())
        if rng.random() < 0.6:
            ends[3] = math.inf
        times[f"A{i}"] = [tuple(ends[:2]), tuple(ends[2:])][rng.integers(2) :]
    return {"allowed": times}


def allowed_period(rng, m):
    period = int(rng.integers(2, 7))
    times = {}
    for i in some(rng, m)[: m - 1 if rng.random() < 0.7 else m]:
        begin, end = sorted(rng.choice(period + 1, 2, replace=False).tolist())
        times[i] = [(begin, end)]
    return {"allowed": times, "allowed_period": period}


def several(rng, m):
    rules = {}
    for rule in rng.choice(np.array(SINGLE[1:], dtype=object), rng.integers(2, 5), replace=False):
        rules |= rule(rng, m)
    if "allowed_period" in rules and any(given[-1][1] > rules["allowed_period"] for given in rules["allowed"].values()):
        del rules["allowed_period"]  # it was another draw's
    if {"min_dwell", "max_dwell"} <= rules.keys():  # for one mode they would be refused, whatever the others allow
        low, high = in_order(rules["min_dwell"], m, 1), in_order(rules["max_dwell"], m, math.inf)
        rules |= {"min_dwell": low, "max_dwell": [max(pair) for pair in zip(low, high, strict=True)]}
    return rules


def in_order(values, m, free):
    if isinstance(values, dict):
        return [values.get(i, values.get(f"A{i}", free)) for i in range(m)]
    return values if isinstance(values, list) else [values] * m


def seconds(rng, m, dt):
    """Several rules, with times that the modes' period need not divide."""
    rules = several(rng, m)
    rules.setdefault("min_dwell", 1)

    def time(steps, least=-0.4, most=0.4):
        return steps if steps == math.inf else round((steps + rng.choice([least, 0.0, most])) * dt, 6)

    for name, room in (("min_dwell", (-0.4, 0.0)), ("max_dwell", (0.0, 0.4))):
        if name in rules:
            free = 1 if name == "min_dwell" else math.inf
            rules[name] = [time(steps, *room) for steps in in_order(rules[name], m, free)]
    if "start" in rules:
        rules["start"] = (rules["start"][0], time(rules["start"][1], 0.0, 0.0))
    if "budget" in rules and rules["budget"].window is not None:
        old = rules["budget"]
        rules["budget"] = Budget(use=old.use, limit=old.limit, window=time(old.window, -0.4, 0.0))
    if "allowed" in rules:
        rules["allowed"] = {
            mode: [(abs(time(begin)), time(end, -0.4, -0.2)) for begin, end in given]
            for mode, given in rules["allowed"].items()
        }
    if "allowed_period" in rules:
        rules["allowed_period"] = time(rules["allowed_period"], 0.0, 0.0)
    return rules | {"time_unit": "s"}


def none(rng, m):
    return {}


SINGLE = [
    none,
    min_dwell,
    max_dwell,
    transitions,
    switch_cost,
    switch_cost_per_w2,
    price,
    max_switches,
    budget,
    budget_window,
    start,
    allowed,
    allowed_period,
]


def takeover(rng, m):
    """Modes in which a switch changes the state, mostly without a rule."""
    return {} if rng.random() < 0.6 else SINGLE[rng.integers(len(SINGLE))](rng, m)


KINDS = [*SINGLE, several, seconds, takeover]


def some_modes(rng, seconds=False, activation=False):
    """Modes so fast that late switches don't matter; some with one that isn't Schur, some with singular weights."""
    n, m = rng.integers(1, 4), rng.choice([2, 2, 3])
    A = random_modes(rng, n, m, radius=(0.2, 0.6))
    if rng.random() < 0.3:
        i = rng.integers(m)
        A[i] *= rng.uniform(1.05, 1.8) / np.abs(np.linalg.eigvals(A[i])).max()
    Q = None
    if rng.random() < 0.5:
        roots = rng.standard_normal((m, n, rng.integers(1, n + 1)))
        Q = roots @ np.swapaxes(roots, 1, 2)
    dt = float(rng.choice(PERIODS)) if seconds or rng.random() < 0.3 else True
    if not activation:
        return ModeSet(A, dt=dt, Q=Q)
    E = np.tile(np.eye(n), (m, m, 1, 1))
    for j, i in np.argwhere(~np.eye(m, dtype=bool)):
        if rng.random() < 0.8:
            E[j, i] = 0.7 * rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.7)
    return ModeSet(A, dt=dt, Q=Q, plant_states=rng.integers(1, n + 1), activation=E)


def instances(kind, count, seed, pool=None):
    """Modes, at most so many different ones, a state, rules, and the generator for what else is random."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    drawn = []
    for number in range(count):
        place = number % (pool or count)
        if place == len(drawn):
            drawn.append(some_modes(rng, kind is seconds, kind is takeover))
        modes = drawn[place]
        m, n, _ = modes.A.shape
        rules = kind(rng, m, modes.dt) if kind is seconds else kind(rng, m)
        yield modes, random_gaussian(rng, n), Rules(**rules), rng
