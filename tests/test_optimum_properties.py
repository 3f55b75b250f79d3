"""What the mathematics promises of optima, guarantees and files, on random plants."""

import sys
from itertools import pairwise

import numpy as np
import pytest
import test_properties
from hypothesis import strategies as st
from properties import examples, full_plant, in_coordinates, number_of_examples, plant, rotation, weights
from random_cases import random_gaussian, random_modes
from random_rules import KINDS

from switchctl import (
    Constant,
    ContradictionError,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
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
from switchctl.certificates import Certificate, certify
from switchctl.stability import (
    average_dwell_time,
    does_switching_help,
    joint_spectral_radius,
    minimum_dwell_time,
    policy_stability,
    random_stability,
    schur_stability,
    word_stability,
)

GAP = 0.02
PLANNING = [FewSwitches(1), FewSwitches(2), Refine(), Refine(PointwiseMinimum()), Optimal(GAP)]
each = pytest.mark.parametrize("method", PLANNING, ids=repr)
ROUNDING = 1 + 1e-9


def lower(result):
    """What is proven of the optimum."""
    return result.cost if result.lower_bound is None else result.lower_bound


def same_optimum(a, b, factor=1.0):
    """Whether b costs ``factor`` times what a costs: to rounding, or to the gap that is proven."""
    if a.lower_bound is None:
        return b.cost == pytest.approx(factor * a.cost, rel=1e-9)
    overlap = max(factor * a.lower_bound, b.lower_bound) <= min(factor * a.cost, b.cost) * ROUNDING
    return overlap and max(a.gap, b.gap) <= GAP


# Optima


@each
@examples(60, n=(1, 4))
def test_powers_of_two_change_no_plan(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 0.9))
    size, weight = 2.0 ** rng.integers(-20, 21, 2)
    plain = schedule(modes, x0, method)
    larger = Gaussian(size * x0.mean, size**2 * x0.cov)
    scaled = schedule(ModeSet(modes.A, Q=weight * modes.Q), larger, method)
    if isinstance(method, Optimal):  # the bounds come from a solver, and any plan within the gap will do
        assert same_optimum(plain, scaled, size**2 * weight)
        return
    assert (scaled.sequence.tolist(), scaled.lead, scaled.tail) == (plain.sequence.tolist(), plain.lead, plain.tail)
    assert scaled.cost == size**2 * weight * plain.cost


@each
@examples(35, n=(1, 4))
def test_coordinates_and_the_order_of_modes_change_no_optimum(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 0.9))
    plain, T, order = schedule(modes, x0, method), rotation(rng, n), rng.permutation(m)
    assert same_optimum(schedule(*in_coordinates(modes, x0, T, T.T), method), plain)
    if not isinstance(method, Refine):  # which local optimum it comes to may depend on the order
        assert same_optimum(schedule(ModeSet(modes.A[order], Q=modes.Q[order]), x0, method), plain)
    twice = np.concatenate([np.arange(m), rng.integers(m, size=2)])
    doubled = schedule(ModeSet(modes.A[twice], Q=modes.Q[twice]), x0, method)
    assert same_optimum(doubled, plain)
    assert max(*doubled.sequence, *doubled.lead, *doubled.tail) < m  # of equal modes the first is taken


@pytest.mark.parametrize("method", [FewSwitches(1), FewSwitches(2), Optimal(GAP)], ids=repr)
@examples(100, n=(1, 4), m=(1, 3), steps=st.sampled_from([None, 1, 3, 6]))
def test_a_mode_more_never_raises_the_optimum(method, n, m, seed, steps):
    endless = isinstance(method, FewSwitches) or steps is None
    modes, x0, rng = plant(n, m + 1, seed, radius=(0.3, 0.95 if endless else 1.1))
    root, fewer = rng.standard_normal((n, n)), np.delete(np.arange(m + 1), rng.integers(m + 1))
    steps, ends = (None, {}) if endless else (steps, {"terminal": root @ root.T})
    fewer = ModeSet(modes.A[fewer], Q=modes.Q[fewer])
    few, more = (schedule(among, x0, method, steps, **ends) for among in (fewer, modes))
    assert lower(more) <= few.cost * ROUNDING
    assert max(few.gap or 0, more.gap or 0) <= GAP


