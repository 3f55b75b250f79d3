"""Write a certificate of a schedule: what it costs at most, and what every schedule costs at least."""

import math
import time
from typing import Any

import numpy as np
from tqdm import tqdm

from switchctl.certificates import check
from switchctl.certificates.certificate import Certificate, exact
from switchctl.moments import smat
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.search import Search
from switchctl.result import Schedule
from switchctl.validation import number, whole_number
from switchctl.values import require_definite_weights, require_plain_total, switched, word_value

_LARGEST = 20_000  # nodes and choices of a graph
_FIRST = 0.5
_TRIES = 10


def optimum(schedule: Schedule, gap: float, prefixes: int, time_limit: float) -> Certificate:
    """Prove how near to the optimum a schedule is; see `certify`."""
    gap, time_limit = number(gap, "gap"), number(time_limit, "time_limit")
    prefixes = whole_number(prefixes, "prefixes")
    if not (0 < gap < 1 and time_limit > 0):
        raise ValueError(f"gap = {gap}, time_limit = {time_limit}; expected 0 < gap < 1 and seconds above 0")
    require_plain_total(schedule.modes, "a certificate")
    if schedule.modes.activation is not None:
        raise ValueError(
            "a certificate is for modes whose switches leave the state as it is (no ModeSet.activation, which "
            "inactive='reset' makes)"
        )
    if schedule.target is not None:
        raise ValueError("a certificate is of total costs, and this schedule's is a distance to a target")
    if not np.isfinite(schedule.cost):
        raise ValueError("the schedule's cost is infinite, so there is nothing to prove of it")
    if schedule.cost == 0:
        raise ValueError("the schedule costs nothing, and none costs less, so there is nothing to prove of it")
    writer = _Writer(schedule)
    data, run = writer.data(), writer.run()
    problem = check.Problem(data)
    deadline = time.perf_counter() + time_limit
    try:
        upper = float(check.proven_upper(problem, run))
        lower, witness = _proven_lower(writer, problem, upper, gap, prefixes, deadline)
    except check.Rejected as error:
        raise ValueError(
            f"the bounds can't be proven in exact arithmetic ({error}); weigh the cost in another unit"
        ) from None
    claim = {"lower": math.nextafter(lower, -math.inf).hex(), "upper": math.nextafter(upper, math.inf).hex()}
    return Certificate.of("optimum", data, claim, run | witness)


def _proven_lower(
    writer: "_Writer", problem: check.Problem, upper: float, gap: float, prefixes: int, deadline: float
) -> tuple[float, dict[str, Any]]:
    """A lower bound that the checker finds proven, within the gap of the upper one where it can be, and its proof.

    The search knows gaps to the least cost that it has found, which may be below the schedule's, and falls meanwhile;
    and exact arithmetic takes a little from its bounds. So it is asked again for what is lacking.
    """
    wanted, lower, lost = (1 - gap) * upper, -math.inf, 0.0
    witness: dict[str, Any] = {}
    tree: list[int] = []
    for _ in range(_TRIES):
        known, before = writer.cost, tree
        aim = 1 - wanted / known - lost
        tree = writer.grow(aim if aim > 0 else gap, prefixes, deadline)
        if tree == before and writer.cost == known:
            break
        tried = {"tree": tree} | writer.bounds()
        proven = float(check.proven_lower(problem, tried))
        if proven > lower:
            lower, witness = proven, tried
        if lower >= wanted:
            break
        lost += 1.5 * max(1 - aim - proven / writer.cost, 0.0)
    return lower, witness


