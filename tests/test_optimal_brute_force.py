"""The optimum against enumeration, under every kind of rule."""

import math

import numpy as np
import pytest
from enumeration import enumerated, graph_of, run_of
from random_rules import KINDS, instances
from rule_checker import start_of, true_cost, violations

from switchctl import Optimal, schedule

each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


def every_run(modes, rules, graph, steps):
    """All sequences of so many steps that obey the rules, step by step, and can go on; with the nodes they lead to."""
    runs = [((), 0)]
    for _ in range(steps):
        runs = [
            ((*run, i), int(graph.successor[node, i]))
            for run, node in runs
            for i in range(len(modes))
            if graph.successor[node, i] >= 0
        ]
    return [run for run, _ in runs]


def check_finite(modes, x0, rules, steps, rng):
    graph = graph_of(modes, rules)
    if graph is None:
        return 0
    n = modes.A.shape[-1]
    root = rng.standard_normal((n, rng.integers(0, n + 1)))
    M = root @ root.T
    costs = {}
    S0 = np.outer(x0.mean, x0.mean) + x0.cov
    for run in every_run(modes, rules, graph, steps):
        product, before = np.eye(n), start_of(modes, rules)[0]
        for mode in run:
            if modes.activation is not None and before is not None:
                product = modes.activation[before, mode] @ product
            product, before = modes.A[mode] @ product, mode
        costs[run] = true_cost(modes, x0, rules, run) + modes.dk * np.vdot(M, product @ S0 @ product.T)
    least = min(costs.values())
    gap = rng.choice([0.3, 1e-2, 1e-6])
    result = schedule(modes, x0, Optimal(gap=gap), steps, graph, terminal=M)
    run = tuple(result.sequence.tolist())
    assert violations(modes, rules, run) == []
    assert result.tail == result.lead == ()
    assert result.cost == pytest.approx(costs[run], rel=1e-9)
    assert result.lower_bound <= least * (1 + 1e-12), (rules, gap)
    assert result.gap <= gap
    assert result.status == ("optimal" if result.gap <= 1e-9 else "gap reached")
    assert result.cost <= least / (1 - gap) * (1 + 1e-9)
    return 1


def check_endless(modes, x0, rules, steps, rng):
    """The optimum lies between the least cost of the first steps alone and the cheapest run known."""
    graph = graph_of(modes, rules)
    if graph is None:
        return 0
    gap = rng.choice([0.1, 1e-2, 1e-5])
    try:
        result = schedule(modes, x0, Optimal(gap=gap, time_limit=20), rules=graph)
    except ValueError as error:
        assert "none was found" in str(error)
        assert enumerated(modes, x0, rules, 2, 8) == math.inf
        return 0
    first = min(true_cost(modes, x0, rules, run) for run in every_run(modes, rules, graph, steps))
    known = enumerated(modes, x0, rules, 2, 8)
    if result.cost == math.inf:
        assert result.status == "no stabilising sequence found"
        assert result.gap == 1
        assert known == math.inf
        return 0
    run = run_of(result, 60)
    assert violations(modes, rules, run) == []
    assert result.cost == pytest.approx(true_cost(modes, x0, rules, run), rel=1e-6)
    assert result.lower_bound <= result.cost
    assert result.lower_bound <= known * (1 + 1e-9), (rules, gap)
    assert result.gap <= gap, (result.status, rules)
    assert result.cost * (1 - gap) <= known * (1 + 1e-9)
    assert first <= result.cost * (1 + 1e-9)
    return 1


@each_kind
def test_finite_horizons(kind):
    closed = sum(
        check_finite(modes, x0, rules, 6 if len(modes) == 2 else 4, rng)
        for modes, x0, rules, rng in instances(kind, 40, 5, pool=20)
    )
    assert closed > 15


@each_kind
def test_for_ever(kind):
    closed = sum(
        check_endless(modes, x0, rules, 5 if len(modes) == 2 else 4, rng)
        for modes, x0, rules, rng in instances(kind, 25, 6, pool=10)
    )
    assert closed > 8


@pytest.mark.slow
@each_kind
def test_many_finite_horizons(kind):
    for modes, x0, rules, rng in instances(kind, 50, 7, pool=25):
        check_finite(modes, x0, rules, 7 if len(modes) == 2 else 5, rng)


@pytest.mark.slow
@each_kind
def test_many_for_ever(kind):
    for modes, x0, rules, rng in instances(kind, 40, 8, pool=25):
        check_endless(modes, x0, rules, 5 if len(modes) == 2 else 4, rng)