@examples(60, n=(1, 4), m=(2, 3))
def test_who_may_do_more_never_pays_more(n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 0.9))
    best = schedule(modes, x0, Optimal(GAP))
    few = [schedule(modes, x0, FewSwitches(most)) for most in range(3)]
    assert few[0].cost == pytest.approx(single_mode_costs(modes, x0).min(), rel=1e-9)
    assert few[2].cost <= few[1].cost * ROUNDING <= few[0].cost * ROUNDING**2
    others = [Rollout(), Refine(), RecedingHorizon(3), Constant(0)]
    feasible = [*few, *(schedule(modes, x0, method) for method in others)]
    feasible += [Schedule(modes, x0, rng.integers(m, size=6), (*rng.integers(m, size=2).tolist(),)) for _ in range(3)]
    assert best.lower_bound <= min(run.cost for run in feasible) * ROUNDING
    assert schedule(modes, x0, Refine(Rollout())).cost <= feasible[3].cost * ROUNDING
    assert best.gap <= GAP


@pytest.mark.parametrize("method", [FewSwitches(2), Optimal(GAP)], ids=repr)
@examples(40, n=(1, 3), m=(2, 3))
def test_stricter_rules_never_cost_less(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 0.9))
    dwell, price = int(rng.integers(1, 4)), rng.exponential(0.1)
    rules = [
        Rules(),
        Rules(min_dwell=dwell),
        Rules(min_dwell=dwell + 1),
        Rules(min_dwell=dwell + 1, switch_cost=price),
        Rules(min_dwell=dwell + 1, switch_cost=2 * price, max_switches=1),
        Rules(min_dwell=dwell + 1, switch_cost=2 * price, max_switches=0),
    ]
    runs = [schedule(modes, x0, method, rules=told) for told in rules]
    for looser, stricter in pairwise(runs):
        assert lower(looser) <= stricter.cost * ROUNDING
    assert lower(runs[-1]) <= single_mode_costs(modes, x0).min() * ROUNDING


@pytest.mark.parametrize("method", [FewSwitches(2), Optimal(GAP)], ids=repr)
@examples(60, n=(1, 4), m=(2, 3))
def test_the_optimum_is_concave_in_the_moment_and_monotone(method, n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 0.9))
    y0 = random_gaussian(rng, n)
    both = Gaussian(np.zeros(n), x0.second_moment + y0.second_moment)
    a, b, sum_ = (schedule(modes, start, method) for start in (x0, y0, both))
    assert lower(a) + lower(b) <= sum_.cost * ROUNDING
    more = ModeSet(modes.A, Q=modes.Q + 0.3 * np.eye(n))
    assert lower(a) <= schedule(more, x0, method).cost * ROUNDING


@examples(120, n=(1, 4), m=(1, 3))
def test_the_rest_of_an_optimal_run_is_optimal_and_longer_runs_cost_more(n, m, seed):
    """Bellman's principle."""
    modes, x0, rng = plant(n, m, seed, radius=(0.3, 1.2))
    root, steps = rng.standard_normal((n, n)), int(rng.integers(2, 7))
    M = root @ root.T
    whole = schedule(modes, x0, Optimal(GAP), steps, terminal=M)
    first = Schedule(modes, x0, whole.sequence[:1], terminal=np.zeros((n, n)))
    rest = schedule(modes, first.final, Optimal(GAP), steps - 1, terminal=M)
    assert whole.lower_bound <= (first.cost + rest.cost) * ROUNDING
    assert first.cost + rest.lower_bound <= whole.cost * ROUNDING
    free = schedule(modes, x0, Optimal(GAP), steps - 1, terminal=np.zeros((n, n)))
    assert free.lower_bound <= whole.cost * ROUNDING


# Guarantees


def jsr(A):
    return joint_spectral_radius(ModeSet(A), tol=0.05, time_limit=5)


