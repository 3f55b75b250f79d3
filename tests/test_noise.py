"""Noise, estimation and the costs that they ask for: against quadrature, enumeration and simulated samples."""

import control
import mpmath
import numpy as np
import pytest
from random_cases import random_gaussian
from scipy.stats import norm

import switchctl
from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    close_loops,
    schedule,
    single_mode_costs,
    switched_controller,
)
from switchctl.sampling import sampled_noise


def test_noise_is_sampled_exactly():
    rng = np.random.default_rng(0)
    mpmath.mp.dps = 40
    for n, size in [(1, 0.1), (2, 1.0), (3, 30.0)]:
        A, root = size * rng.standard_normal((n, n)), rng.standard_normal((n, n))
        W, h = root @ root.T, 0.3
        A = A - (0 if size < 5 else 40) * np.eye(n)  # stiff
        found = sampled_noise(A, W, h)
        exact = mpmath.matrix(n, n)
        M, V = mpmath.matrix(A.tolist()), mpmath.matrix(W.tolist())
        # the Lyapunov equation A X + X A' = e^(A h) W e^(A' h) - W, solved as a linear system
        E = mpmath.expm(M * h)
        right = E * V * E.T - V
        eye = mpmath.eye(n)
        kron = mpmath.matrix(n * n, n * n)
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    kron[i * n + j, k * n + j] += M[i, k]
                    kron[i * n + j, i * n + k] += M[j, k]
        solved = mpmath.lu_solve(kron, mpmath.matrix([right[i, j] for i in range(n) for j in range(n)]))
        exact = np.array([[float(solved[i * n + j]) for j in range(n)] for i in range(n)])
        assert eye is not None
        np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-13 * np.abs(exact).max())
    brownian = sampled_noise(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, 1.0]), 0.5)
    np.testing.assert_allclose(brownian, [[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]])


PLANT = control.ss([[0, 1], [-1, -0.2]], [[0], [1]], [[1, 0]], 0, states=["angle", "rate"])
LEAD = control.tf([8, 8], [1, 8])
W, V = np.diag([0.0, 0.3]), np.array([[0.02]])


def noisy_loops(**keywords):
    """A gain fed by a Kalman filter, and a lead-lag fed by the noisy output."""
    return close_loops(PLANT, {"gain": [[3.0, 2.0]], "lead": LEAD}, dt=0.1, W=W, V=V, estimator="kalman", **keywords)


def sampled_by_hand(modes, sequence, x0, samples, behaviour, seed):
    """Plant, filter and controllers stepped one after the other with drawn noise: ||x||^2 and the state, by step."""
    rng = np.random.default_rng(seed)
    Pd = PLANT.sample(0.1)
    Wd = sampled_noise(PLANT.A, W, 0.1)
    L = control.dlqe(Pd.A, np.eye(2), Pd.C, Wd, V)[0]
    C = control.sample_system(control.ss(LEAD), 0.1, "tustin")
    K = np.array([[3.0, 2.0]])
    track = -modes.controllers.Gu[0, :1] if behaviour == "track" else None
    x = rng.multivariate_normal(x0.mean, x0.cov, samples).T
    xe, xi = np.tile(x0.mean[:, None], samples), np.zeros((1, samples))
    states = []
    for k, mode in enumerate(sequence):
        if behaviour == "reset" and k and mode == 1 and sequence[k - 1] == 0:
            xi = 0 * xi
        states.append(np.concatenate([x, xi, xe]))
        y = Pd.C @ x + np.sqrt(V) @ rng.standard_normal((1, samples))
        u = -K @ xe if mode == 0 else -(C.C @ xi + C.D @ y)
        moved = C.A @ xi + C.B @ y
        if mode == 0:
            idle = {"run": moved, "hold": xi, "reset": 0 * xi}
            moved = moved + track @ (-u - C.C @ xi - C.D @ y) if behaviour == "track" else idle[behaviour]
        xi = moved
        xe = Pd.A @ xe + Pd.B @ u + L @ (y - Pd.C @ xe)
        x = Pd.A @ x + Pd.B @ u + np.linalg.cholesky(Wd) @ rng.standard_normal((2, samples))
    return np.array(states)


