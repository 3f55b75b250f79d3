"""FewSwitches, Refine and trade_off on the paper's examples, and what the searches rest on."""

import itertools
import math

import numpy as np
import pytest
from random_cases import random_gaussian, random_modes

import switchctl.methods.refine
from switchctl import (
    Budget,
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Scheduler,
    schedule,
    trade_off,
)
from switchctl.methods.orbits import Orbit
from switchctl.moments import svec
from switchctl.optimum.minorants import lower_bounds, minorant


def test_the_best_single_and_double_switch_of_the_quadrotor(quadrotor):
    one = schedule(*quadrotor, FewSwitches(1))
    assert one.switches == ((50, 1, 0),)
    assert one.cost == pytest.approx(46.7176, abs=5e-5)
    two = schedule(*quadrotor, FewSwitches(2))
    assert two.switches == ((1, 0, 1), (27, 1, 0))
    assert two.cost == pytest.approx(45.656, abs=5e-4)
    three = schedule(*quadrotor, FewSwitches(3))
    assert three.cost <= two.cost


def test_sweeps_from_high_alone(quadrotor):
    result = schedule(*quadrotor, Refine(Constant("high")))
    assert result.statistics["start"] == pytest.approx(50.3714, abs=5e-5)
    assert (result.statistics["sweeps"], result.statistics["moves"]) == (2, 0)
    assert result.cost == pytest.approx(45.64859, abs=5e-6)


def test_moves_leave_a_local_optimum_of_the_sweeps(quadrotor, monkeypatch):
    base = RecedingHorizon(150, hold=50)
    result = schedule(*quadrotor, Refine(base))
    assert result.statistics["moves"] > 0
    assert result.cost == pytest.approx(45.6486, abs=5e-5)
    monkeypatch.setattr(switchctl.methods.refine.LocalSearch, "_move", lambda self, run, rest: run.path)
    assert schedule(*quadrotor, Refine(base)).cost == pytest.approx(46.7102, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("dwell", "cost"), [(5, 46.710234), (10, 46.710234), (25, 46.710234), (50, 46.713571)])
def test_refining_under_dwell_times_comes_to_the_known_optima(quadrotor, dwell, cost):
    result = schedule(*quadrotor, Refine(), rules=Rules(min_dwell=dwell))
    assert result.cost == pytest.approx(cost, rel=1e-6)
    assert min(result.dwell_times[:-1]) >= dwell


def test_refining_the_first_example_comes_to_its_optimum(example):
    assert schedule(*example, Refine()).cost == pytest.approx(77.77369815, abs=5e-9)


def test_lower_bounds_are_below_every_sequence():
    rng = np.random.default_rng(3)
    for trial in range(30):
        n, m = int(rng.integers(1, 4)), int(rng.integers(1, 4))
        modes = ModeSet(random_modes(rng, n, m, (0.2, 0.7)), Q=np.diag([1.0] + [float(trial % 2)] * (n - 1)))
        x0 = random_gaussian(rng, n)
        bound = (lower_bounds(modes.A, modes.Q) @ svec(x0.second_moment)).max()
        least = math.inf
        for sequence in itertools.product(range(m), repeat=6):
            S, cost = x0.second_moment, 0.0
            for mode in sequence:
                cost += np.sum(modes.Q[mode] * S)
                S = modes.A[mode] @ S @ modes.A[mode].T
            least = min(least, cost + min(np.sum(P * S) for P in modes.tails))
        assert bound <= least * (1 + 1e-12)


def test_lower_bounds_hold_for_states_of_unlike_units():
    rng = np.random.default_rng(8)
    for _ in range(60):
        n, m = 2, 2
        units = 10.0 ** rng.uniform(-6, 6, n)
        A = random_modes(rng, n, m, (0.2, 0.9)) * units[:, None] / units
        roots = rng.standard_normal((m, n, 1)) / units[:, None]  # singular weights
        Q = roots @ np.swapaxes(roots, 1, 2)
        bounds, tails = lower_bounds(A, Q), ModeSet(A, Q=Q).tails
        for _ in range(5):
            x = units * rng.standard_normal(n)
            least = math.inf
            for sequence in itertools.product(range(m), repeat=7):
                state, cost = x, 0.0
                for mode in sequence:
                    cost += state @ Q[mode] @ state
                    state = A[mode] @ state
                ends = [state @ P @ state for P in tails]
                least = min(least, cost + min(ends))
            assert (bounds @ svec(np.outer(x, x))).max() <= least * (1 + 1e-9)


