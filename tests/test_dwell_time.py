"""Dwell times: published ones, and brute force over all signals that repeat themselves."""

import sys

import numpy as np
import pytest
from products import greatest_growth, product_of, radius, shortest_hold, step
from scipy.linalg import expm

from switchctl import ModeSet
from switchctl.certificates import certify
from switchctl.models import five_mode
from switchctl.stability import average_dwell_time, minimum_dwell_time, mode_dependent_dwell_times

search = sys.modules[minimum_dwell_time.__module__]
average = sys.modules[average_dwell_time.__module__]


def geromel():
    """Geromel and Colaneri, Int. J. Control 79, 2006: two modes sampled at 0.5, at least six steps."""
    return ModeSet([expm(0.5 * np.array([[0, 1], [-10, -1]])), expm(0.5 * np.array([[0, 1], [-0.1, -0.5]]))])


def random_schur(seed, activation=False):
    """Two or three Schur stable modes that need time: matrices far from normal."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 4)), int(rng.integers(2, 4))
    A = rng.standard_normal((m, n, n))
    A *= (rng.uniform(0.4, 0.9, m) / np.abs(np.linalg.eigvals(A)).max(axis=-1))[:, None, None]
    maps = None
    if activation:
        maps = np.tile(np.eye(n), (m, m, 1, 1))
        for j, i in np.argwhere(~np.eye(m, dtype=bool)):
            maps[j, i] += 0.8 * rng.standard_normal((n, n))
    return ModeSet(A, activation=maps)


def held_moves(modes, dwell):
    """Moves where every mode is held for its dwell time, step by step; nodes are (mode, steps so far)."""
    m = len(modes)
    places = [(i, c) for i in range(m) for c in range(1, dwell[i] + 1)]
    node = {place: k for k, place in enumerate(places)}
    moves = []
    for (i, c), v in node.items():
        moves.append((v, node[i, min(c + 1, dwell[i])], modes.A[i], i))
        if c == dwell[i]:
            moves += [(v, node[j, 1], step(modes, i, j), j) for j in range(m) if j != i]
    return moves


def check_signal(modes, word, dwell):
    """A word that keeps to dwell times and doesn't contract."""
    for mode, held in shortest_hold(word).items():
        assert held >= dwell[mode]
    assert radius(product_of(modes, word)) >= 1


def check_least(found, longest=14, most=20_000):
    modes, m = found.modes, len(found.modes)
    grown, _ = greatest_growth(held_moves(modes, (found.upper,) * m), longest, most)
    assert grown < 1 and grown <= found.stable.upper * (1 + 1e-12)
    assert found.stable.verdict == "stable" and 1 <= found.lower <= found.upper
    if found.lower > 1:
        check_signal(modes, found.word, (found.lower - 1,) * m)
    else:
        assert found.word == () and found.unstable is None


def test_example_1_needs_three_steps():
    found = minimum_dwell_time(five_mode.modes())
    assert (found.lower, found.upper, found.word) == (3, 3, (4, 4, 2, 2))
    check_least(found)
    assert "3 steps" in repr(found) and "A5 x 2 A3 x 2" in repr(found)


def test_geromel_and_colaneri_need_six():
    found = minimum_dwell_time(geromel())
    assert (found.lower, found.upper) == (6, 6)
    check_least(found)


@pytest.mark.parametrize("seed", range(10))
def test_random_modes_against_all_signals(seed):
    found = minimum_dwell_time(random_schur(seed, activation=seed % 2 == 1), time_limit=8)
    check_least(found)
    assert found.upper - found.lower <= 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 140))
def test_many_random_modes_against_all_signals(seed):
    modes = random_schur(seed, activation=seed % 2 == 1)
    check_least(minimum_dwell_time(modes, time_limit=10), 16, 100_000)
    check_each(mode_dependent_dwell_times(modes, time_limit=10), 16, 100_000)
    check_average(average_dwell_time(modes, time_limit=10))


