"""Blocks for python-control: in a simulation they do what a schedule predicts, and nothing else."""

import copy
import math
import pickle
import warnings

import control
import numpy as np
import pytest
from random_cases import random_gaussian, random_modes

from switchctl import (
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    close_loops,
    schedule,
    scheduler_system,
    switched_controller,
)
from switchctl.models import five_mode, quadrotor

CONSTRAINED = RecedingHorizon(5, hold=3, decrease=0.2)
METHODS = [
    PointwiseMinimum(),
    RecedingHorizon(6, hold=4),
    RecedingHorizon(math.inf, hold=2),
    CONSTRAINED,
    Rollout(),
    FewSwitches(1),
    Refine(),
    Optimal(gap=0.3, time_limit=20),
]
RULES = [None, Rules(min_dwell=3, switch_cost_per_w2=0.01, start=(1, 2)), Rules(max_switches=2)]
STEPS = 40


@pytest.fixture(autouse=True)
def _nothing_global_changes():
    before = dict(control.config.defaults)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield
    assert dict(control.config.defaults) == before


def random_loops(rng, inactive, initial="zero", feedthrough=False, measure="both"):
    """Two controllers with states fed by the output, one of them strictly proper, and a gain of the state."""
    n, p, q = 3, 2, 2
    while True:
        A = random_modes(rng, n, 1)[0]
        D = 0.3 * rng.standard_normal((p, q)) if feedthrough else np.zeros((p, q))
        if feedthrough:
            D[0] = 0.0  # the first output has none
        plant = control.ss(A, rng.standard_normal((n, q)), rng.standard_normal((p, n)), D, 0.1, name="plant")
        dynamic = [
            control.ss(
                0.8 * random_modes(rng, 2, 1)[0],
                rng.standard_normal((2, p)),
                0.2 * rng.standard_normal((q, 2)),
                k * 0.2 * rng.standard_normal((q, p)),
                0.1,
            )
            for k in (0, 1)
        ]
        controllers = {"one": dynamic[0], "two": dynamic[1], "gain": 0.2 * rng.standard_normal((q, n))}
        if measure == "output":
            del controllers["gain"]
        modes = close_loops(plant, controllers, inactive=inactive, initial=initial)
        if all(P is not None for P in modes.tails):
            return modes


def showing_its_state(plant):
    """The plant with its states as outputs, before its own."""
    n, q = plant.nstates, plant.ninputs
    outputs = [label for label in plant.output_labels if label not in plant.state_labels]
    own = [plant.output_labels.index(label) for label in outputs]
    C, D = np.vstack([np.eye(n), plant.C[own]]), np.vstack([np.zeros((n, q)), plant.D[own]])
    labels = {"inputs": plant.input_labels, "states": plant.state_labels}
    outputs = [*plant.state_labels, *outputs]
    return control.ss(plant.A, plant.B, C, D, plant.dt, name="P", outputs=outputs, **labels)


def closed(modes, block, plant=None):
    plant = showing_its_state(modes.plant) if plant is None else plant
    unused = [f"{plant.name}.{o}" for o in plant.output_labels if o not in block.input_labels]
    outputs = [*block.output_labels]
    return control.interconnect([plant, block], inputs=[], outputs=outputs, ignore_outputs=unused)


def run(loop, dt, x0, steps=STEPS):
    return control.input_output_response(loop, np.arange(steps) * dt, X0=[x0, 0])


def assert_as_scheduled(modes, method, rules, x0, loop=None, steps=STEPS):
    n, z = modes.plant_states, modes.A.shape[-1]
    expected = schedule(modes, Gaussian(x0, np.zeros((n, n))), method, steps=steps, rules=rules)
    loop = closed(modes, switched_controller(method, modes, rules=rules)) if loop is None else loop
    response = run(loop, modes.dk, x0, steps)
    assert response.outputs[-1].tolist() == expected.sequence.tolist()
    tolerance = {"rtol": 0, "atol": 1e-12 * np.abs(expected.mean).max()}
    np.testing.assert_allclose(response.states[:n], expected.mean[:n], **tolerance)
    np.testing.assert_allclose(response.states[n:z, 1:], expected.mean[n:, 1:], **tolerance)
    before = [expected.graph.last_mode[0], *expected.sequence[:-1]]
    for k, (j, i) in enumerate(zip(before, expected.sequence, strict=True)):
        z = expected.mean[:, k] if modes.activation is None or j < 0 else modes.activation[j, i] @ expected.mean[:, k]
        np.testing.assert_allclose(response.outputs[:-1, k], -modes.gains[i] @ z, **tolerance)
    return expected


