"""Online operation for millions of steps: no drift from a fresh scheduler, from the rules or from brute force.

A noisy plant, so that its state never vanishes, runs under ``scheduler.step`` and rules in seconds. Every mode named is
held against the rules, written here once more in whole steps. At intervals a fresh graph and scheduler take over the
memory and decide beside the running one, and every decision is held against the costs of all candidates, each run
through step by step. Memory is what the process holds after a hundredth of the steps and at the end.

    python benchmarks/long_run.py [steps] [method ..]
"""

import gc
import resource
import sys
from collections import deque
from itertools import chain, cycle, islice
from time import perf_counter

import numpy as np
from tqdm import tqdm

from switchctl import Budget, ModeSet, Optimal, PointwiseMinimum, RecedingHorizon, Rollout, Rules, SwitchingGraph
from switchctl.continuation import Continuations
from switchctl.tables import text_table

A = np.array(
    [
        [[0.90, 0.60, 0.0], [-0.10, 0.75, 0.1], [0.0, 0.0, 0.50]],
        [[0.70, -0.40, 0.3], [0.35, 0.70, 0.0], [0.1, 0.0, 0.60]],
        [[0.60, 0.00, 0.0], [1.10, 0.55, 0.0], [0.0, 0.2, 0.85]],
    ]
)
MODES = ModeSet(A, names=["quick", "turn", "calm"], dt=0.01)
LEAST, WINDOW, LIMIT, PERIOD, OPEN, SWITCHES, LATE = (3, 1, 2), 10, 6, 7, 4, 201, 20  # in steps
RULES = {
    "periodic": Rules(
        min_dwell={"quick": 0.03, "calm": 0.02},
        budget=Budget(use={"quick": 0.1}, limit=0.6, window=0.1),
        allowed={"turn": [(0.0, 0.04)]},
        allowed_period=0.07,
        time_unit="s",
    ),
    "limited": Rules(
        min_dwell={"quick": 0.03, "calm": 0.02}, max_switches=SWITCHES, allowed={"turn": [(0.2, np.inf)]}, time_unit="s"
    ),
    "dwell": Rules(min_dwell={"quick": 0.03, "calm": 0.02}, time_unit="s"),
}
METHODS = {
    "rollout": (Rollout(), "periodic"),
    "pointwise": (PointwiseMinimum(), "periodic"),
    "receding": (RecedingHorizon(12, hold=2), "periodic"),
    "policy": (None, "dwell"),
    "limited": (PointwiseMinimum(), "limited"),
}
BESIDE = 25  # steps that a fresh scheduler decides beside the running one
FOR_EVER = 250  # steps after which nothing is left of a state


class Watch:
    """The rules once more, in whole steps: raises at the first step against them."""

    def __init__(self, rules: str) -> None:
        self.rules, self.k, self.mode, self.age, self.switches = rules, 0, -1, 0, 0
        self.recent: deque[int] = deque(maxlen=WINDOW)

    def see(self, mode: int) -> None:
        """Check the coming step."""
        if mode != self.mode:
            broken = self.mode >= 0 and self.age < LEAST[self.mode]
            self.switches += self.mode >= 0
            self.mode, self.age = mode, 0
            if broken or (self.rules == "limited" and self.switches > SWITCHES):
                raise ArithmeticError(f"step {self.k}: a switch to {mode} against the rules")
        self.age += 1
        self.recent.append(mode)
        if self.rules == "periodic" and (self.recent.count(0) > LIMIT or (mode == 1 and self.k % PERIOD >= OPEN)):
            raise ArithmeticError(f"step {self.k}: mode {mode} against the budget or at a time when it is not there")
        if self.rules == "limited" and mode == 1 and self.k < LATE:
            raise ArithmeticError(f"step {self.k}: mode {mode} before it is there")
        self.k += 1


def started(method, rules: str):
    """A scheduler on a graph of its own."""
    graph = SwitchingGraph(MODES, RULES[rules])
    return (Optimal(gap=0.1).policy(MODES, graph, 12) if method is None else method).start(graph)


