"""Rows of running schedulers, and of methods of one's own that return nonsense."""

import math

import numpy as np

from bad_input.table import modes, refused, same, state_of, x0
from bad_input.values import SAME_ARRAYS, wrong_arrays
from switchctl import (
    FewSwitches,
    Method,
    ModeSet,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Scheduler,
    SwitchingGraph,
    schedule,
)
from switchctl.methods import least_cost

SAMPLES = [([1.0, 1.0], 0.01 * np.eye(2)), ([0.9, 0.4], None), ([0.5, -0.3], 0.02 * np.eye(2)), ([0.1, 0.1], None)]
METHODS = [Rollout(), RecedingHorizon(10, 3), RecedingHorizon(10, 2, 0.1), FewSwitches(1), Refine()]
ONE_STATE = ModeSet([[[0.5]], [[0.9]]])


class Deciding(Scheduler):
    """Decides whatever it is told."""

    decision = 0

    def decide(self, S):
        return self.decision


class Told(Method):
    """Starts whatever it is told."""

    def __init__(self, started):
        self.started = started

    def start(self, graph):
        if self.started is not Deciding:
            return self.started
        return Deciding(graph)


def deciding(decision):
    scheduler = Deciding(SwitchingGraph(modes(), Rules(transitions={"fast": ["fast"], "calm": ["calm"]})))
    scheduler.step([1.0, 1.0])
    scheduler.decision = decision
    return scheduler.step([1.0, 1.0])


def after_a_step(method, name):
    """A call of a started scheduler's function."""

    def call(**given):
        scheduler = method.start(modes())
        scheduler.step([1.0, 1.0])
        return getattr(scheduler, name)(**given)

    return call


def refused_midway(method, **given):
    """A refused step in a run: it must leave the scheduler as it was, and the decisions as they would have been."""
    undisturbed, scheduler = method.start(modes()), method.start(modes())
    refusal = None
    for sample in SAMPLES:
        before = state_of(scheduler.memory), scheduler.lengthened
        try:
            scheduler.step(**given)
        except (ValueError, TypeError, FloatingPointError) as error:
            refusal = error
        assert (state_of(scheduler.memory), scheduler.lengthened) == before
        assert scheduler.step(*sample) == undisturbed.step(*sample)
    raise refusal


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


MOMENT = [(what.replace("S: ", ""), *row) for what, *row in wrong_arrays("S")]
FINITE_MOMENT = [row for row in MOMENT if row[0] not in ("asymmetric", "indefinite")]

ROWS = [
    *[
        row
        for method in METHODS
        for row in refused(
            "Scheduler.step",
            lambda method=method, **given: refused_midway(method, **given),
            step,
            (f"NaN midway, {method!r}", {"mean": [np.nan, 1.0]}, ValueError, "mean[0] is nan"),
            (
                f"a second moment beyond the range midway, {method!r}",
                {"mean": [1e200, 1.0]},
                FloatingPointError,
                "scale",
            ),
            (f"an indefinite cov midway, {method!r}", {"cov": -np.eye(2)}, ValueError, "cov", "eigenvalue is -1"),
            (f"too few states midway, {method!r}", {"mean": [1.0]}, ValueError, "mean has shape (1,)", "(2,)"),
        )
    ],
    *refused(
        "Scheduler.step",
        after_a_step(Rollout(), "step"),
        step,
        *wrong_arrays("cov"),
        ("mean: a number", {"mean": 1.0}, ValueError, "mean has shape ()", "expected (2,)"),
        ("mean: a column", {"mean": [[1.0], [1.0]]}, ValueError, "mean has shape (2, 1)", "expected (2,)"),
        ("mean: None", {"mean": None}, TypeError, "mean must hold real numbers"),
        ("mean: texts", {"mean": ["1", "1"]}, TypeError, "mean must hold real numbers"),
        ("mean: booleans of the wrong shape", {"mean": True}, ValueError, "mean has shape ()"),
        ("an unknown keyword", {"covariance": 1}, TypeError, "covariance"),
    ),
    *same(
        "Scheduler.step",
        after_a_step(Rollout(), "step"),
        lambda: {"mean": [2.0, -2.0], "cov": 2 * np.eye(2)},
        *[(f"cov: {what}", {"cov": value}) for what, value in SAME_ARRAYS.items()],
        ("mean: integers", {"mean": np.array([2, -2], dtype=np.int8)}),
        ("mean: float32", {"mean": np.array([2, -2], dtype=np.float32)}),
        ("mean: strided", {"mean": lambda: np.array([2.0, 9.0, -2.0])[::2]}),
    ),
    *refused("Scheduler", Deciding, nothing, ("no modes", {"graph": None}, TypeError, "ModeSet", "NoneType")),
    *refused("Scheduler", Deciding, nothing, ("matrices", {"graph": [np.eye(2)]}, TypeError, "ModeSet(matrices)")),
    *refused(
        "Scheduler.decide",
        deciding,
        nothing,
        *[
            (what, {"decision": decision}, error, "Deciding", words)
            for what, decision, error, words in (
                ("NaN", math.nan, TypeError, "not nan"),
                ("a float", 1.0, TypeError, "not 1.0"),
                ("None", None, TypeError, "not None"),
                ("a boolean", True, TypeError, "not True"),
                ("an array", np.array([0]), TypeError, "array([0])"),
                ("out of range", 2, IndexError, "mode 2 is out of range"),
                ("nowhere", -1, IndexError, "returned -1"),
                ("an unknown name", "slow", KeyError, "'slow'"),
                ("a mode not allowed", 1, ValueError, "'calm' is not allowed"),
            )
        ],
    ),
    *refused(
        "Method.start",
        lambda started: schedule(modes(), x0(), Told(started), 3),
        nothing,
        *[
            (what, {"started": started}, TypeError, "Told.start must return a Scheduler")
            for what, started in (("None", None), ("NaN", math.nan), ("a mode", 1), ("a method", Rollout()))
        ],
    ),
    *refused("Method", Method, nothing, ("itself", {}, TypeError, "abstract")),
    *refused(
        "Scheduler.choose",
        after_a_step(Rollout(), "choose"),
        lambda: {"S": np.eye(2)},
        *MOMENT,
    ),
    *same(
        "Scheduler.choose",
        after_a_step(Rollout(), "choose"),
        lambda: {"S": 2 * np.eye(2)},
        *[(what, {"S": value}) for what, value in SAME_ARRAYS.items()],
    ),
    *refused(
        "Scheduler.cheapest_way", after_a_step(Rollout(), "cheapest_way"), lambda: {"S": np.eye(2)}, *FINITE_MOMENT
    ),
    *refused(
        "Scheduler.tail",
        after_a_step(Rollout(), "tail"),
        lambda: {"S": np.eye(2)},
        *[row for row in FINITE_MOMENT if row[0] in ("NaN", "texts", "of another shape")],
    ),
    *refused(
        "Scheduler.tail",
        lambda method: method.start(modes()).tail(np.eye(2)),
        nothing,
        ("before a step", {"method": Told(Deciding)}, ValueError, "no step has been taken"),
        ("before a plan", {"method": FewSwitches(1)}, ValueError, "no step has been taken"),
    ),
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
