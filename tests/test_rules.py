"""Switching rules: what they accept, what they refuse and how they say so."""

import math
import pickle

import numpy as np
import pytest

from switchctl import Budget, ContradictionError, ModeSet, Rules, SwitchingGraph

MODES = ModeSet([[[0.5]], [[0.9]], [[0.7]]], names=["fast", "slow", "mid"], dt=0.01)


@pytest.mark.parametrize(
    ("told", "error", "words"),
    [
        ({"min_dwell": 0}, ValueError, "min_dwell is 0; expected at least 1"),
        ({"min_dwell": -3}, ValueError, "min_dwell is -3"),
        ({"min_dwell": 2.5}, ValueError, "min_dwell is 2.5; expected a whole number"),
        ({"min_dwell": "5"}, TypeError, "min_dwell must be a whole number, not '5'"),
        ({"min_dwell": True}, TypeError, "whole number"),
        ({"min_dwell": math.nan}, ValueError, "min_dwell is nan"),
        ({"min_dwell": math.inf}, ValueError, "whole number"),
        ({"min_dwell": {}}, ValueError, "min_dwell is empty"),
        ({"min_dwell": {"fast": 0}}, ValueError, r"min_dwell\['fast'\] is 0"),
        ({"min_dwell": [1, 2, -1]}, ValueError, r"min_dwell\[2\] is -1"),
        ({"min_dwell": {1.5: 3}}, ValueError, "the mode in min_dwell"),
        ({"min_dwell": 0.0, "time_unit": "s"}, ValueError, "min_dwell is 0.0 s; expected a positive"),
        ({"max_dwell": 0}, ValueError, "max_dwell is 0"),
        ({"min_dwell": 6, "max_dwell": 5}, ContradictionError, "min_dwell = 6 and max_dwell = 5 contradict"),
        ({"transitions": {}}, ValueError, "transitions is empty"),
        ({"transitions": {"fast": "slow"}}, TypeError, r"transitions\['fast'\] must be a list"),
        ({"transitions": 3}, ValueError, "transitions has shape"),
        ({"switch_cost": -1}, ValueError, "switch_cost is -1; expected a finite number, at least 0"),
        ({"switch_cost": math.inf}, ValueError, "switch_cost is inf"),
        ({"switch_cost": [[0, -1], [1, 0]]}, ValueError, "switch_cost has an entry -1"),
        ({"switch_cost_per_w2": math.nan}, ValueError, "switch_cost_per_w2"),
        ({"price": {"fast": -1}}, ValueError, r"price\['fast'\] is -1"),
        ({"max_switches": -1}, ValueError, "max_switches is -1"),
        ({"max_switches": 1.5}, ValueError, "max_switches is 1.5"),
        ({"budget": 3}, TypeError, "budget must be a Budget"),
        ({"budget": Budget(use=1, limit=2, window=2.5)}, ValueError, "window is 2.5; expected a whole number"),
        ({"start": "fast"}, TypeError, r"start must be a pair \(mode, age\), not 'fast'"),
        ({"start": ("fast", 0)}, ValueError, "the age in start is 0"),
        ({"start": ("fast", 1, 2)}, TypeError, "pair"),
        ({"allowed": [1]}, TypeError, "allowed must be a dict"),
        ({"allowed": {}}, ValueError, "allowed is empty"),
        ({"allowed": {"fast": [(3, 3)]}}, ValueError, "is empty"),
        ({"allowed": {"fast": [3]}}, TypeError, r"allowed\['fast'\] must be a list of intervals"),
        ({"allowed": {"fast": [(-1, 3)]}}, ValueError, "expected at least 0"),
        ({"allowed_period": 3}, ValueError, "allowed_period is given without allowed"),
        ({"time_unit": "ms"}, ValueError, "time_unit is 'ms'; expected 'step' or 's'"),
        ({"dwell": 3}, TypeError, "dwell"),
    ],
)
def test_wrong_values_are_refused(told, error, words):
    with pytest.raises(error, match=words):
        Rules(**told)


@pytest.mark.parametrize(
    ("told", "error", "words"),
    [
        ({"use": -1, "limit": 3}, ValueError, "use is -1"),
        ({"use": {"fast": math.nan}, "limit": 3}, ValueError, r"use\['fast'\] is nan"),
        ({"use": {}, "limit": 3}, ValueError, "use is empty"),
        ({"use": 1, "limit": -1}, ValueError, "limit is -1"),
        ({"use": 1, "limit": math.inf}, ValueError, "limit is inf"),
        ({"use": 1, "limit": 3, "window": 0}, ValueError, "window is 0"),
        ({"use": "1", "limit": 3}, TypeError, "use must be a number"),
    ],
)
def test_a_wrong_budget_is_refused(told, error, words):
    with pytest.raises(error, match=words):
        Budget(**told)


