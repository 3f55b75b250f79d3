"""Runs of plants: equal to the modes where these are exact, to independent integration where not."""

import copy

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from plants import DT, dynamic, linear, quadrotor_rate
from scipy.integrate import solve_ivp

from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    close_loops,
    schedule,
    simulate,
)
from switchctl.models import quadrotor
from switchctl.simulation.replay import lasting

INACTIVE = ["track", "reset", "hold", "run"]


def exact(modes, x, sequence):
    """The modes' own run from a state known exactly."""
    result = Schedule(modes, Gaussian(x, np.zeros((len(x), len(x)))), [*sequence, sequence[-1]])
    return result.mean


def random_sequence(modes, steps=60, seed=0):
    return np.random.default_rng(seed).integers(0, len(modes), steps).tolist()


@pytest.mark.parametrize("inactive", INACTIVE)
@pytest.mark.parametrize("D", [0.0, 0.4])
def test_a_linear_plant_runs_as_its_modes_do(inactive, D):
    plant = linear(D)
    modes = dynamic(plant, inactive)
    x, sequence = [1.0, -0.5], random_sequence(modes)
    run = simulate(plant, modes, Schedule(modes, Gaussian(x, np.zeros((2, 2))), sequence), x, 60)
    expected = exact(modes, x, sequence)
    np.testing.assert_allclose(run.x, expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_array_equal(run.sequence, sequence)
    np.testing.assert_allclose(run.w2, np.sum(expected[:2] ** 2, axis=0), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(run.t, DT * np.arange(61))
    u = run.u[0]
    np.testing.assert_allclose(run.y[0], plant.C[0] @ run.x[:2] + D * u, atol=1e-12)
    np.testing.assert_array_equal(run.y[1], [*sequence, sequence[-1]])
    before = [-1, *sequence[:-1]]
    for k, (j, i) in enumerate(zip(before, sequence, strict=True)):
        taken = modes.activation is None or j in (-1, i)
        z = run.x[:, k] if taken else modes.activation[j, i] @ run.x[:, k]
        assert u[k] == pytest.approx(-(modes.gains[i] @ z)[0], rel=1e-9, abs=1e-9)
    assert u[-1] == u[-2]
    assert run.status == "completed"
    assert run.success


def test_a_nonlinear_system_that_is_linear_runs_as_the_linear_one():
    for D in (0.0, 0.4):
        plant = linear(D)
        A, B, C = plant.A, plant.B, plant.C
        twin = control.nlsys(
            lambda t, x, u, p, A=A, B=B: A @ x + B @ u,
            lambda t, x, u, p, C=C, D=D: C @ x + D * u,
            inputs=1,
            outputs=1,
            states=2,
        )
        modes = dynamic(plant)
        x, sequence = [1.0, -0.5], random_sequence(modes)
        run = simulate(twin, modes, Schedule(modes, Gaussian(x, np.eye(2)), sequence), x, 60)
        np.testing.assert_allclose(run.x, exact(modes, x, sequence), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("D", [0.0, 0.4])
def test_a_sampled_plant_is_stepped(D):
    modes = dynamic(linear(D).sample(DT))
    x, sequence = [1.0, -0.5], random_sequence(modes)
    run = simulate(modes.plant, modes, Schedule(modes, Gaussian(x, np.eye(2)), sequence), x, 60)
    np.testing.assert_allclose(run.x, exact(modes, x, sequence), rtol=1e-12, atol=1e-12)
    without = close_loops(control.ss(linear().sample(DT), dt=True), {"k": [[1.0, 1.0]]})
    run = simulate(control.ss(linear().sample(DT), dt=True), without, Constant(0), x, 5)
    np.testing.assert_array_equal(run.t, np.arange(6))


@pytest.mark.parametrize("inactive", INACTIVE)
@pytest.mark.parametrize("D", [0.0, 0.4])
@pytest.mark.parametrize("limit", [np.inf, 0.3])
def test_a_delay_is_one_more_state(inactive, D, limit):
    """The plant's input w is a state: x+ = A x + B w, w+ = u(zeta, x, C x + D w)."""
    plant = linear(D)
    modes = dynamic(plant, inactive)
    sampled, c = plant.sample(DT), modes.controllers
    x, sequence = np.array([1.0, -0.5]), random_sequence(modes)
    zeta, w, before, expected, inputs = c.initial @ x, np.zeros(1), -1, [], []
    for mode in sequence:
        expected.append([*x, *zeta])
        inputs.append(w)
        begin = zeta if before in (-1, mode) else c.E[before, mode] @ zeta + c.Ex[before, mode] @ x
        y = sampled.C @ x + sampled.D @ w
        u = np.clip(-(c.Hz[mode] @ begin + c.Hx[mode] @ x + c.Hy[mode] @ y), -limit, limit)
        zeta = c.F[mode] @ begin + c.Gx[mode] @ x + c.Gy[mode] @ y + c.Gu[mode] @ u
        x, w, before = sampled.A @ x + sampled.B @ w, u, mode
    planned = Schedule(modes, Gaussian([1.0, -0.5], np.eye(2)), sequence)
    run = simulate(plant, modes, planned, [1, -0.5], 60, delay=True, saturation=(-limit, limit))
    scale = np.abs(expected).max()
    np.testing.assert_allclose(run.x[:, :-1].T, expected, rtol=1e-6, atol=1e-7 * scale)
    np.testing.assert_allclose(run.u[:, :-1].T, inputs, rtol=1e-6, atol=1e-7 * scale)


METHODS = [Rollout(), PointwiseMinimum(), RecedingHorizon(10, 3), FewSwitches(2), Refine(Rollout()), Constant(1)]


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("rules", [None, Rules(min_dwell=4, start=("lag", 2)), Rules(min_dwell=2, start=("lag", 5))])
def test_online_decisions_are_those_of_the_schedule(method, rules):
    plant = linear()
    modes = dynamic(plant, "reset")
    x = [1.0, -0.5]
    planned = schedule(modes, Gaussian(x, np.zeros((2, 2))), method, 40, rules)
    online = simulate(plant, modes, method, x, 40, rules=rules)
    replayed = simulate(plant, modes, planned, x, 40)
    np.testing.assert_array_equal(online.sequence, planned.sequence)
    np.testing.assert_array_equal(online.x, replayed.x)
    np.testing.assert_allclose(replayed.x[:, :-1], planned.mean, rtol=1e-6, atol=1e-8)
    graph = SwitchingGraph(modes, rules or Rules())
    np.testing.assert_array_equal(simulate(plant, modes, method, x, 40, rules=graph).sequence, planned.sequence)


@pytest.mark.parametrize("lead", [(), (2, 0, 0)])
def test_a_longer_schedule_is_the_same_run_for_ever(lead):
    modes = dynamic(linear())
    planned = Schedule(modes, Gaussian([1.0, 0.0], np.eye(2)), [0, 1], tail=(1, 2, 2), lead=lead)
    for steps in range(1, 12):
        longer = lasting(planned, steps)
        assert len(longer) == max(steps, 2)
        assert longer.cost == pytest.approx(planned.cost, rel=1e-9)


def test_a_plant_may_change_with_time():
    modes = close_loops(control.ss(-1, 1, 1, 0), {"off": [[0.0]]}, 0.1)
    plant = control.nlsys(lambda t, x, u, p: [np.cos(t)], lambda t, x, u, p: [t], inputs=1, states=1, outputs=1)
    run = simulate(plant, modes, Constant(0), [0.0], 40)
    np.testing.assert_allclose(run.x[0], np.sin(run.t), atol=1e-8)
    np.testing.assert_array_equal(run.y[0], run.t)


def test_a_schedule_goes_on_with_its_lead_and_its_tail():
    modes = dynamic(linear())
    planned = Schedule(modes, Gaussian([1.0, 0.0], np.eye(2)), [0, 1], tail=(1, 2, 2), lead=(2, 0))
    run = simulate(linear(), modes, planned, [1, 0], 10)
    np.testing.assert_array_equal(run.sequence, [0, 1, 2, 0, 1, 2, 2, 1, 2, 2])
    np.testing.assert_array_equal(simulate(linear(), modes, planned, [1, 0], 1).sequence, [0])
    ruled = schedule(modes, Gaussian([1.0, 0.0], np.eye(2)), Rollout(), 5, Rules(min_dwell=4, max_dwell=6))
    run = simulate(linear(), modes, ruled, [1, 0], 60)
    np.testing.assert_array_equal(run.sequence[:5], ruled.sequence)
    dwells = np.diff(np.flatnonzero(np.diff([-1, *run.sequence, -1])))
    assert len(dwells) > 8
    assert (dwells[:-1] >= 4).all()
    assert (dwells <= 6).all()
    ends = Schedule(modes, Gaussian([1.0, 0.0], np.eye(2)), [0, 1], terminal=np.eye(4))
    with pytest.raises(ValueError, match="ends after 2"):
        simulate(linear(), modes, ends, [1, 0], 3)
    assert simulate(linear(), modes, ends, [1, 0], 2).status == "completed"


def test_the_quadrotor_runs_as_its_equations_say():
    modes = quadrotor.modes()
    x0 = 0.1 * quadrotor.initial_state().mean
    planned = schedule(modes, Gaussian(x0, np.zeros((6, 6))), quadrotor.method(), 100)
    limits = np.array([0.005, 0.02, 0.05])
    run = simulate(quadrotor.nonlinear_plant(), modes, planned, x0, 100, saturation=(-limits, limits), rtol=1e-10)
    x, gains = x0, [quadrotor.high_gain(), quadrotor.low_gain()]
    for k, mode in enumerate(planned.sequence):
        np.testing.assert_allclose(run.x[:, k], x, rtol=1e-8, atol=1e-10)
        u = np.clip(-gains[mode] @ x, -limits, limits)
        np.testing.assert_allclose(run.u[:, k], u, rtol=1e-7, atol=1e-10)
        found = solve_ivp(lambda t, x, u=u: quadrotor_rate(x, u), (0, 0.01), x, "DOP853", rtol=1e-13, atol=1e-15)
        x = found.y[:, -1]
    np.testing.assert_allclose(run.x[:, -1], x, rtol=1e-8, atol=1e-10)
    assert (np.abs(run.u) == limits[:, None]).any(axis=1).sum() >= 2


def test_the_default_tolerance_keeps_eight_digits():
    modes, x0 = quadrotor.modes(), 0.1 * quadrotor.initial_state().mean
    runs = [
        simulate(quadrotor.nonlinear_plant(), modes, Rollout(), x0, 100, **how)
        for how in ({}, {"rtol": 1e-12, "atol": 1e-14})
    ]
    np.testing.assert_array_equal(runs[0].sequence, runs[1].sequence)
    np.testing.assert_allclose(runs[0].x, runs[1].x, rtol=1e-7, atol=1e-8)


def test_saturation_acts_on_the_plant_and_is_told_to_controllers_that_track():
    plant = linear()
    modes = dynamic(plant)
    sequence = [0] * 30
    planned = Schedule(modes, Gaussian([1.0, -0.5], np.eye(2)), sequence)
    run = simulate(plant, modes, planned, [3, 0], 30, saturation=(-0.5, [0.25]))
    sampled, c, z = modes.plant, modes.controllers, np.concatenate([[3.0, 0.0], modes.controllers.initial @ [3.0, 0.0]])
    for k in range(30):
        x, zeta = z[:2], z[2:]
        np.testing.assert_allclose(run.x[:, k], z, rtol=1e-6, atol=1e-7)
        u = np.clip(-np.array([2.0, 1.0]) @ x, -0.5, 0.25)
        assert run.u[0, k] == pytest.approx(u, abs=1e-7)
        zeta = c.F[0] @ zeta + c.Gy[0] @ sampled.C @ x + c.Gu[0] @ [u]
        z = np.concatenate([sampled.A @ x + sampled.B @ [u], zeta])
    assert run.u.min() == -0.5
    assert c.Gu[0].any()
    free = simulate(plant, modes, planned, [3, 0], 30, saturation=(-np.inf, np.inf))
    np.testing.assert_array_equal(free.x, simulate(plant, modes, planned, [3, 0], 30).x)
    one_sided = simulate(plant, modes, planned, [3, 0], 30, saturation=(-0.5, np.inf))
    assert one_sided.u.min() == -0.5


def test_noise_is_drawn_from_the_seed():
    plant = linear()
    modes = dynamic(plant)
    quiet, first, again, other = (
        simulate(plant, modes, Constant("lead"), [1, 0], 50, noise=noise, seed=seed)
        for noise, seed in ((None, 1), (0.01, 1), ([[0.01]], 1), (0.01, 2))
    )
    np.testing.assert_array_equal(first.x, again.x)
    assert not np.allclose(first.x, other.x)
    assert not np.allclose(first.x, quiet.x)
    np.testing.assert_allclose(first.y[0], plant.C[0] @ first.x[:2], atol=1e-12)
    # u = -(H xi + D (y + v)): the noise that was measured has the covariance asked for
    long = simulate(plant, modes, Constant("lead"), [0, 0], 4000, noise=0.01)
    c = modes.controllers
    v = (-long.u[0] - (c.Hz[1] @ long.x[2:])[0]) / c.Hy[1, 0, 0] - long.y[0]
    assert v[:-1].std() == pytest.approx(0.1, rel=0.05)
    silent = simulate(plant, modes, Constant("lead"), [1, 0], 50, noise=0.0)
    np.testing.assert_array_equal(silent.x, quiet.x)


def test_an_initial_state_is_drawn_from_a_gaussian():
    modes = dynamic(linear())
    x0 = Gaussian([1.0, 2.0], [[0.04, 0.01], [0.01, 0.09]])
    draws = np.array([simulate(linear(), modes, Constant(0), x0, 1, seed=seed).x[:, 0] for seed in range(300)])
    np.testing.assert_allclose(draws[:, :2].mean(axis=0), x0.mean, atol=0.06)
    np.testing.assert_allclose(np.cov(draws[:, :2].T), x0.cov, atol=0.03)
    np.testing.assert_allclose(draws[:, 2:], draws[:, :2] @ modes.controllers.initial.T)
    whole = [1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(simulate(linear(), modes, Constant(0), whole, 1).x[:, 0], whole)


def pendulum():
    return control.nlsys(
        lambda t, x, u, p: [x[1], np.sin(x[0]) + u[0]],
        lambda t, x, u, p: [np.sin(x[0])],
        inputs=["torque"],
        states=["angle", "rate"],
        outputs=["height"],
        name="pendulum",
    )


@pytest.mark.parametrize("as_object", [False, True])
def test_loops_run_about_an_operating_point(as_object):
    """A pendulum about 0.7 rad: the same run, in deviations, written out."""
    plant, x_e, u_e = pendulum(), np.array([0.7, 0.0]), np.array([-np.sin(0.7)])
    point = control.find_operating_point(plant, x_e, u_e) if as_object else (x_e, u_e)
    loops = {"gain": [[20.0, 6.0]], "lead": control.tf([40, 60], [1, 12])}
    modes = close_loops(plant.linearize(x_e, u_e), loops, 0.02, initial="settled")
    run = simulate(plant, modes, Rollout(), [1.0, 0.1], 100, operating_point=point, saturation=(-2, 2))
    scheduler, c, before = Rollout().start(modes), modes.controllers, -1
    x, zeta = np.array([1.0, 0.1]), c.initial @ [0.3, 0.1]
    for k in range(100):
        np.testing.assert_allclose(run.x[:, k], [*x, *zeta], atol=1e-8)
        dx = x - x_e
        mode = scheduler.step([*dx, *zeta])
        assert run.sequence[k] == mode
        zeta, before = c.activated(before, mode, zeta, dx), mode
        y = np.array([np.sin(x[0]) - np.sin(0.7)])
        u = np.clip(u_e + c.output(mode, zeta, dx, y), -2, 2)
        zeta = c.updated(mode, zeta, dx, y, u - u_e)
        x = solve_ivp(lambda t, x, u=u: [x[1], np.sin(x[0]) + u[0]], (0, 0.02), x, rtol=1e-12, atol=1e-14).y[:, -1]
    assert run.w2[0] == pytest.approx(0.3**2 + 0.1**2)
    assert run.w2[-1] < 1e-3
    rest = simulate(plant, modes, Rollout(), x_e, 50, operating_point=point)
    np.testing.assert_allclose(rest.x[:2].T, np.broadcast_to(x_e, (51, 2)), atol=1e-9)


def test_loops_follow_a_trajectory():
    plant, N = linear(), 80
    modes = dynamic(plant)
    u_e = np.sin(0.3 * np.arange(N))[None]
    x_e, x = np.empty((2, N + 1)), np.zeros(2)
    for k in range(N + 1):
        x_e[:, k] = x
        x = modes.plant.A @ x + modes.plant.B @ u_e[:, min(k, N - 1)]
    run = simulate(plant, modes, Rollout(), [1.0, -0.5], N, operating_point=(x_e, u_e))
    deviation = simulate(plant, modes, Rollout(), [1.0, -0.5], N)
    np.testing.assert_allclose(run.x[:2] - x_e, deviation.x[:2], atol=1e-7)
    np.testing.assert_allclose(run.x[2:], deviation.x[2:], atol=1e-7)
    np.testing.assert_allclose(run.w2, deviation.w2, atol=1e-7)


def test_the_response_is_python_controls():
    modes = dynamic(linear())
    run = simulate(linear(), modes, Rollout(), [1, 0], 20)
    assert isinstance(run, control.TimeResponseData)
    assert run.input_labels == ["force"]
    assert run.state_labels == ["place", "speed", "lead.x[0]", "lag.x[0]"]
    assert run.output_labels == ["y[0]", "index"]
    np.testing.assert_array_equal(run.outputs["index"], run.y[1])
    assert run.to_pandas().shape == (21, 1 + 1 + 2 + 4)
    run.plot()
    stopped = simulate(linear(), modes, Rollout(), [1, 0], 20, domain=lambda x: -1.0)
    stopped.plot()
    plt.close("all")
    assert "├── switches" in repr(run)
    assert "left its domain" in repr(stopped)
    assert "<table>" in run._repr_html_()
    np.testing.assert_array_equal(copy.deepcopy(run).x, run.x)


def test_arguments_are_not_changed():
    modes, x0, point = dynamic(linear()), np.array([1.0, 0.0]), (np.array([0.5, 0.0]), np.array([0.5]))
    simulate(linear(), modes, Rollout(), x0, 20, operating_point=point)
    np.testing.assert_array_equal(x0, [1.0, 0.0])
    np.testing.assert_array_equal(point[0], [0.5, 0.0])


def test_a_system_of_systems_is_a_plant():
    plant = control.interconnect([linear()], inputs=["force"], outputs=[linear().output_labels[0]])
    modes = dynamic(linear())
    run = simulate(plant, modes, Constant(0), [1, 0], 20)
    np.testing.assert_allclose(run.x, simulate(linear(), modes, Constant(0), [1, 0], 20).x, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("unit", [1e-6, 1e-12, 1e-100, 1e6])
def test_the_unit_of_the_state_changes_nothing(unit):
    """By default the tolerance is of the state at the start."""
    plant = control.ss([[0, 1], [-400, -1]], [[0], [1]], np.eye(2), 0)
    modes = close_loops(plant, [[[1.0, 1.7]]], DT)
    run, x = simulate(plant, modes, Constant(0), [unit, 2 * unit], 30), np.array([1.0, 2.0])
    for _ in range(30):
        x = modes.A[0] @ x
    np.testing.assert_allclose(run.x[:, -1] / unit, x, atol=1e-6)
