"""Rows of `simulate` and `monte_carlo`."""

from concurrent.futures import ThreadPoolExecutor

import control
import numpy as np
from control import ControlDimension
from pair import modes

from bad_input.arrays import faults, forms
from bad_input.table import plant, refused, same
from switchctl import (
    Constant,
    Gaussian,
    ModeSet,
    RecedingHorizon,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    close_loops,
    monte_carlo,
    schedule,
    simulate,
)

GAINS = {"a": [[3.0, 2.0]], "b": [[1.0, 1.0]]}


def loops(**keywords):
    return close_loops(plant(), GAINS, 0.5, **keywords)


LOOPS = loops()
PLANT = plant()
X0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
PLAN = Schedule(LOOPS, X0, [0, 1, 0])
ENDS = schedule(LOOPS, X0, RecedingHorizon(5), 2, terminal=np.eye(2))
AIMED = schedule(LOOPS, X0, RecedingHorizon(5), 2, target=Gaussian([0.5, 0.5], 0.01 * np.eye(2)))
MEASURED = control.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
LEADS = close_loops(MEASURED, {"gain": [[3.0, 2.0]], "lead": control.tf([4, 4], [1, 10])}, 0.5)


def run():
    return {"plant": PLANT, "modes": LOOPS, "method": Constant(0), "x0": np.array([1.0, 2.0]), "steps": 2}


def states(**given):
    found = simulate(**given)
    return [found.states, found.inputs, found.sequence, found.status]


def nonlinear(rate):
    return control.nlsys(lambda t, x, u, params: rate(x, u), inputs=1, states=2, outputs=2)


def linear(x, u):
    return np.array([x[1], u[0]])


def meddling(x, u):
    rate = linear(x, u)
    x[:], u[:] = 7.0, 7.0
    return rate


def meddling_domain(x):
    x[:] = 7.0
    return 1.0


def status(rate):
    return simulate(**{**run(), "plant": nonlinear(rate)}).status


