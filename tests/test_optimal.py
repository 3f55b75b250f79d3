"""The optimum: published and independent numbers, honest statuses, faults, and the policy's guarantee."""

import json
import math
import pickle
import time
from itertools import product

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes
from scipy.linalg import expm, orth

from switchctl import (
    Constant,
    FewSwitches,
    FormatError,
    Gaussian,
    ModeSet,
    Optimal,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    compare,
    schedule,
)
from switchctl.files import digest
from switchctl.models import five_mode, medium_access, quadrotor, servo
from switchctl.moments import svec
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.lower import LowerBounds
from switchctl.optimum.prefixes import Tree
from switchctl.optimum.search import Search
from switchctl.optimum.upper import UpperBounds


@pytest.fixture(scope="module")
def pair():
    return ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])


@pytest.fixture(scope="module")
def x0():
    return Gaussian([1.0, 1.0], 0.01 * np.eye(2))


@pytest.fixture(scope="module")
def design_a():
    return quadrotor.modes("closed_loop"), quadrotor.initial_state()


def test_example_1():
    found = schedule(five_mode.modes(), five_mode.initial_state(), Optimal(gap=1e-9))
    assert found.cost == pytest.approx(77.773698147481, abs=1e-11)
    assert found.gap <= 1e-9
    assert found.status == "optimal"
    assert found.tail == (0, 1, 4)
    assert found.sequence.tolist() == [0, 1, 4] * 6


@pytest.mark.parametrize(
    ("steps", "cost"), [(5, 77.769051355), (8, 77.773678292), (9, 77.773691260), (10, 77.773697505)]
)
def test_example_1_over_finite_horizons(steps, cost):
    found = schedule(five_mode.modes(), five_mode.initial_state(), Optimal(gap=1e-9), steps, terminal=np.eye(2))
    assert found.cost == pytest.approx(cost, abs=1e-9)
    assert found.gap <= 1e-9
    assert len(found) == steps
    assert found.cost == pytest.approx(found.w2.sum() + found.final.w2())


def test_quadrotor(design_a):
    found = schedule(*design_a, Optimal(gap=3e-4))
    assert found.cost == pytest.approx(45.6486, abs=1e-4)
    assert found.gap <= 3e-4
    assert found.status == "gap reached"


@pytest.mark.slow
@pytest.mark.parametrize(("dwell", "cost"), [(5, 46.710234), (10, 46.710234), (25, 46.710234), (50, 46.713571)])
def test_quadrotor_under_dwell_times(design_a, dwell, cost):
    found = schedule(*design_a, Optimal(gap=1e-6), rules=Rules(min_dwell=dwell))
    assert found.gap <= 1e-6
    assert found.lower_bound <= cost <= found.cost + 2e-6
    assert min(found.dwell_times[:-1]) >= dwell


def closed(modes, start, gap=1e-6, time_limit=20.0):
    found = schedule(modes, start, Optimal(gap=gap, time_limit=time_limit))
    assert found.lower_bound <= found.cost * (1 + 1e-12)
    return found.gap <= gap


@pytest.mark.slow
def test_random_modes_are_all_closed():
    rng = np.random.default_rng(1)
    for _ in range(300):
        n, m = rng.integers(2, 9), rng.choice([2, 3, 5])
        A = random_modes(rng, n, m, radius=(0.8, 0.98))
        assert closed(ModeSet(A), random_gaussian(rng, n))


@pytest.mark.slow
def test_orthogonal_times_diagonal_modes_are_all_closed():
    rng = np.random.default_rng(2)
    for _ in range(100):
        n, m = rng.integers(2, 9), rng.choice([2, 3, 5])
        A = np.array([orth(rng.standard_normal((n, n))) @ np.diag(rng.uniform(0.3, 1.2, n)) for _ in range(m)])
        A *= (rng.uniform(0.8, 0.98, m) / np.abs(np.linalg.eigvals(A)).max(axis=1))[:, None, None]
        assert closed(ModeSet(A), random_gaussian(rng, n))


