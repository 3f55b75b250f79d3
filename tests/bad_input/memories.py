"""Rows of what running schedulers remember, and of the least cost."""

import numpy as np
from pair import modes

from bad_input.table import refused, same
from switchctl import (
    FewSwitches,
    RecedingHorizon,
    Scheduler,
)
from switchctl.methods import least_cost

SAMPLES = [([1.0, 1.0], 0.01 * np.eye(2)), ([0.9, 0.4], None), ([0.5, -0.3], 0.02 * np.eye(2)), ([0.1, 0.1], None)]


class Deciding(Scheduler):
    """Decides whatever it is told."""

    decision = 0

    def decide(self, S):
        return self.decision


def assigned(method, change):
    """A wrong memory: refused, and the scheduler where it was."""
    scheduler = method.start(modes())
    scheduler.step([1.0, 1.0])
    memory = scheduler.memory
    try:
        scheduler.memory = change(memory.copy())
    finally:
        np.testing.assert_equal(scheduler.memory, memory)


def changed(place, value):
    def change(memory):
        memory[place] = value
        return memory

    return change


def none_of(memory):
    return memory[:0]


def started_again(reset):
    """The decisions of a scheduler that may have had a run before."""
    scheduler = RecedingHorizon(10, 3).start(modes())
    if reset:
        scheduler.step([0.0, 5.0])
        scheduler.reset()
    return [scheduler.step(*sample) for sample in SAMPLES]


def step():
    return {"mean": [1.0, 1.0]}


def nothing():
    return {}


def at_start(name):
    return lambda **given: getattr(Deciding(modes()), name)(**given)


ROWS = [
    *refused(
        "Scheduler.recover",
        at_start("recover"),
        nothing,
        ("None", {"sequence": None}, TypeError, "sequence must be a sequence of modes, not None"),
        ("a text", {"sequence": "fast"}, TypeError, "sequence must be a sequence of modes, not 'fast'"),
        ("bytes", {"sequence": b"\x00"}, TypeError, "sequence"),
        ("a dict", {"sequence": {0: 1}}, TypeError, "sequence"),
        ("a set", {"sequence": {0, 1}}, TypeError, "sequence"),
        ("a float", {"sequence": [0, 1.0]}, TypeError, "sequence[1]", "1.0"),
        ("out of range", {"sequence": [0, 2]}, IndexError, "sequence[1]", "mode 2"),
        ("an unknown name", {"sequence": ["slow"]}, KeyError, "sequence[0]", "'slow'"),
    ),
    *refused(
        "Scheduler.recall",
        at_start("recall"),
        nothing,
        ("None", {"values": None}, TypeError, "values"),
        ("more than remembered", {"values": [1.0]}, ValueError, "values has shape (1,)", "(0,)"),
    ),
    *refused(
        "Scheduler.recall",
        assigned,
        lambda: {"method": RecedingHorizon(10, 3)},
        ("a node that is not there", {"change": changed(0, 7)}, ValueError, "a node below 1"),
        ("half a node", {"change": changed(0, 0.5)}, ValueError, "memory[0] is 0.5"),
        ("a mode that is not there", {"change": changed(1, 3)}, ValueError, "up to 2"),
        (
            "another mode and an update below 0",
            {"change": changed(slice(1, 3), [1, -1])},
            ValueError,
            "values[0] is -1",
        ),
        ("an update below 0", {"change": changed(2, -1)}, ValueError, "values[0] is -1"),
        ("half a mode to come", {"change": changed(3, 0.5)}, ValueError, "values[1] is 0.5"),
        ("a mode to come that is not there", {"change": changed(3, 9)}, ValueError, "modes to come"),
        ("a gap in the modes to come", {"change": changed(3, 0)}, ValueError, "then zeros"),
        ("NaN", {"change": changed(2, np.nan)}, ValueError, "memory[2] is nan"),
        ("too few numbers", {"change": none_of}, ValueError, "memory has shape (0,)"),
        (
            "more steps left than may be",
            {"method": RecedingHorizon(10, 3, 0.1), "change": changed(3, 1e6)},
            ValueError,
            "at most 100,000 steps",
        ),
        (
            "an indefinite moment of a plan",
            {"method": FewSwitches(1), "change": changed(3, -1.0)},
            ValueError,
            "least eigenvalue",
        ),
        (
            "half a step of a plan",
            {"method": FewSwitches(1), "change": changed(2, 0.5)},
            ValueError,
            "values[0] is 0.5",
        ),
    ),
    *refused("Scheduler.reset", at_start("reset"), nothing, ("an argument", {"node": 1}, TypeError, "node")),
    *same(
        "Scheduler.reset",
        started_again,
        lambda: {"reset": False},
        ("begins anew", {"reset": True}),
    ),
    *refused(
        "least_cost",
        least_cost,
        lambda: {"costs": np.array([2.0, 1.0])},
        ("NaN", {"costs": np.array([1.0, np.nan])}, FloatingPointError, "candidate 1 is nan"),
        ("infinite", {"costs": np.array([np.inf, 1.0])}, FloatingPointError, "candidate 0 is inf"),
        ("none", {"costs": np.array([])}, ValueError, "no candidate"),
        ("none allowed", {"allowed": np.array([False, False])}, ValueError, "no candidate that is allowed"),
        ("None", {"costs": None}, TypeError, "costs", "None"),
        ("texts", {"costs": ["1", "2"]}, TypeError, "costs must be a row of real numbers"),
        ("complex", {"costs": np.array([1j])}, TypeError, "costs must be a row of real numbers"),
        ("a number", {"costs": 1.0}, TypeError, "one a candidate"),
        ("a matrix", {"costs": np.eye(2)}, TypeError, "one a candidate"),
        ("allowed: too few", {"allowed": np.array([True])}, ValueError, "2 booleans"),
        ("allowed: indices", {"allowed": np.array([0, 1])}, ValueError, "2 booleans"),
        ("allowed: a text", {"allowed": "ab"}, ValueError, "2 booleans"),
    ),
    *same(
        "least_cost",
        least_cost,
        lambda: {"costs": np.array([2.0, 1.0, 1.0])},
        ("a list", {"costs": [2, 1, 1]}),
        ("float32", {"costs": np.array([2, 1, 1], dtype=np.float32)}),
        ("less by rounding", {"costs": np.array([2.0, 1.0, 1.0 - 1e-15])}),
        ("NaN that is not allowed", {"costs": np.array([np.nan, 1.0, 2.0]), "allowed": np.array([False, True, True])}),
    ),
]