@pytest.mark.parametrize("behaviour", ["track", "reset", "hold", "run"])
def test_moments_agree_with_100000_samples_at_every_step(behaviour):
    modes = noisy_loops(inactive=behaviour, cost="average")
    assert modes.states == ("angle", "rate", "lead.x[0]", "estimate.angle", "estimate.rate")
    x0 = Gaussian([1.0, -0.5], [[0.2, 0.05], [0.05, 0.1]])
    sequence = [0] * 8 + [1] * 9 + [0, 1] * 3 + [0] * 12
    found = Schedule(modes, x0, sequence)
    samples = 100_000
    drawn = sampled_by_hand(modes, sequence, x0, samples, behaviour, 3)
    squares = (drawn[:, :2] ** 2).sum(axis=1)
    error = squares.std(axis=1) / np.sqrt(samples)
    band = norm.ppf(1 - 0.001 / len(sequence) / 2)  # all steps at once, at 99.9 %
    assert (np.abs(squares.mean(axis=1) - found.w2) <= band * error).all()
    band = norm.ppf(1 - 0.001 / found.mean.size / 2)
    spread = np.sqrt(np.einsum("kii->ik", found.cov) / samples)
    assert (np.abs(drawn.mean(axis=2).T - found.mean) <= band * spread + 1e-12).all()
    for k in (5, 12, 20, 34):
        scale = np.sqrt(np.outer(np.diag(found.cov[k]), np.diag(found.cov[k]))) + 1e-12
        assert (np.abs(np.cov(drawn[k]) - found.cov[k]) <= 0.03 * scale).all()


def test_the_estimates_error_is_what_the_riccati_equation_says():
    modes = noisy_loops(cost="average")
    Pd, Wd = PLANT.sample(0.1), sampled_noise(PLANT.A, W, 0.1)
    _, P, _ = control.dlqe(Pd.A, np.eye(2), Pd.C, Wd, V)
    np.testing.assert_allclose(modes.error_covariance, P, rtol=1e-9)
    end = Schedule(modes, Gaussian([1.0, 0.0], np.zeros((2, 2))), [0, 1] * 300).final.cov
    error = np.hstack([np.eye(2), np.zeros((2, 1)), -np.eye(2)])
    np.testing.assert_allclose(error @ end @ error.T, P, rtol=1e-9)


def noisy_modes(rng, n, m, cost, activation=False):
    A, roots = rng.standard_normal((m, n, n)), 0.3 * rng.standard_normal((m, n, n))
    A *= (rng.uniform(0.4, 0.9, m) / np.linalg.norm(A, 2, axis=(1, 2)))[:, None, None]
    E = np.tile(np.eye(n), (m, m, 1, 1))
    for j, i in np.argwhere(~np.eye(m, dtype=bool)):
        E[j, i] = 0.5 * rng.standard_normal((n, n))
    return ModeSet(
        A,
        W=roots @ np.swapaxes(roots, 1, 2),
        offset=rng.exponential(0.1, m),
        cost=cost,
        activation=E if activation else None,
        dt=0.1,
    )


def by_definition(modes, x0, rules, run):
    """Every step's cost, by the definition: state, switch and price."""
    price = np.broadcast_to(rules.price, len(modes)) - np.min(rules.price)
    S, before, costs = x0.second_moment, None, []
    for mode in run:
        paid = 0.0
        if before is not None and mode != before:
            paid = rules.switch_cost + rules.switch_cost_per_w2 * np.trace(S)
            if modes.activation is not None:
                S = modes.activation[before, mode] @ S @ modes.activation[before, mode].T
        costs.append(modes.dk * (np.vdot(modes.Q[mode], S) + modes.offset[mode] + price[mode]) + paid)
        S, before = modes.A[mode] @ S @ modes.A[mode].T + modes.W[mode], mode
    return np.array(costs)


