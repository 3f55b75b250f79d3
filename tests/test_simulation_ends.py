"""Runs that end before their last step: left domains, plants that fail, escapes, interruptions."""

import re

import control
import numpy as np
import pytest
from plants import DT, linear, quadrotor_rate
from scipy.integrate import solve_ivp

from switchctl import Constant, Gaussian, Rollout, close_loops, monte_carlo, schedule, simulate
from switchctl.models import quadrotor


def clear(x):
    """Whether the pitch is clear of a right angle, where the Euler angles are singular."""
    return np.cos(x[1]) - 0.15


def test_a_run_that_leaves_its_domain_stops_there():
    modes, x0 = quadrotor.modes(), np.array([0.5, -1.3, -5.0, 0.1, -7.8, 0.1])
    plant = quadrotor.nonlinear_plant()
    planned = schedule(modes, Gaussian(x0, np.zeros((6, 6))), Constant("low"), 100)
    run = simulate(plant, modes, planned, x0, 100, domain=clear)
    assert run.status.startswith("left its domain at ")
    left = float(run.status.split()[4])
    k = len(run.t) - 1
    assert 0 < k < 100
    assert run.t[k] <= left < run.t[k] + 0.01
    assert len(run.sequence) == k + 1
    u = run.u[:, k]
    x = solve_ivp(lambda t, x: quadrotor_rate(x, u), (0, left - run.t[k]), run.x[:, k], rtol=1e-10, atol=1e-12)
    assert np.cos(x.y[1, -1]) == pytest.approx(0.15, abs=1e-4)
    assert not run.success
    outside = simulate(plant, modes, planned, x0, 100, domain=lambda x: np.nan)
    assert outside.status == "left its domain at 0 s: domain(x) is not positive"
    assert outside.x.shape == (6, 1)
    assert len(outside.sequence) == 0


def test_a_sampled_run_stops_at_the_first_sample_outside():
    modes = close_loops(linear().sample(DT), {"gain": [[2.0, 1.0]]})
    run = simulate(modes.plant, modes, Constant(0), [1, 0], 50, domain=lambda x: x[0])
    inside = run.x[0, :-1]
    assert (inside > 0).all()
    assert run.x[0, -1] <= 0
    assert run.status == f"left its domain at {run.t[-1]:.6g} s: domain(x) is not positive"


def root_plant(failure):
    """x' = -1 + u, defined while x > 0."""

    def rate(t, x, u, params):
        if x[0] <= 0:
            failure()
        return [-np.sqrt(x[0]) - 0.5 + u[0]]

    return control.nlsys(rate, inputs=1, states=1, outputs=1)


def raising():
    raise ZeroDivisionError("no root")


def interrupting():
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (raising, "stopped at (.*) s: the plant's derivative raised ZeroDivisionError: no root"),
        (lambda: None, "left its domain at (.*) s: the plant's derivative is not finite"),
        (interrupting, "interrupted"),
    ],
)
def test_a_plant_that_fails_ends_the_run_with_what_there_is(failure, words):
    modes = close_loops(control.ss(-1, 1, 1, 0), {"off": [[0.0]]}, 0.1)
    run = simulate(root_plant(failure), modes, Constant(0), [1.0], 100)
    told = re.fullmatch(words, run.status)
    # sqrt(x) + ln(1 + 2 sqrt(x)) terms: x' = -sqrt(x) - 1/2 reaches zero at 2 - ln 3
    end = 2 - np.log(3)
    if failure is not interrupting:
        assert float(told[1]) == pytest.approx(end, abs=1e-3)
    assert len(run.t) == int(end / 0.1) + 1
    assert np.isfinite(run.x).all()
    assert (run.x > 0).all()


def mistaken(t, x, u, params):
    return [np.sn(x[0]) + u[0]]


def late(t, x, u, params):
    return [x[0] - u[1] if t > 0.35 else -x[0] + u[0]]


@pytest.mark.parametrize("dt", [0, 0.1])
def test_what_is_written_wrongly_is_raised_and_not_taken_for_the_end_of_a_domain(dt):
    modes = close_loops(control.ss(-1, 1, 1, 0).sample(0.1), {"off": [[0.0]]})
    planned = schedule(modes, Gaussian([1.0], [[0.1]]), Constant(0), 10)
    plant = control.nlsys(mistaken, inputs=1, states=1, outputs=1, dt=dt)
    for call in (
        lambda: simulate(plant, modes, planned, [1.0], 10),
        lambda: monte_carlo(planned, 10, plant=plant),
        lambda: simulate(
            control.nlsys(lambda t, x, u, p: -x, mistaken, inputs=1, states=1, outputs=1, dt=dt),
            *(
                close_loops(control.ss(-1, 1, 1, 0).sample(0.1), {"out": control.ss([], [], [], 1)}),
                Constant(0),
                [1.0],
                10,
            ),
        ),
    ):
        with pytest.raises(AttributeError, match="no attribute 'sn'") as error:
            call()
        assert "in the plant's" in error.value.__notes__[0] and "at t = 0 and x = [" in error.value.__notes__[0]
    run = simulate(control.nlsys(late, inputs=1, states=1, outputs=1, dt=dt), modes, planned, [1.0], 10)
    assert len(run.t) == 4 + (dt > 0) and "IndexError" in run.status  # what was computed is not lost


def test_an_interruption_before_anything_is_not_swallowed():
    modes = close_loops(control.ss(-1, 1, 1, 0), {"off": [[0.0]]}, 0.1)

    def output(t, x, u, params):
        raise KeyboardInterrupt

    plant = control.nlsys(lambda t, x, u, p: -x, output, inputs=1, outputs=1, states=1)
    with pytest.raises(KeyboardInterrupt):
        simulate(plant, modes, Constant(0), [1.0], 5)


def test_an_output_that_fails_and_nan_never_choose():
    modes = close_loops(linear(), {"lead": control.tf([4, 4], [1, 8]), "gain": [[2.0, 1.0]]}, DT)
    plant = control.nlsys(
        lambda t, x, u, p: linear().A @ x + linear().B @ u,
        lambda t, x, u, p: [x[0] + 0.3 * x[1] if t < 1.05 else np.nan],
        inputs=1,
        outputs=1,
        states=2,
    )
    with pytest.raises(ValueError, match="at operating_point"):
        simulate(
            control.nlsys(plant.updfcn, lambda t, x, u, p: [np.nan], inputs=1, outputs=1, states=2),
            modes,
            Rollout(),
            [1, 0],
            20,
        )
    run = simulate(plant, modes, Rollout(), [1, 0], 20)
    assert "not finite" in run.status
    assert len(run.sequence) == 11
    assert len(run.t) == 12
    assert np.isfinite(run.x).all()
    assert np.isnan(run.y[0, -1])
    assert np.isfinite(run.u).all()


def test_a_run_that_escapes_in_finite_time_stops():
    modes = close_loops(control.ss(-1, 1, 1, 0), {"off": [[0.0]]}, 0.1)
    plant = control.nlsys(lambda t, x, u, p: x**2 + u, inputs=1, states=1, outputs=1)
    run = simulate(plant, modes, Rollout(), [0.95], 100)
    assert float(run.status.split(" at ")[1].split()[0]) == pytest.approx(1 / 0.95, abs=1e-5)
    assert len(run.t) == 11
    sampled = control.nlsys(lambda t, x, u, p: 10 * x**3, inputs=1, states=1, outputs=1, dt=0.1)
    run = simulate(sampled, modes, Rollout(), [2.0], 100)
    assert run.status != "completed"
    assert np.isfinite(run.x).all()
