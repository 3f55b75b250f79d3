"""What plans are made of, and what they can't be made of."""

import numpy as np
from pair import modes, x0

from switchctl import (
    Gaussian,
    ModeSet,
    Rollout,
    Schedule,
    schedule,
)

MODES, X0 = modes(), x0()
PLAN = schedule(MODES, X0, Rollout(), 3)
TWO, ONE = np.zeros((2, 2)), np.zeros((1, 1))
GREAT = {  # each beside what is told
    "a mean beyond the range": (Gaussian([1e200, 1.0], TWO), "exceeds the floating-point range; scale the state"),
    "a covariance beyond the range": (Gaussian([1.0, 1.0], 1e308 * np.eye(2)), "exceeds the floating-point range"),
    "a mean that is lost": (Gaussian([1e-320, 0.0], TWO), "lost below the floating-point range; scale the state"),
    "a covariance that is lost": (Gaussian([0.0, 0.0], 1e-320 * np.eye(2)), "lost below the floating-point range"),
}
WRONG_X0 = [
    ("x0: None", {"x0": None}, TypeError, "x0 must be a Gaussian, not a NoneType"),
    ("x0: a mean", {"x0": [1.0, 1.0]}, TypeError, "x0 must be a Gaussian", "np.zeros((n, n))"),
    ("x0: the class", {"x0": Gaussian}, TypeError, "x0 must be a Gaussian"),
    ("x0: other states", {"x0": Gaussian([1.0], ONE)}, ValueError, "shape (1,)", "(2,)"),
    ("x0: a batch", {"x0": Gaussian(np.ones((3, 2)), np.zeros((3, 2, 2)))}, ValueError, "shape (3, 2)", "(2,)"),
    *[(f"x0: {what}", {"x0": given}, FloatingPointError, words) for what, (given, words) in GREAT.items()],
]
WRONG_MODES = [
    ("modes: None", {"modes": None}, TypeError, "modes must be a ModeSet (see close_loops), not a NoneType"),
    ("modes: matrices", {"modes": [np.eye(2)]}, TypeError, "modes must be a ModeSet", "list"),
    ("modes: a schedule", {"modes": PLAN}, TypeError, "modes must be a ModeSet", "Schedule"),
]
WRONG_METHOD = [
    (f"method: {what}", {"method": given}, TypeError, "method must be a Method", words)
    for what, given, words in (
        ("a number", 3, "not 3"),
        ("the class", Rollout, "Rollout"),
        ("a text", "rollout", "'rollout'"),
    )
]
UNSTABLE, LONE = ModeSet([[[2.0]]]), Gaussian([1.0], ONE)


def state():
    return {"modes": MODES, "x0": X0}


def nothing():
    return {}


def cost(**given):
    return schedule(**given).cost


def sequence(**given):
    return Schedule(**given).sequence
