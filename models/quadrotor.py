"""Example 2 of the paper: the attitude of a quadrotor about hover, under an aggressive and a gentle controller.

The equations are the paper's (Lee and Bhattacharya, DSCC 2014). It gives neither parameters nor gains; its symbols are
those of the OS4 quadrotor, whose parameters are used here (S. Bouabdallah, Design and control of quadrotors with
application to autonomous flying, EPFL thesis 3727, 2007). The controllers are designed below, in the open. They were
searched for until they showed the paper's picture (the aggressive controller raises W2 early, the gentle one does
not, the best single switch comes near k = 50), so the example is reproduced in kind, not to the digit.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import control
import numpy as np
from numpy.typing import NDArray

from switchctl import Budget, Gaussian, Method, ModeSet, RecedingHorizon, Rules, close_loops
from switchctl.validation import number, real_array

PARAMETERS = {
    "g": 9.81,  # m/s2
    "m": 0.650,  # kg
    "l": 0.23,  # m, lever
    "Ixx": 7.5e-3,  # kg m2
    "Iyy": 7.5e-3,
    "Izz": 1.3e-2,
    "Jr": 6e-5,  # kg m2, rotor inertia
    "b": 3.13e-5,  # N s2, thrust factor
    "d": 7.5e-7,  # N m s2, drag factor
}
DT = 0.01  # s
STATES = ["phi", "theta", "psi", "p", "q", "r"]  # rad, rad/s

Array = NDArray[np.float64]


def rotor_speeds(moments: Array, parameters: dict[str, float] = PARAMETERS) -> Array:
    """Rotor speeds that give body moments at hover thrust, saturated at standstill.

    Parameters
    ----------
    moments : array, shape (3,) or (3, N)
        Roll, pitch and yaw moment in N m.
    parameters : dict, optional
        The constants in `PARAMETERS`.

    Returns
    -------
    array, shape (4,) or (4, N)
        Speeds of the four rotors in rad/s.

    Raises
    ------
    TypeError, ValueError
        If moments are not real, finite and three.
    """
    moments = real_array(moments, "moments")
    if moments.shape[:1] != (3,):
        raise control.ControlDimension(f"moments has shape {moments.shape}; expected (3,) or (3, N)")
    return _rotor_speeds(moments, parameters)


def _rotor_speeds(moments: Array, parameters: dict[str, float]) -> Array:
    b, d, arm = parameters["b"], parameters["d"], 2 * parameters["b"] * parameters["l"]
    hover = parameters["m"] * parameters["g"] / (4 * b)
    roll, pitch, yaw = moments[0] / arm, moments[1] / arm, moments[2] / (4 * d)
    squares = [hover + pitch - yaw, hover - roll + yaw, hover - pitch - yaw, hover + roll + yaw]
    return np.sqrt(np.maximum(squares, 0.0))


def _dynamics(t: float, x: Array, u: Array, parameters: dict[str, float]) -> Array:
    """Return the derivative of the attitude and body rates: the paper's equations."""
    phi, theta, _, p, q, r = x
    c = PARAMETERS | parameters
    Ixx, Iyy, Izz, Jr = c["Ixx"], c["Iyy"], c["Izz"], c["Jr"]
    Omega = _rotor_speeds(u, c)
    Omega_r = -Omega[0] + Omega[1] - Omega[2] + Omega[3]
    bl, d, squares = c["b"] * c["l"], c["d"], Omega**2
    attitude = np.array(
        [
            [1, np.sin(phi) * np.tan(theta), np.cos(phi) * np.tan(theta)],
            [0, np.cos(phi), -np.sin(phi)],
            [0, np.sin(phi) / np.cos(theta), np.cos(phi) / np.cos(theta)],
        ]
    ) @ [p, q, r]
    rates = [
        (q * r * (Iyy - Izz) + q * Jr * Omega_r + bl * (-squares[1] + squares[3])) / Ixx,
        (p * r * (Izz - Ixx) - p * Jr * Omega_r + bl * (squares[0] - squares[2])) / Iyy,
        (p * q * (Ixx - Iyy) + d * (-squares[0] + squares[1] - squares[2] + squares[3])) / Izz,
    ]
    return np.concatenate([attitude, rates])


