"""Matrices of fixed-point integers: costs to as many digits as it takes, and a proof of how many are right.

An array of Python integers X with b bits is the matrix X / 2^b. NumPy's product of such arrays is exact, and at n = 30
far faster than mpmath's. Products are then cut to b bits; a sum is checked by its residual, which is not cut.
"""

from fractions import Fraction
from math import isqrt

import numpy as np

DIGITS = 40  # of a reference, that are proven


def fixed(X, bits):
    """A matrix of floats, exactly."""

    def integer(x):
        numerator, denominator = float(x).as_integer_ratio()
        scaled, rest = divmod(numerator << bits, denominator)
        assert rest == 0, "a float has digits beyond the bits"
        return scaled

    X = np.asarray(X)
    return np.array([integer(x) for x in X.ravel()], dtype=object).reshape(X.shape)


def bits_of(*matrices):
    """The bits after the point that hold these floats exactly."""
    return max(float(x).as_integer_ratio()[1].bit_length() for X in matrices for x in np.ravel(X)) - 1


def ratios(X, Y):
    """``X / Y`` in floats, entry by entry, however great the integers."""
    pairs = zip(X.ravel(), Y.ravel(), strict=True)
    return np.array([x / y if y else (np.inf if x else 0.0) for x, y in pairs]).reshape(X.shape)


def greatest(X):
    return max(abs(x) for x in X.ravel())


def exact_tail(steps):
    """``P = sum_k M'^k T M^k`` of a word of steps (A, Q), first step first: M its product, T the cost of a period.

    Returns P and its bits; P is None where the word is unstable. With r the norm of its residual, ``|P - P*| <= r Z``,
    Z the same sum with T = I: at most twice the computed one if the residual of that is below a half. So every diagonal
    entry is right to 40 digits. A word is unstable where the trace of a power exceeds its size, at two precisions.
    """
    n, unstable = len(steps[0][0]), 0
    bits = max(bits_of(*(X for step in steps for X in step)), 256)
    while bits < 5000:
        one = np.diag(np.array([1 << bits] * n, dtype=object))
        word = [(fixed(A, bits), fixed(Q, bits)) for A, Q in steps]
        M, P, Z = one, 0 * one, one
        for A, Q in reversed(word):
            P, M = Q + (A.T @ (P @ A) >> 2 * bits), M @ A >> bits
        for _ in range(80):
            if not M.any() or abs(M.trace()) > 2 * n << bits:
                break
            P, Z, M = P + (M.T @ (P @ M) >> 2 * bits), Z + (M.T @ (Z @ M) >> 2 * bits), M @ M >> bits
        if M.any():
            unstable += abs(M.trace()) > 2 * n << bits
        elif _is_proven(word, P, Z, bits):
            return P, bits
        if unstable == 2:
            return None, bits
        bits *= 2
    raise AssertionError("no reference: the spectral radius is too near 1")


def _is_proven(word, P, Z, bits):
    n, end = len(P), 2 * bits * len(word)
    back, back_Z = P, Z
    for k, (A, Q) in enumerate(reversed(word)):
        back, back_Z = (Q << 2 * bits * (k + 1)) + A.T @ (back @ A), A.T @ (back_Z @ A)
    residuals = back - (P << end), (np.diag(np.array([1 << bits] * n, dtype=object)) << end) + back_Z - (Z << end)
    r, r_Z = (Fraction(n * greatest(R), 1 << end + bits) for R in residuals)
    return r_Z < Fraction(1, 2) and all(
        2 * r * z * 10**DIGITS <= p for p, z in zip(np.diag(P), np.diag(Z), strict=True)
    )


def exact_horizon(A, Q, steps):
    """``sum_{k < steps} A'^k Q A^k``, exactly, and its bits."""
    bits = bits_of(A, Q)
    A, G, power = fixed(A, bits), fixed(Q, bits), 1
    Q = G
    for _ in range(steps - 1):  # G has bits * power bits
        G = A.T @ (G @ A) + (Q << bits * (power + 1))
        power += 2
    return G, bits * power


def errors(P, exact, bits):
    """Of a computed P: the greatest error of the diagonal and of any entry, to sqrt(P_ii P_jj), and in the norm."""
    more = max(bits, bits_of(P))
    exact = exact << (more - bits)
    wrong, diagonal = fixed(P, more) - exact, np.diag(exact)
    scale = np.array([[isqrt(x * y) for x in diagonal] for y in diagonal], dtype=object)
    relative = np.abs(ratios(wrong, scale))
    whole = np.full(exact.shape, greatest(exact), dtype=object)
    norm = np.linalg.norm(ratios(wrong, whole), 2) / np.linalg.norm(ratios(exact, whole), 2) if greatest(exact) else 0.0
    return np.diag(relative).max(), relative.max(), norm