@pytest.mark.parametrize("inactive", ["track", "reset", "hold", "run"])
def test_a_simulation_is_what_the_schedule_predicts(inactive):
    rng = np.random.default_rng(["track", "reset", "hold", "run"].index(inactive))
    switches = 0
    for number, method in enumerate(METHODS):
        for rules in RULES:
            if isinstance(method, Optimal) or (inactive == "hold" and method == CONSTRAINED):
                continue
            initial = "settled" if rng.random() < 0.5 else "zero"
            measure = "output" if rng.random() < 0.3 else "both"
            modes = random_loops(rng, inactive, initial, feedthrough=number % 2 == 1, measure=measure)
            switches += len(assert_as_scheduled(modes, method, rules, rng.standard_normal(3)).switches)
    assert switches > 20


def test_a_reset_to_the_plants_state_and_static_controllers():
    rng = np.random.default_rng(7)
    Z = rng.standard_normal((2, 3))
    assert_as_scheduled(random_loops(rng, {"one": ("reset", Z)}), RecedingHorizon(4), None, rng.standard_normal(3))
    modes = quadrotor.modes()
    x0 = quadrotor.initial_state().mean
    for rules in (None, quadrotor.resources()):
        assert assert_as_scheduled(modes, quadrotor.method(), rules, x0, steps=120).switches


def test_the_sampled_plant_connects_by_names_where_it_shows_its_states():
    plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, name="axis", outputs=["angle", "rate"])
    lead = control.ss([[-5.0]], [[1.0, 1.0]], [[3.0]], [[9.0, 8.0]])  # fed by the outputs, which are the states
    modes = close_loops(plant, {"lead": lead, "soft": [[2, 2]]}, dt=0.05, inactive="reset")
    block = switched_controller(RecedingHorizon(20), modes, name="C")
    assert block.input_labels == ["angle", "rate"]
    assert block.output_labels == ["u[0]", "index"]
    assert block.state_labels[0] == "lead.x[0]"
    loop = control.interconnect([modes.plant, block], inputs=[], outputs=["u[0]", "index"])
    assert loop.dt == 0.05
    assert_as_scheduled(modes, RecedingHorizon(20), None, [1.0, -1.0], loop)
    named = control.interconnect(
        [modes.plant, block], inputs=["u[0]"], outputs=["angle", "rate", "u[0]", "index"], name="loop"
    )  # with a disturbance of the input
    pushed = control.input_output_response(named, np.arange(9) * 0.05, np.ones(9), [1.0, 0.0, 0])
    assert pushed.outputs.shape == (4, 9)
    assert "C_memory[0]" in named.state_labels


def test_signals_in_any_combination():
    rng = np.random.default_rng(5)
    A, B = 0.5 * np.eye(3), np.ones((3, 1))
    C = np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    D = np.array([[0.0], [0.0], [0.1], [0.0]])
    plant = control.ss(A, B, C, D, True, outputs=["last", "sum", "through", "again"], inputs="push", name="P")
    by_output = control.ss([[0.5]], [[0.1, 0.1, 0.1, 0.1]], [[0.1]], 0.1 * rng.standard_normal((1, 4)), True)
    modes = close_loops(plant, {"C.a": by_output, "b": [[0.1, 0.2, 0.1]]})
    block = switched_controller(Rollout(), modes)
    assert block.input_labels == ["x[0]", "x[1]", "last", "sum"]
    whole = control.ss(
        A,
        B,
        np.vstack([np.eye(3), C[1]]),
        0,
        True,
        outputs=["x[0]", "x[1]", "last", "sum"],
        inputs="push",
        name="P",
    )
    assert block.dt is True
    assert_as_scheduled(modes, Rollout(), None, [1.0, 2.0, -1.0], closed(modes, block, whole))
    assert switched_controller(Rollout(), close_loops(plant, [np.zeros((1, 3))])).input_labels == [
        "x[0]",
        "x[1]",
        "last",
    ]


