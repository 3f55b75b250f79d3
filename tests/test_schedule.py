"""Schedules: the cost convention, what follows from a sequence, files."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

import switchctl.methods.prediction
from switchctl import (
    Constant,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Rollout,
    Schedule,
    best_single_mode,
    compare,
    schedule,
    single_mode_costs,
    sweep,
)


def plain_cost(modes, x0, sequence, tail, terms=20000):
    """The convention summed plainly, tail and all."""
    S, total = x0.second_moment, 0.0
    word = [*sequence, *(tail * (terms // len(tail)))]
    for mode in word:
        total += np.trace(modes.Q[mode] @ S)
        S = modes.A[mode] @ S @ modes.A[mode].T
    return modes.dk * total


def test_the_cost_is_the_sum_to_the_end_of_time():
    rng = np.random.default_rng(1)
    Q = np.stack([np.diag([1.0, 0.0, 2.0]), np.eye(3)])
    modes, x0 = ModeSet(random_modes(rng, 3, 2), dt=0.1, Q=Q), random_gaussian(rng, 3)
    sequence = rng.integers(0, 2, 12)
    for tail in ((), (0,), (1, 0, 1)):
        result = Schedule(modes, x0, sequence, tail)
        expected = plain_cost(modes, x0, sequence, tail or (sequence[-1],))
        assert result.cost == pytest.approx(expected, rel=1e-10)
    assert result.area() == pytest.approx(0.1 * result.w2.sum())
    assert result.area(3, 5) == pytest.approx(0.1 * (result.w2[3] + result.w2[4]))
    assert result.area(4, 4) == 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_the_convention_is_linear_and_single_modes_agree(seed):
    rng = np.random.default_rng(seed)
    modes, x0 = ModeSet(random_modes(rng, 3, 3), dt=0.5), random_gaussian(rng, 3)
    for i, cost in enumerate(single_mode_costs(modes, x0)):
        for steps in (1, 7):
            assert schedule(modes, x0, Constant(i), steps).cost == pytest.approx(cost, rel=1e-9)
    twice = Gaussian(np.sqrt(2) * x0.mean, 2 * x0.cov)
    sequence = rng.integers(0, 3, 9)
    assert Schedule(modes, twice, sequence).cost == pytest.approx(2 * Schedule(modes, x0, sequence).cost, rel=1e-9)


def test_a_schedule_is_its_moments_along_its_sequence():
    rng = np.random.default_rng(2)
    modes, x0 = ModeSet(random_modes(rng, 3, 2), dt=0.1), random_gaussian(rng, 3)
    result = Schedule(modes, x0, [0, 0, 1, 1, 1, 0])
    assert result.mean.shape == (3, 6)
    assert result.cov.shape == (6, 3, 3)
    mean, cov = x0.mean, x0.cov
    for k, mode in enumerate(result.sequence):
        np.testing.assert_allclose(result.mean[:, k], mean, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(result.cov[k], cov, rtol=1e-9, atol=1e-12)
        assert result.w2[k] == pytest.approx(mean @ mean + np.trace(cov))
        mean, cov = modes.A[mode] @ mean, modes.A[mode] @ cov @ modes.A[mode].T
    np.testing.assert_allclose(result.final.mean, mean)
    np.testing.assert_allclose(result.time, 0.1 * np.arange(6))
    assert [tuple(s) for s in result.switches] == [(2, 0, 1), (5, 1, 0)]
    assert result.dwell_times.tolist() == [2, 3, 1]
    assert Schedule(modes, x0, [1]).dwell_times.tolist() == [1]


def test_w2_is_the_mean_of_samples():
    rng = np.random.default_rng(3)
    modes, x0 = ModeSet(random_modes(rng, 3, 2)), random_gaussian(rng, 3)
    result = schedule(modes, x0, Rollout(), steps=10)
    x = rng.multivariate_normal(x0.mean, x0.cov, 200_000).T
    for k, mode in enumerate(result.sequence):
        squared = np.sum(x**2, axis=0)
        assert abs(squared.mean() - result.w2[k]) <= 5 * squared.std() / np.sqrt(200_000)
        x = modes.A[mode] @ x


def test_arrays_are_read_only(pair):
    result = schedule(*pair, Rollout())
    for array in (result.sequence, result.w2, result.mean, result.cov):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_schedule_ends_and_says_why(pair, monkeypatch):
    modes, x0 = pair
    result = schedule(modes, x0, Rollout())
    assert result.status == "converged"
    assert result.final.w2() <= 1e-12 * result.w2[0] < result.w2[-1]
    assert schedule(modes, x0, Rollout(), steps=3).status == "number of steps reached"
    unstable = ModeSet([[[1.1]]])
    diverged = schedule(unstable, Gaussian([1.0], [[0.0]]), Constant(0))
    assert diverged.status == "diverged"
    assert diverged.cost == math.inf
    monkeypatch.setattr(switchctl.methods.prediction, "CEILING", 7)
    assert (len(schedule(modes, x0, Rollout())), schedule(modes, x0, Rollout()).status) == (
        7,
        "ceiling of steps reached",
    )


def test_a_state_at_the_target_stays_there(pair):
    result = schedule(pair[0], Gaussian([0.0, 0.0], np.zeros((2, 2))), PointwiseMinimum())
    assert (len(result), result.cost, result.status) == (1, 0.0, "converged")
    assert compare(pair[0], result.x0, Rollout()).rows()[0]["ratio"] is None


def test_a_nilpotent_mode_reaches_the_target_exactly():
    modes = ModeSet([[[0.0, 1.0], [0.0, 0.0]], [[0.9, 0.0], [0.0, 0.9]]])
    result = schedule(modes, Gaussian([1.0, 1.0], np.eye(2)), Rollout(), steps=6)
    assert result.w2[2:].tolist() == [0.0] * 4
    assert result.cost == pytest.approx(4 + 2)


def test_moments_leave_the_range():
    with pytest.raises(ValueError, match="W2 exceeds the floating-point range after step 36"):
        schedule(ModeSet([[[1e4, 0.0], [0.0, 1e4]]]), Gaussian([1e10, 0.0], np.eye(2)), Constant(0), steps=100)


def test_ctrl_c_returns_the_steps_so_far(pair):
    class Interrupted(switchctl.Method):
        def start(self, modes):
            scheduler = Rollout().start(modes)
            decide, calls = scheduler.decide, iter(range(100))

            def interrupted(S):
                if next(calls) == 5:
                    raise KeyboardInterrupt
                return decide(S)

            scheduler.decide = interrupted
            return scheduler

    result = schedule(*pair, Interrupted())
    assert (len(result), result.status) == (5, "interrupted")
    assert result.sequence.tolist() == schedule(*pair, Rollout(), steps=5).sequence.tolist()


def interrupting(j):
    if j == 4:
        raise KeyboardInterrupt
    return 20


def test_ctrl_c_in_a_sweep_keeps_what_is_done_and_stops(pair):
    result = sweep(*pair, [1, interrupting, 20], [1, 2])
    assert np.isnan(result.cost).tolist() == [[False, False], [True, True], [True, True]]
    assert "nan" in repr(result)
    with pytest.raises(KeyboardInterrupt):
        sweep(*pair, [interrupting], [1])


def test_ctrl_c_in_a_comparison_keeps_what_is_done_and_stops(pair):
    methods = {"first": Rollout(), "second": RecedingHorizon(interrupting), "third": Rollout()}
    result = compare(*pair, methods)
    assert list(result.schedules) == ["first", "second (interrupted)"]
    assert len(result.schedules["second (interrupted)"]) == 4


def test_comparison_has_every_single_mode(pair):
    modes, x0 = pair
    result = compare(modes, x0, [Rollout(), RecedingHorizon(20)])
    labels = [row["label"] for row in result.rows()]
    assert labels == ["fast", "calm", "Rollout()", "RecedingHorizon(horizon=20)"]
    assert result.rows()[1]["ratio"] == 1.0
    np.testing.assert_allclose([row["cost"] for row in result.rows()[:2]], single_mode_costs(modes, x0))
    assert list(compare(modes, x0, Rollout()).schedules) == ["Rollout()"]
    assert ">Rollout()</td>" in result._repr_html_()


def test_sweep_is_the_table_of_single_runs(pair):
    result = sweep(*pair, [2, math.inf], [1, 4])
    for i, T in enumerate((2, math.inf)):
        for j, hold in enumerate((1, 4)):
            assert result.cost[i, j] == schedule(*pair, RecedingHorizon(T, hold)).cost
    np.testing.assert_allclose(result.relative, result.cost / single_mode_costs(*pair).min())
    assert "hold 4" in result._repr_html_()


def test_an_explicit_sequence_may_leave_the_range():
    result = Schedule(ModeSet([[[10.0]]]), Gaussian([1.0], [[0.0]]), [0] * 400)
    with pytest.raises(FloatingPointError, match="after step 154"):
        result.w2  # noqa: B018
    assert "W2        not available" in repr(result)


def test_wrong_arguments(pair):
    modes, x0 = pair
    for call, error, words in (
        (lambda: schedule(modes, x0, "rollout"), TypeError, "must be a Method"),
        (lambda: schedule(modes, x0, Rollout), TypeError, "must be a Method"),
        (lambda: schedule(modes.A, x0, Rollout()), TypeError, "must be a ModeSet"),
        (lambda: schedule(modes, [1.0, 1.0], Rollout()), TypeError, "must be a Gaussian, not a list"),
        (lambda: schedule(modes, Gaussian([1.0], [[1.0]]), Rollout()), ValueError, "the modes have 2 states"),
        (lambda: schedule(modes, x0, Rollout(), steps=0), ValueError, "steps is 0"),
        (lambda: schedule(modes, x0, Rollout(), steps=2.5), ValueError, "steps is 2.5"),
        (lambda: schedule(modes, x0, Rollout(), steps="9"), TypeError, "'9'"),
        (lambda: schedule(modes, x0, Rollout(), horizon=3), TypeError, "horizon"),
        (lambda: compare(modes, x0, []), ValueError, "methods is empty"),
        (lambda: compare(modes, x0, {"fast": Rollout()}), ValueError, "name of a mode"),
        (lambda: compare(modes, x0, [Rollout(), Rollout()]), ValueError, r"two that read Rollout\(\)"),
        (lambda: sweep(modes, x0, 50, [1]), TypeError, "horizons must be a sequence"),
        (lambda: Schedule(modes, x0, [0]).save("/nowhere/s.json"), FileNotFoundError, "no folder '/nowhere'"),
        (lambda: compare(modes, x0, ["rollout"]), TypeError, "must be a Method"),
        (lambda: compare(modes, x0, {1: Rollout()}), TypeError, "labels are strings"),
        (lambda: compare("modes", x0, Rollout()), TypeError, "must be a ModeSet"),
        (lambda: sweep("modes", x0, [5], [1]), TypeError, "must be a ModeSet"),
        (lambda: single_mode_costs(modes, Gaussian([1.0], [[1.0]])), ValueError, "the modes have 2 states"),
        (
            lambda: best_single_mode(modes, Gaussian(np.ones((3, 2)), np.zeros((3, 2, 2)))),
            ValueError,
            r"expected \(2,\)",
        ),
        (lambda: x0.w2([[1.0], [2.0]]), ValueError, r"target has shape \(2, 1\)"),
        (lambda: sweep(modes, x0, [], [1]), ValueError, "at least one"),
        (lambda: sweep(modes, x0, [5], [0]), ValueError, "hold is 0"),
        (lambda: Schedule(modes, x0, []), ValueError, "sequence is empty"),
        (lambda: Schedule(modes, x0, [0, 2]), IndexError, "mode 2 is out of range"),
        (lambda: Schedule(modes, x0, [0, 0.5]), TypeError, "index or its name"),
        (lambda: Schedule(modes, x0, [0]).area(0, 5), ValueError, "0 <= start <= stop <= 1"),
        (lambda: Schedule(modes, x0, [0]).area(-1), ValueError, "start is -1"),
    ):
        with pytest.raises(error, match=words):
            call()


def test_names_are_good_for_a_sequence(pair):
    assert Schedule(*pair, ["calm", "fast"]).sequence.tolist() == [1, 0]


def test_a_sweep_takes_any_iterable(pair):
    result = sweep(*pair, (T for T in (1, 5)), range(1, 3))
    assert result.cost.shape == (2, 2)
    assert (result.horizons, result.holds) == ((1, 5), (1, 2))


def test_what_a_method_decides_is_checked(pair):
    class Wrong(switchctl.Method):
        def __init__(self, answer):
            self.answer = answer

        def start(self, modes):
            answer = self.answer

            class Scheduler(switchctl.Scheduler):
                def decide(self, S):
                    return answer

            return Scheduler(modes)

    for answer, error in ((7, IndexError), (0.5, TypeError), (None, TypeError)):
        with pytest.raises(error, match="mode"):
            schedule(*pair, Wrong(answer))
        with pytest.raises(error, match="mode"):
            Wrong(answer).start(pair[0]).step([1.0, 1.0])
    assert schedule(*pair, Wrong("calm"), steps=2).sequence.tolist() == [1, 1]


def test_what_a_schedule_says_of_itself(pair):
    modes, x0 = pair
    told = repr(Schedule(modes, x0, [0, 1, 0, 1, 0, 1], tail=(0, 1)))
    assert "fast calm repeated" in told and "6 steps (0.6 s)" in told
    assert "calm -> fast at step 2, fast -> calm at step 3, .. 2 more" in told
    assert repr(Schedule(ModeSet(modes.A), x0, [1])).startswith("Schedule: 1 step\n")
    assert "A1 held" in repr(Schedule(ModeSet(modes.A), x0, [1]))
    with pytest.raises(TypeError, match="must be a ModeSet"):
        Schedule(modes.A, x0, [1])


def test_the_limits_are_those_documented(pair):
    assert (switchctl.methods.prediction.CEILING, switchctl.methods.prediction.CONVERGED) == (100_000, 1e-12)
    diverged = schedule(ModeSet([[[1.1]]]), Gaussian([1.0], [[0.0]]), Constant(0))
    assert diverged.w2[-1] < 1e12 <= diverged.final.w2()


def test_a_comparison_of_unstable_modes_and_of_peaks():
    modes = ModeSet([[[1.1, 0.0], [0.0, 0.5]], [[0.5, 0.0], [0.0, 1.1]]])
    result = compare(
        modes, Gaussian([1.0, 1.0], np.zeros((2, 2))), {"short": Constant(0), "long": PointwiseMinimum()}, 9
    )
    assert [row["ratio"] for row in result.rows()] == [None] * 4
    assert result.rows()[2]["peak"] == result.schedules["short"].w2.max() > 2
    assert "inf" in repr(result)
    stable = ModeSet([[[0.5]], [[1.1]]])
    uneven = compare(stable, Gaussian([1.0], [[0.0]]), {"a": Constant(0), "b": Constant(1)})
    assert uneven.steps == max(map(len, uneven.schedules.values())) > min(map(len, uneven.schedules.values()))
    assert "%" not in repr(uneven).splitlines()[3]  # an infinite cost has no ratio


def test_a_sweep_passes_its_settings_on(pair):
    held, cut = sweep(*pair, [5], [2], decrease=0.9).cost[0, 0], sweep(*pair, [5], [2], steps=3).cost[0, 0]
    plain = schedule(*pair, RecedingHorizon(5, 2)).cost
    assert held == schedule(*pair, RecedingHorizon(5, 2, 0.9)).cost != plain
    assert cut == schedule(*pair, RecedingHorizon(5, 2), steps=3).cost != plain


def test_a_run_down_to_the_last_bits_is_told_saved_and_scheduled_online(tmp_path):
    A = np.array([[-0.2, -0.2], [-0.2, 0.1]])
    modes, x0 = ModeSet([A, 1.01 * A]), Gaussian([1.0, 1.0], [[1.0, 0.3], [0.3, 0.5]])
    whole = schedule(modes, x0, Constant(0))
    for steps in range(298, 312):
        long = schedule(modes, x0, Constant(0), steps)
        assert long.cost == pytest.approx(whole.cost)
        assert np.linalg.norm(long.final.cov) < 1e-307
        assert repr(Schedule.load(long.save(tmp_path / "s.json"))) == repr(long)
    for method in (Rollout(), PointwiseMinimum(), RecedingHorizon(3)):
        scheduler, mean, cov = method.start(modes), np.ones(2), np.eye(2)
        for _ in range(400):
            chosen = modes.A[scheduler.step(mean, cov)]
            mean, cov = chosen @ mean, chosen @ cov @ chosen.T
