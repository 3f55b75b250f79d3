"""What is called stable is, from hostile initial states too, and within the bound that is stated."""

from dataclasses import dataclass

import numpy as np
import pytest
from random_cases import random_modes

from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    Method,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    SwitchingGraph,
    schedule,
)
from switchctl.models import five_mode, servo
from switchctl.stability import policy_stability

STEPS = 80


def worst_excess(graph, method, stability, rng, tries=25):
    """The greatest ``tr S(k) / (constant rate^(2k) tr S(0))``, over states drawn and then bent towards the worst."""
    modes = graph.modes if isinstance(graph, SwitchingGraph) else graph
    n = modes.A.shape[-1]

    def excess(F):
        scheduler, ratios, S0 = method.start(graph), [], np.sum(F * F)
        last = scheduler.graph.start_mode
        for k in range(STEPS):
            if np.sum(F * F) < 1e-200:
                break
            ratios.append(np.sum(F * F) / (stability.constant * stability.rate ** (2 * k) * S0))
            mode = scheduler.step(F[:, 0], F[:, 1:] @ F[:, 1:].T)
            F = modes.A_after[last, mode] @ F
            last = mode
        return max(ratios)

    best = None
    for k in range(tries):
        if k < n:
            F = np.zeros((n, n + 1))
            F[k, 0] = 1.0
        elif best is None or k < tries // 2:
            F = np.zeros((n, n + 1))
            F[:, : (1 if k % 2 else n + 1)] = rng.standard_normal((n, 1 if k % 2 else n + 1))
        else:
            F = best[1] + 0.3 * rng.standard_normal((n, n + 1)) * (np.abs(best[1]) > 0)
        value = excess(F)
        if best is None or value > best[0]:
            best = value, F
    return best[0]


def mixed_modes(rng, n, m):
    """Some Schur, some not."""
    A = random_modes(rng, n, m, (0.4, 1.25))
    A[0] *= 0.8 / np.abs(np.linalg.eigvals(A[0])).max()
    return ModeSet(A)


@pytest.mark.parametrize("seed", range(4))
def test_rollout_falls_as_proven(seed):
    rng = np.random.default_rng(seed)
    modes = mixed_modes(rng, int(rng.integers(1, 4)), int(rng.integers(2, 4)))
    stability = policy_stability(modes, Rollout())
    assert stability.verdict == "stable" and 0 < stability.fall.share <= 1
    assert 0.02 < worst_excess(modes, Rollout(), stability, rng) <= 1


def test_the_witness_of_rollout():
    """Every weight is above the share of the mean of quadratics, and these fall along their own modes."""
    modes = five_mode.modes()
    fall = policy_stability(modes, Rollout()).fall
    assert fall.steps == 1 and len(fall.weights[0]) == 1
    for Q, mix in zip(fall.weights[0], fall.mixes[0], strict=True):
        assert (mix >= 0).all() and mix.sum() == pytest.approx(1)
        assert np.linalg.eigvalsh(Q - fall.share * np.tensordot(mix, fall.P[0], 1))[0] > 0
        assert np.linalg.eigvalsh(Q - 1.001 * fall.share * np.tensordot(mix, fall.P[0], 1))[0] < 0
    tails = [P for P in modes.tails if P is not None]
    assert np.allclose(fall.P[0], tails)
    assert all(Q == pytest.approx(np.eye(2)) for Q in fall.weights[0])
    mean = policy_stability(modes, Rollout()).rate
    alone = max(1 / np.linalg.eigvalsh(P)[-1] for P in tails)
    assert mean < np.sqrt(1 - alone)  # a mean of them is better than any one of them


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "rules",
    [
        Rules(min_dwell=3),
        Rules(max_dwell=2, min_dwell=2),
        Rules(switch_cost_per_w2=0.5),
        Rules(min_dwell=2, start=("A1", 1)),
    ],
)
def test_rollout_under_rules_falls_as_proven(seed, rules):
    rng = np.random.default_rng(seed)
    modes = ModeSet(random_modes(rng, 2, 2, (0.4, 0.95)))
    graph = SwitchingGraph(modes, rules)
    try:
        stability = policy_stability(graph, Rollout())
    except ValueError:
        pytest.skip("no way on at finite cost")
    assert stability.verdict == "stable"
    assert worst_excess(graph, Rollout(), stability, rng, 12) <= 1


