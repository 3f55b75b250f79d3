"""Online for a long time: no drift from a fresh scheduler, the rules or brute force, and no memory that grows."""

import runpy
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from switchctl import Gaussian, ModeSet, RecedingHorizon, Rollout, Rules, SwitchingGraph, monte_carlo, schedule

LONG = runpy.run_path(str(Path(__file__).parent.parent / "benchmarks" / "long_run.py"))
BLOCKS = 2_000  # that the interpreter may hold more at the end: tables of places met late


@pytest.mark.parametrize(
    ("name", "steps"),
    [
        *[(name, 25_000) for name in ("rollout", "pointwise", "receding")],
        ("limited", 10_000),
        *[pytest.param(name, 100_000, marks=pytest.mark.slow) for name in LONG["METHODS"]],
    ],
)
def test_nothing_drifts(name, steps):
    """The run itself raises where a mode, a memory or a cost is not what it should be."""
    found = LONG["run"](name, steps, checks=4, early=steps // 2)
    assert found["steps"] == steps and found["compared"] == 75
    (blocks, _, _), (later, _, _) = found["held"]
    assert later - blocks < BLOCKS
    assert found["switches"] == 201 if name == "limited" else found["switches"] > 0.2 * steps


def test_the_run_would_notice():
    """A scheduler that loses its place breaks a rule."""
    started = LONG["started"](*LONG["METHODS"]["pointwise"])
    watch, x = LONG["Watch"]("periodic"), np.array([3.0, -2.0, 1.0])
    with pytest.raises(ArithmeticError, match="against"):
        for k in range(500):
            if k % 50 == 49:
                started.node = 0
            mode = started.step(x)
            watch.see(mode)
            x = LONG["A"][mode] @ x + np.sin(k)


def test_a_period_in_seconds_is_whole_steps_for_ever():
    """k dt in floating point would name another step of the period long before the ten millionth."""
    modes = ModeSet([[[0.5]], [[0.9]]], dt=0.01)
    graph = SwitchingGraph(modes, Rules(allowed={"A0": [(0.0, 0.04)]}, allowed_period=0.07, time_unit="s"))
    scheduler, wrong, S = Rollout().start(graph), 0, np.eye(1)
    for start in (0, 10**7):
        node = 0
        for _ in range(start % 7):
            node = int(graph.successor[node, 1])
        for k in range(start, start + 70):
            there = Fraction(k, 100) % Fraction(7, 100) < Fraction(4, 100)
            assert (graph.successor[node, 0] >= 0) == there
            scheduler.node = node
            assert scheduler.decide(S) == (0 if there else 1)
            node = int(graph.successor[node, 1])
            wrong += (k * 0.01 % 0.07 + 0.01 <= 0.04) != there
    assert wrong > 0


def test_counters_count_on():
    """An update far beyond any run, and a memory that holds it to the unit."""
    modes = ModeSet([[[0.5, 1.0], [0.0, 0.5]], [[0.9, 0.0], [0.0, 0.4]]])
    scheduler = RecedingHorizon(lambda j: 1 + j % 3, hold=2).start(modes)
    memory = scheduler.memory
    memory[2] = 3 * 10**15
    scheduler.memory = memory
    for k in range(1, 20):
        scheduler.step([1.0, k])
        assert scheduler.memory[2] == 3 * 10**15 + (k + 1) // 2


@pytest.mark.parametrize("steps", [20_000, pytest.param(50_000, marks=pytest.mark.slow)])
def test_a_long_noisy_schedule_stays_at_its_stationary_value(steps):
    """Of the mode it ends in; with no symmetry lost and no covariance below zero."""
    A, W = np.array([[[0.9, 0.5], [-0.2, 0.7]], [[0.6, 0.0], [0.4, 0.8]]]), np.array([[0.1, 0.02], [0.02, 0.05]])
    modes = ModeSet(A, W=W, cost=("discounted", 0.99))
    found = schedule(modes, Gaussian([3.0, 1.0], np.eye(2)), RecedingHorizon(5), steps)
    assert len(found) == steps
    S = np.outer([3.0, 1.0], [3.0, 1.0]) + np.eye(2)
    for mode in found.sequence[-2000:]:  # whatever it began with is forgotten
        S = A[mode] @ S @ A[mode].T + W
    np.testing.assert_allclose(found.final.second_moment, S, rtol=1e-9)
    cov = found.final.cov
    np.testing.assert_array_equal(cov, cov.T)
    assert np.linalg.eigvalsh(cov)[0] > 0
    half = found.w2[steps // 2 :]
    np.testing.assert_allclose(half[len(half) // 2 :].max(), half[: len(half) // 2].max(), rtol=1e-9)
    if steps <= 20_000:
        assert monte_carlo(found, 64, steps=2000, seed=1).inside.min() > 0.95
