"""One mode held: its moments, costs and nodes step after step."""

import numpy as np
from numpy.typing import NDArray

from switchctl.graph import SwitchingGraph
from switchctl.moments import Array


class Orbit:
    """The powers of a matrix on a vector, by doubling: ``M^k x`` for k = 0 .. steps.

    Parameters
    ----------
    M : array, shape (d, d)
        The matrix.
    """

    def __init__(self, M: Array) -> None:
        self.squares = [M]

    def square(self, j: int) -> Array:
        """``M^(2^j)``."""
        while len(self.squares) <= j:
            self.squares.append(self.squares[-1] @ self.squares[-1])
        return self.squares[j]

    def from_(self, x: Array, steps: int) -> Array:
        """The rows ``M^k x``, shape (steps + 1, d)."""
        rows = x[None]
        for j in range(int(steps).bit_length()):
            rows = np.concatenate([rows, rows @ self.square(j).T])
        return rows[: steps + 1]


def held_nodes(graph: SwitchingGraph, node: int, mode: int, steps: int) -> NDArray[np.intp]:
    """The nodes while a mode is held, for so many steps at most: fewer where the rules end it."""
    if graph.free:
        return np.zeros(steps + 1, dtype=np.intp)
    nodes, successor = [node], graph.successor[:, mode]
    while len(nodes) <= steps and (node := int(successor[node])) >= 0:
        nodes.append(node)
    return np.array(nodes, dtype=np.intp)
