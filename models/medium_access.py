"""Medium access: two magnetically suspended balls share one channel; at each sample one of them is controlled.

A mode is who is served. The coil of the other one falls back to the voltage of the equilibrium, which is unstable, so
no mode is Schur: only switching keeps both balls in the air. Round robin does, but gives half of the channel to a ball
that is where it should be, while the other one falls; here it costs a third more than `method`. Round robin in turns of
ten samples comes close, if the right ball has the first turn; if the other one has, it costs almost three times as
much. The schedule tells from the moments who needs the channel.

The plants are two copies of the one of the Control Tutorials for MATLAB and Simulink ("Introduction: State-Space
Methods for Controller Design", University of Michigan and Carnegie Mellon): ``m h'' = m g - K i^2 / h`` and
``L i' = V - R i`` with m = 0.05 kg, K = 1e-4 N m/A2, L = 0.01 H, R = 1 ohm, g = 9.81 m/s2, about a gap of h = 0.01 m.
That two of them share a channel, its period, the weights, the rules and the initial state are ours.
"""

import control
import numpy as np
from numpy.typing import NDArray

from switchctl import Gaussian, Method, ModeSet, RecedingHorizon, Rules, close_loops

MASS, MAGNET, INDUCTANCE, RESISTANCE, GRAVITY = 0.05, 1e-4, 0.01, 1.0, 9.81  # kg, N m/A2, H, ohm, m/s2
GAP = 0.01  # m
CURRENT = float(np.sqrt(MASS * GRAVITY * GAP / MAGNET))  # A, at equilibrium; so is the voltage, in V
DT = 0.002  # s
DISPLACEMENT, VOLTAGE = 1e-3, 1.0  # m and V that cost the same
MIN_TURN, MAX_TURN = 0.004, 0.02  # s


def ball() -> control.StateSpace:
    """Voltage to gap, speed (downwards) and current of one ball, all about the equilibrium."""
    A = [
        [0, 1, 0],
        [GRAVITY / GAP, 0, -2 * GRAVITY / CURRENT],
        [0, 0, -RESISTANCE / INDUCTANCE],
    ]
    return control.ss(A, [[0], [0], [1 / INDUCTANCE]], np.eye(3), np.zeros((3, 1)))


def plant() -> control.StateSpace:
    """Both balls, side by side."""
    states = [f"{name} {number}" for number in (1, 2) for name in ("gap", "speed", "current")]
    inputs = ["voltage 1", "voltage 2"]
    return control.append(ball(), ball(), name="balls", states=states, outputs=states, inputs=inputs)


def gain() -> NDArray[np.float64]:
    """Return the gain of one ball's controller: LQR, as if the channel were its own."""
    K, _, _ = control.dlqr(ball().sample(DT), np.diag([DISPLACEMENT**-2, 0, 0]), [[VOLTAGE**-2]])
    return K


def controllers() -> dict[str, NDArray[np.float64]]:
    """Who is served has its gain, the other one a row of zeros."""
    K, idle = gain(), np.zeros((1, 3))
    return {"serve 1": np.block([[K, idle], [idle, idle]]), "serve 2": np.block([[idle, idle], [idle, K]])}


def initial_state() -> Gaussian:
    """Ball 1 is a millimetre low, ball 2 in its place: to 0.1 mm, 5 mm/s and 10 mA."""
    return Gaussian([DISPLACEMENT, 0, 0, 0, 0, 0], np.diag(np.square([1e-4, 5e-3, 1e-2] * 2)))


def modes() -> ModeSet:
    """Close the loops; gaps and voltages count in the cost, with the weights of the LQR."""
    Q = np.diag([DISPLACEMENT**-2, 0, 0] * 2)
    return close_loops(plant(), controllers(), dt=DT, Q=Q, R=np.diag([VOLTAGE**-2] * 2))


def rules() -> Rules:
    """Who has the channel keeps it for two samples at least, and for ten at most: nobody waits any longer."""
    return Rules(min_dwell=MIN_TURN, max_dwell=MAX_TURN, time_unit="s")


def method() -> Method:
    """T = 30 (60 ms): long enough for serving to pay, short enough for the ball that is not served to count.

    Under `rules`: without any, the last mode is held after the last step, and that costs infinitely much.
    """
    return RecedingHorizon(horizon=30)
