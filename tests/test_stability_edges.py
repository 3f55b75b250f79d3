"""Verdicts of stability at the edges of what floats can hold: right, or undecided with a reason."""

import warnings
from fractions import Fraction

import numpy as np
import pytest

from switchctl import Constant, Gaussian, ModeSet, PointwiseMinimum, RecedingHorizon, Refine, Rollout, schedule
from switchctl.certificates import certify
from switchctl.stability import (
    average_dwell_time,
    does_switching_help,
    joint_spectral_radius,
    minimum_dwell_time,
    mode_dependent_dwell_times,
    policy_stability,
    random_stability,
    schur_stability,
    stabilising_word,
    word_stability,
)
from switchctl.stability.branching import Cycle, branch
from switchctl.stability.falling import spread
from switchctl.stability.moves import Moves, exactly, power

A = np.array([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.2, 0.8]]])
BIG = [[[0.5, 1e30], [0, 0.5]], [[0.5, 0], [1e-3, 0.6]]]
UNITS = [1e40, 1e-80, 1e150, 1e-150, 1e200]
RADII = {  # modes, and their spectral radii
    "subnormal": ([[[1e-310, 0], [0, 5e-324]]], [1e-310]),
    "smallest": ([[[5e-324]]], [5e-324]),
    "small": ([[[1e-300]], [[1e-160]]], [1e-300, 1e-160]),
    "great": ([[[1e300]], [[-1e160]]], [1e300, 1e160]),
    "zero": (np.zeros((2, 3, 3)), [0, 0]),
    "nilpotent": ([np.eye(3, k=1)], [0]),
    "marginal": ([np.eye(2)], [1]),
    "turning": ([[[0, 1], [-1, 0]]], [1]),
    "just below one": ([[[1 - 1e-9]]], [1 - 1e-9]),
    "as near to one as floats": ([[[1 - 2**-53]], [[1 + 2**-52]]], [1 - 2**-53, 1 + 2**-52]),
    "defective": ([[[0.9999, 1.0], [0, 0.9999]]], [0.9999]),
    "marginal and defective": ([[[1.0, 1.0], [0, 1.0]]], [1]),
    "a great transient": ([[[0.5, 1e200], [0, 0.25]]], [0.5]),
}


def in_units(unit):
    units = np.array([1.0, unit])
    return ModeSet(A * units[:, None] / units)


@pytest.mark.parametrize("name", RADII)
def test_bounds_hold_the_radius(name):
    matrices, radii = RADII[name]
    for rate, radius in zip(schur_stability(ModeSet(matrices)), radii, strict=True):
        assert rate.lower <= radius <= rate.upper
        assert rate.verdict in ("undecided", "stable" if radius < 1 else "unstable")
        assert np.isfinite(rate.P).all() and np.isfinite(rate.H).all()
        certify(rate).check()
    assert joint_spectral_radius(ModeSet(matrices), 1e-2, 0.1).upper >= max(radii)


def test_growth_of_steps_that_differ_in_size():
    word = word_stability(ModeSet([[[1e150]], [[1e-155]]]), [0, 1])
    assert word.lower <= np.sqrt(1e-5) <= word.upper
    rate = random_stability(ModeSet([[[0.0]], [[0.5]]]), [1.0, 1e-320])
    assert rate.lower <= 0.5 * np.sqrt(1e-320) <= rate.upper


@pytest.mark.parametrize("unit", UNITS)
def test_units_of_states_change_no_verdict(unit):
    modes, plain = in_units(unit), ModeSet(A)
    for found, wanted in zip(schur_stability(modes), schur_stability(plain), strict=True):
        assert (found.verdict, found.upper) == (wanted.verdict, pytest.approx(wanted.upper, rel=1e-9))
    assert word_stability(modes, [0, 1]).lower == pytest.approx(word_stability(plain, [0, 1]).lower, rel=1e-9)
    assert random_stability(modes, [0.5, 0.5]).verdict == "unstable"
    assert stabilising_word(modes).word == (0,)
    growth = joint_spectral_radius(modes, 1e-2, 5)
    assert growth.verdict == "unstable" and growth.lower <= 1.2634 <= growth.upper


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("scale", [1.0, 1e-300, 1e100, 1e160])
def test_sizes_only_make_verdicts_undecided(unit, scale):
    modes = ModeSet(scale * in_units(unit).A if unit == 1e40 or scale == 1 else scale * A)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        help_ = does_switching_help(modes)
        assert help_.helps is not False or scale < 1
        for method in (Rollout(), PointwiseMinimum(), RecedingHorizon(np.inf), Refine(), Constant(0)):
            try:
                found = policy_stability(modes, method)
            except (ValueError, ArithmeticError) as refusal:
                assert str(refusal)
                continue
            assert found.why and (found.verdict != "unstable" or scale > 1)
            assert found.verdict != "stable" or scale <= 1
            assert found.constant is None or found.constant >= 1