def _output(measured: list[int], t: float, x: Array, u: Array, parameters: dict[str, float]) -> Array:
    """Return some of the states."""
    return np.asarray(x)[measured]


def _numbers(measured: Sequence[str]) -> list[int]:
    """The states that are measured, by their numbers."""
    names = [] if isinstance(measured, str) or not isinstance(measured, Sequence) else list(measured)
    if not names or not all(name in STATES for name in names) or len(set(names)) < len(names):
        raise ValueError(f"measured is {measured!r}; expected a list of some of {', '.join(STATES)}, each once")
    return [STATES.index(name) for name in names]


def nonlinear_plant(measured: Sequence[str] = STATES) -> control.NonlinearIOSystem:
    """Return the nonlinear equations, inputs the body moments.

    Parameters
    ----------
    measured : sequence of str, optional
        The states that are outputs, in this order; all by default, `STATES[:3]` for `compensator`.

    Returns
    -------
    control.NonlinearIOSystem

    Raises
    ------
    ValueError
        If measured holds something else than names of states, or one twice.

    Examples
    --------
    >>> from switchctl.models import quadrotor
    >>> quadrotor.nonlinear_plant(["phi", "psi"]).output(0, [0.1, 0.2, 0.3, 0.0, 0.0, 0.0], np.zeros(3)).tolist()
    [0.1, 0.3]
    """
    return control.nlsys(
        _dynamics,
        partial(_output, _numbers(measured)),
        inputs=["tau_phi", "tau_theta", "tau_psi"],
        states=STATES,
        outputs=list(measured),
        name="quadrotor",
    )


def plant(measured: Sequence[str] = STATES) -> control.StateSpace:
    """Linearise the nonlinear equations about hover.

    Parameters
    ----------
    measured : sequence of str, optional
        As for `nonlinear_plant`.

    Returns
    -------
    control.StateSpace
    """
    linear = nonlinear_plant(measured).linearize(np.zeros(6), np.zeros(3), eps=1e-6)
    # About hover each axis is a double integrator; the difference quotients leave noise in the zeros.
    A, B = np.round(linear.A, 6), np.where(np.abs(linear.B) < 1e-6 * np.abs(linear.B).max(), 0, linear.B)
    return control.ss(
        A,
        B,
        np.eye(6)[_numbers(measured)],
        0,
        name="quadrotor",
        states=STATES,
        outputs=list(measured),
        inputs=["tau_phi", "tau_theta", "tau_psi"],
    )


def high_gain() -> Array:
    """C_high: LQR by Bryson's rule: angles, rates and moments at most so large.

    Roll and pitch may use the whole moment that the rotors have at hover, yaw a quarter of it.
    """
    thrust, b, d = PARAMETERS["m"] * PARAMETERS["g"], PARAMETERS["b"], PARAMETERS["d"]
    roll, yaw = thrust * PARAMETERS["l"] / 2, thrust * d / b
    angles, rates, moments = [0.35, 0.35, np.pi], [12, 12, 4], [roll, roll, yaw / 4]
    Q = np.diag(1 / np.square([*angles, *rates]))
    R = np.diag(1 / np.square(moments))
    K, _, _ = control.lqr(plant(), Q, R)
    return K


def lead_lag(crossover: float, spread: float = 14) -> control.StateSpace:
    """C_low on one axis, per unit inertia: a lead centred at the crossover, then a lag a decade below it.

    Parameters
    ----------
    crossover : float
        Gain crossover frequency of the loop with 1/s2, in rad/s.
    spread : float, optional
        p / z of the lead.

    Returns
    -------
    control.StateSpace
        ``K (s + z)/(s + p) (s + zl)/(s + pl)`` with zl/pl = 2; its states are the lead's and the lag's.

    Raises
    ------
    TypeError, ValueError
        If an argument is not a number from 1e-9 to 1e9, or spread is below 1.
    """
    crossover, spread = number(crossover, "crossover"), number(spread, "spread")
    for name, value, least in (("crossover", crossover, 1e-9), ("spread", spread, 1.0)):
        if not least <= value <= 1e9:
            raise ValueError(f"{name} is {value}; expected a number from {least:g} to 1e9")
    z, p, zl, pl = crossover / np.sqrt(spread), crossover * np.sqrt(spread), crossover / 10, crossover / 20
    A, B, C = [[-p, 0], [z - p, -pl]], [[1], [1]], np.array([[z - p, zl - pl]])
    gain = crossover**2 / abs(control.ss(A, B, C, 1)(1j * crossover))
    return control.ss(A, B, gain * C, gain, states=["lead", "lag"])


