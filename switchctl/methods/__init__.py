"""The methods of scheduling, one a file."""

from switchctl.methods.base import Method, Scheduler
from switchctl.methods.constant import Constant, best_single_mode, single_mode_costs
from switchctl.methods.few_switches import FewSwitches
from switchctl.methods.least import least_cost
from switchctl.methods.optimal import Optimal, Rung
from switchctl.methods.pointwise import PointwiseMinimum
from switchctl.methods.policy import Policy
from switchctl.methods.receding_horizon import RecedingHorizon
from switchctl.methods.refine import Refine
from switchctl.methods.rollout import Rollout

__all__ = [
    "Constant",
    "FewSwitches",
    "Method",
    "Optimal",
    "PointwiseMinimum",
    "Policy",
    "RecedingHorizon",
    "Refine",
    "Rollout",
    "Rung",
    "Scheduler",
    "best_single_mode",
    "least_cost",
    "single_mode_costs",
]
