"""Rows of `switchctl.plotting` and the ``plot`` methods: nothing is left open or half drawn."""

from functools import cache, wraps

import matplotlib.pyplot as plt
import numpy as np
from pair import modes, x0

from bad_input.table import refused, same
from switchctl import (
    Constant,
    Gaussian,
    ModeSet,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    compare,
    monte_carlo,
    schedule,
    sweep,
    trade_off,
)
from switchctl.certificates import certify
from switchctl.plotting import (
    plot_area,
    plot_bounds,
    plot_ellipses,
    plot_graph,
    plot_monte_carlo,
    plot_report,
    plot_schematic,
    plot_sweep,
    plot_switching,
    plot_trade_off,
    plot_tree,
    plot_w2,
)
from switchctl.stability import report, schur_stability


@cache
def plan():
    return schedule(modes(), x0(), Rollout())


@cache
def page():
    return report(ModeSet([[[0.5]]]), time_limit=1.0)


def certificate():
    return certify(schur_stability(ModeSet([[[0.5]]]))[0])


def swept():
    return sweep(modes(), x0(), [1, 2], [1])


def traded():
    return trade_off(modes(), x0(), Rules(), over="min_dwell", values=[1, 2], method=Rollout())


DRAWN = {  # what each draws, its argument, and what makes one
    plot_w2: ("data", plan),
    plot_switching: ("schedule", plan),
    plot_schematic: ("schedule", plan),
    plot_ellipses: ("schedule", plan),
    plot_area: ("comparison", cache(lambda: compare(modes(), x0(), [Rollout()]))),
    plot_sweep: ("sweep", cache(swept)),
    plot_trade_off: ("trade_off", cache(traded)),
    plot_monte_carlo: ("result", cache(lambda: monte_carlo(plan(), samples=20, seed=1))),
    plot_graph: ("graph", cache(lambda: SwitchingGraph(modes(), Rules(min_dwell=2)))),
    plot_report: ("report", page),
}
TIMED = (plot_w2, plot_switching, plot_schematic, plot_ellipses, plot_monte_carlo)
METHODS = {
    "Schedule.plot": plot_w2,
    "Comparison.plot": plot_area,
    "Sweep.plot": plot_sweep,
    "TradeOff.plot": plot_trade_off,
    "MonteCarlo.plot": plot_monte_carlo,
    "SwitchingGraph.plot": plot_graph,
    "Report.plot": plot_report,
}


def clean(function):
    """A picture that is made of axes given as a function; where it is refused nothing may be left behind."""

    @wraps(function)
    def call(**given):
        if getattr(given.get("ax"), "__module__", "") == __name__:
            given["ax"] = given["ax"]()
        figures, axes = plt.get_fignums(), list(np.atleast_1d(given.get("ax")).ravel())
        try:
            return function(**given)
        except Exception:
            assert plt.get_fignums() == figures
            assert not any(ax.has_data() or ax.get_title() for ax in axes if hasattr(ax, "has_data"))
            raise
        finally:
            plt.close("all")

    return call


def figure():
    return plt.figure()


def two_axes():
    return plt.subplots(1, 2)[1]


def polar_axes():
    return plt.figure().add_subplot(projection="polar")


def solid_axes():
    return plt.figure().add_subplot(projection="3d")


def removed_axes():
    ax = plt.subplots()[1]
    ax.remove()
    return ax


def empty_axes():
    return plt.subplots()[1]


AXES = [
    ("ax a figure", {"ax": figure}, ValueError, "ax must be one matplotlib Axes", "Figure"),
    ("ax two axes", {"ax": two_axes}, ValueError, "ax must be one matplotlib Axes"),
    ("ax a number", {"ax": 3}, ValueError, "ax must be one matplotlib Axes", "3"),
    ("ax in polar coordinates", {"ax": polar_axes}, ValueError, "ax has polar coordinates"),
    ("ax in space", {"ax": solid_axes}, ValueError, "ax has 3d coordinates"),
    ("ax removed", {"ax": removed_axes}, ValueError, "ax was removed from its figure"),
    ("legend_loc unknown", {"ax": empty_axes, "legend_loc": "top"}, ValueError, "legend_loc is 'top'", "upper right"),
    ("legend_loc a number", {"ax": empty_axes, "legend_loc": 7}, TypeError, "legend_loc must be a string", "7"),
    ("title a number with axes", {"ax": empty_axes, "title": 7}, TypeError, "title must be a string", "7"),
]
STOPS = [
    ("stop zero", {"stop": 0}, ValueError, "stop is 0", "at least 1"),
    ("stop fractional", {"stop": 1.5, "ax": empty_axes}, ValueError, "stop is 1.5", "whole number"),
    ("stop nan", {"stop": np.nan}, ValueError, "stop is nan", "whole number"),
    ("stop True", {"stop": True}, TypeError, "stop must be a whole number", "True"),
    ("stop a string", {"stop": "10"}, TypeError, "stop must be a whole number", "'10'"),
]


def good(function):
    argument, make = DRAWN[function]
    return lambda: {argument: make()}


