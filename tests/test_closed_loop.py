"""Closing loops against python-control's own feedback and exact sampling."""

import pickle

import control
import numpy as np
import pytest
from scipy.linalg import expm

from switchctl import close_loops


def random_plant(rng, n=3, inputs=2, outputs=2, feedthrough=True):
    D = rng.standard_normal((outputs, inputs)) if feedthrough else np.zeros((outputs, inputs))
    return control.ss(
        rng.standard_normal((n, n)), rng.standard_normal((n, inputs)), rng.standard_normal((outputs, n)), D
    )


def axis():
    return control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), np.zeros((2, 1)), name="axis", states=["angle", "rate"])


K = {"stiff": np.array([[40.0, 10.0]]), "soft": np.array([[1.0, 1.0]])}


def test_the_plant_is_sampled_then_closed_by_default():
    modes = close_loops(axis(), K, dt=0.02)
    sampled = axis().sample(0.02)
    for name, gain in K.items():
        np.testing.assert_allclose(modes[name].A, sampled.A - sampled.B @ gain, atol=1e-14)
        np.testing.assert_array_equal(modes[name].K, gain)
    assert modes.dt == 0.02
    assert modes.states == ("angle", "rate")
    assert close_loops(axis(), K).dt == 0.01


def test_closing_first_samples_the_loop_exactly():
    modes = close_loops(axis(), K, dt=0.02, discretize="closed_loop")
    for name, gain in K.items():
        np.testing.assert_allclose(modes[name].A, expm((axis().A - axis().B @ gain) * 0.02), atol=1e-14)


def test_a_static_system_is_what_python_control_feeds_back():
    rng = np.random.default_rng(1)
    for _ in range(100):
        plant = random_plant(rng)
        gain = control.ss([], [], [], rng.standard_normal((2, 2)))
        reference = control.feedback(plant.sample(0.05), control.ss([], [], [], gain.D, 0.05)).A
        assert close_loops(plant, [gain], dt=0.05).A[0] == pytest.approx(reference, rel=1e-9, abs=1e-9)
        closed = close_loops(plant, [gain], dt=0.05, discretize="closed_loop").A[0]
        assert closed == pytest.approx(expm(control.feedback(plant, gain).A * 0.05), rel=1e-9, abs=1e-9)


def test_a_system_whose_inputs_fit_only_the_states_is_fed_by_the_state():
    rng = np.random.default_rng(2)
    plant, gain = random_plant(rng, n=3, inputs=2, outputs=1), rng.standard_normal((2, 3))
    by_array, by_system = (close_loops(plant, [c]) for c in (gain, control.ss([], [], [], gain)))
    np.testing.assert_allclose(by_array.A, by_system.A)


def test_a_static_transfer_function_is_a_controller():
    modes = close_loops(control.ss([[-1.0]], [[1.0]], [[2.0]], [[0.5]]), {"k": control.tf([3.0], [1.0])}, dt=0.1)
    sampled = control.ss([[-1.0]], [[1.0]], [[2.0]], [[0.5]]).sample(0.1)
    assert modes.A[0, 0, 0] == pytest.approx((sampled.A - sampled.B * 3 * 2 / (1 + 3 * 0.5))[0, 0])


def test_a_transfer_function_plant_is_realised():
    modes = close_loops(control.tf([1], [1, 2, 1]), {"open": np.zeros((1, 2))}, dt=0.1)
    assert np.sort(np.linalg.eigvals(modes.A[0]).real) == pytest.approx([np.exp(-0.1)] * 2, abs=1e-7)


def test_timebases():
    sampled = axis().sample(0.1)
    assert close_loops(sampled, K).dt == 0.1
    assert close_loops(sampled, K, dt=0.1).dt == 0.1
    assert close_loops(axis().sample(3 * 0.1), K, dt=0.3).dt == 3 * 0.1
    unspecified = control.ss(sampled.A, sampled.B, sampled.C, sampled.D, True)
    assert close_loops(unspecified, K).dt is True
    assert close_loops(unspecified, K, dt=0.1).dt == 0.1
    assert close_loops(stepping(), [static(0.1), static(None), static(0.1)]).dt == 0.1
    assert close_loops(sampled, [control.ss([], [], [], [[1.0, 1.0]], 0.1)]).dt == 0.1
    assert close_loops(axis(), [control.ss([], [], [], [[1.0, 1.0]], 0)]).dt == 0.01


