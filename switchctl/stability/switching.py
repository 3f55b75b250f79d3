"""Mean-square stability of switching that is fixed beforehand: a mode, a word repeated for ever, random switching."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from control import ControlDimension
from scipy.sparse.csgraph import connected_components

from switchctl.continuation import lasting
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.limits import indices
from switchctl.modes import ModeSet, require_modes
from switchctl.moments import Array
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.upper import contracting_walk
from switchctl.stability.growth import GrowthRate, growth_rate
from switchctl.stability.moment_operator import Move
from switchctl.validation import real_array

_SUM = 1e-9
_CHOICES = 1000  # of a graph, from which words are tried


def schur_stability(modes: ModeSet) -> tuple[GrowthRate, ...]:
    """Bound the spectral radius of each mode.

    Parameters
    ----------
    modes : ModeSet
        The modes.

    Returns
    -------
    tuple of GrowthRate
        One a mode.

    Raises
    ------
    TypeError
        If modes is not a ModeSet.

    Examples
    --------
    >>> from switchctl.stability import schur_stability
    >>> for rate in schur_stability(ModeSet([[[0.5, 9.0], [0.0, 0.25]], [[1.0, 1.0], [-1.0, 1.0]]])):
    ...     print(rate)
    GrowthRate: stable
    ├── of     A0 held
    ├── rate   between 0.5 and 0.5 per step
    └── graph  1 node, 1 move
    GrowthRate: unstable
    ├── of     A1 held
    ├── rate   between 1.41421356 and 1.41421356 per step
    └── graph  1 node, 1 move
    """
    require_modes(modes)
    return tuple(_word(modes, (i,), f"{modes.names[i]} held") for i in range(len(modes)))


def word_stability(modes: ModeSet | SwitchingGraph, word: Iterable[Any]) -> GrowthRate:
    """Bound the growth per step of a word of modes repeated for ever.

    Node k of the result is that before the k-th step of the word.

    Parameters
    ----------
    modes : ModeSet or SwitchingGraph
        The modes. A graph's rules must let the word be repeated for ever from some node.
    word : sequence of int, str or Mode
        The modes of one period, by index or name, first step first.

    Returns
    -------
    GrowthRate

    Raises
    ------
    ValueError
        If the word is empty, or the rules forbid a step of it; the message says which.
    TypeError, KeyError, IndexError
        If modes is neither a ModeSet nor a SwitchingGraph, or the word names something that is no mode.

    Examples
    --------
    >>> from switchctl.stability import word_stability
    >>> modes = ModeSet([[[0.0, 2.0], [0.0, 0.5]], [[0.5, 0.0], [2.0, 0.0]]])  # both stable, but not in turn
    >>> word_stability(modes, ["A0", "A1"])
    GrowthRate: unstable
    ├── of     A0 A1 repeated
    ├── rate   between 2 and 2 per step
    └── graph  2 nodes, 2 moves
    """
    graph = as_graph(modes)
    told = tuple(indices(graph.modes, word, "word", "modes, such as [0, 1]"))
    if not told:
        raise ValueError("word is empty; give at least one mode")
    if not lasting(graph, told).any():
        graph.walk(told * (len(graph) + 1))  # raises: it would have to return to a node otherwise
    names = " ".join(graph.modes.names[i] for i in told)
    return _word(graph.modes, told, f"{names} repeated")


def _word(modes: ModeSet, word: tuple[int, ...], of: str) -> GrowthRate:
    p = len(word)
    moves = [Move(k, (k + 1) % p, i, 1.0, modes.A_after[word[k - 1], i]) for k, i in enumerate(word)]
    noise = (np.full(p, 1 / p), np.roll(modes.W[list(word)], 1, axis=0) / p) if modes.noisy else None
    return growth_rate(of, moves, p, noise)


def stabilising_word(modes: ModeSet | SwitchingGraph) -> GrowthRate | None:
    """Look for a word that is stable when repeated for ever; modes that are unstable alone may have one.

    Products are tried from the shortest on, the smallest of each length; whether such a word exists is undecidable in
    general, so not finding one proves nothing.

    Parameters
    ----------
    modes : ModeSet or SwitchingGraph
        The modes, with or without rules.

    Returns
    -------
    GrowthRate or None
        Of the word, which is its ``word``; None where none was found.

    Raises
    ------
    TypeError
        If modes is neither a ModeSet nor a SwitchingGraph.

    Examples
    --------
    >>> from switchctl.stability import stabilising_word
    >>> found = stabilising_word(ModeSet([[[2.0, 0.0], [0.0, 0.25]], [[0.25, 0.0], [0.0, 2.0]]]))
    >>> found.word, round(found.upper, 6)
    ((0, 1), 0.707107)
    """
    with np.errstate(over="ignore", invalid="ignore"):  # products that are not finite are left out
        decisions = Decisions(as_graph(modes))
        decisions.reachable(_CHOICES)
        found = contracting_walk(decisions, costing=True)
    if found is None:
        return None
    at, word = found[0], list[int]()
    for number in found[1]:
        move = decisions.moves(at)[number]
        word, at = [*word, *move.word], move.head
    rate = word_stability(modes, word)
    return rate if rate.verdict == "stable" else None


def random_stability(modes: ModeSet, probabilities: Any) -> GrowthRate:
    """Bound the growth of the second moment under random switching.

    Independent switching draws each step's mode with the same probabilities. Markov switching remembers the mode of the
    step before: after mode i, the next is j with the probability in row i, column j. The nodes of the result are then
    the modes of the step before, and it holds whatever the first of them. (Independent switching of modes with an
    ``activation`` has these nodes too.)

    Parameters
    ----------
    modes : ModeSet
        The modes.
    probabilities : array_like, shape (m,) or (m, m)
        Of the modes, or of the next mode by the mode before. They add up to 1 (within 1e-9; what is missing is made up
        for).

    Returns
    -------
    GrowthRate
        With process noise its ``stationary`` tells the second moment given the mode of the step before, and in all.

    Raises
    ------
    ValueError
        If a probability is negative or they don't add up to 1; with noise, if the chain has no unique stationary
        distribution.
    TypeError
        If an argument is of the wrong kind.

    Examples
    --------
    >>> from switchctl.stability import random_stability
    >>> modes = ModeSet([[[0.5]], [[1.2]]])
    >>> random_stability(modes, [0.5, 0.5])  # the square root of (0.25 + 1.44) / 2
    GrowthRate: stable
    ├── of     independent random switching
    ├── rate   between 0.919238816 and 0.919238816 per step
    └── graph  1 node, 2 moves
    >>> random_stability(modes, [[0.1, 0.9], [0.1, 0.9]]).verdict  # after any mode, A1 with probability 0.9
    'unstable'
    """
    require_modes(modes)
    chain, m = real_array(probabilities, "probabilities"), len(modes)
    if chain.shape not in ((m,), (m, m)):
        raise ControlDimension(f"probabilities has shape {chain.shape}; expected {(m,)} or {(m, m)}")
    chain = _distributions(chain)
    independent = chain.ndim == 1
    of = "independent random switching" if independent else "Markov switching"
    if independent and modes.activation is None:
        moves = [Move(0, 0, i, float(p), modes.A[i]) for i, p in enumerate(chain) if p > 0]
        noise = (np.ones(1), np.einsum("i,ijk->jk", chain, modes.W)[None]) if modes.noisy else None
        return growth_rate(of, moves, 1, noise)
    chain = np.broadcast_to(chain, (m, m))
    moves = [Move(i, j, j, float(chain[i, j]), modes.A_after[i, j]) for i, j in np.argwhere(chain > 0).tolist()]
    if not modes.noisy:
        return growth_rate(of, moves, m)
    share = _stationary_distribution(chain, modes.names)
    return growth_rate(of, moves, m, (share, share[:, None, None] * modes.W))


def _distributions(given: Array) -> Array:
    """Probabilities, checked and made to add up to 1."""
    for i, row in enumerate(np.atleast_2d(given)):
        where = "probabilities" if given.ndim == 1 else f"row {i} of probabilities"
        if (row < 0).any():
            raise ValueError(f"{where} has an entry {row.min():.6g}; expected probabilities of at least 0")
        if abs(row.sum() - 1) > _SUM:
            raise ValueError(f"the sum of {where} is {row.sum():.12g}; expected 1")
    normalised: Array = given / given.sum(axis=-1, keepdims=True)
    return normalised


def _stationary_distribution(chain: Array, names: tuple[str, ...]) -> Array:
    """How often each state is visited in the long run, by Grassmann, Taksar and Heyman, without a subtraction."""
    count, group = connected_components(chain > 0, connection="strong")
    closed = [c for c in range(count) if not chain[np.ix_(group == c, group != c)].any()]
    if len(closed) > 1:
        told = ["{" + ", ".join(names[i] for i in np.flatnonzero(group == c)) + "}" for c in closed]
        raise ValueError(
            f"with noise the chain must have one stationary distribution, and {' and '.join(told)} are never left once "
            "entered; treat each of these sets of modes alone"
        )
    states = np.flatnonzero(group == closed[0])
    P = chain[np.ix_(states, states)].copy()
    for k in range(len(P) - 1, 0, -1):
        P[:k, k] /= P[k, :k].sum()
        P[:k, :k] += np.outer(P[:k, k], P[k, :k])
    weights = np.ones(len(P))
    for k in range(1, len(P)):
        weights[k] = weights[:k] @ P[:k, k]
    share = np.zeros(len(chain))
    share[states] = weights / weights.sum()
    return share
