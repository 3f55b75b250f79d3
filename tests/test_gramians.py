"""The kernel where it is easily broken: batches, units far apart, the edges of its verdicts."""

import numpy as np
import pytest

from switchctl.gramians import affine_gramians, horizon_gramians, regrouped_gramians, seen, tail, word_tail
from switchctl.moments import (
    closed_form_w2,
    constant_w2,
    moment_factor,
    moment_maps,
    root,
    second_moment,
    smat,
    svec,
    transform,
)


def test_batches_of_batches():
    rng = np.random.default_rng(0)
    X, A = rng.standard_normal((2, 2, 5, 3, 3))
    X = X + np.swapaxes(X, -1, -2)
    moved = np.einsum("...ij,...j->...i", moment_maps(A), svec(X))
    for where in np.ndindex(2, 5):
        assert (svec(X)[where] == svec(X[where])).all() and (smat(svec(X))[where] == smat(svec(X[where]))).all()
        np.testing.assert_allclose(smat(moved[where]), A[where] @ X[where] @ A[where].T, atol=1e-12)
        assert (transform(A, X)[where] == transform(A[where], X[where])).all()
        assert (seen(A, X**2)[where] == seen(A[where], X[where] ** 2)).all()
    mean, cov = rng.standard_normal((2, 5, 3)), X @ X
    for where in np.ndindex(2, 5):
        moment = np.outer(mean[where], mean[where]) + cov[where]
        np.testing.assert_allclose(second_moment(mean, cov)[where], moment, rtol=1e-15)


def test_transform_is_a_congruence_and_exactly_symmetric():
    M, G = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[1.0, 0.5], [0.5, 2.0]])
    assert transform(M, G).tolist() == [[22.0, 31.0], [31.0, 44.0]]


def test_a_factor_multiplies_to_its_matrix_in_units_far_apart():
    correlated = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, -0.3], [0.2, -0.3, 1.0]])
    for scale in ([1.0, 1.0, 1.0], [1e12, 1.0, 1e-12], [3e-150, 1.0, 7e150], [1e-9, 2.0, 1e9]):
        S = correlated * np.outer(scale, scale)
        L = root(S)
        np.testing.assert_allclose(L @ L.T, S, rtol=1e-13)


def test_a_factor_of_a_singular_matrix_is_real_and_keeps_zeros():
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = rng.standard_normal((4, 1)) * [[1.0], [1e-6], [1e6], [1.0]]
        x[rng.integers(4)] = 0.0
        L = root(x @ x.T)
        np.testing.assert_allclose(L @ L.T, x @ x.T, rtol=1e-13)
        assert not L[x[:, 0] == 0].any()
    assert not root(np.zeros((2, 2))).any()
    assert moment_factor(np.array([3.0, 4.0]), np.zeros((2, 2))).tolist() == [[3.0, 0.0, 0.0], [4.0, 0.0, 0.0]]


def test_a_variance_or_weight_that_rounding_made_negative_counts_as_zero():
    L = root(np.diag([4.0, -1e-18]))
    assert (L @ L.T).tolist() == [[4.0, 0.0], [0.0, 0.0]]
    assert seen(np.eye(2), np.diag([1.0, -1e-18])).tolist() == [True, False]


def test_what_does_not_fit_into_memory_is_refused_with_its_size():
    with pytest.raises(
        MemoryError, match=r"moment maps of 300 states, 45150 by 45150 for each mode, .* 1.3e\+11 bytes"
    ):
        moment_maps(np.broadcast_to(np.eye(300), (2, 300, 300)))
    with pytest.raises(MemoryError, match=r"the Kronecker products of 300 states, 90000 by 90000, .* 1.94e\+11 bytes"):
        closed_form_w2(np.eye(300)[None], np.array([0]), np.eye(300))


def test_another_grouping_of_a_sum_rounds_otherwise():
    A, Q = nearly_parallel(1e-6)
    G, H = horizon_gramians(A, Q, 63), regrouped_gramians(A, Q, 64)
    assert np.abs(G - H).max() > 0.1 * np.abs(G).max()
    np.testing.assert_allclose(regrouped_gramians(np.array([[0.5]]), np.array([[3.0]]), 10**6), 4.0, rtol=1e-14)