def test_rounding_of_products_is_counted():
    """A nilpotent mode in other coordinates: its powers are rounding, and floats make it a mode of radius 1e-5."""
    Q = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    M = Q @ np.eye(3, k=1) @ Q.T
    F = [[Fraction(entry) for entry in row] for row in M.tolist()]
    minors = [F[i][i] * F[j][j] - F[i][j] * F[j][i] for i, j in ((0, 1), (0, 2), (1, 2))]
    crossed = [F[1][(j + 1) % 3] * F[2][(j + 2) % 3] - F[1][(j + 2) % 3] * F[2][(j + 1) % 3] for j in range(3)]
    determinant = sum(a * b for a, b in zip(F[0], crossed, strict=True))
    exact = [1.0, *map(float, (-F[0][0] - F[1][1] - F[2][2], sum(minors), -determinant))]
    radius = np.abs(np.roots(exact)).max()
    assert 1e-7 < radius < 1e-4
    found = joint_spectral_radius(ModeSet([M]), time_limit=0.3)
    assert found.lower <= radius <= found.upper
    (rate,) = schur_stability(ModeSet([M]))
    assert rate.lower <= radius <= rate.upper


def test_errors_of_powers_are_bounded():
    rng = np.random.default_rng(1)
    for count in (2, 7, 64):
        M = rng.normal(size=(4, 4)) / 2
        exact = np.linalg.matrix_power(M.astype(np.longdouble), count)
        rounded, wrong = power(exactly(M), count)
        assert (np.abs(rounded - exact) <= wrong).all() and (wrong < 1e-9 * np.abs(rounded).max()).all()


def test_a_deep_tree_takes_no_time_squared():
    moves = Moves.with_dwell(ModeSet([[[0.5, 1.0], [0, 0.5]]]), (1,))
    found = branch(moves, Cycle(0.5, ()), 1e-12, 0.0, 5000, np.inf)
    assert len(found.tree) == 5001 and found.upper >= 0.5


def test_dwell_times_of_great_transients():
    with pytest.raises(ValueError, match="every signal stable"):
        minimum_dwell_time(ModeSet([[[0.5, 1e300], [0, 0.5]], [[0.5, 0], [1e300, 0.6]]]), 0.2)
    modes = ModeSet([[[0.5, 1e3], [0, 0.5]], [[0.5, 0], [1e-3, 0.6]]])
    assert minimum_dwell_time(modes, 5).upper <= 5 and max(mode_dependent_dwell_times(modes, 5).dwell) <= 5


def test_zero_modes_have_a_stabilising_word():
    assert stabilising_word(ModeSet(np.zeros((2, 2, 2)))).word == (0,)
    assert stabilising_word(ModeSet([[[2.0, 0], [0, 0]], [[0, 0], [0, 2.0]]])).upper < 1e-19


def test_constants_of_badly_scaled_weights():
    assert 1e20 <= spread([np.diag([1.0, 1e20])], [np.diag([1.0, 1e20])]) <= 1.1e20
    unit = np.diag([1.0, 1e10])
    P = unit @ np.array([[1.0, 0.5], [0.5, 1.0]]) @ unit  # its least eigenvalue is 3/4, and hidden by rounding
    assert 1e20 / 0.75 <= spread([P], [P]) <= 4e20
    assert spread([np.full((2, 2), np.nan)], [np.eye(2)]) == np.inf


@pytest.mark.parametrize("n", [20, 26, 30])
def test_shifts_that_vanish_after_many_steps(n):
    found = joint_spectral_radius(ModeSet([np.eye(n, k=1), 2 * np.eye(n, k=1)]), time_limit=1)
    assert found.lower == 0 and 0 < found.upper <= 2 * (1 + 1e-9)


def test_one_mode_has_no_average_dwell_time_to_keep():
    A = np.eye(20, k=1)
    A[-1, -1] = 0.5
    assert average_dwell_time(ModeSet([A]), time_limit=0.3).upper == 0


def test_pairs_of_many_modes_keep_the_time_limit():
    turn = 0.95 * np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    found = does_switching_help(ModeSet([turn] * 60), time_limit=0.2)
    assert (found.helps, found.status, found.gain) == (None, "time limit", 1.0)
    assert "of 3540 pairs" in found.why


def test_costs_of_far_sizes_are_not_called_singular_weights():
    modes = ModeSet([np.eye(20, k=1), 2 * np.eye(20, k=1)])
    with pytest.raises(ValueError, match="costs of nearer sizes"):
        certify(schedule(modes, Gaussian(np.ones(20), np.zeros((20, 20))), Constant(0)))
