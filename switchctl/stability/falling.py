"""Values that fall at every step of a run by a share of themselves: what makes a policy stable."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import solve_triangular

from switchctl.graph import SwitchingGraph
from switchctl.methods.least import TIE
from switchctl.moments import Array, svec
from switchctl.optimum.minorants import below
from switchctl.optimum.programs import solution, solver
from switchctl.stability.growth import definite

_WALKS = 1024  # of as many steps as are looked at, from all nodes
_STEPS = 16
_PROGRAMS = 24  # solved for more steps than needed, 2, 4, 8, ..
_EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Fall:
    """A value that falls: ``V(k + steps) <= (1 - share) V(k)`` along every run of a policy, but for rounding.

    Parameters
    ----------
    P : dict of int to array, shape (r, n, n)
        By node of the graph, quadratics whose least bounds the value from above, ``V(S) <= min_p tr(P_p S)``.
    weights : dict of int to array, shape (walks, n, n)
        By node, a matrix below what each walk of so many steps costs, different ones.
    mixes : dict of int to array, shape (walks, r)
        Rows of nonnegative numbers that add up to 1, with ``weight >= share * sum_p mix_p P_p``.
    share : float
        The share.
    steps : int
        The steps.
    rate : float
        What this makes of a state per step, rounding and discount included.
    """

    P: dict[int, Array]
    weights: dict[int, Array]
    mixes: dict[int, Array]
    share: float
    steps: int
    rate: float


class Walks(NamedTuple):
    """Matrices below what walks of some steps cost, by node; all of them positive definite."""

    steps: int
    weights: dict[int, Array]


def walks(graph: SwitchingGraph, nodes: Iterable[int]) -> Iterator[Walks]:
    """Matrices below what all walks of some steps cost, for those numbers of steps from which on they see every state.

    Parameters
    ----------
    graph : SwitchingGraph
        The graph.
    nodes : iterable of int
        The nodes that are visited; moves elsewhere are not taken.

    Yields
    ------
    Walks
        In the unit of W2, as discounted.
    """
    modes, inside = graph.modes, set(nodes)
    n, g = modes.A.shape[-1], modes.discount
    moves = [edge for edge in graph.edges() if edge.tail in inside and edge.head in inside]
    each = {v: np.zeros((1, n, n)) for v in inside}
    steps, seen = 0, False
    while steps == 0 or (steps < _STEPS and sum(len(each[edge.head]) for edge in moves) <= _WALKS):
        found: dict[int, dict[bytes, Array]] = {v: {} for v in inside}
        for edge in moves:
            for L in each[edge.head]:
                Q = edge.Q / modes.dk
                weight = below(Q, np.sqrt(g) * edge.A, L) if steps else Q
                found[edge.tail][weight.tobytes()] = weight
        each = {v: np.array(list(weights.values())) for v, weights in found.items()}
        steps += 1
        if all(definite(weights, 4 * _EPS * np.abs(weights)) for weights in each.values()):
            seen = True
            yield Walks(steps, each)
        elif seen:
            return


def largest_share(Q: Array, P: Array) -> tuple[float, Array]:
    """The greatest share for which some mean of quadratics satisfies ``share * sum_p a_p P_p <= Q``, checked.

    Parameters
    ----------
    Q : array, shape (n, n)
        A positive definite matrix.
    P : array, shape (r, n, n)
        Positive semidefinite ones.

    Returns
    -------
    share : float
        0 where rounding hides it.
    mix : array, shape (r,)
        The a_p.
    """
    unit = np.exp2(np.round(np.log2(np.diag(Q)) / 2))
    scale = np.outer(unit, unit)
    root = np.linalg.cholesky(Q / scale)
    half = solve_triangular(root, P / scale, lower=True)
    N = solve_triangular(root, np.swapaxes(half, -1, -2), lower=True)
    N = (N + np.swapaxes(N, -1, -2)) / 2
    tops = np.maximum(np.linalg.eigvalsh(N)[:, -1], 1e-30)
    mixes = [np.eye(len(P))[int(tops.argmin())]]
    if len(P) > 1 and (found := _mix(N / tops.min())) is not None:
        mixes.insert(0, found)
    best = 0.0, mixes[-1]
    for mix in mixes:
        mean = np.tensordot(mix, P, 1)
        share = 1 / max(float(np.linalg.eigvalsh(np.tensordot(mix, N, 1))[-1]), 1e-30)
        for slack in (1e-10, 1e-6, 1e-3):
            trial = share * (1 - slack)
            wrong = (len(P) + 8) * _EPS * (np.abs(Q) + trial * np.tensordot(mix, np.abs(P), 1))
            if trial > best[0] and definite(Q - trial * mean, wrong):
                best = trial, mix
                break
    return best


def _mix(N: Array) -> Array | None:
    """Numbers a, which add up to 1, with the least greatest eigenvalue of ``sum_p a_p N_p``."""
    clarabel = solver()

    r, n, _ = N.shape
    matrix = sparse.csc_matrix(np.concatenate([-np.eye(r), svec(N).T]))
    vector = np.concatenate([np.zeros(r), svec(np.eye(n))])
    found = solution(-np.ones(r), matrix, vector, [clarabel.NonnegativeConeT(r), clarabel.PSDTriangleConeT(n)])
    if found is None or np.maximum(found, 0.0).sum() <= 0:
        return None
    found = np.maximum(found, 0.0)
    return found / found.sum()


def fall(graph: SwitchingGraph, P: dict[int, Array], slack: float) -> Fall | None:
    """The share by which a value must fall that pays for every step, over as many steps as make the best rate.

    Parameters
    ----------
    graph : SwitchingGraph
        The graph, some steps of which see every state.
    P : dict of int to array, shape (r, n, n)
        By node that is visited, quadratics whose least bounds the value from above.
    slack : float
        By what fraction of the value a step may miss what is promised.

    Returns
    -------
    Fall or None
        None where the value may not fall: because of rounding, or a discount.
    """
    best: Fall | None = None
    for tried, (steps, weights) in enumerate(walks(graph, P)):
        if tried and sum(map(len, weights.values())) > _PROGRAMS:
            break
        if tried and steps & (steps - 1):
            continue
        mixes, share = {}, 1.0
        for v, of_walks in weights.items():
            found = [largest_share(Q, P[v]) for Q in of_walks]
            mixes[v] = np.array([mix for _, mix in found])
            share = min([share, *(each for each, _ in found)])
        left = (1 - share + 2 * steps * slack) / graph.modes.discount**steps
        falling = Fall(P, weights, mixes, share, steps, float(left) ** (1 / (2 * steps)))
        if share > 0 and left < 1 and (best is None or falling.rate < best.rate):
            best = falling
    return best


def rounding(least: Sequence[Array], compared: Sequence[Array], residuals: Sequence[Array]) -> float:
    """By what fraction of the value a choice may miss the least, ties and rounding included.

    Parameters
    ----------
    least : sequence of arrays, shape (n, n)
        Positive definite matrices, the least of which bounds the value from below.
    compared : sequence of arrays, shape (n, n)
        The matrices that choices are made by.
    residuals : sequence of arrays, shape (n, n)
        By how much these exceed what is promised.

    Returns
    -------
    float
        Infinite where rounding hides everything.
    """
    n = len(least[0])
    unit = np.sqrt(np.mean([np.diag(P) for P in least], axis=0))
    scale = np.outer(unit, unit)
    compared, residuals = ([M / scale for M in each] for each in (compared, residuals))
    if not (np.isfinite(scale).all() and np.isfinite([*compared, *residuals]).all()):
        return np.inf
    floor = min(float(np.linalg.eigvalsh(P / scale)[0]) for P in least) - 8 * n * n * _EPS
    if floor <= 0:
        return np.inf
    size = max(float(np.linalg.norm(M)) for M in compared)
    excess = max((float(np.linalg.norm(R)) for R in residuals), default=0.0)
    return 4 * TIE * max(1.0, size / floor) + (8 * n * n * _EPS * size + excess) / floor


def spread(above: Sequence[Array], below: Sequence[Array]) -> float:
    """The greatest eigenvalue of some matrices over the least of others, or more; infinite where rounding hides it.

    Parameters
    ----------
    above, below : sequence of arrays, shape (n, n)
        Positive definite matrices.

    Returns
    -------
    float
    """
    if not np.isfinite([*above, *below]).all():
        return np.inf
    noise = 8 * len(above[0]) * _EPS
    greatest = max(float(np.linalg.eigvalsh(P)[-1]) for P in above)
    least = []
    for P in below:
        plain, unit = np.linalg.eigvalsh(P), np.sqrt(np.diag(P))
        balanced = np.linalg.eigvalsh(P / unit[:, None] / unit)
        parts = plain[0] - noise * plain[-1], (balanced[0] - noise * balanced[-1]) * float(unit.min()) ** 2
        least.append(max(parts))
    return greatest / min(least) * (1 + 1e-6) if min(least) > 0 else np.inf
