"""Gripenberg's branch and bound for the joint spectral radius, on a graph and in quadratic norms.

Products are multiplied out move by move from every node. One whose norm is at most ``target ** steps`` goes no further:
every run can be cut into such products and those that are left when the budget ends, each of which is cut where it
grew the least (G. Gripenberg, Linear Algebra Appl. 234, 1996).
"""

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array
from switchctl.stability.moves import LEAST, Indices, Moves

Tree = list[tuple[Indices, Indices, NDArray[np.bool_]]]


class Cycle(NamedTuple):
    """Moves that lead from a node back to it, and the growth of a step when they are repeated for ever."""

    rate: float
    edges: tuple[int, ...]


class Branching(NamedTuple):
    """What a branch and bound found.

    The tree is a list of levels: each product's number in the level before, its last move, and whether runs are cut
    there.
    """

    cycle: Cycle
    upper: float
    tree: Tree


class _Level(NamedTuple):
    parent: Indices
    edge: Indices
    start: Indices
    end: Indices
    product: Array
    wrong: Array  # by how much rounding may have moved its norm
    steps: Array
    least: Array  # the least growth of a step at which the product can be cut
    cut: Indices  # the level where that is


def branch(moves: Moves, cycle: Cycle, tol: float, goal: float, budget: int, deadline: float) -> Branching:
    """Search all products until their growth is known to a tolerance.

    Parameters
    ----------
    moves : Moves
        The moves, in states whose Euclidean norms are those to use.
    cycle : Cycle
        The greatest growth known.
    tol : float
        Stop where the upper bound exceeds the lower one by this, relative.
    goal : float
        Or at this upper bound.
    budget : int
        The most products.
    deadline : float
        Stop at this reading of `time.perf_counter`.

    Returns
    -------
    Branching
    """
    lengths, n = moves.lengths, moves.A.shape[-1]
    after = [np.flatnonzero(moves.tail == v) for v in range(len(moves))]
    V = len(moves)
    nodes = np.arange(V)
    nothing = np.tile(np.eye(n), (V, 1, 1))
    none, sizes = np.zeros(V), np.linalg.norm(moves.A, 2, axis=(1, 2))
    wrong = moves.wrong.sum(axis=(1, 2)) + 2 * n**2 * np.finfo(float).eps * sizes
    levels = [_Level(nodes, nodes, nodes, nodes, nothing, none, none, np.full(V, np.inf), np.full(V, -1))]
    count, upper, patterns = 0, 0.0, np.tile(np.eye(n, dtype=bool), (V, 1, 1))
    pattern = (moves.A != 0) | (moves.wrong != 0)
    while True:
        last = levels[-1]
        target = max(cycle.rate * (1 + tol), goal)
        cut = last.least <= target
        upper, alive = max(upper, float(last.least[cut].max(initial=0.0))), np.flatnonzero(~cut)
        ways = [after[v] for v in last.end[alive]]
        count += sum(map(len, ways))
        if not len(alive) or count > budget or time.perf_counter() > deadline:
            break
        parent = np.repeat(alive, [len(way) for way in ways])
        edge = np.concatenate(ways)
        product, steps = moves.A[edge] @ last.product[parent], last.steps[parent] + lengths[edge]
        before = np.linalg.norm(last.product, axis=(1, 2))[parent]
        with np.errstate(over="ignore", invalid="ignore"):
            doubt = (sizes + wrong)[edge] * last.wrong[parent] + wrong[edge] * before
        norms, patterns = np.linalg.norm(product, 2, axis=(1, 2)) + doubt, pattern[edge] @ patterns[parent]
        growth = np.where(patterns.any(axis=(1, 2)), np.maximum(norms, LEAST), 0.0) ** (1 / steps)
        better = growth < last.least[parent]
        level = _Level(
            parent,
            edge,
            last.start[parent],
            moves.head[edge],
            product,
            doubt,
            steps,
            np.where(better, growth, last.least[parent]),
            np.where(better, len(levels), last.cut[parent]),
        )
        levels.append(level)
        cycle = _greatest(moves, level, growth, cycle, levels)
    return Branching(cycle, max(upper, float(last.least[alive].max(initial=0.0))), _cuts(levels))


