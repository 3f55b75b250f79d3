"""Loops that the plant's direct feedthrough closes at once, linear or not, at the limits of the actuators."""

import control
import numpy as np
import pytest
from plants import DT, linear

from switchctl import Constant, Rollout, close_loops, simulate


def curved(gain=0.4):
    """A plant whose output depends on its input at once, and not linearly."""
    return control.nlsys(
        lambda t, x, u, p: [x[1], -np.sin(x[0]) + u[0]],
        lambda t, x, u, p: [x[0] + gain * np.tanh(u[0])],
        inputs=1,
        outputs=1,
        states=2,
        name="curved",
    )


@pytest.mark.parametrize("saturation", [None, (-0.3, 0.3)])
@pytest.mark.parametrize("plant", [curved(), linear(0.4)], ids=lambda plant: plant.name)
def test_an_algebraic_loop_is_solved_at_every_sample(plant, saturation):
    of = plant if isinstance(plant, control.StateSpace) else plant.linearize([0, 0], [0])
    modes = close_loops(of, {"out": control.ss([], [], [], [[1.5]]), "lead": control.tf([4, 4], [1, 8])}, DT)
    run = simulate(plant, modes, Rollout(), [1.0, 0.5], 40, saturation=saturation)
    low, high = saturation or (-np.inf, np.inf)
    c = modes.controllers
    for k, mode in enumerate(run.sequence):
        y = plant.output(0, run.x[:2, k], run.u[:, k])
        assert run.y[0, k] == y[0]
        asked = -(c.Hz[mode] @ run.x[2:, k] + c.Hy[mode] @ y)
        assert run.u[:, k] == pytest.approx(np.clip(asked, low, high), abs=1e-8)
    assert len(set(run.sequence.tolist())) == 2 or saturation
    if saturation:
        assert (np.abs(run.u) == 0.3).any()


def test_an_algebraic_loop_of_two_inputs_at_their_limits():
    """What one input lacks at its limit, the other makes up for as far as the loop couples them."""
    D = np.array([[0.4, 0.3], [-0.2, 0.5]])
    plant = control.ss(np.diag([-0.1, -0.2]), np.eye(2), np.eye(2), D)
    K = np.array([[1.0, 0.4], [-0.3, 1.2]])
    modes = close_loops(plant, {"both": control.ss([], [], [], K), "half": control.ss([], [], [], K / 2)}, DT)
    # with two outputs and two states a system is fed by the output
    assert modes.controllers.by_output
    assert not modes.controllers.by_state
    run = simulate(plant, modes, Rollout(), [2.0, -1.0], 40, saturation=(-0.4, [0.2, 3.0]))
    for k, mode in enumerate(run.sequence):
        asked = -[K, K / 2][mode] @ (run.x[:, k] + D @ run.u[:, k])
        assert run.u[:, k] == pytest.approx(np.clip(asked, -0.4, [0.2, 3.0]), abs=1e-8)
    one = (run.u[0] == -0.4) & (np.abs(run.u[1]) < 0.4)
    assert one.any()


def test_an_algebraic_loop_without_solution_is_told():
    plant = control.nlsys(
        lambda t, x, u, p: [-x[0]],
        lambda t, x, u, p: [x[0] + 0.5 * u[0] + 5 * u[0] ** 2],
        inputs=1,
        outputs=1,
        states=1,
    )
    modes = close_loops(plant.linearize([0], [0]), {"out": control.ss([], [], [], [[1.0]])}, DT)
    with pytest.raises(ValueError, match=r"algebraic loop.*delay=True"):
        simulate(plant, modes, Constant(0), [5.0], 3)
    assert simulate(plant, modes, Constant(0), [0.1], 3).status == "completed"
    assert simulate(plant, modes, Constant(0), [0.1], 3, delay=True).status == "completed"
