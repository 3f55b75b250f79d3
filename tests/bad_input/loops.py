"""Rows of `close_loops` and `ClosedLoops`."""

import control
import numpy as np
from control import ControlDimension
from pair import modes

from bad_input.arrays import faults, forms, symmetric_faults
from bad_input.table import plant, refused, same
from switchctl import ClosedLoops, Gaussian, close_loops

LEAD = control.tf([40, 40], [1, 10])


def measured(**keywords):
    """A double integrator whose position is measured."""
    return control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, states=["position", "speed"], **keywords)


def first_order(D=0.0, dt=0, A=-1.0):
    return control.ss([[A]], [[1]], [[1]], [[D]], dt)


def nonlinear():
    return control.nlsys(lambda t, x, u, params: [x[1], np.sin(x[0]) + u[0]], inputs=1, states=2, outputs=2)


def frequencies():
    return control.frd([1, 2, 3], [1, 2, 3])


def good():
    return {"plant": plant(), "controllers": {"a": np.array([[3.0, 2.0]]), "b": np.array([[1.0, 1.0]])}, "dt": 0.5}


def unstable(A):
    return control.ss([[A, 0], [0, 1]], [[1], [1]], np.eye(2), 0)


def seen(**given):
    made = close_loops(**given)
    return [made.A, made.Q, made.W, made.gains, made.names, made.states, made.offset, made.initial, made.plant.A]


def kept(change):
    """Loops, what they were made of changed afterwards."""
    given = good() | {"Q": np.eye(2), "W": np.eye(2)}
    made = close_loops(**given)
    changed = {"plant": given["plant"].A, "gain": given["controllers"]["a"], "Q": given["Q"], "W": given["W"]}
    if change:
        changed[change][...] = 7.0
    return [made.A, made.Q, made.W, made.gains, made.plant.A]


def parts(**given):
    loops = close_loops(**good())
    made = {"matrices": loops.A, "names": loops.names, "dt": loops.dt, "plant": loops.plant}
    return made | {"controllers": loops.controllers} | given


def double(**keywords):
    return control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, **keywords)


