"""Gaussians and the distance between them."""

import numpy as np
import pytest
from random_cases import random_gaussian
from scipy.linalg import sqrtm

from switchctl import Gaussian, wasserstein


def textbook(a, b):
    """The usual formula for the squared distance."""
    root = sqrtm(a.cov)
    cross = sqrtm(root @ b.cov @ root).real
    return np.sum((a.mean - b.mean) ** 2) + np.trace(a.cov + b.cov - 2 * cross)


def test_distance_is_the_textbook_formula():
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 8):
        a, b = random_gaussian(rng, n), random_gaussian(rng, n)
        assert wasserstein(a, b) ** 2 == pytest.approx(textbook(a, b), rel=1e-9)


def test_distance_in_one_dimension_and_for_commuting_covariances():
    a, b = Gaussian([1.0, 2.0], np.diag([4.0, 9.0])), Gaussian([0.0, 0.0], np.diag([1.0, 0.0]))
    assert wasserstein(a, b) ** 2 == pytest.approx(1 + 4 + (2 - 1) ** 2 + 3**2)


def test_distance_is_a_metric_up_to_rounding():
    rng = np.random.default_rng(2)
    for _ in range(50):
        a, b, c = (random_gaussian(rng, 3) for _ in range(3))
        assert wasserstein(a, a) < 1e-13
        assert wasserstein(a, b) == pytest.approx(wasserstein(b, a), rel=1e-12)
        assert wasserstein(a, c) <= wasserstein(a, b) + wasserstein(b, c) + 1e-12


def test_distance_is_optimal_transport_between_samples():
    from scipy.optimize import linear_sum_assignment

    rng = np.random.default_rng(3)
    a, b = Gaussian([0.0, 0.0], np.eye(2)), Gaussian([3.0, 0.0], np.diag([4.0, 0.25]))
    x, y = (rng.multivariate_normal(g.mean, g.cov, 1000) for g in (a, b))
    costs = np.sum((x[:, None] - y[None]) ** 2, axis=-1)
    assert costs[linear_sum_assignment(costs)].mean() == pytest.approx(wasserstein(a, b) ** 2, rel=0.05)


def test_distance_loses_no_digits_for_close_or_singular_covariances():
    cov = np.diag([1.0, 1e-4, 0.0])
    for shift in (1e-3, 1e-6, 1e-9):
        other = np.diag([(1 + shift) ** 2, 1e-4, 0.0])
        assert wasserstein(Gaussian(np.zeros(3), cov), Gaussian(np.zeros(3), other)) == pytest.approx(shift, rel=1e-6)
    rank_one = Gaussian([0.0, 0.0], [[1.0, 1.0], [1.0, 1.0]])
    orthogonal = Gaussian([0.0, 0.0], [[1.0, -1.0], [-1.0, 1.0]])
    assert wasserstein(rank_one, orthogonal) == pytest.approx(2.0)


def test_distance_to_a_point_is_the_papers_special_case():
    rng = np.random.default_rng(4)
    a, target = random_gaussian(rng, 4), rng.standard_normal(4)
    dirac = Gaussian(target, np.zeros((4, 4)))
    assert wasserstein(a, dirac) ** 2 == pytest.approx(a.w2(target))
    assert a.w2() == pytest.approx(np.trace(a.second_moment))


def test_a_batch_is_its_members():
    rng = np.random.default_rng(5)
    members = [random_gaussian(rng, 3) for _ in range(6)]
    batch = Gaussian(np.stack([g.mean for g in members]), np.stack([g.cov for g in members]))
    np.testing.assert_allclose(
        wasserstein(batch, members[0]), [wasserstein(g, members[0]) for g in members], atol=1e-12
    )
    np.testing.assert_allclose(batch.w2(), [g.w2() for g in members])
    np.testing.assert_allclose(batch.second_moment[2], members[2].second_moment)


def test_from_samples_is_numpys_mean_and_covariance():
    rng = np.random.default_rng(6)
    samples = rng.standard_normal((50, 3))
    fitted = Gaussian.from_samples(samples)
    np.testing.assert_allclose(fitted.mean, samples.mean(axis=0))
    np.testing.assert_allclose(fitted.cov, np.cov(samples.T), atol=1e-15)
    assert Gaussian.from_samples([[1.0], [3.0]]).cov == pytest.approx(2.0)