RULES = [Rules(), Rules(price=(0.3, 0.0), switch_cost=0.05, switch_cost_per_w2=0.1), Rules(min_dwell=3)]


@pytest.mark.parametrize("activation", [False, True])
@pytest.mark.parametrize("rules", RULES, ids=repr)
def test_costs_for_ever_are_what_the_steps_cost(rules, activation):
    rng = np.random.default_rng(4)
    lead, word = [0, 0, 0, 1, 1, 1, 1], (0, 0, 0, 1, 1, 1)
    for _ in range(5):
        x0 = random_gaussian(rng, 2)
        modes = noisy_modes(rng, 2, 2, ("discounted", 0.9), activation)
        graph = SwitchingGraph(modes, rules)
        found = Schedule(modes, x0, lead, tail=word, graph=graph)
        costs = by_definition(modes, x0, rules, [*lead, *word * 60])
        assert found.cost == pytest.approx(0.9 ** np.arange(len(costs)) @ costs, rel=1e-9)
        assert found.cost == pytest.approx(sum(found.cost_parts))
        average = ModeSet(modes.A, W=modes.W, offset=modes.offset, activation=modes.activation, dt=0.1, cost="average")
        found = Schedule(average, x0, lead, tail=word, graph=SwitchingGraph(average, rules))
        late = by_definition(average, x0, rules, word * 60)[-6:]
        assert found.cost == pytest.approx(late.mean() / modes.dk, rel=1e-9)
        assert sum(found.cost_parts) == pytest.approx(found.cost)


def test_single_modes_and_the_tables_of_methods_agree_with_schedules():
    rng = np.random.default_rng(5)
    for cost in (("discounted", 0.95), "average"):
        for rules in RULES:
            modes, x0 = noisy_modes(rng, 3, 2, cost, activation=True), random_gaussian(rng, 3)
            graph = SwitchingGraph(modes, rules)
            costs = single_mode_costs(graph, x0)
            held = [Schedule(modes, x0, [i], graph=graph).cost for i in range(2)]
            np.testing.assert_allclose(costs, held, rtol=1e-9)
            found = schedule(modes, x0, Rollout(), 200, rules)
            assert found.cost <= costs.min() * (1 + 1e-9)


def test_few_switches_and_refine_under_noise_and_discount():
    rng = np.random.default_rng(6)
    for number in range(6):
        modes, x0 = noisy_modes(rng, 2, 2, ("discounted", 0.7), number % 2 == 1), random_gaussian(rng, 2)
        rules = RULES[number % 3]
        graph = SwitchingGraph(modes, rules)
        best = schedule(modes, x0, FewSwitches(2), 1, graph)
        least = np.inf
        for first in range(2):
            for a in range(1, 16):
                for b in range(a, 16):
                    run = [first] * a + [1 - first] * (b - a) + [first] * (16 - b) if b > a else [first] * 16
                    try:
                        least = min(least, Schedule(modes, x0, run, graph=graph).cost)
                        least = min(least, Schedule(modes, x0, run[:b], graph=graph).cost) if b > a else least
                    except ValueError:
                        continue
        assert best.cost <= least * (1 + 1e-9)
        assert best.cost == pytest.approx(least, rel=1e-6)
        refined = schedule(modes, x0, Refine(), 40, graph)
        base = schedule(modes, x0, Rollout(), 40, graph)
        assert refined.cost <= base.cost * (1 + 1e-9)
        assert refined.statistics["start"] >= refined.cost * (1 - 1e-9)


def test_a_receding_horizon_counts_noise():
    rng = np.random.default_rng(7)
    for number in range(20):
        cost = [("discounted", 0.8), "average"][number % 2]
        modes, x0, T = noisy_modes(rng, 2, 3, cost), random_gaussian(rng, 2), int(rng.integers(1, 9))
        expected = [
            modes.discount ** np.arange(T + 1) @ by_definition(modes, x0, Rules(), [i] * (T + 1)) for i in range(3)
        ]
        assert RecedingHorizon(T).start(modes).step(x0.mean, x0.cov) == int(np.argmin(expected))


