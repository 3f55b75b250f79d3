"""Growth of moments: both bounds against 60 digits, their witnesses in exact arithmetic."""

from fractions import Fraction
from itertools import product

import mpmath
import numpy as np
import pytest
from control import ControlDimension
from random_cases import random_modes

from switchctl import ModeSet, Rules, SwitchingGraph
from switchctl.stability import random_stability, schur_stability, word_stability


def exactly(M):
    return [[Fraction(float(x)) for x in row] for row in M]


def times(X, Y):
    columns = list(zip(*Y, strict=True))
    return [[sum(a * b for a, b in zip(row, column, strict=True)) for column in columns] for row in X]


def semidefinite(M, strictly=False):
    M, n = [row[:] for row in M], len(M)
    for k in range(n):
        if M[k][k] < 0 or (M[k][k] == 0 and (strictly or any(M[k][k:]))):
            return False
        for i in range(k + 1, n):
            if M[k][k]:
                factor = M[i][k] / M[k][k]
                M[i] = [a - factor * b for a, b in zip(M[i], M[k], strict=True)]
    return True


def check_witnesses(rate):
    """What the docstring of GrowthRate says of P, H and start, in rational arithmetic."""
    n = rate.P.shape[-1]
    P, H = [exactly(M) for M in rate.P], [exactly(M) for M in rate.H]
    for sign, square, X in ((1, Fraction(rate.upper) ** 2, P), (-1, Fraction(rate.lower) ** 2, H)):
        before = [[[Fraction(0)] * n for _ in range(n)] for _ in X]
        for move in rate.moves:
            A = exactly(move.A)
            moved = times(list(map(list, zip(*A, strict=True))), times(X[move.head], A))
            for i, j in product(range(n), repeat=2):
                before[move.tail][i][j] += Fraction(move.weight) * moved[i][j]
        for M, N in zip(X, before, strict=True):
            assert all(M[i][j] == M[j][i] for i, j in product(range(n), repeat=2))
            left = [[sign * (square * M[i][j] - N[i][j]) for j in range(n)] for i in range(n)]
            assert semidefinite(left)
            assert sign < 0 or semidefinite(M, strictly=True)
    node, x = rate.start
    x = [[Fraction(float(entry))] for entry in x]
    assert times([[entry for (entry,) in x]], times(H[node], x))[0][0] > 0


def radius_60(A, degree=1):
    """Spectral radius to 60 digits, and its root of a degree."""
    with mpmath.workdps(60):
        eigenvalues = mpmath.eig(mpmath.matrix(A), left=False, right=False)
        return max(abs(x) for x in eigenvalues) ** (mpmath.mpf(1) / degree)


def rate_of(steps):
    with mpmath.workdps(60):
        whole = mpmath.eye(len(steps[0]))
        for A in steps:
            whole = mpmath.matrix(A) * whole
        return radius_60(whole, len(steps))


def operator_60(moves, nodes, n):
    """The operator on vec of the moments, to 60 digits."""
    with mpmath.workdps(60):
        T = mpmath.zeros(nodes * n * n)
        for tail, head, weight, A in moves:
            for i, j, k, q in product(range(n), repeat=4):
                T[head * n * n + i * n + j, tail * n * n + k * n + q] += (
                    mpmath.mpf(weight) * mpmath.mpf(A[i, k]) * mpmath.mpf(A[j, q])
                )
        return T


def gap(rate, true):
    """How far apart the bounds are, which must be on either side."""
    with mpmath.workdps(60):
        assert mpmath.mpf(rate.lower) <= true <= mpmath.mpf(rate.upper)
    assert (rate.verdict == "stable") <= (true < 1) and (rate.verdict == "unstable") <= (true >= 1)
    return (rate.upper - rate.lower) / rate.upper


