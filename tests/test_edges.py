"""Cases at the edge: runs from rest, averages of a policy, units, choices that would be ignored."""

import control
import numpy as np
import pytest

from switchctl import (
    Constant,
    Gaussian,
    ModeSet,
    PointwiseMinimum,
    RecedingHorizon,
    Rollout,
    Schedule,
    best_single_mode,
    close_loops,
    monte_carlo,
    schedule,
    simulate,
    single_mode_costs,
)

PLANT = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, states=["a", "r"])
LEAD = control.tf([40, 40], [1, 10])
REST = Gaussian([0.0, 0.0], np.zeros((2, 2)))
A = [[[0.9, 0.8], [0, 0.5]], [[0.95, 0], [-0.4, 0.7]]]
W = np.diag([0.1, 1.0])


def test_a_run_from_rest_goes_on():
    modes = ModeSet(A, W=W, cost=("discounted", 0.99))
    long = schedule(modes, REST, PointwiseMinimum(), 2000)
    for start in (REST, Gaussian([1e-3, 0.0], np.zeros((2, 2)))):
        found = schedule(modes, start, PointwiseMinimum())
        assert found.status == "discounted to nothing"
        assert found.cost == pytest.approx(long.cost, rel=1e-4)
    loops = close_loops(PLANT, {"stiff": [[40, 10]], "lead": LEAD}, dt=0.01)
    moved = schedule(loops, Gaussian([0, 0, 1.0], np.zeros((3, 3))), Constant("lead"))
    assert moved.status == "converged"
    assert moved.cost == pytest.approx(loops.dk * moved.w2.sum(), rel=1e-6)
    passing = ModeSet([[[0.5, 1.0], [0, 0.9]]], plant_states=1, initial=[[1.0], [-0.5]])
    found = schedule(passing, Gaussian([1.0], [[0.2]]), Constant(0))
    assert len(found) > 100
    assert found.cost == pytest.approx(found.w2.sum(), rel=1e-9)


def test_an_average_is_that_of_the_run_where_it_repeats_itself():
    modes = ModeSet(A, W=W, cost="average")
    for method in (Rollout(), PointwiseMinimum(), RecedingHorizon(5)):
        found = schedule(modes, Gaussian([1, 0], np.eye(2)), method, 2000)
        assert found.cost == pytest.approx(found.w2[1000:].mean(), rel=1e-2)
    best = single_mode_costs(modes, REST).min()
    assert schedule(modes, Gaussian([1, 0], np.eye(2)), Rollout(), 2000).cost < 0.8 * best
    with pytest.raises(ValueError, match="say how many steps to list"):
        schedule(modes, REST, Rollout())


def test_targets_are_kept_apart_from_what_counts_from_the_origin():
    loops = close_loops(PLANT, {"a": [[40, 10]], "b": [[1, 1]]}, dt=0.01)
    x0 = Gaussian([1.0, 0.5], 0.1 * np.eye(2))
    found = schedule(loops, x0, RecedingHorizon(5), 20, target=Gaussian([0.5, 0.5], 0.01 * np.eye(2)))
    with pytest.raises(ValueError, match="has a target"):
        monte_carlo(found, 100)
    with pytest.raises(ValueError, match="a target, and no tail"):
        simulate(PLANT, loops, found, [1.0, 1.0], 30)
    modes = ModeSet([[[0.5, 0.1], [0, 0.6]], [[0.4, 0], [0.2, 0.7]]], offset=[0, 100.0])
    paid = schedule(modes, x0, RecedingHorizon(2), 10, target=Gaussian([0.5, 0.5], 0.01 * np.eye(2)))
    assert paid.cost == pytest.approx(paid.w2.sum() + paid.final_w2)


