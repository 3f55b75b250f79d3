"""What follows a schedule's last step costs: modes taken once, then a word repeated for ever."""

from typing import NamedTuple

import numpy as np

from switchctl.gramians import word_tail
from switchctl.graph import SwitchingGraph
from switchctl.moments import Array


class CostParts(NamedTuple):
    """A cost in parts: what the state costs, what switches cost, and the running price; each may be infinite."""

    state: float
    switching: float
    running: float


def tail_parts(graph: SwitchingGraph, before: int, lead: tuple[int, ...], word: tuple[int, ...], S: Array) -> CostParts:
    """Cost of a lead and then a word repeated for ever.

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
    A, Q, dk = graph.modes.A, graph.modes.Q, graph.modes.dk
    state = switching = running = 0.0
    for mode in lead:
        state += dk * np.sum(Q[mode] * S)
        switching += graph.switch_cost[before, mode] + graph.switch_cost_per_w2[before, mode] * np.trace(S)
        running += dk * graph.price[mode]
        before, S = mode, A[mode] @ S @ A[mode].T
    by_state, by_switches = word_costs(graph, word)
    state += np.inf if by_state is None else float(dk * np.sum(by_state * S))
    switching += graph.switch_cost[before, word[0]] + graph.switch_cost_per_w2[before, word[0]] * np.trace(S)
    switching += np.inf if by_switches is None else float(np.sum(by_switches * S))
    if graph.price[list(word)].any():
        running = np.inf
    return CostParts(float(state), float(switching), float(running))


def word_value(graph: SwitchingGraph, word: tuple[int, ...]) -> Array | None:
    """Cost matrix per dk of a word repeated for ever, apart from the switch to its first mode.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and what switches cost.
    word : tuple of int
        The modes.

    Returns
    -------
    array, shape (n, n), or None
        None where it is infinite.
    """
    state, switching = word_costs(graph, word)
    if state is None or switching is None or graph.price[list(word)].any():
        return None
    return state + switching / graph.modes.dk


def word_costs(graph: SwitchingGraph, word: tuple[int, ...]) -> tuple[Array | None, Array | None]:
    """Cost matrices of a word repeated for ever, apart from the switch to its first mode.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes and what switches cost.
    word : tuple of int
        The modes.

    Returns
    -------
    state, switching : arrays, shape (n, n), or None
        What the state costs, per dk, and what switches cost; None where it is infinite.
    """
    state = word_tail(graph.modes.A, graph.modes.Q, word)
    here, before = np.array(word), np.array([word[-1], *word[:-1]])
    by_w2, identity = graph.switch_cost_per_w2[before, here], np.eye(graph.modes.A.shape[-1])
    if graph.switch_cost[before, here].any():
        return state, None
    if not by_w2.any():
        return state, np.zeros_like(identity)
    switching = word_tail(graph.modes.A[here], by_w2[:, None, None] * identity, tuple(range(len(word))))
    return state, None if switching is None else switching - by_w2[0] * identity
