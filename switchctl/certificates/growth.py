"""Certificates of how fast states can grow: the joint spectral radius, dwell times, average dwell times."""

import math
import warnings
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from switchctl.certificates import check
from switchctl.certificates.certificate import SHARES, Certificate, exact, holds, loosened
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.stability.average_dwell_time import AverageDwellTime, switch_count
from switchctl.stability.dwell_time import DwellTime, DwellTimes
from switchctl.stability.joint_spectral_radius import JointSpectralRadius, Norms


def joint_spectral_radius(found: JointSpectralRadius) -> Certificate:
    """Prove both bounds of a joint spectral radius."""
    graph, modes = found.graph, found.graph.modes
    steps: dict[tuple[int, int], int] = {}
    moves = []
    for v in range(len(graph)):
        ways = np.flatnonzero(graph.successor[v] >= 0).tolist()
        before = int(graph.last_mode[v]) if modes.activation is not None else -1
        moves.append([[steps.setdefault((before, i), len(steps)), int(graph.successor[v, i])] for i in ways])
    data = {
        "names": [modes.names[i] if j < 0 else f"{modes.names[i]} after {modes.names[j]}" for j, i in steps],
        "A": [exact(modes.A_after[step]) for step in steps],
        "moves": moves,
    }
    read = check.Graph.read(data)
    witness: dict[str, Any] = {"upper": _norms(read, found.norms, range(len(graph))), "lower": None}
    upper = loosened(found.upper, lambda rate: read.grows_at_most(rate, witness["upper"]))
    lower = 0.0
    if found.cycle:
        nodes = graph.walk(found.cycle, found.node)
        ways = [int((graph.successor[v, :i] >= 0).sum()) for v, i in zip(nodes, found.cycle, strict=False)]
        witness["lower"], lower = _cycle(read, found.node, ways, found.lower)
    return Certificate.of("joint spectral radius", data, {"lower": lower.hex(), "upper": upper.hex()}, witness)


def dwell_time(found: DwellTime | DwellTimes) -> Certificate:
    """Prove a dwell time, or one for each mode: every signal that keeps it is stable, one that keeps less is not."""
    modes, m = found.modes, len(found.modes)
    data = _data(modes)
    stable, less, proof = (
        (found.dwell, None, None)
        if isinstance(found, DwellTimes)
        else ((found.upper,) * m, (found.lower - 1,) * m, found.unstable)
    )
    graph = check.Graph.with_dwell(data, list(stable))
    ends = (np.cumsum(stable) - 1).tolist()
    witness: dict[str, Any] = {"stable": _norms(graph, found.stable.norms, ends), "unstable": None}
    rate = loosened(found.stable.upper, lambda rate: graph.grows_at_most(rate, witness["stable"]))
    if rate >= 1:
        raise ValueError("the growth is too near to one to be proven below it; the dwell time above may be")
    claim = {"stable": list(stable), "unstable": None}
    if proof is not None and less is not None:
        graph = check.Graph.with_dwell(data, list(less))
        witness["unstable"], rate_below = _word(graph, less, proof.cycle)
        claim["unstable"] = list(less) if rate_below >= 1 else None
    return Certificate.of("dwell time", data, claim, {**witness, "rate": rate.hex()})


def average_dwell_time(found: AverageDwellTime) -> Certificate:
    """Prove an average dwell time, in 64ths of a step: every signal that keeps it is stable, one with less is not."""
    modes = found.modes
    if not found.P.size:
        raise ValueError("no average dwell time was found, so there is nothing to certify; certify a dwell time")
    data = _data(modes)
    graph = check.Graph.with_dwell(data, [1] * len(modes))
    claim: dict[str, Any] = {"stable": None, "unstable": None}
    witness: dict[str, Any] = {"P": [exact(P) for P in found.P], "unstable": None}

    def prove(rate: float) -> None:
        decay, jump = found.decay * rate, found.jump * (rate if found.jump > 1 else 1.0)
        check.need(decay < 1, "the norms don't shrink")
        time = 0.0 if jump == 1 else math.ceil(-64 * math.log(jump) / math.log(decay) * (1 + 1e-9)) / 64
        claim["stable"], witness["decay"], witness["jump"] = time.hex(), decay.hex(), jump.hex()
        check.average_dwell_time(data, claim, witness)

    loosened(1.0, prove)
    if found.word:
        witness["unstable"], rate = _word(graph, (1,) * len(modes), found.word)
        claim["unstable"] = _below(found.lower, found.word).hex() if rate >= 1 else None
    return Certificate.of("average dwell time", data, claim, witness)


def _below(average: float, word: tuple[int, ...]) -> float:
    """An average dwell time of a word, not rounded up."""
    return average if Fraction(average) * switch_count(word) <= len(word) else math.nextafter(average, 0.0)


