"""Changes of mode along a sequence."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Switch(NamedTuple):
    """A change of mode: the first step of the new mode, and the modes before and after.

    Parameters
    ----------
    step : int
        From 0.
    before, after : int
        Indices of the modes.
    """

    step: int
    before: int
    after: int


def switches_of(sequence: NDArray[np.intp], start: int) -> tuple[Switch, ...]:
    """Every change of mode, also at the first step from the mode before it (-1 for none)."""
    before = np.concatenate([[sequence[0] if start < 0 else start], sequence[:-1]])
    return tuple(Switch(int(k), int(before[k]), int(sequence[k])) for k in np.flatnonzero(before != sequence))
