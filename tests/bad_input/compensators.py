"""Rows of `close_loops` for compensators, filters, and loops that aren't well-posed."""

import control
import numpy as np
from control import ControlDimension

from bad_input.arrays import faults
from bad_input.loops import LEAD, first_order, measured
from bad_input.table import refused
from switchctl import close_loops


def dynamic():
    return {"plant": measured(), "controllers": {"lead": LEAD, "gain": [[3.0, 2.0]]}, "dt": 0.1}


def twenty():
    return control.ss(0.5 * np.eye(20), np.ones((20, 1)), np.ones((1, 20)), 0, 0.1)


def filtered():
    noises = {"W": np.eye(2), "V": [[0.5]], "cost": "average"}
    return {"plant": measured(), "controllers": {"gain": [[3.0, 2.0]]}, "dt": 0.1, "estimator": "kalman", **noises}


DYNAMIC = [
    ("a frequency above the last", {"sampling": ("tustin", 40.0)}, ValueError, "below pi / dt = 31.4"),
    ("NaN as frequency", {"sampling": ("tustin", np.nan)}, ValueError, "the frequency in sampling is nan"),
    ("a word as frequency", {"sampling": ("tustin", "6")}, TypeError, "the frequency in sampling must be a number"),
    ("an unknown way with one", {"sampling": ("matched", 6.0)}, ValueError, "sampling is 'matched'; expected"),
    ("no way", {"sampling": {"lead": None}}, TypeError, "sampling is None; expected a method such as 'tustin'"),
    ("a tracking gain alone", {"controllers": {"lead": LEAD}, "inactive": ("track", np.eye(2))}, ControlDimension,
     "the tracking gain of controllers['lead'] has shape (2, 2); expected (1, 1)"),
    ("an unstable tracking gain", {"inactive": ("track", [[100.0]])}, ValueError,
     "leaves controllers['lead'] unstable"),
    ("a reset of other states", {"inactive": ("reset", [[1.0]])}, ControlDimension,
     "has shape (1, 1); expected (1, 2)"),
    ("NaN as reset", {"inactive": ("reset", [[1.0, np.nan]])}, ValueError,
     "the reset of controllers['lead'][0, 1] is nan"),
    ("a gain to hold", {"inactive": ("hold", [[1.0]])}, ValueError, "inactive of controllers['lead'] is ('hold'"),
    ("an initial state of others", {"initial": np.eye(2)}, ControlDimension,
     "(2, 2); expected (1, 2), states by plant's"),
    ("an integrator settled", {"controllers": {"i": control.tf([1], [1, 0])}, "initial": "settled"}, ValueError,
     "controllers['i'] can't start settled"),
    ("negative noise", {"V": -1.0}, ValueError, "V is not positive semidefinite: its least eigenvalue is -1"),
    ("noise of another output", {"V": np.eye(2)}, ControlDimension, "V has shape (2, 2); expected (1, 1)"),
    ("noise in continuous time", {"V": 1.0, "discretize": "closed_loop"}, ValueError, "V and estimator are of samples"),
]  # fmt: skip
FILTERS = [
    ("an unknown estimator", {"estimator": "kalmann"}, ValueError, "estimator is 'kalmann'; expected 'kalman'"),
    ("no V", {"V": None}, ValueError, "estimator='kalman' needs V", "positive definite"),
    ("V of nothing", {"V": 0.0}, ValueError, "estimator='kalman' needs V", "positive definite"),
    ("no W", {"W": None}, ValueError, "(give W)"),
    ("several W", {"controllers": [[[3.0, 2.0]], [[1.0, 1.0]]], "W": [np.eye(2), 2 * np.eye(2)]}, ValueError, "one W"),
    ("a gain that doesn't converge", {"estimator": np.zeros((2, 1))}, ValueError,
     "doesn't converge", "spectral radius 1"),
    ("what the output doesn't show", {"plant": lambda: control.ss(np.diag([1, -1]), np.ones((2, 1)), [[0, 1]], 0)},
     ValueError, "the plant may have an unstable state that its output doesn't show"),
    ("a start that isn't known", {"controllers": [control.ss(-1, [[1, 1]], 1, 0)], "initial": "settled"}, ValueError,
     "initial of controllers['C0'] must be 'zero': it is fed by an estimate"),
]  # fmt: skip
ILL = [
    ("an ill-posed loop", {"D": -1.0}, ValueError, "controllers['C0'] is ill-posed", "condition number inf"),
    (
        "a nearly ill-posed loop",
        {"D": -1 + 1e-10},
        ValueError,
        "controllers['C0'] is ill-posed",
        "condition number 2e+10",
    ),
    ("a feedthrough beyond the range", {"D": 1e308, "K": 1e300}, ValueError, "controllers['C0'] is ill-posed", "inf"),
]

ROWS = [
    *refused("close_loops", close_loops, dynamic, *((f"{what} of a compensator", *rest) for what, *rest in DYNAMIC)),
    *refused("close_loops", close_loops, filtered, *FILTERS, *faults("estimator", np.ones((2, 1)))[:4]),
    *refused("close_loops", lambda D, K=1.0: close_loops(first_order(D), [control.tf([K], [1])], 0.1), dict, *ILL),
    *refused(
        "close_loops",
        lambda count: close_loops(first_order(dt=0.1, A=0.5), [twenty()] * count, inactive="reset"),
        dict,
        ("too many states", {"count": 60}, MemoryError, "60 controllers with 1200 states", "1.25e+11 bytes"),
    ),
]  # fmt: skip
