"""Guarantees: when switching is stable, whether it helps at all, and how long a controller must dwell."""

from switchctl.stability.average_dwell_time import AverageDwellTime, average_dwell_time
from switchctl.stability.dwell_time import DwellTime, DwellTimes, minimum_dwell_time, mode_dependent_dwell_times
from switchctl.stability.joint_spectral_radius import JointSpectralRadius, joint_spectral_radius

__all__ = [
    "AverageDwellTime",
    "DwellTime",
    "DwellTimes",
    "JointSpectralRadius",
    "average_dwell_time",
    "joint_spectral_radius",
    "minimum_dwell_time",
    "mode_dependent_dwell_times",
]
