"""Modes on which a cost for ever is hard to compute, by family, seeded."""

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm


class Case(NamedTuple):
    """A mode, its stage weight, and the states that the cost sees, sooner or later."""

    name: str
    A: np.ndarray
    Q: np.ndarray
    seen: np.ndarray


def case(name, A, Q=None, hidden=()):
    n = len(A)
    states = np.array([i not in hidden for i in range(n)])
    return Case(name, np.ascontiguousarray(A, dtype=float), np.eye(n) if Q is None else Q, states)


def rotation(rng, n):
    return np.linalg.qr(rng.standard_normal((n, n)))[0]


def rotated(rng, A):
    basis = rotation(rng, len(A))
    return basis @ A @ basis.T


def rescaled(rng, A):
    """The mode in other units: powers of two from 2^-20 to 2^20, so that nothing is rounded."""
    unit = np.exp2(rng.integers(-20, 21, len(A)))
    return A * unit / unit[:, None]


def jordan(n, eigenvalue):
    return eigenvalue * np.eye(n) + np.eye(n, k=1)


JORDAN = [*product((2, 3, 5, 8, 13), (0.5, 0.9, 0.99, 1 - 1e-3)), (30, 0.5)]


def jordan_plain():
    for n, eigenvalue in JORDAN:
        yield case(f"Jordan block, n = {n}, {eigenvalue}", jordan(n, eigenvalue))


def jordan_rotated():
    for n, eigenvalue in JORDAN:
        rng = np.random.default_rng(n)
        yield case(f"rotated Jordan block, n = {n}, {eigenvalue}", rotated(rng, jordan(n, eigenvalue)))


def jordan_rescaled():
    for n, eigenvalue in JORDAN:
        rng = np.random.default_rng(n)
        yield case(f"rescaled Jordan block, n = {n}, {eigenvalue}", rescaled(rng, jordan(n, eigenvalue)))


