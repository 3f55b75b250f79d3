"""Bounds of the joint spectral radius against listing all products, and the exact checker against floating point."""

import sys
from collections.abc import Iterator
from time import perf_counter

import numpy as np

from switchctl import ModeSet
from switchctl.certificates import Certificate, certify
from switchctl.models import five_mode
from switchctl.moments import Array
from switchctl.stability import joint_spectral_radius
from switchctl.tables import text_table

TOL = float(sys.argv[1]) if len(sys.argv) > 1 else 1e-2
WORDS = 2_000_000


def listed(A: Array, tol: float) -> tuple[float, float, int, int]:
    """The bounds of all products of a length, until they are within the tolerance: lower, upper, length, products."""
    products, lower, upper, count, k = A, 0.0, np.inf, 0, 1
    while True:
        count += len(products)
        lower = max(lower, float(np.abs(np.linalg.eigvals(products)).max()) ** (1 / k))
        upper = min(upper, float(np.linalg.norm(products, 2, axis=(1, 2)).max()) ** (1 / k))
        if upper <= lower * (1 + tol) or len(products) * len(A) > WORDS:
            return lower, upper, k, count
        products = (A[None] @ products[:, None]).reshape(-1, *A.shape[1:])
        k += 1


def matrix(rows: list[list[str]]) -> Array:
    return np.array([[float.fromhex(entry) for entry in row] for row in rows])


def in_floats(certificate: Certificate) -> bool:
    """The inequalities of a certificate of a joint spectral radius without rules, in floating point."""
    document = certificate.document
    A = [matrix(M) for M in document["data"]["A"]]
    upper, witness = certificate.upper, document["witness"]["upper"]
    norms = [matrix(R) for _, R in witness["norms"]]
    back = [np.linalg.inv(np.linalg.cholesky(R)) for R in norms]
    return all(
        np.linalg.norm(back[token] @ X @ back[token].T, 2) <= upper ** (2 * steps) * (1 + 1e-9)
        for R, tokens in zip(norms, witness["trees"], strict=True)
        for token, X, steps in cuts(A, R, tokens)
    )


def cuts(A: list[Array], R: Array, tokens: list[int]) -> Iterator[tuple[int, Array, int]]:
    stack = [(M, R, 1) for M in reversed(A)]
    for token in tokens:
        M, X, steps = stack.pop()
        X = M @ X @ M.T
        if token == -1:
            stack += [(M, X, steps + 1) for M in reversed(A)]
        else:
            yield token, X, steps


def random_pair(n: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((2, n, n))


def row(name: str, A: Array) -> list[str]:
    """One set of matrices."""
    begun = perf_counter()
    found = joint_spectral_radius(ModeSet(A), tol=TOL)
    ours = perf_counter() - begun
    begun = perf_counter()
    lower, upper, length, count = listed(A, TOL)
    theirs = perf_counter() - begun
    closed = upper <= lower * (1 + TOL)
    certificate = certify(found)
    begun = perf_counter()
    certificate.check()
    exact = perf_counter() - begun
    begun = perf_counter()
    assert in_floats(certificate)
    floats = perf_counter() - begun
    return [
        name,
        f"{found.lower:.6f} to {found.upper:.6f}",
        f"{ours * 1e3:.0f}",
        f"{lower:.6f} to {upper:.6f}",
        f"{length} ({count:,})",
        f"{'' if closed else '> '}{theirs / ours:.3g}",
        f"{exact * 1e3:.1f}",
        f"{exact / floats:.1f}",
    ]


if __name__ == "__main__":
    ahmadi = np.array([[[-1, -1], [-4, 0]], [[3, 3], [-2, 1]]], dtype=float)
    sets = {
        "Ahmadi et al. 5.4": ahmadi,
        "example 1": five_mode.modes().A,
        "{[1 1; 0 1], 0.8 [1 0; 1 1]}": np.array([[[1, 1], [0, 1]], [[0.8, 0], [0.8, 0.8]]]),
        **{f"Gaussian, n = {n}": random_pair(n, n) for n in (2, 3, 4, 6)},
    }
    joint_spectral_radius(ModeSet(ahmadi))  # the first one imports the solver
    heading = ["matrices", "bounds", "ms", "all products", "length", "time to ours", "check ms", "to floats"]
    print(f"to a relative gap of {TOL:g}, at most {WORDS:,} products of a length")
    print(text_table(heading, [row(name, A) for name, A in sets.items()]))