SEEDS_AND_STEPS = [
    (f"{argument} {value!r}"[:20], {argument: value}, error, argument, words)
    for argument, value, error, words in (
        ("steps", 0, ValueError, "is 0; expected at least 1"),
        ("steps", -1, ValueError, "is -1; expected at least 1"),
        ("steps", 1.5, ValueError, "is 1.5; expected a whole number"),
        ("steps", True, TypeError, "must be a whole number, not True"),
        ("steps", "3", TypeError, "must be a whole number, not '3'"),
        ("steps", np.nan, ValueError, "is nan; expected a whole number"),
        ("steps", np.inf, ValueError, "is inf; expected a whole number"),
        ("seed", None, TypeError, "must be a whole number, not None"),
        ("seed", -1, ValueError, "is -1; expected at least 0"),
        ("seed", 0.5, ValueError, "is 0.5; expected a whole number"),
        ("seed", "a", TypeError, "must be a whole number, not 'a'"),
        ("seed", True, TypeError, "must be a whole number, not True"),
    )
]
PLANTS = [
    ("no plant", {"plant": "pendulum"}, TypeError, "plant must be a NonlinearIOSystem or StateSpace, not a str"),
    ("a transfer function", {"plant": control.tf([1], [1, 1])}, TypeError, "plant", "control.ss makes one"),
    ("another plant", {"plant": control.ss(-1, 1, 1, 0)}, ControlDimension, "plant has 1 states", "one of 2, 1 and 2"),
    ("states in another order", {"plant": control.ss(PLANT, states=["speed", "position"])}, ValueError,
     "plant has the states speed, position; the loops were closed with position, speed", "give them one order"),
    ("NaN in the plant", {"plant": control.ss([[0, np.nan], [0, 0]], [[0], [1]], np.eye(2), 0)}, ValueError,
     "plant.A[0, 1] is nan"),
    ("a plant of another period", {"plant": control.ss(np.eye(2), [[0], [1]], np.eye(2), 0, 0.2)}, ValueError,
     "plant is sampled with dt = 0.2, and the modes with dt = 0.5"),
    ("a plant without a timebase", {"plant": control.ss(np.eye(2), [[0], [1]], np.eye(2), 0, None)}, ValueError,
     "plant.dt is None"),
    ("limits reversed", {"saturation": (1.0, -1.0)}, ValueError, "saturation is ([1.0], [-1.0]); expected low <= high"),
    ("NaN as limit", {"saturation": (np.nan, 1.0)}, ValueError, "saturation is ([nan], [1.0])"),
    ("one limit", {"saturation": 5.0}, TypeError, "saturation must be (low, high), not 5.0"),
    ("masked limits", {"saturation": (np.ma.array([-1.0], mask=[True]), 1)}, TypeError, "low is a masked array"),
    ("ragged limits", {"saturation": ([1, [2]], 1)}, ValueError, "saturation's low is not rectangular"),
    ("no low limit", {"saturation": (None, 1)}, TypeError, "saturation's low must hold real numbers, not a NoneType"),
    ("limits of two inputs", {"saturation": ([0, 0], 1)}, ControlDimension, "low has shape (2,)", "(1,)"),
    ("a delay in seconds", {"delay": 0.1}, TypeError, "delay must be True or False, not 0.1"),
    ("noise that isn't measured", {"noise": 0.1}, ValueError, "noise is of the plant's output", "don't measure it"),
    ("a number as operating point", {"operating_point": 3}, TypeError, "operating_point must be (state, input)", "int"),
    ("a point of another plant", {"operating_point": ([0.0], [0.0])}, ControlDimension, "the state of operating_point",
     "(1,); expected (2,)"),
    ("NaN in the point", {"operating_point": ([0.0, np.nan], [0.0])}, ValueError,
     "the state of operating_point[1] is nan"),
    ("no equilibrium", {"operating_point": ([0.0, 1.0], [0.0])}, ValueError, "no equilibrium", "moves by 0.5"),
    ("a point beyond the range", {"operating_point": ([0.0, 1.5e308], [1.5e308])}, ValueError, "operating_point"),
    ("a number as domain", {"domain": 1.0}, TypeError, "domain must be a function of the state", "not 1.0"),
]  # fmt: skip
SETTINGS = [
    ("no modes", {"modes": None}, TypeError, "modes must be what close_loops returns, not a NoneType"),
    ("matrices as modes", {"modes": LOOPS.A}, TypeError, "modes must be what close_loops returns, not a ndarray"),
    ("modes without controllers", {"modes": ModeSet(LOOPS.A)}, TypeError, "a plain ModeSet", "knows no plant"),
    ("a schedule as modes", {"modes": PLAN}, TypeError, "modes must be", "not a Schedule"),
    ("loops in continuous time", {"modes": loops(discretize="closed_loop")}, ValueError, 'discretize="plant"'),
    ("the class of a method", {"method": Rollout}, TypeError, "method must be a Method such as Rollout()"),
    ("a name as method", {"method": "Rollout"}, TypeError, "method must be a Method", "not 'Rollout'"),
    ("a schedule of others", {"method": Schedule(LEADS, X0, [0])}, ValueError,
     "of other modes (gain, lead) than these"),
    ("a schedule that ends", {"method": ENDS, "steps": 3}, ValueError, "steps is 3, and the schedule ends after 2"),
    ("rules of a schedule", {"method": PLAN, "rules": Rules()}, ValueError, "a schedule was made under its own"),
    ("too many steps of one", {"method": PLAN, "steps": 10**13}, MemoryError, "10000000000000 steps", "2e+15 bytes"),
    ("a word as rules", {"rules": "dwell"}, TypeError, "rules must be Rules(..), not 'dwell'"),
    ("a graph of others", {"rules": SwitchingGraph(modes())}, ValueError, "SwitchingGraph of other modes"),
    ("no state", {"x0": None}, TypeError, "x0 must hold real numbers, not a NoneType"),
    ("a Gaussian of others", {"x0": Gaussian([1.0], [[1.0]])}, ControlDimension, "x0 has shape (1,)", "expected (2,)"),
    ("a state beyond the range", {"method": Rollout(), "x0": [1e200, 0.0]}, FloatingPointError, "scale the state"),
    ("a domain of nothing", {"domain": lambda: (lambda x: None)}, TypeError, "domain returns None; expected a number"),
    ("a domain of each state", {"domain": lambda: (lambda x: x)}, TypeError,
     "domain returns [1.0, 2.0]; expected a number"),
    ("a domain of text", {"domain": lambda: (lambda x: "in")}, TypeError, "domain returns 'in'; expected a number"),
    ("too few rates", {"plant": nonlinear(lambda x, u: [x[1]])}, ControlDimension, "returns 1 numbers; expected 2"),
    ("a generator as seed", {"seed": np.random.default_rng(0)}, TypeError, "seed must be a whole number"),
    ("no tolerance", {"rtol": 0}, ValueError, "rtol is 0; expected a positive number"),
    ("a tolerance below rounding", {"rtol": 1e-300}, ValueError, "rtol is 1e-300; expected at least 2.22e-14"),
    ("a tolerance of all", {"rtol": 10}, ValueError, "rtol is 10; expected", "less than 1"),
    ("NaN as tolerance", {"atol": np.nan}, ValueError, "atol is nan"),
    ("a word as tolerance", {"atol": "small"}, TypeError, "atol must be a number, not 'small'"),
    ("unknown keyword", {"saturated": True}, TypeError, "saturated"),
]  # fmt: skip
NOISE = [
    ("yes as noise", {"noise": True}, TypeError, "noise is True; expected a covariance, False for none"),
    ("negative noise", {"noise": -1.0}, ValueError, "noise is not positive semidefinite: its least eigenvalue is -1"),
    ("NaN as noise", {"noise": np.nan}, ValueError, "noise is nan"),
    ("noise of two outputs", {"noise": np.eye(2)}, ControlDimension, "noise has shape (2, 2); expected (1, 1)"),
    ("ragged noise", {"noise": [[1, 2], [3]]}, ValueError, "noise is not rectangular"),
]
SCHEDULES = [
    ("no schedule", {"schedules": None}, TypeError, "schedules must be a Schedule, a dict", "got a NoneType"),
    ("a list", {"schedules": [PLAN]}, TypeError, "schedules must be a Schedule, a dict", "got a list"),
    ("modes", {"schedules": LOOPS}, TypeError, "schedules must be a Schedule", "got a ClosedLoops"),
    ("the class", {"schedules": Schedule}, TypeError, "schedules must be a Schedule", "got a type"),
    ("an empty dict", {"schedules": {}}, TypeError, "not empty; got an empty dict"),
    ("a number as label", {"schedules": {1: PLAN}}, TypeError, "schedules[1] is a Schedule", "by their labels"),
    ("a method", {"schedules": {"a": Rollout()}}, TypeError, "schedules['a'] is a Rollout"),
    ("another start", {"schedules": {"a": PLAN, "b": Schedule(LOOPS, Gaussian([2.0, 1.0], np.eye(2)), [0])}},
     ValueError,
     "schedules['b'] has another initial state"),
    ("other modes", {"schedules": {"a": PLAN, "b": Schedule(LEADS, X0, [0])}}, ValueError,
     "schedules['b'] is of other"),
    ("a target", {"schedules": AIMED}, ValueError, "has a target"),
    ("more steps than it has", {"schedules": ENDS, "steps": 3}, ValueError,
     "steps is 3, and the schedule ends after 2"),
    ("more steps than memory", {"steps": 10**13}, MemoryError, "10000000000000 steps would take 4.8e+14 bytes"),
    ("one sample", {"samples": 1}, ValueError, "samples is 1; expected at least 2"),
    ("part of a sample", {"samples": 2.5}, ValueError, "samples is 2.5; expected a whole number"),
    ("yes as samples", {"samples": True}, TypeError, "samples must be a whole number, not True"),
    *((f"confidence {value!r}", {"confidence": value}, error, "confidence", words) for value, error, words in (
        (0, ValueError, "is 0.0; expected a number between 0 and 1"),
        (1, ValueError, "is 1.0; expected a number between 0 and 1"),
        (99, ValueError, "such as 0.99"),
        (1 - 1e-16, ValueError, "is 0.9999999999999999; expected a number between 0 and 1"),
        (np.nan, ValueError, "is nan"),
        ("high", TypeError, "must be a number, not 'high'"),
    )),
    *((f"{name} without a plant", {name: value}, ValueError, f"{name} is for runs of a plant") for name, value in (
        ("saturation", (-1, 1)), ("delay", True), ("noise", 0.1), ("operating_point", ([0, 0], [0])), ("domain", abs),
    )),
    ("an executor without a plant", {"executor": 2}, ValueError, "executor is for runs of a plant"),
    ("a number as executor", {"plant": PLANT, "executor": 2}, TypeError, "executor must be", "not a int"),
    ("the class of one", {"plant": PLANT, "executor": ThreadPoolExecutor}, TypeError, "executor must be", "not a type"),
    ("modes without controllers", {"plant": PLANT, "schedules": Schedule(ModeSet(LOOPS.A), X0, [0])}, TypeError,
     "a plain ModeSet"),
    ("unknown keyword", {"runs": 3}, TypeError, "runs"),
]  # fmt: skip

