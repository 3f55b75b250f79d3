"""Whether switching helps at all, against enumeration of words, each followed by every tail."""

import mpmath
import numpy as np
import pytest
from enumeration import held_costs
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

import switchctl.stability.pairs
from switchctl import Gaussian, ModeSet, Optimal, Rollout, schedule
from switchctl.stability import SwitchingHelp, does_switching_help

MIXED = np.array([np.diag([0.5, 0.6]), np.diag([0.6, 0.5])])
MIXED_Q = np.array([np.diag([4.0, 1.0]), np.diag([1.0, 4.0])])


def tails_of(modes):
    return [P for P in held_costs(modes) if P is not None]


def words(modes, most=2000, longest=8):
    """What every word of up to so many steps costs, followed by each tail."""
    level = np.array(tails_of(modes))
    levels = [level]
    while len(level) * len(modes) <= most and len(levels) <= longest:
        ahead = np.swapaxes(modes.A, 1, 2)[:, None] @ level @ modes.A[:, None]
        level = (modes.Q[:, None] + ahead).reshape(-1, *level.shape[1:])
        levels.append(level)
    return np.concatenate(levels)


def moments(rng, n, count=60):
    factors = [rng.standard_normal((n, 1 if k % 2 else n)) * 10 ** rng.uniform(-2, 2, (n, 1)) for k in range(count)]
    return np.array([F @ F.T for F in factors])


def check(found, rng, units=None):
    """Hold an answer against enumeration; returns the greatest share seen to be saved."""
    modes = found.modes
    n, tails = modes.A.shape[-1], tails_of(modes)
    assert 0 <= found.gain <= 1
    assert isinstance(found, SwitchingHelp)
    if not tails:
        return 0.0
    S = moments(rng, n)
    if units is not None:
        S = S * np.outer(units, units)
    if found.moment is not None:
        S = np.concatenate([S, found.moment[None]])
    costs = np.tensordot(words(modes), S, ([1, 2], [1, 2]))
    single = np.tensordot(np.array(tails), S, ([1, 2], [1, 2])).min(axis=0)
    saved = 1 - costs.min(axis=0) / single
    assert saved.max() <= found.gain + 1e-9
    if found.helps:
        check_witness(found)
        assert saved[-1] >= 1 - found.cost / found.best_single - 1e-9
        assert found.gain >= 1 - found.cost / found.best_single - 1e-9
    elif found.helps is False:
        assert found.gain <= 1e-9
        assert found.moment is found.pair is found.word is None
        check_combinations(found)
    return float(saved.max())


def check_witness(found):
    """Propagate the moment of a True by hand."""
    modes, S = found.modes, found.moment
    assert S.dtype == np.float64
    assert np.array_equal(S, S.T)
    assert np.trace(S) == pytest.approx(1)
    unit = np.sqrt(np.diag(S))
    assert np.linalg.eigvalsh(S / np.outer(unit, unit))[0] > 0
    i, q = found.pair
    costs = held_costs(modes)
    after = modes.A[i] @ S @ modes.A[i].T
    switched = np.sum(modes.Q[i] * S) + np.sum(costs[q] * after)
    single = min(np.sum(P * S) for P in costs if P is not None)
    assert switched == pytest.approx(found.cost, rel=1e-6)
    assert single == pytest.approx(found.best_single, rel=1e-6)
    assert switched < single
    assert set(found.outlasted) == {p for p, P in enumerate(modes.tails) if P is None}
    for p, steps in found.outlasted.items():
        if steps > 5000:
            continue
        paid, moved = 0.0, S
        for _ in range(steps):
            paid += np.sum(modes.Q[p] * moved)
            moved = modes.A[p] @ moved @ modes.A[p].T
        assert paid > found.best_single


def check_combinations(found):
    """Every pair's combination is below, up to the gain."""
    modes = found.modes
    finite = [q for q, P in enumerate(modes.tails) if P is not None]
    if len(modes) > 1:
        assert set(found.combinations) == {(i, q) for i in range(len(modes)) for q in finite}
    for (i, q), alpha in found.combinations.items():
        assert alpha.shape == (len(modes),)
        assert (alpha >= 0).all()
        assert alpha.sum() == pytest.approx(1)
        assert not alpha[[p for p in range(len(modes)) if p not in finite]].any()
        M = modes.Q[i] + modes.A[i].T @ modes.tails[q] @ modes.A[i]
        below = sum(alpha[p] * modes.tails[p] for p in finite)
        unit = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
        assert np.linalg.eigvalsh((M - below) / np.outer(unit, unit))[0] >= -1e-8


