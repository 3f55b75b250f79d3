"""The switching graph: its nodes and edges, automata written by hand, what follows from them."""

import copy
import math
import pickle

import networkx
import numpy as np
import pytest
from random_cases import random_modes

from switchctl import Budget, Gaussian, ModeSet, Rules, Schedule, SwitchingGraph, schedule
from switchctl.continuation import Continuations, lasting, shortest
from switchctl.methods import Constant, Method, Rollout, Scheduler

MODES = ModeSet([[[0.5]], [[0.9]]], names=["fast", "slow"], dt=0.1)


@pytest.mark.parametrize(
    ("rules", "nodes", "edges"),
    [
        (Rules(), 1, 2),
        (Rules(min_dwell=1, switch_cost=0, transitions=np.ones((2, 2))), 1, 2),
        (Rules(min_dwell=1, max_dwell=math.inf, price={"fast": 1}), 1, 2),
        (Rules(switch_cost=1), 3, 6),
        (Rules(min_dwell=3), 7, 10),
        (Rules(max_dwell=4, start=("fast", 1)), 8, 14),
        (Rules(max_switches=1, start=("fast", 1)), 2, 3),
        (Rules(budget=Budget(use={"fast": 1}, limit=3)), 4, 7),
        (Rules(budget=Budget(use={"fast": 1}, limit=1, window=3)), 3, 4),
        (Rules(budget=Budget(use={"fast": 1}, limit=0)), 1, 1),
        (Rules(allowed={"fast": [(2, 5)]}), 6, 9),
        (Rules(allowed={"fast": [(2, 5)]}, allowed_period=6), 6, 9),
    ],
    ids=str,
)
def test_only_what_must_be_remembered_is(rules, nodes, edges):
    graph = SwitchingGraph(MODES, rules)
    assert (len(graph), sum(1 for _ in graph.edges())) == (nodes, edges)
    assert (graph.successor.max(axis=1) >= 0).all()  # a way on from every node


def test_an_edge_holds_what_a_step_costs():
    rules = Rules(switch_cost=[[0, 3], [5, 0]], switch_cost_per_w2=0.25, price=[2, 1])
    graph = SwitchingGraph(MODES, rules)
    (edge,) = [e for e in graph.edges() if graph.last_mode[e.tail] == 1 and e.mode == 0]
    assert edge.A.item() == 0.5
    assert edge.Q.item() == pytest.approx(0.1 * 1 + 0.25)
    assert edge.constant == pytest.approx(0.1 * (2 - 1) + 5)
    (stay,) = [e for e in graph.edges() if graph.last_mode[e.tail] == 1 == e.mode]
    assert (stay.Q.item(), stay.constant) == (pytest.approx(0.1), 0)


def test_moves_without_a_way_on_are_left_out():
    # fast may be held for two steps and then not be left: from slow it may never be taken.
    graph = SwitchingGraph(MODES, Rules(max_dwell={"fast": 2}, transitions={"fast": [], "slow": ["fast"]}))
    assert [e.mode for e in graph.edges()] == [1, 1]
    assert np.isinf(graph.holds[0]).tolist() == [False, True]


def test_an_automaton_written_by_hand():
    edges = [("idle", "one", "fast"), ("one", "two", "slow"), ("two", "one", "fast"), ("two", "idle", "slow")]
    graph = SwitchingGraph.from_edges(MODES, edges)
    assert (len(graph), graph.label(0)) == (3, "idle")
    assert graph.walk([0, 1, 1, 0, 1]).tolist() == [0, 1, 2, 0, 1, 2]
    with pytest.raises(ValueError, match=r"step 1: mode 'fast' is not allowed .*the way on is by slow"):
        graph.walk([0, 0])
    dwelling = SwitchingGraph.from_edges(MODES, edges, Rules(max_dwell={"slow": 1}))
    assert dwelling.walk([0, 1, 0, 1]).tolist()
    with pytest.raises(ValueError, match="not allowed"):
        dwelling.walk([0, 1, 1])
    begun = SwitchingGraph.from_edges(MODES, edges, start="two")
    assert begun.label(0) == "two"