ROWS = [
    *refused("simulate", simulate, run, *PLANTS, *SETTINGS, *SEEDS_AND_STEPS, *faults("x0", np.ones(2))),
    *refused("simulate", lambda **given: simulate(MEASURED, LEADS, Constant(0), [1.0, 0.0], 2, **given), dict, *NOISE),
    *refused("simulate", lambda **given: simulate(**given), dict, ("nothing", {}, TypeError, "plant", "modes", "x0")),
    *same(
        "simulate",
        states,
        run,
        *forms("x0", [1, 2]),
        ("steps of float", {"steps": 2.0}),
        ("a flag of numpy", {"delay": np.False_}),
        ("a seed of numpy", {"seed": np.uint8(0)}),
        ("a domain that changes what it is told", {"domain": meddling_domain}),
        ("limits that aren't reached", {"saturation": (-1e9, 1e9)}),
    ),
    *same(
        "simulate",
        lambda rate: simulate(**{**run(), "plant": nonlinear(rate)}).states,
        lambda: {"rate": linear},
        ("a plant that changes what it is told", {"rate": meddling}),
        ("a plant that returns a column", {"rate": lambda: (lambda x, u: [[x[1]], [u[0]]])}),
    ),
    *same(
        "simulate",
        status,
        lambda: {"rate": lambda x, u: [np.nan, 0.0]},
        ("a plant that returns nothing", {"rate": lambda: (lambda x, u: None)}),
        ("a plant that goes to infinity", {"rate": lambda: (lambda x, u: [np.inf, 0.0])}),
    ),
    *refused("monte_carlo", monte_carlo, lambda: {"schedules": PLAN, "samples": 4}, *SCHEDULES, *SEEDS_AND_STEPS),
    *refused("monte_carlo", monte_carlo, lambda: {"schedules": PLAN, "samples": 4, "plant": PLANT}, *PLANTS),
    *refused("monte_carlo", monte_carlo, lambda: {"schedules": PLAN, "samples": 4}, *[
        (f"{name}: False without a plant", {name: False}, ValueError, f"{name} is for runs of a plant")
        for name in ("noise", "saturation", "operating_point", "domain", "executor")
    ]),
]  # fmt: skip