def _greatest(moves: Moves, level: _Level, growth: Array, cycle: Cycle, levels: list[_Level]) -> Cycle:
    """The cycle that grows most, of the one known and those of a level."""
    closed = np.flatnonzero((level.start == level.end) & (growth > cycle.rate))
    if not len(closed):
        return cycle
    radii = np.abs(np.linalg.eigvals(level.product[closed])).max(axis=1)
    rates = radii ** (1 / level.steps[closed])
    best = int(rates.argmax())
    if rates[best] <= cycle.rate * (1 + 1e-12):
        return cycle
    place = int(closed[best])
    edges: list[int] = []
    for one in reversed(levels[1:]):
        edges.append(int(one.edge[place]))
        place = int(one.parent[place])
    return Cycle(float(rates[best]), tuple(reversed(edges)))


def _cuts(levels: list[_Level]) -> Tree:
    """The tree of products up to where they are cut."""
    marks = [np.zeros(len(level.edge), dtype=bool) for level in levels]
    expanded = [np.zeros(len(level.edge), dtype=bool) for level in levels]
    for k, level in enumerate(levels[1:], 1):
        expanded[k - 1][level.parent] = True
    at = cut = np.empty(0, dtype=np.intp)  # where the ways back from the leaves are, and where each is cut
    for k in range(len(levels) - 1, 0, -1):
        leaves = np.flatnonzero(~expanded[k])
        at, cut = np.concatenate([at, leaves]), np.concatenate([cut, levels[k].cut[leaves]])
        marks[k][at[cut == k]] = True
        at, cut = levels[k].parent[at[cut < k]], cut[cut < k]
    return [(level.parent, level.edge, mark) for level, mark in zip(levels, marks, strict=True)]


def promising_cycle(moves: Moves, longest: int, beam: int) -> Cycle:
    """A cycle that grows much: the greatest of the cycles among the products of greatest norm at every length.

    Parameters
    ----------
    moves : Moves
        The moves.
    longest : int
        The most moves of a cycle.
    beam : int
        How many products of a length go on.

    Returns
    -------
    Cycle
    """
    after = [np.flatnonzero(moves.tail == v) for v in range(len(moves))]
    E = len(moves.tail)
    parent = edge = np.arange(E)
    level = _Level(
        parent,
        edge,
        moves.tail,
        moves.head,
        moves.A,
        np.zeros(E),
        moves.lengths,
        np.full(E, np.inf),
        np.zeros(E, dtype=int),
    )
    levels, cycle = [level, level], Cycle(0.0, ())
    while True:
        norms = np.linalg.norm(level.product, axis=(1, 2))
        size = norms ** (1 / level.steps)
        cycle = _greatest(moves, level, np.full(len(size), np.inf), cycle, levels)
        kept = np.argsort(-size, kind="stable")[:beam]
        kept = kept[(size[kept] > cycle.rate * (1 - 1e-9)) & np.isfinite(size[kept]) & (norms[kept] > 0)]
        if not len(kept) or len(levels) > longest:
            break
        ways = [after[v] for v in level.end[kept]]
        parent, edge = np.repeat(kept, [len(way) for way in ways]), np.concatenate(ways)
        with np.errstate(over="ignore", invalid="ignore"):
            product = moves.A[edge] @ level.product[parent]
        level = _Level(
            parent, edge, level.start[parent], moves.head[edge], product, level.wrong[parent],
            level.steps[parent] + moves.lengths[edge], level.least[parent], level.cut[parent],
        )  # fmt: skip
        levels.append(level)
    return cycle
