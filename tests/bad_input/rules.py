"""Rows of rules, budgets and the switching graph."""

import math
from itertools import count

import numpy as np
from pair import modes

from bad_input.table import refused, same
from bad_input.values import HUGE, whole_numbers, wrong_numbers
from switchctl import Budget, ContradictionError, ModeSet, Rollout, Rules, SwitchingGraph
from switchctl.limits import TooManyNodes

MODES = modes()
GRAPH = SwitchingGraph(MODES, Rules(min_dwell=2))
PER_MODE = ("min_dwell", "max_dwell", "price")
LISTS = ("a list", "None")  # which say something there
EMPTY = [(f"{name}: an empty dict", {name: {}}, ValueError, f"{name} is empty") for name in PER_MODE]
WINDOW = 10**9


def nothing():
    return {}


def used():
    return {"use": 1, "limit": 3}


def under(**rules):
    return SwitchingGraph(MODES, Rules(**rules))


def resting(argument, least=None):
    """Rows of a number, but for what it may be besides."""
    rows = wrong_numbers(argument) if least is None else whole_numbers(argument, least)
    return [row for row in rows if row[0].split(": ")[1] not in (*LISTS, "infinite")]


ROWS = [
    *refused(
        "Rules",
        Rules,
        nothing,
        *[row for name in ("min_dwell", "max_dwell") for row in resting(name, 1)],
        *[row for name in ("price", "switch_cost", "switch_cost_per_w2") for row in resting(name)],
        *[(f"{name}: negative", {name: -1}, ValueError, f"{name} is -1") for name in ("price", "switch_cost")],
        *[(f"{name}: infinite", {name: math.inf}, ValueError, f"{name} is inf") for name in ("price", "switch_cost")],
        *[row for row in whole_numbers("max_switches", 0) if "None" not in row[0]],
        *EMPTY,
        ("min_dwell: by no mode", {"min_dwell": {None: 3}}, TypeError, "the mode in min_dwell", "None"),
        ("min_dwell: NaN of a mode", {"min_dwell": {"fast": math.nan}}, ValueError, "min_dwell['fast'] is nan"),
        ("min_dwell: NaN in a list", {"min_dwell": [1, math.nan]}, ValueError, "min_dwell[1] is nan"),
        ("min_dwell: above max_dwell", {"min_dwell": 4, "max_dwell": 3}, ContradictionError, "contradict each other"),
        ("transitions: a text", {"transitions": "ab"}, TypeError, "transitions must hold real numbers"),
        ("transitions: a list", {"transitions": [1, 0]}, ValueError, "transitions has shape (2,)"),
        ("transitions: other than 0 and 1", {"transitions": [[1, 2], [0, 1]]}, ValueError, "booleans"),
        ("transitions: to a text", {"transitions": {"fast": "calm"}}, TypeError, "transitions['fast']", "'calm'"),
        ("switch_cost: a dict", {"switch_cost": {"fast": 1}}, TypeError, "switch_cost must be a number or a matrix"),
        (
            "switch_cost: negative entries",
            {"switch_cost": [[0, -1], [1, 0]]},
            ValueError,
            "switch_cost has an entry -1",
        ),
        (
            "switch_cost: NaN in a matrix",
            {"switch_cost": [[0, np.nan], [1, 0]]},
            ValueError,
            "switch_cost[0, 1] is nan",
        ),
        ("budget: a number", {"budget": 3}, TypeError, "budget must be a Budget(use=.., limit=..), not 3"),
        ("budget: half a step", {"budget": Budget(use=1, limit=3, window=2.5)}, ValueError, "window is 2.5"),
        ("start: a mode", {"start": "fast"}, TypeError, "start must be a pair (mode, age), not 'fast'"),
        ("start: bytes", {"start": b"ab"}, TypeError, "start must be a pair (mode, age)"),
        ("start: three", {"start": ("fast", 1, 2)}, TypeError, "start must be a pair"),
        ("start: no age", {"start": ("fast", 0)}, ValueError, "the age in start is 0"),
        ("start: no mode", {"start": (None, 1)}, TypeError, "the mode in start"),
        ("allowed: a list", {"allowed": [(0, 3)]}, TypeError, "allowed must be a dict"),
        ("allowed: one interval", {"allowed": {"fast": (0, 3)}}, TypeError, "allowed['fast']", "list of intervals"),
        ("allowed: backwards", {"allowed": {"fast": [(3, 1)]}}, ValueError, "(3, 1)", "empty"),
        ("allowed: NaN", {"allowed": {"fast": [(0, math.nan)]}}, ValueError, "allowed['fast'] is nan"),
        ("allowed_period: alone", {"allowed_period": 3}, ValueError, "without allowed"),
        ("time_unit: unknown", {"time_unit": "ms"}, ValueError, "time_unit is 'ms'; expected 'step' or 's'"),
        ("time_unit: None", {"time_unit": None}, ValueError, "time_unit is None"),
        (
            "min_dwell: seconds",
            {"min_dwell": 0.05},
            ValueError,
            "a whole number of steps, or seconds and time_unit='s'",
        ),
        ("an unknown rule", {"dwell": 3}, TypeError, "dwell"),
    ),
    *same(
        "Rules",
        lambda **given: repr(Rules(**given)),
        lambda: {"min_dwell": 3, "switch_cost": 0.5},
        ("whole floats", {"min_dwell": 3.0}),
        ("arrays without axes", {"min_dwell": np.array(3), "switch_cost": np.array(0.5)}),
        ("float32", {"switch_cost": np.float32(0.5)}),
    ),
    *refused(
        "Budget",
        Budget,
        used,
        *[row for name in ("use", "limit") for row in wrong_numbers(name) if "a list" not in row[0]],
        *[row for row in wrong_numbers("window") if "None" not in row[0]],
        ("use: negative", {"use": {"fast": -1}}, ValueError, "use['fast'] is -1"),
        ("use: empty", {"use": []}, ValueError, "use is empty"),
        ("limit: infinite", {"limit": math.inf}, ValueError, "limit is inf"),
        ("window: 0", {"window": 0}, ValueError, "window is 0"),
        ("window: infinite", {"window": math.inf}, ValueError, "window is inf", "None for the whole run"),
        ("without a limit", {"limit": None}, TypeError, "limit"),
    ),
    *refused(
        "SwitchingGraph",
        SwitchingGraph,
        lambda: {"modes": MODES},
        ("modes: None", {"modes": None}, TypeError, "modes must be a ModeSet"),
        ("rules: a dict", {"rules": {"min_dwell": 3}}, TypeError, "rules must be Rules(..)"),
        ("rules: a method", {"rules": Rollout()}, TypeError, "rules must be Rules(..), not Rollout()"),
    ),
    *refused(
        "SwitchingGraph",
        under,
        nothing,
        ("an unknown mode", {"min_dwell": {"slow": 3}}, KeyError, "min_dwell: no mode is named 'slow'", "fast, calm"),
        ("a mode out of range", {"min_dwell": {2: 3}}, IndexError, "min_dwell: mode 2 is out of range"),
        ("a mode told twice", {"min_dwell": {"fast": 3, 0: 3}}, ValueError, "min_dwell tells one mode twice"),
        ("a list too long", {"min_dwell": [1, 2, 3]}, ValueError, "min_dwell has 3 entries; expected 2"),
        ("a matrix too great", {"switch_cost": np.ones((3, 3))}, ValueError, "(3, 3)", "(2, 2)"),
        ("transitions that leave one out", {"transitions": {"fast": []}}, ValueError, "says nothing of mode 'calm'"),
        ("an interval of 10^12 steps", {"allowed": {"fast": [(0, 10**12)]}}, TooManyNodes, "1,000,000,000,001 steps"),
        (
            "a start that fills a window of 10^9 steps",
            {"budget": Budget(use=1, limit=WINDOW, window=WINDOW), "start": ("fast", WINDOW)},
            TooManyNodes,
            "more than 2,000,000 uses in the budget's window",
        ),
        ("a start held for too long", {"start": ("fast", 5), "max_dwell": 3}, ContradictionError, "contradict each"),
        (
            "seconds beyond counting",
            {"max_dwell": 1e300, "time_unit": "s"},
            ValueError,
            "1e+300 s is more than 9007199254740992 steps of 0.1 s",
        ),
        *[
            (
                f"{name} much shorter than a step",
                {**rule, "time_unit": "s"},
                ValueError,
                f"{name} is 1e-12 s; expected a",
            )
            for name, rule in (
                ("allowed_period", {"allowed": {"fast": []}, "allowed_period": 1e-12}),
                ("the age in start", {"start": ("fast", 1e-12)}),
            )
        ],
        ("a dwell shorter than a step", {"max_dwell": 0.01, "time_unit": "s"}, ValueError, "shorter than a step"),
    ),
    *refused(
        "SwitchingGraph",
        lambda: SwitchingGraph(ModeSet([[[0.5]]]), Rules(min_dwell=1.0, time_unit="s")),
        nothing,
        ("seconds without a period", {}, ValueError, "no sampling period"),
    ),
    *refused(
        "ContradictionError",
        under,
        nothing,
        ("a budget that runs out", {"budget": Budget(use=1, limit=3)}, ContradictionError, "budget", "at most 3 steps"),
        (
            "two rules",
            {"max_dwell": 2, "max_switches": 1},
            ContradictionError,
            "max_dwell = 2 and max_switches = 1 contradict each other",
        ),
    ),
    *refused(
        "SwitchingGraph.from_edges",
        SwitchingGraph.from_edges,
        lambda: {"modes": MODES, "edges": [("a", "a", 0)]},
        ("modes: None", {"modes": None}, TypeError, "modes must be a ModeSet"),
        ("edges: None", {"edges": None}, TypeError, "edges must be a sequence of moves (from, to, mode), not None"),
        ("edges: a text", {"edges": "aa0"}, TypeError, "edges must be a sequence"),
        ("edges: none", {"edges": []}, ValueError, "edges is empty"),
        ("edges: pairs", {"edges": [("a", "a")]}, TypeError, "edges[0] is ('a', 'a'); expected (from, to, mode)"),
        ("edges: without an end", {"edges": lambda: ((i, i + 1, 0) for i in count())}, ValueError, "more than 200,000"),
        ("edges: an unknown mode", {"edges": [("a", "a", "slow")]}, KeyError, "edges[0]: no mode is named 'slow'"),
        ("edges: no mode", {"edges": [("a", "a", None)]}, TypeError, "edges[0]", "None"),
        ("edges: a node that is a list", {"edges": [([], "a", 0)]}, TypeError, "edges[0] has the node []"),
        ("edges: a node that is NaN", {"edges": [(math.nan, "a", 0)]}, TypeError, "edges[0] has the node nan"),
        ("edges: two of one mode", {"edges": [("a", "a", 0), ("a", "b", 0)]}, ValueError, "one edge a mode"),
        ("edges: an end", {"edges": [("a", "b", 0)]}, ContradictionError, "the edges"),
        ("start: no node", {"start": "b"}, ValueError, "start is 'b', which no edge leaves"),
        ("start: a list", {"start": []}, ValueError, "start is [], which no edge leaves"),
        ("rules: a dict", {"rules": {}}, TypeError, "rules must be Rules(..)"),
    ),
    *[
        row
        for name, good in (("label", {}), ("walk", {"sequence": [0]}), ("refusal", {"mode": 1}))
        for row in refused(
            f"SwitchingGraph.{name}",
            getattr(GRAPH, name),
            lambda good=good: {**good, "node": 0},
            *[row for row in whole_numbers("node", 0) if "beyond" not in row[0]],
            ("node: out of range", {"node": len(GRAPH)}, IndexError, f"node is {len(GRAPH)}", "counted from 0"),
        )
    ],
    *refused(
        "SwitchingGraph.walk",
        GRAPH.walk,
        lambda: {"sequence": [0]},
        ("sequence: None", {"sequence": None}, TypeError, "sequence must be a sequence of modes"),
        ("sequence: a text", {"sequence": "fast"}, TypeError, "sequence must be a sequence of modes"),
        ("sequence: out of range", {"sequence": [0, 5]}, IndexError, "sequence[1]: mode 5 is out of range"),
        ("sequence: against the rules", {"sequence": [0, 1]}, ValueError, "step 1: mode 'calm' is not allowed"),
    ),
    *refused(
        "SwitchingGraph.refusal",
        GRAPH.refusal,
        lambda: {"node": 0, "mode": 0},
        ("mode: None", {"mode": None}, TypeError, "mode: a mode is given by its index or its name, not None"),
        ("mode: out of range", {"mode": HUGE}, IndexError, "mode"),
        ("mode: allowed", {}, ValueError, "mode 'fast' is allowed at node 0", "nothing refuses it"),
    ),
    *refused("SwitchingGraph.edges", GRAPH.edges, nothing, ("an argument", {"node": 1}, TypeError, "node")),
    *refused("SwitchingGraph.to_networkx", GRAPH.to_networkx, nothing, ("an argument", {"node": 1}, TypeError, "node")),
    *refused("SwitchingGraph.plot", GRAPH.plot, nothing, ("an unknown keyword", {"colour": 1}, TypeError, "colour")),
]