def test_a_minorant_is_below_both():
    v, u = np.array([1, 1e-4]), np.array([1, -1e4])
    X, Y = np.outer(v, v), 1e6 * np.diag([1.0, 0.0])
    L = minorant(X, Y)
    assert u @ L @ u <= 1e-9
    assert np.linalg.eigvalsh(X - L)[0] >= -1e-12
    assert np.linalg.eigvalsh(Y - L)[0] >= -1e-9


def test_a_cost_of_nothing_ends_the_search():
    g = np.random.default_rng(0)
    c = g.normal(size=2)
    x = np.array([-c[1], c[0]])
    V = np.column_stack([c, x]) / np.linalg.norm(c)
    modes = ModeSet([V @ np.diag(d) @ V.T for d in ((0.5, 0.9), (0.6, 0.8))], Q=np.outer(c, c))
    for method in (Refine(), FewSwitches(2)):
        assert abs(schedule(modes, Gaussian(x, np.zeros((2, 2))), method).cost) < 1e-12


def test_more_switches_than_can_be_cost_nothing(pair):
    one = ModeSet([[[0.5]]])
    assert schedule(one, Gaussian([1.0], [[0.0]]), FewSwitches(10**6)).cost == pytest.approx(4 / 3)
    modes, x0 = pair
    assert len(schedule(modes, x0, FewSwitches(10**6), rules=Rules(max_switches=1)).switches) == 1


@pytest.mark.parametrize("at", range(2, 9))
@pytest.mark.parametrize("method", [Rollout(), FewSwitches(2), RecedingHorizon(5, hold=3)], ids=repr)
def test_an_interrupt_after_a_decision_leaves_a_whole_schedule(pair, monkeypatch, method, at):
    modes, x0 = pair
    rules = Rules(min_dwell=3) if isinstance(method, FewSwitches) else Rules(max_dwell=5)
    original, count = Scheduler.take, itertools.count(1)

    def take(self, S):
        mode = original(self, S)
        if next(count) == at:
            raise KeyboardInterrupt
        return mode

    whole = schedule(modes, x0, method, steps=at - 1, rules=rules)
    monkeypatch.setattr(Scheduler, "take", take)
    cut = schedule(modes, x0, method, rules=rules)
    assert cut.status == "interrupted"
    assert (cut.sequence.tolist(), cut.lead, cut.tail) == (whole.sequence.tolist(), whole.lead, whole.tail)


def test_an_orbit_is_the_powers():
    rng = np.random.default_rng(1)
    M, x = rng.standard_normal((3, 3)) / 2, rng.standard_normal(3)
    for steps in (0, 1, 2, 7, 8, 13):
        expected = [np.linalg.matrix_power(M, k) @ x for k in range(steps + 1)]
        assert Orbit(M).from_(x, steps) == pytest.approx(np.array(expected))


def test_few_switches_finds_a_late_opening():
    # fast opens only after 3000 steps, long after slow has left nothing to gain: it must still be found legal to hold.
    modes = ModeSet([[[0.5]], [[0.9]]], names=["fast", "slow"])
    rules = Rules(allowed={"fast": [(3000, math.inf)]}, price={"slow": 1e-9})
    result = schedule(modes, Gaussian([1.0], [[0.0]]), FewSwitches(1), rules=rules)
    assert [*result.sequence, *result.lead].count(1) == 3000
    assert result.tail == (0,)


def test_few_switches_needs_a_mode_to_end_in(pair):
    modes, x0 = pair
    with pytest.raises(ValueError, match=r"FewSwitches\(1\) ends in a mode held for ever at finite cost, and Rules"):
        schedule(modes, x0, FewSwitches(1), rules=Rules(max_dwell=9))
    with pytest.raises(ValueError, match=r"FewSwitches\(0\)"):
        schedule(modes, x0, FewSwitches(0), rules=Rules(price={"fast": 1}, start=("fast", 1)))
    for wrong in (-1, 1.5):
        with pytest.raises(ValueError, match="max_switches"):
            FewSwitches(wrong)