def test_a_nonlinear_plant():
    modes = close_loops(
        control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, outputs=["angle", "rate"]),
        {"stiff": [[20, 6.4]], "soft": [[1, 1.73]]},
        dt=0.05,
    )

    def update(t, x, u, params):
        return np.array([x[0] + 0.05 * x[1], x[1] + 0.05 * (u[0] - np.sin(x[0]))])

    def output(t, x, u, params):
        return x

    plant = control.nlsys(
        update, output, inputs=["u[0]"], outputs=["angle", "rate"], states=2, dt=0.05, name="pendulum"
    )
    method = RecedingHorizon(20, hold=5)
    response = run(closed(modes, switched_controller(method, modes), plant), 0.05, [1.0, 2.0], 200)
    scheduler, x = method.start(modes), np.array([1.0, 2.0])
    for k in range(200):
        np.testing.assert_array_equal(response.states[:2, k], x)
        mode = scheduler.step(x)
        assert mode == response.outputs[-1, k]
        x = update(0, x, -modes.gains[mode] @ x, {})
    assert len(set(response.outputs[-1])) == 2
    continuous = control.nlsys(update, output, inputs=["u[0]"], outputs=["angle", "rate"], states=2, name="p")
    with pytest.raises(ValueError, match="incompatible timebases"):
        closed(modes, switched_controller(method, modes), continuous)


def test_the_scheduler_alone_along_predicted_moments():
    rng = np.random.default_rng(3)
    for method in METHODS:
        modes, x0 = ModeSet(random_modes(rng, 3, 3, (0.3, 0.9))), random_gaussian(rng, 3)
        predicted = schedule(modes, x0, method, steps=25)
        block = scheduler_system(method, modes, covariance=True)
        assert block.input_labels[:5] == ["x[0]", "x[1]", "x[2]", "P[0,0]", "P[0,1]"]
        inputs = np.vstack([predicted.mean, predicted.cov.reshape(25, 9).T])
        for _ in range(2):
            response = control.input_output_response(block, np.arange(25), inputs)
            assert response.outputs[0].tolist() == predicted.sequence.tolist()


def test_the_scheduler_in_a_loop():
    modes, x0 = five_mode.modes(), five_mode.initial_state().mean
    plant = control.nlsys(
        lambda t, x, u, params: modes.A[int(u[0])] @ x,
        lambda t, x, u, params: x,
        inputs=["index"],
        outputs=list(modes.states),
        states=2,
        dt=modes.dt,
        name="plant",
    )
    for method in (PointwiseMinimum(), RecedingHorizon(10, hold=3), Rollout(), Refine(), Optimal(), FewSwitches(2)):
        for rules in (None, Rules(min_dwell=2)):
            block = scheduler_system(method, modes, rules=rules)
            loop = control.interconnect([plant, block], inputs=[], outputs=["index"])
            predicted = schedule(modes, Gaussian(x0, np.zeros((2, 2))), method, steps=30, rules=rules)
            response = run(loop, 1.0, x0, 30)
            assert response.outputs[0].tolist() == predicted.sequence.tolist()
            np.testing.assert_allclose(response.states[:2], predicted.mean, rtol=0, atol=1e-12 * np.abs(x0).max())


@pytest.mark.parametrize("method", METHODS)
def test_nothing_that_is_asked_changes_anything(method):
    rng = np.random.default_rng(11)
    modes = random_loops(rng, "reset", "settled")
    rules = None if isinstance(method, Optimal) else RULES[1]
    block = switched_controller(method, modes, rules=rules)
    states, inputs = [np.zeros(block.nstates)], []
    start = rng.standard_normal(5)
    for k in range(12):
        inputs.append(0.8**k * start + 0.1 * 0.8**k * rng.standard_normal(5))
        states.append(block.dynamics(0, states[-1], inputs[-1]))
    outputs = [block.output(0, x, u) for x, u in zip(states, inputs, strict=False)]
    twin = copy.deepcopy(block)
    kept = copy.deepcopy((states, inputs))
    for k in rng.integers(12, size=60):
        other = inputs[rng.integers(12)] if k else inputs[0]
        for each in (block, twin):
            each.output(0, states[k], other)
            each.dynamics(0, states[k], other)
            np.testing.assert_array_equal(each.output(0, states[k], inputs[k]), outputs[k])
            np.testing.assert_array_equal(each.dynamics(0, states[k], inputs[k]), states[k + 1])
    np.testing.assert_array_equal(states, kept[0])
    np.testing.assert_array_equal(inputs, kept[1])


