"""Two modes of which one switch helps, and an initial state for them."""

from typing import Any

import numpy as np

from switchctl import Gaussian, ModeSet


def modes(**keywords: Any) -> ModeSet:
    """The modes."""
    A = [[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]]
    return ModeSet(A, **{"names": ["fast", "calm"], "dt": 0.1, **keywords})


def x0() -> Gaussian:
    """The initial state."""
    return Gaussian([1.0, 1.0], 0.01 * np.eye(2))
