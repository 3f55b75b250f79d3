"""The methods: the paper's algorithm evaluated plainly, the promises of each, online against offline."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

import switchctl
from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    SwitchingGraph,
    best_single_mode,
    schedule,
    single_mode_costs,
)
from switchctl.methods import least_cost

METHODS = [
    Constant(0),
    PointwiseMinimum(),
    RecedingHorizon(1),
    RecedingHorizon(7, hold=3),
    RecedingHorizon(math.inf, hold=2),
    RecedingHorizon([5, 2, 9], hold=2),
    RecedingHorizon(lambda j: 1 + j % 4),
    RecedingHorizon(4, hold=2, decrease=0.3),
    RecedingHorizon(math.inf, decrease=0.01),
    Rollout(),
    FewSwitches(2),
    Refine(),
    Optimal(gap=1e-2),
    Refine(PointwiseMinimum()),
]
cases = st.tuples(st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**32 - 1))


def draw(case):
    n, m, seed = case
    rng = np.random.default_rng(seed)
    return ModeSet(random_modes(rng, n, m)), random_gaussian(rng, n)


def plain_receding_horizon(modes, S, horizon, hold, decrease, steps):
    """The paper's algorithm, straight from its equations: W2 along every mode, sums, the constraint, longer holds."""
    sequence, last = [], None
    while len(sequence) < steps:
        now = np.trace(S)
        bound = (1 - decrease) * (now if last is None else last) if decrease else math.inf
        length = hold
        while True:
            runs = []
            for A in modes.A:
                w2, moment = [], S
                for _ in range(max(horizon, length) + 1):
                    w2.append(np.trace(moment))
                    moment = A @ moment @ A.T
                runs.append(w2)
            allowed = [i for i, w2 in enumerate(runs) if w2[length] <= bound]
            if allowed:
                break
            length += 1
        choice = min(allowed, key=lambda i: sum(runs[i][: horizon + 1]))
        sequence += [choice] * length
        for _ in range(length):
            S = modes.A[choice] @ S @ modes.A[choice].T
        last = now
    return sequence[:steps]


@pytest.mark.parametrize(
    ("horizon", "hold", "decrease"), [(1, 1, None), (6, 1, None), (3, 5, None), (4, 1, 0.5), (5, 2, 0.9)]
)
def test_receding_horizon_is_the_papers_algorithm(horizon, hold, decrease):
    rng = np.random.default_rng(1)
    for _ in range(30):
        modes, x0 = ModeSet(random_modes(rng, 3, 3)), random_gaussian(rng, 3)
        plain = plain_receding_horizon(modes, x0.second_moment, horizon, hold, decrease, 40)
        result = schedule(modes, x0, RecedingHorizon(horizon, hold, decrease), steps=40)
        assert result.sequence.tolist() == plain


def test_pointwise_minimum_takes_the_least_next_w2():
    rng = np.random.default_rng(2)
    for _ in range(30):
        modes, x0 = ModeSet(random_modes(rng, 3, 4)), random_gaussian(rng, 3)
        result, S = schedule(modes, x0, PointwiseMinimum(), steps=20), x0.second_moment
        for mode in result.sequence:
            assert mode == np.argmin([np.trace(A @ S @ A.T) for A in modes.A])
            S = modes.A[mode] @ S @ modes.A[mode].T


def test_rollout_takes_the_step_with_the_least_cost_ahead():
    rng = np.random.default_rng(3)
    Q = np.stack([np.diag([1.0, 2.0, 0.1]) * (1 + i) for i in range(3)])
    for _ in range(30):
        modes, x0 = ModeSet(random_modes(rng, 3, 3), Q=Q), random_gaussian(rng, 3)
        result, S = schedule(modes, x0, Rollout(), steps=15), x0.second_moment
        for mode in result.sequence:
            ahead = [
                np.trace(Q[i] @ S) + min(np.trace(P @ A @ S @ A.T) for P in modes.tails) for i, A in enumerate(modes.A)
            ]
            assert mode == np.argmin(ahead)
            S = modes.A[mode] @ S @ modes.A[mode].T


