"""Rules and methods against enumeration: every kind of rule, on random small instances."""

import math
import re
from functools import cache, reduce
from itertools import combinations, product

import numpy as np
import pytest
from random_cases import random_gaussian, random_modes
from rule_checker import costs_of, start_of, true_cost, true_parts, violations

from switchctl import (
    Budget,
    Constant,
    ContradictionError,
    FewSwitches,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    schedule,
    single_mode_costs,
)
from switchctl.methods.lower_bounds import lower_bounds

INSTANCES = 500  # of each kind of rule
REFINED = 1250  # in all; some rules leave no way on
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
KINDS = [*SINGLE, several, seconds]
each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


def some_modes(rng, seconds=False):
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
    return ModeSet(A, dt=float(rng.choice(PERIODS)) if seconds or rng.random() < 0.3 else True, Q=Q)


def instances(kind, count, seed, pool=None):
    """Modes, at most so many different ones, a state, rules, and the generator for what else is random."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    drawn = []
    for number in range(count):
        place = number % (pool or count)
        if place == len(drawn):
            drawn.append(some_modes(rng, kind is seconds))
        modes = drawn[place]
        m, n, _ = modes.A.shape
        rules = kind(rng, m, modes.dt) if kind is seconds else kind(rng, m)
        yield modes, random_gaussian(rng, n), Rules(**rules), rng


def graph_of(modes, rules):
    """The graph; None where the rules contradict each other, which enumeration must confirm."""
    try:
        return SwitchingGraph(modes, rules)
    except ContradictionError as error:
        told = re.search(r"ends after at most (\d+) step", str(error))
        most = int(told[1]) if told else 0
        if rules.start is not None:  # the most is told of the rules without it, and an age lets a dwell end sooner
            most += start_of(modes, rules)[1]
        assert longest_run(modes, rules, most + 1) <= most, (rules, str(error))
        return None


def longest_run(modes, rules, most, begin=(), tries=1000):
    """How many steps some run that begins so obeys for: exactly up to ``most``, unless there are too many to try."""
    longest, stack = 0, [] if violations(modes, rules, begin) else [tuple(begin)]
    while stack and longest < most and tries:
        run, tries = stack.pop(), tries - 1
        longest = max(longest, len(run))
        likely_last = sorted(range(len(modes)), key=lambda i: bool(run) and i == run[-1])  # to stay rarely ends a run
        stack += [(*run, i) for i in likely_last if not violations(modes, rules, (*run, i))]
    return longest


@cache
def with_few_switches(m, steps, most):
    """Every sequence with at most so many switches, one a row."""
    sequences = []
    for switches in range(most + 1):
        for cuts in combinations(range(1, steps), switches):
            lengths = np.diff([0, *cuts, steps])
            orders = (order for order in product(range(m), repeat=switches + 1) if all(np.diff(order)))
            sequences += [np.repeat(order, lengths) for order in orders]
    return np.array(sequences)


def held_costs(modes):
    """What each mode costs when held for ever, as a matrix; None where it isn't Schur."""
    n, found = modes.A.shape[-1], []
    for A, Q in zip(modes.A, modes.Q, strict=True):
        P = np.linalg.solve(np.eye(n * n) - np.kron(A.T, A.T), Q.ravel()).reshape(n, n)
        found.append(P if np.abs(np.linalg.eigvals(A)).max() < 1 else None)
    return found


@cache
def quadratics(modes, steps, most):
    """The sequences that end in a Schur mode; W2 at each step and the cost of the state for ever, as x' .. x."""
    ends = held_costs(modes)
    sequences = with_few_switches(len(modes), steps, most)
    sequences = sequences[[ends[i] is not None for i in sequences[:, -1]]]
    moved = np.tile(np.eye(modes.A.shape[-1]), (len(sequences), 1, 1))
    w2, cost = [], 0.0
    for mode in sequences.T:
        w2.append(np.swapaxes(moved, 1, 2) @ moved)
        cost += np.swapaxes(moved, 1, 2) @ modes.Q[mode] @ moved
        moved = modes.A[mode] @ moved
    for i, P in enumerate(ends):
        if P is not None:
            last = sequences[:, -1] == i
            cost[last] += np.swapaxes(moved[last], 1, 2) @ P @ moved[last]
    return sequences, np.stack(w2, axis=1), modes.dk * cost


