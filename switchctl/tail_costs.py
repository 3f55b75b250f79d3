"""What follows a schedule's last step costs: modes taken once, then a word repeated for ever."""

from typing import NamedTuple

import numpy as np

from switchctl.gramians import transform, word_tail
from switchctl.graph import SwitchingGraph
from switchctl.modes import ModeSet
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
    modes, dk = graph.modes, graph.modes.dk
    state = switching = running = 0.0
    for mode in lead:
        A = modes.A_after[before, mode]
        state += dk * np.sum(modes.Q_after[before, mode] * S)
        switching += _switch(graph, before, mode, S)
        running += dk * graph.price[mode]
        before, S = mode, A @ S @ A.T
    by_state, by_switches = word_costs(graph, word)
    switching += _switch(graph, before, word[0], S)
    if modes.activation is not None:
        E = modes.activation[before, word[0]] if before >= 0 else np.eye(len(S))
        S = E @ S @ E.T
    state += np.inf if by_state is None else float(dk * np.sum(by_state * S))
    switching += np.inf if by_switches is None else float(np.sum(by_switches * S))
    if graph.price[list(word)].any():
        running = np.inf
    return CostParts(float(state), float(switching), float(running))


def _switch(graph: SwitchingGraph, before: int, mode: int, S: Array) -> float:
    w2 = np.sum(graph.modes.distance * S)
    return float(graph.switch_cost[before, mode] + graph.switch_cost_per_w2[before, mode] * w2)


def word_value(graph: SwitchingGraph, word: tuple[int, ...]) -> Array | None:
    """Cost matrix per dk of a word repeated for ever, after the switch to its first mode.

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
    """Cost matrices of a word repeated for ever, after the switch to its first mode.

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
    modes, here, before = graph.modes, np.array(word), np.array([word[-1], *word[:-1]])
    A, Q = modes.A_after[before, here], modes.Q_after[before, here]
    state = _after_switch(modes, word, A, Q, modes.Q[word[0]])
    if graph.switch_cost[before, here].any():
        return state, None
    by_w2 = graph.switch_cost_per_w2[before, here, None, None] * modes.distance
    return state, _after_switch(modes, word, A, by_w2, np.zeros_like(modes.distance))


def _after_switch(modes: ModeSet, word: tuple[int, ...], A: Array, Q: Array, first: Array) -> Array | None:
    """What steps A at the costs Q cost, repeated for ever, where the first one begins after its switch."""
    if not Q.any():
        return np.zeros_like(first)
    P = word_tail(A, Q, tuple(range(len(word))))
    if P is None or (np.array_equal(A[0], modes.A[word[0]]) and np.array_equal(Q[0], first)):
        return P
    for k in range(len(word) - 1, 0, -1):
        P = Q[k] + transform(A[k], P)
    return first + transform(modes.A[word[0]], P)