@examples(20, n=(1, 3), m=(2, 3))
def test_the_joint_spectral_radius_is_a_property_of_the_set(n, m, seed):
    rng = np.random.default_rng([n, m, seed])
    A, size = random_modes(rng, n, m, (0.1, 1.3)), 10 ** rng.uniform(-2, 2)
    T = rotation(rng, n) @ np.diag(rng.uniform(0.5, 2.0, n)) @ rotation(rng, n)
    found = jsr(A)
    assert np.abs(np.linalg.eigvals(A)).max() <= found.upper * ROUNDING
    assert found.lower <= found.upper <= np.linalg.norm(A, 2, axis=(1, 2)).max() * ROUNDING
    for factor, same in (
        (size, size * A),
        (1.0, np.swapaxes(A, 1, 2)),
        (1.0, T @ A @ np.linalg.inv(T)),
        (1.0, np.concatenate([A, A[:1], A.mean(axis=0)[None]])),  # a mean of modes grows no more
    ):
        other = jsr(same)
        assert other.lower <= factor * found.upper * ROUNDING
        assert factor * found.lower <= other.upper * ROUNDING
    assert jsr(A[1:]).lower <= found.upper * ROUNDING
    words = np.array([B @ C for B in A for C in A])
    squared = jsr(words)
    assert squared.lower <= found.upper**2 * ROUNDING and found.lower**2 <= squared.upper * ROUNDING


@examples(40, n=(1, 3), m=(2, 3))
def test_less_growth_needs_no_longer_dwell_times(n, m, seed):
    rng = np.random.default_rng([n, m, seed])
    A = random_modes(rng, n, m, (0.1, 0.9))
    found = minimum_dwell_time(ModeSet(A), time_limit=5)
    assert 1 <= found.lower <= found.upper
    assert minimum_dwell_time(ModeSet(rng.uniform(0.6, 1.0) * A), time_limit=5).lower <= found.upper
    assert minimum_dwell_time(ModeSet(A[1:]), time_limit=5).lower <= found.upper
    T = rotation(rng, n)
    turned = minimum_dwell_time(ModeSet(T @ A @ T.T), time_limit=5)
    assert turned.lower <= found.upper and found.lower <= turned.upper


@examples(200, n=(1, 4), m=(1, 3))
def test_mean_square_growth_of_words_and_chains(n, m, seed):
    rng = np.random.default_rng([n, m, seed])
    modes, word = ModeSet(random_modes(rng, n, m, (0.2, 1.3))), rng.integers(m, size=rng.integers(1, 5)).tolist()
    held, share = schur_stability(modes), rng.dirichlet(np.ones(m))
    for one, radius in zip(held, modes.spectral_radii, strict=True):
        assert one.lower <= radius * ROUNDING and radius <= one.upper * ROUNDING
    plain, turned = word_stability(modes, word), word_stability(modes, [*word[1:], word[0]])
    assert max(plain.lower, turned.lower) <= min(plain.upper, turned.upper) * ROUNDING
    product = np.eye(n)
    for i in word:
        product = modes.A[i] @ product
    rate = np.abs(np.linalg.eigvals(product)).max() ** (1 / len(word))
    assert plain.lower * (1 - 1e-6) <= rate <= plain.upper * (1 + 1e-6)
    drawn = random_stability(modes, share)
    chain = random_stability(modes, np.tile(share, (m, 1)))
    assert max(drawn.lower, chain.lower) <= min(drawn.upper, chain.upper) * ROUNDING
    radius = np.abs(np.linalg.eigvals(sum(p * np.kron(A, A) for p, A in zip(share, modes.A, strict=True)))).max()
    assert drawn.lower * (1 - 1e-6) <= np.sqrt(radius) <= drawn.upper * (1 + 1e-6)
    alone = random_stability(modes, np.eye(m)[0])
    assert max(alone.lower, held[0].lower) <= min(alone.upper, held[0].upper) * ROUNDING


