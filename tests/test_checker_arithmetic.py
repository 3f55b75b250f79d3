"""The checker's own arithmetic: rounding goes the safe way, and definiteness is decided exactly."""

import random
from fractions import Fraction

from switchctl.certificates.check import Matrix, power


def fractions(M):
    scale = Fraction(2) ** -M.exponent
    return [[entry * scale for entry in row] for row in M.rows]


def semidefinite(rows):
    """Exactly, by eliminating in fractions."""
    rows = [row[:] for row in rows]
    for k in range(len(rows)):
        if rows[k][k] < 0 or (rows[k][k] == 0 and any(rows[k][k:])):
            return False
        for i in range(k + 1, len(rows)):
            if rows[k][k]:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True


def symmetric(generator, n, bits):
    rows = [
        [generator.getrandbits(generator.randint(1, bits)) * generator.choice([-1, 1]) for _ in range(n)]
        for _ in range(n)
    ]
    return Matrix([[rows[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)], generator.randint(-50, 400))


def test_rounding_goes_the_safe_way():
    """Matrices are rounded up and down in the Loewner order, and powers as numbers."""
    generator = random.Random(1)
    for _ in range(150):
        M = symmetric(generator, generator.randint(1, 4), 400)
        exact = fractions(M)
        for up in (True, False):
            rounded = M.coarse(up=up)
            assert max(abs(entry).bit_length() for row in rounded.rows for entry in row) <= 162
            other = fractions(rounded)
            sign = 1 if up else -1
            assert semidefinite(
                [[sign * (b - a) for a, b in zip(x, y, strict=True)] for x, y in zip(exact, other, strict=True)]
            )
    for _ in range(150):
        base, exponent = generator.choice([generator.random(), 1 + generator.random(), 1e-3]), generator.randint(0, 300)
        true = Fraction(base) ** exponent
        below, above = power(base, exponent, up=False), power(base, exponent, up=True)
        assert below <= true <= above
        assert above - below <= true * Fraction(1, 1 << 120)


def test_definite_is_exact_and_surely_definite_is_sure():
    generator = random.Random(2)
    sure = 0
    for _ in range(300):
        n = generator.randint(1, 4)
        size = generator.choice([2, 60, 200])
        F = [
            [generator.getrandbits(size) * generator.choice([-1, 0, 1]) for _ in range(n)]
            for _ in range(generator.randint(1, 4))
        ]
        rows = [[sum(f[i] * f[j] for f in F) for j in range(n)] for i in range(n)]
        k = generator.randrange(n)
        rows[k][k] += generator.choice([-1, 0, 1])
        M, true = Matrix(rows, generator.randint(0, 5)), semidefinite([[Fraction(x) for x in row] for row in rows])
        assert M.definite() == true
        less = [
            [x - (Fraction(1, 1 << 2000) if i == j else 0) for j, x in enumerate(row)] for i, row in enumerate(rows)
        ]
        positive = semidefinite(less)
        assert M.definite(strictly=True) == positive
        if M.surely_definite():
            sure += 1
            assert positive
    assert sure > 50