def test_the_constraint_holds_under_activation():
    E = np.tile(np.eye(2), (2, 2, 1, 1))
    E[0, 1], E[1, 0] = [[0.78, 0.84], [0.89, -0.28]], [[-0.52, 1.32], [-1.5, -0.47]]
    modes = ModeSet([[[1.12, 1.75], [-0.17, -0.19]], [[0.06, -0.11], [-1.71, -0.53]]], activation=E)
    found = schedule(modes, Gaussian([-0.55, -1.05], np.zeros((2, 2))), RecedingHorizon(5, decrease=0.2), 15)
    held = dict(found.lengthened)
    updates = [0]
    while updates[-1] < 14:
        updates.append(updates[-1] + 1 + held.get(updates[-1], 0))
    for before, after in zip([0, *updates], updates[1:], strict=False):
        if after < 15:
            assert found.w2[after] <= 0.8 * found.w2[before] * (1 + 1e-9)


def test_a_disturbance_is_noticed_where_controllers_have_states():
    loops = close_loops(PLANT, {"K": [[1, 1]], "lead": control.tf([4, 4], [1, 10])}, dt=0.1)
    scheduler, x, before, longest = RecedingHorizon(20, decrease=0.1).start(loops), np.array([1, 0.5, 0]), -1, 0
    for k in range(340):
        if k == 300:
            x[0] += 1
        mode = scheduler.step(x)
        longest = max(longest, scheduler.lengthened if k > 300 else 0)
        x, before = loops.A_after[before, mode] @ x, mode
    assert longest < 30


def test_no_mode_of_finite_cost_is_no_best_mode():
    with pytest.raises(ValueError, match="offset at every step"):
        best_single_mode(ModeSet([[[0.5]], [[0.9]]], offset=[1, 1]), Gaussian([1.0], [[0.0]]))


def test_a_controller_that_runs_away_is_named():
    plant = control.ss([[-1]], [[1]], [[1]], 0)
    unstable = control.ss([[15.0]], [[1.0]], [[0.5]], [[2.0]], 0)
    loops = close_loops(plant, {"K": [[1.0]], "un": unstable}, dt=0.1, inactive="run")
    x0 = Gaussian([1.0], [[0.1]])
    with pytest.raises(ValueError, match=r"'un.x\[0\]', exceeds.*inactive='track'"):
        schedule(loops, x0, Constant("K"), 500)
    with pytest.raises(FloatingPointError, match=r"'un.x\[0\]'"):
        _ = Schedule(loops, x0, [0] * 500).w2
    assert np.isfinite(single_mode_costs(loops, x0)[0])


PID = control.tf([2.4, 20.1, 5], [0.02, 1, 0])
MOTOR = control.ss([[0, 1, 0], [0, -10, 1], [0, -0.02, -2]], [[0], [0], [2]], [[1, 0, 0]], 0)


def test_a_pid_with_filtered_derivative_takes_over_smoothly():
    gain = control.lqr(MOTOR, np.diag([100, 1, 0.1]), [[0.1]])[0]
    costs = {}
    for inactive in ("track", "reset", "hold", "run"):
        modes = close_loops(MOTOR, {"lqr": gain, "pid": PID}, dt=0.01, inactive={"pid": inactive})
        x0 = Gaussian([1, 0, 0], np.zeros((3, 3)))
        costs[inactive] = Schedule(modes, x0, [0] * 30 + [1]).cost
        if inactive == "track":
            late = Schedule(modes, x0, [0] * 300 + [1]).cost
            assert late < 1.01 * single_mode_costs(modes, x0)[0]
    assert costs["track"] < 0.95 * min(costs["reset"], costs["hold"], costs["run"])


