"""What the package answers to a bit: every method, guarantee, certificate and run, on small cases of every kind."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import control
import numpy as np
from pair import modes, x0

from switchctl import (
    Budget,
    Constant,
    FewSwitches,
    Gaussian,
    Method,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Run,
    Schedule,
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
from switchctl.models import five_mode, quadrotor

ENDLESS = 1e6  # seconds: what is decided by tolerance never meets the limit of time
METHODS = {
    "constant": Constant(0),
    "pointwise": PointwiseMinimum(),
    "horizon": RecedingHorizon(7, hold=3),
    "horizon for ever": RecedingHorizon(math.inf, hold=2),
    "constrained": RecedingHorizon(4, hold=2, decrease=0.3),
    "rollout": Rollout(),
    "refine": Refine(),
    "few switches": FewSwitches(2),
    "optimal": Optimal(gap=1e-4, time_limit=ENDLESS),
}
RULES = Rules(min_dwell=3, switch_cost=0.05, budget=Budget(use={"fast": 0.1}, limit=0.3, window=5))
TIMES = {"seconds", "seconds of bounds", "seconds of refine"}  # what a search tells of its time


class Cases:
    """The modes that all answers are about, shared by whoever asks."""

    def __init__(self):
        self.pair, self.x0 = modes(), x0()
        self.graph = SwitchingGraph(self.pair, RULES)
        self.five, self.start = five_mode.modes(), five_mode.initial_state()
        self.quadrotor, self.attitude = quadrotor.modes(), quadrotor.initial_state()
        plant = control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, states=["angle", "rate"], name="axis")
        gains = {"stiff": [[20.0, 6.0]], "soft": [[3.0, 2.0]]}
        self.noisy = close_loops(plant, gains, dt=0.05, W=np.diag([0.0, 0.01]), cost="average", discretize="plant")
        self.two = ModeSet(self.five.A[[2, 4]], names=["A3", "A5"])
        self.plant, self.random = plant, ModeSet(np.random.default_rng(5).standard_normal((3, 6, 6)) * 0.34)


def questions(cases, known):
    """By name, what computes an answer; some use those already known."""
    five, x0, pair, graph = cases.five, cases.start, cases.pair, cases.graph
    asked = {}
    for name, method in METHODS.items():
        asked[name] = lambda method=method: schedule(pair, cases.x0, method)
        asked[f"{name}, five modes"] = lambda method=method: schedule(five, x0, method)
        if name not in ("constant", "constrained"):
            asked[f"{name}, rules"] = lambda method=method: schedule(pair, cases.x0, method, rules=graph)
    asked |= {
        "policy": lambda: Optimal(gap=0.2, time_limit=ENDLESS).policy(pair),
        "followed": lambda: schedule(pair, cases.x0, known["policy"]),
        "finite": lambda: schedule(five, x0, Optimal(gap=1e-3, time_limit=ENDLESS), 30, terminal=np.eye(2)),
        "hard": lambda: schedule(cases.quadrotor, cases.attitude, Optimal(gap=6e-2, time_limit=ENDLESS)),
        "six states": lambda: schedule(
            cases.random, Gaussian(np.ones(6), np.eye(6)), Optimal(gap=4e-2, time_limit=ENDLESS)
        ),
        "noise": lambda: schedule(cases.noisy, Gaussian([1.0, 0.0], 0.01 * np.eye(2)), Rollout(), 200),
        "comparison": lambda: compare(five, x0, list(METHODS.values())[1:6]).rows(),
        "sweep": lambda: sweep(five, x0, [1, 5, 20], [1, 3]).cost,
        "trade-off": lambda: trade_off(pair, cases.x0, Rules(switch_cost=0.1), over="min_dwell", values=[1, 5]).rows(),
        "samples": lambda: monte_carlo(compare(five, x0, [Rollout(), PointwiseMinimum()]), 3000, seed=3),
        "noisy samples": lambda: monte_carlo(known["noise"], 300, steps=50, seed=3),
        "run": lambda: simulate(cases.plant, cases.noisy, Rollout(), Gaussian([1.0, 0.0], np.eye(2)), 30, seed=4),
        "runs": lambda: monte_carlo(known["noise"], 3, steps=10, seed=3, plant=cases.plant),
    }
    limit = {"time_limit": ENDLESS}
    asked |= {
        "radii": lambda: stability.schur_stability(five),
        "word": lambda: stability.word_stability(five, [0, 1, 4]),
        "stabilising": lambda: stability.stabilising_word(ModeSet([np.diag([2.0, 0.25]), np.diag([0.25, 2.0])])),
        "random": lambda: stability.random_stability(five, [0.1, 0.3, 0.3, 0.2, 0.1]),
        "growth": lambda: stability.joint_spectral_radius(five, 1e-3, **limit),
        "growth under rules": lambda: stability.joint_spectral_radius(graph, 1e-3, **limit),
        "dwell": lambda: stability.minimum_dwell_time(cases.two, **limit),
        "dwells": lambda: stability.mode_dependent_dwell_times(cases.two, **limit),
        "average dwell": lambda: stability.average_dwell_time(cases.two, **limit),
        "help": lambda: stability.does_switching_help(five, x0, gap=1e-4, **limit),
        "of rollout": lambda: stability.policy_stability(five, Rollout()),
        "of a horizon": lambda: stability.policy_stability(five, METHODS["constrained"]),
        "report": lambda: stability.report(pair, cases.x0, **limit),
    }
    proven = "refine", "optimal, five modes", "finite", "growth", "growth under rules", "dwell", "dwells"
    for name in (*proven, "average dwell", "help", "of rollout", "word"):
        asked[f"certificate of {name}"] = lambda name=name: json.dumps(certified(known[name]).document)
    return asked


def certified(found):
    """A certificate, of a schedule to a gap that takes no time."""
    return certify(found, 0.05, time_limit=ENDLESS) if isinstance(found, Schedule) else certify(found)


def plain(found):
    """An answer as JSON, every float to its last bit, dicts in their order, without seconds."""
    if isinstance(found, (str, bool, int)) or found is None:
        return found
    if isinstance(found, (float, np.floating)):
        return float(found).hex()
    if isinstance(found, (ModeSet, SwitchingGraph, Method, control.NonlinearIOSystem)):
        return type(found).__name__ if not hasattr(found, "tables") else plain((found.tables, found.factor))
    if isinstance(found, np.ndarray):
        return [str(found.dtype), list(found.shape), hashlib.sha256(np.ascontiguousarray(found).tobytes()).hexdigest()]
    if isinstance(found, Run):
        return plain([found.states, found.inputs, found.outputs, found.sequence, found.w2, found.status])
    if isinstance(found, Schedule):
        return [
            plain(found.cost),
            plain(found.w2),
            *(plain(getattr(found, f.name)) for f in fields(found) if f.name != "method"),
        ]
    if is_dataclass(found):
        return [plain(getattr(found, field.name)) for field in fields(found)]
    if isinstance(found, Mapping):
        return [[plain(key), plain(value)] for key, value in found.items() if key not in TIMES]
    if isinstance(found, (tuple, list)):
        return [plain(entry) for entry in found]
    return plain(vars(found)) if hasattr(found, "__dict__") else plain(np.asarray(found))


def digest(found):
    """Few characters that tell answers apart."""
    return hashlib.sha256(json.dumps(plain(found)).encode()).hexdigest()[:12]


def found(cases=None, without=()):
    """Every answer, by name."""
    known = {}
    for name, ask in questions(Cases() if cases is None else cases, known).items():
        if name not in without:
            known[name] = ask()
    return known


def digests(answers):
    """The digest of every answer, by name."""
    return {name: digest(answer) for name, answer in answers.items()}