def rows_of(function):
    name, argument = function.__name__, DRAWN[function][0]
    return refused(
        name,
        clean(function),
        good(function),
        ("nothing to draw", {argument: None}, TypeError, f"{name} draws a ", "not a NoneType"),
        ("a list of what it draws", {argument: [1]}, TypeError, f"{name} draws a ", "not a list"),
        ("modes", {argument: lambda: modes()}, TypeError, f"{name} draws a ", "not a ModeSet"),
        ("the class", {argument: Schedule}, TypeError, f"{name} draws a ", "not a type"),
        ("title a number", {"title": 7}, TypeError, "title must be a string", "7"),
        ("an unknown keyword", {"color": "red"}, TypeError, "color"),
        *(AXES if function is not plot_report else [("ax", {"ax": None}, TypeError, "ax")]),
        *(STOPS if function in TIMED else []),
    )


def method_rows(name, function):
    make = DRAWN[function][1]
    return refused(
        name,
        clean(lambda **given: make().plot(**given)),
        dict,
        ("title in a list", {"title": ["a"]}, TypeError, "title must be a string", "['a']"),
        ("unknown keyword", {"color": "red"}, TypeError, "color"),
    )


def ellipses(**given):
    return clean(plot_ellipses)(**given).lines[0, 0][0].get_xydata()


STATES = "expected two different ones of x[0], x[1]"

ROWS = [
    *[row for function in DRAWN for row in rows_of(function)],
    *[row for name, function in METHODS.items() for row in method_rows(name, function)],
    *refused(
        "Comparison.plot_area",
        clean(lambda **given: DRAWN[plot_area][1]().plot_area(**given)),
        dict,
        ("title a number", {"title": 1.5}, TypeError, "title must be a string", "1.5"),
    ),
    *refused(
        "plot_ellipses",
        clean(plot_ellipses),
        good(plot_ellipses),
        ("states None", {"states": None}, ValueError, "states is None", STATES),
        ("states a number", {"states": 1}, ValueError, "states is 1", STATES),
        ("states a name", {"states": "x[0]"}, ValueError, "states is 'x[0]'", STATES),
        ("one state", {"states": (0,)}, ValueError, "states is (0,)", STATES),
        ("a state twice", {"states": (1, "x[1]")}, ValueError, STATES),
        ("an unknown state", {"states": ("x[0]", "speed")}, ValueError, "'speed'", STATES),
        ("a state out of range", {"states": (0, 2)}, ValueError, STATES),
        ("a negative state", {"states": (0, -1)}, ValueError, STATES),
        ("states that are bools", {"states": (False, True)}, ValueError, STATES),
        ("states that are floats", {"states": (0.0, 1.0)}, ValueError, STATES),
        ("nested states", {"states": ([0], [1])}, ValueError, STATES),
        ("a single state", {"schedule": lambda: one_state()}, ValueError, "expected two different ones of x[0]"),
        ("probability None", {"probability": None}, TypeError, "probability must be a number"),
        ("probability True", {"probability": True}, TypeError, "probability must be a number"),
        ("probability nan", {"probability": np.nan}, ValueError, "probability is nan"),
        ("probability zero", {"probability": 0}, ValueError, "probability is 0", "strictly between 0 and 1"),
        ("probability one", {"probability": 1}, ValueError, "probability is 1", "strictly between 0 and 1"),
        ("probability in per cent", {"probability": 95}, ValueError, "probability is 95"),
    ),
    *same(
        "plot_ellipses",
        ellipses,
        good(plot_ellipses),
        ("states by name", {"states": ("x[0]", "x[1]")}),
        ("states in an array", {"states": np.array([0, 1], dtype=np.uint8)}),
        ("probability float32", {"probability": np.float32(0.95)}),
        ("a title", {"title": "A title", "ax": empty_axes}),
    ),
    *refused(
        "plot_schematic",
        clean(plot_schematic),
        good(plot_schematic),
        (
            "no switch",
            {"schedule": lambda: schedule(modes(), x0(), Constant(0), steps=3)},
            ValueError,
            "never switches",
        ),
    ),
    *refused(
        "plot_graph",
        clean(plot_graph),
        good(plot_graph),
        ("many nodes", {"graph": lambda: SwitchingGraph(modes(), Rules(min_dwell=40))}, ValueError, "at most 60"),
    ),
    *refused(
        "plot_tree",
        clean(plot_tree),
        lambda: {"certificate": certificate()},
        ("nothing to draw", {"certificate": None}, TypeError, "plot_tree draws a Certificate", "NoneType"),
        ("a schedule", {"certificate": lambda: plan()}, TypeError, "plot_tree draws a Certificate", "Schedule"),
        ("another kind", {}, ValueError, "of a schedule", "'mean square'"),
    ),
    *refused(
        "plot_bounds",
        clean(plot_bounds),
        lambda: {"rungs": []},
        ("no rungs", {}, TypeError, "plot_bounds draws a list of Rung, one at least"),
        ("nothing to draw", {"rungs": None}, TypeError, "plot_bounds draws a list of Rung"),
        ("a string", {"rungs": "rungs"}, TypeError, "plot_bounds draws a list of Rung"),
        ("numbers", {"rungs": [1.0, 2.0]}, TypeError, "plot_bounds draws a list of Rung"),
        ("a generator", {"rungs": lambda: iter([])}, TypeError, "plot_bounds draws a list of Rung"),
    ),
]


def one_state():
    return schedule(ModeSet([[[0.5]]]), Gaussian([1.0], [[0.0]]), Constant(0), steps=3)
