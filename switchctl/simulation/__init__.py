"""Runs of the loops beyond their modes: nonlinear and sampled, one by one and in numbers."""

from switchctl.simulation.estimates import MonteCarlo
from switchctl.simulation.monte_carlo import monte_carlo
from switchctl.simulation.response import Run
from switchctl.simulation.run import simulate

__all__ = ["MonteCarlo", "Run", "monte_carlo", "simulate"]