def test_finite_horizons_need_no_choice():
    rng = np.random.default_rng(8)
    modes, x0 = noisy_modes(rng, 2, 2, "total"), random_gaussian(rng, 2)
    M = np.diag([2.0, 1.0])
    for method in (RecedingHorizon(4), PointwiseMinimum(), Refine(RecedingHorizon(3)), Constant(1)):
        found = schedule(modes, x0, method, 15, terminal=M)
        steps = by_definition(modes, x0, Rules(), found.sequence.tolist())
        assert found.cost == pytest.approx(steps.sum() + modes.dk * np.vdot(M, found.final.second_moment))
    coarse = schedule(modes, x0, RecedingHorizon(3), 15, terminal=M).cost
    assert schedule(modes, x0, Refine(RecedingHorizon(3)), 15, terminal=M).cost <= coarse * (1 + 1e-12)


def test_a_filter_feeds_the_scheduler():
    modes = noisy_loops(cost=("discounted", 0.99))
    whole, told = Rollout().start(modes), Rollout().start(modes)
    rng = np.random.default_rng(9)
    P = modes.error_covariance
    for _ in range(20):
        estimate, xi = rng.standard_normal(2), rng.standard_normal(1)
        cov = np.zeros((5, 5))
        cov[:2, :2] = P
        assert told.step(np.append(estimate, xi), P) == whole.step([*estimate, *xi, *estimate], cov)
    with pytest.raises(ValueError, match=r"expected \(5,\), or \(3,\) without the estimate"):
        told.step([1.0, 2.0])
    with pytest.raises(ValueError, match=r"expected \(5, 5\), or \(2, 2\) of the plant"):
        told.step([1.0, 2.0, 3.0], np.eye(3))


def test_a_block_with_a_filter_runs_on_the_output_alone():
    modes = noisy_loops(cost=("discounted", 0.99))
    block = switched_controller(Rollout(), modes)
    assert block.input_labels == modes.plant.output_labels
    loop = control.interconnect([modes.plant, block], inputs=[], outputs=[*modes.plant.output_labels, "index"])
    response = control.input_output_response(loop, np.arange(60) * 0.1, X0=[[1.0, 0.5], 0])
    scheduler, zeta, x = Rollout().start(modes), np.zeros(3), np.array([1.0, 0.5])
    before = -1
    for k in range(60):
        mode = scheduler.step(np.concatenate([zeta[-2:], zeta]), modes.error_covariance)
        assert mode == response.outputs[-1, k]
        y = modes.plant.C @ x
        assert y == pytest.approx(response.outputs[0, k], abs=1e-12)
        c = modes.controllers
        zeta = c.activated(before, mode, zeta, x)
        u = c.output(mode, zeta, x, y)
        zeta, before = c.updated(mode, zeta, x, y, u), mode
        x = modes.plant.A @ x + modes.plant.B @ u


def test_saving_and_copying(tmp_path):
    import pickle

    modes, x0 = noisy_loops(cost=("discounted", 0.99)), Gaussian([1.0, 0.0], 0.1 * np.eye(2))
    found = schedule(modes, x0, Rollout())
    assert found.status == "discounted to nothing"
    loaded, copied = Schedule.load(found.save(tmp_path / "s.json")), pickle.loads(pickle.dumps(found))
    for again in (loaded, copied):
        assert again.cost == found.cost
        np.testing.assert_array_equal(again.w2, found.w2)
    assert copied.modes.plant.state_labels == modes.plant.state_labels
    np.testing.assert_array_equal(copied.modes.controllers.F, modes.controllers.F)


