"""Rows of `ModeSet`, its modes by index, and `Mode.to_ss`."""

import control
import numpy as np
from control import ControlDimension
from pair import modes
from scipy import sparse

from bad_input.arrays import faults, forms, symmetric_faults
from bad_input.table import refused, same
from switchctl import Gaussian, Mode, ModeSet

A = np.array([[[0.0, 3.0], [-1.0, 2.0]], [[1.0, 0.0], [0.0, -1.0]]])  # whole numbers, for other types of array
Q = np.array([[2.0, 1.0], [1.0, 3.0]])
HUGE = 10**400


def good():
    return {"matrices": A.copy()}


def seen(**given):
    made = ModeSet(**{**good(), **given})
    arrays = [made.A, made.Q, made.W, made.initial, made.offset, made.A_after, made.gains]
    return [*arrays, made.names, made.dt, made.plant_states, made.cost]


def kept(change):
    """A set of modes, one of the arrays that it was made of changed afterwards."""
    given = {"matrices": A.copy(), "Q": Q.copy(), "W": Q.copy(), "offset": np.ones(2), "gains": np.ones((2, 1, 2))}
    made = ModeSet(**given)
    if change:
        given[change][...] = 7.0
    return [made.A, made.Q, made.W, made.offset, made.gains]


def as_system(name):
    system = modes(names=[name, "b"], states=["plant.x", "v"])[0].to_ss()
    return [system.A, system.C, system.dt, system.name, system.state_labels]


def words_of(argument):
    wrong = (
        ("one word", "ab", TypeError, "must be a sequence of non-empty strings; got 'ab'"),
        ("a number", 3, TypeError, "got 3"),
        ("numbers", [1, 2], TypeError, "got (1, 2)"),
        ("an empty name", ["", "b"], TypeError, "non-empty strings"),
        ("too few", ["a"], ValueError, "has 1 entries; expected 2"),
        ("one name twice", ["a", "a"], ValueError, "holds 'a' more than once"),
        ("a set, which has no order,", {"a", "b"}, TypeError, "must be a sequence"),
    )
    return [(f"{what} as {argument}", {argument: value}, error, argument, words) for what, value, error, words in wrong]