def sampled():
    """Plants with rates from 1 to 10^6 per second, sampled every so many seconds."""
    for n in (3, 6, 12, 30):
        for dt in (1e-3, 1e-2, 1e-1, 1.0) if n < 30 else (1e-1,):
            rng = np.random.default_rng(n)
            rates = np.geomspace(1.0, 1e6, n)
            basis = rng.standard_normal((n, n))
            F = -basis @ np.diag(rates) @ np.linalg.inv(basis)
            yield case(f"rates 1 .. 1e6, n = {n}, dt = {dt:g} s", expm(F * dt))
    for n in (4, 8):
        for dt in (1e-3, 1e-2, 1e-1):
            rng = np.random.default_rng(n)
            k = np.geomspace(1.0, 1e6, n // 2)
            springs = np.diag(k + np.append(k[1:], 0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
            F = np.block([[np.zeros_like(springs), np.eye(n // 2)], [-springs, -0.01 * springs - 0.1 * np.eye(n // 2)]])
            yield case(f"stiff springs, n = {n}, dt = {dt:g} s", expm(F * dt))


def near_the_circle():
    """Poles at a distance 10^-k from the unit circle: real, complex, and double."""
    for k in range(3, 13):
        rng, radius = np.random.default_rng(k), 1 - 10.0**-k
        c, s = radius * np.cos(0.7), radius * np.sin(0.7)
        pair = np.array([[c, -s], [s, c]])
        fast = np.diag([0.9, -0.5, 0.1])
        couplings = 0.1 * np.triu(rng.standard_normal((7, 7)), 1)
        for name, slow in (
            ("real pole", np.array([[-radius]])),
            ("complex pair", pair),
            ("double pole", np.array([[radius, 10.0**-k], [0.0, radius]])),
            ("double pair", np.block([[pair, 10.0**-k * np.eye(2)], [np.zeros((2, 2)), pair]])),
        ):
            n = len(slow) + 3
            A = block_diag(slow, fast)
            A[: len(slow), len(slow) :] += couplings[: len(slow), len(slow) : n]
            yield case(f"{name} at 1 - 1e-{k}", rotated(rng, A))


def growing():
    """Modes whose powers grow by orders of magnitude before they shrink."""
    for n in (8, 14, 30):
        grcar = np.triu(np.tril(np.ones((n, n)), 3)) - np.eye(n, k=-1)
        for radius in (0.5, 0.9, 0.99) if n < 30 else (0.9,):
            A = grcar * radius / np.abs(np.linalg.eigvals(grcar)).max()
            yield case(f"Grcar, n = {n}, radius {radius}", A)
    for n in (3, 5, 8):
        for coupling in (1e1, 1e2, 1e3, 1e5, 1e8):
            rng = np.random.default_rng(n)
            A = np.diag(rng.uniform(-0.95, 0.95, n)) + coupling * np.triu(rng.standard_normal((n, n)), 1)
            yield case(f"triangular, n = {n}, couplings {coupling:g}", A)
            yield case(f"rotated triangular, n = {n}, couplings {coupling:g}", rotated(rng, A))
    for n in (3, 5, 8, 12, 16):
        for radius in (0.6, 0.9):
            rng = np.random.default_rng(n)
            coefficients = np.poly(radius * np.linspace(0.7, 1.0, n))
            yield case(f"companion, n = {n}, radius {radius}", np.vstack([-coefficients[1:], np.eye(n - 1, n)]))


def gaussian():
    for n in (2, 3, 4, 5, 6, 8, 10, 14, 20, 30):
        for radius in (0.3, 0.9, 0.999) if n < 20 else (0.9,):
            rng = np.random.default_rng(n)
            A = rng.standard_normal((n, n))
            yield case(f"Gaussian, n = {n}, radius {radius}", A * radius / np.abs(np.linalg.eigvals(A)).max())


def weights():
    """Weights of rank one and badly scaled ones; states hidden from the cost, unstable among them."""
    for n in (2, 4, 7, 12):
        for radius in (0.8, 0.99):
            rng = np.random.default_rng(n)
            A = rng.standard_normal((n, n))
            A *= radius / np.abs(np.linalg.eigvals(A)).max()
            C = rng.standard_normal((1, n))
            first = np.zeros((n, n))
            first[0, 0] = 1.0
            scales = np.diag(10 ** np.linspace(-8, 8, n))
            yield case(f"rank one, n = {n}, radius {radius}", A, C.T @ C)
            yield case(f"one state weighted, n = {n}, radius {radius}", A, first)
            yield case(f"weights 1e-8 .. 1e8, n = {n}, radius {radius}", A, scales)
            triangular = np.triu(A, 1) + radius * np.eye(n)
            yield case(f"weights 1e8 .. 1e-8, triangular, n = {n}, radius {radius}", triangular, scales[::-1, ::-1])
            yield case(f"head of a chain weighted, n = {n}, radius {radius}", jordan(n, radius), first)
    for pole in (1.0, -1.0, 1.5):
        for n in (3, 6):
            rng = np.random.default_rng(n)
            A = np.zeros((n + 2, n + 2))
            A[:n, :n] = rng.standard_normal((n, n))
            A[:n, :n] *= 0.9 / np.abs(np.linalg.eigvals(A[:n, :n])).max()
            A[n:, :n] = rng.standard_normal((2, n))
            A[n:, n:] = [[pole, 1.0], [0.0, pole]]
            Q = np.zeros((n + 2, n + 2))
            Q[:n, :n] = np.eye(n)
            yield case(f"hidden pole {pole:g}, n = {n}", A, Q, hidden=(n, n + 1))


FAMILIES = {
    "Jordan blocks": jordan_plain,
    "Jordan blocks, rotated": jordan_rotated,
    "Jordan blocks, rescaled": jordan_rescaled,
    "stiff, sampled": sampled,
    "near the unit circle": near_the_circle,
    "transient growth": growing,
    "Gaussian": gaussian,
    "weights": weights,
}


def words():
    """Two modes that undo each other but for poles near the unit circle, and random ones: steps of a word."""
    for n in (2, 3, 5):
        for condition in (1e1, 1e2, 1e4, 1e6, 1e8):
            for gap in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
                rng = np.random.default_rng([n, int(np.log10(condition))])
                there = rotation(rng, n) @ np.diag(np.geomspace(1, condition, n)) @ rotation(rng, n)
                poles = rotated(rng, np.diag(np.append(1 - gap, rng.uniform(-0.9, 0.9, n - 1))))
                A = there, poles @ np.linalg.inv(there)
                name = f"out and back, n = {n}, condition {condition:g}, 1 - {gap:g}"
                yield name, [(A[0], np.eye(n)), (A[1], np.eye(n))]
                yield name + ", from amid", [(A[1], np.eye(n)), (A[0], np.eye(n))]
    for n in (2, 4, 8):
        for length in (3, 12):
            rng = np.random.default_rng([n, length])
            yield (
                f"Gaussian, n = {n}, {length} steps",
                [(rng.standard_normal((n, n)) / np.sqrt(n) * 0.9, np.eye(n)) for _ in range(length)],
            )
