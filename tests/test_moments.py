"""The kernel against the definitions, evaluated plainly."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

from switchctl import Gaussian, ModeSet, Schedule
from switchctl.gramians import horizon_gramians, tail, word_tail
from switchctl.moments import (
    closed_form_w2,
    constant_w2,
    moment_factor,
    moment_maps,
    second_moment,
    smat,
    svec,
    trajectory,
)
from switchctl.schur import is_schur

sizes = st.tuples(st.integers(1, 6), st.integers(1, 4), st.integers(0, 2**32 - 1))


def symmetric(rng, n):
    X = rng.standard_normal((n, n))
    return X + X.T


@given(sizes)
def test_svec_is_an_isometry_and_smat_its_inverse(size):
    n, _, seed = size
    rng = np.random.default_rng(seed)
    X, Y = symmetric(rng, n), symmetric(rng, n)
    assert svec(X) @ svec(Y) == pytest.approx(np.trace(X @ Y), rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(smat(svec(X)), X, rtol=1e-15)


def test_smat_finds_the_size_for_every_dimension():
    for n in range(1, 60):
        assert smat(svec(np.eye(n))).shape == (n, n)


@given(sizes)
def test_a_step_is_one_matrix_and_a_batch_one_product(size):
    n, m, seed = size
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((m, n, n))
    S = np.stack([symmetric(rng, n) for _ in range(5)])
    for mode, K in zip(A, moment_maps(A), strict=True):
        np.testing.assert_allclose(smat(svec(S) @ K.T), mode @ S @ mode.T, atol=1e-12)


def test_moment_map_is_the_kronecker_product_without_its_redundancy():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((3, 3))
    duplicate = np.stack([smat(e).ravel() for e in np.eye(6)], axis=1)  # svec -> vec, an isometry
    np.testing.assert_allclose(moment_maps(A), duplicate.T @ np.kron(A, A) @ duplicate, atol=1e-14)


@given(sizes)
@settings(max_examples=50)
def test_trajectory_is_the_papers_recursion(size):
    n, m, seed = size
    rng = np.random.default_rng(seed)
    A, x0 = random_modes(rng, n, m), random_gaussian(rng, n)
    sequence = rng.integers(0, m, 20)
    factors = trajectory(A, sequence, moment_factor(x0.mean, x0.cov))
    mean, cov = x0.mean, x0.cov
    for F, mode in zip(factors, [*sequence, 0], strict=True):
        scale = np.trace(second_moment(mean, cov)) + 1e-300
        np.testing.assert_allclose(F[:, 0], mean, atol=1e-12 * np.sqrt(scale))
        np.testing.assert_allclose(F[:, 1:] @ F[:, 1:].T, cov, atol=1e-12 * scale)
        mean, cov = A[mode] @ mean, A[mode] @ cov @ A[mode].T


@given(sizes, st.integers(1, 40))
@settings(max_examples=50)
def test_constant_w2_is_the_recursion_of_every_mode(size, steps):
    n, m, seed = size
    rng = np.random.default_rng(seed)
    A, S = random_modes(rng, n, m), random_gaussian(rng, n).second_moment
    w2 = constant_w2(A, S, steps)
    assert w2.shape == (m, steps)
    for mode, row in zip(A, w2, strict=True):
        moment, plain = S, []
        for _ in range(steps):
            plain.append(np.trace(moment))
            moment = mode @ moment @ mode.T
        np.testing.assert_allclose(row, plain, rtol=1e-8, atol=1e-13 * max(plain))


def test_constant_w2_of_modes_whose_directions_are_nearly_parallel():
    directions = np.array([[1.0, 1.0], [0.0, 1e-5]])
    A = directions @ np.diag([0.9, 0.5]) @ np.linalg.inv(directions)
    x = directions[:, 0]
    w2 = constant_w2(A[None], np.outer(x, x), 40)[0]
    np.testing.assert_allclose(w2, 0.81 ** np.arange(40), rtol=1e-3)


def test_constant_w2_beyond_the_floating_point_range_is_infinite():
    w2 = constant_w2(np.array([[[10.0, 1.0], [0.0, 5.0]], [[0.5, 0.0], [0.0, 0.5]]]), np.eye(2), 1000)
    assert np.isinf(w2[0, -1])
    other = constant_w2(np.diag([2.0, 0.5])[None], np.diag([0.0, 1.0]), 1500)
    np.testing.assert_allclose(other[0], 0.25 ** np.arange(1500))
    assert np.isfinite(w2[1]).all()
    assert not np.isnan(w2).any()


@given(sizes)
@settings(max_examples=30)
def test_proposition_3_agrees_with_the_recursion(size):
    n, m, seed = size
    rng = np.random.default_rng(seed)
    A, x0 = random_modes(rng, min(n, 4), m), random_gaussian(rng, min(n, 4))
    sequence = rng.integers(0, m, 8)
    factors = trajectory(A, sequence, moment_factor(x0.mean, x0.cov))
    for k in range(9):
        assert closed_form_w2(A, sequence[:k], x0.second_moment) == pytest.approx(np.sum(factors[k] ** 2), rel=1e-9)


@pytest.mark.parametrize("horizon", [1, 2, 3, 6, 7, 8, 50, 1000])
def test_horizon_gramian_is_the_plain_sum(horizon):
    rng = np.random.default_rng(3)
    A = random_modes(rng, 4, 3)
    Q = np.stack([symmetric(rng, 4) @ np.eye(4) for _ in range(3)])
    Q = Q @ np.swapaxes(Q, -1, -2)
    plain, power = np.zeros_like(A), np.broadcast_to(np.eye(4), A.shape)
    for _ in range(horizon + 1):
        plain = plain + np.swapaxes(power, -1, -2) @ Q @ power
        power = A @ power
    np.testing.assert_allclose(horizon_gramians(A, Q, horizon), plain, rtol=1e-10, atol=1e-12)


def exact_tail(A, Q):
    """The Lyapunov solution in 60 digits."""
    with mpmath.workdps(60):
        n = len(A)
        M, right = mpmath.matrix(n * n, n * n), mpmath.matrix(n * n, 1)
        for i, j in np.ndindex(n, n):
            right[i * n + j] = mpmath.mpf(float(Q[i, j]))
            for k, h in np.ndindex(n, n):
                M[i * n + j, k * n + h] = (i == k) * (j == h) - mpmath.mpf(float(A[k, i])) * mpmath.mpf(float(A[h, j]))
        return np.array(mpmath.lu_solve(M, right).tolist(), dtype=float).reshape(n, n)


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("sign", [1, -1])
def test_tail_against_60_digits_near_the_unit_circle(gap, sign):
    rng = np.random.default_rng(4)
    basis = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    A = basis @ np.diag([sign * (1 - gap), 0.9, -0.5, 0.1]) @ basis.T + 0.1 * basis[:, :1] @ basis[:, 1:2].T
    P = tail(A, np.eye(4))
    exact = exact_tail(A, np.eye(4))
    assert np.linalg.eigvalsh(P).min() > 0
    assert np.linalg.norm(P - exact) <= 1e-3 * np.linalg.norm(exact)
    if gap >= 1e-6:
        assert np.linalg.norm(P - exact) <= 1e-8 * np.linalg.norm(exact)


@pytest.mark.parametrize(
    "A",
    [
        0.99 * np.eye(5) + np.diag(np.ones(4), 1),
        np.array([[0.9, 1e9], [0.0, 0.5]]),
        np.array([[0.9, 1e7], [1e-12, 0.5]]),
        np.diag([1e6, 1.0, 1e-6])
        @ np.array([[0.5, 0.3, 0.1], [0.2, 0.6, -0.2], [0.0, 0.4, 0.3]])
        @ np.diag([1e-6, 1.0, 1e6]),
    ],
)
def test_tail_of_jordan_blocks_and_badly_scaled_states(A):
    exact = exact_tail(A, np.eye(len(A)))
    assert exact.max() > 1e9
    np.testing.assert_allclose(tail(A, np.eye(len(A))), exact, rtol=1e-6)


def test_tail_with_a_singular_weight():
    rng = np.random.default_rng(5)
    A, q = random_modes(rng, 4, 1)[0], rng.standard_normal((1, 4))
    np.testing.assert_allclose(tail(A, q.T @ q), exact_tail(A, q.T @ q), rtol=1e-9)
    np.testing.assert_array_equal(tail(A, np.zeros((4, 4))), 0)


@pytest.mark.parametrize(
    "A",
    [
        np.eye(2),
        np.diag([1.0, 0.5]),
        np.array([[0.0, -1.0], [1.0, 0.0]]),
        np.array([[1.0, 1.0], [0.0, 1.0]]),
        np.diag([1.0 + 1e-9, 0.0]),
        np.array([[2.0, 1.0], [0.0, 3.0]]),
        1e200 * np.eye(2),
    ],
)
def test_a_mode_that_is_not_schur_has_no_tail(A):
    assert tail(A, np.eye(2)) is None


def test_a_tail_that_cannot_be_trusted_is_an_error():
    directions = np.linalg.qr(np.random.default_rng(8).standard_normal((2, 2)))[0] @ [[1.0, 1.0], [0.0, 1e-5]]
    A = directions @ np.diag([0.9, 0.5]) @ np.linalg.inv(directions)
    with pytest.raises(np.linalg.LinAlgError, match="cannot be computed"):
        tail(A, np.eye(2))


def rotated(T, seed=8):
    basis = np.linalg.qr(np.random.default_rng(seed).standard_normal(T.shape))[0]
    return basis @ T @ basis.T


def test_a_verdict_that_rounding_hides_is_an_error():
    A = rotated(np.diag(np.linspace(0.9, -0.9, 5)) + 600 * np.triu(np.ones((5, 5)), 1))
    with mpmath.workdps(60):
        assert max(abs(x) for x in mpmath.eig(mpmath.matrix(A.tolist()), left=False, right=False)) < 1
    with pytest.raises(np.linalg.LinAlgError, match="undecided"):
        is_schur(A)
    modes = ModeSet([A, 0.5 * np.eye(5)], names=["wild", "tame"])
    assert "wild  spectral radius" in repr(modes) and "Schur undecided" in repr(modes)
    with pytest.raises(np.linalg.LinAlgError, match="mode 'wild'"):
        modes.tails  # noqa: B018
    assert "cost      not available" in repr(Schedule(modes, Gaussian(np.ones(5), np.eye(5)), [0]))


def test_no_verdict_is_ever_wrong():
    rng = np.random.default_rng(9)
    for _ in range(150):
        n = int(rng.integers(2, 6))
        growth = 10 ** rng.uniform(-1, 4)
        A = rotated(np.triu(rng.standard_normal((n, n)) * growth, 1) + np.diag(rng.uniform(-1.05, 1.05, n)), rng)
        with mpmath.workdps(60):
            eigenvalues = mpmath.eig(mpmath.matrix(A.tolist()), left=False, right=False)
            schur = max(abs(x) for x in eigenvalues) < 1
        try:
            assert is_schur(A) == schur
        except np.linalg.LinAlgError:
            assert np.linalg.norm(A, 2) > 10


@pytest.mark.slow
def test_no_tail_is_ever_indefinite_or_off():
    rng = np.random.default_rng(6)
    for _ in range(500):
        n = int(rng.integers(1, 13))
        A = random_modes(rng, n, 1, (1 - 10.0 ** rng.uniform(-12, -1),) * 2)[0]
        try:
            P = tail(A, np.eye(n))
        except np.linalg.LinAlgError:
            continue
        assert P is not None
        assert np.linalg.eigvalsh(P).min() >= 1 - 1e-9
        residual = np.eye(n) + A.T @ P @ A - P
        assert np.linalg.norm(residual) <= 1e-11 * np.linalg.norm(P)


def test_word_tail_is_the_sum_over_its_repetition():
    rng = np.random.default_rng(7)
    A = random_modes(rng, 3, 3, (0.3, 0.6))
    Q = np.stack([np.eye(3) * (i + 1) for i in range(3)])
    x0 = random_gaussian(rng, 3)
    word, total, S = (2, 0, 1, 1), 0.0, x0.second_moment
    for k in range(4000):
        mode = word[k % 4]
        total += np.trace(Q[mode] @ S)
        S = A[mode] @ S @ A[mode].T
    P = word_tail(A, Q, word)
    assert np.trace(P @ x0.second_moment) == pytest.approx(total, rel=1e-12)
    assert word_tail(A, Q, (1,)) == pytest.approx(tail(A[1], Q[1]))


def test_cost_matrices_are_exactly_symmetric():
    A = random_modes(np.random.default_rng(10), 5, 3)
    Q = np.broadcast_to(np.eye(5), A.shape)
    for G in (tail(A[0], Q[0]), word_tail(A, Q, (0, 1)), *horizon_gramians(A, Q, 11)):
        assert G is None or (G == G.T).all()