@pytest.mark.parametrize(
    ("edges", "keywords", "error", "words"),
    [
        ([], {}, ValueError, "edges is empty"),
        ([("a", "b")], {}, TypeError, r"edges\[0\] is \('a', 'b'\); expected \(from, to, mode\)"),
        (["abc"], {}, TypeError, r"edges\[0\]"),
        ([("a", "a", "none")], {}, KeyError, r"edges\[0\]: no mode is named 'none'"),
        ([("a", "a", 0), ("a", "b", 0)], {}, ValueError, "another edge leaves 'a' in mode 'fast'"),
        ([(["a"], "a", 0)], {}, TypeError, "must be hashable"),
        ([("a", "a", 0)], {"start": "b"}, ValueError, "start is 'b', which no edge leaves"),
        (
            [("a", "b", 0), ("b", "c", 1)],
            {},
            ValueError,
            "the edges can't be met: every run ends after at most 2 steps",
        ),
        (
            [("a", "b", 0), ("b", "a", 1), ("a", "a", 1)],
            {"rules": Rules(budget=Budget(use={"slow": 1}, limit=3))},
            ValueError,
            "budget = .* and the edges contradict each other: every run ends after at most",
        ),
    ],
)
def test_a_wrong_automaton_is_refused(edges, keywords, error, words):
    with pytest.raises(error, match=words):
        SwitchingGraph.from_edges(MODES, edges, **keywords)


def test_the_graph_of_other_modes_is_refused(pair):
    modes, x0 = pair
    with pytest.raises(ValueError, match="other modes"):
        schedule(modes, x0, Rollout(), rules=SwitchingGraph(MODES))
    with pytest.raises(TypeError, match=r"rules must be Rules\(..\), not 5"):
        schedule(modes, x0, Rollout(), rules=5)
    with pytest.raises(TypeError, match="ModeSet"):
        SwitchingGraph(5)


def test_copies_and_networkx():
    rules = Rules(min_dwell=3, switch_cost=0.1)
    for graph in (
        SwitchingGraph(MODES, rules),
        SwitchingGraph.from_edges(MODES, [("a", "a", 0), ("a", "a", 1)], rules),
    ):
        for twin in (copy.deepcopy(graph), pickle.loads(pickle.dumps(graph))):
            assert (twin.successor == graph.successor).all()
            assert repr(twin) == repr(graph)
        exported = graph.to_networkx()
        assert isinstance(exported, networkx.MultiDiGraph)
        assert exported.number_of_nodes() == len(graph)
        assert exported.number_of_edges() == sum(1 for _ in graph.edges())
        assert exported.nodes[0]["label"] == graph.label(0)
        assert {data["mode"] for *_, data in exported.edges(data=True)} == {"fast", "slow"}


def test_holds_and_words_by_walking():
    rng = np.random.default_rng(4)
    for _ in range(50):
        m, V = int(rng.integers(1, 4)), int(rng.integers(1, 8))
        modes = ModeSet(rng.standard_normal((m, 1, 1)) / 9)
        edges = [(v, int(rng.integers(V)), i) for v in range(V) for i in range(m) if rng.random() < 0.7]
        try:
            graph = SwitchingGraph.from_edges(modes, edges)
        except ValueError:
            continue
        word = tuple(rng.integers(m, size=3).tolist())
        for v in range(len(graph)):
            for i in range(m):
                nodes = [v]
                while len(nodes) < 50 and graph.successor[nodes[-1], i] >= 0:
                    nodes.append(int(graph.successor[nodes[-1], i]))
                assert graph.holds[v, i] == (math.inf if len(nodes) == 50 else len(nodes) - 1)
            node, steps = v, 0
            while node >= 0 and steps < 60:
                node, steps = int(graph.successor[node, word[steps % 3]]), steps + 1
            assert lasting(graph, word)[v] == (node >= 0)