@pytest.mark.slow
def test_most_sampled_continuous_modes_are_closed():
    rng = np.random.default_rng(3)
    done = 0
    for n in (2, 4, 6):
        for _ in range(7):
            F = rng.standard_normal((2, n, n))
            shift = np.linalg.eigvals(F).real.max(axis=1) + rng.uniform(0.1, 1.0, 2)
            A = expm(0.1 * (F - shift[:, None, None] * np.eye(n)))
            done += closed(ModeSet(A), random_gaussian(rng, n), time_limit=10.0)
    assert done >= 19  # of 21


def test_singular_weights_are_bounded_too():
    found = schedule(servo.modes(), servo.initial_state(), Optimal(gap=1e-3))
    assert found.gap <= 1e-3
    assert found.statistics["bounds"] > 1
    assert found.cost < min(schedule(servo.modes(), servo.initial_state(), Constant(i)).cost for i in range(2))


def test_where_no_mode_is_stable_alone():
    found = schedule(medium_access.modes(), medium_access.initial_state(), Optimal(), rules=medium_access.rules())
    assert found.gap <= 1e-3
    unstable = ModeSet([[[1.2, 0.0], [0.0, 0.5]], [[0.5, 0.0], [0.0, 1.2]]])
    found = schedule(unstable, Gaussian([1.0, 1.0], np.eye(2)), Optimal(gap=1e-6))
    assert found.status == "gap reached"
    assert set(found.tail) == {0, 1}


def test_a_long_stabilising_word_is_found():
    """Each mode turns the state by a tenth of the way to where it shrinks."""
    angle, shrink = np.pi / 14, np.diag([1.3, 0.7])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    modes = ModeSet([turn * 1.001, shrink])
    assert not modes.schur.any()
    found = schedule(modes, Gaussian([1.0, 0.0], 0.1 * np.eye(2)), Optimal(gap=0.5, time_limit=20))
    assert math.isfinite(found.cost)
    assert found.status in ("gap reached", "time limit")
    assert found.lower_bound <= found.cost


def test_no_stabilising_sequence():
    found = schedule(ModeSet([[[1.1]], [[1.2]]]), Gaussian([1.0], [[0.0]]), Optimal())
    assert found.status == "no stabilising sequence found"
    assert found.cost == math.inf
    assert found.gap == 1
    unstable = ModeSet([[[1.1]], [[1.2]]])
    finite = schedule(unstable, Gaussian([1.0], [[0.0]]), Optimal(gap=1e-6), 5, terminal=[[1.0]])
    assert finite.sequence.tolist() == [0] * 5


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 3), st.integers(2, 3), st.integers(0, 2**32 - 1))
def test_no_method_costs_less_than_the_bound(n, m, seed):
    rng = np.random.default_rng(seed)
    modes, start = ModeSet(random_modes(rng, n, m, radius=(0.3, 0.95))), random_gaussian(rng, n)
    best = schedule(modes, start, Optimal(gap=1e-4, time_limit=5))
    for method in (Refine(), RecedingHorizon(5), Constant(0)):
        assert schedule(modes, start, method).cost >= best.lower_bound
    for _ in range(20):
        run = Schedule(modes, start, rng.integers(m, size=rng.integers(1, 9)).tolist())
        assert run.cost >= best.lower_bound


def bounds_of(modes, start, rules=None):
    decisions = Decisions(SwitchingGraph(modes, rules))
    upper, s = UpperBounds(decisions), decisions.scaled(start.second_moment)
    return decisions, LowerBounds(decisions, upper.reference(s)), upper, s


@pytest.mark.parametrize("rules", [None, Rules(min_dwell=4), Rules(switch_cost_per_w2=0.1, max_dwell={"calm": 7})])
def test_every_bound_holds_on_every_move(pair, x0, rules):
    decisions, lower, *_ = bounds_of(pair, x0, rules)
    rng = np.random.default_rng(0)
    for _ in range(20):
        factor = rng.standard_normal((2, 2))
        lower.improve(int(rng.integers(len(decisions.places))), svec(factor @ factor.T))
    assert lower.count > 3
    for u in range(len(decisions.places)):
        for move in decisions.moves(u):
            after = move.q + lower.rows(move.head) @ move.K
            for _ in range(20):
                x = rng.standard_normal(2)
                moment = svec(np.outer(x, x))
                assert (lower.rows(u) @ moment <= after @ moment + 1e-12 * np.abs(after @ moment)).all()