def test_rollout_with_a_switch_cost():
    modes = ModeSet([[[0.9, 1.0], [0.0, 0.5]], [[0.6, 0.0], [0.5, 0.8]], [[1.2, 0.0], [0.0, 0.5]]])
    graph = SwitchingGraph(ModeSet(modes.A[:2]), Rules(switch_cost=0.5))
    stability = policy_stability(graph, Rollout())
    assert stability.rate < 1 and worst_excess(graph, Rollout(), stability, np.random.default_rng(0)) <= 1
    stability = policy_stability(SwitchingGraph(modes, Rules(switch_cost=0.5, start=("A2", 1))), Rollout())
    assert stability.verdict == "stable" and stability.rate is None  # to leave A2 costs a constant


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("hold", [1, 3])
def test_an_infinite_horizon_falls_as_proven(seed, hold):
    rng = np.random.default_rng(seed)
    modes = mixed_modes(rng, int(rng.integers(1, 4)), 3)
    method = RecedingHorizon(np.inf, hold=hold)
    stability = policy_stability(modes, method)
    assert stability.verdict == "stable"
    assert 0.02 < worst_excess(modes, method, stability, rng) <= 1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("hold", "decrease"), [(1, 0.05), (2, 0.5), (4, 0.9)])
def test_the_constraint_makes_w2_fall_as_proven(seed, hold, decrease):
    rng = np.random.default_rng(seed)
    modes = ModeSet(random_modes(rng, int(rng.integers(1, 4)), 2, (0.3, 0.9)))
    for graph in (modes, SwitchingGraph(modes, Rules(min_dwell=3))):
        method = RecedingHorizon(4, hold=hold, decrease=decrease)
        stability = policy_stability(graph, method)
        assert stability.verdict == "stable"
        assert worst_excess(graph, method, stability, rng, 12) <= 1


def test_the_longest_hold_is_never_exceeded():
    from switchctl.stability.holds import longest_hold

    rng = np.random.default_rng(3)
    for _ in range(10):
        modes = ModeSet(random_modes(rng, 3, 2, (0.5, 0.9)))
        longest, growth = longest_hold(SwitchingGraph(modes), 2, 0.6)
        powers = np.array([[np.linalg.norm(np.linalg.matrix_power(A, k), 2) ** 2 for k in range(300)] for A in modes.A])
        assert growth == pytest.approx(powers.max(), rel=1e-9)
        bound = 0.4 / max(1, powers[:, 2:].max())
        assert longest == min(k for k in range(2, 300) if powers[:, k].min() <= bound * (1 + 1e-9))
        for _ in range(5):
            result = schedule(
                modes, Gaussian(rng.standard_normal(3), np.zeros((3, 3))), RecedingHorizon(3, 2, 0.6), steps=99
            )
            assert all(2 + added <= longest for _, added in result.lengthened)


@pytest.mark.parametrize("seed", range(2))
def test_the_pointwise_minimum_where_a_mean_of_modes_contracts(seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2, 2))
    for Q in (np.eye(2), root @ root.T + 0.1 * np.eye(2)):
        units = np.linalg.cholesky(Q).T  # in them Q is the identity
        A = np.linalg.solve(units, np.array([np.diag([1.3, 0.3]), np.diag([0.4, 1.2])]) @ units)
        modes = ModeSet(A, Q=Q)
        for method in (PointwiseMinimum(), RecedingHorizon(1)):
            stability = policy_stability(modes, method)
            assert stability.verdict == "stable"
            assert worst_excess(modes, method, stability, rng) <= 1


def test_the_best_mean_of_two_modes():
    modes = ModeSet([np.diag([1.3, 0.3]), np.diag([0.4, 1.2])])
    p = (1.44 - 0.16) / (1.69 - 0.16 + 1.44 - 0.09)  # makes both entries of the mean alike
    mean = 1.69 * p + 0.16 * (1 - p)
    assert policy_stability(modes, PointwiseMinimum()).rate == pytest.approx(np.sqrt(mean), abs=1e-6)


def test_the_pointwise_minimum_that_diverges_is_undecided():
    grow = 1.01 * np.array([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]])
    modes = ModeSet([grow, [[0.9, 5.0], [0.0, 0.9]]])
    assert policy_stability(modes, PointwiseMinimum()).verdict == "undecided"
    assert policy_stability(ModeSet([0.5 * grow, grow], Q=[np.eye(2), 2 * np.eye(2)]), PointwiseMinimum()).rate is None


