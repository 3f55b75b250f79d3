"""Rows of running schedulers, and of methods of one's own that return nonsense."""

import math

import numpy as np
from pair import modes, x0

from bad_input.table import refused, same, state_of
from bad_input.values import SAME_ARRAYS, wrong_arrays
from switchctl import (
    FewSwitches,
    Method,
    Optimal,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Scheduler,
    SwitchingGraph,
    schedule,
)

SAMPLES = [([1.0, 1.0], 0.01 * np.eye(2)), ([0.9, 0.4], None), ([0.5, -0.3], 0.02 * np.eye(2)), ([0.1, 0.1], None)]
METHODS = [Rollout(), RecedingHorizon(10, 3), RecedingHorizon(10, 2, 0.1), FewSwitches(1), Refine()]


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


def refused_midway(method, times=None, **given):
    """A refused step in a run: it must leave the scheduler as it was, and the decisions as they would have been."""
    undisturbed, scheduler = method.start(modes()), method.start(modes())
    refusal = None
    for sample in SAMPLES[:times]:
        before = state_of(scheduler.memory), scheduler.lengthened
        try:
            scheduler.step(**given)
        except (ValueError, TypeError, FloatingPointError) as error:
            refusal = error
        assert (state_of(scheduler.memory), scheduler.lengthened) == before
        assert scheduler.step(*sample) == undisturbed.step(*sample)
    raise refusal


def step():
    return {"mean": [1.0, 1.0]}


def nothing():
    return {}


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
        lambda **given: refused_midway(Optimal(gap=0.9), 1, **given),
        step,
        ("a moment too great to plan for", {"mean": [1e100, 1.0]}, FloatingPointError, "too great to be searched with"),
    ),
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
]