class Broken:
    """A solver that fails in a given way."""

    how = ""

    def __init__(self, *problem):
        self.size = len(problem[1])

    def solve(self):
        if self.how == "raises":
            raise RuntimeError
        if self.how == "panics":
            raise BaseException("panic")
        return self

    @property
    def x(self):
        value = {"nan": math.nan, "rubbish": 1e6, "negative": -1e6}.get(self.how)
        return np.zeros(3) if value is None else np.full(self.size, value)


@pytest.mark.parametrize("how", ["raises", "panics", "nan", "rubbish", "negative", "wrong size"])
def test_a_solver_that_fails_is_not_believed(pair, x0, monkeypatch, how):
    monkeypatch.setattr(Broken, "how", how)
    monkeypatch.setattr(clarabel, "DefaultSolver", Broken)
    found = schedule(pair, x0, Optimal(gap=1e-2, time_limit=20))
    assert found.gap <= 1e-2
    assert found.lower_bound <= 14.44225631


def test_limits(design_a):
    begun = time.perf_counter()
    found = schedule(*design_a, Optimal(gap=1e-8, time_limit=0.5))
    assert time.perf_counter() - begun < 5
    assert found.status == "time limit"
    assert 0 < found.lower_bound < found.cost < 46
    found = schedule(*design_a, Optimal(gap=1e-8, memory_limit=1e5))
    assert found.status == "memory limit"
    assert found.lower_bound > 0


def test_the_callback_and_ctrl_c(design_a):
    rungs = []

    def stop(rung):
        rungs.append(rung)
        if rung.gap < 0.1:
            raise KeyboardInterrupt

    found = schedule(*design_a, Optimal(gap=1e-8, callback=stop))
    assert found.status == "interrupted"
    assert found.lower_bound == pytest.approx(rungs[-1].lower_bound)
    assert found.cost == pytest.approx(rungs[-1].cost, rel=1e-9)
    assert [rung.tolerance for rung in rungs] == sorted((rung.tolerance for rung in rungs), reverse=True)
    assert all(rung.gap <= 1 and rung.nodes > 0 and rung.seconds > 0 for rung in rungs)


def test_the_same_answer_again(design_a):
    one, two = (schedule(*design_a, Optimal(gap=1e-3)) for _ in range(2))
    assert one.sequence.tolist() == two.sequence.tolist()
    assert (one.cost, one.lower_bound, one.statistics["nodes"]) == (two.cost, two.lower_bound, two.statistics["nodes"])


def test_a_tree_that_drops_what_is_not_needed_gives_the_same(monkeypatch, design_a):
    whole = schedule(*design_a, Optimal(gap=1e-3))
    kept = []
    keep = Tree.keep
    monkeypatch.setattr("switchctl.optimum.search._TREE", 500)
    monkeypatch.setattr(Tree, "keep", lambda self, stacks: (kept.append(1), keep(self, stacks))[1])
    again = schedule(*design_a, Optimal(gap=1e-3))
    assert kept
    assert again.sequence.tolist() == whole.sequence.tolist()
    assert again.lower_bound == whole.lower_bound


def test_online_it_makes_the_same_decisions(pair, x0):
    scheduler = Optimal(gap=1e-3).start(pair)
    planned = schedule(pair, x0, Optimal(gap=1e-3))
    mean, cov = x0.mean, x0.cov
    for k in range(20):
        mode = scheduler.step(mean, cov)
        assert mode == planned.sequence[k]
        mean, cov = pair.A[mode] @ mean, pair.A[mode] @ cov @ pair.A[mode].T
    scheduler.reset()
    assert scheduler.lower_bound is None


def test_saving_copying_and_printing(pair, x0, tmp_path):
    M = [[2.0, 0.5], [0.5, 1.0]]
    for found in (schedule(pair, x0, Optimal()), schedule(pair, x0, Optimal(), 12, terminal=M)):
        loaded = Schedule.load(found.save(tmp_path / "schedule.json"))
        for again in (loaded, pickle.loads(pickle.dumps(found))):
            assert (again.cost, again.lower_bound, again.gap) == (found.cost, found.lower_bound, found.gap)
            assert again.status == found.status
            assert (
                np.array_equal(again.terminal, found.terminal) if found.terminal is not None else again.terminal is None
            )
        assert "no sequence costs less than" in repr(found)