PLANTS = [
    (what, {"plant": make}, error, *words)
    for what, make, error, *words in (
        ("a nonlinear plant", lambda: nonlinear(), TypeError, "not a NonlinearIOSystem", "plant.linearize("),
        ("frequency data", lambda: frequencies(), TypeError, "plant must be a StateSpace", "FrequencyResponseData"),
        ("matrices", lambda: ([[0]], [[1]], [[1]], [[0]]), TypeError, "plant must be a StateSpace", "not a tuple"),
        ("a word", "axis", TypeError, "plant must be a StateSpace or TransferFunction, not a str"),
        ("no plant", None, TypeError, "plant must be a StateSpace or TransferFunction, not a NoneType"),
        ("the class", control.StateSpace, TypeError, "plant must be", "not a type"),
        ("modes", lambda: modes(), TypeError, "plant must be", "not a ModeSet"),
        ("an improper plant", lambda: control.tf([1, 0, 0], [1, 1]), ValueError, "plant is improper", "filter it"),
        ("transfer functions", lambda: control.tf([[[1], [1]]], [[[1, 1], [1, 1]]]), ValueError, "as a StateSpace"),
        ("a static plant", lambda: control.ss([], [], [], [[1]]), ControlDimension, "plant has 0 states and 1 inputs"),
        ("no timebase", lambda: double(dt=None), ValueError, "plant.dt is None; say whether", "dt=0"),
        ("NaN in it", lambda: control.ss(-1, 1, [[1], [np.nan]], 0), ValueError, "plant.C[1, 0] is nan"),
        ("states of one name", lambda: double(states=["x", "x"]), ValueError, "plant has 2 states with names x"),
        ("outputs of one name", lambda: double(outputs=["y", "y"]), ValueError, "plant has 2 outputs with names y"),
        ("another period", lambda: double(dt=0.2), ValueError, "dt is 0.5 s", "sampled with dt = 0.2 s"),
        (
            "one that overflows",
            lambda: unstable(2000.0),
            ValueError,
            "the plant can't be sampled",
            "shorter period",
        ),
        ("one beyond the range", lambda: unstable(1e308), ValueError, "the plant can't be sampled", "overflows"),
    )
]
CONTROLLERS = [
    (what, {"entry": make}, error, "controllers['a']", *words)
    for what, make, error, *words in (
        ("no controller", None, TypeError, "must hold real numbers, not a NoneType"),
        ("what lqr returns", (np.ones((1, 2)), np.eye(2), np.ones(2)), TypeError, "as control.lqr returns", "pass K"),
        ("a gain transposed", [[1.0], [1.0]], ControlDimension, "(2, 1); expected (1, 2)", "1 inputs and 2 states"),
        ("a number", 1.0, ControlDimension, "has shape (1, 1); expected (1, 2)"),
        ("a nonlinear one", lambda: nonlinear(), TypeError, "must be a gain array", "not a NonlinearIOSystem"),
        ("frequency data", lambda: frequencies(), TypeError, "must be a gain array", "FrequencyResponseData"),
        ("the class", control.StateSpace, TypeError, "must hold real numbers, not a type"),
        ("a Gaussian", lambda: Gaussian([1.0], [[1.0]]), TypeError, "must hold real numbers, not a Gaussian"),
        ("too many inputs", lambda: control.ss(-1, [[1, 1, 1]], 1, 0), ControlDimension, "has 3 inputs and 1 outputs"),
        ("too many outputs", lambda: control.ss(-1, [[1, 1]], np.ones((2, 1)), 0), ControlDimension, "2 outputs"),
        ("an improper one", lambda: control.tf([[[1, 0], [1]]], [[[1], [1]]]), ValueError, "is improper", "s / (1 +"),
        ("NaN in it", lambda: control.ss(-1, [[1, np.nan]], 1, 0), ValueError, ".B[0, 1] is nan"),
        ("no timebase", lambda: control.ss(-1, [[1, 1]], 1, 0, None), ValueError, "has states and dt = None", "dt=0"),
        ("another period", lambda: control.ss(0.5, [[1, 1]], 1, 0, 0.2), ValueError, "dt = 0.2", "with dt = 0.5"),
        ("a static one so", lambda: control.ss([], [], [], [[1, 1]], 0.2), ValueError, "dt = 0.2", "with dt = 0.5"),
        ("a pole at 2 / dt", lambda: control.ss([[4.0]], [[1, 1]], 1, 0), ValueError, "can't be sampled by 'tustin'"),
        ("one of one name", lambda: control.ss(-np.eye(2), np.eye(2), np.ones((1, 2)), 0, states=["x", "x"]),
         ValueError,
         "has 2 states with names x"),
    )
]  # fmt: skip
PERIODS = [
    (f"dt {value!r}"[:20], {"dt": value}, error, *words)
    for value, error, *words in (
        (0, ValueError, "dt is 0; expected a positive, finite sampling period"),
        (False, ValueError, "dt is False; expected a sampling period"),
        (True, ValueError, "dt is True, but the plant is continuous"),
        (np.nan, ValueError, "dt is nan"),
        (np.inf, ValueError, "dt is inf"),
        (-0.1, ValueError, "dt is -0.1"),
        ("fast", TypeError, "dt must be a number, not 'fast'"),
        ([0.1], TypeError, "dt must be a number"),
        (10**400, ValueError, "dt exceeds the floating-point range"),
        (1e200, ValueError, "the plant can't be sampled with dt = 1e+200 s, it overflows"),
    )
]
MAPPINGS = [
    ("no controllers", {"controllers": None}, TypeError, "controllers must be a dict or a list", "not a NoneType"),
    ("one array of gains", {"controllers": np.ones((2, 1, 2))}, TypeError, "controllers must be", "not a ndarray"),
    ("a generator", {"controllers": lambda: (K for K in [[[1, 1]]])}, TypeError, "controllers must be", "a generator"),
    ("a word for controllers", {"controllers": "lqr"}, TypeError, "controllers must be a dict or a list", "not a str"),
    ("an empty dict", {"controllers": {}}, ValueError, "controllers is empty; give at least one"),
    ("an empty list", {"controllers": []}, ValueError, "controllers is empty; give at least one"),
    ("a number as name", {"controllers": {1: [[1.0, 1.0]]}}, TypeError, "controllers has an entry named 1"),
    ("an empty name", {"controllers": {"": [[1.0, 1.0]]}}, TypeError, "an entry named ''"),
    ("a gain beyond the range", {"controllers": [[[1e308, 1e308]]], "discretize": "closed_loop"}, ValueError,
     "overflows"),
    ("an unknown order", {"discretize": "Plant"}, ValueError,
     "discretize is 'Plant'; expected 'plant' or 'closed_loop'"),
    ("an array as order", {"discretize": np.ones(2)}, ValueError, "discretize is array", "expected 'plant'"),
    ("V without measuring", {"V": np.eye(2)}, ValueError, "V is the noise of the plant's output", "measures it"),
    ("a number for two states", {"Q": 2.0}, ControlDimension, "Q has shape (); expected (2, 2)"),
    ("an effort for two inputs", {"R": np.eye(2)}, ControlDimension, "R has shape (2, 2); expected (1, 1)"),
    ("a negative effort", {"R": -1.0}, ValueError, "R is not positive semidefinite: its least eigenvalue is -1"),
    ("NaN as effort", {"R": np.nan}, ValueError, "R is nan"),
    ("a ragged effort", {"R": [[1.0, 2.0], [3.0]]}, ValueError, "R is not rectangular"),
    ("an effort beyond the range", {"R": 1e308}, ValueError, "R: the cost of the effort", "exceeds", "scale"),
    ("noise beyond the range", {"plant": lambda: first_order(A=10.0), "controllers": [[[1.0]]], "W": 1.0, "dt": 40.0},
     ValueError, "sampling with dt = 40.0 s overflows; choose a shorter period"),
    ("an unknown cost", {"cost": "mean"}, ValueError, "cost is 'mean'; expected 'total'"),
    ("an unknown way of sampling", {"sampling": "tustn"}, ValueError, "sampling is 'tustn'; expected one of tustin"),
    ("sampling of a gain", {"sampling": {"a": "zoh"}}, ValueError, "sampling names 'a', which has"),
    ("an unknown name", {"inactive": {"c": "hold"}}, KeyError, "inactive names 'c', and the controllers are a, b"),
    ("an unknown inactive", {"inactive": "trak"}, ValueError,
     "inactive of controllers['a'] is 'trak'", "'hold' or 'run'"),
    ("no inactive", {"inactive": None}, ValueError, "inactive of controllers['a'] is None", "'hold' or 'run'"),
    ("an array as inactive", {"inactive": np.ones(2)}, ValueError, "inactive of controllers['a'] is array"),
    ("an unknown initial", {"initial": "zeros"}, ValueError, "initial of controllers['a'] is 'zeros'", "'settled'"),
    ("unknown keyword", {"weight": 1}, TypeError, "weight"),
]  # fmt: skip
ROWS = [
    *refused("close_loops", close_loops, good, *PLANTS, *PERIODS, *MAPPINGS),
    *refused("close_loops", close_loops, good, *symmetric_faults("Q", [[3, 1], [1, 2]]), *symmetric_faults("W",
     np.eye(2))),
    *refused(
        "close_loops",
        lambda entry: close_loops(plant(), {"a": entry, "b": [[1.0, 1.0]]}, 0.5),
        dict,
        *((f"{what} as controller", *rest) for what, *rest in CONTROLLERS),
        *faults("entry", np.ones((1, 2)), "controllers['a']"),
    ),
    *refused("close_loops", lambda **given: close_loops(**given), dict, ("nothing", {}, TypeError,
     "plant", "controllers")),
    *refused(
        "close_loops",
        close_loops,
        lambda: good() | {"plant": double(dt=True), "dt": None},
        ("two periods under True", {"controllers": [control.ss(0.5, [[1, 1]], 1, 0, dt) for dt in (0.1, 0.2)]},
         ValueError,
         "controllers['C1'] has dt = 0.2, but the modes are sampled with dt = 0.1"),
        ("a continuous controller", {"controllers": [control.ss(-0.5, [[1, 1]], 1, 0)]}, ValueError,
         "give dt in seconds"),
        ("closed in continuous time", {"discretize": "closed_loop"}, ValueError, "the plant is already sampled"),
    ),
    *same(
        "close_loops",
        seen,
        lambda: good() | {"Q": [[3, 1], [1, 2]], "R": [[2]], "W": np.eye(2), "cost": "average"},
        ("a number as R", {"R": 2}),
        ("an array without axes as R", {"R": np.array(2)}),
        ("gains of integers", {"controllers": {"a": [[3, 2]], "b": np.array([1, 1], np.int8)}}),
        ("gains of float32", {"controllers": {"a": np.float32([[3, 2]]), "b": np.float32([[1, 1]])}}),
        *forms("Q", [[3, 1], [1, 2]]),
        *forms("W", np.eye(2)),
    ),
    *same(
        "close_loops",
        kept,
        lambda: {"change": None},
        *((f"{what} changed afterwards", {"change": what}) for what in ("plant", "gain", "Q", "W")),
    ),
    *same(
        "close_loops",
        lambda dt, controller_dt, given: close_loops(
            double(dt=dt), [control.ss(0.5, [[1, 1]], 1, 0, controller_dt)], given
        ).A,
        lambda: {"dt": 0.3, "controller_dt": 0.3, "given": 0.3},
        ("0.3 and 3 * 0.1 as periods", {"controller_dt": 3 * 0.1}),
        ("3 * 0.1 as dt", {"given": 3 * 0.1}),
        ("True beside 0.3", {"dt": True}),
        ("a controller of True", {"controller_dt": True}),
        ("no dt", {"given": None}),
        ("dt of True", {"given": True}),
    ),
    *refused(
        "ClosedLoops",
        lambda **given: ClosedLoops(**parts(**given)),
        dict,
        ("a word as plant", {"plant": "axis"}, TypeError, "plant must be a StateSpace or None, not a str"),
        ("a transfer function as plant", {"plant": LEAD}, TypeError, "plant must be a StateSpace or None"),
        ("a plant of other states", {"plant": lambda: first_order(dt=0.5)}, ControlDimension, "plant has 1 states"),
        ("gains as controllers", {"controllers": [[[1, 1]]]}, TypeError, "controllers must be a Controllers or None"),
        ("NaN in noise", {"process_noise": np.full((2, 2, 2), np.nan)}, ValueError, "process_noise[0, 0, 0] is nan"),
        ("a word as noise", {"measurement_noise": "white"}, TypeError, "measurement_noise must hold real numbers"),
        ("no matrices", {"matrices": None}, TypeError, "matrices must be the A_i"),
        ("unknown keyword", {"gain": 1}, TypeError, "gain"),
    ),
]  # fmt: skip
