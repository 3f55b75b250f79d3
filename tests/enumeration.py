"""Sequences under rules by enumeration, with the independent checker."""

import math
import re
from functools import cache
from itertools import combinations, product

import numpy as np
import pytest
from rule_checker import costs_of, start_of, true_cost, violations

from switchctl import (
    ContradictionError,
    FewSwitches,
    SwitchingGraph,
    schedule,
)


def graph_of(modes, rules):
    """The graph; None where the rules contradict each other, which enumeration must confirm."""
    try:
        return SwitchingGraph(modes, rules)
    except ContradictionError as error:
        told = re.search(r"ends after at most (\d+) step", str(error))
        most = int(told[1]) if told else 0
        assert longest_run(modes, rules, most + 1) <= most, (rules, str(error))
        return None


def longest_run(modes, rules, most, begin=(), tries=1000):
    """How many steps some run that begins so obeys for: exactly up to ``most``, unless there are too many to try."""
    longest, stack = 0, [] if violations(modes, rules, begin) else [tuple(begin)]
    while stack and longest < most and tries:
        run, tries = stack.pop(), tries - 1
        longest = max(longest, len(run))
        likely_last = sorted(range(len(modes)), key=lambda i: bool(run) and i == run[-1])  # to stay rarely ends a run
        stack += [(*run, i) for i in likely_last if not violations(modes, rules, (*run, i))]
    return longest


@cache
def with_few_switches(m, steps, most):
    """Every sequence with at most so many switches, one a row."""
    sequences = []
    for switches in range(most + 1):
        for cuts in combinations(range(1, steps), switches):
            lengths = np.diff([0, *cuts, steps])
            orders = (order for order in product(range(m), repeat=switches + 1) if all(np.diff(order)))
            sequences += [np.repeat(order, lengths) for order in orders]
    return np.array(sequences)


def held_costs(modes):
    """What each mode costs when held for ever, as a matrix; None where it isn't Schur."""
    n, found = modes.A.shape[-1], []
    for A, Q in zip(modes.A, modes.Q, strict=True):
        P = np.linalg.solve(np.eye(n * n) - np.kron(A.T, A.T), Q.ravel()).reshape(n, n)
        P = (P + P.T) / 2
        found.append(P if np.abs(np.linalg.eigvals(A)).max() < 1 else None)
    return found


@cache
def quadratics(modes, steps, most, start):
    """The sequences that end in a Schur mode; W2 at each step and the cost of the state for ever, as x' .. x."""
    ends = held_costs(modes)
    sequences = with_few_switches(len(modes), steps, most)
    sequences = sequences[[ends[i] is not None for i in sequences[:, -1]]]
    moved = np.tile(np.eye(modes.A.shape[-1]), (len(sequences), 1, 1))
    w2, cost, p = [], 0.0, modes.plant_states
    for k, mode in enumerate(sequences.T):
        w2.append(np.swapaxes(moved[:, :p], 1, 2) @ moved[:, :p])
        if modes.activation is not None and (k or start is not None):
            moved = modes.activation[sequences[:, k - 1] if k else start, mode] @ moved
        cost += np.swapaxes(moved, 1, 2) @ modes.Q[mode] @ moved
        moved = modes.A[mode] @ moved
    for i, P in enumerate(ends):
        if P is not None:
            last = sequences[:, -1] == i
            cost[last] += np.swapaxes(moved[last], 1, 2) @ P @ moved[last]
    return sequences, np.stack(w2, axis=1), modes.dk * cost


def enumerated(modes, x0, rules, most, steps, beyond=40):
    """The least cost of a run with at most so many switches, all in the first steps, that ends in one mode; or inf."""
    start, _ = start_of(modes, rules)
    sequences, w2, cost = quadratics(modes, steps, most, start)
    S = np.outer(x0.mean, x0.mean) + x0.cov
    price, fixed, by_w2 = costs_of(modes, rules)
    before = np.column_stack([sequences[:, 0] if start is None else np.full(len(sequences), start), sequences[:, :-1]])
    switched = sequences != before
    costs = np.tensordot(cost, S) + modes.dk * price[sequences].sum(axis=1)
    costs += (switched * (fixed[before, sequences] + by_w2[before, sequences] * np.tensordot(w2, S))).sum(axis=1)
    costs[(switched.sum(axis=1) > most) | (price[sequences[:, -1]] > 0)] = math.inf
    for place in np.argsort(costs):  # the first that obeys is the best, so few must be checked
        sequence = sequences[place].tolist()
        if costs[place] == math.inf:
            break
        if not violations(modes, rules, sequence):
            if not violations(modes, rules, sequence + [sequence[-1]] * beyond):
                return costs[place]
    return math.inf


def run_of(result, least=35):
    """The modes of a schedule, with at least so many of those that are repeated for ever."""
    rounds = -(-least // len(result.tail))
    return [*result.sequence.tolist(), *result.lead, *(result.tail * rounds)]


def switches_of(modes, rules, run):
    """The steps at which the mode changes."""
    start, _ = start_of(modes, rules)
    return np.flatnonzero(np.diff([run[0] if start is None else start, *run]))


def check_few_switches(modes, x0, rules, most, steps, listed=None):
    graph = graph_of(modes, rules)
    if graph is None:
        return
    least = enumerated(modes, x0, rules, most, steps)
    try:
        result = schedule(modes, x0, FewSwitches(most), listed, graph)
    except ValueError as error:
        assert "held for ever at finite cost" in str(error)
        assert least == math.inf, rules
        return
    run = run_of(result)
    switches = switches_of(modes, rules, run)
    assert violations(modes, rules, run) == []
    assert len(result.tail) == 1
    assert len(switches) <= most
    assert result.cost == pytest.approx(true_cost(modes, x0, rules, run), rel=1e-9)
    assert result.cost <= least * (1 + 1e-9), (rules, most)
    if len(switches) == 0 or switches[-1] < steps:
        assert result.cost == pytest.approx(least, rel=1e-9), (rules, most)