def rotation(rng, n):
    return np.linalg.qr(rng.standard_normal((n, n)))[0]


def in_coordinates(modes, T):
    """The same modes for the state ``T x``."""
    back = np.linalg.inv(T)
    Q = back.T @ modes.Q @ back
    return ModeSet(T @ modes.A @ back, Q=(Q + np.swapaxes(Q, 1, 2)) / 2)


def mixed(rng, m):
    """Modes none of which dominates, each the best somewhere, and yet no switching helps; perturbed and turned."""
    A, Q = MIXED + 0.003 * rng.standard_normal((2, 2, 2)), MIXED_Q + 0.0
    worse = [1.05 * A[k % 2] for k in range(m - 2)]
    heavier = [1.1 * MIXED_Q[k % 2] for k in range(m - 2)]
    T = rotation(rng, 2) * rng.uniform(0.5, 2, 2)
    return in_coordinates(ModeSet(np.array([*A, *worse]), Q=np.array([*Q, *heavier])), T)


def dominated(rng, n, m):
    """A mode, and the same with more of everything."""
    A = random_modes(rng, n, 1, (0.3, 0.9))[0]
    return ModeSet(np.array([A * f for f in [1.0, *rng.uniform(1.01, 1.3, m - 1)]]))


def commuting(rng, n, m):
    """Diagonal modes in some orthogonal basis, one of them the least in every entry."""
    U, first = rotation(rng, n), rng.uniform(-0.8, 0.8, n)
    others = np.sign(rng.standard_normal((m - 1, n))) * (np.abs(first) + rng.uniform(0.01, 0.3, (m - 1, n)))
    return ModeSet(np.array([(U * d) @ U.T for d in [first, *others]]))


def test_the_papers_first_example_is_helped(example):
    modes, x0 = example
    found = does_switching_help(modes, x0)
    assert found.helps is True
    assert found.dominant is found.paper_test is None
    check(found, np.random.default_rng(0))
    assert 1 - found.cost / found.best_single > 0.6
    assert found.saves_at_least == pytest.approx(1 - 77.7737 / 136.761, abs=1e-4)
    assert found.saves_at_least <= found.saves_at_most < found.saves_at_least + 2e-3
    assert isinstance(found.schedule.cost, float)