def test_bounds_of_modes():
    rng = np.random.default_rng(1)
    gaps = []
    for _ in range(100):
        n = int(rng.integers(1, 7))
        A = random_modes(rng, n, 1, (0.5, 1.5))
        (rate,) = schur_stability(ModeSet(A))
        gaps.append(gap(rate, radius_60(A[0])))
        assert rate.verdict != "undecided"
        if n <= 3:
            check_witnesses(rate)
    assert np.median(gaps) < 1e-11 and max(gaps) < 1e-7


def test_bounds_of_words():
    rng = np.random.default_rng(2)
    gaps = []
    for _ in range(80):
        n, m, p = int(rng.integers(1, 6)), int(rng.integers(1, 4)), int(rng.integers(1, 8))
        A, word = random_modes(rng, n, m, (0.7, 1.3)), rng.integers(0, m, p).tolist()
        rate = word_stability(ModeSet(A), word)
        gaps.append(gap(rate, rate_of([A[i] for i in word])))
        if n <= 2:
            check_witnesses(rate)
    assert np.median(gaps) < 1e-11 and max(gaps) < 1e-7


def test_bounds_of_independent_switching():
    rng = np.random.default_rng(3)
    gaps = []
    for _ in range(70):
        n, m = int(rng.integers(1, 4)), int(rng.integers(2, 4))
        A, p = random_modes(rng, n, m, (0.5, 1.3)), rng.dirichlet(np.ones(m))
        rate = random_stability(ModeSet(A), p)
        p = p / p.sum()
        T = operator_60([(0, 0, p[i], A[i]) for i in range(m)], 1, n)
        gaps.append(gap(rate, radius_60(T, 2)))
        check_witnesses(rate)
    assert np.median(gaps) < 1e-11 and max(gaps) < 1e-7


def test_bounds_of_markov_switching():
    rng = np.random.default_rng(4)
    gaps = []
    for _ in range(50):
        n, m = int(rng.integers(1, 3)), int(rng.integers(2, 4))
        A, Pi = random_modes(rng, n, m, (0.5, 1.4)), rng.dirichlet(np.ones(m) / 2, m)
        rate = random_stability(ModeSet(A), Pi)
        Pi = Pi / Pi.sum(axis=1, keepdims=True)
        T = operator_60([(i, j, Pi[i, j], A[j]) for i, j in np.ndindex(m, m)], m, n)
        gaps.append(gap(rate, radius_60(T, 2)))
        check_witnesses(rate)
    assert np.median(gaps) < 1e-11 and max(gaps) < 1e-7


def unimodular(rng, n):
    """An integer matrix and its inverse, both exact."""
    L, U = (np.tril(rng.integers(-2, 3, (n, n)), -1) + np.eye(n) for _ in range(2))
    T = L @ U.T
    return T, np.round(np.linalg.inv(T))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("power", [1, 10, 20, 36])
def test_defective_modes_near_the_unit_circle_are_never_judged_wrongly(order, power):
    """Jordan blocks of the eigenvalue 1 -+ 2^-power, exact, plainly and in other coordinates."""
    rng = np.random.default_rng(order * 100 + power)
    decided = 0
    for eigenvalue in (1 - 2.0**-power, 1 + 2.0**-power):
        J = eigenvalue * np.eye(order) + np.eye(order, k=1)
        T, inverse = unimodular(rng, order)
        for A in (J, J.T, T @ J @ inverse):
            if exactly(A) not in (exactly(J), exactly(J.T), times(times(exactly(T), exactly(J)), exactly(inverse))):
                continue  # rounded, and so another matrix
            (rate,) = schur_stability(ModeSet([A]))
            gap(rate, mpmath.mpf(eigenvalue))
            check_witnesses(rate)
            decided += rate.verdict != "undecided"
    assert decided >= 4  # those that show how they are scaled


def test_one_minus_1e_12_is_decided():
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    for rho, verdict in ((1 - 1e-12, "stable"), (1 + 1e-12, "unstable")):
        A = turn @ np.diag([rho, 0.5, -0.3, 0.1]) @ turn.T
        (rate,) = schur_stability(ModeSet([A]))
        gap(rate, radius_60(A))
        assert rate.verdict == verdict
        check_witnesses(rate)


