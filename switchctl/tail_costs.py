"""What follows a schedule's last step costs, in parts: modes taken once, then a word repeated for ever."""

from typing import NamedTuple

import numpy as np

from switchctl.graph import SwitchingGraph
from switchctl.moments import Array
from switchctl.values import cost_of, repeated


class CostParts(NamedTuple):
    """A cost in parts: what the state costs, what switches cost, and the running price; each may be infinite.

    Parameters
    ----------
    state, switching, running : float
        The parts, in the unit of `Schedule.cost`.
    """

    state: float
    switching: float
    running: float


def step_parts(graph: SwitchingGraph, before: int, mode: int, S: Array) -> tuple[float, float, float]:
    """What a step costs per dk: the state, the switch and the running price.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and what switches cost.
    before, mode : int
        The modes.
    S : array, shape (n, n)
        The second moment before the switch.

    Returns
    -------
    tuple of float
    """
    modes, dk = graph.modes, graph.modes.dk
    w2 = float(np.sum(modes.distance * S))
    state = float(np.sum(modes.Q_after[before, mode] * S) + modes.offset[mode])
    switch = graph.switch_cost[before, mode] + graph.switch_cost_per_w2[before, mode] * w2
    return state, float(switch / dk), float(graph.price[mode])


def tail_parts(graph: SwitchingGraph, before: int, lead: tuple[int, ...], word: tuple[int, ...], S: Array) -> CostParts:
    """Cost of a lead and then a word repeated for ever; of an average, that of the word.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and what switches cost.
    before : int
        The mode before.
    lead, word : tuples of int
        The modes.
    S : array, shape (n, n)
        The second moment at the beginning.

    Returns
    -------
    CostParts
    """
    modes, paid, weight = graph.modes, np.zeros(3), 1.0
    for mode in lead:
        paid += weight * np.array(step_parts(graph, before, mode, S))
        A = modes.A_after[before, mode]
        S, before, weight = A @ S @ A.T + modes.W[mode], mode, weight * modes.discount
    for_ever = np.array(_word_parts(graph, before, word, S))
    if modes.cost == "average":
        return CostParts(*for_ever.tolist())
    return CostParts(*(modes.dk * paid + weight * for_ever).tolist())


def _word_parts(graph: SwitchingGraph, before: int, word: tuple[int, ...], S: Array) -> list[float]:
    """What a word repeated for ever costs, by state, switches and running price."""
    modes, dk, first = graph.modes, graph.modes.dk, word[0]
    here, there = np.array(word), np.array([word[-1], *word[:-1]])
    nothing, free = np.zeros_like(modes.Q_after[there, here]), np.zeros(len(word))
    by_w2 = graph.switch_cost_per_w2[there, here, None, None] / dk * modes.distance
    charges = [
        (modes.Q_after[there, here], modes.offset[here], (modes.Q[first], float(modes.offset[first]))),
        (by_w2, graph.switch_cost[there, here] / dk, (nothing[0], 0.0)),
        (nothing, free + graph.price[here], (nothing[0], float(graph.price[first]))),
    ]
    entry = step_parts(graph, before, first, S)[1]
    if modes.activation is not None and before >= 0:
        S = modes.activation[before, first] @ S @ modes.activation[before, first].T
    costs = []
    for Q, r, begin in charges:
        value = repeated(modes, word, Q, r, begin)
        costs.append(np.inf if value is None else cost_of(modes, value, S))
    if modes.cost != "average":
        costs[1] += dk * entry
    return costs
