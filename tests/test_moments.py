"""The kernel against the definitions, evaluated plainly."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

from switchctl.gramians import horizon_gramians, is_schur, tail, word_tail
from switchctl.moments import (
    closed_form_w2,
    constant_w2,
    moment_factor,
    moment_maps,
    powers,
    second_moment,
    smat,
    svec,
    trajectory,
)

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


def test_constant_w2_beyond_the_floating_point_range_is_infinite():
    w2 = constant_w2(np.array([[[10.0, 1.0], [0.0, 5.0]], [[0.5, 0.0], [0.0, 0.5]]]), np.eye(2), 1000)
    assert np.isinf(w2[0, -1])
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


def test_powers():
    rng = np.random.default_rng(2)
    A = rng.standard_normal((2, 3, 3))
    for count in (1, 2, 7, 16):
        result = powers(A, count)
        assert result.shape == (2, count, 3, 3)
        np.testing.assert_allclose(result[1, -1], np.linalg.matrix_power(A[1], count - 1), rtol=1e-10)


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


def test_tail_of_a_jordan_block_with_large_transient_growth():
    A = 0.99 * np.eye(3) + np.diag(np.ones(2), 1)
    exact = exact_tail(A, np.eye(3))
    assert exact[-1, -1] > 1e9
    np.testing.assert_allclose(tail(A, np.eye(3)), exact, rtol=1e-6)


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
    A = 0.99 * np.eye(5) + np.diag(np.ones(4), 1)
    with pytest.raises(np.linalg.LinAlgError, match="cannot be computed"):
        tail(A, np.eye(5))


def test_a_verdict_that_rounding_hides_is_an_error():
    rng = np.random.default_rng(8)
    basis = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    A = basis @ (0.5 * np.eye(4) + 100 * np.diag(np.ones(3), 1)) @ basis.T
    assert np.abs(np.linalg.eigvals(A)).max() < 0.52
    with pytest.raises(np.linalg.LinAlgError, match="undecided"):
        is_schur(A)


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
