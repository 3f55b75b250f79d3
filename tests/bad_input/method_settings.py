"""Rows of the methods and what they are started on."""

import math

import numpy as np
from pair import modes, x0

from bad_input.table import refused, same
from bad_input.values import HUGE, whole_numbers, wrong_numbers
from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    Policy,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    SwitchingGraph,
    schedule,
)

RESET = ModeSet([0.5 * np.eye(2)] * 2, activation=[[np.eye(2), np.diag([1.0, 0.0])], [np.eye(2)] * 2])
UNSTABLE = ModeSet([[[2.0]], [[3.0]]])
NOISY = ModeSet([[[0.5]], [[0.6]]], W=[[1.0]])
STARTED = {
    "Constant": Constant(0),
    "PointwiseMinimum": PointwiseMinimum(),
    "RecedingHorizon": RecedingHorizon(5),
    "Rollout": Rollout(),
    "FewSwitches": FewSwitches(1),
    "Refine": Refine(),
    "Optimal": Optimal(),
}
FOREIGN = {
    "None": None,
    "matrices": [np.eye(2)],
    "a schedule": schedule(modes(), x0(), Rollout(), 2),
    "the class": ModeSet,
    "rules": Rules(),
}
POLICY = Optimal(gap=0.5, time_limit=1).policy(modes(), quadratics=2)


nothing = dict


def horizon():
    return {"horizon": 5}


def costs_along(**settings):
    return schedule(modes(), x0(), RecedingHorizon(**settings), 6).sequence


