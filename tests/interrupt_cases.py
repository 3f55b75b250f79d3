"""What is interrupted: every call that may take long, small enough to be asked many times."""

import json
from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np
from pair import modes as pair
from pair import x0

from switchctl import (
    FewSwitches,
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
from switchctl.certificates import certify

X0 = x0()
LIMIT = 1e6  # seconds


def small():
    return ModeSet([[[0.8, 1.0], [0.0, 0.3]], [[0.3, 0.0], [0.8, 0.7]]], names=["fast", "calm"], dt=0.1)


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


def of_plan(name, ask):
    """What is done with a schedule and a folder."""

    def begun(folder):
        modes = small()
        plan = schedule(modes, X0, Refine())
        return (lambda: ask(plan, Path(folder))), modes

    begun.__name__ = name
    case(begun)


def drawn(plan, folder):
    plan.plot()
    plt.close("all")


of_plan("certifying", lambda plan, folder: json.dumps(certify(plan, 1e-2, time_limit=LIMIT).document))
of_plan("saving", lambda plan, folder: plan.save(folder / "plan.json").read_bytes().hex())
of_plan("table", lambda plan, folder: plan.to_csv(folder / "plan.csv").read_text())
of_plan("plotting", drawn)
