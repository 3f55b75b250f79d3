"""Every bundled model offers the same functions, and its method is worth showing."""

import importlib

import numpy as np
import pytest

import switchctl
from switchctl import models


@pytest.mark.parametrize("name", models.NAMES)
def test_a_model_offers_what_it_should(name):
    module = importlib.import_module(f"switchctl.models.{name}")
    modes, x0, method = module.modes(), module.initial_state(), module.method()
    assert set(module.controllers()) == set(modes.names)
    plant = module.plant()
    assert plant is None or plant.nstates == modes.A.shape[-1]
    assert modes.schur.all() or (name == "medium_access" and not modes.schur.any())
    result = switchctl.schedule(modes, x0, method, rules=module.rules() if hasattr(module, "rules") else None)
    assert result.status == "converged"
    assert np.isfinite(result.cost)
    assert result.cost < 0.93 * switchctl.single_mode_costs(modes, x0).min()


def test_every_module_is_listed():
    from pathlib import Path

    files = {path.stem for path in Path(models.__file__).parent.glob("*.py")} - {"__init__"}
    assert files == set(models.NAMES)


def test_suspension_weighs_acceleration_and_deflection():
    from switchctl.models import suspension

    modes, x = suspension.modes(), np.array([0.01, -0.2, 0.005, 0.3])
    plant = suspension.plant()
    for mode, c in zip(modes, suspension.SETTINGS.values(), strict=True):
        force = -c * (x[1] - x[3])
        acceleration = (plant.A @ x + plant.B[:, 0] * force)[1]
        assert x @ mode.Q @ x == pytest.approx(acceleration**2 + (x[2] / 0.02) ** 2)


def test_servo_runs_at_the_speed_that_its_back_emf_allows():
    from switchctl.models import servo

    plant = servo.plant()
    speed = -plant.B[1, 0] / plant.A[1, 1]  # steady, per volt: K / (b R + K^2)
    assert speed == pytest.approx(0.0274 / (3.5077e-6 * 4 + 0.0274**2))
    for name, ratio in servo.DAMPING.items():
        poles = np.linalg.eigvals(plant.A - plant.B @ servo.controllers()[name])
        assert abs(poles[0]) == pytest.approx(servo.BANDWIDTH)
        assert -poles[0].real / abs(poles[0]) == pytest.approx(ratio, rel=1e-6)


def test_suspension_obeys_newton():
    from switchctl.models import suspension

    body, body_speed, wheel, wheel_speed = x = np.array([0.02, -0.4, 0.01, 0.7])
    spring, force = 80_000 * (body - wheel), 300.0
    tyre = 500_000 * wheel + 15_020 * wheel_speed
    rate = suspension.plant().A @ x + suspension.plant().B[:, 0] * force
    expected = [body_speed, (force - spring) / 2500, wheel_speed, (spring - force - tyre) / 320]
    np.testing.assert_allclose(rate, expected)


def test_quadrotor_obeys_euler():
    """Body rates by M = I w' + w x (I w) with the rotors' momentum, attitude by the derivative of the rotation."""
    from switchctl.models import quadrotor

    rng = np.random.default_rng(1)
    inertia = np.diag([quadrotor.PARAMETERS[name] for name in ("Ixx", "Iyy", "Izz")])
    for _ in range(20):
        x, moments = rng.uniform(-1, 1, 6), rng.uniform(-0.02, 0.02, 3)
        phi, theta, _ = x[:3]
        w = x[3:]
        rate = quadrotor.nonlinear_plant().dynamics(0, x, moments)
        speeds = quadrotor.rotor_speeds(moments)
        residual = speeds @ [-1, 1, -1, 1]  # of the rotors' speeds, about the body's z axis
        rotors = -np.cross(w, [0, 0, -quadrotor.PARAMETERS["Jr"] * residual])
        expected = np.linalg.solve(inertia, moments - np.cross(w, inertia @ w) + rotors)
        np.testing.assert_allclose(rate[3:], expected, rtol=1e-9)
        to_rates = np.array(  # body rates from the rates of roll, pitch and yaw, in that order of rotation
            [
                [1, 0, -np.sin(theta)],
                [0, np.cos(phi), np.sin(phi) * np.cos(theta)],
                [0, -np.sin(phi), np.cos(phi) * np.cos(theta)],
            ]
        )
        np.testing.assert_allclose(to_rates @ rate[:3], w, rtol=1e-9, atol=1e-12)
    assert (quadrotor.rotor_speeds(np.array([5.0, 0.0, 0.0])) >= 0).all()
