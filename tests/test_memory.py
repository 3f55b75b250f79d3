"""What a running scheduler remembers, as numbers: restored, it decides as if nothing had come between."""

import math

import numpy as np
import pytest
from random_cases import random_gaussian, random_modes
from test_methods import METHODS

from switchctl import (
    Constant,
    FewSwitches,
    ModeSet,
    Optimal,
    PointwiseMinimum,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    Scheduler,
    SwitchingGraph,
)

RULES = [
    None,
    Rules(min_dwell=3, switch_cost=0.1),
    Rules(max_dwell=4, min_dwell=2, start=("A1", 1)),
    Rules(max_switches=5),
]
MANY = [*METHODS, RecedingHorizon(5, hold=6), RecedingHorizon(4, hold=3, decrease=0.6), Refine(RecedingHorizon(3))]


def cases(seed):
    rng = np.random.default_rng(seed)
    for method in MANY:
        for rules in RULES:
            A = random_modes(rng, 3, 3, (0.4, 0.9))
            E = np.tile(np.eye(3), (3, 3, 1, 1))
            if rng.random() < 0.5:
                E[0, 1, 2] = E[2, 1, 2] = 0.0
            modes = ModeSet(A, activation=E, plant_states=int(rng.integers(2, 4)))
            x0 = random_gaussian(rng, 3)
            holding = isinstance(method, Constant | FewSwitches) or getattr(method, "decrease", None) is not None
            if not (holding and rules is not None and rules.max_dwell is not None):
                yield rng, method, method.start(SwitchingGraph(modes, rules)), x0


def moments(rng, x0, steps=14):
    """Moments that no prediction can have made: whatever is measured."""
    for k in range(steps):
        yield 0.7**k * (x0.mean + rng.standard_normal(3)), 0.7 ** (2 * k) * x0.cov


def test_a_memory_restored_decides_as_without_interruption():
    for rng, method, scheduler, x0 in cases(1):
        seen = list(moments(rng, x0))
        start = scheduler.memory
        assert not start.any(), method
        memories, decisions = [], []
        for mean, cov in seen:
            memories.append(scheduler.memory)
            decisions.append(scheduler.step(mean, cov))
        assert {len(memory) for memory in memories} == {len(start)}
        assert np.isfinite(memories).all()
        end, tail = scheduler.memory, scheduler.tail(x0.second_moment)
        for k in rng.permutation(len(seen)):
            scheduler.memory = memories[k]
            np.testing.assert_array_equal(scheduler.memory, memories[k])
            scheduler.step(*seen[rng.integers(len(seen))])  # something else meanwhile
            scheduler.memory = memories[k]
            rest = [scheduler.step(*moment) for moment in seen[k:]]
            assert rest == decisions[k:], (method, scheduler.graph.rules, k)
            np.testing.assert_array_equal(scheduler.memory, end)
        assert scheduler.tail(x0.second_moment) == tail


def test_a_memory_moves_to_another_scheduler():
    for rng, method, scheduler, x0 in cases(2):
        seen = list(moments(rng, x0))
        for moment in seen[:5]:
            scheduler.step(*moment)
        twin = method.start(scheduler.graph)
        twin.memory = scheduler.memory
        tails = [one.tail(x0.second_moment) for one in (scheduler, twin)]
        assert tails[0] == tails[1]
        assert [twin.step(*m) for m in seen[5:]] == [scheduler.step(*m) for m in seen[5:]]


def test_a_memory_is_a_copy(pair):
    scheduler = RecedingHorizon(4, hold=3).start(pair[0])
    scheduler.step([1.0, 1.0])
    memory = scheduler.memory
    memory[:] = 0.0
    assert scheduler.memory.any()
    assert len(memory) == 5


@pytest.mark.parametrize("method", [Optimal(gap=1e-2), Refine(), FewSwitches(1)])
def test_a_plan_is_made_once_for_each_first_moment(pair, method):
    scheduler = method.start(pair[0])
    searched, search = [], scheduler.search
    scheduler.search = lambda S: searched.append(S) or search(S)
    zero = scheduler.memory
    for mean in ([1.0, 1.0], [1.0, -2.0], [0.0, -0.0]) * 3:
        scheduler.memory = zero
        for _ in range(3):
            scheduler.step(mean)
            scheduler.memory = scheduler.memory
    assert len(searched) == 3
    scheduler.reset()
    scheduler.step([1.0, 1.0])
    assert len(searched) == 4  # and what a search reports is there again
    for k in range(20):
        scheduler.memory = zero
        scheduler.step([1.0, k])
    assert len(scheduler.plans) <= 8


def test_a_plan_cut_short_is_no_memory(pair):
    scheduler = FewSwitches(1).start(pair[0])
    scheduler.step([1.0, 1.0])
    memory, search = scheduler.memory, scheduler.search
    scheduler.reset()

    def interrupted(S):
        scheduler.interrupted = True
        return (), (0,)

    scheduler.search = interrupted
    with pytest.raises(KeyboardInterrupt):
        scheduler.memory = memory
    scheduler.reset()
    with pytest.raises(KeyboardInterrupt):
        scheduler.step([1.0, 1.0])
    scheduler.search = search
    scheduler.memory = memory
    assert scheduler.plan != ((), (0,))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.0], r"memory has shape \(1,\); expected \(3,\)"),
        ([0.0, math.nan, 0.0], r"memory\[1\] is nan"),
        ([0.5, 0.0, 0.0], r"memory\[0\] is 0.5; expected a whole number"),
        ([-1.0, 0.0, 0.0], r"memory\[0\] is -1.0; expected at least 0"),
        ([1.0, 0.0, 0.0], "expected a node below 1 and a mode, counted from 1, up to 2"),
        ([0.0, 3.0, 0.0], "expected a node below 1"),
    ],
)
def test_wrong_memory(pair, values, words):
    scheduler = PointwiseMinimum().start(pair[0])
    with pytest.raises(ValueError, match=words):
        scheduler.memory = values
    assert not scheduler.memory.any()


def test_a_scheduler_of_ones_own_must_say_what_it_remembers(pair):
    class Silent(Scheduler):
        def forget(self):
            self.mode = None

        def decide(self, S):
            return 0

    with pytest.raises(TypeError, match="Silent has something to forget"):
        _ = Silent(pair[0]).memory

    class Telling(Silent):
        def remembered(self):
            return (0 if self.mode is None else self.mode + 1,)

        def recall(self, values):
            self.mode = int(values[0]) - 1 if values[0] else None

    assert not Telling(pair[0]).memory.any()
    assert len(Rollout().start(pair[0]).memory) == 2


def test_what_counts_as_a_disturbance_is_remembered_where_w2_leaves_states_out():
    method, compared = RecedingHorizon(4, decrease=0.8), 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        modes = ModeSet(random_modes(rng, 3, 2, (0.4, 0.9)), plant_states=1)
        kept, restored = method.start(modes), method.start(modes)
        for mean, cov in moments(rng, random_gaussian(rng, 3)):
            restored.memory = kept.memory
            assert restored.step(mean, cov) == kept.step(mean, cov)
            assert restored.lengthened == kept.lengthened
            np.testing.assert_array_equal(restored.memory, kept.memory)
            compared += kept.lengthened > 0
    assert compared > 20