def test_the_papers_test_is_not_sufficient():
    """A_0 is faster, and shortens every state more than A_1; yet A_1 turns x[0] to where A_0 ends it in one step."""
    A = np.array([[[0.9, 0.0], [0.0, 0.0]], [[0.0, -0.95], [0.95, 0.0]]])
    assert np.abs(np.linalg.eigvals(A)).max(axis=1) == pytest.approx([0.9, 0.95])
    assert np.linalg.eigvalsh(A[1].T @ A[1] - A[0].T @ A[0])[0] > 0.09
    found = does_switching_help(ModeSet(A), Gaussian([1.0, 0.0], np.zeros((2, 2))))
    assert found.paper_test == 0
    assert found.helps is True
    assert found.pair == (1, 0)
    check(found, np.random.default_rng(0))
    alone, turned_first = 1 / (1 - 0.81), 1 + 0.95**2
    assert found.saves_at_least == pytest.approx(1 - turned_first / alone, abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_random_modes_against_enumeration(seed):
    rng = np.random.default_rng(seed)
    answers = []
    for _ in range(20):
        n, m = rng.integers(1, 6), rng.integers(1, 5)
        modes = ModeSet(random_modes(rng, n, m, (0.1, 1.05)))
        found = does_switching_help(modes)
        check(found, rng)
        answers.append(found.helps)
        assert found.helps is not None or all(P is None for P in modes.tails)
    assert {True, False} <= set(answers)


@pytest.mark.parametrize("seed", range(6))
def test_modes_made_so_that_switching_does_not_help(seed):
    rng = np.random.default_rng(100 + seed)
    for k in range(30):
        n, m = int(rng.integers(1, 6)), int(rng.integers(2, 5))
        modes = [mixed(rng, m), dominated(rng, n, m), commuting(rng, n, m)][k % 3]
        found = does_switching_help(modes)
        assert found.helps is False
        assert found.gain == 0
        check(found, rng)
        if k % 3:
            assert found.dominant == 0
            continue
        assert found.dominant is None
        assert any(np.count_nonzero(alpha > 1e-3) > 1 for alpha in found.combinations.values())
        least = np.tensordot(np.array(tails_of(modes)), moments(rng, 2, 200), ([1, 2], [1, 2])).argmin(axis=0)
        assert {0, 1} <= set(least)


@pytest.mark.parametrize("seed", range(4))
def test_in_badly_scaled_states(seed):
    rng = np.random.default_rng(200 + seed)
    for k in range(15):
        n, m = int(rng.integers(2, 5)), int(rng.integers(2, 4))
        modes = [mixed(rng, m), dominated(rng, n, m), ModeSet(random_modes(rng, n, m))][k % 3]
        units = 10 ** rng.uniform(-6, 6, modes.A.shape[-1])
        units[:2] = 1e6, 1.0
        found, plain = does_switching_help(in_coordinates(modes, np.diag(units))), does_switching_help(modes)
        check(found, rng, units)
        assert found.helps == plain.helps
        assert found.gain == pytest.approx(plain.gain, rel=1e-3, abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(2, 4))
def test_the_answer_does_not_depend_on_coordinates_or_names(seed, n, m):
    rng = np.random.default_rng(seed)
    modes = ModeSet(random_modes(rng, n, m, (0.2, 1.02)))
    order = rng.permutation(m)
    found = does_switching_help(modes)
    turned = does_switching_help(in_coordinates(modes, rotation(rng, n)))
    renamed = does_switching_help(ModeSet(modes.A[order]))
    for other in (turned, renamed):
        saved, again = (0.0 if not one.helps else 1 - one.cost / one.best_single for one in (found, other))
        assert saved == pytest.approx(again, rel=0.03, abs=1e-7)
        assert other.helps == found.helps or max(saved, again) < 1e-7
        assert other.gain == pytest.approx(found.gain, rel=1e-3, abs=1e-8)
    if found.pair is not None and found.cost < 0.999 * found.best_single:
        back = tuple(int(order[mode]) for mode in renamed.pair)
        assert back == found.pair or renamed.cost / renamed.best_single == pytest.approx(
            found.cost / found.best_single, rel=0.02
        )


@pytest.mark.parametrize("seed", range(5))
def test_what_x0_can_save_is_within_what_any_state_can(seed):
    rng = np.random.default_rng(300 + seed)
    modes, x0 = ModeSet(random_modes(rng, 3, 3)), random_gaussian(rng, 3)
    found = does_switching_help(modes, x0, gap=1e-2)
    best = min(np.sum(P * x0.second_moment) for P in tails_of(modes))
    assert 0 <= found.saves_at_least <= found.saves_at_most <= found.gain + 1e-9
    assert found.saves_at_least >= 1 - schedule(modes, x0, Rollout()).cost / best - 1e-2
    assert found.saves_at_most <= 1 - schedule(modes, x0, Optimal(gap=1e-4)).lower_bound / best + 1e-2


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-14, 1e-13, 1e-12, 1e-10])
def test_modes_that_are_next_to_equal(apart):
    rng = np.random.default_rng(5)
    A = random_modes(rng, 3, 1, (0.5, 0.9))[0]
    found = does_switching_help(ModeSet([A, A + apart * rng.standard_normal((3, 3))]))
    assert found.gain < max(1e-10, 100 * apart)
    if apart < 1e-13:
        assert found.helps is not True
    check(found, rng)


@pytest.mark.parametrize("seed", range(8))
def test_a_little_help_is_never_claimed_wrongly(seed):
    """In 50 digits, where the difference is of the size of rounding."""
    rng = np.random.default_rng(500 + seed)
    for _ in range(12):
        A = random_modes(rng, 3, 1, (0.5, 0.99))[0]
        modes = ModeSet([A, A + 10 ** rng.uniform(-17, -11) * rng.standard_normal((3, 3))])
        found = does_switching_help(modes)
        if not found.helps:
            continue
        with mpmath.workdps(50):
            A, S = [mpmath.matrix(A.tolist()) for A in modes.A], mpmath.matrix(found.moment.tolist())
            tails = [exact_tail(Ai) for Ai in A]
            i, q = found.pair
            M = mpmath.eye(3) + A[i].T * tails[q] * A[i]
            assert trace(M * S) < min(trace(P * S) for P in tails)