def _data(modes: ModeSet) -> dict[str, Any]:
    first = None if modes.activation is None else [[exact(A) for A in row] for row in modes.A_after[:-1]]
    return {"names": list(modes.names), "A": [exact(A) for A in modes.A], "first": first}


def _word(graph: check.Graph, dwell: Sequence[int], word: tuple[int, ...]) -> tuple[Any, float]:
    """A proof that a word with these dwell times doesn't contract; it begins with a mode that takes over."""
    shift = next(k for k in range(len(word)) if word[k] != word[k - 1])
    word, ends = word[shift:] + word[:shift], np.cumsum(dwell) - 1
    ways, start = [], int(ends[word[-1]])
    v = start
    for mode in word:
        ways.append(mode if len(graph.moves[v]) > 1 else 0)
        v = graph.moves[v][ways[-1]][1]
    return _cycle(graph, start, ways, 1.0)


def _cycle(graph: check.Graph, node: int, ways: list[int], rate: float) -> tuple[Any, float]:
    """A proof that a cycle grows by a rate, or nearly: ``M' H M - rate^(2 steps) H`` is the identity."""
    every = [_floats(A) for A in graph.A]
    product, v = np.eye(len(every[0])), node
    for way in ways:
        k, v = graph.moves[v][way]
        product = every[k] @ product
    for share in SHARES:
        claimed = rate * (1 - share)
        M = product / claimed ** len(ways)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # whether H is a proof is decided exactly
            try:
                H = solve_discrete_lyapunov(M.T, -np.eye(len(M)), method="direct")
            except np.linalg.LinAlgError:
                continue
        H = (H + H.T) / 2
        H = H / np.abs(H).max()
        x = np.linalg.eigh(H)[1][:, -1:]
        witness = {"node": node, "moves": ways, "H": exact(H), "x": exact(x)}
        if np.isfinite(H).all() and holds(partial(graph.may_grow, claimed, witness)):
            return witness, claimed
    return None, 0.0


def _floats(A: check.Matrix) -> Array:
    """A matrix in floats."""
    return np.array([[float(Fraction(entry) / 2**A.exponent) for entry in row] for row in A.rows])


def _norms(graph: check.Graph, norms: tuple[Norms, ...], nodes: Sequence[int]) -> dict[str, Any]:
    """The norms at the nodes, the trees of the runs from each of them, and the order of the graph's parts."""
    tails, heads = np.array([(v, w) for v, ways in enumerate(graph.moves) for _, w in ways]).T
    V = len(graph.moves)
    rank = connected_components(csr_array((np.ones(len(tails)), (tails, heads)), shape=(V, V)), connection="strong")[1]
    if (rank[heads] > rank[tails]).any():
        rank = rank.max() - rank
    stated, trees, begin = [], [], 0
    for part in norms:
        places = [int(nodes[place]) for place in part.moves.places]
        inverse = np.linalg.inv(part.P)
        inverse = (inverse + np.swapaxes(inverse, -1, -2)) / 2
        stated += [[place, exact(R)] for place, R in zip(places, inverse, strict=True)]
        trees += [list(_tree(graph, part, rank, s, place, begin)) for s, place in enumerate(places)]
        begin += len(places)
    return {"rank": rank.tolist(), "norms": stated, "trees": trees}


def _tree(graph: check.Graph, norms: Norms, rank: Any, state: int, place: int, begin: int) -> Iterator[int]:
    """The runs from a node, depth first: -1 where one goes on, the number of a norm where it is cut."""
    moves, children = norms.moves, _children(norms)
    stack: list[tuple[list[int], tuple[int, int], int, int]] = [([], (0, state), state, place)]
    while stack:
        tokens, product, s, v = stack.pop()
        yield from tokens
        if tokens and tokens[-1] >= 0:
            continue
        edges = np.flatnonzero(moves.tail == s)
        ways = [w for _, w in graph.moves[v] if rank[w] == rank[v]]
        found = []
        for e, w in zip(edges, ways, strict=True):
            length, head = len(moves.words[e]), int(moves.head[e])
            for _ in range(length - 1):
                w = next(u for _, u in graph.moves[w] if rank[u] == rank[w])
            after = children.get((product, int(e)))
            found.append(([-1] * (length - 1) + [begin + head if after is None else -1], after or product, head, w))
        stack += reversed(found)


def _children(norms: Norms) -> dict[tuple[tuple[int, int], int], tuple[int, int]]:
    """The products that go on after another and a move, where runs are not cut there; none without a tree."""
    return {
        ((k - 1, int(parent)), int(edge)): (k, place)
        for k, (parents, edges, cuts) in enumerate(norms.tree[1:], 1)
        for place, (parent, edge, cut) in enumerate(zip(parents, edges, cuts, strict=True))
        if not cut
    }
