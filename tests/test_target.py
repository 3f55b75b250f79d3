"""Gaussian targets: against the Bures-Wasserstein distance written out, and every plan of a horizon."""

import numpy as np
import pytest
from random_cases import random_gaussian, random_modes
from scipy.linalg import sqrtm

from switchctl import (
    Constant,
    FewSwitches,
    Gaussian,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Schedule,
    schedule,
)


def squared_distance(mean, cov, target):
    root = sqrtm(target.cov)
    bures = np.trace(cov + target.cov - 2 * sqrtm(root @ cov @ root).real)
    return np.sum((mean - target.mean) ** 2) + bures


def distances(modes, x0, sequence, target):
    mean, cov, found = x0.mean, x0.cov, []
    for mode in [*sequence, 0]:
        found.append(squared_distance(mean, cov, target))
        mean, cov = modes.A[mode] @ mean, modes.A[mode] @ cov @ modes.A[mode].T + modes.W[mode]
    return np.array(found)


def case(seed):
    rng = np.random.default_rng(seed)
    noise = 0.3 * rng.standard_normal((3, 2, 2))
    modes = ModeSet(random_modes(rng, 2, 3), W=noise @ np.swapaxes(noise, 1, 2), dt=0.1)
    return rng, modes, random_gaussian(rng, 2), random_gaussian(rng, 2)


def test_w2_is_the_distance_to_the_target():
    for seed in range(10):
        rng, modes, x0, target = case(seed)
        sequence = rng.integers(0, 3, 12).tolist()
        found, expected = Schedule(modes, x0, sequence, target=target), distances(modes, x0, sequence, target)
        np.testing.assert_allclose(found.w2, expected[:-1], rtol=1e-7)
        assert found.final_w2 == pytest.approx(expected[-1], rel=1e-7)
        assert found.cost == pytest.approx(0.1 * expected.sum(), rel=1e-7)
        assert found.tail == ()


def test_the_receding_horizon_takes_the_plan_that_stays_nearest():
    for seed in range(15):
        rng, modes, x0, target = case(seed)
        T = int(rng.integers(1, 6))
        first = [distances(modes, x0, [i] * T, target)[: T + 1].sum() for i in range(3)]
        found = schedule(modes, x0, RecedingHorizon(T), 6, target=target)
        assert found.sequence[0] == np.argmin(first)
        assert schedule(modes, x0, PointwiseMinimum(), 6, target=target).sequence.tolist() == (
            schedule(modes, x0, RecedingHorizon(1), 6, target=target).sequence.tolist()
        )
        dwelling = schedule(modes, x0, RecedingHorizon(T), 9, Rules(min_dwell=3), target=target)
        assert min(dwelling.dwell_times[:-1], default=3) >= 3
        assert schedule(modes, x0, Constant(2), 4, target=target).sequence.tolist() == [2] * 4


def test_noise_is_steered_to_the_covariance_that_is_wanted():
    """Two modes of different stationary covariance: the one nearer to the target is taken."""
    modes = ModeSet([0.9 * np.eye(2), 0.5 * np.eye(2)], W=0.19 * np.eye(2), names=["wide", "narrow"])
    x0 = Gaussian([0.0, 0.0], 0.5 * np.eye(2))
    for variance, mode in ((1.0, 0), (0.19 / 0.75, 1)):
        found = schedule(modes, x0, RecedingHorizon(5), 40, target=Gaussian([0, 0], variance * np.eye(2)))
        assert (found.sequence[-10:] == mode).all()
        assert found.final_w2 < 1e-3


def test_saving(tmp_path):
    _, modes, x0, target = case(0)
    found = schedule(modes, x0, RecedingHorizon(3), 8, target=target)
    again = Schedule.load(found.save(tmp_path / "s.json"))
    np.testing.assert_array_equal(again.w2, found.w2)
    assert again.cost == found.cost
    assert "distance to the target" in repr(found)
    assert found.plot() is not None


MODES, X0, TARGET = case(1)[1:]


@pytest.mark.parametrize(
    ("method", "keywords", "error", "words"),
    [
        (Rollout(), {}, ValueError, r"cost="),
        (Refine(RecedingHorizon(2)), {"target": TARGET}, ValueError, r"x0.about\(target.mean\)"),
        (FewSwitches(1), {"target": TARGET}, ValueError, "linear in the second moment"),
        (Optimal(), {"target": TARGET}, ValueError, "linear in the second moment"),
        (RecedingHorizon(np.inf), {"target": TARGET}, ValueError, "finite"),
        (RecedingHorizon(2, decrease=0.1), {"target": TARGET}, ValueError, "decrease"),
        (RecedingHorizon(2), {"target": [0.0, 0.0]}, TypeError, r"x0.about\(point\)"),
        (RecedingHorizon(2), {"target": Gaussian([0.0], [[1.0]])}, ValueError, r"shape \(1,\)"),
        (RecedingHorizon(2), {"target": TARGET, "steps": None}, ValueError, "say when, steps=N"),
        (RecedingHorizon(2), {"target": TARGET, "terminal": np.eye(2)}, ValueError, "terminal"),
    ],
)
def test_wrong_input(method, keywords, error, words):
    with pytest.raises(error, match=words):
        schedule(MODES, X0, method, **{"steps": 5} | keywords)


def test_methods_that_need_linear_costs_say_so():
    plain = ModeSet(MODES.A)
    for method in (Rollout(), Refine(), FewSwitches(1), Optimal()):
        with pytest.raises(ValueError, match=r"linear in the second moment.*x0\.about"):
            schedule(plain, X0, method, 5, target=TARGET)


def test_about():
    shifted = X0.about([1.0, 2.0])
    np.testing.assert_array_equal(shifted.mean, X0.mean - [1.0, 2.0])
    np.testing.assert_array_equal(shifted.cov, X0.cov)
    with pytest.raises(ValueError, match="point has shape"):
        X0.about([1.0])