@examples(100, n=(1, 3), m=(1, 3))
def test_what_rollout_is_proven_to_do_it_does(n, m, seed):
    modes, x0, _ = plant(n, m, seed, Q=None)
    proven, run = policy_stability(modes, Rollout()), schedule(modes, x0, Rollout(), 12)
    assert proven.verdict == "stable"
    V = [min(np.sum(P * S) for P in modes.tails) for S in np.einsum("nk,pk->knp", run.mean, run.mean) + run.cov]
    share, steps = proven.fall.share, proven.fall.steps
    assert all(V[k + steps] <= (1 - share) * V[k] * ROUNDING for k in range(len(V) - steps))


# Files


def equal(a, b):
    """Whether two things are the same, down to the entries of their arrays."""
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if isinstance(a, Gaussian):
        return equal(a.mean, b.mean) and equal(a.cov, b.cov)
    return type(a) is type(b) and (a == b or (a != a and b != b))


OF_MODES = "A names dt Q gains states plant_states activation initial estimate_states W offset cost".split()
OF_SCHEDULE = (
    "x0 sequence tail method status lengthened lead lower_bound terminal target cost cost_parts w2 mean cov switches "
    "resource_use final_w2"
).split()


def same_file(original, folder):
    loaded = Schedule.load(original.save(folder / "schedule.json"))
    assert loaded.graph.rules == original.graph.rules
    assert equal(loaded.graph.successor, original.graph.successor)
    assert dict(loaded.statistics) == dict(original.statistics)
    for names, a, b in ((OF_MODES, original.modes, loaded.modes), (OF_SCHEDULE, original, loaded)):
        for name in names:
            assert equal(getattr(a, name), getattr(b, name)), name


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("properties")


@examples(300, m=(2, 3), kind=st.sampled_from(KINDS))
def test_a_loaded_schedule_is_the_one_saved(folder, n, m, seed, kind):
    modes, x0, rng = full_plant(n, m, seed, names=None, dt=0.25)
    told = kind(rng, m, modes.dt) if kind.__name__ == "seconds" else kind(rng, m)
    try:
        graph = SwitchingGraph(modes, Rules(**told))
    except ContradictionError:
        graph = SwitchingGraph(modes)
    same_file(schedule(modes, x0, RecedingHorizon(3, hold=2), 8, graph), folder)


@examples(250)
def test_a_loaded_schedule_has_every_setting(folder, n, m, seed):
    modes, x0, rng = full_plant(n, m, seed)
    p, kind = modes.plant_states, rng.integers(3)
    if kind == 0:
        made = schedule(modes, x0, PointwiseMinimum(), 5, target=random_gaussian(rng, p))
    elif kind == 1:
        root = rng.standard_normal((p, p))
        made = schedule(modes, x0, RecedingHorizon(3), 5, terminal=root @ root.T)
    else:
        plain = ModeSet(modes.A, Q=weights(rng, n, m))
        made = schedule(plain, x0, [RecedingHorizon(3, decrease=0.9), FewSwitches(1), Refine()][rng.integers(3)], 5)
    same_file(made, folder)


@examples(80, n=(1, 3), m=(1, 2))
def test_a_loaded_certificate_is_the_one_saved_and_still_proves(folder, n, m, seed):
    modes, x0, rng = plant(n, m, seed, radius=(0.2, 0.8), Q=None)
    kind = seed % 7
    found = [
        lambda: schedule(modes, x0, Rollout()),
        lambda: joint_spectral_radius(modes, tol=0.1, time_limit=5),
        lambda: minimum_dwell_time(modes, time_limit=5),
        lambda: average_dwell_time(modes),
        lambda: word_stability(modes, rng.integers(m, size=3).tolist()),
        lambda: does_switching_help(modes),
        lambda: policy_stability(modes, Rollout()),
    ][kind]()
    made = certify(found, **({"gap": 0.1, "prefixes": 200} if kind == 0 else {}))
    loaded = Certificate.load(made.save(folder / "claim.json"))
    assert (loaded.document, loaded.kind, loaded.claim, repr(loaded)) == (
        made.document,
        made.kind,
        made.claim,
        repr(made),
    )
    loaded.check()


def test_there_are_at_least_20_000_examples():
    assert number_of_examples(test_properties, sys.modules[__name__]) >= 20_000
