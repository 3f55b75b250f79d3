"""Rows of `switchctl.stability`: arguments of every function."""

import numpy as np
from control import ControlDimension
from pair import modes, x0
from scipy import sparse

from bad_input.table import refused, same
from switchctl import Constant, Gaussian, ModeSet, RecedingHorizon, Rollout, Rules, SwitchingGraph, schedule
from switchctl.stability import (
    average_dwell_time,
    does_switching_help,
    joint_spectral_radius,
    minimum_dwell_time,
    mode_dependent_dwell_times,
    policy_stability,
    random_stability,
    report,
    schur_stability,
    stabilising_word,
    word_stability,
)


def stable():
    """A mode that is held for ever, whatever is asked of it soon done."""
    return ModeSet([[[0.5]]])


def plan():
    return schedule(modes(), x0(), Constant(0), steps=3)


FUNCTIONS = {  # with arguments besides the modes
    schur_stability: {},
    word_stability: {"word": [0]},
    random_stability: {"probabilities": [1.0]},
    stabilising_word: {},
    policy_stability: {"method": Constant(0)},
    joint_spectral_radius: {"time_limit": 1.0},
    minimum_dwell_time: {"time_limit": 1.0},
    mode_dependent_dwell_times: {"time_limit": 1.0},
    average_dwell_time: {"time_limit": 1.0},
    does_switching_help: {"time_limit": 1.0},
    report: {"time_limit": 1.0},
}
FIRST = {joint_spectral_radius: "modes_or_graph"}
TIMED = [function for function, others in FUNCTIONS.items() if "time_limit" in others]


def good(function, of=stable):
    first = FIRST.get(function, "modes")
    return lambda: {first: of(), **FUNCTIONS[function]}


def rows_of_modes(function):
    name, first = function.__name__, FIRST.get(function, "modes")
    wanted = "modes must be a ModeSet"
    return refused(
        name,
        function,
        good(function),
        ("None for modes", {first: None}, TypeError, wanted, "not a NoneType"),
        ("matrices for modes", {first: lambda: modes().A}, TypeError, wanted, "not a ndarray"),
        ("a list of modes", {first: lambda: list(modes())}, TypeError, wanted, "not a list"),
        ("the class for modes", {first: ModeSet}, TypeError, wanted, "not a type"),
        ("a schedule for modes", {first: lambda: plan()}, TypeError, wanted, "not a Schedule"),
        ("rules for modes", {first: Rules(min_dwell=2)}, TypeError, wanted, "not a Rules"),
        ("an unknown keyword", {"horizon": 3}, TypeError, "horizon"),
    )


def rows_of_time(function):
    wanted = "time_limit must be a number"
    return [
        *refused(
            function.__name__,
            function,
            good(function),
            ("time_limit None", {"time_limit": None}, TypeError, wanted, "None"),
            ("time_limit a string", {"time_limit": "10 s"}, TypeError, wanted, "'10 s'"),
            ("time_limit True", {"time_limit": True}, TypeError, wanted, "True"),
            ("time_limit in a list", {"time_limit": [1.0]}, TypeError, wanted, "[1.0]"),
            ("time_limit complex", {"time_limit": 1j}, TypeError, wanted, "1j"),
            ("time_limit nan", {"time_limit": np.nan}, ValueError, "time_limit is nan"),
            ("time_limit zero", {"time_limit": 0}, ValueError, "time_limit", "0", "above 0"),
            ("time_limit negative", {"time_limit": -1.5}, ValueError, "time_limit", "-1.5", "above 0"),
            ("time_limit of 400 digits", {"time_limit": 10**400}, ValueError, "time_limit exceeds"),
        ),
        *same(
            function.__name__,
            lambda **given: repr(function(**given)),
            good(function),
            ("time_limit infinite", {"time_limit": np.inf}),
            ("time_limit float32", {"time_limit": np.float32(1.0)}),
            ("time_limit an integer", {"time_limit": np.int64(2)}),
        ),
    ]


def bounds(found):
    return found.lower, found.upper, found.verdict


def two(**others):
    return lambda: {"modes": modes(), **others}


def noisy_and_never_left():
    return {"modes": modes(W=0.1 * np.eye(2)), "probabilities": np.eye(2)}


