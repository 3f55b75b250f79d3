"""A mass on a spring with its loops, and the quadrotor's equations written out."""

import control
import numpy as np

from switchctl import close_loops
from switchctl.models import quadrotor

DT = 0.1


def linear(D=0.0):
    return control.ss(
        [[0, 1], [-1, -0.2]], [[0], [1]], [[1, 0.3]], [[D]], name="mass", states=["place", "speed"], inputs=["force"]
    )


def dynamic(plant, inactive="track"):
    """A gain, and two controllers with states, of which one is fed by the output."""
    lead, lag = control.tf([4, 4], [1, 8]), control.tf([1, 0.5], [1, 0.05])
    loops = {"gain": [[2.0, 1.0]], "lead": lead, "lag": lag}
    return close_loops(plant, loops, DT, inactive=inactive, initial="settled")


def quadrotor_rate(x, tau, c=quadrotor.PARAMETERS):
    """The paper's equations with the rotors' speeds by hand."""
    phi, theta, _, p, q, r = x
    b, d, lever, hover = c["b"], c["d"], c["l"], c["m"] * c["g"]
    common, roll, pitch, yaw = hover / (4 * b), tau[0] / (2 * b * lever), tau[1] / (2 * b * lever), tau[2] / (4 * d)
    squares = [common - yaw + pitch, common + yaw - roll, common - yaw - pitch, common + yaw + roll]
    o1, o2, o3, o4 = np.sqrt(squares)
    residual = -o1 + o2 - o3 + o4
    return [
        p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)),
        q * np.cos(phi) - r * np.sin(phi),
        (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta),
        (q * r * (c["Iyy"] - c["Izz"]) + c["Jr"] * q * residual + tau[0]) / c["Ixx"],
        (p * r * (c["Izz"] - c["Ixx"]) - c["Jr"] * p * residual + tau[1]) / c["Iyy"],
        (p * q * (c["Ixx"] - c["Iyy"]) + tau[2]) / c["Izz"],
    ]
