"""Noise of whatever size: the filter's gain and what is sampled know no units."""

import control
import numpy as np
import pytest

from switchctl import Gaussian, close_loops, single_mode_costs
from switchctl.estimation import filter_gain
from switchctl.sampling import sampled_noise


def oscillator(C):
    return control.ss([[0, 1], [-4, -1]], [[0], [1]], C, 0)


@pytest.mark.parametrize(
    ("V", "W"), [(1e-2, 1.0), (1e-12, 1e-12), (1e-14, 1e-16), (1e-18, 1e-12), (1e-18, 1.0), (1e6, 1e-3)]
)
def test_the_kalman_gain_is_that_of_the_riccati_recursion(V, W):
    """Whatever the covariances' size: in metres a sensor of nanometres has 1e-18."""
    modes = close_loops(oscillator([[1, 0]]), [[[20.0, 5.0]]], 0.02, W=np.diag([0, W]), V=[[V]], estimator="kalman")
    A, C, noise = modes.plant.A, modes.plant.C, modes.process_noise[0] / W
    P = noise
    for _ in range(20_000):
        gain = A @ P @ C.T / (C @ P @ C.T + V / W)
        P = A @ P @ A.T + noise - gain @ C @ P @ A.T
    np.testing.assert_allclose(modes.error_covariance, W * P, rtol=1e-9, atol=1e-11 * W * P.max())


@pytest.mark.parametrize("unit", [2.0**-300, 2.0**-60, 2.0**100, 2.0**300])
def test_the_unit_of_the_noise_changes_nothing(unit):
    def loops(unit):
        return close_loops(
            oscillator([[1, 0], [1, 1]]),
            {"stiff": [[20.0, 5.0]], "soft": [[1.0, 1.7]]},
            0.02,
            W=np.diag([0.2, 1.0]) * unit,
            V=np.array([[0.5, 0.1], [0.1, 0.04]]) * unit,
            estimator="kalman",
            cost="average",
        )

    one, other = loops(1.0), loops(unit)
    np.testing.assert_allclose(other.A, one.A, rtol=1e-9, atol=1e-12)
    for name in ("W", "error_covariance"):
        np.testing.assert_allclose(getattr(other, name) / unit, getattr(one, name), rtol=1e-9, atol=1e-15)
    still = Gaussian([0.0, 0.0], np.zeros((2, 2)))
    np.testing.assert_allclose(single_mode_costs(other, still) / unit, single_mode_costs(one, still), rtol=1e-9)


@pytest.mark.parametrize("powers", [0, 3, 6, 9])
def test_the_units_of_states_and_outputs_change_no_filter(powers):
    rng = np.random.default_rng(powers)
    for _ in range(25):
        n, p = rng.integers(1, 8), rng.integers(1, 3)
        A, C, W, V = (rng.standard_normal(shape) for shape in ((n, n), (p, n), (n, n), (p, p)))
        A *= rng.choice([0.9, 1.0, 1.3]) / np.abs(np.linalg.eigvals(A)).max()
        W, V = W @ W.T, V @ V.T + 0.1 * np.eye(p)
        x, y = 10.0 ** rng.uniform(-powers, powers, n), 10.0 ** rng.uniform(-powers, powers, p)
        plant = control.ss(A * x[:, None] / x, np.zeros((n, 1)), C * y[:, None] / x, 0, dt=True)
        L = filter_gain(plant, "kalman", (W * np.outer(x, x))[None], V * np.outer(y, y))
        P = np.eye(n)
        for _ in range(3000):
            gain = np.linalg.solve(C @ P @ C.T + V, C @ P @ A.T).T
            P = A @ P @ A.T + W - gain @ C @ P @ A.T
            P = (P + P.T) / 2
        np.testing.assert_allclose(L / x[:, None] * y, gain, rtol=1e-6, atol=1e-9 * np.abs(gain).max())


@pytest.mark.parametrize(("unit", "dt"), [(1e100, 1e-6), (1e60, 1e-2), (1e-200, 1e-2)])
def test_sampled_noise_is_linear_in_its_intensity(unit, dt):
    A, W = np.array([[0.0, 1.0], [-4.0, -1.0]]), np.diag([0.0, 1.0])
    np.testing.assert_allclose(sampled_noise(A, W * unit, dt) / unit, sampled_noise(A, W, dt), rtol=1e-13)


def test_sampled_noise_knows_no_units_of_the_states():
    rng = np.random.default_rng(1)
    for _ in range(100):
        n = rng.integers(1, 7)
        A, W, x = rng.standard_normal((n, n)), rng.standard_normal((n, n)), 10.0 ** rng.uniform(-9, 9, n)
        W = W @ W.T
        other = sampled_noise(A * x[:, None] / x, W * np.outer(x, x), 0.1) / np.outer(x, x)
        one = sampled_noise(A, W, 0.1)
        size = np.sqrt(np.outer(np.diag(one), np.diag(one)))
        np.testing.assert_allclose(other / size, one / size, atol=1e-12)
