"""Switching rules: the best two switches against a plain double loop, and decisions with and without dwell rules."""

from time import perf_counter

import numpy as np
from timing import microseconds, random_modes, ratio, require_equal, timed

from switchctl import Budget, FewSwitches, ModeSet, RecedingHorizon, Rollout, Rules, SwitchingGraph, schedule
from switchctl.models import quadrotor
from switchctl.moments import Array
from switchctl.tables import text_table

STEPS = 1500


def double_loop(modes: ModeSet, S: Array) -> float:
    """Least cost with at most two switches in 1500 steps: every pair of instants in turn, in plain NumPy."""
    A, (P0, P1) = modes.A, modes.tails
    best = np.inf
    for first in (0, 1):
        i, j = A[first], A[1 - first]
        end, other = (P0, P1) if first == 0 else (P1, P0)
        moment, cost = S, 0.0
        for k in range(STEPS):
            if k:
                best = min(best, cost + np.vdot(other, moment))
            inner, so_far = moment, cost
            for _ in range(k, STEPS if k else 0):
                so_far += np.trace(inner)
                inner = j @ inner @ j.T
                best = min(best, so_far + np.vdot(end, inner))
            cost += np.trace(moment)
            moment = i @ moment @ i.T
        best = min(best, np.vdot(end, S))
    return modes.dk * best


def few_switches() -> list[list[str]]:
    """Time the search for the best two switches of the quadrotor."""
    modes, x0 = quadrotor.modes("closed_loop"), quadrotor.initial_state()
    S = x0.second_moment
    begin = perf_counter()
    loop = double_loop(modes, S)
    seconds = perf_counter() - begin
    rows = [["plain double loop", f"{seconds:.2f}", "1", f"{STEPS * (STEPS + 1):,}"]]
    for switches in (2, 3):
        scheduler = FewSwitches(switches).start(modes)
        if switches == 2:
            require_equal(np.array(schedule(modes, x0, FewSwitches(2)).cost), np.array(loop), "the best two switches")
        scheduler.search(S)
        compared = scheduler.statistics["schedules compared"]
        start, search = timed(lambda s=switches: FewSwitches(s).start(modes), lambda s=scheduler: s.search(S))
        both = np.median(start) + np.median(search)
        rows.append([f"FewSwitches({switches})", f"{both:.3f}", f"{seconds / both:,.0f}", f"{compared:,}"])
    return rows


def decisions() -> list[list[str]]:
    """Time decisions at every sample, without rules and under several."""
    A, S = random_modes(2, 6)
    modes = ModeSet(A)
    rules = {
        "no rules": Rules(),
        "min_dwell = 10": Rules(min_dwell=10),
        "min_dwell = 10, switch_cost = 0.1": Rules(min_dwell=10, switch_cost=0.1),
        "max_dwell = 20": Rules(max_dwell=20),
        "budget, 100 in all": Rules(budget=Budget(use=[1, 0], limit=100)),
    }
    graphs = {name: SwitchingGraph(modes, rule) for name, rule in rules.items()}
    columns = []
    for method in (RecedingHorizon(50), Rollout()):
        runs = []
        for graph in graphs.values():
            scheduler = method.start(graph)

            def run(scheduler: object = scheduler) -> None:
                scheduler.reset()  # type: ignore[attr-defined]
                for _ in range(100):
                    scheduler.choose(S)  # type: ignore[attr-defined]

            runs.append(run)
        columns.append(timed(*runs) / 100)
    return [
        [
            name,
            f"{len(graph):,}",
            *(text for times in columns for text in (microseconds(times[j]), ratio(times[j], times[0]))),
        ]
        for j, (name, graph) in enumerate(graphs.items())
    ]


if __name__ == "__main__":
    print(
        text_table(["the best of all instants", "seconds", "ratio", "schedules compared"], few_switches()), end="\n\n"
    )
    header = ["n = 6, m = 2", "nodes", "RecedingHorizon(50) (us)", "to none", "Rollout (us)", "to none"]
    print(text_table(header, decisions()))