def by_brute_force(name: str, scheduler, S: np.ndarray) -> dict[tuple[int, ...], float]:
    """Every candidate of a scheduler that decides anew: the modes until then, and its cost by running through it."""
    graph, node, costs = scheduler.graph, scheduler.node, {}
    if name in ("rollout", "policy"):
        ways = Continuations(graph)
        for mode in np.flatnonzero(graph.successor[node] >= 0).tolist():
            head = int(graph.successor[node, mode])
            if name == "rollout":
                plans = [ways.path(head, number) for number in ways.table(head)[0]]
                plans = [((mode, *lead), word) for lead, word in plans]
            elif node not in scheduler.tables:
                plans = [((mode,), (mode,))]
            else:
                plans = [plan for plan in scheduler.tables[node][0] if (plan[0] + plan[1])[0] == mode]
            each = [cost(S, chain(lead, cycle(word)), FOR_EVER) for lead, word in plans]
            if each:
                costs[(mode,)] = min(each)
        return costs
    samples, hold = scheduler.method.horizon + 1, scheduler.method.hold
    for mode in np.flatnonzero(scheduler.costs.moves[node]).tolist():
        steps = int(min(graph.holds[node, mode], samples))  # a mode as long as it may be held, then another
        then = int(graph.walk([mode] * steps, node)[-1])
        for other in np.flatnonzero(scheduler.costs.moves[then]).tolist() if steps < samples else [mode]:
            left = [other] * int(min(graph.holds[then, other], hold)) if steps < samples else []
            found = cost(S, [mode] * steps + [other] * (samples - steps), samples)
            taken = tuple(([mode] * steps + left)[:hold])
            costs[taken] = min(costs.get(taken, np.inf), found)
    return costs


def cost(S: np.ndarray, modes, steps: int) -> float:
    """What a run costs, step by step."""
    total = 0.0
    for mode in islice(modes, steps):
        total, S = total + float(np.trace(S)), A[mode] @ S @ A[mode].T
    return total


def compare(name: str, running, fresh, x: np.ndarray) -> int:
    """One decision of both, and of brute force where the method decides anew; raises where they differ."""
    anew = name != "receding" or not running.plan
    node, S = running.node, np.outer(x, x)
    costs = by_brute_force(name, running, S) if anew else {}
    mode, other = running.step(x), fresh.step(x)
    if mode != other or not np.array_equal(running.memory, fresh.memory):
        raise ArithmeticError(f"{name}: the running scheduler names {mode}, a fresh one {other}")
    if costs:
        taken = (mode, *running.plan) if name == "receding" else (mode,)
        if not costs[taken] <= min(costs.values()) * (1 + 1e-9):
            raise ArithmeticError(f"{name}: {taken} at node {node} costs {costs[taken]}, the least is {costs}")
    return mode


def held() -> tuple[int, int, float]:
    """Memory blocks and objects that the interpreter holds, and the greatest memory of the process in MB."""
    gc.collect()
    unit = 1024 if sys.platform != "darwin" else 1024**2
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return sys.getallocatedblocks(), len(gc.get_objects()), peak


def run(name: str, steps: int, checks: int = 20, early: int | None = None) -> dict:
    """Run so many steps; what was counted, with the memory held early (after a hundredth) and at the end."""
    method, rules = METHODS[name]
    running, watch, random = started(method, rules), Watch(rules), np.random.default_rng(0)
    x, counts, compared, begun = np.array([3.0, -2.0, 1.0]), np.zeros(len(MODES), dtype=np.int64), 0, perf_counter()
    start = None
    for number in range(checks):
        fresh = started(method, rules) if number else None
        if fresh is not None:
            fresh.memory = running.memory
        for k in range(number * steps // checks, (number + 1) * steps // checks):
            if fresh is not None:
                mode, compared = compare(name, running, fresh, x), compared + 1
                if compared % BESIDE == 0:
                    fresh = None
            else:
                mode = running.step(x)
            watch.see(mode)
            counts[mode] += 1
            x = A[mode] @ x + random.standard_normal(3)
            if k + 1 == (early or steps // 100):
                start = held()
    if watch.k != steps or not np.isfinite(x).all():
        raise ArithmeticError(f"{watch.k} steps counted of {steps}, at the state {x}")
    fresh = None
    return {
        "steps": steps,
        "compared": compared,
        "switches": watch.switches,
        "share": counts / steps,
        "seconds": perf_counter() - begun,
        "held": (start, held()),
    }


def main(words: list[str]) -> None:
    """Print one row a method."""
    steps, names = int(words[0]) if words else 100_000, words[1:] or list(METHODS)
    if unknown := set(names) - METHODS.keys():
        sys.exit(f"no method {min(unknown)}; expected {', '.join(METHODS)}")
    rows = []
    for name in tqdm(names, "methods", leave=False):
        found = run(name, steps)
        (blocks, objects, peak), (later_blocks, later_objects, later_peak) = found["held"]
        rows.append(
            [
                name,
                f"{steps:,}",
                f"{found['compared']:,}",
                f"{found['switches']:,}",
                " ".join(f"{share:.3f}" for share in found["share"]),
                f"{1e6 * found['seconds'] / steps:.1f}",
                f"{later_blocks - blocks:+,}",
                f"{later_objects - objects:+,}",
                f"{peak:.1f} -> {later_peak:.1f}",
            ]
        )
    print(text_table(["", "steps", "compared", "switches", "shares", "us a step", "blocks", "objects", "MB"], rows))


if __name__ == "__main__":
    main(sys.argv[1:])