class _Writer:
    def __init__(self, schedule: Schedule) -> None:
        self.schedule, graph = schedule, schedule.graph
        steps = None if schedule.terminal is None else len(schedule)
        self.decisions = Decisions(graph, steps)
        terminal = None if schedule.terminal is None else self.decisions.scaled_cost(schedule.terminal)
        if not self.decisions.reachable(_LARGEST):
            raise ValueError(f"the graph has more than {_LARGEST:,} choices, too many for a certificate")
        search = Search.prepared(self.decisions, self.decisions.scaled(schedule.x0.second_moment), terminal)
        if search is None:
            raise ValueError("no way on of finite cost was found from the start, and a certificate begins with one")
        if not search.lower.definite:
            require_definite_weights(graph.modes, "a certificate")
            raise ValueError("what some states cost is lost beside others: a certificate needs costs of nearer sizes")
        self.search, self.lower = search, search.lower
        dk = graph.modes.dk
        if schedule.cost / dk < self.search.cost:
            self.search.cost = schedule.cost / dk
        self.nodes = self._reached()

    @property
    def cost(self) -> float:
        """The least cost known."""
        return float(self.search.cost * self.schedule.modes.dk)

    def _reached(self) -> dict[tuple[int, int], int]:
        """The nodes of the problem, by steps taken (0 if endless) and node of the graph, numbered from the start."""
        graph, steps = self.schedule.graph, self.decisions.steps
        if steps is None:
            return {(0, v): v for v in range(len(graph))}
        nodes = {(0, 0): 0}
        for k, v in (queue := [(0, 0)]):
            for head in graph.successor[v][graph.successor[v] >= 0].tolist() if k < steps else []:
                if (k + 1, head) not in nodes:
                    nodes[k + 1, head] = len(nodes)
                    queue.append((k + 1, head))
        if len(nodes) > _LARGEST:
            raise ValueError(f"the run has {len(nodes):,} nodes, more than the {_LARGEST:,} of a certificate")
        return nodes

    def grow(self, gap: float, prefixes: int, deadline: float) -> list[int]:
        """The tree of the least tolerance that can be had."""
        tolerance, tree = max(_FIRST, gap), [0]
        with tqdm(desc="certificate", unit="rung", delay=2, leave=False) as progress:
            while self.search.rung(tolerance, deadline) == "closed":
                found = self._tree(self.search.cost * (1 - tolerance), prefixes)
                tree = tree if found is None else found
                if found is None or tolerance <= gap:
                    break
                tolerance = max(tolerance / 4, gap * (1 - 1e-3))
                progress.update()
        return tree

    def _tree(self, threshold: float, most: int) -> list[int] | None:
        """The prefixes to give up, depth first: -1 to go on, or the bound that exceeds the threshold.

        Where there is nothing to choose, and at the end, nothing (-2) is told.
        """
        decisions, lower = self.decisions, self.lower
        tokens = [0]
        children: list[list[int]] = [[]]
        waiting: dict[int, tuple[Any, ...]] = {0: (self.search.s[None], np.zeros(1), np.zeros(1, dtype=int))}
        while waiting:
            u, (moments, costs, places) = waiting.popitem()
            worth = moments @ lower.rows(u).T + costs[:, None]
            best = worth.argmax(axis=1)
            for place, bound in zip(places, best, strict=True):
                tokens[place] = int(bound)
            going = np.flatnonzero((worth.max(axis=1) < threshold) | (not decisions.chooses(u)))
            for move in decisions.moves(u) if len(going) else ():
                begun = len(tokens)
                if begun + len(going) > most:
                    return None
                tokens += [0] * len(going)
                children += [[] for _ in going]
                for child, parent in enumerate(places[going].tolist(), begun):
                    tokens[parent] = -1 if decisions.chooses(u) else -2
                    children[parent].append(child)
                after = moments[going] @ move.K.T, costs[going] + moments[going] @ move.q + move.constant
                found: tuple[Any, ...] = *after, np.arange(begun, begun + len(going))
                if decisions.ended(move.head):
                    for place in found[2]:
                        tokens[place] = -2
                    continue
                if move.head in waiting:
                    known = waiting[move.head]
                    found = tuple(np.concatenate(pair) for pair in zip(known, found, strict=True))
                waiting[move.head] = found
        order, stack = [], [0]
        while stack:
            place = stack.pop()
            order += [tokens[place]] if tokens[place] != -2 else []
            stack += reversed(children[place])
        return order

    def data(self) -> dict[str, Any]:
        """The problem, in numbers that are exact."""
        graph, x0 = self.schedule.graph, self.schedule.x0
        modes, steps = graph.modes, self.decisions.steps
        moves = []
        for k, v in self.nodes:
            ways = np.flatnonzero(graph.successor[v] >= 0).tolist() if steps is None or k < steps else []
            ahead = 0 if steps is None else k + 1
            moves.append([[mode, self.nodes[ahead, int(graph.successor[v, mode])]] for mode in ways])
        return {
            "names": list(modes.names),
            "period": float(modes.dk).hex(),
            "mean": [[float(x).hex()] for x in x0.mean],
            "cov": exact(x0.cov),
            "A": [exact(A) for A in modes.A],
            "Q": [exact(Q) for Q in modes.Q],
            "moves": moves,
            "last": [int(graph.last_mode[v]) for _, v in self.nodes],
            "switch_cost": exact(graph.switch_cost),
            "switch_cost_per_w2": exact(graph.switch_cost_per_w2),
            "price": [float(x).hex() for x in graph.price],
            "terminal": None if self.schedule.terminal is None else exact(self.schedule.terminal),
        }

    def bounds(self) -> dict[str, Any]:
        """The lower bounds at every choice, in the unit of the cost, a little lower: rounding takes from them."""
        decisions, lower, dk = self.decisions, self.lower, self.schedule.modes.dk
        choices = [u for u in range(len(decisions.places)) if not decisions.ended(u) and decisions.chooses(u)]
        rows = np.array([lower.rows(u) for u in choices])
        size = float(np.linalg.norm(rows, axis=2).max())
        lightest = float(np.linalg.eigvalsh(lower.least)[0])
        share = 1 - 256 * decisions.n * np.finfo(float).eps * (1 + size / lightest)
        L = decisions.plain_cost(smat(rows)) * dk * share
        numbers = [self.nodes[decisions.places[u]] for u in choices]
        guard = 16.0 * decisions.n * float(np.linalg.norm(L, axis=(2, 3)).max())
        used = range(lower.count)
        return {
            "bounds": [{str(v): exact(L[i, j]) for i, v in enumerate(numbers)} for j in used],
            "guards": [guard.hex() for _ in used],
        }

    def run(self) -> dict[str, Any]:
        """The schedule, up to where its word returns to a node, and a matrix above the cost of the word."""
        schedule, graph = self.schedule, self.schedule.graph
        path = [*schedule.sequence.tolist(), *schedule.lead]
        if schedule.terminal is not None:
            return {"lead": path, "word": [], "tail": None}
        word, node = list(schedule.tail), int(graph.walk(path)[-1])
        nodes = [node]  # after each round of the word, until one returns
        while (node := int(graph.walk(word, node)[-1])) not in nodes:
            nodes.append(node)
        path, word = path + word * nodes.index(node), word * (len(nodes) - nodes.index(node))
        value = word_value(graph, tuple(word))
        assert value is not None  # the cost is finite
        dk = graph.modes.dk
        P = self.decisions.scaled_cost(switched(graph, node, word[0], value).P)
        lightest = float(np.linalg.eigvalsh(self.lower.least)[0])
        P = P * (1 + 1e-9 + 1e4 * np.finfo(float).eps * np.linalg.norm(P) / lightest)
        return {
            "lead": path,
            "word": word,
            "tail": exact(self.decisions.plain_cost(P) * dk),
        }