def test_effort_made_by_measurement_noise_is_paid():
    modes = noisy_loops(cost="average", R=0.5)
    x0 = Gaussian([0.0, 0.0], np.zeros((2, 2)))
    sequence = [1] * 3000
    states = sampled_by_hand(modes, [1] * 120, x0, 20_000, "track", 1)
    C = control.sample_system(control.ss(LEAD), 0.1, "tustin")
    rng = np.random.default_rng(2)
    y = states[-1][:1] + np.sqrt(V) @ rng.standard_normal((1, 20_000))
    u = -(C.C @ states[-1][2:3] + C.D @ y)
    cost = np.mean((states[-1][:2] ** 2).sum(axis=0) + 0.5 * u[0] ** 2)
    assert Schedule(modes, x0, sequence).cost == pytest.approx(cost, rel=0.03)


STABLE = [[[0.5, 0.1], [0.0, 0.6]], [[0.4, 0.0], [0.2, 0.7]]]


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (
            lambda: schedule(ModeSet(STABLE, W=np.eye(2)), X0, Rollout()),
            ValueError,
            r"infinite; say which.*cost=\('disc",
        ),
        (lambda: Schedule(ModeSet(STABLE, W=np.eye(2)), X0, [0]).cost, ValueError, "say which cost is meant"),
        (lambda: switchctl.compare(ModeSet(STABLE, W=np.eye(2)), X0, [Rollout()]), ValueError, "say which cost"),
        (lambda: single_mode_costs(ModeSet(STABLE, W=np.eye(2)), X0), ValueError, "say which cost"),
        (lambda: ModeSet(STABLE, W=np.diag([1.0, -1.0])), ValueError, "W is not positive semidefinite"),
        (lambda: ModeSet(STABLE, W=np.eye(3)), ValueError, r"W has shape \(3, 3\)"),
        (lambda: ModeSet(STABLE, cost="sum"), ValueError, "cost is 'sum'; expected 'total', 'average' or"),
        (lambda: ModeSet(STABLE, cost=("discounted", 1.0)), ValueError, "discount factor is 1.0"),
        (lambda: ModeSet(STABLE, cost=("discounted", np.nan)), ValueError, "nan"),
        (lambda: ModeSet(STABLE, offset=[-1.0, 0.0]), ValueError, "offset"),
        (lambda: schedule(NOISY, X0, Optimal()), ValueError, "Optimal is for total costs without noise"),
        (lambda: Optimal().policy(NOISY), ValueError, "a policy is for total costs without noise"),
        (lambda: schedule(NOISY, X0, RecedingHorizon(3, decrease=0.1)), ValueError, "decrease.*noise"),
        (
            lambda: switchctl.certificates.certify(schedule(NOISY, X0, Rollout())),
            ValueError,
            "a certificate is for total",
        ),
        (
            lambda: schedule(ModeSet(STABLE, cost="average"), X0, Rollout(), 3, terminal=np.eye(2)),
            ValueError,
            "average",
        ),
        (lambda: schedule(ModeSet(STABLE, cost="average"), X0, Refine(), 3), ValueError, "average"),
        (lambda: schedule(ModeSet(STABLE, cost="average"), X0, FewSwitches(1), 3), ValueError, "average"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], V=[[-1.0]]), ValueError, "V is not positive semidefinite"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], V=np.eye(2)), ValueError, r"V has shape \(2, 2\)"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], V=[[1.0]]), ValueError, "no controller or estimator measures it"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=np.diag([1.0, -1.0])), ValueError, "W is not positive"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=np.eye(3)), ValueError, r"W has shape \(3, 3\)"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=W, estimator="kalman"), ValueError, "needs V"),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=W, V=V, estimator="luenberger"), ValueError, "'luenberger'"),
        (
            lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=W, V=V, estimator=[[9.0], [9.0]]),
            ValueError,
            "doesn't converge",
        ),
        (lambda: close_loops(PLANT, [[[1.0, 1.0]]], W=W, V=V, estimator=[[9.0]]), ValueError, r"expected \(2, 1\)"),
        (
            lambda: close_loops(PLANT, [[[1, 1]]] * 2, W=[W, 2 * W], V=V, estimator="kalman"),
            ValueError,
            "one W for all modes",
        ),
        (
            lambda: close_loops(PLANT, [[[1, 1]]], V=V, estimator="kalman", discretize="closed_loop"),
            ValueError,
            "closed in continuous time have none",
        ),
    ],
)
def test_wrong_input(make, error, words):
    with pytest.raises(error, match=words):
        make()


