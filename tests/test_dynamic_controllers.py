"""Controllers with states of their own: against python-control's feedback, and against a run written out by hand."""

import control
import numpy as np
import pytest

import switchctl
from switchctl import Gaussian, Schedule, close_loops

BEHAVIOURS = ["track", "reset", "hold", "run"]


def lead_lag(rng):
    z, p, zl, pl = rng.uniform(0.2, 20.0, 4)
    return rng.uniform(0.2, 3.0) * control.tf([1, z], [1, p]) * control.tf([1, zl], [1, pl])


def pid(rng):
    kp, ki, kd, tau = rng.uniform(0.1, 2.0, 4)
    return control.tf([kp], [1]) + control.tf([ki], [1, 0]) + control.tf([kd, 0], [0.1 * tau, 1])


def static(rng):
    return control.tf([rng.normal()], [1])


def one(kind, rng, p, q):
    """A controller with p inputs and q outputs whose entries are of a kind, as python-control makes larger ones."""
    entries = [[kind(rng) for _ in range(p)] for _ in range(q)]
    if p == q == 1:
        return entries[0][0]
    if kind is lead_lag and p == q:
        return control.append(*[control.ss(entries[i][i]) for i in range(p)])
    return control.combine_tf(entries)


def random_plant(rng, p, q, feedthrough):
    n = int(rng.integers(1, 5))
    A = rng.standard_normal((n, n)) - np.eye(n)
    D = 0.2 * rng.standard_normal((p, q)) if feedthrough else np.zeros((p, q))
    return control.ss(A, rng.standard_normal((n, q)), rng.standard_normal((p, n)), D)


def in_state_space(system):
    """A realisation made here: entry after entry, row by row."""
    if isinstance(system, control.StateSpace):
        return system
    if system.issiso():
        return control.ss(system)
    rows = []
    for i in range(system.noutputs):
        parts = [control.ss(system[i, j]) for j in range(system.ninputs)]
        rows.append(control.append(*parts))
    whole = control.append(*rows)
    p, q = system.ninputs, system.noutputs
    spread, add = np.tile(np.eye(p), (q, 1)), np.kron(np.eye(q), np.ones((1, p)))
    return control.ss(whole.A, whole.B @ spread, add @ whole.C, add @ whole.D @ spread)


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (2, 1), (1, 2)])
def test_500_loops_are_python_controls_feedback_of_the_sampled_parts(size, feedthrough):
    p, q = size
    rng = np.random.default_rng([p, q, feedthrough])
    done = 0
    while done < 63:
        plant, dt = random_plant(rng, p, q, feedthrough), float(rng.uniform(0.01, 0.2))
        given = {kind.__name__: one(kind, rng, p, q) for kind in (static, lead_lag, pid)}
        sampled = {
            name: control.sample_system(in_state_space(c), dt, method="tustin") if c.dt == 0 else in_state_space(c)
            for name, c in given.items()
        }
        for system in sampled.values():
            system.dt = dt  # a static one has none
        Pd = plant.sample(dt)
        conditions = [np.linalg.cond(np.eye(q) + c.D @ Pd.D) for c in sampled.values()]
        if max(conditions) > 50:
            continue  # python-control's own rounding would show
        done += 1
        modes = close_loops(plant, given, dt=dt, inactive="run")
        begin = plant.nstates
        for i, C in enumerate(sampled.values()):
            own = np.r_[0 : plant.nstates, begin : begin + C.nstates]
            begin += C.nstates
            reference = control.feedback(Pd, C).A
            scale = np.abs(reference).max()
            np.testing.assert_allclose(modes.A[i][np.ix_(own, own)], reference, atol=1e-12 * scale, rtol=0)
            hidden = np.setdiff1d(np.arange(modes.A.shape[-1]), own)
            assert not modes.A[i][np.ix_(own, hidden)].any()  # what doesn't act moves nothing
            if not feedthrough:
                check_interconnected(Pd, C, reference, rng)


