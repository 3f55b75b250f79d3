"""One online decision of the receding horizon: whatever the horizon, and against computing the costs afresh."""

from itertools import accumulate, repeat
from time import perf_counter

import numpy as np
from timing import microseconds, random_modes, ratio, require_equal, timed

from switchctl import ModeSet, RecedingHorizon
from switchctl.gramians import horizon_gramians
from switchctl.moments import Array, svec
from switchctl.tables import text_table

T = 50
PATIENCE = 5.0  # seconds that one evaluation of the Kronecker powers may take


def propagated_costs(A: Array, S: Array) -> Array:
    """Cost of every mode over the horizon: move the moments of all modes step by step and add up their traces."""
    moments, transposed = np.broadcast_to(S, A.shape), np.swapaxes(A, 1, 2)
    costs = np.trace(moments, axis1=1, axis2=2)
    for _ in range(T):
        moments = A @ moments @ transposed
        costs = costs + np.trace(moments, axis1=1, axis2=2)
    return costs


def kronecker_costs(A: Array, S: Array) -> Array | None:
    """Cost of every mode by the paper's formula as it stands, ``sum_k vec(I)' (A (x) A)^k vec(S)``.

    None where the evaluation takes longer than `PATIENCE`.
    """
    end = perf_counter() + PATIENCE
    identity, moment = np.eye(len(S)).ravel(), S.ravel()
    costs = np.full(len(A), identity @ moment)
    for i, mode in enumerate(A):
        for power in accumulate(repeat(np.kron(mode, mode), T), np.matmul):
            costs[i] += identity @ power @ moment
            if perf_counter() > end:
                return None
    return costs


def horizons(n: int, m: int) -> list[list[str]]:
    """Time decisions and the start for T = 10 to 10,000."""
    A, S = random_modes(m, n)
    modes, mean = ModeSet(A), np.ones(n)
    methods = [RecedingHorizon(horizon) for horizon in (10, 100, 1_000, 10_000)]
    schedulers = [method.start(modes) for method in methods]
    decide = [lambda s=s: s.decide(S) for s in schedulers]
    step = [lambda s=s: s.step(mean, S) for s in schedulers]
    start = [lambda method=method: method.start(modes) for method in methods]
    times = np.reshape(timed(*decide, *step, *start), (3, len(methods), -1))
    return [
        [f"n = {n}, m = {m}, T = {method.horizon:,}"]
        + [text for row in times for text in (microseconds(row[j]), ratio(row[j], row[0]))]
        for j, method in enumerate(methods)
    ]


def peers(n: int, m: int) -> list[str]:
    """Time a decision against both peers, which compute the same costs to a relative 1e-9."""
    A, S = random_modes(m, n)
    modes, method = ModeSet(A), RecedingHorizon(T)
    scheduler = method.start(modes)
    costs, kronecker = svec(horizon_gramians(A, modes.Q, T)) @ svec(S), kronecker_costs(A, S)
    require_equal(propagated_costs(A, S), costs, "propagated costs")
    functions = [lambda: method.start(modes), lambda: scheduler.decide(S), lambda: propagated_costs(A, S)]
    if kronecker is not None:
        require_equal(kronecker, costs, "Kronecker powers")
        functions.append(lambda: kronecker_costs(A, S))
    start, decide, propagate, *powers = timed(*functions)
    cells = [microseconds(start), microseconds(decide), microseconds(propagate), ratio(propagate, decide)]
    if powers:
        cells += [microseconds(powers[0]), ratio(powers[0], decide)]
    else:
        cells += [f"> {microseconds(PATIENCE)}", f"> {ratio(PATIENCE, decide)}"]
    return [f"n = {n}, m = {m}, T = {T}", *cells]


if __name__ == "__main__":
    header = ["", "decide (us)", "to T = 10", "step (us)", "to T = 10", "start (us)", "to T = 10"]
    print(text_table(header, horizons(6, 2) + horizons(12, 5)), end="\n\n")
    header = ["", "start (us)", "decide (us)", "propagate (us)", "to decide", "Kronecker (us)", "to decide"]
    print(text_table(header, [peers(n, m) for n in (2, 6, 12, 50) for m in (2, 5, 20)]))
    print(f"\nA decision is made at every sample, the start once. One evaluation is given up after {PATIENCE:g} s;")
    print("its costs are then checked against the propagated ones only.")