def test_w2_counts_the_states_of_the_plant():
    A = np.array([[[0.5, 1.0], [0.0, 2.0]], [[1.0, 0.0], [1.0, 0.5]]])
    S = np.array([[1.0, 0.5], [0.5, 1.0]])
    np.testing.assert_allclose(constant_w2(A, S, 3, 1), [[1.0, 1.75, 6.9375], [1.0, 1.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(constant_w2(A, S, 2), [[2.0, 5.75], [2.0, 2.75]], rtol=1e-14)
    assert closed_form_w2(A, np.array([0]), S) == 5.75
    assert closed_form_w2(A, np.array([0, 1]), S) == pytest.approx(np.trace(A[1] @ A[0] @ S @ A[0].T @ A[1].T))


@pytest.mark.parametrize("steps", range(1, 18))
def test_a_block_is_its_steps_one_by_one(steps):
    A, Q, W = (
        np.array([[[0.5, 1.0], [0.0, -0.75]]]),
        np.array([[[2.0, 0.5], [0.5, 1.0]]]),
        np.array([[[1.0, 0.0], [0.0, 3.0]]]),
    )
    S, cost = np.array([[2.0, -0.5], [-0.5, 1.0]]), 0.0
    block = affine_gramians(A, Q, W, np.array([0.25]), 0.5, steps)
    begin = S
    for k in range(steps):
        cost += 0.5**k * (np.vdot(Q, S) + 0.25)
        S = A[0] @ S @ A[0].T + W[0]
    assert np.vdot(block.G, begin) + block.constant[0] == pytest.approx(cost, rel=1e-14)
    np.testing.assert_allclose(block.A[0] @ begin @ block.A[0].T + block.W[0], 0.5**steps * S, rtol=1e-13)
    plain = sum(np.linalg.matrix_power(A[0], k).T @ Q[0] @ np.linalg.matrix_power(A[0], k) for k in range(steps))
    np.testing.assert_allclose(horizon_gramians(A, Q, steps - 1)[0], plain, rtol=1e-14)


def test_what_the_cost_sees():
    A = np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -1.0, 0.5]])
    assert seen(A, np.diag([1.0, 0.0, 0.0])).tolist() == [True, False, False]
    assert seen(A, np.diag([0.0, 1.0, 0.0])).tolist() == [False, True, False]
    assert seen(A, np.diag([0.0, 0.0, 1.0])).tolist() == [False, True, True]
    assert not seen(A, np.zeros((3, 3))).any()
    shift = np.diag(np.ones(5), 1)
    for first in range(6):
        weight = np.zeros((6, 6))
        weight[first, first] = 1.0
        assert seen(shift, weight).tolist() == [False] * first + [True] * (6 - first)


def nearly_parallel(angle, scale=1.0):
    """A mode whose directions are so near that rounding in it makes its cost doubtful."""
    basis = np.linalg.qr(np.random.default_rng(8).standard_normal((2, 2)))[0]
    directions = basis @ [[1.0, 1.0], [0.0, angle]]
    return directions @ np.diag([0.9, 0.5]) @ np.linalg.inv(directions), scale * np.eye(2)


def refused(angle, scale=1.0):
    try:
        tail(*nearly_parallel(angle, scale))
    except np.linalg.LinAlgError as error:
        assert "cannot be computed" in str(error)
        return True
    return False


def test_a_cost_is_trusted_up_to_an_error_of_one_percent():
    assert [refused(angle) for angle in (1e-2, 2e-3, 7e-4, 1e-4, 2e-5)] == [False, False, True, True, True]


@pytest.mark.parametrize("scale", [2.0**-600, 2.0**-850, 2.0**400, 2.0**540])
def test_a_cost_is_trusted_whatever_its_unit(scale):
    for angle in (1e-2, 2e-3, 7e-4, 1e-4):
        assert refused(angle, scale) == refused(angle)
    A, Q = nearly_parallel(2e-3)
    assert (tail(A, scale * Q) == scale * tail(A, Q)).all()


@pytest.mark.parametrize("A", [[[0.5, 1e200], [0.0, 0.5]], [[0.1, 1e200], [1e-210, 0.0]], [[0.9, 1e155], [0.0, 0.5]]])
def test_a_cost_beyond_the_floating_point_range_is_an_error(A):
    with pytest.raises(np.linalg.LinAlgError, match="cannot be computed"):
        tail(np.array(A), np.eye(2))
    with pytest.raises(np.linalg.LinAlgError, match="cannot be computed"):
        tail(np.array([[0.5, 1e5], [0.0, 0.5]]), 1e308 * np.eye(2))


def test_the_order_of_a_word():
    A = np.array([[[0.0, 2.0], [0.0, 0.0]], [[0.5, 0.0], [0.25, 0.0]]])
    Q = np.array([np.eye(2), 3 * np.eye(2)])
    assert word_tail(A, Q, (0,)).tolist() == [[1.0, 0.0], [0.0, 5.0]]
    for word in ((0, 1), (1, 0), (1, 1, 0)):
        cost, power = np.zeros((2, 2)), np.eye(2)
        for k in range(300):
            cost += power.T @ Q[word[k % len(word)]] @ power
            power = A[word[k % len(word)]] @ power
        np.testing.assert_allclose(word_tail(A, Q, word), cost, rtol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_words_of_states_that_only_some_of_their_steps_show(sign):
    A = np.array(
        [
            [[0.5, sign * 1.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.5]],
            [[0.5, 0.0, 0.0], [0.0, 0.5, sign * 0.5], [0.0, 0.0, 0.25]],
            [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [1.0, 0.0, 3.0]],
        ]
    )
    Q = np.array([np.diag([1.0, 0.0, 0.0]), np.diag([1.0, 0.0, 0.0]), np.zeros((3, 3))])
    for word in ((0,), (2,), (0, 1), (1, 0), (0, 1, 1), (1, 0, 0), (0, 2), (2, 0), (0, 2, 2), (2, 2, 0)):
        P, cost, power = word_tail(A, Q, word), np.zeros((3, 3)), np.eye(3)
        for k in range(600):
            cost += power.T @ Q[word[k % len(word)]] @ power
            power = A[word[k % len(word)]] @ power
        np.testing.assert_allclose(P, cost, rtol=1e-12)