def check_each(found, longest=14, most=20_000):
    """The dwell times are stable, and one step less of a mode said to be least has a signal that isn't."""
    grown, _ = greatest_growth(held_moves(found.modes, found.dwell), longest, most)
    assert grown < 1 and grown <= found.stable.upper * (1 + 1e-12)
    for i, least in enumerate(found.least):
        if not least or found.dwell[i] == 1:
            assert least or found.dwell[i] > 1
            continue
        dwell = list(found.dwell)
        dwell[i] -= 1
        if sum(dwell) <= 14:  # a signal that needs no more than a few steps
            moves = held_moves(found.modes, dwell)
            assert greatest_growth(moves, 2 * sum(dwell), 5 * most)[0] >= 1 - 1e-3


def test_dwell_times_of_each_mode():
    found = mode_dependent_dwell_times(five_mode.modes())
    assert found.dwell == (2, 3, 3, 2, 3) and all(found.least)
    check_each(found)


@pytest.mark.parametrize("seed", range(4))
def test_random_modes_with_dwell_times_of_each(seed):
    check_each(mode_dependent_dwell_times(random_schur(20 + seed, activation=seed % 2 == 1), time_limit=8))


def check_average(found, seed=0):
    """Signals that switch no more often than allowed vanish; the word at ``lower`` doesn't, and is as slow as said."""
    modes, m = found.modes, len(found.modes)
    assert found.lower <= found.upper * (1 + 1e-9)
    assert found.P.shape == (m, *modes.A.shape[1:])
    if found.word:
        switches = sum(a != b for a, b in zip(found.word, found.word[-1:] + found.word[:-1], strict=True))
        assert found.lower == pytest.approx(len(found.word) / switches)
        assert radius(product_of(modes, found.word)) >= 1
    rng, tried = np.random.default_rng(seed), 0
    for _ in range(400):
        switches = 2 * int(rng.integers(1, 4)) if m == 2 else int(rng.integers(2, 6))
        order = rng.integers(m, size=switches)
        if (order == np.roll(order, 1)).any():
            continue
        steps = int(np.ceil(switches * found.upper))
        holds = 1 + rng.multinomial(max(0, steps - switches), rng.dirichlet(0.4 * np.ones(switches)))
        word = tuple(int(i) for i, count in zip(order, holds, strict=True) for _ in range(count))
        assert radius(product_of(modes, word)) < 1 + 1e-12
        tried += 1
    assert tried > 20
    # the inequalities that prove it, in floating point
    for j in range(m):
        for i in range(m):
            most = found.decay**2 * (1 if i == j else found.jump**2) * found.P[j]
            left = most - step(modes, j, i).T @ found.P[i] @ step(modes, j, i)
            assert np.linalg.eigvalsh(left).min() >= -1e-7 * np.linalg.eigvalsh(most).max()
    if found.upper:
        assert found.jump * found.decay**found.upper <= 1 + 1e-12


@pytest.mark.parametrize("modes", [five_mode.modes(), geromel()], ids=["five modes", "Geromel and Colaneri"])
def test_average_dwell_times(modes):
    found = average_dwell_time(modes, time_limit=10)
    check_average(found)
    assert found.lower > 1


@pytest.mark.parametrize("seed", range(4))
def test_average_dwell_times_of_random_modes(seed):
    check_average(average_dwell_time(random_schur(40 + seed, activation=seed % 2 == 1), time_limit=6))


def test_scalar_modes_that_grow_at_a_switch():
    """Halved at each step and trebled by each switch: two steps for each switch, log 3 / log 2 on average."""
    activation = 3 * np.ones((2, 2, 1, 1))
    activation[[0, 1], [0, 1]] = 1
    modes = ModeSet([[[0.5]], [[0.5]]], activation=activation)
    found = minimum_dwell_time(modes)
    assert (found.lower, found.upper) == (2, 2)
    each = mode_dependent_dwell_times(modes)
    assert sorted(each.dwell) == [1, 3] or each.dwell == (2, 2)
    check_each(each)
    mean = average_dwell_time(modes)
    assert mean.upper == pytest.approx(np.log(3) / np.log(2), rel=1e-2)
    assert mean.lower <= np.log(3) / np.log(2)
    check_average(mean)
    assert mean.lower == pytest.approx(1.5)