PERIODS = [
    (f"dt {value!r}"[:20], {"dt": value}, error, *words)
    for value, error, *words in (
        (0, ValueError, "dt is 0; expected a positive, finite sampling period in seconds, or True"),
        (False, ValueError, "dt is False; expected a sampling period"),
        (None, ValueError, "dt is None; expected a sampling period in seconds, or True for none"),
        (np.nan, ValueError, "dt is nan"),
        (np.inf, ValueError, "dt is inf; expected a positive, finite"),
        (-0.1, ValueError, "dt is -0.1; expected a positive"),
        ("0.1", TypeError, "dt must be a number, not '0.1'"),
        (1j, TypeError, "dt must be a number, not 1j"),
        ([0.1], TypeError, "dt must be a number, not [0.1]"),
        (HUGE, ValueError, "dt exceeds the floating-point range"),
    )
]
COUNTS = [
    (f"{argument} {value!r}"[:30], {argument: value}, error, argument, words)
    for argument, value, error, words in (
        ("plant_states", 0, ValueError, "is 0; expected at least 1"),
        ("plant_states", 3, ValueError, "is 3, but the modes have 2 states"),
        ("plant_states", 1.5, ValueError, "is 1.5; expected a whole number"),
        ("plant_states", np.nan, ValueError, "is nan; expected a whole number"),
        ("plant_states", True, TypeError, "must be a whole number, not True"),
        ("plant_states", "1", TypeError, "must be a whole number, not '1'"),
        ("plant_states", [1], TypeError, "must be a whole number, not [1]"),
        ("plant_states", np.inf, ValueError, "is inf; expected a whole number"),
        ("estimate_states", 1, ValueError, "is 1; expected 0, or 2 after the plant's states"),
        ("estimate_states", -1, ValueError, "is -1; expected at least 0"),
        ("estimate_states", None, TypeError, "must be a whole number, not None"),
    )
]
COSTS = [
    (f"cost {value!r}", {"cost": value}, error, *words)
    for value, error, *words in (
        ("totl", ValueError, "cost is 'totl'; expected 'total', 'average' or ('discounted', factor)"),
        (None, ValueError, "cost is None", "('discounted', factor)"),
        ("discounted", ValueError, "cost is 'discounted'", "('discounted', factor)"),
        (["discounted", 0.9], ValueError, "cost is ['discounted', 0.9]"),
        (("discounted", 0.9, 1), ValueError, "cost is ('discounted', 0.9, 1)"),
        (("discounted", 1), ValueError, "the discount factor is 1.0; expected a number strictly between 0 and 1"),
        (("discounted", 0), ValueError, "the discount factor is 0.0"),
        (("discounted", np.nan), ValueError, "the discount factor is nan"),
        (("discounted", True), TypeError, "the discount factor must be a number, not True"),
        (("discounted", "a"), TypeError, "the discount factor must be a number, not 'a'"),
        ((np.ones(2), 0.9), ValueError, "cost is (array", "expected 'total'"),
    )
]
INDICES = [
    (f"{value!r}"[:20], {"mode": value}, error, *words)
    for value, error, *words in (
        ("calmer", KeyError, "no mode is named 'calmer'; the modes are fast, calm"),
        ("Fast", KeyError, "no mode is named 'Fast'", "fast, calm"),
        ("", KeyError, "no mode is named ''", "fast, calm"),
        ("0", KeyError, "no mode is named '0'"),
        (2, IndexError, "mode 2 is out of range; there are 2 modes, counted from 0"),
        (-3, IndexError, "mode -3 is out of range"),
        (HUGE, IndexError, "is out of range; there are 2 modes"),
        (None, TypeError, "by its index or its name, not None"),
        (1.0, TypeError, "by its index or its name, not 1.0 (float)"),
        (True, TypeError, "not True (bool)"),
        ([0], TypeError, "not [0] (list)"),
        (b"fast", TypeError, "(bytes)"),
        (np.array([0]), TypeError, "(ndarray)"),
        (np.array(0.0), TypeError, "(float64)"),
        (np.True_, TypeError, "(bool)"),
        (Mode, TypeError, "(type)"),
        (slice(1), TypeError, "(slice)"),
    )
]

