"""A position servo: switch the damping instead of compromising on it.

The bandwidth of a servo is fixed by what it must not excite; its damping ratio is then a compromise between a quick
rise (light damping) and a calm settling (heavy damping). With both controllers at hand the light one starts the move
and the heavy one ends it.

The plant is the DC motor of the Control Tutorials for MATLAB and Simulink ("DC Motor Position: System Modeling",
University of Michigan and Carnegie Mellon): J = 3.2284e-6 kg m2, b = 3.5077e-6 N m s, K = 0.0274 V s and N m/A, R = 4
ohm. Its inductance (2.75e-6 H, 0.7 us) is neglected. Bandwidth, damping ratios and the initial state are ours.
"""

import control
import numpy as np
from numpy.typing import NDArray

from switchctl import Gaussian, Method, ModeSet, RecedingHorizon, close_loops

J, FRICTION, K, RESISTANCE = 3.2284e-6, 3.5077e-6, 0.0274, 4.0
DT = 0.001  # s
BANDWIDTH = 60.0  # rad/s
DAMPING = {"light": 0.25, "heavy": 1.0}


def plant() -> control.StateSpace:
    """Voltage to shaft angle and speed."""
    damping = (FRICTION + K**2 / RESISTANCE) / J
    return control.ss(
        [[0, 1], [0, -damping]],
        [[0], [K / (RESISTANCE * J)]],
        np.eye(2),
        np.zeros((2, 1)),
        name="motor",
        states=["angle", "speed"],
        outputs=["angle", "speed"],
        inputs=["voltage"],
    )


def controllers() -> dict[str, NDArray[np.float64]]:
    """Gains on angle and speed that give the bandwidth with either damping ratio."""
    motor = plant()
    b, natural = motor.B[1, 0], motor.A[1, 1]
    return {
        name: np.array([[BANDWIDTH**2 / b, (2 * ratio * BANDWIDTH + natural) / b]]) for name, ratio in DAMPING.items()
    }


def initial_state() -> Gaussian:
    """Return one radian from the target, to 0.1 rad, at rest to 2 rad/s."""
    return Gaussian([1.0, 0.0], np.diag([0.01, 4.0]))


def modes() -> ModeSet:
    """Close the loops; only the angle counts in the cost."""
    return close_loops(plant(), controllers(), dt=DT, Q=np.diag([1.0, 0.0]))


def method() -> Method:
    """T = 30, hold = 10 (10 ms): nearly what Rollout gives, with an eighth of its switches."""
    return RecedingHorizon(horizon=30, hold=10)