def test_refine_says_what_it_needs():
    with pytest.raises(TypeError, match="base must be a Method"):
        Refine("rollout")
    with pytest.raises(ValueError, match="the schedule to refine costs infinitely much"):
        schedule(ModeSet([[[1.1]], [[1.2]]]), Gaussian([1.0], [[0.0]]), Refine(Constant(0)), steps=3)


@pytest.mark.parametrize(
    ("method", "place", "calls"),
    [
        (Refine(Constant("high")), "switchctl.methods.refine.LocalSearch._sweep", 2),
        (FewSwitches(2), "switchctl.methods.few_switches._FewSwitchesScheduler._hold", 2),
    ],
)
def test_ctrl_c_returns_the_best_so_far(quadrotor, monkeypatch, method, place, calls):
    *module, kind, name = place.split(".")
    owner = getattr(__import__(".".join(module), fromlist=[kind]), kind)
    original, count = getattr(owner, name), itertools.count(1)

    def interrupted(self, *arguments):
        if next(count) == calls:
            raise KeyboardInterrupt
        return original(self, *arguments)

    monkeypatch.setattr(owner, name, interrupted)
    result = schedule(*quadrotor, method)
    assert result.status == "interrupted"
    assert math.isfinite(result.cost)
    assert result.cost < 52.6


def test_a_plan_is_followed_whatever_comes(pair):
    modes, x0 = pair
    planned = schedule(modes, x0, FewSwitches(1))
    scheduler: Scheduler = FewSwitches(1).start(modes)
    assert [scheduler.step(x0.mean, x0.cov), *(scheduler.step([9.0, 9.0]) for _ in range(9))] == list(
        planned.sequence[:10]
    )
    scheduler.reset()
    assert scheduler.step(x0.mean, x0.cov) == planned.sequence[0]
    for steps in (1, 4, 7, 8, 30):  # cut short, the rest of the plan leads to the tail
        cut = schedule(modes, x0, FewSwitches(1), steps=steps)
        assert cut.cost == pytest.approx(planned.cost, rel=1e-12)


def test_a_trade_off_never_rewards_a_tighter_rule(example):
    modes, x0 = example
    dwell = trade_off(modes, x0, over="min_dwell", values=[1, 2, 3, 5, 8])
    costs = [row["cost"] for row in dwell.rows()]
    assert costs == sorted(costs)
    assert costs[0] == pytest.approx(77.77369815)
    price = trade_off(modes, x0, values=[0, 0.1, 1, 10, 100])
    switches = [row["switches"] for row in price.rows()]
    assert [row["cost"] for row in price.rows()] == sorted(row["cost"] for row in price.rows())
    assert switches == sorted(switches, reverse=True)
    assert switches[-1] == 0
    budget = trade_off(modes, x0, Rules(budget=Budget(use={"A1": 1, "A2": 1}, limit=4)), over="budget")
    costs = [row["cost"] for row in budget.rows()]
    assert costs == sorted(costs, reverse=True)
    assert all(row["use"] <= row["value"] for row in budget.rows())


def test_a_trade_off_tells_what_cannot_be(pair):
    modes, x0 = pair
    result = trade_off(modes, x0, Rules(max_dwell=12), over="min_dwell", values=[1, 12, 20])
    assert result.schedules[2] is None
    assert repr(result).splitlines()[-1].split() == ["20", "-", "-", "-", "-"]
    for keywords, error, words in (
        ({"over": "dwell"}, ValueError, "over is 'dwell'; expected"),
        ({"over": "budget"}, ValueError, "the rules have none"),
        ({"values": []}, ValueError, "values is empty"),
        ({"values": "12"}, TypeError, "values must be a sequence"),
        ({"values": [-1]}, ValueError, "switch_cost is -1"),
    ):
        with pytest.raises(error, match=words):
            trade_off(modes, x0, **keywords)


def test_of_equal_modes_the_first_is_taken():
    """A product of matrices may round equal rows differently, by where they stand."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        A, Q, x0 = random_modes(rng, 4, 3, (0.3, 0.9)), np.eye(4), random_gaussian(rng, 4)
        twice = [0, 1, 2, *rng.integers(3, size=2)]
        found = schedule(ModeSet(A[twice], Q=Q), x0, Refine(PointwiseMinimum()))
        assert max(*found.sequence, *found.lead, *found.tail) < 3
        assert found.cost == pytest.approx(schedule(ModeSet(A, Q=Q), x0, Refine(PointwiseMinimum())).cost, rel=1e-9)
