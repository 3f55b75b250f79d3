"""Cases at the edge that are taken: what comes out is what the mathematics says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Schedule,
    best_single_mode,
    monte_carlo,
    schedule,
    single_mode_costs,
    wasserstein,
)
from switchctl.moments import closed_form_w2, moment_maps

X0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
FAST, CALM = [[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]
METHODS = [RecedingHorizon(5), PointwiseMinimum(), Rollout(), Refine(), FewSwitches(2)]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_the_only_mode_is_chosen(method):
    modes = ModeSet([CALM])
    found = schedule(modes, X0, method, 5)
    assert_array_equal(found.sequence, np.zeros(5))
    assert found.cost == pytest.approx(single_mode_costs(modes, X0)[0])


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_of_modes_that_are_the_same_the_lowest_index_wins(method):
    twice = schedule(ModeSet([FAST, CALM, FAST, CALM]), X0, method, 20)
    once = schedule(ModeSet([FAST, CALM]), X0, method, 20)
    assert_array_equal(twice.sequence, once.sequence)
    assert set(twice.sequence) == {0, 1}
    assert best_single_mode(ModeSet([CALM, CALM]), X0).index == 0


@pytest.mark.parametrize(
    ("A", "Q", "cost"),
    [
        ([[1.0]], 1.0, np.inf),
        ([[-1.0]], 1.0, np.inf),
        ([[1 + 1e-9]], 1.0, np.inf),
        ([[1 - 1e-9]], 1.0, 1 / (1 - (1 - 1e-9) ** 2)),
        ([[1e-300]], 1.0, 1.0),
        ([[1.0, 1.0], [0.0, 1.0]], np.eye(2), np.inf),
        ([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]], np.eye(2), np.inf),
        ([[0.5, 1.0], [0.0, 0.5]], np.eye(2), None),
        ([[0.999, 1e3], [0.0, 0.999]], np.eye(2), None),
        ([[0.0, 1e150], [0.0, 0.0]], np.eye(2), 2 + 1e300),
        ([[0.5, 0.0], [0.0, 2.0]], np.diag([1.0, 0.0]), 4 / 3),
        ([[0.5, 0.0], [0.0, 1.0]], np.diag([1.0, 0.0]), 4 / 3),
        ([[0.5, 0.0], [1.0, 2.0]], np.diag([1.0, 0.0]), 4 / 3),
        ([[0.5, 1e-9], [0.0, 2.0]], np.diag([1.0, 0.0]), np.inf),
        ([[0.5, 0.0], [0.0, 2.0]], np.zeros((2, 2)), 0.0),
    ],
    ids="marginal alternating beyond within nilpotent-almost integrators circle defective slow nilpotent hidden "
    "hidden-marginal hidden-fed barely-seen free".split(),
)
def test_a_cost_is_infinite_or_finite_as_the_mathematics_says(A, Q, cost):
    n = len(A)
    modes = ModeSet([A], Q=np.reshape(Q, (n, n)))
    found = single_mode_costs(modes, Gaussian(np.ones(n), np.zeros((n, n))))[0]
    if cost is None:  # (I - A' (x) A') vec(P) = vec(Q)
        A = np.array(A)
        P = np.linalg.solve(np.eye(n * n) - np.kron(A.T, A.T), np.ravel(Q)).reshape(n, n)
        assert_allclose(found, P.sum(), rtol=1e-8)
    else:
        assert found == pytest.approx(cost, rel=1e-6)


def test_schur_is_decided_near_the_ends_of_the_floating_point_range():
    modes = ModeSet([1e300 * np.ones((2, 2)), [[0, 1e300], [0, 0]], 5e-324 * np.eye(2), 1e-300 * np.ones((2, 2))])
    assert modes.schur.tolist() == [False, True, True, True]


@pytest.mark.parametrize("scale", [1e-150, 1e-100, 1.0, 1e100, 1e150])
def test_units_change_no_decision_and_no_digit(scale):
    modes, whole = ModeSet([FAST, CALM]), 2.0 ** round(np.log2(scale))
    x0 = Gaussian(whole * X0.mean, whole * (whole * X0.cov))
    for method in METHODS:
        found, usual = schedule(modes, x0, method, 12), schedule(modes, X0, method, 12)
        assert_array_equal(found.sequence, usual.sequence)
        assert found.cost / whole / whole == pytest.approx(usual.cost, rel=1e-12)


def test_moments_that_underflow_are_refused_and_rest_costs_nothing_in_the_first_mode():
    modes, tiny = ModeSet([CALM, FAST]), Gaussian([1e-200, 1e-200], np.zeros((2, 2)))
    rest = Gaussian([0.0, 0.0], np.zeros((2, 2)))
    for method in METHODS:
        with pytest.raises(FloatingPointError, match="lost below the floating-point range; scale the state"):
            schedule(modes, tiny, method, 3)
        found = schedule(modes, rest, method, 3)
        assert found.cost == 0
        assert_array_equal(found.sequence, 0)
        assert method.start(modes).step(tiny.mean) == 0
    assert single_mode_costs(modes, rest).tolist() == [0, 0]


@pytest.mark.parametrize("mean", [1e200, 1e308])
def test_moments_that_overflow_are_refused(mean):
    modes, x0 = ModeSet([FAST, CALM]), Gaussian([mean, 1.0], np.zeros((2, 2)))
    for call in (
        lambda: schedule(modes, x0, Rollout()),
        lambda: single_mode_costs(modes, x0),
        lambda: best_single_mode(modes, x0),
        lambda: Rollout().start(modes).step([mean, 1.0]),
        lambda: Schedule(modes, x0, [0]).cost,
        lambda: x0.second_moment,
        x0.w2,
    ):
        with pytest.raises(FloatingPointError, match=r"exceeds the floating-point range.*; scale the state"):
            call()
    with pytest.raises(ValueError, match=r"exceeds the floating-point range after step 2.*at most 2 steps"):
        schedule(ModeSet([1e60 * np.eye(2)]), X0, Constant(0), 9)


@pytest.mark.parametrize("scale", [1e-160, 1e-100, 1.0, 1e100, 1e150])
def test_distances_keep_their_digits_where_squares_would_leave_the_range(scale):
    a = Gaussian(scale * np.array([3.0, 0.0]), scale * (scale * np.diag([4.0, 1.0])))
    b = Gaussian(scale * np.array([0.0, 4.0]), scale * (scale * np.diag([1.0, 1.0])))
    assert wasserstein(a, b) / scale == pytest.approx(np.sqrt(26), rel=1e-3 if scale < 1e-150 else 1e-12)
    far, near = Gaussian([1e300], [[1.0]]), Gaussian([-1e300], [[1.0]])
    assert wasserstein(far, near) == pytest.approx(2e300)


@pytest.mark.parametrize("scale", [1e-140, 1e-100, 1.0, 1e100, 1e153])
def test_the_error_of_monte_carlo_stays_in_the_range_of_w2(scale):
    whole = 2.0 ** round(np.log2(scale))
    plan = Schedule(ModeSet([FAST, CALM]), Gaussian(whole * X0.mean, whole * (whole * X0.cov)), [0, 1, 0])
    usual = Schedule(plan.modes, X0, [0, 1, 0])
    found, expected = (monte_carlo(each, samples=3000, seed=3) for each in (plan, usual))
    assert_allclose(found.standard_error / whole / whole, expected.standard_error, rtol=1e-12)
    assert found.inside == expected.inside == 1.0


def test_the_error_of_monte_carlo_follows_w2_on_its_way_to_zero():
    long = schedule(ModeSet([[[0.9, 1.0], [0.0, 0.8]]]), X0, Constant(0), 3000)
    assert 0 < long.w2[-1] < 1e-250
    found = monte_carlo(long, samples=500)
    assert (found.standard_error > 0).all()
    assert found.inside == 1.0


def test_great_states_hide_no_small_ones():
    cov = np.diag([1e40, 1.0, 1.0])
    cov[1, 2] = cov[2, 1] = 0.5
    assert_array_equal(Gaussian(np.zeros(3), cov).cov, cov)
    for wrong, words in ((2.0, "least eigenvalue is -1;"), (np.nan, "is nan")):
        cov[1, 2] = cov[2, 1] = wrong
        with pytest.raises(ValueError, match=words):
            Gaussian(np.zeros(3), cov)
    rank_one = np.outer([1e20, 1.0, 1e-20], [1e20, 1.0, 1e-20])
    assert_array_equal(Gaussian(np.zeros(3), rank_one).cov, rank_one)
    rounded = np.array([[1.0, 1.0], [1.0, 1.0 - 1e-16]])  # its least eigenvalue is below zero by rounding
    assert_array_equal(ModeSet([FAST], Q=rounded).Q[0], rounded)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: moment_maps(np.broadcast_to(0.0, (1, 2000, 2000))), r"2001000 by 2001000.*1\.28e\+14 bytes"),
        (
            lambda: closed_form_w2(np.zeros((1, 200, 200)), np.array([0]), np.eye(200)),
            r"40000 by 40000.*3\.84e\+10 bytes",
        ),
        (
            lambda: FewSwitches(1).start(ModeSet([0.5 * np.eye(150)] * 2)).step(np.ones(150)),
            r"150 states.*8\.21e\+09",
        ),
    ],
    ids=["moment maps", "Kronecker products", "a plan"],
)
def test_what_memory_does_not_hold_is_refused_before_it_is_made(call, words):
    with pytest.raises(MemoryError, match=words):
        call()