def enumerated(modes, x0, rules, most, steps, beyond=40):
    """The least cost of a run with at most so many switches, all in the first steps, that ends in one mode; or inf."""
    sequences, w2, cost = quadratics(modes, steps, most)
    S = np.outer(x0.mean, x0.mean) + x0.cov
    price, fixed, by_w2 = costs_of(modes, rules)
    start, _ = start_of(modes, rules)
    before = np.column_stack([sequences[:, 0] if start is None else np.full(len(sequences), start), sequences[:, :-1]])
    switched = sequences != before
    costs = np.tensordot(cost, S) + modes.dk * price[sequences].sum(axis=1)
    costs += (switched * (fixed[before, sequences] + by_w2[before, sequences] * np.tensordot(w2, S))).sum(axis=1)
    costs[(switched.sum(axis=1) > most) | (price[sequences[:, -1]] > 0)] = math.inf
    for place in np.argsort(costs):  # the first that obeys is the best, so few must be checked
        sequence = sequences[place].tolist()
        if costs[place] == math.inf:
            break
        if not violations(modes, rules, sequence):
            if not violations(modes, rules, sequence + [sequence[-1]] * beyond):
                return costs[place]
    return math.inf


def run_of(result, least=35):
    """The modes of a schedule, with at least so many of those that are repeated for ever."""
    rounds = -(-least // len(result.tail))
    return [*result.sequence.tolist(), *result.lead, *(result.tail * rounds)]


def switches_of(modes, rules, run):
    """The steps at which the mode changes."""
    start, _ = start_of(modes, rules)
    return np.flatnonzero(np.diff([run[0] if start is None else start, *run]))


def check_few_switches(modes, x0, rules, most, steps, listed=None):
    graph = graph_of(modes, rules)
    if graph is None:
        return
    least = enumerated(modes, x0, rules, most, steps)
    try:
        result = schedule(modes, x0, FewSwitches(most), listed, graph)
    except ValueError as error:
        assert "held for ever at finite cost" in str(error)
        assert least == math.inf, rules
        return
    run = run_of(result)
    switches = switches_of(modes, rules, run)
    assert violations(modes, rules, run) == []
    assert len(result.tail) == 1
    assert len(switches) <= most
    assert result.cost == pytest.approx(true_cost(modes, x0, rules, run), rel=1e-9)
    assert result.cost <= least * (1 + 1e-9), (rules, most)
    if len(switches) == 0 or switches[-1] < steps:
        assert result.cost == pytest.approx(least, rel=1e-9), (rules, most)


@pytest.fixture
def bounds_once(monkeypatch):
    """Bounds that depend on the modes alone take half the time of FewSwitches here: compute them once a mode set."""
    known = {}

    def bounds(A, Q):
        key = A.tobytes(), Q.tobytes()
        if key not in known:
            known[key] = lower_bounds(A, Q)
        return known[key]

    monkeypatch.setattr("switchctl.methods.few_switches.lower_bounds", bounds)


@pytest.mark.slow
@each_kind
def test_few_switches_finds_the_optimum(kind, bounds_once):
    for modes, x0, rules, rng in instances(kind, INSTANCES if kind is not seconds else 150, 0, pool=25):
        most = rng.choice(3, p=[0.2, 0.4, 0.4])
        check_few_switches(
            modes, x0, rules, most, steps=8 if most == 2 else 10, listed=rng.choice([None, 1], p=[0.2, 0.8])
        )


@each_kind
def test_three_switches(kind):
    for modes, x0, rules, _ in instances(kind, 10, 1):
        check_few_switches(modes, x0, rules, 3, steps=7)


@each_kind
def test_the_graph_allows_what_can_go_on(kind):
    for modes, _, rules, rng in instances(kind, 8, 2):
        graph = graph_of(modes, rules)
        if graph is None:
            continue
        node, run = 0, ()
        for _ in range(8):
            enough = len(run) + 20
            goes_on = [longest_run(modes, rules, enough, (*run, i)) == enough for i in range(len(modes))]
            assert (graph.successor[node] >= 0).tolist() == goes_on, (rules, run)
            mode = int(rng.choice(np.flatnonzero(goes_on)))
            node, run = graph.successor[node, mode], (*run, mode)


METHODS = [
    PointwiseMinimum(),
    RecedingHorizon(3),
    RecedingHorizon(6, hold=2),
    RecedingHorizon(2, hold=4),
    RecedingHorizon([5, 1, 2], hold=3),  # so far, methods that need no way on at finite cost
    RecedingHorizon(math.inf),
    RecedingHorizon(math.inf, hold=3),
    RecedingHorizon(3, decrease=0.3),
    RecedingHorizon(4, hold=2, decrease=0.7),
    Rollout(),
    Refine(),
    Refine(PointwiseMinimum()),
    FewSwitches(1),
    FewSwitches(2),
]
LOOK_NOT_TO_THE_END = 5
NO_WAY = "at finite cost|held for ever|costs infinitely much|needs a Schur mode|needs every mode to be Schur"


def may_hover(rules):
    """Whether a short horizon may see more in a price or a cost than in the state, and never end."""
    return rules.price != 0 or rules.switch_cost != 0


def attempt(modes, x0, method, steps, graph):
    """A schedule; None where the method says that there is no way for it."""
    try:
        return schedule(modes, x0, method, steps, graph)
    except ValueError as error:
        assert re.search(NO_WAY, str(error)), str(error)
        return None


def radius(modes, word):
    return np.abs(np.linalg.eigvals(reduce(np.matmul, [modes.A[i] for i in reversed(word)]))).max()


def finite(modes, rules, word):
    """Whether a word repeated for ever costs finitely much."""
    price, fixed, _ = costs_of(modes, rules)
    switches = [(i, j) for i, j in zip((word[-1], *word[:-1]), word, strict=True) if i != j]
    return radius(modes, word) < 1 and not any(price[i] for i in word) and not any(fixed[pair] for pair in switches)


def check_run(modes, x0, rules, result):
    assert violations(modes, rules, run_of(result)) == []
    assert math.isfinite(result.cost) == finite(modes, rules, result.tail)
    if math.isfinite(result.cost):
        rounds = math.ceil(-10 / math.log10(max(radius(modes, result.tail), 1e-5))) + 10  # until W2 is nothing
        parts = true_parts(modes, x0, rules, run_of(result, rounds * len(result.tail)))
        assert result.cost == pytest.approx(sum(parts), rel=1e-9)
        assert result.cost_parts == pytest.approx(parts, rel=1e-9, abs=1e-9 * result.cost)


@pytest.mark.slow
@each_kind
def test_every_method_obeys(kind):
    for modes, x0, rules, rng in instances(kind, 8, 3):
        graph = graph_of(modes, rules)
        if graph is None:
            continue
        for method in rng.choice(np.array(METHODS, dtype=object), 4, replace=False):
            steps = rng.choice([None, 1, 4, 9])
            if may_hover(rules):
                if method == Refine(PointwiseMinimum()):
                    continue
                steps = steps or 200
            result = attempt(modes, x0, method, steps, graph)
            if result is None:
                assert method not in METHODS[:LOOK_NOT_TO_THE_END]
                continue
            check_run(modes, x0, rules, result)
            scheduler = method.start(SwitchingGraph(modes, rules))  # not schedule's, to share nothing
            online = [scheduler.step(result.mean[:, k], result.cov[k]) for k in range(len(result))]
            assert online == result.sequence.tolist(), (rules, method)


@each_kind
def test_constant_holds_as_soon_as_the_rules_allow(kind):
    for modes, x0, rules, rng in instances(kind, 10, 4):
        graph = graph_of(modes, rules)
        if graph is None:
            continue
        mode = int(rng.integers(len(modes)))
        result = attempt(modes, x0, Constant(mode), 40, graph)
        earliest = 5
        if result is not None:
            assert violations(modes, rules, result.sequence) == []
            earliest = max((k + 1 for k, i in enumerate(result.sequence) if i != mode), default=0)
        for steps in range(min(earliest, 5)):
            for before in product(range(len(modes)), repeat=steps):
                assert violations(modes, rules, [*before, *[mode] * 40]), (rules, before, mode)


@each_kind
def test_methods_that_look_to_the_end_cost_no_more_than_any_mode_held(kind):
    for modes, x0, rules, rng in instances(kind, 8, 5):
        graph = graph_of(modes, rules)
        if graph is None:
            continue
        held = [attempt(modes, x0, Constant(i), 60, graph) for i in range(len(modes))]
        costs = [
            math.inf
            if result is None or not finite(modes, rules, (i,))
            else true_cost(modes, x0, rules, result.sequence)
            for i, result in enumerate(held)
        ]
        assert single_mode_costs(graph, x0) == pytest.approx(costs, rel=1e-9), rules
        for method in (Rollout(), RecedingHorizon(math.inf), RecedingHorizon(math.inf, hold=3)):
            result = attempt(modes, x0, method, rng.choice([None, 3]), graph)
            if np.isfinite(costs).any():
                assert result.cost <= min(costs) * (1 + 1e-9), (rules, method)


BASES = [
    Rollout(),
    RecedingHorizon(math.inf, hold=2),
    Constant(0),
    PointwiseMinimum(),  # from here on, short horizons
    RecedingHorizon(4),
    RecedingHorizon(3, hold=3),
]


@pytest.mark.slow
def test_refine_never_costs_more_than_its_base(bounds_once):
    compared = improved = 0
    for kind in KINDS:
        for modes, x0, rules, rng in instances(kind, REFINED // len(KINDS), 6, pool=20):
            graph = graph_of(modes, rules)
            base = BASES[rng.integers(3 if may_hover(rules) else len(BASES))]
            if graph is None or (result := attempt(modes, x0, base, None, graph)) is None:
                continue
            refined = attempt(modes, x0, Refine(base), 1, graph)
            assert (refined is not None) == math.isfinite(result.cost)
            if refined is not None:
                assert refined.cost <= result.cost * (1 + 1e-9), (rules, base)
                assert violations(modes, rules, run_of(refined)) == []
                compared, improved = compared + 1, improved + (refined.cost < result.cost * (1 - 1e-9))
    assert compared >= 1000
    assert improved >= 100


@pytest.mark.slow
def test_rules_that_forbid_nothing_change_nothing():
    for modes, x0, _, rng in instances(none, 12, 7):
        m = len(modes)
        free = Rules(min_dwell=1, switch_cost=0, transitions=np.ones((m, m)))
        steps = rng.choice([None, 5])
        for method in [*METHODS, *map(Constant, range(m))]:
            plain, *others = [attempt(modes, x0, method, steps, rules) for rules in (None, Rules(), free)]
            for other in others:
                assert (plain is None) == (other is None)
                if plain is not None:
                    assert plain.sequence.tobytes() == other.sequence.tobytes()
                    assert (plain.lead, plain.tail, plain.cost) == (other.lead, other.tail, other.cost)
                    assert plain.cost_parts == other.cost_parts


@pytest.mark.parametrize(
    ("rules", "good", "bad"),
    [
        (Rules(min_dwell={"A0": 3}), ["0001000", "00010", "10"], ["0010", "10010"]),
        (Rules(max_dwell=[2, math.inf]), ["0011111001"], ["000", "1000"]),
        (Rules(transitions={"A0": ["A1"], "A1": []}), ["0001111", "1"], ["10"]),
        (Rules(transitions=[[0, 0], [1, 0]]), ["110", "00"], ["01"]),
        (Rules(max_switches=1), ["0001"], ["00010"]),
        (Rules(max_switches=1, start=("A1", 1)), ["1110", "000"], ["01", "101"]),
        (Rules(budget=Budget(use=[0.1, 0.0], limit=0.3)), ["1010101111"], ["10101010"]),
        (Rules(budget=Budget(use=[0.1, 0.0], limit=0.3), start=(0, 9)), ["000"], ["0000"]),
        (Rules(budget=Budget(use=[1, 0], limit=2, window=3)), ["0010010100"], ["000", "100101101000"]),
        (Rules(budget=Budget(use=[1, 0], limit=2, window=3), start=(0, 1)), ["0100", "100"], ["00"]),
        (Rules(budget=Budget(use=[1, 0], limit=2, window=3), start=(0, 7)), ["1001"], ["0"]),
        (Rules(min_dwell=4, start=(0, 2)), ["001111", "0"], ["01", "1"]),
        (Rules(max_dwell=4, start=(0, 2)), ["001", "1"], ["000"]),
        (Rules(allowed={1: [(1, 3), (5, math.inf)]}), ["01100111", "0000"], ["1", "0111"]),
        (Rules(allowed={1: [(1, 3)]}, allowed_period=4), ["0110011001100"], ["01101", "0110111"]),
        (Rules(min_dwell=0.25, max_dwell={1: 0.35}, time_unit="s"), ["0001110000", "1"], ["001", "1111"]),
        (Rules(allowed={1: [(0.11, 0.49), (0.5, 0.55)]}, time_unit="s"), ["001100"], ["01", "00111", "000001"]),
        (Rules(budget=Budget(use=[1, 0], limit=1, window=0.15), time_unit="s"), ["0101"], ["1100"]),
        (Rules(max_dwell=0.3, start=(0, 0.2), time_unit="s"), ["01"], ["00"]),
    ],
)
def test_the_checker_itself(rules, good, bad):
    modes = ModeSet([[[0.9]], [[0.5]]], dt=0.1)
    for sequence in good:
        assert violations(modes, rules, sequence) == []
    for sequence in bad:
        assert len(violations(modes, rules, sequence)) > 0


SLOW, FAST = 0, 1
AHEAD = [PointwiseMinimum(), RecedingHorizon(3), Rollout()]


@pytest.mark.parametrize("method", AHEAD)
@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        (Rules(min_dwell=5, start=(SLOW, 3)), [0, 0, 1, 1]),
        (Rules(min_dwell=5, start=(SLOW, 5)), [1, 1]),
        (Rules(min_dwell=5, start=(SLOW, 50)), [1, 1]),
        (Rules(max_dwell={FAST: 5}, start=(FAST, 3)), [1, 1, 0, 1, 1, 1, 1, 1, 0]),
        (Rules(max_dwell={FAST: 5}, start=(FAST, 5)), [0, 1]),
        (Rules(max_dwell={FAST: 5}, start=(SLOW, 5)), [1, 1, 1, 1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2, window=3)), [1, 1, 0, 1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2, window=3), start=(FAST, 1)), [1, 0, 1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2, window=3), start=(FAST, 2)), [0, 1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2, window=3), start=(FAST, 9)), [0, 1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2, window=3), start=(SLOW, 9)), [1, 1, 0]),
        (Rules(budget=Budget(use={FAST: 1}, limit=2), start=(FAST, 9)), [1, 1, 0, 0, 0]),
        (Rules(max_switches=0, start=(SLOW, 1)), [0, 0, 0]),
        (Rules(transitions={SLOW: [], FAST: [SLOW]}, start=(SLOW, 1)), [0, 0, 0]),
        (Rules(allowed={FAST: [(1, 3)]}, start=(FAST, 4)), [0, 1, 1, 0, 0]),
    ],
)
def test_what_came_before_the_start_counts(rules, expected, method):
    modes, x0 = ModeSet([[[0.9]], [[0.5]]]), Gaussian([1.0], [[0.0]])
    result = schedule(modes, x0, method, rules=rules)
    assert result.sequence.tolist()[: len(expected)] == expected