X0 = Gaussian([1.0, 1.0], 0.1 * np.eye(2))
NOISY = ModeSet(STABLE, W=0.1 * np.eye(2), cost=("discounted", 0.9))


def test_simulated_and_drawn_runs_have_the_predicted_moments():
    """The whole way: noise, filter, controllers and plant of `simulate` and `monte_carlo` against the prediction."""
    modes = noisy_loops(cost=("discounted", 0.99))
    x0 = Gaussian([1.0, -0.5], 0.05 * np.eye(2))
    planned = Schedule(modes, x0, [0] * 6 + [1] * 8 + [0] * 6)
    drawn = switchctl.monte_carlo(planned, 20_000, seed=1)
    assert (np.abs(drawn.mean[0] - planned.w2) <= 4.5 * drawn.standard_error[0]).all()
    ran = switchctl.monte_carlo(planned, 500, plant=PLANT, seed=2)
    assert (np.abs(ran.mean[0] - planned.w2) <= 4.5 * ran.standard_error[0]).all()
    online = switchctl.simulate(PLANT, modes, Rollout(), x0, 40, seed=3)
    again = switchctl.simulate(PLANT, modes, Rollout(), x0, 40, seed=3)
    np.testing.assert_array_equal(online.states, again.states)
    assert online.status == "completed"


def test_a_run_decides_by_the_estimate():
    quiet = close_loops(PLANT, {"gain": [[3.0, 2.0]], "lead": LEAD}, dt=0.1, estimator=[[0.5], [0.3]])
    x0 = Gaussian([1.0, -0.5], 0.3 * np.eye(2))
    run = switchctl.simulate(PLANT, quiet, RecedingHorizon(3), x0, 30, seed=4)
    scheduler = RecedingHorizon(3).start(quiet)
    estimates = run.states[-2:]
    np.testing.assert_array_equal(estimates[:, 0], [1.0, -0.5])
    assert np.linalg.norm(run.states[:2, 0] - estimates[:, 0]) > 0.1
    for k in range(30):
        z = np.concatenate([estimates[:, k], run.states[2:, k]])
        assert scheduler.step(z, quiet.error_covariance) == run.sequence[k]
    assert np.linalg.norm(run.states[:2, -1] - estimates[:, -1]) < 0.02


def test_of_equal_averages_the_better_beginning_is_taken():
    """Both modes settle at S = 1: from below the slow one stays there longer, from above the fast one falls faster."""
    modes = ModeSet([[[0.5]], [[0.8]]], W=[[[0.75]], [[0.36]]], cost="average")
    np.testing.assert_allclose(single_mode_costs(modes, Gaussian([1.0], [[0.0]])), 1.0)
    for method in (Rollout(), RecedingHorizon(np.inf)):
        for variance, mode in ((5.0, 0), (1.2, 0), (0.8, 1), (0.0, 1)):
            assert method.start(modes).step([0.0], [[variance]]) == mode


def test_bounds_under_a_discount_are_below_what_runs_cost():
    rng = np.random.default_rng(10)
    for _ in range(10):
        modes, x0 = noisy_modes(rng, 2, 2, ("discounted", 0.5)), random_gaussian(rng, 2)
        scheduler = FewSwitches(1).start(modes)
        least = (scheduler.bounds @ scheduler.moment(x0.second_moment)).max()
        assert 0 < least <= schedule(modes, x0, Refine(), 30).cost / modes.dk
