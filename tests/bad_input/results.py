"""Rows of `Schedule`."""

import math
import os
import tempfile
from pathlib import Path

import numpy as np
from pair import modes

from bad_input.plans import MODES, ONE, PLAN, WRONG_MODES, WRONG_X0, X0, nothing, sequence
from bad_input.table import refused, same
from bad_input.values import whole_numbers, wrong_arrays, wrong_numbers
from switchctl import (
    Gaussian,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
)

WRONG_PATHS = [
    (f"path: {what}", {"path": given}, TypeError, "path must be a str or a pathlib.Path")
    for what, given in (("None", None), ("a number", 0), ("bytes", b"file"), ("a list", ["file"]), ("empty", ""))
]
NO_FOLDER = Path(tempfile.gettempdir()) / "there is no such folder" / "file"


def made():
    return {"modes": MODES, "x0": X0, "sequence": [1, 0]}


def left_alone(function):
    """Writing that is refused, into an empty folder: nothing may be left there."""

    def call(path):
        with tempfile.TemporaryDirectory() as folder:
            before = os.getcwd()
            os.chdir(folder)
            try:
                function(path)
            finally:
                left = os.listdir(folder)
                os.chdir(before)
                assert left == []

    return call


ROWS = [
    *refused(
        "Schedule",
        Schedule,
        made,
        *WRONG_MODES,
        *WRONG_X0[:5],
        *[
            (f"{name}: {what}", {name: given}, TypeError, f"{name} must be a sequence of modes", word)
            for name in ("sequence", "tail", "lead")
            for what, given, word in (
                ("None", None, "None"),
                ("a text", "fast", "'fast'"),
                ("a dict", {0: 1}, "{0: 1}"),
            )
        ],
        *[
            (f"{name}: {what}", {name: [0, given]}, error, f"{name}[1]", word)
            for name in ("sequence", "tail", "lead")
            for what, given, error, word in (
                ("out of range", 2, IndexError, "mode 2 is out of range"),
                ("a float", 1.0, TypeError, "1.0 (float)"),
                ("an unknown name", "slow", KeyError, "'slow'; the modes are fast, calm"),
            )
        ],
        ("no steps", {"sequence": []}, ValueError, "sequence is empty"),
        ("steps without an end", {"sequence": (None for _ in range(3))}, TypeError, "sequence[0]", "None"),
        ("method: no text", {"method": Rollout()}, TypeError, "method must be a text, not Rollout()"),
        ("status: no text", {"status": None}, TypeError, "status must be a text, not None"),
        ("statistics: a list", {"statistics": [1]}, TypeError, "statistics must be a dict of numbers, not [1]"),
        ("statistics: no name", {"statistics": {0: 1.0}}, TypeError, "statistics has the name 0"),
        ("statistics: a text", {"statistics": {"nodes": "7"}}, TypeError, "statistics['nodes'] must be a number"),
        ("statistics: NaN", {"statistics": {"nodes": np.nan}}, ValueError, "statistics['nodes'] is nan"),
        ("lengthened: None", {"lengthened": None}, TypeError, "lengthened must be a sequence of pairs"),
        ("lengthened: no pairs", {"lengthened": [(1, 2, 3)]}, ValueError, "pairs (step, steps added)"),
        ("lengthened: half a step", {"lengthened": [(1, 0.5)]}, ValueError, "lengthened is 0.5"),
        ("graph: rules", {"graph": Rules()}, TypeError, "graph must be a SwitchingGraph(modes, rules), not Rules()"),
        ("graph: of other modes", {"graph": SwitchingGraph(modes())}, ValueError, "graph is of other modes"),
        (
            "against the rules",
            {"graph": SwitchingGraph(MODES, Rules(min_dwell=3))},
            ValueError,
            "step 1: mode 'fast' is not allowed",
        ),
        *[row for row in wrong_numbers("lower_bound") if "None" not in row[0]],
        (
            "a lower bound above the cost",
            {"lower_bound": 1e9},
            ValueError,
            "lower_bound 1000000000.0 is above its cost",
        ),
        ("an infinite lower bound", {"lower_bound": math.inf}, ValueError, "lower_bound inf is above its cost"),
        *wrong_arrays("terminal"),
        ("terminal: with a tail", {"terminal": np.eye(2), "tail": [0]}, ValueError, "it has no tail"),
        ("target: a mean", {"target": [0.0, 0.0]}, TypeError, "target must be a Gaussian"),
        ("target: other states", {"target": Gaussian([1.0], ONE)}, ValueError, "2 states"),
    ),
    *same(
        "Schedule",
        sequence,
        made,
        ("names", {"sequence": ["calm", "fast"]}),
        ("an array", {"sequence": np.array([1, 0], dtype=np.int8)}),
        ("a tuple, from the end", {"sequence": (-1, -2)}),
        ("a generator", {"sequence": lambda: (i for i in (1, 0))}),
    ),
    *refused("Schedule.area", PLAN.area, nothing, *whole_numbers("start", 0)),
    *refused(
        "Schedule.area",
        PLAN.area,
        nothing,
        *[row for row in whole_numbers("stop", 0) if "None" not in row[0]],
        ("beyond the end", {"stop": 4}, ValueError, "stop = 4", "<= 3"),
        ("backwards", {"start": 2, "stop": 1}, ValueError, "start = 2, stop = 1"),
    ),
    *[
        row
        for name in ("to_csv", "save")
        for row in refused(
            f"Schedule.{name}",
            left_alone(getattr(PLAN, name)),
            nothing,
            *WRONG_PATHS,
            ("path: no folder", {"path": NO_FOLDER}, FileNotFoundError, "there is no folder", "create it first"),
            ("path: a folder", {"path": Path(tempfile.gettempdir())}, IsADirectoryError, "Is a directory"),
        )
    ],
    *refused("Schedule.load", Schedule.load, nothing, *WRONG_PATHS),
    *refused(
        "Schedule.load",
        Schedule.load,
        nothing,
        ("path: no file", {"path": NO_FOLDER}, FileNotFoundError, "No such file"),
        ("path: a folder", {"path": tempfile.gettempdir()}, IsADirectoryError, "Is a directory"),
    ),
    *refused("Schedule.to_pandas", PLAN.to_pandas, nothing, ("an argument", {"path": 1}, TypeError, "path")),
    *refused(
        "Schedule.plot",
        PLAN.plot,
        nothing,
        ("ax: a text", {"ax": "here"}, ValueError, "ax must be one matplotlib Axes", "'here'"),
        ("stop: a text", {"stop": "end"}, TypeError, "stop must be a whole number, not 'end'"),
        ("stop: 0", {"stop": 0}, ValueError, "stop is 0"),
        ("an unknown keyword", {"colour": 1}, TypeError, "colour"),
    ),
]