def test_rotations_are_undecided_and_bounded():
    for angle in (0.1, np.pi / 2, 2.0):
        A = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        (rate,) = schur_stability(ModeSet([A]))
        assert rate.verdict == "undecided" and gap(rate, radius_60(A)) < 1e-9
        assert "undecided" in repr(rate) and "undecided" in rate._repr_html_()


def test_nilpotent_and_zero_modes():
    for A in (np.zeros((2, 2)), np.diag([1.0, 2.0], 1), np.diag([1.0, -3.0, 1e3], -1)):
        (rate,) = schur_stability(ModeSet([A]))
        assert rate.verdict == "stable" and rate.lower == 0 and rate.upper < 1e-9
        check_witnesses(rate)
    rng = np.random.default_rng(6)
    for n in (2, 3, 4):
        T, inverse = unimodular(rng, n)
        A = T @ np.eye(n, k=1) @ inverse
        (rate,) = schur_stability(ModeSet([A]))
        assert rate.verdict == "stable" and rate.lower <= 1e-3 and rate.upper < 0.2
        check_witnesses(rate)
    modes = ModeSet([np.diag([1.0, 1.0], 1), np.diag([5.0, 5.0], 1)])
    assert random_stability(modes, [0.3, 0.7]).upper < 1e-9  # T is nilpotent: products are strictly triangular


def test_badly_scaled_states():
    rng = np.random.default_rng(7)
    for _ in range(30):
        n = int(rng.integers(2, 5))
        D = np.diag(2.0 ** rng.integers(-20, 21, n))
        A = D @ random_modes(rng, n, 2, (0.5, 1.2)) @ np.linalg.inv(D)
        modes = ModeSet(A)
        for i, rate in enumerate(schur_stability(modes)):
            assert gap(rate, radius_60(A[i])) < 1e-9
        for rate in (word_stability(modes, [0, 1, 1]), random_stability(modes, [0.5, 0.5])):
            assert (rate.upper - rate.lower) / rate.upper < 1e-9
            if n <= 3:
                check_witnesses(rate)


def test_a_long_word_whose_product_leaves_the_range_of_numbers():
    for size in (1e-3, 0.5, 3.0):
        modes = ModeSet([size * np.array([[0.6, 1.0], [0.0, 0.6]]), size * np.array([[0.6, 0.0], [0.5, 0.6]])])
        word = ([0, 1] * 200) + [0]
        short, long = word_stability(modes, [0, 1]), word_stability(modes, word)
        assert (long.upper - long.lower) / long.upper < 1e-7
        assert long.upper == pytest.approx(short.upper, rel=0.02)


def test_a_word_with_activation_begins_each_step_with_its_switch():
    rng = np.random.default_rng(8)
    E = np.broadcast_to(np.eye(2), (2, 2, 2, 2)).copy()
    E[0, 1], E[1, 0] = rng.standard_normal((2, 2, 2))
    modes = ModeSet(random_modes(rng, 2, 2), activation=E)
    A = modes.A
    rate = word_stability(modes, [0, 0, 1])
    gap(rate, rate_of([A[0] @ E[1, 0], A[0], A[1] @ E[0, 1]]))
    independent = random_stability(modes, [0.4, 0.6])
    chain = random_stability(modes, [[0.4, 0.6], [0.4, 0.6]])
    assert len(independent.P) == 2 and independent.upper == pytest.approx(chain.upper, rel=1e-9)
    check_witnesses(independent)


def moments_by_paths(modes, Pi, first, S, steps):
    """The expected second moment after some steps, over all paths of modes after the mode ``first``."""
    m, total = len(modes), np.zeros_like(S)
    for path in product(range(m), repeat=steps):
        probability, M, before = 1.0, np.eye(len(S)), first
        for i in path:
            probability, M, before = probability * Pi[before][i], modes.A_after[before, i] @ M, i
        total += probability * M @ S @ M.T
    return total


