"""What the benchmarks share: timing by turns, and random modes to run on."""

from collections.abc import Callable
from time import perf_counter

import numpy as np

from switchctl.moments import Array

RUN = 0.003  # seconds: long enough for the clock, short enough to take turns


def timed(*functions: Callable[[], object], seconds: float = 0.2) -> Array:
    """Seconds per call of each function at each turn, shape (functions, turns).

    The functions take turns, so that a slow moment of the machine falls on all of them; `ratio` compares within a
    turn. There are at least five turns, and as many as fit into ``seconds`` a function.
    """
    calls = [_calls(function) for function in functions]
    times: list[list[float]] = [[] for _ in functions]
    turn = list(range(len(functions)))
    end = perf_counter() + seconds * len(functions)
    while len(times[0]) < 5 or perf_counter() < end:
        for j in turn:
            times[j].append(_run(functions[j], calls[j]))
        turn.reverse()  # so that none always comes first
    return np.array(times)


def _calls(function: Callable[[], object]) -> int:
    """How many calls fill a run, by doubling: a first call says little."""
    calls = 1
    while _run(function, calls) * calls < RUN:
        calls *= 2
    return calls


def _run(function: Callable[[], object], calls: int) -> float:
    """Seconds per call, after one call that brings code and data back into the cache."""
    function()
    start = perf_counter()
    for _ in range(calls):
        function()
    return (perf_counter() - start) / calls


def random_modes(m: int, n: int, seed: int = 0) -> tuple[Array, Array]:
    """Draw m Gaussian matrices scaled to spectral radius 0.95, and a second moment."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((m, n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max(axis=1)[:, None, None]
    factor = random.standard_normal((n, n + 1))
    return A, factor @ factor.T


def microseconds(seconds: Array | float) -> str:
    """Format the median time over the turns."""
    value = 1e6 * np.median(seconds)
    return f"{value:,.{1 if value < 100 else 0}f}"


def ratio(seconds: Array | float, reference: Array) -> str:
    """Format the median, over the turns, of how many times the reference."""
    value = np.median(seconds / reference)
    return f"{value:,.{2 if value < 10 else 0}f}"


def require_equal(value: Array, reference: Array, what: str) -> None:
    """Raise unless two computations agree to a relative 1e-9: only then is their speed worth comparing."""
    if not np.allclose(value, reference, rtol=1e-9, atol=0):
        error = np.max(np.abs(value / reference - 1))
        raise ArithmeticError(f"{what}: the two computations differ by a relative {error:.2g}")