def test_weights():
    Q, R = np.diag([4.0, 0.0]), np.array([[0.5]])
    modes = close_loops(axis(), K, Q=Q, R=R)
    for name, gain in K.items():
        np.testing.assert_allclose(modes[name].Q, Q + 0.5 * gain.T @ gain)
    np.testing.assert_array_equal(close_loops(axis(), K).Q[0], np.eye(2))
    np.testing.assert_array_equal(close_loops(axis(), K, R=0.5).Q, close_loops(axis(), K, R=[[0.5]]).Q)


def test_names_and_kinds_of_controllers():
    assert close_loops(axis(), [K["stiff"], K["soft"]]).names == ("C0", "C1")
    assert close_loops(axis(), {"row": [40, 10]})["row"].K == pytest.approx(K["stiff"])
    assert close_loops(control.ss(-1, 1, 1, 0), [2.0]).gains.shape == (1, 1, 1)


def test_input_is_copied():
    plant, gains = axis(), {"a": np.array([[1.0, 1.0]])}
    modes = close_loops(plant, gains)
    before = modes.A.copy()
    plant.A[0, 0], gains["a"][0, 0] = 99.0, 99.0
    np.testing.assert_array_equal(modes.A, before)
    assert modes["a"].K[0, 0] == 1.0


def test_closed_loops_can_be_pickled():
    loops = {"gain": [[40.0, 10.0]], "lead": control.ss(-10, [[1.0, 0.5]], 1, [[2.0, 1.0]])}
    for discretize in ("plant", "closed_loop"):
        modes = close_loops(axis(), loops, 0.02, discretize)
        copied = pickle.loads(pickle.dumps(modes))
        assert type(copied) is type(modes)
        np.testing.assert_array_equal(copied.A, modes.A)
        assert (copied.plant is None) == (modes.plant is None) == (discretize == "closed_loop")
        if modes.plant is not None:
            np.testing.assert_array_equal(copied.plant.B, modes.plant.B)
            np.testing.assert_array_equal(copied.controllers.F, modes.controllers.F)
            assert (copied.plant.dt, copied.plant.state_labels) == (0.02, ["angle", "rate"])


def nonlinear():
    return control.nlsys(lambda t, x, u, params: -x, inputs=1, outputs=1, states=1)


def stepping():
    return control.ss([[0.5]], [[1]], [[1]], 0, True)


def static(dt):
    return control.ss([], [], [], [[0.1]], dt)


def explosive():
    return control.ss([[800.0]], [[1]], [[1]], 0)