def test_a_mode_held_for_longer_than_it_may_be_is_no_start():
    with pytest.raises(ContradictionError, match="longer than it may be"):
        SwitchingGraph(ModeSet([[[0.9]], [[0.5]]]), Rules(max_dwell=3, start=(0, 4)))


def test_a_dwell_cut_by_the_last_step_goes_on():
    modes, x0 = ModeSet([[[0.9]], [[0.5]]]), Gaussian([1.0], [[0.0]])
    least, most = SwitchingGraph(modes, Rules(min_dwell=4)), SwitchingGraph(modes, Rules(max_dwell=3))
    for graph, sequence, lead, tail, obeys in [
        (least, [0, 0], (0, 0), (1,), True),
        (least, [0, 0], (0,), (1,), False),
        (least, [0, 0], (), (1,), False),
        (least, [0, 0, 0, 0, 1, 1], (), (1,), True),
        (least, [0, 0, 0, 0, 1, 1], (), (1, 1, 0, 0, 0, 0, 1, 1), True),
        (least, [0, 0, 0, 0, 1, 1], (), (0, 0, 0, 0, 1, 1, 1, 1), False),
        (most, [0, 0], (), (0, 1), True),
        (most, [0, 0], (0, 0), (1, 0), False),
        (most, [0, 0], (), (0,), False),
        (most, [0], (1,), (1, 1, 0, 0, 1, 1), False),
        (most, [0], (1,), (1, 0, 0, 0, 1), True),
    ]:
        assert obeys == (violations(modes, graph.rules, [*sequence, *lead, *tail * 9]) == [])
        if obeys:
            check_run(modes, x0, graph.rules, Schedule(modes, x0, sequence, tail, lead=lead, graph=graph))
        else:
            with pytest.raises(ValueError, match=r"not allowed|can't repeat"):
                Schedule(modes, x0, sequence, tail, lead=lead, graph=graph)


@pytest.mark.parametrize("steps", [1, 2, 6])
@pytest.mark.parametrize("start", [None, (FAST, 1)])
def test_constant_goes_on_for_ever_after_the_last_step(steps, start):
    modes, x0 = ModeSet([[[0.9]], [[0.5]]]), Gaussian([1.0], [[0.0]])
    result = schedule(modes, x0, Constant(SLOW), steps, Rules(min_dwell=5, start=start))
    assert run_of(result) == [FAST] * (0 if start is None else 4) + [SLOW] * (len(run_of(result)) - 4 * bool(start))
