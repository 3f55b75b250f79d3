"""Stability where there is no theorem, no time or no room: undecided with its reason, or bounds that still hold."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from pair import modes as pair

from switchctl import FewSwitches, ModeSet, Optimal, PointwiseMinimum, RecedingHorizon, Refine, Rollout, Rules
from switchctl import SwitchingGraph as Graph
from switchctl.moments import transform
from switchctl.stability import (
    does_switching_help,
    joint_spectral_radius,
    policy_stability,
    random_stability,
    report,
    word_stability,
)

TWO = [[[0.5]], [[0.9]]]
GROWING = ModeSet([2 * np.eye(2), 3 * np.eye(2)])
BLIND = ModeSet([np.diag([0.5, 0.6]), np.diag([0.6, 0.5])], Q=np.diag([1.0, 0.0]))
SLOW = ModeSet([[[1 - 1e-7]], [[1 - 1e-7]]])
IDLE = ModeSet([[[0.5]], [[2.0]]])


@pytest.mark.parametrize(
    ("modes", "method", "why"),
    [
        (ModeSet(TWO, cost=("discounted", 0.9)), FewSwitches(1), "finite discounted cost may grow"),
        (BLIND, FewSwitches(1), "the stage weights leave states unseen"),
        (BLIND, RecedingHorizon(np.inf), "the stage weights leave states unseen"),
        (BLIND, Rollout(), "the stage weights leave states unseen"),
        (GROWING, Refine(PointwiseMinimum()), "no way on at finite cost is known"),
        (Graph(ModeSet(TWO), Rules(min_dwell=2)), PointwiseMinimum(), "under rules or prices has no theorem"),
        (ModeSet(TWO, Q=[[[2.0]], [[1.0]]]), PointwiseMinimum(), "one positive definite Q alone"),
        (ModeSet([[[1.5]], [[2.0]]]), PointwiseMinimum(), "no mean of the modes' next W2 is below"),
        (pair(), RecedingHorizon(3), "no theorem without a constraint at a finite horizon"),
        (SLOW, RecedingHorizon(3, decrease=0.1), "how long holds may have to be is not found"),
    ],
)
def test_a_method_without_a_theorem(modes, method, why):
    found = policy_stability(modes, method)
    assert found.verdict == "undecided" and why in found.why
    assert (found.rate, found.constant) == (None, None)


def test_a_policy_with_rules_and_one_of_other_weights():
    free = pair()
    policy = Optimal(gap=0.05).policy(free)
    assert policy_stability(free, policy).rate < 1
    ruled = Graph(free, Rules(min_dwell=2))
    found = policy_stability(ruled, Optimal(gap=0.05).policy(free, rules=ruled))
    assert found.verdict == "stable" and found.rate is None and "is finite" in found.why
    found = policy_stability(BLIND, replace(policy, graph=Graph(BLIND)))
    assert found.verdict == "undecided" and "unseen" in found.why


def test_a_report_of_modes_that_nothing_holds():
    found = report(GROWING, time_limit=1)
    assert "stabilising word  none was found, which proves nothing" in repr(found)


def test_a_report_with_no_time_and_one_from_another_thread():
    three = ModeSet([[[0.9, 3.0], [0.0, 0.5]], [[0.5, 0.0], [3.0, 0.9]], [[0.8, 0.0], [1.0, 0.8]]])
    assert np.isnan(report(three, time_limit=1e-9).pairs.lower).any()
    found = []
    thread = threading.Thread(target=lambda: found.append(report(IDLE, time_limit=0.5)))
    thread.start()
    thread.join()
    assert found[0].joint_spectral_radius.verdict == "unstable"


def test_more_words_than_can_be_listed():
    """Weights that see each state only after three steps, of seventeen modes."""
    A = [np.array([[0.5, 0.1 + k / 100, 0.0], [0.0, 0.4, 0.1 + k / 100], [0.0, 0.0, 0.3]]) for k in range(17)]
    modes = ModeSet(A, Q=np.diag([1.0, 0.0, 0.0]))
    found = does_switching_help(modes)
    first, then = found.pair
    costs = [np.trace(P @ found.moment) for P in modes.tails]
    once = modes.Q[first] + transform(modes.A[first], modes.tails[then])
    assert found.helps and np.trace(once @ found.moment) < 0.95 * min(costs)


def test_a_chain_of_many_modes():
    """More unknowns than all eigenvalues are computed for; the mean squares of x grow by the mean of the squares."""
    factors = np.linspace(0.1, 1.2, 50)
    even = np.full((50, 50), 1 / 50)
    found = random_stability(ModeSet(factors[:, None, None] * np.eye(6)), even)
    assert found.lower <= np.sqrt(np.mean(factors**2)) <= found.upper <= 1.001 * found.lower


def test_products_beyond_the_floating_point_range():
    assert word_stability(ModeSet([[[0.0, 1e308], [0.0, 0.0]], [[1e308, 0.0], [1e308, 0.0]]]), [0, 1]).lower > 1
    found = word_stability(ModeSet([1e300 * np.eye(2), [[1e-300, 0.0], [0.0, 5e-324]]]), [0, 1])
    assert found.lower <= 1 <= found.upper and found.verdict == "undecided"
    spread = ModeSet([[[1e200]], [[1e-200]]])
    assert random_stability(spread, [[0.5, 0.5], [0.5, 0.5]]).verdict == "unstable"
    assert joint_spectral_radius(spread, time_limit=0.2).lower >= 0.99e200