def exact_tail(A):
    P, M = mpmath.eye(A.rows), A
    while mpmath.norm(M) > mpmath.mpf(10) ** -60:
        P, M = P + M.T * P * M, M * M
    return P


def trace(X):
    return mpmath.fsum(X[k, k] for k in range(X.rows))


def test_a_little_help_is_seen():
    found = does_switching_help(ModeSet([[[0.5, 0.2], [0.0, 0.4]], [[0.5, 0.2 + 1e-6], [1e-6, 0.4 - 1e-6]]]))
    assert found.helps is True
    assert 1e-9 < 1 - found.cost / found.best_single < 1e-5
    check(found, np.random.default_rng(0))


def test_equality_with_a_genuine_combination():
    """One matrix, two weights: the tails are proportional, and every pair holds with equality."""
    modes = ModeSet(0.5 * np.array([np.eye(2)] * 2), Q=[np.diag([2.0, 1.0]), np.diag([1.0, 2.0])])
    found = does_switching_help(modes)
    assert found.helps is False
    assert found.gain < 1e-11
    assert found.combinations[0, 1] == pytest.approx([0.75, 0.25])
    check(found, np.random.default_rng(0))


def test_no_dominant_mode_and_yet_no_help_with_one_weight():
    """The same with the identity as weight: what a mode adds to the cost is carried by states one step late."""
    late = np.array([np.diag([np.sqrt(3.0), 0.0]), np.diag([0.0, np.sqrt(3.0)])])
    modes = ModeSet(
        np.array([np.block([[A, np.zeros((2, 2))], [C, np.zeros((2, 2))]]) for A, C in zip(MIXED, late, strict=True)])
    )
    found = does_switching_help(modes)
    assert found.helps is False
    assert found.dominant is None
    assert found.gain < 1e-12
    check(found, np.random.default_rng(0))


def test_one_mode():
    found = does_switching_help(ModeSet([[[0.5]]]))
    assert (found.helps, found.gain, found.dominant) == (False, 0.0, 0)
    assert does_switching_help(ModeSet([[[1.5]]])).helps is False


def test_unstable_modes_that_contract_together():
    modes = ModeSet([np.diag([1.5, 0.3]), np.diag([0.3, 1.5])])
    found = does_switching_help(modes, Gaussian([1.0, 1.0], np.eye(2)))
    assert found.helps is True
    assert found.pair is None
    assert np.abs(np.linalg.eigvals(np.linalg.multi_dot([np.eye(2), *modes.A[list(found.word)]]))).max() < 1
    assert np.array_equal(found.moment, np.eye(2))
    assert found.best_single == np.inf
    paid, S = 0.0, np.eye(2)
    for mode in found.word * 100:
        paid, S = paid + np.trace(S), modes.A[mode] @ S @ modes.A[mode].T
    assert paid == pytest.approx(found.cost)
    assert found.saves_at_least == found.saves_at_most == 1
    assert set(found.outlasted) == {0, 1}
    assert does_switching_help(ModeSet([[[1.5]], [[2.0]]])).helps is None


def test_an_unstable_mode_that_helps():
    rng = np.random.default_rng(6)
    helped = 0
    for _ in range(20):
        A = random_modes(rng, 3, 2, (0.5, 0.95))
        A[1] *= rng.choice([1.001, 1.05, 3.0]) / np.abs(np.linalg.eigvals(A[1])).max()
        found = does_switching_help(ModeSet(A))
        assert found.helps is not None
        helped += found.helps
        check(found, rng)
        assert not found.helps or set(found.outlasted) == {1}
    assert helped > 3


def test_an_unstable_mode_whose_instability_the_cost_does_not_see():
    """The second mode alone costs less than any sequence with the first; a pair isn't reported as better."""
    modes = ModeSet([0.5 * np.eye(2), [[1.05, -0.95], [-0.95, 1.05]]], Q=np.ones((2, 2)))
    assert modes.tails[1] is None
    assert does_switching_help(modes).helps is None