@pytest.mark.parametrize(
    ("rules", "error", "words"),
    [
        (Rules(min_dwell={"quick": 3}), KeyError, "min_dwell: no mode is named 'quick'; the modes are fast, slow, mid"),
        (Rules(start=(7, 2)), IndexError, "start: mode 7 is out of range"),
        (Rules(min_dwell=[1, 2]), ValueError, "min_dwell has 2 entries; expected 3"),
        (Rules(switch_cost=np.ones((2, 2))), ValueError, r"switch_cost has shape \(2, 2\); expected \(3, 3\)"),
        (Rules(transitions=np.ones((2, 2))), ValueError, r"transitions has shape \(2, 2\)"),
        (Rules(transitions={"fast": ["slow"]}), ValueError, r"transitions says nothing of mode 'slow'; give it \[\]"),
        (Rules(max_dwell=0.005, time_unit="s"), ValueError, "max_dwell of 'fast' is shorter than a step"),
        (Rules(start=("fast", 0.015), time_unit="s"), ValueError, "the age in start is 0.015 s; expected a multiple"),
        (Rules(allowed={"fast": [(0, 8)]}, allowed_period=5), ValueError, "ends at step 8, after allowed_period = 5"),
        # What contradicts itself: the fewest rules that together do are named, and no others.
        (Rules(min_dwell={"fast": 6}, max_dwell=5), ContradictionError, "min_dwell = 6 and max_dwell = 5 .*'fast'"),
        (
            Rules(start=("fast", 7), max_dwell=5, switch_cost=1),
            ContradictionError,
            r"start = \('fast', 7\) and max_dwell = 5 steps contradict",
        ),
        (
            Rules(max_dwell=5, max_switches=3, switch_cost=1, min_dwell=2),
            ContradictionError,
            r"^max_dwell = 5 and max_switches = 3 contradict each other: every run ends after at most 20 steps",
        ),
        (
            Rules(budget=Budget(use=[1, 2, 3], limit=20), min_dwell=2),
            ContradictionError,
            r"^budget = .* can't be met: every run ends after at most 20 steps",
        ),
        (
            Rules(allowed={"fast": [(0, 5)], "slow": [(7, math.inf)], "mid": [(0, 5)]}, start=("mid", 1)),
            ContradictionError,
            r"^allowed = .* can't be met: every run ends after at most 5 steps",
        ),
        (
            Rules(budget=Budget(use={"slow": 1}, limit=0), min_dwell=2, start=("slow", 1), price=[1, 2, 3]),
            ContradictionError,
            r"^min_dwell = 2 and budget = .* and start = .* contradict each other: every run ends before its first",
        ),
        (
            Rules(budget=Budget(use={"fast": 1}, limit=20, window=60)),
            ValueError,
            "more than 100,000 nodes, the most there may be",
        ),
    ],
)
def test_rules_that_do_not_fit_the_modes_are_refused(rules, error, words):
    with pytest.raises(error, match=words):
        SwitchingGraph(MODES, rules)


def test_no_rule_in_seconds_is_no_rule():
    assert len(SwitchingGraph(MODES, Rules(time_unit="s"))) == 1


def test_seconds_need_a_period():
    with pytest.raises(ValueError, match="time_unit is 's', but the modes have no sampling period"):
        SwitchingGraph(ModeSet([[[0.5]], [[0.9]]]), Rules(min_dwell=0.1, time_unit="s"))


def test_seconds_are_rounded_towards_the_stricter_rule():
    def limits(**told):
        return SwitchingGraph(MODES, Rules(time_unit="s", **told))._memory.limits

    assert limits(min_dwell=0.031).min_dwell == [4, 4, 4]
    assert limits(min_dwell=0.3).min_dwell == [30, 30, 30]  # 0.3 / 0.01 is not 30 in floating point
    assert limits(max_dwell=0.059).max_dwell == [5, 5, 5]
    assert limits(budget=Budget(use={"fast": 1}, limit=1, window=0.021)).window == 3
    available = limits(allowed={"fast": [(0.005, 0.039)]}).available
    assert available[:, 0].tolist() == [False, True, True, False]
    assert limits(start=("fast", 0.07)).start == (0, 7)


def test_rules_are_immutable_and_copied():
    dwell, use = {"fast": 3}, [1.0, 0.0, 0.0]
    rules = Rules(min_dwell=dwell, budget=Budget(use=use, limit=3))
    dwell["fast"] = 9
    use[0] = 9.0
    assert rules.min_dwell["fast"] == 3
    assert rules.budget.use == (1.0, 0.0, 0.0)
    with pytest.raises(TypeError):
        rules.min_dwell["fast"] = 4
    with pytest.raises(AttributeError):
        rules.min_dwell = 4
    assert pickle.loads(pickle.dumps(rules)) == rules
    assert eval(repr(rules)) == rules


def test_a_long_window_asks_for_no_more_than_it_must():
    modes = MODES
    graph = SwitchingGraph(modes, Rules(budget=Budget(use={"fast": 1}, limit=1, window=5000)))
    assert len(graph) == 5000
    for rules in (
        Rules(budget=Budget(use={"fast": 1}, limit=1, window=10**9)),
        Rules(allowed={"fast": [(0, 10**12)]}),
    ):
        with pytest.raises(ValueError, match="100,000 nodes"):
            SwitchingGraph(modes, rules)


def test_a_mode_is_told_once():
    with pytest.raises(ValueError, match="min_dwell tells one mode twice"):
        SwitchingGraph(MODES, Rules(min_dwell={"fast": 3, 0: 5}))
    assert len({Rules(min_dwell={"fast": 3}), Rules(min_dwell={"fast": 3})}) == 1


def test_uses_are_added_as_decimals():
    graph = SwitchingGraph(MODES, Rules(budget=Budget(use={"fast": 0.1}, limit=0.3)))
    graph.walk([0, 0, 0, 1])  # 0.1 + 0.1 + 0.1 > 0.3 in floating point
    with pytest.raises(ValueError, match="'fast' is not allowed"):
        graph.walk([0, 1, 0, 1, 0, 0])
