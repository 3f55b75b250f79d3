"""Rules and methods against enumeration: every kind of rule, on random small instances."""

import math
import re
from functools import reduce
from itertools import product

import numpy as np
import pytest
from enumeration import check_few_switches, graph_of, longest_run, run_of
from random_rules import (
    KINDS,
    instances,
    max_dwell,
    min_dwell,
    none,
    price,
    seconds,
    switch_cost,
    switch_cost_per_w2,
)
from rule_checker import costs_of, true_cost, true_parts, violations

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
from switchctl.optimum.minorants import lower_bounds

INSTANCES = 300  # of each kind of rule
REFINED = 1400  # in all; some rules leave no way on
each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


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
    for modes, x0, rules, rng in instances(kind, INSTANCES if kind is not seconds else 150, 0, pool=10):
        most = rng.choice(3, p=[0.25, 0.45, 0.3])
        check_few_switches(
            modes, x0, rules, most, steps=8 if most == 2 else 10, listed=rng.choice([None, 1], p=[0.2, 0.8])
        )


@each_kind
def test_three_switches(kind):
    for modes, x0, rules, _ in instances(kind, 10, 1):
        check_few_switches(modes, x0, rules, 3, steps=7)


def test_few_switches_looks_past_a_start_that_is_not_worth_keeping():
    matrices = [[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]], [[9.0, 0.0], [0.0, 9.0]]]
    modes, x0 = ModeSet(matrices, names=["fast", "calm", "bad"]), Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    free = schedule(modes, x0, FewSwitches(1), rules=Rules(min_dwell=2))
    for most in (2, 3):
        result = schedule(modes, x0, FewSwitches(most), rules=Rules(min_dwell=2, start=("bad", 2)))
        assert result.cost <= free.cost * (1 + 1e-9)


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
    steps = [modes.A[i] for i in word]
    if modes.activation is not None:
        before = (word[-1], *word[:-1])
        steps = [A @ modes.activation[j, i] for A, j, i in zip(steps, before, word, strict=True)]
    return np.abs(np.linalg.eigvals(reduce(np.matmul, steps[::-1]))).max()


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
def test_every_method_obeys(kind, bounds_once):
    for modes, x0, rules, rng in instances(kind, 8, 3, pool=2):
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


@pytest.mark.parametrize("kind", [min_dwell, max_dwell, switch_cost, switch_cost_per_w2, price])
def test_a_finite_horizon_compares_modes_held_for_as_long_as_the_rules_allow(kind):
    for modes, x0, rules, rng in instances(kind, 40, 8):
        if not modes.schur.all() or not np.isinf(SwitchingGraph(modes, rules).holds).any(axis=1).all():
            continue  # some moves leave no way on at finite cost, and are none
        T = int(rng.integers(1, 6))
        chosen = schedule(modes, x0, RecedingHorizon(T), 6, rules).sequence.tolist()
        for k in range(6):
            best = {}
            for i in range(len(modes)):
                holds = [h for h in range(1, T + 2) if not violations(modes, rules, [*chosen[:k], *[i] * h])]
                plans = [[i] * max(holds, default=0)]
                if 0 < len(plans[0]) <= T:
                    plans = [[*plans[0], *[j] * (T + 1 - len(plans[0]))] for j in range(len(modes)) if j != i]
                costs = [true_cost(modes, x0, rules, chosen[:k] + plan) for plan in plans if plan]
                if costs:
                    best[i] = min(costs)
            assert best[chosen[k]] <= min(best.values()) * (1 + 1e-9), (rules, T, k)


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
        for modes, x0, rules, rng in instances(kind, REFINED // len(KINDS), 6, pool=10):
            graph = graph_of(modes, rules)
            base = BASES[rng.integers(3 if may_hover(rules) else len(BASES))]
            if graph is None or (result := attempt(modes, x0, base, None, graph)) is None:
                continue
            refined = attempt(modes, x0, Refine(base), 1, graph)
            assert (refined is not None) == math.isfinite(result.cost)
            if refined is not None:
                assert refined.cost <= result.cost * (1 + 1e-9), (rules, base)
                assert refined.statistics["start"] == pytest.approx(result.cost, rel=1e-9)
                assert violations(modes, rules, run_of(refined)) == []
                compared, improved = compared + 1, improved + (refined.cost < result.cost * (1 - 1e-9))
    assert compared >= 1000
    assert improved >= 100


@pytest.mark.slow
def test_rules_that_forbid_nothing_change_nothing(bounds_once):
    for modes, x0, _, rng in instances(none, 8, 7):
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
