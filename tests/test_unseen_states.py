"""States that the cost doesn't see, noise in the kernel, and blocks of steps: against plain sums."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov

from switchctl import FewSwitches, Gaussian, ModeSet, Optimal, RecedingHorizon, Refine, Rollout, schedule
from switchctl.gramians import affine_gramians, seen, tail
from switchctl.moments import moment_factor, stepped
from switchctl.sampling import exact_step
from switchctl.schur import is_schur


def hidden(rng, n, unseen, radius=1.5):
    """A mode whose last states move nothing that is weighed, and may grow."""
    A = rng.standard_normal((n + unseen, n + unseen))
    A[:n, n:] = 0.0
    A[:n, :n] *= rng.uniform(0.3, 0.95) / np.abs(np.linalg.eigvals(A[:n, :n])).max()
    if unseen:
        A[n:, n:] *= radius / np.abs(np.linalg.eigvals(A[n:, n:])).max()
    root = rng.standard_normal((n, n))
    Q = np.zeros_like(A)
    Q[:n, :n] = root @ root.T
    return A, Q


def test_the_cost_for_ever_is_that_of_the_states_that_are_seen():
    rng = np.random.default_rng(0)
    for _ in range(200):
        n, unseen = int(rng.integers(1, 5)), int(rng.integers(0, 4))
        A, Q = hidden(rng, n, unseen, rng.choice([0.5, 1.0, 1.5]))
        order = rng.permutation(n + unseen)
        mixed = np.ix_(order, order)
        P, kept = tail(A[mixed], Q[mixed]), np.argsort(order)
        P = P[np.ix_(kept, kept)]
        np.testing.assert_allclose(P[:n, :n], solve_discrete_lyapunov(A[:n, :n].T, Q[:n, :n], "direct"), rtol=1e-6)
        assert not P[n:].any() and not P[:, n:].any()
        assert (seen(A, Q) == (np.arange(n + unseen) < n)).all()


def test_a_state_that_moves_a_weighed_one_late_is_seen():
    A = np.diag(np.ones(3), 1)  # 3 -> 2 -> 1 -> 0
    A[3, 3] = 1.0
    assert seen(A, np.diag([1.0, 0, 0, 0])).all()
    assert tail(A, np.diag([1.0, 0, 0, 0])) is None
    assert tail(np.eye(2), np.zeros((2, 2))).tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert not is_schur(np.eye(2))


def test_methods_on_modes_that_are_not_schur_where_nobody_looks():
    rng = np.random.default_rng(1)
    for _ in range(10):
        pairs = [hidden(rng, 2, 1, 1.0) for _ in range(2)]
        whole = ModeSet([A for A, _ in pairs], Q=[Q for _, Q in pairs], plant_states=2)
        part = ModeSet([A[:2, :2] for A, _ in pairs], Q=[Q[:2, :2] for _, Q in pairs])
        x0 = Gaussian([1.0, -1.0, 5.0], np.diag([0.1, 0.2, 0.3]))
        seen_alone = Gaussian([1.0, -1.0], np.diag([0.1, 0.2]))
        assert not whole.schur.all()
        for method in (Rollout(), Refine(), FewSwitches(1), RecedingHorizon(np.inf), RecedingHorizon(4)):
            ours, theirs = (schedule(m, x, method, 30) for m, x in ((whole, x0), (part, seen_alone)))
            assert ours.cost == pytest.approx(theirs.cost, rel=1e-9)
            np.testing.assert_allclose(ours.w2, theirs.w2, rtol=1e-6, atol=1e-9 * theirs.w2[0])
        best, known = schedule(whole, x0, Optimal(gap=0.05, time_limit=10)), schedule(part, seen_alone, Optimal(1e-6))
        assert best.lower_bound <= known.cost * (1 + 1e-9)
        assert best.cost >= known.lower_bound * (1 - 1e-9)
        assert best.gap <= 0.05


def test_blocks_of_steps():
    rng = np.random.default_rng(2)
    for discount in (1.0, 0.9):
        A, roots = 0.6 * rng.standard_normal((2, 3, 3)), rng.standard_normal((2, 2, 3, 3))
        Q, W = roots @ np.swapaxes(roots, -1, -2)
        price, S0 = rng.random(2), np.cov(rng.standard_normal((3, 9)))
        for steps in (1, 2, 3, 7, 20):
            block = affine_gramians(A, Q, W, price, discount, steps)
            for i in range(2):
                S, cost = S0, 0.0
                for k in range(steps):
                    cost += discount**k * (np.vdot(Q[i], S) + price[i])
                    S = A[i] @ S @ A[i].T + W[i]
                found = np.vdot(block.G[i], S0) + block.constant[i]
                assert found == pytest.approx(cost, rel=1e-12)
                np.testing.assert_allclose(block.A[i] @ S0 @ block.A[i].T + block.W[i], discount**steps * S, rtol=1e-11)


def test_a_step_of_a_factor_with_noise():
    rng = np.random.default_rng(3)
    A, root = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    mean, cov = rng.standard_normal(3), np.cov(rng.standard_normal((3, 9)))
    F = stepped(moment_factor(mean, cov), A, root)
    np.testing.assert_allclose(F[:, 0], A @ mean)
    np.testing.assert_allclose(F[:, 1:] @ F[:, 1:].T, A @ cov @ A.T + root @ root.T)
    assert F.shape == (3, 4)


def test_sampling_keeps_zeros():
    rng = np.random.default_rng(4)
    A = 5 * rng.standard_normal((7, 7))
    A[:3, 3:] = 0.0
    A[3:5, 5:] = 0.0
    order = rng.permutation(7)
    step = exact_step(A[np.ix_(order, order)], 0.3)[np.ix_(np.argsort(order), np.argsort(order))]
    np.testing.assert_allclose(step, expm(0.3 * A), atol=1e-12 * np.abs(step).max())
    assert not step[:3, 3:].any() and not step[3:5, 5:].any()