@given(cases, st.sampled_from(METHODS))
@settings(max_examples=150, deadline=None)
def test_offline_is_the_online_scheduler_along_the_predicted_moments(case, method):
    modes, x0 = draw(case)
    result = schedule(modes, x0, method, steps=25)
    scheduler = method.start(modes)
    for _ in range(2):
        online = [scheduler.step(result.mean[:, k], result.cov[k]) for k in range(25)]
        assert online == result.sequence.tolist()
        scheduler.reset()


@pytest.mark.slow
def test_stability_over_a_thousand_random_sets():
    """The constrained receding horizon converges; rollout costs at most the best single mode."""
    rng = np.random.default_rng(2014)
    for _ in range(1000):
        n, m = int(rng.integers(1, 9)), int(rng.integers(1, 7))
        modes, x0 = ModeSet(random_modes(rng, n, m)), random_gaussian(rng, n)
        horizon, hold = int(rng.integers(1, 30)), int(rng.integers(1, 8))
        decrease = rng.uniform(0.01, 0.6)
        result = schedule(modes, x0, RecedingHorizon(horizon, hold, decrease))
        assert result.status == "converged"
        updates, added = [0], dict(result.lengthened)
        while updates[-1] < len(result):
            updates.append(updates[-1] + hold + added.get(updates[-1], 0))
        w2 = result.w2[[t for t in updates if t < len(result)]]
        before = np.concatenate([w2[:1], w2[:-2]])
        assert (w2[1:] <= (1 - decrease) * before * (1 + 1e-9)).all()
        rollout = schedule(modes, x0, Rollout())
        assert rollout.status == "converged"
        assert rollout.cost <= single_mode_costs(modes, x0).min() * (1 + 1e-9)


@given(cases)
@settings(max_examples=100, deadline=None)
def test_rollout_keeps_its_promise_at_every_length(case):
    modes, x0 = draw(case)
    best = single_mode_costs(modes, x0).min()
    costs = [schedule(modes, x0, Rollout(), steps=steps).cost for steps in (1, 2, 5, 20)]
    assert all(cost <= best * (1 + 1e-9) for cost in costs)


def test_a_running_scheduler_can_be_pickled(pair):
    for method in METHODS:
        if callable(getattr(method, "horizon", None)):
            continue
        scheduler = method.start(pair[0])
        scheduler.step([1.0, 1.0])
        twin = pickle.loads(pickle.dumps(scheduler))
        assert [twin.step([0.1, 0.9]) for _ in range(5)] == [scheduler.step([0.1, 0.9]) for _ in range(5)]


def test_the_horizon_may_vary_with_the_update(pair):
    modes, x0 = pair
    varying = schedule(modes, x0, RecedingHorizon([3, 50]))
    assert (
        varying.sequence.tolist()
        == schedule(modes, x0, RecedingHorizon(lambda j: 3 if j == 0 else 50)).sequence.tolist()
    )
    assert RecedingHorizon(np.array([3, 50])) == RecedingHorizon([3, 50])
    assert RecedingHorizon([3, 50]).at(7) == 50


def test_an_unstable_mode_is_allowed_where_no_theorem_needs_it_schur():
    modes = ModeSet([[[0.5, 1.0], [0.0, 0.5]], [[1.2, 0.0], [0.0, 0.1]]])
    x0 = Gaussian([0.1, 1.0], 0.01 * np.eye(2))
    for method in (PointwiseMinimum(), RecedingHorizon(3), RecedingHorizon(math.inf), Rollout()):
        assert schedule(modes, x0, method).status == "converged"
    assert schedule(modes, x0, Rollout()).cost <= single_mode_costs(modes, x0).min()
    assert 1 in schedule(modes, x0, Rollout()).sequence
    assert 1 not in schedule(modes, x0, RecedingHorizon(math.inf)).sequence
    assert schedule(modes, x0, Constant(1)).cost == math.inf
    with pytest.raises(ValueError, match=r"needs every mode to be Schur, and 'A1' has spectral radius 1\.2"):
        schedule(modes, x0, RecedingHorizon(3, decrease=0.1))


@pytest.mark.parametrize("method", [Rollout(), RecedingHorizon(math.inf)])
def test_no_schur_mode_at_all(method):
    modes, x0 = ModeSet([[[1.1]], [[-1.0]]]), Gaussian([1.0], [[0.0]])
    with pytest.raises(ValueError, match=r"A0: 1\.1, A1: 1"):
        schedule(modes, x0, method)
    with pytest.raises(ValueError, match="needs a Schur mode"):
        best_single_mode(modes, x0)


