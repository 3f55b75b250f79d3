"""Guarantees: when switching is stable, whether it helps at all, and how long a controller must dwell."""

from switchctl.stability.average_dwell_time import AverageDwellTime, average_dwell_time
from switchctl.stability.dwell_time import DwellTime, DwellTimes, minimum_dwell_time, mode_dependent_dwell_times
from switchctl.stability.falling import Fall
from switchctl.stability.growth import GrowthRate, Stationary
from switchctl.stability.helps import SwitchingHelp, does_switching_help
from switchctl.stability.joint_spectral_radius import JointSpectralRadius, joint_spectral_radius
from switchctl.stability.moment_operator import Move
from switchctl.stability.policies import PolicyStability, policy_stability
from switchctl.stability.report import PairGrowth, Report, report
from switchctl.stability.switching import random_stability, schur_stability, stabilising_word, word_stability
from switchctl.stability.transient_growth import TransientGrowth

__all__ = [
    "AverageDwellTime",
    "DwellTime",
    "DwellTimes",
    "Fall",
    "GrowthRate",
    "JointSpectralRadius",
    "Move",
    "PairGrowth",
    "PolicyStability",
    "Report",
    "Stationary",
    "SwitchingHelp",
    "TransientGrowth",
    "average_dwell_time",
    "does_switching_help",
    "joint_spectral_radius",
    "minimum_dwell_time",
    "mode_dependent_dwell_times",
    "policy_stability",
    "random_stability",
    "report",
    "schur_stability",
    "stabilising_word",
    "word_stability",
]
