"""A long schedule: time and memory a step, against the receding horizon that propagates every mode at every step."""

import tracemalloc
from statistics import median
from time import perf_counter

import numpy as np
from timing import microseconds, ratio, timed

from switchctl import Gaussian, ModeSet, RecedingHorizon, schedule
from switchctl.models import quadrotor
from switchctl.tables import text_table

T = 150
LENGTHS = (1_000, 10_000, 100_000)
PEER_STEPS = 300


def lasting_modes() -> ModeSet:
    """Scale the quadrotor's modes to spectral radius 1: the state neither vanishes nor grows in 100,000 steps."""
    modes = quadrotor.modes()
    return ModeSet(modes.A / modes.spectral_radii[:, None, None], modes.names, modes.dt)


def propagated_schedule(modes: ModeSet, x0: Gaussian) -> list[int]:
    """Schedule as the definition says: at every step move every mode's moment over the horizon, take the least."""
    A, transposed = modes.A, np.swapaxes(modes.A, 1, 2)
    S, sequence = x0.second_moment, []
    for _ in range(PEER_STEPS):
        moments, costs = np.broadcast_to(S, A.shape), np.zeros(len(A))
        for _ in range(T + 1):
            costs += np.trace(moments, axis1=1, axis2=2)
            moments = A @ moments @ transposed
        sequence.append(int(np.argmin(costs)))
        S = A[sequence[-1]] @ S @ transposed[sequence[-1]]
    return sequence


def seconds(modes: ModeSet, x0: Gaussian, steps: int) -> float:
    """Time one schedule."""
    start = perf_counter()
    schedule(modes, x0, RecedingHorizon(T), steps)
    return perf_counter() - start


def peak_bytes(modes: ModeSet, x0: Gaussian, steps: int) -> int:
    """Peak of the memory that Python and NumPy allocate for a schedule."""
    tracemalloc.start()
    schedule(modes, x0, RecedingHorizon(T), steps)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def main() -> None:
    modes, x0 = lasting_modes(), quadrotor.initial_state()
    turns = [[seconds(modes, x0, steps) for steps in LENGTHS] for _ in range(5)]
    rows = []
    for steps, times in zip(LENGTHS, zip(*turns, strict=True), strict=True):
        typical = median(times)
        bytes_each = peak_bytes(modes, x0, steps) / steps
        rows.append([f"{steps:,} steps", f"{typical:.3f}", f"{steps / typical:,.0f}", f"{bytes_each:.1f}"])
    print(text_table(["schedule, n = 6, m = 2", "seconds", "steps a second", "peak bytes a step"], rows))

    if schedule(modes, x0, RecedingHorizon(T), PEER_STEPS).sequence.tolist() != propagated_schedule(modes, x0):
        raise ArithmeticError("the schedule differs from the propagated one")
    peer, ours = timed(
        lambda: propagated_schedule(modes, x0),
        lambda: schedule(modes, x0, RecedingHorizon(T), PEER_STEPS),
        seconds=5,
    )
    print(f"\nAgainst propagating both modes over T = {T} at every step, {PEER_STEPS} steps, same decisions:")
    print(f"propagated {microseconds(peer / PEER_STEPS)} us a step, ", end="")
    print(f"schedule {microseconds(ours / PEER_STEPS)} us a step, ratio {ratio(peer, ours)}")


if __name__ == "__main__":
    main()