ROWS = [
    *[row for function in FUNCTIONS for row in rows_of_modes(function)],
    *[row for function in TIMED for row in rows_of_time(function)],
    *refused(
        "joint_spectral_radius",
        joint_spectral_radius,
        good(joint_spectral_radius),
        ("tol None", {"tol": None}, TypeError, "tol must be a number"),
        ("tol True", {"tol": True}, TypeError, "tol must be a number"),
        ("tol nan", {"tol": np.nan}, ValueError, "tol is nan"),
        ("tol zero", {"tol": 0}, ValueError, "tol = 0", "0 < tol < 1"),
        ("tol negative", {"tol": -1e-4}, ValueError, "tol = -0.0001", "0 < tol < 1"),
        ("tol one", {"tol": 1}, ValueError, "tol = 1", "0 < tol < 1"),
        ("tol infinite", {"tol": np.inf}, ValueError, "tol = inf", "0 < tol < 1"),
    ),
    *same(
        "joint_spectral_radius",
        lambda **given: bounds(joint_spectral_radius(**given)),
        good(joint_spectral_radius),
        ("tol below what floats can", {"tol": 1e-300, "time_limit": 0.01}),
        ("tol float32", {"tol": np.float32(1e-4)}),
        ("a graph without rules", {"modes_or_graph": lambda: SwitchingGraph(stable())}),
    ),
    *refused(
        "word_stability",
        word_stability,
        two(word=[0, 1]),
        ("word None", {"word": None}, TypeError, "word must be a sequence", "None"),
        ("word an index", {"word": 1}, TypeError, "word must be a sequence", "not 1"),
        ("word a name", {"word": "calm"}, TypeError, "word must be a sequence", "'calm'"),
        ("word bytes", {"word": b"\x00"}, TypeError, "word must be a sequence"),
        ("word a set", {"word": {0, 1}}, TypeError, "word must be a sequence", "{0, 1}"),
        ("word a dict", {"word": {0: 1}}, TypeError, "word must be a sequence"),
        ("word empty", {"word": []}, ValueError, "word is empty", "at least one"),
        ("an unknown name", {"word": ["calm", "clam"]}, KeyError, "'clam'", "fast, calm"),
        ("a mode of another set", {"word": lambda: [stable()[0]]}, KeyError, "'A0'", "fast, calm"),
        ("an index too great", {"word": [0, 2]}, IndexError, "mode 2 is out of range", "2 modes"),
        ("an index too small", {"word": [-3]}, IndexError, "mode -3 is out of range"),
        ("an index that is a float", {"word": np.array([0.0, 1.0])}, TypeError, "index or its name", "float64"),
        ("an index that is a bool", {"word": [True]}, TypeError, "index or its name", "True"),
        ("a nested list", {"word": [[0, 1]]}, TypeError, "index or its name", "[0, 1]"),
        (
            "a word that the rules forbid",
            {"modes": lambda: SwitchingGraph(modes(), Rules(min_dwell=2))},
            ValueError,
            "not allowed by",
        ),
    ),
    *same(
        "word_stability",
        lambda **given: (bounds(word_stability(**given)), word_stability(**given).word),
        two(word=[0, 1]),
        ("by names", {"word": ["fast", "calm"]}),
        ("by modes", {"word": lambda: list(modes())}),
        ("from the end", {"word": (-2, -1)}),
        ("an array", {"word": np.array([0, 1], dtype=np.int8)}),
        ("numpy strings", {"word": np.array(["fast", "calm"])}),
        ("a range", {"word": range(2)}),
    ),
    *refused(
        "random_stability",
        random_stability,
        two(probabilities=[0.5, 0.5]),
        ("probabilities None", {"probabilities": None}, TypeError, "probabilities must hold real numbers"),
        ("probabilities strings", {"probabilities": ["a", "b"]}, TypeError, "probabilities must hold real numbers"),
        ("probabilities complex", {"probabilities": [1j, 1]}, TypeError, "probabilities", "complex128"),
        ("probabilities sparse", {"probabilities": lambda: sparse.eye(2)}, TypeError, "probabilities", ".toarray()"),
        ("probabilities masked", {"probabilities": lambda: np.ma.ones(2)}, TypeError, "probabilities", ".filled"),
        ("probabilities ragged", {"probabilities": [[0.5, 0.5], [1.0]]}, ValueError, "probabilities", "rectangular"),
        ("a probability nan", {"probabilities": [np.nan, 1.0]}, ValueError, "probabilities[0] is nan"),
        ("an entry infinite", {"probabilities": [[1, 0], [0, np.inf]]}, ValueError, "probabilities[1, 1] is inf"),
        ("a probability negative", {"probabilities": [-0.1, 1.1]}, ValueError, "has an entry -0.1", "at least 0"),
        ("a row negative", {"probabilities": [[1, 0], [-1, 2]]}, ValueError, "row 1 of probabilities", "-1"),
        ("too much in all", {"probabilities": [0.5, 0.6]}, ValueError, "sum of probabilities is 1.1", "expected 1"),
        ("nothing in all", {"probabilities": [0, 0]}, ValueError, "sum of probabilities is 0"),
        ("a row of nothing", {"probabilities": [[1, 0], [0, 0]]}, ValueError, "sum of row 1", "is 0"),
        ("a number", {"probabilities": 1.0}, ControlDimension, "shape ()", "(2,) or (2, 2)"),
        ("too few", {"probabilities": [1.0]}, ControlDimension, "shape (1,)", "(2,) or (2, 2)"),
        ("one row", {"probabilities": [[0.5, 0.5]]}, ControlDimension, "shape (1, 2)", "(2,) or (2, 2)"),
        ("three axes", {"probabilities": np.full((2, 2, 2), 0.5)}, ControlDimension, "shape (2, 2, 2)"),
        ("no entries", {"probabilities": []}, ControlDimension, "shape (0,)", "(2,) or (2, 2)"),
    ),
    *refused(
        "random_stability",
        random_stability,
        noisy_and_never_left,
        ("noise and two modes never left", {}, ValueError, "{fast} and {calm} are never left"),
    ),
    *same(
        "random_stability",
        lambda **given: bounds(random_stability(**given)),
        two(probabilities=[0.0, 1.0]),
        ("integers", {"probabilities": [0, 1]}),
        ("booleans", {"probabilities": [False, True]}),
        ("float32", {"probabilities": np.array([0, 1], dtype=np.float32)}),
        ("strided and read-only", {"probabilities": lambda: np.broadcast_to([0.0, 1.0], (3, 2))[1]}),
    ),
    *same(
        "random_stability",
        lambda **given: bounds(random_stability(**given)),
        two(probabilities=[[0.5, 0.5], [0.0, 1.0]]),
        ("Fortran order", {"probabilities": lambda: np.asfortranarray([[0.5, 0.5], [0.0, 1.0]])}),
        ("np.matrix", {"probabilities": lambda: np.matrix([[0.5, 0.5], [0.0, 1.0]])}),
        ("rounding in a row", {"probabilities": [[0.5, 0.5 + 1e-16], [0.0, 1.0]]}),
    ),
    *refused(
        "policy_stability",
        policy_stability,
        two(method=Rollout()),
        ("method None", {"method": None}, TypeError, "method must be a Method such as Rollout()", "None"),
        ("the class of a method", {"method": Rollout}, TypeError, "method must be a Method", "class"),
        ("the name of a method", {"method": "Rollout"}, TypeError, "method must be a Method", "'Rollout'"),
        ("a list of methods", {"method": [Rollout()]}, TypeError, "method must be a Method", "[Rollout()]"),
        ("a running scheduler", {"method": lambda: Rollout().start(modes())}, TypeError, "method must be a Method"),
        ("a mode that is none", {"method": Constant("clam")}, KeyError, "'clam'", "fast, calm"),
        ("noise and a total", {"modes": lambda: modes(W=np.eye(2))}, ValueError, "noise", "infinite"),
        (
            "a constraint on unstable modes",
            {"modes": lambda: ModeSet([[[2.0]]]), "method": RecedingHorizon(2, decrease=0.1)},
            ValueError,
            "decrease=0.1",
            "Schur",
        ),
    ),
    *refused(
        "does_switching_help",
        does_switching_help,
        two(x0=None),
        ("x0 a list", {"x0": [1.0, 1.0]}, TypeError, "x0 must be a Gaussian", "list"),
        ("the class of x0", {"x0": Gaussian}, TypeError, "x0 must be a Gaussian"),
        ("x0 of other modes", {"x0": Gaussian([1.0], [[1.0]])}, ControlDimension, "shape (1,)", "(2,)"),
        ("gap None", {"gap": None}, TypeError, "gap must be a number"),
        ("gap zero", {"gap": 0}, ValueError, "gap is 0", "between 0 and 1"),
        ("gap one", {"gap": 1.0}, ValueError, "gap is 1", "between 0 and 1"),
        ("gap nan", {"gap": np.nan}, ValueError, "gap is nan"),
        ("noise", {"modes": lambda: modes(W=np.eye(2))}, ValueError, "does_switching_help", "noise"),
        ("an offset", {"modes": lambda: modes(offset=[1, 0])}, ValueError, "does_switching_help", "offset"),
        ("a discount", {"modes": lambda: modes(cost=("discounted", 0.9))}, ValueError, "does_switching_help", "0.9"),
        ("an average", {"modes": lambda: modes(cost="average")}, ValueError, "does_switching_help", "average"),
        (
            "switches that change the state",
            {"modes": lambda: modes(activation=[[np.eye(2), 2 * np.eye(2)], [np.eye(2), np.eye(2)]])},
            ValueError,
            "does_switching_help",
            "activation",
        ),
    ),
    *refused(
        "report",
        report,
        two(x0=None, rules=None),
        ("x0 a list", {"x0": [1.0, 1.0]}, TypeError, "x0 must be a Gaussian", "list"),
        ("x0 of other modes", {"x0": Gaussian([1.0], [[1.0]])}, ControlDimension, "shape (1,)", "(2,)"),
        ("rules a string", {"rules": "min_dwell=2"}, TypeError, "rules must be Rules(..)", "min_dwell"),
        ("the class of rules", {"rules": Rules}, TypeError, "rules must be Rules(..)"),
        ("a graph of other modes", {"rules": lambda: SwitchingGraph(modes())}, ValueError, "of other modes"),
    ),
]