def test_nothing_to_do(pair):
    for steps, M in ((None, None), (4, np.eye(2))):
        found = schedule(pair, Gaussian([0.0, 0.0], np.zeros((2, 2))), Optimal(), steps, terminal=M)
        assert (found.cost, found.gap, found.status) == (0, 0, "optimal")


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        ({"gap": 0}, ValueError, "gap is 0.0; expected a number between 0 and 1"),
        ({"gap": 1}, ValueError, "between 0 and 1"),
        ({"gap": math.nan}, ValueError, "gap is nan"),
        ({"gap": "small"}, TypeError, "gap must be a number"),
        ({"time_limit": 0}, ValueError, "time_limit is 0.0; expected a number above 0"),
        ({"memory_limit": -1}, ValueError, "memory_limit"),
        ({"callback": 3}, TypeError, "callable"),
    ],
)
def test_wrong_settings(wrong, error, words):
    with pytest.raises(error, match=words):
        Optimal(**wrong)


def test_a_terminal_weight_must_fit(pair, x0):
    for method in (Optimal(), Refine(), Rollout()):
        with pytest.raises(ValueError, match=r"steps=N"):
            schedule(pair, x0, method, terminal=np.eye(2))
        for M, words in [
            (np.eye(3), "the modes have 2 states"),
            ([[1.0, 2.0], [2.0, 1.0]], "least eigenvalue is -1"),
            ([[1.0, 2.0]], r"shape \(1, 2\)"),
            ([[1.0, 0.0], [0.0, math.inf]], r"terminal\[1, 1\] is inf"),
        ]:
            with pytest.raises(ValueError, match=words):
                schedule(pair, x0, method, 5, terminal=M)


def test_every_method_takes_a_terminal_weight(pair, x0):
    best = schedule(pair, x0, Optimal(gap=1e-6), 12, terminal=3 * np.eye(2))
    for method in (Refine(), Rollout(), RecedingHorizon(5), Refine(RecedingHorizon(2))):
        found = schedule(pair, x0, method, 12, terminal=3 * np.eye(2))
        assert len(found) == 12 and found.tail == ()
        assert found.cost == pytest.approx(found.w2.sum() + 3 * found.final.w2())
        assert found.cost >= best.lower_bound
    with pytest.raises(ValueError, match="a run for ever"):
        schedule(pair, x0, FewSwitches(1), 12, terminal=np.eye(2))


def test_a_rung_stops_where_it_is_told_to(pair, x0):
    """A rung stops where it is told to, and what it proved until then is kept."""
    decisions, lower, upper, s = bounds_of(pair, x0)
    search = Search(decisions, lower, upper, s)
    assert search.rung(0.5, math.inf) == "closed"
    proven = search.bound
    assert proven >= 0.5 * 14.4422
    assert search.rung(1e-7, math.inf, most=1) == "too many"
    assert search.bound >= proven


def test_a_long_finite_horizon_is_as_good_as_the_beginning_of_the_endless_run(pair, x0):
    endless = schedule(pair, x0, Optimal(gap=1e-6))
    cut = Schedule(pair, x0, endless.sequence[:100], terminal=np.eye(2))
    assert schedule(pair, x0, Optimal(gap=1e-3), 100, terminal=np.eye(2)).cost <= cut.cost * (1 + 1e-12)


def test_what_costs_infinitely_much_by_the_rules_is_said(pair, x0):
    with pytest.raises(ValueError, match="at finite cost"):
        schedule(pair, x0, Optimal(), rules=Rules(max_dwell=6, switch_cost=0.1))


def test_a_comparison_tells_the_gap(pair, x0):
    table = repr(compare(pair, x0, {"best": Optimal(gap=1e-2), "refined": Refine()}))
    assert table.splitlines()[0].split()[-1] == "gap"


def test_a_file_whose_bound_is_above_its_cost_is_refused(pair, x0, tmp_path):
    path = schedule(pair, x0, Optimal()).save(tmp_path / "schedule.json")
    document = json.loads(path.read_text())
    document["lower_bound"] = 1.1 * document["cost"]
    document["sha256"] = digest({key: value for key, value in document.items() if key != "sha256"})
    path.write_text(json.dumps(document))
    with pytest.raises(FormatError, match="above its cost"):
        Schedule.load(path)


