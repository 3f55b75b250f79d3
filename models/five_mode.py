"""Example 1 of the paper: five modes of two states, given as matrices (Lee and Bhattacharya, DSCC 2014).

There is no plant behind them and no sampling period: a sample counts 1 (dk = 1).
"""

from switchctl import Gaussian, Method, ModeSet, PointwiseMinimum

A1 = [[1.01, -0.17], [0.32, -0.48]]
A2 = [[0.06, 0.80], [0.01, -0.77]]
A3 = [[0.72, 0.48], [0.0, 0.55]]
A4 = [[-0.33, -0.65], [-0.46, 0.69]]
A5 = [[-0.13, 0.12], [-1.33, -1.05]]


def plant() -> None:
    """No plant: the paper gives the closed loops."""


def controllers() -> dict[str, list[list[float]]]:
    """Return the modes themselves: the multi-model case."""
    return {"A1": A1, "A2": A2, "A3": A3, "A4": A4, "A5": A5}


def initial_state() -> Gaussian:
    """``N((5, 5), 2.25 I)``."""
    return Gaussian([5.0, 5.0], [[2.25, 0.0], [0.0, 2.25]])


def modes() -> ModeSet:
    """Return the five modes, named as in the paper."""
    matrices = controllers()
    return ModeSet(list(matrices.values()), list(matrices))


def method() -> Method:
    """Return the pointwise minimum, which beats every longer horizon here."""
    return PointwiseMinimum()