def low_gain() -> Array:
    """C_low as a static gain: per axis the PD controller that equals the lead-lag at its crossover."""
    inertia = [PARAMETERS["Ixx"], PARAMETERS["Iyy"], PARAMETERS["Izz"]]
    K = np.zeros((3, 6))
    for axis, crossover in enumerate([4.5, 4.5, 0.8]):
        value = lead_lag(crossover)(1j * crossover)
        K[axis, axis], K[axis, axis + 3] = inertia[axis] * value.real, inertia[axis] * value.imag / crossover
    return K


def controllers() -> dict[str, Array]:
    """C_high and C_low as gains ``u = -K x``."""
    return {"high": high_gain(), "low": low_gain()}


def compensator() -> control.StateSpace:
    """C_low as it is in the paper, with states of its own: a lead-lag on each angle (design B).

    Crossovers 6 and 1 rad/s, p/z = 10, phase margin 52 degrees; inputs the three angles, outputs the moments.
    """
    inertia = [PARAMETERS["Ixx"], PARAMETERS["Iyy"], PARAMETERS["Izz"]]
    axes = [lead_lag(crossover, 10) for crossover in (6.0, 6.0, 1.0)]
    whole = control.append(*axes)
    gains = np.diag(inertia)
    states = [f"{part} {angle}" for angle in STATES[:3] for part in ("lead", "lag")]
    return control.ss(whole.A, whole.B, gains @ whole.C, gains @ whole.D, states=states, inputs=STATES[:3])


def settled_lead() -> Array:
    """The state of `compensator` at the start by the vehicle's: leads settled on the angles, lags at zero."""
    start = np.zeros((6, 6))
    for axis, crossover in enumerate((6.0, 6.0, 1.0)):
        start[2 * axis, axis] = 1 / (crossover * np.sqrt(10))
    return start


def dynamic_modes(
    discretize: Literal["plant", "closed_loop"] = "plant",
    inactive: Any = "track",
    initial: Any = None,
) -> ModeSet:
    """Close the loops of design B: C_high, and C_low with states of its own, fed by the angles.

    Parameters
    ----------
    discretize, inactive : optional
        As for `switchctl.close_loops`.
    initial : array_like, shape (12, 6), optional
        As for `switchctl.close_loops`; by default `settled_lead`.

    Returns
    -------
    ModeSet
        Of twelve states, the vehicle's and the compensator's; W2 and the cost count the vehicle's.
    """
    return close_loops(
        plant(STATES[:3]),
        {"high": high_gain(), "low": compensator()},
        dt=DT,
        discretize=discretize,
        inactive={"low": inactive},
        initial={"low": settled_lead() if initial is None else initial},
    )


def initial_state() -> Gaussian:
    """Return the paper's initial state; at full size a linear exercise (theta = -1.5 rad is near the singularity)."""
    return Gaussian([0.5, -1.5, -5.0, 0.1, 0.2, 0.1], 0.0225 * np.eye(6))


def modes(discretize: Literal["plant", "closed_loop"] = "plant") -> ModeSet:
    """Close both loops.

    Parameters
    ----------
    discretize : {"plant", "closed_loop"}, optional
        As for `switchctl.close_loops`; the paper samples the closed loops.

    Returns
    -------
    ModeSet
        "high" is mode 0, "low" mode 1 (the paper's A1 and A2).
    """
    return close_loops(plant(), controllers(), dt=DT, discretize=discretize)


def method() -> Method:
    """T = 150, hold = 50: one switch near k = 50, the paper's picture."""
    return RecedingHorizon(horizon=150, hold=50)


def resources() -> Rules:
    """Ration C_high, which uses more computing time and energy (the paper gives no figures): 2 s in all.

    Either controller acts for 0.1 s at least.
    """
    return Rules(min_dwell=10, budget=Budget(use={"high": 1}, limit=200))