@pytest.mark.parametrize("seed", range(2))
def test_a_constant_mode_falls_as_proven(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    E = np.broadcast_to(np.eye(n), (2, 2, n, n)).copy()
    E[0, 1], E[1, 0] = rng.standard_normal((2, n, n))
    modes = ModeSet(random_modes(rng, n, 2, (0.5, 0.95)), activation=E)
    for graph in (modes, SwitchingGraph(modes, Rules(min_dwell=4, start=("A1", 1)))):
        stability = policy_stability(graph, Constant(0))
        assert stability.verdict == "stable" and stability.rate < 1
        assert 0.01 < worst_excess(graph, Constant(0), stability, rng) <= 1
    single = ModeSet(modes.A[:1])
    assert policy_stability(single, RecedingHorizon(3)).rate == policy_stability(single, Constant(0)).rate


def test_a_constant_mode_that_is_not_schur():
    modes = ModeSet([[[1.1]], [[1.0]], [[0.5]]])
    assert [policy_stability(modes, Constant(i)).verdict for i in range(3)] == ["unstable", "undecided", "stable"]


def test_states_that_the_cost_does_not_see_are_undecided():
    modes = ModeSet([np.diag([0.5, 2.0]), np.diag([0.6, 0.5])], Q=np.diag([1.0, 0.0]))
    for method in (Rollout(), RecedingHorizon(np.inf), FewSwitches(1), Optimal(), Refine()):
        stability = policy_stability(modes, method)
        assert stability.verdict == "undecided" and "unseen" in stability.why


def test_a_singular_weight_that_two_steps_see():
    modes = servo.modes()
    assert np.linalg.eigvalsh(modes.Q[0])[0] <= 1e-12
    stability = policy_stability(modes, Rollout())
    assert stability.verdict == "stable" and stability.fall.steps >= 2
    rng = np.random.default_rng(1)
    assert worst_excess(modes, Rollout(), stability, rng) <= 1
    rotating = ModeSet([[[0.0, 0.9], [-0.9, 0.0]], [[0.5, 0.3], [-0.8, 0.2]]], Q=np.diag([1.0, 0.0]))
    stability = policy_stability(rotating, Rollout())
    assert stability.verdict == "stable" and 0.01 < worst_excess(rotating, Rollout(), stability, rng) <= 1


def test_a_discount_may_hide_growth():
    A = [[[1.05, 0.0], [0.0, 0.9]], [[0.95, 0.0], [0.0, 1.05]]]
    growing = ModeSet([[[1.05]], [[1.06]]], cost=("discounted", 0.5))
    assert policy_stability(growing, Rollout()).verdict == "undecided"
    assert policy_stability(growing, Refine()).verdict == "undecided"
    rng = np.random.default_rng(2)
    for modes in (ModeSet(A, cost=("discounted", 0.85)), ModeSet(0.6 * np.array(A), cost=("discounted", 0.9))):
        stability = policy_stability(modes, Rollout())
        if stability.verdict == "stable":
            assert worst_excess(modes, Rollout(), stability, rng) <= 1
    assert stability.verdict == "stable"


def test_plans_converge_without_a_common_rate():
    modes, x0 = five_mode.modes(), five_mode.initial_state()
    for method in (FewSwitches(1), Refine(), Optimal()):
        stability = policy_stability(modes, method)
        assert (stability.verdict, stability.rate, stability.constant) == ("stable", None, None)
    assert schedule(modes, x0, FewSwitches(1)).w2[-1] < 1e-8


def test_a_policy_falls_as_proven(pair):
    modes, _ = pair
    policy = Optimal(gap=0.1).policy(modes, quadratics=12)
    stability = policy_stability(modes, policy)
    assert stability.verdict == "stable" and stability.rate < 1
    assert worst_excess(modes, policy, stability, np.random.default_rng(4)) <= 1


@dataclass(frozen=True, repr=False)
class Mine(Method):
    def start(self, graph):
        return Rollout().start(graph)


def test_what_is_undecided_says_why():
    modes = ModeSet([[[0.5]], [[0.9]]])
    assert "no theorem" in policy_stability(modes, Mine()).why
    assert "no theorem" in policy_stability(modes, RecedingHorizon(5)).why
    noisy = ModeSet([[[0.5]], [[0.9]]], W=[[1.0]], cost="average")
    assert "noise" in policy_stability(noisy, Rollout()).why
    priced = ModeSet([[[0.5]], [[2.0]]], offset=[1.0, 0.0], cost="average")
    assert policy_stability(priced, Rollout()).verdict == "undecided"
    held = ModeSet([np.diag([0.5, 0.9]), np.diag([0.4, 0.8])], plant_states=1)
    assert "controllers" in policy_stability(held, RecedingHorizon(5, decrease=0.1)).why
    text = repr(policy_stability(modes, Rollout()))
    assert text.startswith("PolicyStability: stable") and "Rollout()" in text
    assert "stable" in policy_stability(modes, Rollout())._repr_html_()


def test_what_is_refused():
    modes = ModeSet([[[1.5]], [[1.9]]])
    with pytest.raises(ValueError, match="needs a Schur mode"):
        policy_stability(modes, Rollout())
    with pytest.raises(TypeError, match="must be a Method"):
        policy_stability(modes, "rollout")
    with pytest.raises(TypeError, match="ModeSet"):
        policy_stability(np.eye(2), Rollout())


def test_badly_scaled_states_lose_no_verdict():
    modes = five_mode.modes()
    D = np.diag([2.0**-20, 2.0**17])
    inverse = np.linalg.inv(D)
    scaled = ModeSet(D @ modes.A @ inverse, Q=inverse @ inverse)
    stability = policy_stability(scaled, Rollout())
    assert stability.rate == pytest.approx(policy_stability(modes, Rollout()).rate, rel=1e-6)