def test_every_way_on_costs_what_it_says():
    rng = np.random.default_rng(5)
    for rules in (
        Rules(min_dwell=3, switch_cost=0.1, switch_cost_per_w2=0.7),
        Rules(max_dwell=4, switch_cost_per_w2=0.3),
        Rules(price=[1, 0], start=(0, 2), min_dwell=4),
        Rules(max_dwell=[3, math.inf], min_dwell=2),
        Rules(budget=Budget(use=[1, 1], limit=1, window=1), max_switches=3, allowed={0: [(0, 4)]}),
    ):
        modes = ModeSet(random_modes(rng, 2, 2, (0.2, 0.7)), dt=0.1)
        graph = SwitchingGraph(modes, rules)
        ways, S = Continuations(graph), np.array([[2.0, 0.5], [0.5, 1.0]])
        for v in range(len(graph)):
            for number, *_ in zip(ways.table(v)[0], strict=True):
                lead, word = ways.path(v, number)
                P, constant, _ = ways.value(v, number)
                node, moment, cost = v, S, 0.0
                for mode in [*lead, *(word * 200)]:
                    before = graph.last_mode[node]
                    w2 = np.trace(moment)
                    cost += 0.1 * (w2 + graph.price[mode])
                    cost += graph.switch_cost[before, mode] + graph.switch_cost_per_w2[before, mode] * w2
                    moment, node = modes.A[mode] @ moment @ modes.A[mode].T, graph.successor[node, mode]
                    assert node >= 0
                assert 0.1 * (np.sum(P * S) + constant) == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize(
    ("lead", "word", "briefly"),
    [
        ((1, 0, 0), (0, 0), ((1,), (0,))),
        ((), (0, 1, 0, 1), ((), (0, 1))),
        ((2, 1), (0, 1), ((2,), (1, 0))),
        ((1,), (0, 1, 1), ((), (1, 0, 1))),
    ],
)
def test_a_run_is_told_briefly(lead, word, briefly):
    assert shortest(lead, word) == briefly


def test_a_schedule_against_the_rules_is_refused():
    x0, graph = Gaussian([1.0], [[0.0]]), SwitchingGraph(MODES, Rules(min_dwell=3, max_dwell={"slow": 5}))
    with pytest.raises(ValueError, match=r"step 2: mode 'slow' is not allowed by Rules.*\(fast for 2\); the way on is"):
        Schedule(MODES, x0, [0, 0, 1], graph=graph)
    with pytest.raises(ValueError, match="the tail can't repeat 'slow' for ever"):
        Schedule(MODES, x0, [1, 1, 1], graph=graph)
    with pytest.raises(ValueError, match="other modes"):
        Schedule(MODES, x0, [0], graph=SwitchingGraph(ModeSet([[[0.5]], [[0.9]]])))
    assert Schedule(MODES, x0, [1, 1, 1], tail=(0,), lead=(1,), graph=graph).tail == (0,)


def test_an_infinite_cost_is_said_to_be_so():
    x0 = Gaussian([1.0], [[0.0]])
    priced = Schedule(MODES, x0, [0, 0], graph=SwitchingGraph(MODES, Rules(price={"fast": 1})))
    assert (priced.cost, priced.cost_parts.state) == (math.inf, pytest.approx(0.1 / 0.75))
    assert "inf" in repr(priced)
    assert "running price inf" in repr(priced)
    toggling = Schedule(MODES, x0, [0, 1], tail=(0, 1), graph=SwitchingGraph(MODES, Rules(switch_cost=0.1)))
    assert toggling.cost_parts.switching == math.inf
    assert math.isfinite(toggling.cost_parts.state)


class Stubborn(Method):
    def start(self, graph):
        return StubbornScheduler(graph)


class StubbornScheduler(Scheduler):
    def decide(self, S):
        return 0


def test_a_method_that_breaks_the_rules_is_stopped():
    x0 = Gaussian([1.0], [[0.0]])
    with pytest.raises(ValueError, match=r"StubbornScheduler chose against the rules: mode 'fast' is not allowed"):
        schedule(MODES, x0, Stubborn(), rules=Rules(max_dwell=2))


def test_constant_goes_to_its_mode_as_soon_as_it_may():
    x0 = Gaussian([1.0], [[0.0]])
    result = schedule(MODES, x0, Constant("fast"), steps=6, rules=Rules(min_dwell=4, start=("slow", 1)))
    assert result.sequence.tolist() == [1, 1, 1, 0, 0, 0]
    with pytest.raises(ValueError, match=r"mode 'fast' can't be held for ever under Rules\(max_dwell=3\)"):
        schedule(MODES, x0, Constant("fast"), rules=Rules(max_dwell=3))