def test_singular_weights():
    """Observability in a few steps is enough for a proof; a state that the cost never sees needs no proof."""
    A = np.array([[0.5, 0.3], [0.1, 0.4]])
    found = does_switching_help(ModeSet([A, 1.1 * A, 1.3 * A], Q=np.diag([1.0, 0.0])))
    assert (found.helps, found.gain, found.dominant) == (False, 0.0, 0)
    check(found, np.random.default_rng(0))
    same = does_switching_help(ModeSet([A, A], Q=np.diag([1.0, 0.0])))
    assert same.helps is False
    assert 0 < same.gain < 1e-10
    unseen = does_switching_help(ModeSet([np.diag([0.5, 2.0]), np.diag([0.6, 0.5])], Q=np.diag([1.0, 0.0])))
    assert (unseen.helps, unseen.dominant) == (False, 0)
    free = does_switching_help(ModeSet([[[0.5]], [[1.0]]], Q=[[[1.0]], [[0.0]]]))
    assert (free.helps, free.dominant) == (False, 1)
    nothing = does_switching_help(ModeSet([[[0.5]], [[1.5]]], Q=[[0.0]]))
    assert (nothing.helps, nothing.gain) == (False, 0.0)


def test_a_run_that_costs_little_and_does_not_come_to_rest():
    """All inequalities hold, and yet switching helps: after one step of the first mode the second is free for ever."""
    modes = ModeSet([np.diag([0.0, 0.9]), np.eye(2)], Q=[np.eye(2), np.diag([1.0, 0.0])])
    P = modes.tails[0]
    assert modes.tails[1] is None
    assert np.linalg.eigvalsh(modes.Q[1] + P - P)[0] >= 0
    found = does_switching_help(modes)
    assert found.helps is None
    assert found.gain == 1
    assert "come to rest" in found.why


@pytest.mark.parametrize("seed", range(3))
def test_singular_weights_against_enumeration(seed):
    rng = np.random.default_rng(400 + seed)
    for _ in range(15):
        n, m = int(rng.integers(2, 4)), int(rng.integers(2, 4))
        C = rng.standard_normal((m, 1, n))
        found = does_switching_help(ModeSet(random_modes(rng, n, m, (0.2, 0.9)), Q=np.swapaxes(C, 1, 2) @ C))
        check(found, rng)
        assert found.helps is not None


def test_what_it_is_not_for_is_refused():
    A = [[[0.5]], [[0.6]]]
    with pytest.raises(TypeError, match="modes must be a ModeSet"):
        does_switching_help(A)
    with pytest.raises(TypeError, match="x0 must be a Gaussian"):
        does_switching_help(ModeSet(A), [1.0])
    with pytest.raises(ValueError, match="gap is 2"):
        does_switching_help(ModeSet(A), gap=2)
    for keywords, told in [
        ({"W": [[1.0]]}, "noise"),
        ({"offset": [1.0, 0.0]}, "offset"),
        ({"cost": ("discounted", 0.9)}, "discounted"),
        ({"cost": "average"}, "average"),
        ({"activation": np.full((2, 2, 1, 1), 0.5)}, "activation"),
    ]:
        with pytest.raises(ValueError, match=told):
            does_switching_help(ModeSet(A, **keywords))


def test_interrupted_it_tells_what_it_has(example, monkeypatch):
    decide, count = switchctl.stability.pairs.Pairs.decide, []

    def interrupted(self, i, q):
        count.append((i, q))
        if len(count) == most:
            raise KeyboardInterrupt
        return decide(self, i, q)

    monkeypatch.setattr(switchctl.stability.pairs.Pairs, "decide", interrupted)
    most = 1
    found = does_switching_help(example[0])
    assert found.helps is None
    assert found.why == "interrupted after 0 of 20 pairs of modes"
    most, count = 12, []
    found = does_switching_help(example[0])
    assert found.helps is True
    assert found.gain == 1
    check_witness(found)


def test_a_solver_that_fails_or_lies_is_not_believed(monkeypatch):
    rng = np.random.default_rng(7)
    cases = [ModeSet(random_modes(rng, 3, 3)) for _ in range(5)] + [ModeSet(MIXED, Q=MIXED_Q)]

    def nothing(*arguments, **keywords):
        return None

    def nonsense(objective, matrix, vector, cones, **keywords):
        return rng.uniform(0, 1, len(objective)), rng.standard_normal(len(vector)) + 1

    for solver in (nothing, nonsense):
        monkeypatch.setattr(switchctl.stability.pairs, "primal_and_dual", solver)
        for modes in cases:
            check(does_switching_help(modes), rng)


def test_printed():
    found = does_switching_help(ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], ["fast", "calm"]))
    assert repr(found).startswith("SwitchingHelp: yes\n├── why           fast once and then calm for ever save ")
    assert "<table>" in found._repr_html_()
    assert "undecided" in repr(does_switching_help(ModeSet([[[1.5]], [[2.0]]])))