def test_moves_of_markov_switching_give_the_expected_moment():
    rng = np.random.default_rng(9)
    E = rng.standard_normal((2, 2, 2, 2))
    E[0, 0] = E[1, 1] = np.eye(2)
    Pi, S = np.array([[0.9, 0.1], [0.6, 0.4]]), np.array([[2.0, 0.3], [0.3, 1.0]])
    for modes in (ModeSet(random_modes(rng, 2, 2)), ModeSet(random_modes(rng, 2, 2), activation=E)):
        rate = random_stability(modes, Pi)
        for first in (0, 1):
            nodes = np.zeros((2, 2, 2))
            nodes[first] = S
            for _ in range(6):
                after = np.zeros_like(nodes)
                for move in rate.moves:
                    after[move.head] += move.weight * move.A @ nodes[move.tail] @ move.A.T
                nodes = after
            assert np.allclose(nodes.sum(axis=0), moments_by_paths(modes, Pi, first, S, 6))


def run_markov(rng, modes, Pi, x, before, steps, noise=False):
    """Drawn runs: the states, and the modes of the last step."""
    roots = np.linalg.cholesky(modes.W) if noise else None
    for _ in range(steps):
        drawn = (rng.random(len(x))[:, None] > np.cumsum(Pi, axis=1)[before]).sum(axis=1)
        x = np.einsum("kij,kj->ki", modes.A_after[before, drawn], x)
        if noise:
            x = x + np.einsum("kij,kj->ki", roots[drawn], rng.standard_normal(x.shape))
        before = drawn
    return x, before


def test_markov_switching_against_drawn_runs():
    rng = np.random.default_rng(10)
    modes = ModeSet([[[0.9, 0.5], [0.0, 0.4]], [[1.2, 0.0], [0.3, 0.5]]])
    Pi = np.array([[0.5, 0.5], [0.9, 0.1]])
    x, _ = run_markov(rng, modes, Pi, np.ones((200_000, 2)), np.zeros(200_000, int), 5)
    expected = moments_by_paths(modes, Pi, 0, np.ones((2, 2)), 5)
    assert np.allclose(x.T @ x / len(x), expected, rtol=0.03)


def test_stationary_moments_of_modes_and_words_are_where_runs_settle():
    rng = np.random.default_rng(11)
    W = np.array([np.diag([0.5, 0.1]), [[1.0, 0.4], [0.4, 0.3]]])
    modes = ModeSet(random_modes(rng, 2, 2, (0.6, 0.8)), W=W)
    for word in ([0], [1], [0, 1], [0, 0, 1], [1, 0, 1, 1]):
        rate, S = word_stability(modes, word), np.zeros((2, 2))
        assert rate.verdict == "stable"
        for _ in range(300):
            here = []
            for i in word:
                here.append(S)
                S = modes.A[i] @ S @ modes.A[i].T + W[i]
        assert np.allclose(rate.stationary.given, here, rtol=1e-9)
        assert np.allclose(rate.stationary.total, np.mean(here, axis=0), rtol=1e-9)
    for i, rate in enumerate(schur_stability(modes)):
        assert np.allclose(rate.stationary.total, word_stability(modes, [i]).stationary.total)
    assert "second moment of trace" in repr(rate)


