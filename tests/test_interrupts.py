"""Ctrl-C at any moment of a long call: what there is so far, marked as such, or KeyboardInterrupt and nothing half done.

Whatever it does, no input changes, nothing global stays changed, no file is left in parts, and asked again it answers
as if there had been no interrupt.
"""

import inspect
import signal
import sys
from pathlib import Path

import control
import numpy as np

import switchctl
from switchctl import (
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    SwitchingGraph,
    close_loops,
    compare,
    monte_carlo,
    schedule,
    simulate,
    stability,
    sweep,
    trade_off,
)

PACKAGE = str(Path(switchctl.__file__).parent)
GENERATOR = inspect.CO_GENERATOR
LATE = 0.98  # of the calls: after so many an interrupt may leave nothing out
X0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
LIMIT = 1e6  # seconds


def pair():
    return ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"], dt=0.1)


def small():
    return ModeSet([[[0.8, 1.0], [0.0, 0.3]], [[0.3, 0.0], [0.8, 0.7]]], names=["fast", "calm"], dt=0.1)


class Interrupt:
    """SIGINT at a number of calls, of those within the package."""

    def __init__(self, at=0):
        self.at, self.count = at, 0

    def __call__(self, frame, event, arg):
        code = frame.f_code
        if event == "c_return" or (event == "call" and not code.co_flags & GENERATOR):  # one may be closing
            if not code.co_filename.startswith(PACKAGE):
                return
            self.count += 1
            if self.count == self.at:
                signal.raise_signal(signal.SIGINT)

    def __enter__(self):
        self.handler = signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.setprofile(self)

    def __exit__(self, *error):
        sys.setprofile(None)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, self.handler)


def interrupted(ask, at):
    """The answer (None: KeyboardInterrupt came out), and the calls made."""
    interrupt = Interrupt(at)
    try:
        with interrupt:
            found = ask()
    except KeyboardInterrupt:
        return None, interrupt.count
    return found, interrupt.count


def marked(found):
    """Whether an answer says that it was cut short."""
    if isinstance(found, switchctl.Sweep):
        return bool(np.isnan(found.cost).any())
    if isinstance(found, stability.Report):
        return "not done" in found.reasons.values() or any(
            getattr(getattr(found, name), "status", "") == "interrupted" for name in vars(found)
        )
    return getattr(found, "status", "") == "interrupted"


CASES = {}


def case(function):
    """A case: a function of fresh inputs and a folder that returns the call and its inputs."""
    CASES[function.__name__] = function
    return function


def of_schedule(name, make, method, steps=None, rules=None, **keywords):
    def begun(folder):
        modes = make()
        graph = SwitchingGraph(modes, rules)
        return (lambda: schedule(modes, X0, method, steps, graph, **keywords)), modes

    begun.__name__ = name
    case(begun)


of_schedule("rollout", pair, Rollout(), 30)
of_schedule("receding", pair, RecedingHorizon(7, hold=3), 30)
of_schedule("refine", small, Refine())
of_schedule("refine_finite", small, Refine(), 12, terminal=np.eye(2))
of_schedule("refine_under_rules", small, Refine(RecedingHorizon(3)), 12, Rules(min_dwell=3, switch_cost=0.1))
of_schedule("few_switches", pair, FewSwitches(2))
of_schedule("few_three", small, FewSwitches(3))
of_schedule("optimal", pair, Optimal(gap=1e-3, time_limit=LIMIT), 20)
of_schedule("optimal_finite", small, Optimal(gap=1e-6, time_limit=LIMIT), 8, terminal=np.eye(2))


@case
def hard(folder):
    from switchctl.models import quadrotor

    modes = quadrotor.modes()
    return (lambda: schedule(modes, quadrotor.initial_state(), Optimal(gap=3e-2, time_limit=LIMIT), 10)), modes


@case
def policy(folder):
    modes = small()
    return (lambda: Optimal(gap=0.05, time_limit=LIMIT).policy(modes)), modes


@case
def comparison(folder):
    modes = pair()
    return (lambda: compare(modes, X0, [Rollout(), PointwiseMinimum(), RecedingHorizon(5)], 10)), modes


@case
def sweeping(folder):
    modes = pair()
    return (lambda: sweep(modes, X0, [1, 5], [1, 2], steps=6)), modes


@case
def trading(folder):
    modes = small()
    return (lambda: trade_off(modes, X0, Rules(switch_cost=0.1), "min_dwell", [1, 3, 5], RecedingHorizon(3))), modes


@case
def sampling(folder):
    modes = pair()
    plans = compare(modes, X0, [Rollout(), PointwiseMinimum()], 5)
    return (lambda: monte_carlo(plans, 5000, seed=1)), modes


def loops():
    plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, states=["angle", "rate"], name="axis")
    gains = {"stiff": [[20.0, 6.0]], "soft": [[3.0, 2.0]]}
    return plant, close_loops(plant, gains, dt=0.05, discretize="plant")


@case
def simulating(folder):
    plant, modes = loops()
    return (lambda: simulate(plant, modes, Rollout(), [1.0, 0.0], 8)), modes


@case
def sampling_a_plant(folder):
    plant, modes = loops()
    plan = schedule(modes, X0, Rollout(), 4)
    return (lambda: monte_carlo(plan, 10, seed=1, plant=plant)), modes


def of_stability(name, ask, make=small):
    def begun(folder):
        modes = make()
        return (lambda: ask(modes)), modes

    begun.__name__ = name
    case(begun)


def under_rules(modes):
    return SwitchingGraph(modes, Rules(min_dwell=2))


def two():
    from switchctl.models import five_mode

    return ModeSet(five_mode.modes().A[[2, 4]], names=["A3", "A5"])


def pair_close():  # 1 is between the bounds found in half of the time
    return two()


of_stability("growth", lambda modes: stability.joint_spectral_radius(modes, 1e-3, LIMIT), two)
of_stability("growth_under_rules", lambda modes: stability.joint_spectral_radius(under_rules(modes), 1e-3, LIMIT), two)
of_stability("dwell_time", lambda modes: stability.minimum_dwell_time(modes, LIMIT), two)
of_stability("dwell_times", lambda modes: stability.mode_dependent_dwell_times(modes, LIMIT), two)
of_stability("average_dwell_time", lambda modes: stability.average_dwell_time(modes, LIMIT), two)
of_stability("switching_help", lambda modes: stability.does_switching_help(modes, X0, time_limit=LIMIT), pair)
of_stability("no_help", lambda modes: stability.does_switching_help(modes), two)
of_stability("policy_stability", lambda modes: stability.policy_stability(modes, Rollout()))
of_stability("random_stability", lambda modes: stability.random_stability(modes, [0.5, 0.5]))
of_stability("word_stability", lambda modes: stability.word_stability(modes, [0, 1]))
of_stability("radii", stability.schur_stability)
of_stability(
    "stabilising_word",
    stability.stabilising_word,
    lambda: ModeSet([np.diag([2.0, 0.25]), np.diag([0.25, 2.0])]),
)
of_stability("report", lambda modes: stability.report(modes, X0, time_limit=LIMIT))