def test_a_gaussian_is_immutable_and_copies_its_input():
    mean, cov = np.zeros(2), np.eye(2)
    gaussian = Gaussian(mean, cov)
    mean[0] = cov[0, 0] = 9.0
    assert gaussian.mean[0] == 0.0
    assert gaussian.cov[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        gaussian.mean[0] = 1.0
    with pytest.raises(AttributeError):
        gaussian.mean = mean


@pytest.mark.parametrize(
    ("mean", "cov", "error", "words"),
    [
        ([0, np.nan], np.eye(2), ValueError, r"mean\[1\] is nan"),
        ([0, 0], [[1, 0], [0, np.inf]], ValueError, r"cov\[1, 1\] is inf"),
        ([0, 0], [[1, 0.5], [0, 1]], ValueError, "not symmetric"),
        ([0, 0], [[1, 2], [2, 1]], ValueError, "least eigenvalue is -1"),
        ([0, 0], np.eye(3), ValueError, r"shape \(2,\) and cov has shape \(3, 3\)"),
        ([], np.eye(0), ValueError, "shape"),
        (0.0, 1.0, ValueError, "shape"),
        ([0, 1j], np.eye(2), TypeError, "real numbers"),
        (["a", "b"], np.eye(2), TypeError, "real numbers"),
        (np.ma.masked_array([0.0, 1.0], [True, False]), np.eye(2), TypeError, "masked"),
        ([0, [1, 2]], np.eye(2), ValueError, "rectangular"),
    ],
)
def test_wrong_input(mean, cov, error, words):
    with pytest.raises(error, match=words):
        Gaussian(mean, cov)


def test_wrong_arguments_of_the_distance():
    with pytest.raises(TypeError, match="two Gaussians; got a list"):
        wasserstein(Gaussian([0.0], [[1.0]]), [0.0])
    with pytest.raises(ValueError, match="dimension 1 and b has 2"):
        wasserstein(Gaussian([0.0], [[1.0]]), Gaussian([0.0, 0.0], np.eye(2)))
    with pytest.raises(ValueError, match="at least two"):
        Gaussian.from_samples([[1.0, 2.0]])


def test_rounding_is_symmetrised_and_more_is_refused():
    cov = np.array([[1.0, 0.5], [0.5 * (1 + 1e-15), 1.0]])
    assert (Gaussian([0.0, 0.0], cov).cov == Gaussian([0.0, 0.0], cov).cov.T).all()
    for scale in (1e-12, 1.0, 1e12):
        assert Gaussian([0.0, 0.0], scale * np.array([[1.0, 1.0], [1.0, 1.0 - 1e-15]])).cov.shape == (2, 2)
        with pytest.raises(ValueError, match="not symmetric"):
            Gaussian([0.0, 0.0], scale * np.array([[1.0, 0.5], [0.5 + 1e-7, 1.0]]))
        with pytest.raises(ValueError, match="not positive semidefinite"):
            Gaussian([0.0, 0.0], scale * np.diag([1.0, -1e-7]))


def test_arrays_of_a_gaussian_are_read_only():
    gaussian = Gaussian([0.0], [[1.0]])
    for array in (gaussian.mean, gaussian.cov):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 2.0
    with pytest.raises(ValueError, match=r"target\[0\] is nan"):
        gaussian.w2([np.nan])


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_covariances_that_underflow_are_not_refused(n):
    """Down to the last bits rounding is as great as the entries, and makes an eigenvalue of theirs negative."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        A = rng.standard_normal((n, n))
        A *= 0.3 / np.abs(np.linalg.eigvals(A)).max()
        cov = np.eye(n)
        for _ in range(400):
            cov = A @ cov @ A.T
            Gaussian(np.zeros(n), cov)


def test_covariances_of_low_rank_beside_states_without_variance_are_taken():
    """The least eigenvalue is rounding, and its eigenvector any in the null space."""
    rng = np.random.default_rng(0)
    for _ in range(2000):
        known, rank, none = rng.integers(1, 5), rng.integers(1, 3), rng.integers(1, 3)
        F = np.concatenate(
            [rng.standard_normal((known, rank)) * 10.0 ** rng.integers(-150, 150), np.zeros((none, rank))]
        )
        F = F[rng.permutation(len(F))]
        Gaussian(np.zeros(len(F)), F @ F.T)
    for a in range(1, 40):
        for b in range(1, 40):
            Gaussian(np.zeros(3), np.outer([a / 10, 0.0, b / 10], [a / 10, 0.0, b / 10]))


@pytest.mark.parametrize("least", [1.0, 1e-300, 1e-310, 1e-320])
def test_however_small_an_indefinite_covariance_is_refused(least):
    for cov in ([[-least]], np.diag([1.0, -least]), [[least, 2 * least], [2 * least, least]]):
        with pytest.raises(ValueError, match="cov is not positive semidefinite: its least eigenvalue is -"):
            Gaussian(np.zeros(len(cov)), cov)
    with pytest.raises(ValueError, match="cov is not symmetric"):
        Gaussian([0.0, 0.0], [[least, least / 2], [0.0, least]])