def test_rounding_that_hides_the_cost_is_no_proof():
    """A great state that costs nothing: products of moments lose the others, and the bound must not claim them."""
    A = [[[0.3, 0.3, 0], [0.9, 0.7, 0], [0, 0, 0.1]], [[-1.6, 0.9, 0], [-1.2, 0.4, 0], [0, 0, 1.0]]]
    Q = np.diag([1.0, 1.0, 0.0])
    start = Gaussian([0.0, -0.3, 3e6], np.zeros((3, 3)))
    found = schedule(ModeSet(A, Q=Q), start, Optimal(), 3, terminal=Q)
    costs = []
    for run in product(range(2), repeat=3):
        x, cost = start.mean, 0.0
        for mode in run:
            x, cost = np.array(A[mode]) @ x, cost + x @ Q @ x
        costs.append(cost + x @ Q @ x)
    assert found.lower_bound <= min(costs)
    assert found.status == "precision limit"


def test_a_price_is_paid_by_a_state_at_rest(pair):
    rules = Rules(price=[1.0, 0.0], start=("fast", 1), switch_cost=0.5)
    nowhere = Gaussian([0.0, 0.0], np.zeros((2, 2)))
    found = schedule(pair, nowhere, Optimal(gap=1e-3), 5, rules, terminal=np.eye(2))
    assert found.sequence.tolist() == [1] * 5
    assert found.cost == pytest.approx(0.5)
    assert found.gap <= 1e-3


def test_units_of_the_states_make_no_difference():
    S = np.array([[1, 0.5, 0.2], [0.5, 1, -0.3], [0.2, -0.3, 1]])
    A = [[[0.9, 0.3, 0], [0, 0.8, 0.2], [0.1, 0, 0.7]], [[0.7, 0, 0.2], [-0.4, 0.9, 0], [0, 0.3, 0.6]]]
    plain = schedule(ModeSet(A), Gaussian(np.zeros(3), S), Optimal(gap=1e-4))
    for units in ([1, 1e-6, 1e6], [1e6, 1, 1e-6]):
        T = np.diag(units)
        modes = ModeSet([T @ a @ np.linalg.inv(T) for a in np.array(A)], Q=np.linalg.inv(T @ T))
        found = schedule(modes, Gaussian(np.zeros(3), T @ S @ T), Optimal(gap=1e-4))
        assert found.cost == pytest.approx(plain.cost, rel=1e-9)
        assert found.lower_bound <= plain.cost
        assert found.gap <= 1.1e-4


def test_what_must_be_paid_in_constants_is_the_least_of_all_runs():
    rng = np.random.default_rng(4)
    modes = ModeSet(random_modes(rng, 1, 3))
    rules = Rules(max_dwell=2, switch_cost=rng.exponential(1.0, (3, 3)), price=[0.3, 0.0, 0.5])
    graph = SwitchingGraph(modes, rules)
    edges = {}
    for edge in graph.edges():
        edges.setdefault(edge.tail, []).append((edge.head, edge.constant))

    def least(v, steps):
        return min(paid + least(head, steps - 1) for head, paid in edges[v]) if steps else 0.0

    constants = Decisions(graph, 6).constants
    for k in range(7):
        assert constants[k, 0] == pytest.approx(least(0, 6 - k), rel=1e-9)
        assert constants[k, 0] <= least(0, 6 - k)
    for_ever = Rules(switch_cost=0.7, start=("A0", 1), price=[0.3, 0.0, 0.5])
    decisions = Decisions(SwitchingGraph(modes, for_ever))
    assert decisions.constants[0] == pytest.approx(0.7, rel=1e-9)
    assert decisions.constants[0] <= 0.7


@pytest.mark.parametrize("Q", [np.diag([1.0, 0.0]), np.zeros((2, 2))])
def test_one_mode_whose_weight_does_not_see_every_state(Q):
    found = schedule(ModeSet([np.diag([0.5, 0.8])], Q=Q), Gaussian([1.0, 1.0], np.eye(2)), Optimal(gap=0.1))
    assert found.status in ("optimal", "gap reached")
    assert found.cost == pytest.approx(2 / 0.75 if Q.any() else 0.0)
