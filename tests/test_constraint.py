"""The stability constraint of the receding horizon: lengthened holds, disturbances, limits."""

import numpy as np
import pytest
from random_cases import random_gaussian, random_modes

from switchctl import (
    Gaussian,
    ModeSet,
    RecedingHorizon,
    schedule,
)


def test_a_hold_is_lengthened_until_a_mode_meets_the_constraint():
    modes = ModeSet([[[0.9, 10.0], [0.0, 0.9]]])
    result = schedule(modes, Gaussian([1.0, 1.0], np.zeros((2, 2))), RecedingHorizon(5, hold=2, decrease=0.5))
    (first, added), *_ = result.lengthened
    w2 = result.w2
    assert first == 0
    assert w2[2 + added] <= 0.5 * w2[0] < w2[1 + added]
    assert "1 hold, for stability, at step 0" in repr(result)
    unconstrained = schedule(modes, Gaussian([1.0, 1.0], np.zeros((2, 2))), RecedingHorizon(5, hold=2))
    assert unconstrained.lengthened == ()


def test_a_disturbance_begins_the_constraint_anew():
    modes = ModeSet([[[0.999, 0.1], [0.0, 0.9]], [[0.99, 0.0], [0.0, 0.995]]])
    method = RecedingHorizon(20, decrease=0.1)
    fresh = method.start(modes)
    for past in ([[0.0, 0.0], [0.0, 0.0]], [[1e-200, 0.0]] * 3, [[1e-3, 1e-3]]):
        scheduler = method.start(modes)
        for x in past:
            scheduler.step(x)
            for _ in range(scheduler.lengthened):
                scheduler.step(x)
        assert scheduler.step([1.0, 1.0]) == fresh.step([1.0, 1.0])
        assert scheduler.lengthened == fresh.lengthened > 0
        fresh.reset()


def test_a_constraint_on_moments_that_underflow_ends():
    modes = ModeSet([[[0.5, 1.0], [0.0, 0.5]], [[0.99, 0.0], [0.0, 0.9]]])
    result = schedule(modes, Gaussian([1.0, 1.0], np.eye(2)), RecedingHorizon(5, decrease=0.5), steps=2000)
    assert result.w2[-1] == 0.0


def test_rounding_never_decides_a_constraint_that_just_binds():
    def turn(angle):
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    rng = np.random.default_rng(5)
    for _ in range(100):
        r, angle = rng.uniform(0.7, 0.95), rng.uniform(0, 3)
        modes, x0 = ModeSet([r * turn(angle), r * turn(-2 * angle)]), random_gaussian(rng, 2)
        method = RecedingHorizon(3, decrease=1 - r**4)
        result = schedule(modes, x0, method, steps=20)
        scheduler = method.start(modes)
        assert result.lengthened[:1] in ((), ((0, 1),))
        online = [scheduler.step(result.mean[:, k], result.cov[k]) for k in range(20)]
        assert online == result.sequence.tolist()


def test_a_hold_that_would_take_for_ever_is_an_error():
    scheduler = RecedingHorizon(10, decrease=0.5).start(ModeSet([np.diag([1 - 1e-7, 0.5])]))
    with pytest.raises(ValueError, match="no mode meets the constraint within 100000 steps"):
        scheduler.step([1.0, 0.0])


@pytest.mark.parametrize(("measured", "added"), [(0.24, 0), (0.3, 1), (0.9, 1)])
def test_what_counts_as_a_disturbance(measured, added):
    """The held mode makes at most 0.25 of W2 = 1: up to there the bound is 0.1, beyond it 0.1 of what was measured."""
    scheduler = RecedingHorizon(5, decrease=0.9).start(ModeSet([0.5 * np.eye(2)]))
    scheduler.step([1.0, 0.0])
    scheduler.step([0.5, 0.0])  # the first hold was lengthened by a step
    assert scheduler.lengthened == 0
    scheduler.reset()
    scheduler.step([1.0, 0.0])
    scheduler.last_w2, scheduler.growth, scheduler.plan = 1.0, 0.25 * (1 + 1e-9), []
    scheduler.step([np.sqrt(measured), 0.0])
    assert scheduler.lengthened == added


def test_growth_is_that_of_the_held_mode_over_its_hold():
    scheduler = RecedingHorizon(5, hold=2, decrease=0.9).start(ModeSet([0.5 * np.eye(2)]))
    scheduler.step([3.0, 4.0])
    assert (scheduler.lengthened, scheduler.last_w2) == (0, 25.0)
    assert scheduler.growth == pytest.approx(0.5**4)
    longer = RecedingHorizon(5, hold=1, decrease=0.9).start(ModeSet([0.5 * np.eye(2)]))
    longer.step([3.0, 4.0])
    assert longer.lengthened == 1
    assert longer.growth == pytest.approx(0.5**4)


def test_w2_falls_over_every_two_updates():
    rng = np.random.default_rng(6)
    for _ in range(20):
        modes, x0 = ModeSet(random_modes(rng, 3, 2)), random_gaussian(rng, 3)
        result = schedule(modes, x0, RecedingHorizon(4, hold=2, decrease=0.5), steps=60)
        added, updates = dict(result.lengthened), [0]
        while updates[-1] + 2 + added.get(updates[-1], 0) < 60:
            updates.append(updates[-1] + 2 + added.get(updates[-1], 0))
        w2 = result.w2[updates]
        assert (w2[1:] <= 0.5 * np.concatenate([w2[:1], w2[:-2]]) * (1 + 1e-9)).all()