def test_ties_go_to_the_lowest_index():
    modes = ModeSet([[[0.5, 0.0], [0.0, 0.5]]] * 3)
    x0 = Gaussian([1.0, 2.0], np.eye(2))
    for method in METHODS:
        assert set(schedule(modes, x0, method, steps=10).sequence) == {0}
    assert best_single_mode(modes, x0).index == 0
    assert Constant(best_single_mode(modes, x0)) == Constant("A0")
    assert least_cost(np.array([1.0, 1.0 - 1e-13, 1.0 - 1e-11])) == 2
    assert least_cost(np.array([0.0, 0.0, -1e-300])) == 2
    assert least_cost(np.array([3.0, 1.0, 2.0]), np.array([True, False, True])) == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_cost_that_is_not_finite_never_decides(bad):
    with pytest.raises(FloatingPointError, match="candidate 1"):
        least_cost(np.array([1.0, bad, 0.5]))
    assert least_cost(np.array([1.0, bad, 0.5]), np.array([True, False, True])) == 2


def test_a_single_mode_and_a_single_state():
    modes, x0 = ModeSet([[[0.5]]]), Gaussian([2.0], [[1.0]])
    for method in METHODS:
        result = schedule(modes, x0, method)
        assert result.cost == pytest.approx(5 / (1 - 0.25))
        assert result.switches == ()


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: RecedingHorizon(0), ValueError, "horizon is 0; expected at least 1"),
        (lambda: RecedingHorizon(-3), ValueError, "horizon is -3"),
        (lambda: RecedingHorizon(2.5), ValueError, "horizon is 2.5; expected a whole number"),
        (lambda: RecedingHorizon(math.nan), ValueError, "horizon is nan"),
        (lambda: RecedingHorizon(-math.inf), ValueError, "horizon is -inf"),
        (lambda: RecedingHorizon("50"), TypeError, "'50'"),
        (lambda: RecedingHorizon(b"5"), TypeError, "b'5'"),
        (lambda: RecedingHorizon(5, decrease=10**400), ValueError, "floating-point range"),
        (lambda: RecedingHorizon(True), TypeError, "True"),
        (lambda: RecedingHorizon(None), TypeError, "None"),
        (lambda: RecedingHorizon([]), ValueError, "empty"),
        (lambda: RecedingHorizon([5, 0]), ValueError, r"horizon\[1\] is 0"),
        (lambda: RecedingHorizon(5, hold=0), ValueError, "hold is 0"),
        (lambda: RecedingHorizon(5, hold=1.5), ValueError, "hold is 1.5"),
        (lambda: RecedingHorizon(5, decrease=0), ValueError, "decrease is 0"),
        (lambda: RecedingHorizon(5, decrease=1), ValueError, "decrease is 1"),
        (lambda: RecedingHorizon(5, decrease=math.nan), ValueError, "decrease is nan"),
        (lambda: RecedingHorizon(5, decrease="a"), TypeError, "'a'"),
        (lambda: RecedingHorizon(5, length=2), TypeError, "length"),
        (lambda: Rollout(3), TypeError, "argument"),
    ],
)
def test_wrong_settings(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_wrong_settings_that_show_at_the_start(pair):
    modes, x0 = pair
    with pytest.raises(KeyError, match="no mode is named 'hihg'"):
        schedule(modes, x0, Constant("hihg"))
    with pytest.raises(ValueError, match=r"horizon\(0\) is 0"):
        schedule(modes, x0, RecedingHorizon(lambda j: 0))
    with pytest.raises(ValueError, match="'A0' over a horizon of 10000 steps exceeds"):
        RecedingHorizon(10000).start(ModeSet([[[1.1]], [[0.5]]]))


def test_settings_are_immutable_and_compare():
    method = RecedingHorizon(5)
    with pytest.raises(AttributeError):
        method.horizon = 6
    assert method == RecedingHorizon(5, hold=1)
    assert repr(method) == "RecedingHorizon(horizon=5)"
    assert repr(RecedingHorizon(5, 2, 0.1)) == "RecedingHorizon(horizon=5, hold=2, decrease=0.1)"


def test_wrong_input_online_decides_nothing_and_changes_nothing(pair):
    modes, _ = pair
    for method in METHODS:
        reference, scheduler = method.start(modes), method.start(modes)
        mean, cov = np.array([1.0, 1.0]), 0.01 * np.eye(2)
        for _ in range(5):
            for bad_mean, bad_cov, words in (
                ([1.0, math.nan], cov, r"mean\[1\] is nan"),
                ([1.0], cov, r"mean has shape \(1,\)"),
                (mean, np.eye(3), "cov has shape"),
                (mean, [[1.0, 2.0], [2.0, 1.0]], "least eigenvalue"),
            ):
                with pytest.raises(ValueError, match=words):
                    scheduler.step(bad_mean, bad_cov)
            assert scheduler.step(mean, cov) == reference.step(mean, cov)
            mean = mean * 0.8
        assert scheduler.step(mean) in (0, 1)


@pytest.mark.parametrize("size", [1e200, 1e154])
def test_an_online_state_beyond_the_range_is_an_error(pair, size):
    for method in (PointwiseMinimum(), RecedingHorizon(3, decrease=0.5), Rollout()):
        with pytest.raises(FloatingPointError, match="exceeds the floating-point range"):
            method.start(pair[0]).step([size, size])


def test_every_public_method_is_tested_here():
    public = {v for v in vars(switchctl).values() if isinstance(v, type) and issubclass(v, switchctl.Method)}
    assert public - {switchctl.Method, switchctl.Policy} == {type(method) for method in METHODS}


def test_updates_are_counted_from_0_one_at_a_time(pair):
    asked = []

    def horizon(j):
        asked.append(j)
        return 5

    schedule(*pair, RecedingHorizon(horizon, hold=3), steps=10)
    assert asked == [0, 0, 1, 2, 3]  # the first one is also tried at the start


def test_rollouts_tail_is_named_among_all_modes():
    modes = ModeSet([[[1.2]], [[0.5]], [[0.9]]])
    assert schedule(modes, Gaussian([1.0], [[0.0]]), Rollout(), steps=2).tail == (1,)


def test_whole_numbers_are_kept_as_integers():
    method = RecedingHorizon(np.float64(5), hold=2.0)
    assert (type(method.horizon), type(method.hold)) == (int, int)


@given(cases, st.integers(1, 4), st.integers(1, 20))
@settings(max_examples=100, deadline=None)
def test_the_infinite_horizon_costs_no_more_than_the_best_single_mode(case, hold, steps):
    modes, x0 = draw(case)
    result = schedule(modes, x0, RecedingHorizon(math.inf, hold), steps=steps)
    assert result.cost <= single_mode_costs(modes, x0).min() * (1 + 1e-9)


@pytest.mark.parametrize("hold", [1, 2, 5])
def test_a_hold_does_not_lead_where_every_way_on_costs_infinitely_much(hold):
    modes = ModeSet([[[0.5]], [[1.05]], [[0.9]]], names=["good", "bad", "slow"])
    edges = [("s", "t", 0), ("s", "s", 2), ("t", "s", 2), ("t", "trap", 0), ("trap", "trap", 1)]
    rules = SwitchingGraph.from_edges(modes, edges)
    result = schedule(modes, Gaussian([1.0], [[0.0]]), RecedingHorizon(2, hold=hold), rules=rules)
    assert math.isfinite(result.cost)
    assert 1 not in result.sequence


def test_a_singular_weight_bounds_the_cost_and_not_w2():
    modes = ModeSet([np.diag([0.5, 2.0]), np.diag([0.6, 0.5])], Q=np.diag([1.0, 0.0]))
    x0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
    result = schedule(modes, x0, Rollout(), steps=20)
    assert result.w2[-1] > 1e6
    assert result.cost <= single_mode_costs(modes, x0)[1]


def test_settings_are_told_by_name_and_as_plain_numbers():
    assert repr(RecedingHorizon(5, decrease=np.float64(0.1))) == "RecedingHorizon(horizon=5, decrease=0.1)"
    assert repr(RecedingHorizon(draw)) == "RecedingHorizon(horizon=draw)"
    with pytest.raises(FloatingPointError, match="second moment"):
        Constant(0).start(ModeSet([np.eye(2) / 2])).step([1e200, 1e200])
