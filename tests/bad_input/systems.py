"""Rows of `scheduler_system` and `switched_controller`, and of what the blocks are fed with."""

import control
import numpy as np
from pair import modes

from bad_input.table import plant, refused
from switchctl import (
    Gaussian,
    ModeSet,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    close_loops,
    scheduler_system,
    switched_controller,
)

GAINS = {"a": [[3.0, 2.0]], "b": [[1.0, 1.0]]}
NOISES = {"W": np.eye(2), "V": [[1e-6]], "cost": "average"}


def loops(**keywords):
    return close_loops(plant(), GAINS, 0.5, **keywords)


def filtered():
    measured = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    return close_loops(measured, GAINS, 0.5, estimator="kalman", **NOISES)


SHARED = [
    ("no method", {"method": None}, TypeError, "method must be a Method such as RecedingHorizon", "not None"),
    ("a name as method", {"method": "Rollout"}, TypeError, "method must be a Method", "not 'Rollout'"),
    (
        "the class of a method",
        {"method": Rollout},
        TypeError,
        "method must be a Method",
        "rollout.Rollout'>",
    ),
    ("no modes", {"modes": None}, TypeError, "modes must be", "not a NoneType"),
    ("matrices as modes", {"modes": np.ones((2, 2, 2))}, TypeError, "modes must be", "not a ndarray"),
    (
        "a graph as modes",
        {"modes": lambda: SwitchingGraph(modes())},
        TypeError,
        "modes must be",
        "not a SwitchingGraph",
    ),
    ("the class of modes", {"modes": ModeSet}, TypeError, "modes must be", "not a type"),
    ("a word as rules", {"rules": "dwell"}, TypeError, "rules must be Rules(..), not 'dwell'"),
    ("the class of rules", {"rules": Rules}, TypeError, "rules must be Rules(..)"),
    ("a graph of other modes", {"rules": lambda: SwitchingGraph(modes())}, ValueError, "SwitchingGraph of other modes"),
    ("a number as name", {"name": 3}, TypeError, "name must be a non-empty string, not 3"),
    ("no name", {"name": None}, TypeError, "name must be a non-empty string, not None"),
    ("an empty name", {"name": ""}, TypeError, "name must be a non-empty string, not ''"),
    ("a dot in the name", {"name": "a.b"}, ValueError, "name 'a.b'", "not allowed"),
    ("unknown keyword", {"order": 2}, TypeError, "order"),
]


def one():
    return Gaussian([1.0, 1.0], np.eye(2))


def decide(inputs, state=(0, 0), covariance=False):
    return scheduler_system(Rollout(), modes(), covariance=covariance).output(0, np.array(state, float), inputs)


def control_with(inputs, state, estimated=False):
    block = switched_controller(Rollout(), filtered() if estimated else loops())
    return block.output(0, np.array(state, float), inputs)


ROWS = [
    *refused(
        "scheduler_system",
        scheduler_system,
        lambda: {"method": Rollout(), "modes": loops()},
        *SHARED,
        ("a word as covariance", {"covariance": "yes"}, TypeError, "covariance must be True or False, not 'yes'"),
        ("a number as covariance", {"covariance": 1}, TypeError, "covariance must be True or False, not 1"),
        ("a state called index", {"modes": lambda: modes(states=["index", "v"])}, ValueError,
         "called 'index'", "rename"),
        ("states alike but for dots", {"modes": lambda: modes(states=["a.b", "a_b"])}, ValueError, "called 'a_b'"),
        ("rules for other modes", {"rules": Rules(start=("c", 1))}, KeyError, "'c'"),
    ),
    *refused(
        "scheduler_system",
        decide,
        dict,
        ("NaN in the block's mean", {"inputs": [1.0, np.nan]}, ValueError, "mean[1] is nan"),
        ("a mean beyond the range", {"inputs": [1e200, 1.0]}, FloatingPointError, "the second moment exceeds", "scale"),
        ("an indefinite covariance", {"inputs": [1, 1, 1, 2, 2, 1], "covariance": True}, ValueError,
         "cov is not", "-1"),
        ("a memory of no node", {"inputs": [1, 1], "state": [7, 0]}, ValueError, "expected a node below 1"),
        ("a memory of no mode", {"inputs": [1, 1], "state": [0, 3]}, ValueError, "counted from 1, up to 2"),
        ("part of a node", {"inputs": [1, 1], "state": [0.5, 0]}, ValueError, "memory[0] is 0.5"),
        ("NaN as memory", {"inputs": [1, 1], "state": [0, np.nan]}, ValueError, "memory[1] is nan"),
    ),
    *refused(
        "switched_controller",
        switched_controller,
        lambda: {"method": Rollout(), "modes": loops()},
        *SHARED,
        ("modes without controllers", {"modes": lambda: modes()}, TypeError, "a plain ModeSet", "knows no plant"),
        ("a schedule as modes", {"modes": lambda: Schedule(loops(), one(), [0])}, TypeError, "not a Schedule"),
        ("loops in continuous time", {"modes": lambda: loops(discretize="closed_loop")}, ValueError,
         'discretize="plant"'),
    ),
    *refused(
        "switched_controller",
        control_with,
        dict,
        ("NaN in the block's state", {"inputs": [1.0, 1.0], "state": [np.nan, 0]}, ValueError, "state[0] is nan"),
        ("NaN as a state measured", {"inputs": [1.0, np.nan], "state": [0, 0]}, ValueError, "inputs[1] is nan"),
        ("a state beyond the range", {"inputs": [1e200, 1.0], "state": [0, 0]}, FloatingPointError, "scale the state"),
        ("NaN as an output that a filter measures", {"inputs": [np.nan], "state": np.zeros(4), "estimated": True},
         ValueError, "inputs[0] is nan"),
        ("an output beyond the range", {"inputs": [1.5e308], "state": [0, 0, 0, 0], "estimated": True},
         FloatingPointError, "exceeds the floating-point range"),
    ),
]  # fmt: skip
