"""The kernel's verdict whether a mode is Schur: poles near the circle, near each other, and moved by rounding."""

import mpmath
import numpy as np
import pytest
from accuracy_cases import jordan, rotated, rotation
from fixed_point import exact_tail
from scipy.linalg import expm

from switchctl.schur import _some_beyond, along, is_schur, majorant, rounded_sizes, scaled_norm


def test_how_near_to_one_a_radius_counts_as_one():
    for sign in (1, -1):
        assert is_schur(np.array([[sign * (1 - 1.1e-14)]])) and not is_schur(np.array([[sign * (1 - 0.9e-14)]]))
        assert is_schur(*[np.array([[sign * (1 - 1.1e-14)]])] * 5)
        assert not is_schur(*[np.array([[sign * (1 - 0.9e-14)]])] * 5)
        turned = sign * np.array([[0.6, -0.8], [0.8, 0.6]])  # of radius 1
        assert is_schur((1 - 1e-11) * turned) and not is_schur((1 + 1e-11) * turned) and not is_schur(turned)


def carts(count, stiffness, damping, dt):
    """Carts in a row with springs between: the whole coasts, which is a double pole at 1."""
    chain = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    chain[0, 0] = chain[-1, -1] = 1.0
    rates = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness * chain, -damping * chain]])
    return expm(dt * rates)


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize(("stiffness", "damping"), [(1.0, 0.0), (1.0, 0.1), (1.0, 5.0), (100.0, 0.0), (100.0, 0.1)])
@pytest.mark.parametrize("dt", [0.01, 0.1])
def test_a_body_that_coasts_is_not_schur_in_any_coordinates(count, stiffness, damping, dt):
    A = carts(count, stiffness, damping, dt)
    basis = np.linalg.qr(np.random.default_rng(count).standard_normal(A.shape))[0]
    assert not is_schur(A)
    assert not is_schur(basis @ A @ basis.T)
    assert is_schur(0.99 * A)


@pytest.mark.parametrize("poles", [[1.0] * 2, [-1.0] * 2, [1.0] * 3, [1.0, 1.0, -1.0, -1.0]])
def test_multiple_poles_in_companion_form(poles):
    poly = np.poly(poles)
    companion = np.vstack([-poly[1:], np.eye(len(poly) - 1)[:-1]])
    assert not is_schur(companion)
    assert is_schur(0.99 * companion)
    try:
        assert is_schur((1 - 1e-9) * companion)  # Schur, if barely: an error may say that rounding hides it
    except np.linalg.LinAlgError:
        pass


def test_a_verdict_of_parts():
    basis = np.linalg.qr(np.random.default_rng(8).standard_normal((5, 5)))[0]
    hidden = basis @ (np.diag(np.linspace(0.9, -0.9, 5)) + 1e4 * np.triu(np.ones((5, 5)), 1)) @ basis.T
    for pole, told in ((0.5, None), (1.5, False)):
        A = np.zeros((7, 7))
        A[:5, :5], A[5, 5], A[6, 6] = hidden, pole, -0.25
        if told is None:
            with pytest.raises(np.linalg.LinAlgError, match="undecided"):
                is_schur(A)
        else:
            assert is_schur(A) is told
    with pytest.raises(np.linalg.LinAlgError, match="undecided"):
        is_schur(hidden)


def turned(rng, n, condition, pole):
    """A mode with one pole at the unit circle, in coordinates of that condition."""
    there = rotation(rng, n) @ np.diag(np.geomspace(1, condition, n)) @ rotation(rng, n)
    return there @ np.diag(np.append(pole, rng.uniform(-0.9, 0.9, n - 1))) @ np.linalg.inv(there)


def verdict(A):
    try:
        return is_schur(A)
    except np.linalg.LinAlgError:
        return None


def test_rounding_in_the_product_of_a_word_counts():
    """Eigenvalues that rounding has moved over the circle, which the basis of its eigenvectors alone doesn't show."""
    wrong = 0
    for seed in (204, 304, 1326, 1372, 2150, 2898, 3004, 3258, 3860, 4344, 4384, 8868, 10104, 10736, 11400):
        rng = np.random.default_rng(seed)
        n, condition = int(rng.integers(2, 4)), 10 ** rng.uniform(1, 6)
        pole = 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-13, -6)
        A = turned(rng, n, condition, pole)
        schur = exact_tail([(A, np.eye(n))])[0] is not None
        assert verdict(A) in (None, schur)
        wrong += (np.abs(np.linalg.eigvals(A)).max() < 1) != schur
    assert wrong  # so some of these are hard


def test_discs_are_small_where_they_matter():
    told = [verdict(turned(np.random.default_rng(k), n, 1e5, 1 + 1e-7)) for n in (6, 9) for k in range(8)]
    assert True not in told and told.count(False) >= 10


def test_verdicts_where_eigenvectors_are_no_basis():
    A = np.array([[-0.5, -1.0, -1.0], [0.5, 0.5, 0.5], [-0.5, -0.5, -0.5]])  # poles -0.5, 0, 0 with two eigenvectors
    assert verdict(A) is True and verdict(4 * A) is not True


