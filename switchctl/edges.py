"""Moves of a switching graph."""

from typing import NamedTuple

from switchctl.moments import Array


class Edge(NamedTuple):
    """One move of a `SwitchingGraph`: from a node to a node by a step in a mode.

    The step moves the second moment by ``S+ = A S A'`` and costs ``tr(Q S) + constant``, in the unit of
    `Schedule.cost`: Q holds dk times the stage weight and what a switch costs by W2, the constant dk times the running
    price and the fixed cost of the switch.

    Parameters
    ----------
    tail, head : int
        The nodes.
    mode : int
        Index of the mode.
    A, Q : arrays, shape (n, n)
        The step, and what it costs by the second moment before it.
    constant : float
        What it costs besides.
    """

    tail: int
    head: int
    mode: int
    A: Array
    Q: Array
    constant: float