def test_what_happens_at_a_switch_counts_on_average():
    """Words that grow are none where a switch shrinks the state to a tenth; others are where it trebles it."""
    for factor in (0.1, 3.0):
        maps = factor * np.tile(np.eye(2), (2, 2, 1, 1))
        maps[[0, 1], [0, 1]] = np.eye(2)
        found = average_dwell_time(ModeSet(geromel().A, activation=maps), time_limit=6)
        check_average(found)
        assert bool(found.word) == (factor > 1)
        certificate = certify(found)
        certificate.check()
        assert (certificate.claim["unstable"] is None) == (factor < 1)


def test_modes_that_need_no_dwell_time():
    for modes in (ModeSet([[[0.5]], [[-0.9]]]), ModeSet([[[0.5, 1.0], [0.0, 0.3]]])):
        found = minimum_dwell_time(modes)
        assert (found.lower, found.upper, found.word, found.unstable) == (1, 1, (), None)
        assert mode_dependent_dwell_times(modes).dwell == (1,) * len(modes)
        mean = average_dwell_time(modes)
        assert (mean.lower, mean.upper, mean.word) == (0, 0, ())
        for result in (found, mean):
            certify(result).check()


@pytest.mark.parametrize("function", [minimum_dwell_time, mode_dependent_dwell_times, average_dwell_time])
def test_wrong_input(function):
    with pytest.raises(ValueError, match="'A1' is not Schur stable"):
        function(ModeSet([[[0.5]], [[1.1]]]))
    with pytest.raises(ValueError, match="not Schur stable"):
        function(ModeSet([[[0.5]], [[1.0]]]))
    with pytest.raises(TypeError, match="ModeSet"):
        function([[[0.5]]])
    modes = ModeSet([[[0.5]]])
    for wrong in (0, -1, np.nan):
        with pytest.raises(ValueError, match="time_limit"):
            function(modes, time_limit=wrong)
    with pytest.raises(TypeError, match="time_limit"):
        function(modes, time_limit="long")


def test_an_interrupt_keeps_the_bounds(monkeypatch):
    """Ctrl-C while a shorter dwell time is looked into: what is known is returned, and nothing more is tried."""
    inside, calls = sys.modules["switchctl.stability.joint_spectral_radius"], []
    run = inside._Search._run

    def some(self):
        calls.append(self)
        if len(calls) == 5:  # after 1, 2, 4 and 8
            raise KeyboardInterrupt
        assert len(calls) < 5, "the search goes on"
        return run(self)

    monkeypatch.setattr(inside._Search, "_run", some)
    found = minimum_dwell_time(geromel())
    assert (found.lower, found.upper) == (5, 8) and len(calls) == 5
    monkeypatch.undo()
    check_least(found)

    def at_once(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(inside._Search, "_run", at_once)
    with pytest.raises(KeyboardInterrupt):
        minimum_dwell_time(five_mode.modes())


def test_little_time():
    for seed in range(4):
        found = minimum_dwell_time(random_schur(seed), time_limit=1e-6)
        check_least(found)


def test_little_time_gives_dwell_times_that_are_proven(monkeypatch):
    modes = five_mode.modes()
    found = mode_dependent_dwell_times(modes, time_limit=1e-6)
    assert found.stable.verdict == "stable" and found.status == "done"
    inside = sys.modules["switchctl.stability.average_dwell_time"]
    norms, calls = inside.quadratic_norms, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return norms(*arguments)

    monkeypatch.setattr(inside, "quadratic_norms", interrupted)
    found = average_dwell_time(modes, time_limit=5)
    assert found.status == "interrupted" and np.isfinite(found.upper) and "interrupted" in repr(found)