def in_units_far_apart(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A = rotated(rng, jordan(n, rng.choice([0.5, 0.9, 0.99, 0.999])))
    unit = np.exp2(rng.integers(-20, 21, n))
    return A * unit / unit[:, None]


def coupled(seed):
    """A rotated triangular mode with couplings from 1e-4 to 1e4, poles at 0.5, 0.9, 1 - 1e-6 and 1."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A = np.triu(rng.standard_normal((n, n))) * 10.0 ** rng.integers(-4, 5, (n, n))
    np.fill_diagonal(A, rng.choice([0.5, 0.9, 1.0, 0.999999], n))
    return rotated(rng, A)


def clustered(seed):
    """Two poles at 1 - 1e-13 .. 1e-3 or beyond 1 by as much, coupled, in ill-conditioned coordinates."""
    rng = np.random.default_rng(seed)
    n, pole = int(rng.integers(2, 5)), 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-13, -3)
    poles = np.diag(np.append([pole, pole], rng.uniform(-0.9, 0.9, n - 2)))
    poles[0, 1] = 10 ** rng.uniform(-6, 1)
    there = rotation(rng, n) @ np.diag(np.geomspace(1, 10 ** rng.uniform(0, 7), n)) @ rotation(rng, n)
    return there @ poles @ np.linalg.inv(there)


@pytest.mark.parametrize("family", [in_units_far_apart, coupled, clustered])
def test_no_verdict_is_wrong(family):
    hard = (71, 78, 182, 224, 229, 265, 323, 330, 338, 420, 421, 610, 629, 762)  # where less care errs, of `coupled`
    told = []
    for seed in (*range(60), *(hard if family is coupled else ())):
        A = family(seed)
        told.append(verdict(A))
        if told[-1] is not None:
            schur = exact_tail([(A, np.eye(len(A)))])[0] is not None
            assert told[-1] == schur or (schur and exact_radius(A) > 1 - 1e-12), seed
    assert told.count(None) < 0.8 * len(told)


def exact_radius(A):
    with mpmath.workdps(60):
        return max(abs(x) for x in mpmath.eig(mpmath.matrix(A.tolist()), left=False, right=False))


def test_verdicts_that_are_within_reach():
    assert [verdict(in_units_far_apart(seed)) for seed in (30, 42, 147)] == [True] * 3  # by units that fit the states
    assert not is_schur(np.array([[-1.0, -1.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [1.0, 1.0]]))  # radius of a disc: 0


def test_what_rounding_may_add_to_a_mean_of_eigenvalues():
    """A product of steps is known up to what rounding may have done to it, which counts twice."""
    step, identity = np.array([[1.0, 2e6], [0.0, 1.0]]), np.eye(2)  # 2 * 2 EPS * 2e6 is 1.78e-9
    assert not _some_beyond([step], (1 + 1.7e-9) * identity) and _some_beyond([step], (1 + 1.9e-9) * identity)
    there, back = np.array([[1.0, 1e6], [0.0, 1.0]]), np.array([[1.0, -1e6], [0.0, 1.0]])
    steps = [there, back]
    assert not _some_beyond(steps, (1 + 3.4e-9) * identity) and _some_beyond(steps, (1 + 3.8e-9) * identity)


def test_how_great_the_terms_are_that_rounding_acts_on():
    steps = [np.array([[2.0, -1.0], [0.0, 3.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])]
    worth = along(steps, [np.eye(2)] * 2, np.eye(2))
    assert [P.tolist() for P in worth[1:]] == [[[3, 1], [1, 2]], [[13, 0], [0, 16]]]
    first, whole = rounded_sizes(steps, [np.eye(2)] * 2, worth)
    assert first.tolist() == [[26, 0], [0, 44]] and whole.tolist() == [[50, -12], [-12, 86]]


def test_a_majorant_is_shown_or_there_is_none():
    one = np.eye(1)
    for M, shown in ((1 - 2.0**-49, True), (1 - 2.0**-50, True), (1 - 2.0**-52, False), (1.0, False), (1.5, False)):
        Z = majorant([M * one], M * one, one, one)
        assert Z == pytest.approx(1 / (1 - M**2), rel=1e-4) if shown else Z is None
    M = 1 - 2.0**-50  # the same after two steps more, that change nothing but add their rounding
    assert majorant([M * one, one, one], M * one, one, one) is None


def test_the_norm_in_units_of_the_states():
    units = np.diag([4.0, 0.0, 9.0])
    assert scaled_norm(np.array([[4.0, 0.0, 6.0], [0.0, 0.0, 0.0], [0.0, 0.0, 9.0]]), units) == pytest.approx(
        np.linalg.norm([[1.0, 1.0], [0.0, 1.0]], 2)
    )
    assert scaled_norm(np.diag([np.inf, 0.0, 1.0]), units) == np.inf
    assert scaled_norm(np.eye(2), np.diag([np.nan, 1.0])) == np.inf
