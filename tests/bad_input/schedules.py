"""Rows of `schedule` and of what single modes cost."""

import numpy as np
from pair import modes

from bad_input.plans import (
    LONE,
    MODES,
    ONE,
    TWO,
    UNSTABLE,
    WRONG_METHOD,
    WRONG_MODES,
    WRONG_X0,
    X0,
    cost,
    nothing,
    state,
)
from bad_input.table import refused, same
from bad_input.values import SAME_ARRAYS, whole_numbers, wrong_arrays
from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    SwitchingGraph,
    best_single_mode,
    schedule,
    single_mode_costs,
)


def planned():
    return {"modes": MODES, "x0": X0, "method": RecedingHorizon(3), "steps": 3}


ROWS = [
    *refused(
        "schedule",
        schedule,
        planned,
        *WRONG_MODES,
        *WRONG_X0,
        *WRONG_METHOD,
        *[row for row in whole_numbers("steps", 1) if "None" not in row[0]],
        ("steps: more than memory", {"steps": 10**12}, MemoryError, "1000000000000 steps", "3.2e+13 bytes"),
        ("rules: a dict", {"rules": {"min_dwell": 3}}, TypeError, "rules must be Rules(..), not {'min_dwell': 3}"),
        ("rules: the class", {"rules": Rules}, TypeError, "rules must be Rules(..)"),
        ("rules: of other modes", {"rules": SwitchingGraph(modes())}, ValueError, "SwitchingGraph of other modes"),
        *wrong_arrays("terminal"),
        ("terminal: without steps", {"terminal": np.eye(2), "steps": None}, ValueError, "steps=N"),
        ("target: a mean", {"target": [0.0, 0.0]}, TypeError, "target must be a Gaussian", "x0.about(point)"),
        ("target: other states", {"target": Gaussian([1.0], ONE)}, ValueError, "(1,)", "2 states"),
        ("target: without steps", {"target": X0, "steps": None}, ValueError, "steps=N"),
        ("target: with terminal", {"target": X0, "terminal": np.eye(2)}, ValueError, "a terminal weight"),
        ("target: for Rollout", {"target": X0, "method": Rollout()}, ValueError, "linear in the second moment"),
        (
            "target: a horizon that memory can't hold",
            {"target": X0, "method": RecedingHorizon(10**9)},
            MemoryError,
            "1000000000 steps would take 1.28e+11 bytes",
        ),
        (
            "a second moment too great to be searched with",
            {"x0": Gaussian([1e100, 1.0], TWO), "method": Optimal()},
            FloatingPointError,
            "too great",
        ),
        (
            "a second moment too small to be searched with",
            {"x0": Gaussian([1e-150, 0.0], TWO), "method": Optimal()},
            FloatingPointError,
            "too small",
        ),
        (
            "a run that leaves the range",
            {"modes": UNSTABLE, "x0": LONE, "method": Constant(0), "steps": 2000},
            ValueError,
            "W2 exceeds the floating-point range after step",
            "ask for at most",
        ),
        ("an unknown keyword", {"horizon": 3}, TypeError, "horizon"),
    ),
    *same(
        "schedule",
        cost,
        lambda: {**planned(), "terminal": 2 * np.eye(2)},
        *[(f"terminal: {what}", {"terminal": value}) for what, value in SAME_ARRAYS.items()],
        ("steps: a whole float", {"steps": 3.0}),
        ("steps: a NumPy integer", {"steps": np.uint8(3)}),
        ("steps: an array without axes", {"steps": np.array(3)}),
    ),
    *same(
        "schedule",
        lambda power, method: schedule(MODES, Gaussian([2.0**power, 2.0**power], TWO), method, 9).sequence,
        lambda: {"power": 0, "method": RecedingHorizon(5)},
        ("a great state", {"power": 500}),
        ("a small state", {"power": -500}),
        ("a state of another scale", {"power": 40}),
    ),
    *same(
        "schedule",
        lambda A: schedule(ModeSet(A), LONE, RecedingHorizon(10**9), 5).cost,
        lambda: {"A": [[[0.0]]]},
        ("powers that underflow", {"A": [[[1e-300]]]}),
        ("a subnormal mode", {"A": [[[5e-324]]]}),
    ),
    *refused("single_mode_costs", single_mode_costs, state, *WRONG_MODES, *WRONG_X0),
    *refused(
        "single_mode_costs",
        single_mode_costs,
        state,
        ("noise", {"modes": ModeSet([[[0.5]]], W=[[1.0]]), "x0": LONE}, ValueError, "with noise", "discounted"),
        (
            "a cost beyond the range",
            {"modes": ModeSet([[[1 - 1e-9]]]), "x0": Gaussian([1e153], ONE)},
            FloatingPointError,
            "a cost exceeds the floating-point range",
        ),
    ),
    *refused("best_single_mode", best_single_mode, state, *WRONG_MODES, *WRONG_X0[:3]),
    *refused(
        "best_single_mode",
        best_single_mode,
        state,
        ("no Schur mode", {"modes": UNSTABLE, "x0": LONE}, ValueError, "needs a Schur mode", "A0: 2"),
        ("a marginal mode", {"modes": ModeSet([[[1.0]]]), "x0": LONE}, ValueError, "A0: 1"),
    ),
    *same(
        "best_single_mode",
        lambda A: best_single_mode(ModeSet(A), LONE).index,
        lambda: {"A": [[[0.5]], [[0.9]]]},
        ("duplicate modes: the lowest index", {"A": [[[0.5]], [[0.5]]]}),
    ),
    *refused(
        "Refine",
        lambda base: schedule(UNSTABLE, LONE, Refine(base)),
        nothing,
        ("a base of infinite cost", {"base": Constant(0)}, ValueError, "costs infinitely much"),
    ),
    *refused(
        "FewSwitches",
        lambda **given: schedule(MODES, X0, FewSwitches(1), **given),
        nothing,
        ("a run that ends", {"steps": 3, "terminal": np.eye(2)}, ValueError, "plans a run for ever"),
    ),
]