@pytest.mark.parametrize(
    ("plant", "controllers", "keywords", "error", "words"),
    [
        (nonlinear(), [[[1.0]]], {}, TypeError, "linearise it"),
        ("plant", [[[1.0]]], {}, TypeError, "StateSpace or TransferFunction, not a str"),
        (control.frd([1, 2], [1, 2]), [[[1.0]]], {}, TypeError, "not a FrequencyResponseData"),
        (control.ss([], [], [], [[1.0]]), [[[1.0]]], {}, ValueError, "0 states"),
        (axis(), {}, {}, ValueError, "controllers is empty"),
        (axis(), 3, {}, TypeError, "dict or a list"),
        (axis(), "gain", {}, TypeError, "dict or a list"),
        (axis(), {"k": [[1.0, 2.0, 3.0]]}, {}, ValueError, r"controllers\['k'\] has shape \(1, 3\); expected \(1, 2\)"),
        (axis(), {"k": [[1.0, np.nan]]}, {}, ValueError, r"controllers\['k'\]\[0, 1\] is nan"),
        (axis(), {"k": control.tf([1], [1, 1])}, {}, ValueError, "1 inputs and 1 outputs; expected 2"),
        (axis(), {"k": control.ss([], [], [], np.ones((1, 5)))}, {}, ValueError, "5 inputs and 1 outputs; expected 2"),
        (axis(), {"k": nonlinear()}, {}, TypeError, "gain array, a StateSpace or"),
        (axis(), {"k": control.lqr(axis(), np.eye(2), [[1]])}, {}, TypeError, r"pass K, its first entry"),
        (axis(), {1: [[1.0, 1.0]]}, {}, TypeError, "non-empty strings"),
        (axis(), K, {"dt": 0}, ValueError, "positive, finite"),
        (axis(), K, {"dt": -0.1}, ValueError, "positive, finite"),
        (axis(), K, {"dt": np.nan}, ValueError, "nan"),
        (axis(), K, {"dt": np.inf}, ValueError, "positive, finite"),
        (axis(), K, {"dt": "fast"}, TypeError, "'fast'"),
        (axis(), K, {"dt": True}, ValueError, "plant is continuous"),
        (axis(), K, {"dt": False}, ValueError, "False"),
        (axis().sample(0.1), K, {"dt": 0.2}, ValueError, "0.2 s, but the plant is sampled with dt = 0.1"),
        (axis().sample(0.1), K, {"discretize": "closed_loop"}, ValueError, "already sampled"),
        (axis(), K, {"discretize": "both"}, ValueError, "'both'; expected 'plant' or 'closed_loop'"),
        (axis(), [control.ss([], [], [], [[1.0, 1.0]], 0.5)], {}, ValueError, "dt = 0.5, but .* dt = 0.01"),
        (axis().sample(0.1), [control.ss([], [], [], [[1.0, 1.0]], 0)], {}, ValueError, "dt = 0, but .* dt = 0.1"),
        (control.ss([[0.5]], [[1]], [[1]], 0, None), [1.0], {}, ValueError, "plant.dt is None"),
        (control.ss([[1]], [[1]], [[1]], [[-1.0]]), [control.ss([], [], [], [[1.0]])], {}, ValueError, "ill-posed"),
        (control.ss(-1, 1, 1, -1 / 0.3), [control.ss([], [], [], [[0.1 + 0.2]])], {}, ValueError, "ill-posed"),
        (stepping(), [static(0.1), static(0.2)], {}, ValueError, "dt = 0.2, but .* dt = 0.1"),
        (axis(), K, {"Q": np.diag([1.0, -1.0])}, ValueError, "Q is not positive semidefinite.*eigenvalue is -1"),
        (axis(), K, {"Q": np.eye(3)}, ValueError, r"Q has shape \(3, 3\)"),
        (axis(), K, {"R": [[-1.0]]}, ValueError, "R is not positive semidefinite"),
        (axis().sample(0.1), K, {"dt": 0.10001}, ValueError, "0.10001 s, but the plant is sampled"),
        (control.ss(np.eye(2), np.zeros((2, 0)), np.eye(2), np.zeros((2, 0))), [1.0], {}, ValueError, "0 inputs"),
        (axis(), K, {"R": np.eye(2)}, ValueError, r"R has shape \(2, 2\)"),
        (control.ss([[800.0]], [[1]], [[1]], 0), [0.0], {"dt": 10.0}, ValueError, "overflows"),
        (
            control.ss([[800.0]], [[1]], [[1]], 0),
            [0.0],
            {"dt": 10.0, "discretize": "closed_loop"},
            ValueError,
            "overfl",
        ),
    ],
)
def test_wrong_input(plant, controllers, keywords, error, words):
    with pytest.raises(error, match=words):
        close_loops(plant, controllers, **keywords)


def test_nan_in_the_plant_is_named():
    plant = axis()
    plant.B[1, 0] = np.nan
    with pytest.raises(ValueError, match=r"plant.B\[1, 0\] is nan"):
        close_loops(plant, K)
