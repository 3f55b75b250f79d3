"""A semi-active suspension: choose the damper's setting at each sample after a pothole.

A damper that can be set to soft, medium or hard: soft is comfortable on the road, hard stops the wheel, and no one
setting does both. The cost is what passengers and tyre feel: body acceleration and tyre deflection. The force depends
on the setting, so each mode has a stage weight of its own.

The plant is the quarter-bus of the Control Tutorials for MATLAB and Simulink ("Suspension: System Modeling",
University of Michigan and Carnegie Mellon): body 2500 kg, wheel 320 kg, spring 80,000 N/m, tyre 500,000 N/m and
15,020 N s/m. Its damper is replaced by one with three settings; these, the weights and the initial state are ours.
"""

import control
import numpy as np

from switchctl import Gaussian, Method, ModeSet, Rollout, close_loops

BODY, WHEEL = 2500.0, 320.0  # kg
SPRING, TYRE, TYRE_DAMPING = 80_000.0, 500_000.0, 15_020.0  # N/m, N/m, N s/m
SETTINGS = {"soft": 1_000.0, "medium": 6_000.0, "hard": 20_000.0}  # N s/m
DT = 0.005  # s
ACCELERATION, DEFLECTION = 1.0, 0.02  # m/s2 and m that cost the same


def plant() -> control.StateSpace:
    """Damper force (on the body, upwards) to heights and speeds of body and wheel above a flat road."""
    A = [
        [0, 1, 0, 0],
        [-SPRING / BODY, 0, SPRING / BODY, 0],
        [0, 0, 0, 1],
        [SPRING / WHEEL, 0, -(SPRING + TYRE) / WHEEL, -TYRE_DAMPING / WHEEL],
    ]
    states = ["body", "body speed", "wheel", "wheel speed"]
    return control.ss(
        A,
        [[0], [1 / BODY], [0], [-1 / WHEEL]],
        np.eye(4),
        np.zeros((4, 1)),
        name="suspension",
        states=states,
        outputs=states,
        inputs=["force"],
    )


def controllers() -> dict[str, list[list[float]]]:
    """Damper force against the speed of the body over the wheel, for each setting."""
    return {name: [[0.0, c, 0.0, -c]] for name, c in SETTINGS.items()}


def initial_state() -> Gaussian:
    """Just out of a pothole: the wheel is up and rising, the body rising, none of it known well."""
    return Gaussian([0.0, 0.3, 0.03, 0.5], np.diag([1e-4, 1e-3, 1e-5, 1e-2]))


def modes() -> ModeSet:
    """Close the loops, and weigh body acceleration and tyre deflection."""
    loops = close_loops(plant(), controllers(), dt=DT)
    A, B, K = plant().A, plant().B, np.array(list(controllers().values()))
    acceleration = (A - B @ K)[:, 1:2, :] / ACCELERATION
    deflection = np.array([[0.0, 0.0, 1.0, 0.0]]) / DEFLECTION
    Q = np.swapaxes(acceleration, -1, -2) @ acceleration + deflection.T @ deflection
    return ModeSet(loops.A, loops.names, loops.dt, Q=Q, gains=K, states=loops.states)


def method() -> Method:
    """Rollout: never worse than the best fixed setting."""
    return Rollout()
