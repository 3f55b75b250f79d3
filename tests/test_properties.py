"""What the mathematics promises of moments, costs, schedules and decisions, on random plants."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from properties import DECIDING, examples, full_plant, in_coordinates, least_margin, plant, rotation, weights
from random_cases import random_gaussian, random_modes
from random_rules import KINDS, none

from switchctl import (
    ContradictionError,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    schedule,
    single_mode_costs,
    wasserstein,
)
from switchctl.gramians import horizon_gramians, tail, word_tail
from switchctl.moments import closed_form_w2, constant_w2, moment_factor, moment_maps, smat, svec, trajectory

STEPS = 10
CLEAR = 1e-9  # choices whose costs differ by more are not made by rounding
FINITE = [PointwiseMinimum(), RecedingHorizon(6), RecedingHorizon(4, hold=3)]
each = pytest.mark.parametrize("method", DECIDING, ids=repr)
matrices = arrays(np.int64, st.tuples(st.integers(1, 4), st.just(3), st.just(3)), elements=st.integers(-1, 1))


def close(a, b, rel=1e-9):
    """Whether arrays agree, relative to their greatest entry."""
    scale = np.abs(b).max(initial=0.0)
    return np.abs(np.asarray(a) - b).max(initial=0.0) <= rel * scale


def at_most(G, H, rel=1e-9):
    """Whether H - G is positive semidefinite, but for rounding."""
    return (np.linalg.eigvalsh(H - G)[..., 0] >= -rel * np.abs(H).max(axis=(-2, -1))).all()


# Moments


@examples(2000)
def test_moment_maps_are_a_homomorphism_and_svec_an_isometry(n, m, seed):
    modes, x0, rng = plant(n, m, seed, Q=None)
    K, S = moment_maps(modes.A), x0.second_moment
    X = rng.standard_normal((m, n, n))
    X = X + np.swapaxes(X, 1, 2)
    assert close(smat(svec(X)), X, 1e-14)
    assert close(svec(X) @ svec(X).T, np.tensordot(X, X, ((1, 2), (1, 2))), 1e-12)
    assert close(moment_maps(modes.A[0] @ modes.A[-1]), K[0] @ K[-1], 1e-12)
    assert close(moment_maps(np.swapaxes(modes.A, 1, 2)), np.swapaxes(K, 1, 2), 1e-12)
    assert close(smat(K @ svec(S)), modes.A @ S @ np.swapaxes(modes.A, 1, 2), 1e-12)


@examples(1500)
def test_the_closed_form_the_recursion_and_the_schedule_have_the_same_w2(n, m, seed):
    modes, x0, rng = plant(n, m, seed, Q=None)
    sequence, S = rng.integers(m, size=STEPS), x0.second_moment
    factors = trajectory(modes.A, sequence, moment_factor(x0.mean, x0.cov))
    w2 = np.sum(factors**2, axis=(1, 2))
    run = Schedule(modes, x0, sequence)
    assert close([*run.w2, run.final_w2], w2, 1e-12)
    for k in (0, int(rng.integers(STEPS + 1))):
        assert closed_form_w2(modes.A, sequence[:k], S) == pytest.approx(w2[k], rel=1e-9)
    powers = [
        np.sum(np.linalg.matrix_power(modes.A[-1], k) @ S * np.linalg.matrix_power(modes.A[-1], k)) for k in (0, 7)
    ]
    assert close(constant_w2(modes.A, S, 8)[-1, [0, 7]], np.array(powers))


@examples(600)
def test_w2_is_the_mean_over_drawn_runs(n, m, seed):
    """Within the bound of Laurent and Massart (Ann. Statist. 28, 2000), for all steps and examples at once."""
    modes, x0, rng = full_plant(n, m, seed)
    run = Schedule(modes, x0, rng.integers(m, size=6))
    N, p = 4000, modes.plant_states
    t = math.log(2 * len(run) * 600 / 1e-3)  # all bands together miss with probability 1e-3

    def drawn(cov):
        values, vectors = np.linalg.eigh(cov)
        return rng.standard_normal((N, n)) @ (vectors * np.sqrt(np.maximum(values, 0))).T

    x, mean, cov = x0.mean + drawn(x0.cov), x0.mean, x0.cov
    for k, i in enumerate(run.sequence):
        variance = 2 * np.sum(cov[:p, :p] ** 2) + 4 * mean[:p] @ cov[:p, :p] @ mean[:p]
        band = math.sqrt(2 * variance * t / N) + 2 * np.linalg.norm(cov[:p, :p], 2) * t / N
        assert abs(np.mean(np.sum(x[:, :p] ** 2, axis=1)) - run.w2[k]) <= band + 1e-9 * run.w2[k]
        A = modes.A[i]
        if k and modes.activation is not None:
            A = A @ modes.activation[run.sequence[k - 1], i]
        x, mean, cov = x @ A.T + (drawn(modes.W[i]) if modes.noisy else 0.0), A @ mean, A @ cov @ A.T + modes.W[i]


@examples(1500)
def test_distances_between_gaussians_move_with_them(n, m, seed):
    rng = np.random.default_rng([n, seed])
    a, b, c = (random_gaussian(rng, n) for _ in range(3))
    size, shift, T = 10 ** rng.uniform(-3, 3), rng.standard_normal(n), rotation(rng, n)

    def moved(g):
        cov = size**2 * T @ g.cov @ T.T
        return Gaussian(size * T @ g.mean + shift, (cov + cov.T) / 2)

    assert wasserstein(moved(a), moved(b)) == pytest.approx(size * wasserstein(a, b), rel=1e-6)
    assert wasserstein(a, b) == pytest.approx(wasserstein(b, a), rel=1e-6)
    assert wasserstein(a, c) <= (wasserstein(a, b) + wasserstein(b, c)) * (1 + 1e-9)
    assert wasserstein(a, Gaussian(shift, np.zeros((n, n)))) ** 2 == pytest.approx(a.w2(shift), rel=1e-9)
    assert a.about(shift).w2() == pytest.approx(a.w2(shift), rel=1e-12)
    root = rng.standard_normal((n, n))
    M = root @ root.T  # x -> M x + shift is the gradient of a convex function, so it moves optimally (Brenier)
    cov = M @ a.cov @ M
    there = Gaussian(M @ a.mean + shift, (cov + cov.T) / 2)
    rest = np.eye(n) - M
    expected = np.sum((rest @ a.mean - shift) ** 2) + np.sum((rest @ a.cov) * rest)
    assert wasserstein(a, there) ** 2 == pytest.approx(expected, rel=1e-6)


# Costs


@examples(2500)
def test_horizon_costs_obey_their_recursion_and_grow_to_the_tail(n, m, seed):
    modes, _, rng = plant(n, m, seed)
    A, Q, T = modes.A, modes.Q, int(rng.integers(1, 40))
    G, longer = horizon_gramians(A, Q, T), horizon_gramians(A, Q, T + 1)
    assert close(horizon_gramians(A, Q, 0), Q, 1e-15)
    assert close(longer, Q + np.swapaxes(A, 1, 2) @ G @ A, 1e-11)
    assert at_most(G, longer)
    P = tail(A[0], Q[0])
    assert close(P, Q[0] + A[0].T @ P @ A[0])
    assert at_most(longer[0], P)


@examples(1300)
def test_tails_are_linear_and_monotone_in_the_weight_and_under_a_discount(n, m, seed):
    modes, _, rng = plant(n, 1, seed)
    A, Q, factor = modes.A[0], modes.Q[0], 10 ** rng.uniform(-3, 3)
    more = rng.standard_normal((n, 1))
    added = more @ more.T
    P = tail(A, Q)
    assert close(tail(A, factor * Q + added), factor * P + tail(A, added))
    assert at_most(P, tail(A, Q + added))
    g = float(rng.uniform(0.3, 0.999))
    (discounted,) = ModeSet([A], Q=Q, cost=("discounted", g)).tails
    assert close(discounted, Q + g * A.T @ discounted @ A)
    assert at_most(discounted, P)


@examples(1000)
def test_the_cost_of_a_word_is_that_of_its_first_step_and_of_the_word_turned(n, m, seed):
    modes, _, rng = plant(n, m, seed, radius=(0.2, 0.7))
    word = rng.integers(m, size=rng.integers(1, 5)).tolist()
    P, product = word_tail(modes.A, modes.Q, word), np.eye(n)
    for i in word:
        product = modes.A[i] @ product
    assert (P is not None) == (np.abs(np.linalg.eigvals(product)).max() < 1)
    if P is not None:
        A, turned = modes.A[word[0]], word_tail(modes.A, modes.Q, [*word[1:], word[0]])
        assert close(P, modes.Q[word[0]] + A.T @ turned @ A)
        assert close(word_tail(modes.A, modes.Q, word + word), P)


@examples(250)
def test_costs_are_linear_in_the_moment_and_linear_and_monotone_in_the_weight(n, m, seed):
    modes, x0, rng = plant(n, m, seed)
    sequence, y0, a, b = rng.integers(m, size=STEPS), random_gaussian(rng, n), *rng.exponential(1.0, 2)
    other, size = weights(rng, n, m), rng.exponential(1.0)
    other = np.eye(n) if other is None else other
    both = Gaussian(np.zeros(n), a * x0.second_moment + b * y0.second_moment)

    def cost(start, Q):
        return Schedule(ModeSet(modes.A, Q=Q), start, sequence).cost

    plain = cost(x0, modes.Q)
    assert cost(both, modes.Q) == pytest.approx(a * plain + b * cost(y0, modes.Q), rel=1e-9)
    assert cost(x0, size * modes.Q + other) == pytest.approx(size * plain + cost(x0, other), rel=1e-9)
    assert plain <= cost(x0, modes.Q + other) * (1 + 1e-9)


@examples(700)
def test_a_schedule_is_its_beginning_and_the_rest_from_its_last_moments(n, m, seed):
    modes, x0, rng = full_plant(n, m, seed)
    sequence, k = rng.integers(m, size=STEPS), int(rng.integers(1, STEPS))
    costs = {"switch_cost": rng.exponential(1.0, (m, m)), "switch_cost_per_w2": rng.exponential(1.0, (m, m))}
    whole = Schedule(modes, x0, sequence, graph=SwitchingGraph(modes, Rules(**costs)))
    first = Schedule(modes, x0, sequence[:k], graph=whole.graph)
    again = SwitchingGraph(modes, Rules(**costs, start=(int(sequence[k - 1]), 1)))
    rest = Schedule(modes, first.final, sequence[k:], graph=again)
    assert close([*first.w2, *rest.w2], whole.w2)
    assert close(np.hstack([first.mean, rest.mean]), whole.mean)
    assert close(np.concatenate([first.cov, rest.cov]), whole.cov)
    assert close(rest.final.second_moment, whole.final.second_moment)
    assert close(first.cost - first.tail_cost + modes.discount**k * rest.cost, np.array(whole.cost))
    longer = Schedule(modes, x0, [*sequence, *[sequence[-1]] * 3], graph=whole.graph)
    assert longer.cost == pytest.approx(whole.cost, rel=1e-9)
    moved = [s._replace(step=s.step + k) for s in rest.switches]
    assert (*first.switches, *moved) == whole.switches


@examples(200)
def test_noise_never_makes_a_run_cheaper(n, m, seed):
    rng = np.random.default_rng([n, m, seed])
    A, Q, cost = random_modes(rng, n, m, (0.3, 0.95)), weights(rng, n, m), ("discounted", rng.uniform(0.5, 0.99))
    V, W = (np.einsum("mij,mkj->mik", R, R) for R in rng.standard_normal((2, m, n, 1)))
    sequence, x0 = rng.integers(m, size=STEPS), random_gaussian(rng, n)
    none, some, other, both = (
        Schedule(ModeSet(A, Q=Q, W=noise, cost=cost), x0, sequence).cost for noise in (None, V, W, V + W)
    )
    assert none <= some * (1 + 1e-9)
    assert both - none == pytest.approx(some - none + other - none, rel=1e-9, abs=1e-9 * both)


# Decisions


@each
@examples(200)
def test_powers_of_two_change_no_decision(method, n, m, seed):
    """Exact in floating point: states and weights in other units decide the same, bit for bit."""
    modes, x0, rng = plant(n, m, seed)
    size, weight = 2.0 ** rng.integers(-30, 31, 2)
    plain = schedule(modes, x0, method, STEPS)
    larger = Gaussian(size * x0.mean, size**2 * x0.cov)
    scaled = schedule(ModeSet(modes.A, Q=weight * modes.Q), larger, method, STEPS)
    assert scaled.sequence.tolist() == plain.sequence.tolist()
    assert scaled.cost == size**2 * weight * plain.cost


@examples(250)
def test_powers_of_two_change_no_lengthened_hold(n, m, seed):
    modes, x0, rng = plant(n, m, seed)
    method, size = RecedingHorizon(5, hold=int(rng.integers(1, 4)), decrease=rng.uniform(0.1, 0.9)), 2.0**20
    plain = schedule(modes, x0, method, 30)
    scaled = schedule(modes, Gaussian(size * x0.mean, size**2 * x0.cov), method, 30)
    assert (scaled.sequence.tolist(), scaled.lengthened) == (plain.sequence.tolist(), plain.lengthened)


@each
@examples(200)
def test_rotated_coordinates_change_no_decision(method, n, m, seed):
    """No choice of these plants is so close that rounding could make it, which is checked."""
    modes, x0, rng = plant(n, m, seed)
    plain, T, size = schedule(modes, x0, method, STEPS), rotation(rng, n), 10 ** rng.uniform(-3, 3)
    assert least_margin(method, modes, x0, plain.sequence) > CLEAR
    turned = schedule(*in_coordinates(modes, x0, size * T, T.T / size), method, STEPS)
    assert turned.sequence.tolist() == plain.sequence.tolist()
    assert turned.cost == pytest.approx(plain.cost, rel=1e-9)


@pytest.mark.parametrize("method", DECIDING[1:], ids=repr)
@examples(200, m=(2, 4))
def test_modes_in_another_order_are_the_same_modes(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed)
    plain, order = schedule(modes, x0, method, STEPS), rng.permutation(m)
    assert least_margin(method, modes, x0, plain.sequence) > CLEAR
    again = schedule(ModeSet(modes.A[order], Q=modes.Q[order]), x0, method, STEPS)
    assert order[again.sequence].tolist() == plain.sequence.tolist()
    twice = np.concatenate([np.arange(m), rng.integers(m, size=2)])
    doubled = schedule(ModeSet(modes.A[twice], Q=modes.Q[twice]), x0, method, STEPS)
    assert doubled.sequence.tolist() == plain.sequence.tolist()


@pytest.mark.parametrize("method", FINITE, ids=repr)
@examples(500, A=matrices)
def test_of_modes_that_tie_the_lowest_index_is_taken(method, n, m, seed, A):
    """Costs of small integers, in integers."""
    rng = np.random.default_rng(seed)
    A, x = A[rng.integers(len(A), size=m)], rng.integers(-2, 3, 3)
    scheduler, Q, held = method.start(ModeSet(A)), np.eye(3, dtype=int), 0
    G = Q + 0 * A
    for _ in range(getattr(method, "horizon", 1)):
        G = Q + np.swapaxes(A, 1, 2) @ G @ A
    for k in range(6):
        mode = scheduler.step(x)
        if k % getattr(method, "hold", 1) == 0:
            held = int(np.argmin(np.einsum("i,mij,j->m", x, G, x)))
        assert mode == held
        x = A[mode] @ x


@pytest.mark.parametrize("method", [PointwiseMinimum(), RecedingHorizon(4), Rollout()], ids=repr)
@examples(200)
def test_a_method_that_decides_anew_each_step_may_be_started_anew(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed)
    costs = {"switch_cost_per_w2": rng.exponential(0.1, (m, m)), "min_dwell": int(rng.integers(1, 4))}
    whole = schedule(modes, x0, method, STEPS, Rules(**costs))
    k = int(rng.integers(1, STEPS))
    first = schedule(modes, x0, method, k, Rules(**costs))
    start = (int(first.sequence[-1]), int(first.dwell_times[-1]))
    rest = schedule(modes, first.final, method, STEPS - k, Rules(**costs, start=start))
    assert [*first.sequence, *rest.sequence] == whole.sequence.tolist()
    assert close([*first.w2, *rest.w2], whole.w2)


@examples(600, m=(2, 3), kind=st.sampled_from([kind for kind in KINDS if kind is not none]))
def test_online_under_rules_and_noise_is_offline(n, m, seed, kind):
    modes, x0, rng = full_plant(n, m, seed, names=None, dt=0.25)
    told = kind(rng, m, modes.dt) if kind.__name__ == "seconds" else kind(rng, m)
    try:
        graph = SwitchingGraph(modes, Rules(**told))
    except ContradictionError:
        graph = SwitchingGraph(modes)
    method = DECIDING[rng.integers(1, len(DECIDING))]
    try:
        offline = schedule(modes, x0, method, STEPS, graph)
    except ValueError as error:
        assert "finite cost" in str(error)
        method = RecedingHorizon(3)
        offline = schedule(modes, x0, method, STEPS, graph)
    scheduler = method.start(SwitchingGraph(modes, graph.rules))
    online = [scheduler.step(offline.mean[:, k], offline.cov[k]) for k in range(STEPS)]
    assert online == offline.sequence.tolist()


@examples(300)
def test_methods_that_look_to_the_end_never_cost_more_than_the_best_mode(n, m, seed):
    modes, x0, rng = plant(n, m, seed)
    best = single_mode_costs(modes, x0).min()
    method = [Rollout(), RecedingHorizon(math.inf), RecedingHorizon(math.inf, hold=3)][rng.integers(3)]
    run = schedule(modes, x0, method, int(rng.integers(1, STEPS)))
    assert run.cost <= best * (1 + 1e-9)