ROWS = [
    *[
        row
        for name, method in STARTED.items()
        for row in refused(
            f"{name}.start",
            method.start,
            nothing,
            *[(what, {"graph": given}, TypeError, "ModeSet", type(given).__name__) for what, given in FOREIGN.items()],
        )
    ],
    *refused("Policy.start", POLICY.start, nothing, ("other modes", {"graph": modes()}, ValueError, "policy is for")),
    *refused("Policy.start", POLICY.start, nothing, ("None", {"graph": None}, TypeError, "ModeSet")),
    *refused("Policy", Policy, nothing, ("nothing", {}, TypeError, "graph", "tables", "factor")),
    *refused(
        "Constant",
        Constant,
        nothing,
        *[
            (what, {"mode": mode}, TypeError, "mode must be", word)
            for what, mode, word in (
                ("None", None, "None"),
                ("NaN", math.nan, "nan"),
                ("a list", [0], "[0]"),
                ("a boolean", True, "True"),
                ("a fraction", 0.5, "0.5"),
            )
        ],
    ),
    *refused(
        "Constant.start",
        lambda mode, graph: Constant(mode).start(graph),
        lambda: {"graph": modes()},
        ("an unknown name", {"mode": "slow"}, KeyError, "'slow'", "fast, calm"),
        ("out of range", {"mode": 2}, IndexError, "mode 2", "2 modes"),
        ("below the range", {"mode": -3}, IndexError, "mode -3"),
        ("beyond the range", {"mode": HUGE}, IndexError, "out of range"),
        (
            "never held",
            {"mode": 0, "graph": SwitchingGraph(modes(), Rules(max_dwell={"fast": 3}))},
            ValueError,
            "'fast' can't be held for ever",
        ),
    ),
    *refused("PointwiseMinimum", PointwiseMinimum, nothing, ("a setting", {"horizon": 3}, TypeError, "horizon")),
    *refused("Rollout", Rollout, nothing, ("a setting", {"mode": 3}, TypeError, "mode")),
    *refused(
        "Rollout.start",
        Rollout().start,
        nothing,
        ("no Schur mode", {"graph": UNSTABLE}, ValueError, "needs a Schur mode", "A0: 2, A1: 3"),
        ("noise", {"graph": NOISY}, ValueError, "with noise the total cost for ever is infinite"),
        (
            "a mode beyond the range",
            {"graph": ModeSet([[[1e300]], [[0.5]]])},
            FloatingPointError,
            "'A0'",
            "1e+300",
            "scale the states",
        ),
    ),
    *refused(
        "RecedingHorizon",
        RecedingHorizon,
        horizon,
        *[row for row in whole_numbers("horizon", 1) if "infinite" not in row[0] and "a list" not in row[0]],
        *whole_numbers("hold", 1),
        *[row for row in wrong_numbers("decrease") if "None" not in row[0]],
        ("a long hold", {"hold": 10**9}, ValueError, "hold is 1000000000", "at most 100,000"),
        ("decrease of 1", {"decrease": 1}, ValueError, "decrease is 1.0", "between 0 and 1"),
        ("no horizon in a sequence", {"horizon": []}, ValueError, "empty sequence"),
        ("a bad horizon in a sequence", {"horizon": [3, 0]}, ValueError, "horizon[1] is 0"),
        ("NaN in an array", {"horizon": np.array([3, np.nan])}, ValueError, "horizon[1] is nan"),
        ("no horizon", {"horizon": {}}, TypeError, "horizon", "{}"),
    ),
    *refused(
        "RecedingHorizon.at",
        RecedingHorizon([3, 4]).at,
        lambda: {"j": 0},
        *whole_numbers("j", 0),
    ),
    *refused(
        "RecedingHorizon.at",
        lambda value: RecedingHorizon(lambda j: value).at(0),
        nothing,
        ("a callable's NaN", {"value": math.nan}, ValueError, "horizon(0) is nan"),
        ("a callable's None", {"value": None}, TypeError, "horizon(0)", "None"),
        ("a callable's 0", {"value": 0}, ValueError, "horizon(0) is 0"),
    ),
    *refused(
        "RecedingHorizon.start",
        lambda graph, **settings: RecedingHorizon(**settings).start(graph),
        lambda: {"graph": modes(), "horizon": 5},
        ("an infinite horizon without a Schur mode", {"graph": UNSTABLE, "horizon": math.inf}, ValueError, "Schur"),
        ("a constraint without", {"graph": UNSTABLE, "decrease": 0.1}, ValueError, "'A0' has spectral radius 2"),
        ("a constraint with noise", {"graph": NOISY, "decrease": 0.1}, ValueError, "without noise"),
        (
            "a cost beyond the range",
            {"graph": UNSTABLE, "horizon": 10**9},
            ValueError,
            "exceeds the floating-point range",
            "shorter horizon",
        ),
        (
            "rules that end every hold",
            {"graph": SwitchingGraph(modes(), Rules(max_dwell=3)), "decrease": 0.1},
            ValueError,
            "held for ever",
        ),
    ),
    *refused("FewSwitches", FewSwitches, lambda: {"max_switches": 1}, *whole_numbers("max_switches", 0)),
    *refused(
        "FewSwitches.start",
        FewSwitches(1).start,
        nothing,
        ("no Schur mode", {"graph": UNSTABLE}, ValueError, "FewSwitches(1)", "finite cost"),
        ("noise", {"graph": NOISY}, ValueError, "with noise"),
        ("an average", {"graph": ModeSet([[[0.5]]], cost="average")}, ValueError, "cost='average'"),
        ("a mode beyond the range", {"graph": ModeSet([[[1e200]], [[0.5]]])}, FloatingPointError, "'A0'", "1e+200"),
    ),
    *refused(
        "Refine",
        Refine,
        nothing,
        *[
            (what, {"base": base}, TypeError, "base must be a Method")
            for what, base in (("None", None), ("the class", Rollout), ("a text", "rollout"), ("a mode", 0))
        ],
    ),
    *refused(
        "Refine.start",
        Refine().start,
        nothing,
        ("no Schur mode", {"graph": UNSTABLE}, ValueError, "Schur"),
        ("an average", {"graph": ModeSet([[[0.5]]], cost="average")}, ValueError, "cost='average'"),
    ),
    *refused(
        "Optimal",
        Optimal,
        nothing,
        *[row for argument in ("gap", "time_limit", "memory_limit") for row in wrong_numbers(argument)],
        ("no gap", {"gap": 0}, ValueError, "gap is 0.0", "1e-9"),
        ("all of it", {"gap": 1}, ValueError, "gap is 1.0", "between 0 and 1"),
        ("no time", {"time_limit": 0}, ValueError, "time_limit is 0.0", "seconds"),
        ("no memory", {"memory_limit": -1}, ValueError, "memory_limit is -1.0", "bytes"),
        ("no callable", {"callback": 3}, TypeError, "callback must be callable, not 3"),
    ),
    *refused(
        "Optimal.start",
        Optimal().start,
        nothing,
        ("noise", {"graph": NOISY}, ValueError, "without noise", "use Rollout"),
        ("a discount", {"graph": ModeSet([[[0.5]]], cost=("discounted", 0.9))}, ValueError, "discounted"),
    ),
    *refused(
        "Optimal.policy",
        Optimal(gap=0.5).policy,
        lambda: {"modes": modes()},
        *whole_numbers("quadratics", 1),
        ("no modes", {"modes": None}, TypeError, "modes must be a ModeSet"),
        ("no rules", {"rules": {"min_dwell": 3}}, TypeError, "rules must be Rules(..)"),
        ("rules of other modes", {"rules": SwitchingGraph(modes())}, ValueError, "SwitchingGraph of other modes"),
        ("noise", {"modes": NOISY}, ValueError, "a policy is for total costs without noise"),
        ("a singular weight", {"modes": ModeSet([0.5 * np.eye(2)], Q=np.diag([1.0, 0.0]))}, ValueError, "'A0'"),
        ("a switch that loses some of the state", {"modes": RESET}, ValueError, "from 'A0' to 'A1' loses some of it"),
        ("no Schur mode", {"modes": UNSTABLE}, ValueError, "finite cost"),
    ),
    *same(
        "RecedingHorizon",
        costs_along,
        lambda: {"horizon": 5, "hold": 2},
        ("a whole float", {"horizon": 5.0}),
        ("a NumPy integer", {"horizon": np.int8(5), "hold": np.uint8(2)}),
        ("arrays without axes", {"horizon": np.array(5), "hold": np.array(2.0)}),
        ("a sequence of one", {"horizon": [5]}),
        ("an array of one", {"horizon": np.array([5.0])}),
        ("a callable", {"horizon": {0: 5, 1: 5, 2: 5}.get}),
    ),
    *same(
        "Constant",
        lambda mode: schedule(modes(), x0(), Constant(mode), 3).sequence,
        lambda: {"mode": 1},
        ("a name", {"mode": "calm"}),
        ("a mode", {"mode": modes()[1]}),
        ("from the end", {"mode": -1}),
        ("a NumPy integer", {"mode": np.int64(1)}),
    ),
    *same(
        "Rollout",
        lambda A: schedule(ModeSet(A), Gaussian(np.ones(1), np.eye(1)), Rollout(), 3).sequence,
        lambda: {"A": [[[0.5]]]},
        ("duplicate modes: the lowest index", {"A": [[[0.5]], [[0.5]]]}),
    ),
]