ROWS = [
    *refused(
        "ModeSet",
        ModeSet,
        good,
        *faults("matrices", A),
        *symmetric_faults("Q", Q),
        *symmetric_faults("W", Q),
        *faults("gains", np.ones((2, 1, 2))),
        *faults("activation", np.tile(np.eye(2), (2, 2, 1, 1))),
        *faults("initial", np.eye(2)),
        *faults("offset", np.zeros(2)),
        *words_of("names"),
        *words_of("states"),
        *PERIODS,
        *COUNTS,
        *COSTS,
        ("no matrices", {"matrices": None}, TypeError, "matrices must be the A_i, shape (m, n, n); got a NoneType"),
        ("a number", {"matrices": 3}, TypeError, "matrices must be the A_i", "got a int"),
        ("a system", {"matrices": lambda: control.ss(-1, 1, 1, 0)}, TypeError, "matrices must be", "got a StateSpace"),
        ("a sparse matrix", {"matrices": sparse.eye(2)}, TypeError, "matrices is a sparse matrix", ".toarray()"),
        ("a list of them", {"matrices": [sparse.eye(2)]}, TypeError, "matrices[0] is a sparse matrix"),
        ("a dict", {"matrices": {"a": A[0]}}, TypeError, "matrices must be", "got a dict"),
        ("modes", {"matrices": modes}, TypeError, "matrices must be", "got a function"),
        ("a ModeSet", {"matrices": lambda: modes()}, TypeError, "matrices[0] must hold real numbers, not a Mode"),
        ("systems", {"matrices": lambda: [control.ss(-1, 1, 1, 0)]}, TypeError, "matrices[0]", "not a StateSpace"),
        ("the class", {"matrices": ModeSet}, TypeError, "matrices must be", "got a type"),
        ("an empty list", {"matrices": []}, ControlDimension, "matrices has shape (0,); expected (m, n, n)"),
        ("no modes", {"matrices": np.zeros((0, 2, 2))}, ControlDimension, "(0, 2, 2)", "m and n at least 1"),
        ("no states", {"matrices": np.zeros((2, 0, 0))}, ControlDimension, "(2, 0, 0)", "m and n at least 1"),
        ("one matrix for all", {"matrices": np.eye(2)}, ControlDimension, "(2, 2); expected (m, n, n)"),
        ("a matrix as lists", {"matrices": [[1, 0], [0, 1]]}, ControlDimension, "matrices[0] has shape (2,)"),
        ("other sizes", {"matrices": [np.eye(2), np.eye(3)]}, ControlDimension, "shapes [(2, 2), (3, 3)]"),
        ("NaN in a list", {"matrices": [A[0], [[1, np.nan], [0, 1]]]}, ValueError, "matrices[1][0, 1] is nan"),
        ("a weight of none", {"Q": [Q, -Q]}, ValueError, "Q[1] is not positive semidefinite", "least eigenvalue"),
        ("a number as Q", {"Q": 1.0}, ControlDimension, "Q has shape (); expected (2, 2) or (2, 2, 2)"),
        ("an activation of itself", {"activation": np.zeros((2, 2, 2, 2))}, ValueError, "activation[0, 0]", "identity"),
        ("an initial state that isn't", {"initial": 2 * np.eye(2)}, ValueError, "initial must begin with the identity"),
        ("a negative offset", {"offset": [1.0, -1.0]}, ValueError, "offset is [1.0, -1.0]", "at least 0"),
        ("unknown keyword", {"gain": 1}, TypeError, "gain"),
    ),
    *refused("ModeSet", lambda **given: ModeSet(**given), dict, ("nothing", {}, TypeError, "matrices")),
    *same(
        "ModeSet",
        seen,
        lambda: {"Q": Q, "W": Q, "gains": np.ones((2, 1, 2)), "offset": np.ones(2), "dt": 0.5},
        *forms("matrices", A),
        *forms("Q", Q),
        *forms("W", Q),
        *forms("gains", np.ones((2, 1, 2))),
        *forms("offset", np.ones(2)),
        ("one weight each", {"Q": np.stack([Q, Q])}),
        ("matrices in a generator", {"matrices": lambda: (matrix for matrix in A)}),
        ("names in a generator", {"names": lambda: (name for name in ("A0", "A1"))}),
        ("names in an array", {"names": np.array(["A0", "A1"])}),
        ("dt of float32", {"dt": np.float32(0.5)}),
        ("an exact count", {"plant_states": 2.0}),
        ("a count of numpy", {"plant_states": np.int8(2)}),
        ("ulps of asymmetry", {"Q": [[2.0, 1.0 + 2e-16], [1.0, 3.0]]}),
    ),
    *same(
        "ModeSet",
        kept,
        lambda: {"change": None},
        *((f"{what} changed afterwards", {"change": what}) for what in ("matrices", "Q", "W", "offset", "gains")),
    ),
    *refused("ModeSet.index", lambda mode: modes().index(mode), lambda: {"mode": 0}, *INDICES),
    *refused(
        "ModeSet.index",
        lambda mode: modes().index(mode),
        lambda: {"mode": 0},
        ("a mode of another set", {"mode": lambda: ModeSet([[[0.5]]], names=["cool"])[0]}, KeyError, "'cool'", "fast"),
        ("a Gaussian", {"mode": lambda: Gaussian([1], [[1]])}, TypeError, "index or its name", "(Gaussian)"),
    ),
    *same(
        "ModeSet.index",
        lambda mode: modes().index(mode),
        lambda: {"mode": 1},
        ("its name", {"mode": "calm"}),
        ("a name of numpy", {"mode": np.str_("calm")}),
        ("from the end", {"mode": -1}),
        ("a number of numpy", {"mode": np.uint8(1)}),
        ("an array without axes", {"mode": np.array(1)}),
        ("the mode", {"mode": lambda: modes()[1]}),
    ),
    *refused(
        "Mode.to_ss",
        lambda **given: modes()[0].to_ss(**given),
        dict,
        ("unknown keyword", {"name": "a"}, TypeError, "name"),
    ),
    *same(
        "Mode.to_ss",
        as_system,
        lambda: {"name": "two_words"},
        ("a dot, which python-control doesn't take,", {"name": "two.words"}),
    ),
]  # fmt: skip
