"""switchctl: which controller should act at each sample.

A plant and several controllers, as python-control objects, become modes (`close_loops`); a method schedules the modes
for an uncertain initial state (`schedule`).
"""

from importlib import import_module
from types import ModuleType

from switchctl.blocks import scheduler_system, switched_controller
from switchctl.closed_loop import ClosedLoops, close_loops
from switchctl.comparison import Comparison, compare
from switchctl.edges import Edge
from switchctl.files import FormatError
from switchctl.gaussian import Gaussian, wasserstein
from switchctl.graph import SwitchingGraph
from switchctl.methods import (
    Constant,
    FewSwitches,
    Method,
    Optimal,
    PointwiseMinimum,
    Policy,
    RecedingHorizon,
    Refine,
    Rollout,
    Rung,
    Scheduler,
    best_single_mode,
    single_mode_costs,
)
from switchctl.modes import Mode, ModeSet
from switchctl.result import Schedule
from switchctl.rules import Budget, ContradictionError, Rules
from switchctl.scheduling import schedule
from switchctl.simulation import MonteCarlo, Run, monte_carlo, simulate
from switchctl.sweeping import Sweep, sweep
from switchctl.switches import Switch
from switchctl.tail_costs import CostParts
from switchctl.trade_offs import TradeOff, trade_off

__version__ = "0.1.0"


def __getattr__(name: str) -> ModuleType:
    """Import guarantees, certificates, pictures and models when they are first asked for."""
    if name in ("stability", "certificates", "plotting", "models"):
        return import_module(f"switchctl.{name}")
    raise AttributeError(f"module 'switchctl' has no attribute {name!r}")


__all__ = [
    "Budget",
    "ClosedLoops",
    "Comparison",
    "Constant",
    "ContradictionError",
    "CostParts",
    "Edge",
    "FewSwitches",
    "FormatError",
    "Gaussian",
    "Method",
    "Mode",
    "ModeSet",
    "MonteCarlo",
    "Optimal",
    "PointwiseMinimum",
    "Policy",
    "RecedingHorizon",
    "Refine",
    "Rollout",
    "Rules",
    "Run",
    "Rung",
    "Schedule",
    "Scheduler",
    "Sweep",
    "Switch",
    "SwitchingGraph",
    "TradeOff",
    "best_single_mode",
    "close_loops",
    "compare",
    "monte_carlo",
    "schedule",
    "scheduler_system",
    "simulate",
    "single_mode_costs",
    "sweep",
    "switched_controller",
    "trade_off",
    "wasserstein",
]