def check_interconnected(plant, controller, reference, rng):
    """The same once more from the parts' own input-output equations."""
    p, q = plant.noutputs, plant.ninputs
    P, C = (s.copy(name=name, use_prefix_suffix=False) for s, name in ((plant, "P"), (controller, "C")))
    forward = [[f"P.u[{k}]", f"-C.y[{k}]"] for k in range(q)]
    back = [[f"C.u[{k}]", f"P.y[{k}]"] for k in range(p)]
    tied = control.interconnect([P, C], connections=forward + back, inplist=["P.u[0]"], outlist=["P.y[0]"])
    x = rng.standard_normal(tied.nstates)
    size = np.abs(reference).max() * np.abs(x).max()
    np.testing.assert_allclose(tied.dynamics(0, x, [0.0]), reference @ x, atol=1e-12 * size * len(x), rtol=0)


def random_controller(rng, n, p, q):
    A = rng.standard_normal((n, n))
    A *= rng.uniform(0.3, 0.95) / np.abs(np.linalg.eigvals(A)).max()
    return control.ss(
        A, rng.standard_normal((n, p)), rng.standard_normal((q, n)), 0.3 * rng.standard_normal((q, p)), 0.1
    )


def stable_gain(rng, controller):
    L = rng.standard_normal((controller.nstates, controller.noutputs))
    while np.abs(np.linalg.eigvals(controller.A - L @ controller.C)).max() >= 0.99:
        L *= 0.7
    return L


def by_hand(plant, systems, sequence, x, behaviour, gains, resets, xi):
    """The plant and every controller stepped on their own, as they would run; the state at each sample."""
    states = []
    for k, mode in enumerate(sequence):
        states.append(np.concatenate([x, *xi]))
        if behaviour == "reset" and k and mode != sequence[k - 1]:
            xi[mode] = resets[mode] @ x
        C = systems[mode]
        Dk = np.linalg.inv(np.eye(plant.ninputs) + C.D @ plant.D)
        u = -Dk @ (C.C @ xi[mode] + C.D @ plant.C @ x)
        y = plant.C @ x + plant.D @ u
        x = plant.A @ x + plant.B @ u
        for j, c in enumerate(systems):
            if j == mode or behaviour == "run":
                xi[j] = c.A @ xi[j] + c.B @ y
            elif behaviour == "track":
                xi[j] = c.A @ xi[j] + c.B @ y + gains[j] @ (-u - c.C @ xi[j] - c.D @ y)
            elif behaviour == "reset":
                xi[j] = 0 * xi[j]
    return np.array(states)


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
@pytest.mark.parametrize("feedthrough", [False, True])
def test_a_run_is_the_one_written_out_by_hand(behaviour, feedthrough):
    for seed in range(20):
        rng = np.random.default_rng([seed, feedthrough])
        p, q = rng.integers(1, 3, 2)
        Pd = random_plant(rng, p, q, feedthrough).sample(0.1)
        systems = [random_controller(rng, int(n), p, q) for n in rng.integers(1, 4, 3)]
        gains, resets, inactive = [], [], {}
        for j, c in enumerate(systems):
            gains.append(stable_gain(rng, c))
            resets.append(rng.standard_normal((c.nstates, Pd.nstates)))
            told = {"track": ("track", gains[j]), "reset": ("reset", resets[j])}
            inactive[f"C{j}"] = told.get(behaviour, behaviour)
        start = {f"C{j}": rng.standard_normal((c.nstates, Pd.nstates)) for j, c in enumerate(systems)}
        modes = close_loops(Pd, {f"C{j}": c for j, c in enumerate(systems)}, inactive=inactive, initial=start)
        sequence = rng.integers(0, 3, 25)
        x = rng.standard_normal(Pd.nstates)
        xi = [start[f"C{j}"] @ x for j in range(3)]
        expected = by_hand(Pd, systems, sequence, x, behaviour, gains, resets, xi)
        found = Schedule(modes, Gaussian(x, 0 * np.eye(len(x))), sequence)
        scale = np.abs(expected).max(axis=0, keepdims=True) + 1e-9
        np.testing.assert_allclose(found.mean.T / scale, expected / scale, atol=1e-8)
        w2 = (expected[:, : Pd.nstates] ** 2).sum(axis=1)
        np.testing.assert_allclose(found.w2, w2, rtol=1e-8)
        for i in range(3):  # the feedback is the control that was applied
            C = systems[i]
            z = rng.standard_normal(modes.A.shape[-1])
            own = slice(begin := Pd.nstates + sum(c.nstates for c in systems[:i]), begin + C.nstates)
            u = -np.linalg.solve(np.eye(q) + C.D @ Pd.D, C.C @ z[own] + C.D @ Pd.C @ z[: Pd.nstates])
            np.testing.assert_allclose(-modes.gains[i] @ z, u, atol=1e-10 * np.abs(modes.gains[i]).max())