def test_runs_repeat_and_copies_run_alike():
    rng = np.random.default_rng(13)
    modes, x0 = random_loops(rng, "track"), rng.standard_normal(3)
    for method in (RecedingHorizon(5, hold=3, decrease=0.2), Refine(), RecedingHorizon(4, hold=4)):
        block = switched_controller(method, modes)
        loop = closed(modes, block)
        first = run(loop, 0.1, x0)
        for again in (loop, copy.deepcopy(loop), closed(modes, block.copy()), closed(modes, copy.deepcopy(block))):
            run(again, 0.1, -2 * x0[::-1], 7)
            repeated = run(again, 0.1, x0)
            np.testing.assert_array_equal(repeated.states, first.states)
            np.testing.assert_array_equal(repeated.outputs, first.outputs)


def test_a_block_can_be_pickled(pair):
    block = scheduler_system(RecedingHorizon(4, hold=3), pair[0])
    twin = pickle.loads(pickle.dumps(block))
    state = block.dynamics(0, np.zeros(block.nstates), [1.0, 1.0])
    np.testing.assert_array_equal(twin.dynamics(0, np.zeros(block.nstates), [1.0, 1.0]), state)
    assert twin.output(0, state, [0.0, 1.0]) == block.output(0, state, [0.0, 1.0])


def test_a_run_goes_on_from_where_another_ended():
    rng = np.random.default_rng(17)
    modes, x0 = random_loops(rng, "run", "settled"), rng.standard_normal(3)
    loop = closed(modes, switched_controller(RecedingHorizon(6, hold=4), modes, rules=RULES[1]))
    whole = run(loop, 0.1, x0)
    rest = control.input_output_response(loop, np.arange(STEPS - 9) * 0.1, X0=whole.states[:, 9])
    np.testing.assert_array_equal(rest.states, whole.states[:, 9:])


def test_controllers_may_start_elsewhere():
    rng = np.random.default_rng(19)
    modes = random_loops(rng, "run", "settled")
    block, x0, more = switched_controller(Rollout(), modes), rng.standard_normal(3), rng.standard_normal(4)
    z = np.concatenate([x0, modes.controllers.initial @ x0 + more])
    inputs = np.concatenate([x0, modes.plant.C @ x0])
    u = block.output(0, np.concatenate([more, np.zeros(block.nstates - 4)]), inputs)
    mode = Rollout().start(modes).step(z)
    np.testing.assert_allclose(u, [*(-modes.gains[mode] @ z), mode], rtol=1e-12)


def axis(**labels):
    return control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, **labels)


GAINS = {"stiff": [[40.0, 10.0]], "soft": [[1.0, 1.0]]}


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: switched_controller("pointwise", close_loops(axis(), GAINS)), TypeError, "method must be a Method"),
        (lambda: scheduler_system(None, five_mode.modes()), TypeError, "method must be a Method"),
        (lambda: switched_controller(Rollout(), five_mode.modes()), TypeError, "what close_loops returns"),
        (
            lambda: switched_controller(Rollout(), quadrotor.modes("closed_loop")),
            ValueError,
            r"closed in continuous time.*discretize=\"plant\"",
        ),
        (
            lambda: switched_controller(Rollout(), close_loops(axis(inputs=["index"]), GAINS)),
            ValueError,
            "two signals of the block would be called 'index'",
        ),
        (
            lambda: switched_controller(Rollout(), close_loops(axis(inputs=["a"], outputs=["a", "b"]), GAINS)),
            ValueError,
            "called 'a'.*rename",
        ),
        (lambda: scheduler_system(Rollout(), five_mode.modes(), rules=Rules(max_dwell=0)), ValueError, "max_dwell"),
        (lambda: scheduler_system(Rollout(), five_mode.modes(), name="a", order=2), TypeError, "order"),
    ],
)
def test_wrong_input(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_wrong_signals():
    block = scheduler_system(RecedingHorizon(3), five_mode.modes(), covariance=True)
    start, P = np.zeros(3), [1.0, 0.0, 0.0, 1.0]
    with pytest.raises(ValueError, match=r"mean\[0\] is nan"):
        block.output(0, start, [np.nan, 0.0, *P])
    with pytest.raises(ValueError, match="cov is not symmetric"):
        block.output(0, start, [0.0, 0.0, 1.0, 0.5, 0.0, 1.0])
    with pytest.raises(ValueError, match=r"memory\[1\] is 0.5; expected a whole number"):
        block.output(0, [0.0, 0.5, 0.0], [1.0, 0.0, *P])
    with pytest.raises(ValueError, match="expected a node below 1"):
        block.dynamics(0, [3.0, 0.0, 0.0], [1.0, 0.0, *P])
    assert block.output(0, start, [1.0, 0.0, *P]).shape == (1,)
