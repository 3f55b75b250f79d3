"""How fast the state can grow under arbitrary switching, or under rules: the joint spectral radius."""

import time
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from tqdm import tqdm

from switchctl.graph import SwitchingGraph, as_graph
from switchctl.modes import ModeSet
from switchctl.moments import Array
from switchctl.stability.branching import Cycle, Tree, branch, promising_cycle
from switchctl.stability.growth import Verdict, verdict
from switchctl.stability.moves import Moves, Rounded, multiplied
from switchctl.stability.quadratic import growth, lifting_norms, quadratic_norms, rounding
from switchctl.tables import Summary
from switchctl.validation import number

_PRODUCTS = 20_000  # of a branch and bound, at first
_UNKNOWNS = 4_000  # entries of the norms of a lift
_SMALL = 60  # entries of the norms up to which the quadratic bound is found to ten digits in any case
_ACCURACY = 1e-10
_LONGEST = 40  # moves of a cycle that is tried
_HELD = tuple(sorted({round(2 ** (k / 2)) for k in range(2, 19)}))  # how often a move may be repeated in one
_SWITCHES = 4  # moves of a cycle of such
_CLOSE = 1e-7  # to 1
_ENDINGS = ("tolerance reached", "time limit", "interrupted")


@dataclass(frozen=True, eq=False)
class Norms:
    """What proves an upper bound: quadratic norms at the nodes of a graph or its lift, and where runs are cut.

    Parameters
    ----------
    moves : Moves
        The moves, with the nodes that the norms stand at.
    P : array, shape (nodes, n, n)
        The norms ``sqrt(x' P x)``.
    tree : list of levels
        The products that runs are cut into (see `branching`).
    """

    moves: Moves
    P: Array
    tree: Tree


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of the growth of a step, and what proves them.

    Parameters
    ----------
    lower, upper : float
        The bounds. Every run grows by at most a constant times ``upper ** k``.
    cycle : tuple of int
        Modes that, repeated for ever, grow by ``lower`` a step.
    node : int
        The node that the cycle begins at.
    bounds : dict
        The upper bound of each way tried.
    status : str
        Why the search ended.
    norms : tuple of Norms
        What proves ``upper``, for each part of the graph that a run can stay in.
    """

    lower: float
    upper: float
    cycle: tuple[int, ...]
    node: int
    bounds: dict[str, float]
    status: str
    norms: tuple[Norms, ...]

    @property
    def verdict(self) -> Verdict:
        """Whether every run vanishes: "stable", "unstable" (not every one does) or "undecided"."""
        return verdict(self.lower, self.upper)


@dataclass(frozen=True, eq=False, repr=False)
class JointSpectralRadius(Summary, Bounds):
    """The joint spectral radius; see `joint_spectral_radius`.

    Parameters
    ----------
    lower, upper : float
        Its bounds. Every run grows by at most a constant times ``upper ** k``; `certify` proves it.
    cycle : tuple of int
        Modes that, repeated for ever, grow by ``lower`` a step.
    node : int
        The node of the graph that the cycle begins at.
    bounds : dict
        The upper bound of each way tried.
    status : str
        Why the search ended.
    norms : tuple of Norms
        What proves ``upper``, for each part of the graph that a run can stay in.
    graph : SwitchingGraph
        The modes, and the rules.
    """

    graph: SwitchingGraph

    def _facts(self) -> list[tuple[str, str]]:
        between = f"{self.lower:.10g} <= {self.upper:.10g}"
        return [
            ("bounds", f"{between} (relative gap {1 - self.lower / self.upper if self.upper else 0.0:.2g})"),
            (
                "cycle",
                f"{held(self.cycle, self.graph.modes.names)}: rate {self.lower:.10g} a step" if self.cycle else "none",
            ),
            ("switching", _MEANING[self.verdict] + " (but for the noise)" * self.graph.modes.noisy),
            *((f"upper, {way}", f"{bound:.10g}") for way, bound in self.bounds.items()),
            ("status", self.status),
        ]

    def _heading(self) -> str:
        return "JointSpectralRadius"


def held(word: tuple[int, ...], names: tuple[str, ...]) -> str:
    """A word with how often each mode is repeated."""
    runs: list[list[int]] = []
    for mode in word:
        if runs and runs[-1][0] == mode:
            runs[-1][1] += 1
        else:
            runs.append([mode, 1])
    return " ".join(names[mode] + (f" x {count}" if count > 1 else "") for mode, count in runs)


_MEANING = {
    "stable": "stable: every run vanishes",
    "unstable": "not stable: the cycle does not vanish",
    "undecided": "undecided: 1 lies between the bounds",
}


def joint_spectral_radius(
    modes_or_graph: ModeSet | SwitchingGraph, tol: float = 1e-4, time_limit: float = 30.0
) -> JointSpectralRadius:
    """Bound how fast the state can grow under arbitrary switching, or under the rules of a graph.

    The joint spectral radius is the limit of the greatest norm of a product of k modes, to the power 1/k. The lower
    bound is the growth of a cycle. The upper bound is the least of those by Kronecker lifting, by quadratic norms (a
    common quadratic Lyapunov function, and path-complete ones with more and more memory), and by Gripenberg's branch
    and bound in these norms; under rules they stand at the nodes of the graph.

    Parameters
    ----------
    modes_or_graph : ModeSet or SwitchingGraph
        The modes, or modes under rules: ``SwitchingGraph(modes, Rules(min_dwell=5))``.
    tol : float, optional
        The gap between the bounds to stop at, relative to the upper one.
    time_limit : float, optional
        Seconds after which no further way is tried; half of them where that leaves 1 between the bounds, and the rest
        to find on which side of it they should be.

    Returns
    -------
    JointSpectralRadius
        Ctrl-C ends the search with the bounds found so far.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or value.

    Examples
    --------
    >>> from switchctl.stability import joint_spectral_radius
    >>> modes = ModeSet([[[1.0, 1.0], [0.0, 1.0]], [[0.8, 0.0], [0.8, 0.8]]])
    >>> found = joint_spectral_radius(modes)
    >>> print(f"{found.lower:.6f}", found.cycle)  # sqrt(0.8) times the golden ratio
    1.447214 (0, 1)
    """
    graph = as_graph(modes_or_graph)
    tol, time_limit = number(tol, "tol"), number(time_limit, "time_limit")
    if not (0 < tol < 1 and time_limit > 0):
        raise ValueError(f"tol = {tol}, time_limit = {time_limit}; expected 0 < tol < 1 and seconds above 0")
    moves, end = Moves.of(graph), time.perf_counter() + time_limit
    found = bounded(moves, tol, end - time_limit / 2)
    if found.verdict == "undecided" and found.status != "interrupted":
        side = bounded(moves, None, end)
        if side.upper < found.upper:
            found = replace(found, upper=side.upper, norms=side.norms, bounds={**found.bounds, "below one": side.upper})
        if side.lower > found.lower:
            found = replace(found, lower=side.lower, cycle=side.cycle, node=side.node)
        if side.status == "interrupted":
            found = replace(found, status=side.status)
    return JointSpectralRadius(**vars(found), graph=graph)


def bounded(moves: Moves, tol: float | None, deadline: float) -> Bounds:
    """Bound the growth of a step to a tolerance, or, without one, until the bounds are on one side of 1."""
    searches: list[_Search] = []
    status = _ENDINGS[0]
    with tqdm(desc="joint spectral radius", unit="way", delay=2, leave=False) as progress:
        moves, units = moves.balanced()
        for part in moves.components():
            known = max((search.lower for search in searches), default=0.0)
            searches.append(_Search(part, known, tol, deadline, progress))
            if status != "interrupted":
                status = max(status, searches[-1].run(), key=_ENDINGS.index)
    best = max(searches, key=lambda search: search.lower)
    upper = max(search.upper for search in searches)
    ways = {way: None for search in searches for way in search.bounds}
    bounds = {way: max(search.bounds.get(way, search.upper) for search in searches) for way in ways}
    norms = tuple(replace(search.norms, P=search.norms.P / units[:, None] / units) for search in searches)
    return Bounds(best.lower, upper, best.word, best.node, bounds, status, norms)


class _Search:
    """Bounds for one strongly connected part."""

    def __init__(self, part: Moves, known: float, tol: float | None, deadline: float, progress: Any) -> None:
        self.part, self.known, self.side = part, known, tol is None
        self.deadline, self.progress = deadline, progress
        self.tol, self.goal = (_CLOSE, 1 - _CLOSE) if tol is None else (tol, 0.0)
        n = part.A.shape[-1]
        self.lower, self.node = 0.0, part.places[0]
        self.word: tuple[int, ...] = ()
        self.bounds: dict[str, float] = {}
        self.norms = Norms(part, np.tile(np.eye(n), (len(part), 1, 1)), [])
        self.upper = growth(part, self.norms.P)

    @property
    def floor(self) -> float:
        """The lower bound known of the whole graph."""
        return max(self.lower, self.known)

    @property
    def enough(self) -> float:
        """The upper bound to stop at."""
        return max(self.floor * (1 + self.tol), self.goal)

    @property
    def done(self) -> bool:
        """Whether the bounds are as near as they should be, or on one side of 1."""
        return self.upper <= self.enough or (self.side and self.lower >= 1)

    def run(self) -> str:
        """Try one way after the other; return how it ended."""
        try:
            return self._run()
        except KeyboardInterrupt:
            return "interrupted"

    def _run(self) -> str:
        moves, unit = self.part, self.upper
        if unit == 0:
            return "tolerance reached"
        plain, P = moves.divided(unit), lifting_norms(moves)
        self._improve("Kronecker lifting", growth(moves, P), moves, P)
        seen = moves.seen_in(P, unit)
        self._take(plain, promising_cycle(seen, _LONGEST, 200), unit)
        if not self.done:  # modes that are sampled fast must be held for long
            self._take(plain.held(_HELD), promising_cycle(seen.held(_HELD), _SWITCHES, 50), unit)
        budget = _PRODUCTS
        for memory in count():
            small = self.norms.P.size <= _SMALL and memory == 0 and not self.side
            if not self.done or small:
                name = "quadratic norms" if memory == 0 else "path-complete norms"
                stop, accuracy = (0.0, _ACCURACY) if small else (self.enough, self.tol / 10)
                gamma, P = quadratic_norms(moves, P, self.floor, stop, accuracy, self.deadline)
                self._improve(name, gamma, moves, P)
            if self.done:
                return "tolerance reached"
            self._branch(moves, P, budget)
            if self.done:
                return "tolerance reached"
            if time.perf_counter() > self.deadline:
                return "time limit"
            lift = moves.lifted() if len(moves.tail) * P[0].size <= _UNKNOWNS else None
            if lift is None:
                budget *= 4
            else:
                moves, P = lift, P[moves.head]
        raise AssertionError  # the count has no end

    def _branch(self, moves: Moves, P: Array, budget: int) -> None:
        unit = growth(moves, P)
        if not 0 < unit < np.inf:
            return
        known = Cycle(self.floor / unit, ())
        found = branch(moves.seen_in(P, unit), known, self.tol, self.goal / unit, budget, self.deadline)
        self._take(moves.divided(unit), found.cycle, unit)
        self._improve("branch and bound", found.upper * unit * rounding(P), moves, P, found.tree)

    def _take(self, moves: Moves, cycle: Cycle, unit: float) -> None:
        """Keep a cycle that grows more, of moves divided by ``unit ** steps``."""
        if not cycle.edges:
            return
        word = tuple(mode for e in cycle.edges for mode in moves.words[e])
        product: Rounded | None = None
        log = 0.0
        for e in cycle.edges:
            step = moves.A[e], moves.wrong[e]
            product = step if product is None else multiplied(step, product)
            size = float(np.abs(product[0]).max())
            if not 0 < size < np.inf:
                return
            product, log = (product[0] / size, product[1] / size), log + np.log(size)
        assert product is not None
        rate = proven_radius(product) ** (1 / len(word)) * np.exp(log / len(word)) * unit
        rate = float(rate * (1 - 4 * np.finfo(float).eps * (1 + abs(log) / len(word))))
        if rate > self.lower * (1 + _ACCURACY):
            if len(self.part) == 1 and (self.part.lengths == 1).all():  # it may begin anywhere
                word = min(word[k:] + word[:k] for k in range(len(word)))
            self.lower, self.word, self.node = rate, word, moves.places[moves.tail[cycle.edges[0]]]

    def _improve(self, way: str, upper: float, moves: Moves, P: Array, tree: Any = ()) -> None:
        """Keep an upper bound that is lower."""
        upper = float(upper)
        self.bounds[way] = min(upper, self.bounds.get(way, np.inf))
        if upper < self.upper:
            self.upper, self.norms = upper, Norms(moves, P, list(tree))
        self.progress.set_postfix_str(f"{self.lower:.6g} to {self.upper:.6g}", refresh=False)
        self.progress.update()


def proven_radius(product: Rounded) -> float:
    """A spectral radius less what rounding may have added to it, by the condition of its eigenvalue."""
    from scipy.linalg import eig

    M, doubt = product
    if not (np.isfinite(M).all() and np.isfinite(doubt).all()):
        return 0.0
    values, left, right = eig(M, left=True)  # type: ignore[misc]
    k = int(np.abs(values).argmax())
    size = float(np.linalg.norm(M, 2))
    moved = 4 * len(M) * float(np.finfo(float).eps) * size + float(doubt.sum())
    condition = 1 / max(float(np.abs(left[:, k].conj() @ right[:, k])), 1e-300)
    wrong = min(moved * condition, 2 * size * (moved / max(size, 1e-300)) ** (1 / len(M)))
    return max(0.0, float(np.abs(values[k])) - wrong)
