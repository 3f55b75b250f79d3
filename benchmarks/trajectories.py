"""W2 of constant modes, and batches of moments, against the loops that they replace."""

import numpy as np
from timing import microseconds, random_modes, ratio, require_equal, timed

from switchctl.moments import Array, constant_w2, moment_maps, smat, svec
from switchctl.tables import text_table


def looped_w2(A: Array, S: Array, steps: int) -> Array:
    """W2 of every mode by a loop over modes and steps."""
    w2 = np.empty((len(A), steps))
    for i, mode in enumerate(A):
        moment = S
        for k in range(steps):
            w2[i, k] = np.trace(moment)
            moment = mode @ moment @ mode.T
    return w2


def constant_modes(n: int, m: int, steps: int) -> list[str]:
    """Time `constant_w2` against the loop."""
    A, S = random_modes(m, n)
    require_equal(constant_w2(A, S, steps), looped_w2(A, S, steps), "W2")
    ours, loop = timed(lambda: constant_w2(A, S, steps), lambda: looped_w2(A, S, steps))
    return [f"n = {n}, m = {m}, {steps:,} steps", microseconds(ours), microseconds(loop), ratio(loop, ours)]


def batch(n: int, count: int) -> list[str]:
    """Time a step of many moments: one product of half-vectors, a loop, NumPy's batched product of matrices.

    The half-vectorisation is timed apart: it is done once, however many steps follow.
    """
    A = random_modes(1, n)[0][0]
    factors = np.random.default_rng(1).standard_normal((count, n, n))
    S = factors @ np.swapaxes(factors, 1, 2)
    moments, K = svec(S), moment_maps(A)
    shift = np.abs(A @ S @ A.T).max()  # an entry near zero is only as exact as its matrix
    require_equal(smat(moments @ K.T) + shift, A @ S @ A.T + shift, "batched moments")
    require_equal(np.array([A @ moment @ A.T for moment in S]) + shift, A @ S @ A.T + shift, "looped moments")
    product, loop, batched, there, back = timed(
        lambda: moments @ K.T,
        lambda: [A @ moment @ A.T for moment in S],
        lambda: A @ S @ A.T,
        lambda: svec(S),
        lambda: smat(moments),
    )
    cells = [microseconds(product), microseconds(loop), ratio(loop, product)]
    cells += [microseconds(batched), ratio(batched, product), microseconds(there), microseconds(back)]
    return [f"n = {n}, N = {count:,}", *cells]


if __name__ == "__main__":
    header = ["W2 of constant modes", "constant_w2 (us)", "loop (us)", "ratio"]
    sizes = [(2, 200), (5, 200), (5, 2_000)]
    print(text_table(header, [constant_modes(n, m, steps) for n in (2, 6, 12) for m, steps in sizes]), end="\n\n")
    header = [
        "a step of N moments",
        "product (us)",
        "loop (us)",
        "ratio",
        "batched (us)",
        "ratio",
        "svec (us)",
        "smat (us)",
    ]
    print(text_table(header, [batch(n, count) for n in (2, 6, 12) for count in (100, 10_000)]))