def loops(inactive="track", **keywords):
    """A double integrator under a stiff gain and a lead-lag on the position."""
    plant = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, states=["angle", "rate"])
    compensator = control.tf([60, 60], [1, 12]) * control.tf([1, 0.3], [1, 0.1])
    return close_loops(
        plant, {"stiff": [[40.0, 10.0]], "lead-lag": compensator}, dt=0.02, inactive=inactive, **keywords
    )


def test_the_union_state_is_named_and_the_cost_counts_the_plants_states():
    modes = loops()
    assert modes.states == ("angle", "rate", "lead-lag.x[0]", "lead-lag.x[1]")
    assert modes.plant_states == 2
    np.testing.assert_array_equal(modes.Q[0], np.diag([1.0, 1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(loops(Q=np.diag([4.0, 0.0])).Q[1], np.diag([4.0, 0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(loops(Q=np.eye(4)).Q[1], np.eye(4))
    weighted = loops(R=2.0)
    np.testing.assert_allclose(weighted.Q - modes.Q, 2 * np.swapaxes(modes.gains, 1, 2) @ modes.gains)


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_what_a_mode_costs_for_ever_is_right_on_what_the_cost_sees(behaviour):
    modes, x0 = loops(behaviour), Gaussian([1.0, -0.5], 0.01 * np.eye(2))
    assert (modes.spectral_radii[0] == 1.0) == (behaviour == "hold")
    for mode, cost in enumerate(switchctl.single_mode_costs(modes, x0)):
        long = Schedule(modes, x0, [mode] * 20_000)
        assert cost == pytest.approx(modes.dk * long.w2.sum(), rel=1e-9)
        assert long.cost == pytest.approx(cost, rel=1e-9)


def test_a_word_repeated_for_ever_costs_what_its_steps_do():
    for behaviour in BEHAVIOURS:
        modes, x0 = loops(behaviour), Gaussian([1.0, -0.5], 0.01 * np.eye(2))
        word = (0, 1, 1, 0, 0)
        for lead in ([], [1], [0, 1]):
            short = Schedule(modes, x0, [*lead, 1], tail=word)
            long = Schedule(modes, x0, [*lead, 1, *word * 4000])
            assert short.cost == pytest.approx(modes.dk * long.w2.sum(), rel=1e-9), behaviour


def test_initial_states():
    C = control.ss(*[[[0.5]], [[1.0]], [[2.0]], [[0.1]]], 0.1)
    plant = control.ss([[0.9]], [[1.0]], [[3.0]], 0, 0.1)
    assert close_loops(plant, [C]).initial.tolist() == [[1.0], [0.0]]
    assert close_loops(plant, [C], initial="settled").initial[1, 0] == pytest.approx(3.0 / 0.5)
    assert close_loops(plant, [C], initial={"C0": [[7.0]]}).initial[1, 0] == 7.0
    modes = close_loops(plant, [C], initial="settled")
    lifted = Schedule(modes, Gaussian([2.0], [[0.25]]), [0]).x0
    np.testing.assert_allclose(lifted.mean, [2.0, 12.0])
    np.testing.assert_allclose(lifted.cov, 0.25 * np.outer([1, 6], [1, 6]))
    whole = Schedule(modes, Gaussian([2.0, 12.0], 0.25 * np.outer([1, 6], [1, 6])), [0, 0, 0])
    np.testing.assert_allclose(Schedule(modes, Gaussian([2.0], [[0.25]]), [0, 0, 0]).w2, whole.w2)


def test_the_method_of_sampling_is_chosen_by_controller():
    plant = control.ss([[0.0]], [[1.0]], [[1.0]], 0)
    lag = control.tf([1.0], [1.0, 1.0])
    for how in ("tustin", "zoh", "euler", ("tustin", 3.0)):
        modes = close_loops(plant, {"a": lag, "b": lag}, dt=0.5, sampling={"b": how})
        method, at = (how, None) if isinstance(how, str) else how
        expected = control.sample_system(control.ss(lag), 0.5, method=method, prewarp_frequency=at)
        assert modes.controllers.F[1, 1, 1] == pytest.approx(expected.A[0, 0])
        assert modes.controllers.Hy[1, 0, 0] == pytest.approx(expected.D[0, 0])
    exact = control.sample_system(control.ss(lag), 0.5, "tustin", prewarp_frequency=3.0)
    assert exact(np.exp(1.5j)) == pytest.approx(lag(3j))


def test_closing_in_continuous_time_is_the_limit_of_fast_sampling():
    plant = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    compensator = control.ss(control.tf([60, 60], [1, 12]))
    given = {"stiff": [[40.0, 10.0]], "lead": compensator}
    for behaviour in BEHAVIOURS:
        modes = close_loops(plant, given, dt=0.02, discretize="closed_loop", inactive=behaviour)
        loop = control.feedback(plant, compensator)
        np.testing.assert_allclose(modes.A[1], control.sample_system(loop, 0.02, "zoh").A, atol=1e-12)
        assert modes.plant is None and modes.controllers is None
        if behaviour == "track":
            continue  # its gain depends on the period
        fine = close_loops(plant, given, dt=1e-5, inactive=behaviour)
        stepped = np.linalg.matrix_power(fine.A[0], 2000)
        np.testing.assert_allclose(stepped, modes.A[0], atol=2e-3 * np.abs(stepped).max())


def test_the_tracking_gain_does_not_depend_on_coordinates_and_makes_the_takeover_smooth():
    rng = np.random.default_rng(0)
    C = control.ss(control.tf([60, 60], [1, 12]) * control.tf([1, 0.3], [1, 0.1]))
    T = rng.standard_normal((2, 2))
    turned = control.ss(T @ C.A @ np.linalg.inv(T), T @ C.B, C.C @ np.linalg.inv(T), C.D)
    plant = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    plain, other = (close_loops(plant, {"k": [[40.0, 10.0]], "c": c}, dt=0.02) for c in (C, turned))
    change = np.block([[np.eye(2), np.zeros((2, 2))], [np.zeros((2, 2)), T]])
    np.testing.assert_allclose(change @ plain.A[0] @ np.linalg.inv(change), other.A[0], atol=1e-9)
    jumps = {}
    for behaviour in BEHAVIOURS:
        modes = loops(behaviour)
        state = np.linalg.matrix_power(modes.A[0], 10) @ [1.0, 0.0, 0.0, 0.0]
        taken = state if modes.activation is None else modes.activation[0, 1] @ state
        jumps[behaviour] = abs((modes.gains[1] @ taken - modes.gains[0] @ state).item())
    assert jumps["track"] < 0.1 * min(jumps["reset"], jumps["hold"], jumps["run"])


def axis(**keywords):
    return control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, **keywords)


INTEGRATOR = control.tf([1.0], [1.0, 0.0])


@pytest.mark.parametrize(
    ("controller", "keywords", "error", "words"),
    [
        (control.tf([1, 0], [1]), {}, ValueError, r"controllers\['c'\] is improper"),
        (control.tf([1, 0, 0], [1, 1]), {}, ValueError, "improper.*filter it"),
        (
            control.ss(
                -1,
                [[1, 1]],
                1,
                [
                    [
                        0,
                        0,
                    ]
                ],
                0,
            ),
            {"plant": control.ss(np.eye(3), np.ones((3, 1)), [[1, 0, 0]], 0)},
            ValueError,
            "2 inputs and 1 outputs; expected 1 inputs .* or 3, its states",
        ),
        (control.ss(-1, 1, [[1], [1]], 0), {}, ValueError, "1 inputs and 2 outputs"),
        (control.tf([1], [1, 1], 0.5), {}, ValueError, "dt = 0.5, but the modes are sampled with dt = 0.01"),
        (control.tf([1], [1, 1], None), {}, ValueError, "has states and dt = None"),
        (control.tf([1], [1, 1], 0.01), {"discretize": "closed_loop"}, ValueError, "can't be closed in continuous"),
        (control.tf([1], [1, 1]), {"sampling": "foo"}, ValueError, "sampling is 'foo'; expected one of tustin"),
        (control.tf([1], [1, 1]), {"sampling": {"d": "zoh"}}, KeyError, "names 'd', and the controllers are k, c"),
        (control.tf([1], [1, 1]), {"inactive": "sleep"}, ValueError, "is 'sleep'; expected 'track'"),
        (control.tf([1], [1, 1]), {"inactive": ("hold", [[1.0]])}, ValueError, "expected 'track'"),
        (control.tf([1], [1, 1]), {"inactive": {"k": "hold"}}, ValueError, "'k', which has no states of its own"),
        (control.tf([1], [1, 1]), {"initial": {"k": "zero"}}, ValueError, "'k', which has no states of its own"),
        (
            control.tf([1], [1, 1]),
            {"inactive": ("track", [[-5.0]])},
            ValueError,
            "unstable while it is inactive.*radius",
        ),
        (control.tf([1], [1, 1]), {"inactive": ("track", [[1.0, 2.0]])}, ValueError, r"expected \(1, 1\)"),
        (control.tf([1], [1, 1]), {"inactive": ("track", [[np.nan]])}, ValueError, "tracking gain .* is nan"),
        (control.tf([1], [1, 1]), {"inactive": ("reset", [[1.0]])}, ValueError, r"the reset of .* expected \(1, 2\)"),
        (control.tf([1], [1, 1]), {"initial": "warm"}, ValueError, "is 'warm'; expected 'zero', 'settled' or"),
        (control.tf([1], [1, 1]), {"initial": [[1.0]]}, ValueError, r"expected \(1, 2\)"),
        (INTEGRATOR, {"initial": "settled"}, ValueError, "can't start settled: it has an integrator"),
        (control.ss([[0.0]], [[0.0]], [[1.0]], 0), {}, ValueError, "no tracking gain was found"),
        (control.ss([[np.nan]], [[1.0]], [[1.0]], 0), {}, ValueError, r"controllers\['c'\].A\[0, 0\] is nan"),
        (
            control.tf([1], [1, 1]),
            {"dt": True, "plant": control.ss(0.5 * np.eye(2), np.ones((2, 1)), [[1, 0]], 0, True)},
            ValueError,
            "continuous, but the modes have no sampling period",
        ),
        (control.ss(0.5, 1, 1, -1, 0.01), {"plant": control.ss(-1, 1, 1, 1.0), "k": 0.5}, ValueError, "ill-posed"),
        (
            control.ss([[-1.0]], [[0.0]], [[1.0]], -1 + 1e-10),
            {"plant": control.ss(-1, 1, 1, 1.0), "k": 0.5},
            ValueError,
            r"nearly so: .*condition number \d.*e\+",
        ),
    ],
)
def test_wrong_input(controller, keywords, error, words):
    plant, k = keywords.pop("plant", axis()), keywords.pop("k", None)
    k = k if k is not None else np.ones((1, plant.nstates))
    with pytest.raises(error, match=words):
        close_loops(plant, {"k": k, "c": controller}, **{"dt": 0.01 if plant.dt == 0 else None} | keywords)