def test_stationary_moment_of_random_switching():
    rng = np.random.default_rng(12)
    W = np.array([np.diag([0.5, 0.1]), [[1.0, 0.4], [0.4, 0.3]]])
    A = np.array([[[0.7, 0.5], [0.0, 0.4]], [[1.05, 0.0], [0.3, 0.5]]])
    modes, Pi = ModeSet(A, W=W), np.array([[0.8, 0.2], [0.9, 0.1]])
    rate = random_stability(modes, Pi)
    share, given = rate.stationary
    assert np.allclose(share, [9 / 11, 2 / 11])
    x, before = run_markov(rng, modes, Pi, np.zeros((300_000, 2)), np.zeros(300_000, int), 60, noise=True)
    for i in (0, 1):
        assert np.allclose(x[before == i].T @ x[before == i] / (before == i).sum(), given[i], rtol=0.03)
    p, S = np.array([0.8, 0.2]), np.zeros((2, 2))
    for _ in range(3000):
        S = sum(p[i] * (A[i] @ S @ A[i].T + W[i]) for i in (0, 1))
    assert np.allclose(random_stability(modes, p).stationary.total, S, rtol=1e-9)
    assert random_stability(ModeSet(2 * A, W=W), p).stationary is None


def test_noise_needs_one_stationary_distribution():
    A, W = [[[0.5]], [[0.4]], [[0.3]]], [[1.0]]
    two = [[1, 0, 0], [0, 1, 0], [0.5, 0.5, 0]]
    with pytest.raises(ValueError, match=r"\{A0\} and \{A1\} are never left"):
        random_stability(ModeSet(A, W=W), two)
    assert random_stability(ModeSet(A), two).upper == pytest.approx(0.5)
    left = random_stability(ModeSet(A, W=W), [[0.5, 0.5, 0], [0.5, 0.5, 0], [1, 0, 0]]).stationary
    assert left.share[2] == 0 and left.given[2] == 0 and np.isfinite(left.total).all()


def test_a_chain_that_may_never_leave_an_unstable_mode_is_unstable():
    modes = ModeSet([[[0.5]], [[1.1]]])
    rate = random_stability(modes, [[0.5, 0.5], [0, 1]])
    assert rate.verdict == "unstable" and rate.lower == pytest.approx(1.1)
    assert random_stability(modes, [1, 0]).upper == pytest.approx(0.5)


def test_what_is_refused():
    modes = ModeSet([[[0.5]], [[1.1]]])
    with pytest.raises(ValueError, match=r"the sum of row 1 of probabilities is 0\.9"):
        random_stability(modes, [[0.5, 0.5], [0.5, 0.4]])
    with pytest.raises(ValueError, match=r"probabilities has an entry -0\.5"):
        random_stability(modes, [1.5, -0.5])
    with pytest.raises(ControlDimension, match=r"expected \(2,\) or \(2, 2\)"):
        random_stability(modes, [1.0])
    with pytest.raises(ValueError, match="must be finite"):
        random_stability(modes, [np.nan, 1.0])
    for function in (schur_stability, lambda modes: random_stability(modes, [1.0]), lambda m: word_stability(m, [0])):
        with pytest.raises(TypeError, match="ModeSet"):
            function(np.eye(2))
    with pytest.raises(ValueError, match="word is empty"):
        word_stability(modes, [])
    with pytest.raises(TypeError, match="such as"):
        word_stability(modes, "A0")
    with pytest.raises(KeyError):
        word_stability(modes, ["A7"])
    graph = SwitchingGraph(modes, Rules(min_dwell=2))
    with pytest.raises(ValueError, match="not allowed by"):
        word_stability(graph, [0, 1])
    assert word_stability(graph, [0, 0, 1, 1]).upper == pytest.approx(np.sqrt(0.55))
    assert word_stability(graph, ["A0", "A1", "A1", "A0"]).upper == pytest.approx(np.sqrt(0.55))


def test_twenty_states():
    rng = np.random.default_rng(13)
    A = random_modes(rng, 20, 2, (0.9, 0.99))
    for rate, M in zip(schur_stability(ModeSet(A)), A, strict=True):
        assert rate.upper == pytest.approx(np.abs(np.linalg.eigvals(M)).max(), rel=1e-8)
        assert (rate.upper - rate.lower) / rate.upper < 1e-8
    rate = random_stability(ModeSet(A), [0.5, 0.5])
    assert (rate.upper - rate.lower) / rate.upper < 1e-8
