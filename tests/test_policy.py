"""The policy: its guarantee for every initial state, and where it is refused."""

import math
import time

import numpy as np
import pytest

from switchctl import Gaussian, ModeSet, Optimal, Rules, SwitchingGraph, schedule
from switchctl.models import five_mode, servo


@pytest.fixture(scope="module")
def pair():
    return ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])


@pytest.mark.parametrize("rules", [None, Rules(min_dwell=3), Rules(switch_cost=0.05, min_dwell={"fast": 2})])
def test_the_policy_keeps_its_promise(pair, rules):
    policy = Optimal(gap=0.05).policy(pair, rules)
    assert policy.factor < 1.1
    rng = np.random.default_rng(0)
    for _ in range(30):
        start = Gaussian(rng.standard_normal(2) * rng.choice([0, 1]), np.outer(v := rng.standard_normal(2), v))
        best = schedule(pair, start, Optimal(gap=1e-3, time_limit=10), rules=rules)
        assert schedule(pair, start, policy, rules=rules).cost <= policy.factor * best.cost


def test_more_quadratics_promise_more():
    factors = [Optimal(gap=1e-2).policy(five_mode.modes(), quadratics=q).factor for q in (5, 20, 50)]
    assert factors == sorted(factors, reverse=True)
    assert factors[-1] < 1.05


def test_a_policy_is_refused_where_it_cannot_be(pair):
    with pytest.raises(ValueError, match="singular"):
        Optimal().policy(servo.modes())
    with pytest.raises(ValueError, match="none is known"):
        Optimal().policy(ModeSet([[[1.1]], [[1.2]]]))
    with pytest.raises(ValueError, match="too many for a policy"):
        Optimal().policy(pair, Rules(max_switches=300))
    policy = Optimal(gap=0.2).policy(pair)
    with pytest.raises(ValueError, match="the policy is for"):
        policy.start(SwitchingGraph(pair, Rules(min_dwell=2)))


def test_the_policy_knows_no_units():
    def factor_of(unit):
        modes = ModeSet([[[0.56]], [[0.36]], [[0.74]]], Q=np.array([[[0.1]], [[1.0]], [[0.02]]]))
        price = [0.18 * unit**2, 0.4 * unit**2, 0.21 * unit**2]
        rules = Rules(switch_cost=0.3 * unit**2, price=price, min_dwell=3, start=(2, 1))
        return Optimal(gap=0.05).policy(modes, rules, quadratics=10).factor

    assert factor_of(1e-8) == pytest.approx(factor_of(1.0), rel=1e-6)


def test_the_policy_ends_in_the_way_its_value_promises():
    modes = ModeSet([np.diag([0.5, 1.1]), np.diag([1.1, 0.5]), 0.95 * np.eye(2)])
    policy, start = Optimal(gap=0.05).policy(modes), Gaussian([1.0, 1.0], np.zeros((2, 2)))
    best = schedule(modes, start, Optimal())
    for steps in (None, 1, 2, 3, 10):
        assert schedule(modes, start, policy, steps).cost <= policy.factor * best.cost


def test_a_policy_keeps_its_time_limit():
    A = 0.3 * np.random.default_rng(0).standard_normal((8, 4, 4))
    begun = time.perf_counter()
    policy = Optimal(time_limit=0.5).policy(ModeSet(A), Rules(max_dwell=6, switch_cost_per_w2=0.1))
    assert time.perf_counter() - begun < 10
    assert policy.factor == math.inf
    assert "no guarantee" in repr(policy)
