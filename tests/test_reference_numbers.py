"""The numbers of the paper and of the reference designs, as they are given."""

import math

import control
import numpy as np
import pytest

from switchctl import (
    Constant,
    PointwiseMinimum,
    RecedingHorizon,
    Rollout,
    Schedule,
    schedule,
    single_mode_costs,
    sweep,
)
from switchctl.models import quadrotor as model


def test_example_1_single_modes(example):
    modes, x0 = example
    assert x0.w2() == 54.5
    np.testing.assert_allclose(modes.spectral_radii, [0.9725, 0.7795, 0.7200, 0.9277, 0.8180], atol=5e-5)
    np.testing.assert_allclose(np.round(modes.spectral_radii, 2), [0.97, 0.78, 0.72, 0.93, 0.82])  # as the paper prints
    costs = single_mode_costs(modes, x0)
    np.testing.assert_allclose(costs, [475.68312, 136.76131, 198.25327, 149.13475, 818.47713], atol=5e-6)


def test_example_1_pointwise_minimum_is_the_word_a1_a2_a5(example):
    modes, x0 = example
    result = schedule(modes, x0, PointwiseMinimum())
    assert result.cost == pytest.approx(77.774, abs=5e-4)
    assert result.sequence[:12].tolist() == [0, 1, 4] * 4
    assert Schedule(modes, x0, [0], (1, 4, 0)).cost == pytest.approx(77.77369815, abs=5e-9)


@pytest.mark.parametrize(
    ("horizon", "hold", "cost"),
    [(2, 1, 86.0727), (5, 1, 86.7775), (10, 1, 86.6188), (50, 1, 97.2958), (5, 5, 117.760), (10, 10, 134.007)],
)
def test_example_1_receding_horizon(example, horizon, hold, cost):
    assert schedule(*example, RecedingHorizon(horizon, hold)).cost == pytest.approx(
        cost, abs=5e-5 if hold == 1 else 5e-4
    )


def test_example_1_rollout(example):
    assert schedule(*example, Rollout()).cost == pytest.approx(77.77672, abs=5e-6)


def test_example_1_ratio_as_the_paper_counts(example):
    """About 3.5 times less area than A2, when W2(0), which no schedule can change, is left out."""
    modes, x0 = example
    alone, switched = (schedule(modes, x0, method).cost for method in (Constant("A2"), PointwiseMinimum()))
    assert (alone - x0.w2()) / (switched - x0.w2()) == pytest.approx(3.53, abs=5e-3)
    assert alone / switched == pytest.approx(1.758, abs=5e-4)


def test_quadrotor_plant_is_three_double_integrators():
    plant = model.plant()
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    np.testing.assert_array_equal(plant.A, A)
    np.testing.assert_allclose(plant.B[3:], np.diag([1 / 7.5e-3, 1 / 7.5e-3, 1 / 1.3e-2]), rtol=1e-6)


def test_quadrotor_equations_turn_moments_into_rotor_speeds_and_back():
    moments, plant = np.array([0.02, -0.03, 0.01]), model.nonlinear_plant()
    rate = plant.dynamics(0, np.zeros(6), moments)[3:]
    np.testing.assert_allclose(rate, moments / [7.5e-3, 7.5e-3, 1.3e-2])
    hover = model.rotor_speeds(np.zeros(3))
    assert 4 * model.PARAMETERS["b"] * hover[0] ** 2 == pytest.approx(0.65 * 9.81)


def test_quadrotor_controllers_are_the_designs():
    high, low = model.high_gain(), model.low_gain()
    assert high[0, 0] == pytest.approx(2.0951, abs=5e-5)
    assert high[0, 3] == pytest.approx(0.18751, abs=5e-6)
    np.testing.assert_allclose([high[2, 2], high[2, 5]], [0.012159, 0.020182], atol=5e-7)
    plant = model.plant()
    poles = np.linalg.eigvals(plant.A - plant.B @ high)
    for pole in (-12.50 + 11.09j, -0.776 + 0.577j):
        assert np.abs(poles - pole).min() < 6e-3
    np.testing.assert_allclose(low[0, [0, 3]] / 7.5e-3, [10.962, 3.784], atol=5e-4)
    np.testing.assert_allclose(low[2, [2, 5]] / 1.3e-2, [0.346, 0.673], atol=5e-4)
    loop = model.lead_lag(4.5) * control.tf([1], [1, 0, 0])
    _, phase_margin, _, crossover = control.margin(loop)
    assert (phase_margin, crossover) == pytest.approx((57.2, 4.5), abs=0.05)


def test_quadrotor_design_a(quadrotor):
    modes, x0 = quadrotor
    assert x0.w2() == pytest.approx(27.695)
    high, low = (schedule(modes, x0, Constant(name)) for name in ("high", "low"))
    switched = schedule(modes, x0, model.method())
    assert [100 * s.cost for s in (high, low, switched)] == pytest.approx([5037.1, 5257.7, 4671.8], abs=0.05)
    assert high.cost == pytest.approx(50.3714, abs=5e-5)
    assert switched.cost == pytest.approx(46.7176, abs=5e-5)
    assert 1 - switched.cost / high.cost == pytest.approx(0.0725, abs=5e-5)
    for result, peak, step in ((high, 163.7, 6), (low, 32.6, 29), (switched, 40.2, None)):
        assert result.w2.max() == pytest.approx(peak, abs=0.05)
        assert step is None or result.w2.argmax() == step
    assert [tuple(s) for s in switched.switches] == [(50, 1, 0)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("horizon", "costs", "first"),
    [
        (100, [49.14, 48.60, 48.77, 51.12], [58, 60, 75, 200]),
        (130, [46.72, 46.72, 46.72, None], [49, 50, 50, None]),
        (150, [46.83, 46.72, 46.72, 46.72], [44, 50, 50, 50]),
        (200, [47.75, 47.03, 46.72, 46.72], [32, 40, 50, 50]),
        (300, [49.96, 49.40, 48.67, 46.72], [16, 20, 25, 50]),
        (500, [50.37] * 4, [None] * 4),
    ],
)
def test_quadrotor_horizon_and_hold(quadrotor, horizon, costs, first):
    for hold, cost, step in zip((1, 10, 25, 50), costs, first, strict=True):
        result = schedule(*quadrotor, RecedingHorizon(horizon, hold))
        assert cost is None or result.cost == pytest.approx(cost, abs=5e-3)
        assert step is None or result.switches[0].step == step
        assert horizon < 500 or set(result.sequence) == {0}


def test_quadrotor_short_horizons_are_worse_than_high_alone(quadrotor):
    assert (sweep(*quadrotor, [50, 75], [1, 50]).relative > 1).all()


def test_quadrotor_rollout_and_infinite_horizon(quadrotor):
    assert schedule(*quadrotor, Rollout()).cost == pytest.approx(45.648593, abs=5e-7)
    infinite = schedule(*quadrotor, RecedingHorizon(math.inf))
    assert set(infinite.sequence) == {0}
    assert infinite.cost == pytest.approx(50.37, abs=5e-3)


def test_quadrotor_two_switches(quadrotor):
    word = [0] + [1] * 26 + [0]
    assert Schedule(*quadrotor, word).cost == pytest.approx(45.66, abs=5e-3)


def test_quadrotor_with_the_plant_sampled_first():
    modes, x0 = model.modes(), model.initial_state()
    assert single_mode_costs(modes, x0)[0] == pytest.approx(51.25, abs=5e-3)
    by_instant = [Schedule(modes, x0, [1] * k + [0]).cost for k in range(1, 120)]
    assert np.argmin(by_instant) + 1 == 51
