"""Rows of `switchctl.models`: the functions that take arguments."""

import numpy as np
from control import ControlDimension

from bad_input.table import refused, same
from switchctl.models import quadrotor

MEASURED = [
    ("measured None", {"measured": None}, ValueError, "measured is None", "phi, theta, psi"),
    ("measured a name", {"measured": "p"}, ValueError, "measured is 'p'", "a list of some of phi"),
    ("measured an unknown name", {"measured": ["phi", "yaw"]}, ValueError, "'yaw'", "phi, theta, psi, p, q, r"),
    ("measured twice", {"measured": ["phi", "phi"]}, ValueError, "each once"),
    ("measured nothing", {"measured": []}, ValueError, "measured is []"),
    ("measured numbers", {"measured": [0, 1]}, ValueError, "measured is [0, 1]"),
]


def matrices(system):
    return system.A, system.B, system.C, system.D


ROWS = [
    *[row for f in (quadrotor.plant, quadrotor.nonlinear_plant) for row in refused(f.__name__, f, dict, *MEASURED)],
    *refused(
        "lead_lag",
        quadrotor.lead_lag,
        lambda: {"crossover": 3.0},
        ("crossover None", {"crossover": None}, TypeError, "crossover must be a number"),
        ("crossover True", {"crossover": True}, TypeError, "crossover must be a number"),
        ("crossover zero", {"crossover": 0}, ValueError, "crossover is 0"),
        ("crossover negative", {"crossover": -3}, ValueError, "crossover is -3"),
        ("crossover nan", {"crossover": np.nan}, ValueError, "crossover is nan"),
        ("crossover infinite", {"crossover": np.inf}, ValueError, "crossover is inf"),
        ("spread a string", {"spread": "14"}, TypeError, "spread must be a number", "'14'"),
        ("spread below one", {"spread": 0.5}, ValueError, "spread is 0.5", "from 1"),
        ("spread nan", {"spread": np.nan}, ValueError, "spread is nan"),
    ),
    *same(
        "lead_lag",
        lambda **given: matrices(quadrotor.lead_lag(**given)),
        lambda: {"crossover": 3.0},
        ("integers", {"crossover": 3, "spread": np.int64(14)}),
    ),
    *refused(
        "rotor_speeds",
        quadrotor.rotor_speeds,
        lambda: {"moments": np.zeros(3)},
        ("moments None", {"moments": None}, TypeError, "moments must hold real numbers"),
        ("moments complex", {"moments": [1j, 0, 0]}, TypeError, "moments", "complex128"),
        ("moments nan", {"moments": [0, np.nan, 0]}, ValueError, "moments[1] is nan"),
        ("four moments", {"moments": np.zeros(4)}, ControlDimension, "shape (4,)", "(3,) or (3, N)"),
        ("a number", {"moments": 1.0}, ControlDimension, "shape ()"),
    ),
    *same(
        "rotor_speeds",
        quadrotor.rotor_speeds,
        lambda: {"moments": np.array([0.0, 1.0, 0.0])},
        ("a list of integers", {"moments": [0, 1, 0]}),
    ),
    *refused(
        "modes",
        quadrotor.modes,
        dict,
        ("discretize None", {"discretize": None}, ValueError, "discretize is None", "'plant' or 'closed_loop'"),
        ("discretize unknown", {"discretize": "loop"}, ValueError, "discretize is 'loop'"),
        ("an unknown keyword", {"dt": 0.1}, TypeError, "dt"),
    ),
    *refused(
        "dynamic_modes",
        quadrotor.dynamic_modes,
        dict,
        ("discretize unknown", {"discretize": "loop"}, ValueError, "discretize is 'loop'"),
        ("inactive unknown", {"inactive": "sleep"}, ValueError, "sleep"),
    ),
]
