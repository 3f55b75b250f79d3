"""Rows of comparisons, sweeps and trade-offs."""

import math
from itertools import count

import numpy as np
from pair import modes

from bad_input.plans import MODES, PLAN, WRONG_METHOD, WRONG_MODES, WRONG_X0, state
from bad_input.table import refused, same
from switchctl import (
    Budget,
    Comparison,
    Constant,
    Rollout,
    Rules,
    SwitchingGraph,
    compare,
    sweep,
    trade_off,
)


def tried():
    return {**state(), "horizons": [1], "holds": [1], "steps": 3}


def traded():
    return {**state(), "values": [0.1], "method": Constant(1)}


ROWS = [
    *refused(
        "compare",
        compare,
        lambda: {**state(), "methods": Rollout(), "steps": 3},
        *WRONG_MODES,
        *WRONG_X0[:5],
        ("methods: None", {"methods": None}, TypeError, "methods must be a sequence of methods, not None"),
        ("methods: a text", {"methods": "rollout"}, TypeError, "methods must be a sequence of methods"),
        ("methods: none", {"methods": []}, ValueError, "methods is empty"),
        ("methods: the class", {"methods": [Rollout]}, TypeError, "method must be a Method"),
        ("methods: without an end", {"methods": lambda: (Rollout() for _ in count())}, ValueError, "more than 1,000"),
        ("methods: twice the same", {"methods": [Rollout(), Rollout()]}, ValueError, "two that read Rollout()"),
        ("methods: a mode's name", {"methods": {"calm": Rollout()}}, ValueError, "'calm'", "another label"),
        ("methods: a number for a label", {"methods": {1: Rollout()}}, TypeError, "labels are strings"),
        ("steps: 0", {"steps": 0}, ValueError, "steps is 0"),
        ("rules: a dict", {"rules": {}}, TypeError, "rules must be Rules(..)"),
    ),
    *refused(
        "Comparison",
        Comparison,
        lambda: {**state(), "schedules": {"plan": PLAN}},
        *WRONG_MODES,
        *WRONG_X0[:5],
        ("schedules: None", {"schedules": None}, TypeError, "schedules must be a dict", "None"),
        ("schedules: a list", {"schedules": [PLAN]}, TypeError, "schedules must be a dict"),
        ("schedules: none", {"schedules": {}}, TypeError, "at least one schedule"),
        ("schedules: a method", {"schedules": {"plan": Rollout()}}, TypeError, "schedules['plan'] is Rollout()"),
        ("schedules: of other modes", {"modes": modes()}, ValueError, "schedules['plan'] is of other modes"),
    ),
    *refused(
        "sweep",
        sweep,
        tried,
        *WRONG_MODES,
        *WRONG_X0[:5],
        *[
            (f"{name}: {what}", {name: given}, error, name, words)
            for name in ("horizons", "holds")
            for what, given, error, words in (
                ("None", None, TypeError, "must be a sequence of settings to try, not None"),
                ("a number", 3, TypeError, "not 3"),
                ("a text", "3", TypeError, "not '3'"),
                ("bytes", b"3", TypeError, "not b'3'"),
                ("none", [], ValueError, "at least one setting"),
                ("without an end", lambda: count(1), ValueError, "more than 1,000 entries"),
            )
        ],
        ("horizons: 0", {"horizons": [3, 0]}, ValueError, "horizon is 0"),
        ("holds: half", {"holds": [0.5]}, ValueError, "hold is 0.5"),
        ("decrease: 1", {"decrease": 1}, ValueError, "decrease is 1.0"),
        ("steps: None as a text", {"steps": "all"}, TypeError, "steps must be a whole number, not 'all'"),
    ),
    *same(
        "sweep",
        lambda **given: repr(sweep(**given)),
        tried,
        ("whole floats", {"horizons": [1.0], "holds": [1.0]}),
        ("arrays", {"horizons": np.array([1]), "holds": np.array([1.0])}),
        ("generators", {"horizons": lambda: iter([1]), "holds": lambda: iter([1])}),
    ),
    *refused(
        "trade_off",
        trade_off,
        traded,
        *WRONG_MODES,
        *WRONG_X0[:5],
        *WRONG_METHOD,
        ("rules: a graph", {"rules": SwitchingGraph(MODES)}, TypeError, "of which one is varied", "SwitchingGraph"),
        ("over: another rule", {"over": "price"}, ValueError, "over is 'price'", "'min_dwell'"),
        ("over: None", {"over": None}, ValueError, "over is None"),
        ("over: a budget that isn't there", {"over": "budget"}, ValueError, "the rules have none"),
        ("values: a number", {"values": 3}, TypeError, "values must be a sequence of settings, not 3"),
        ("values: a text", {"values": "3"}, TypeError, "values must be a sequence of settings"),
        ("values: none", {"values": []}, ValueError, "values is empty"),
        ("values: without an end", {"values": lambda: count()}, ValueError, "values has more than 1,000 entries"),
        ("values: None", {"values": [0.1, None]}, TypeError, "values[1] must be a number, not None"),
        ("values: NaN", {"values": [math.nan]}, ValueError, "values[0] is nan"),
        ("values: negative", {"values": [-1.0]}, ValueError, "switch_cost is -1.0"),
        ("values: half a step", {"values": [2.5], "over": "min_dwell"}, ValueError, "values[0] is 2.5"),
        (
            "values: an infinite limit",
            {"values": [math.inf], "over": "budget", "rules": Rules(budget=Budget(use=0, limit=1))},
            ValueError,
            "limit is inf",
        ),
    ),
]