def test_units_of_an_input_and_an_output_make_no_difference():
    F, G = np.array([[0.9, 0.1], [0, 0.8]]), np.eye(2)
    H = np.array([[1, 0.3], [0.2, 1]])
    plant = control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), 0, 0.1)
    A = []
    for s in (1.0, 1e-4, 1e-8):
        scaled = control.ss(plant.A, plant.B @ np.diag([1, 1 / s]), plant.C, 0, 0.1)
        controller = control.ss(F, G, np.diag([1, s]) @ H, 0, 0.1)
        gain = np.diag([1, s]) @ [[0.2, 0.1], [0.0, 0.3]]
        A.append(close_loops(scaled, {"K": gain, "C": controller}).A[0])
    np.testing.assert_allclose(A[1], A[0], atol=1e-9)
    np.testing.assert_allclose(A[2], A[0], atol=1e-9)
    two = control.ss(PLANT.A, PLANT.B, np.eye(2), 0)
    for s in (1.0, 1e-7):
        measured = control.ss(two.A, two.B, np.diag([1, s]), 0)
        loops = close_loops(
            measured, {"K": [[1.0, 1.0]]}, W=np.eye(2), V=np.diag([1, s**2]), estimator="kalman", cost="average"
        )
        np.testing.assert_allclose(
            loops.A[0],
            close_loops(two, {"K": [[1.0, 1.0]]}, W=np.eye(2), V=np.eye(2), estimator="kalman", cost="average").A[0],
            atol=1e-9,
        )


def test_a_single_controller_needs_no_tracking_gain():
    hidden = control.ss([[-1, 0], [0, 1.0]], [[1], [1]], [[1, 0.0]], 0, 0)
    assert close_loops(PLANT, {"l": hidden}, dt=0.1).A.shape == (1, 4, 4)


def test_what_is_known_of_loops_cannot_be_changed():
    loops = close_loops(PLANT, {"K": [[1, 1]], "lead": LEAD}, W=W, V=[[0.1]], estimator="kalman", cost="average")
    for array in (loops.process_noise, loops.measurement_noise, loops.error_covariance, loops.controllers.F):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("controllers", "keywords", "error", "words"),
    [
        ({"a": [[1, 1]]}, {"inactive": "bogus"}, ValueError, "is 'bogus'; expected 'track'"),
        ({"a": [[1, 1]]}, {"initial": "bogus"}, ValueError, "is 'bogus'; expected 'zero'"),
        ({"l": LEAD}, {"sampling": ("tustin", 40.0)}, ValueError, "below pi / dt = 31.4"),
        ({"l": LEAD}, {"sampling": ("tustin", -1.0)}, ValueError, "below pi / dt"),
        ({"l": LEAD}, {"sampling": ("zoh", 6.0)}, ValueError, "is for 'tustin'"),
        ({"l": LEAD}, {"sampling": None}, TypeError, "sampling is None; expected a method"),
        ({"l": LEAD}, {"sampling": ("tustin", 1.0, 2.0)}, TypeError, "expected a method"),
        ({"l": LEAD.sample(0.1)}, {"sampling": {"l": "zoh"}}, ValueError, "sampled already"),
        ({"l": LEAD}, {"sampling": "zoh", "discretize": "closed_loop"}, ValueError, "sample no controller"),
    ],
)
def test_choices_that_would_be_ignored_are_refused(controllers, keywords, error, words):
    with pytest.raises(error, match=words):
        close_loops(PLANT, controllers, dt=0.1, **keywords)


def test_operating_points_that_cannot_be_held_are_refused():
    def pendulum(t, x, u, params):
        return [x[1], np.sin(x[0]) + u[0]]

    plant = control.nlsys(pendulum, inputs=1, outputs=2, states=2, name="pendulum")
    modes = close_loops(plant.linearize([0.5, 0], [-np.sin(0.5)]), {"a": [[20, 6]]}, dt=0.05)
    held = ([0.5, 0], [-np.sin(0.5)])
    assert simulate(plant, modes, Constant(0), [0.6, 0], 40, operating_point=held).status == "completed"
    with pytest.raises(ValueError, match="no equilibrium: in one period the state moves by"):
        simulate(plant, modes, Constant(0), [0.6, 0], 40, operating_point=([0.5, 0], [0]))
    with pytest.raises(ValueError, match="is beyond it"):
        simulate(plant, modes, Constant(0), [0.6, 0], 40, operating_point=held, saturation=(-0.1, 0.1))
