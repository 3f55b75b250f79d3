"""Property tests on random plants: how they are drawn, and how many."""

import math
from functools import wraps

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

from switchctl import Constant, Gaussian, ModeSet, PointwiseMinimum, RecedingHorizon, Rollout


def examples(count, n=(1, 6), m=(1, 4), **drawn):
    """A slow test of so many random sizes and seeds, the same ones every time, not one of which may be passed over."""

    def decorate(test):
        tried = []

        @wraps(test)
        def counting(*arguments, **keywords):
            test(*arguments, **keywords)
            tried.append(1)

        given_examples = given(n=st.integers(*n), m=st.integers(*m), seed=st.integers(0, 2**32 - 1), **drawn)
        check = settings(
            max_examples=count,
            derandomize=True,
            deadline=None,
            database=None,
            phases=[Phase.generate, Phase.shrink],
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.differing_executors],
        )(given_examples(counting))

        @wraps(check)
        def run(*arguments, **keywords):
            tried.clear()
            check(*arguments, **keywords)
            assert len(tried) >= count

        run.tries = count
        return pytest.mark.slow(run)

    return decorate


def number_of_examples(*modules):
    """How many examples the property tests of some modules try in all."""
    total = 0
    for test in (thing for module in modules for thing in vars(module).values() if hasattr(thing, "tries")):
        cases = [len(mark.args[1]) for mark in test.pytestmark if mark.name == "parametrize"]
        total += test.tries * math.prod(cases)
    return total


def weights(rng, n, m):
    """The identity, one weight, or a weight for each mode, some of them singular."""
    kind = rng.integers(4)
    roots = rng.standard_normal((m, n, n if kind < 3 else rng.integers(1, n + 1)))
    Q = roots @ np.swapaxes(roots, 1, 2)
    return [None, Q[0], Q, Q][kind]


def plant(n, m, seed, radius=(0.3, 0.98), Q=weights, **keywords):
    """Schur modes with weights, a state that may be known exactly or have no mean, and the generator."""
    rng = np.random.default_rng([n, m, seed])
    modes = ModeSet(random_modes(rng, n, m, radius), Q=Q(rng, n, m) if callable(Q) else Q, **keywords)
    x0 = random_gaussian(rng, n)
    x0 = Gaussian(x0.mean * (rng.random() < 0.8), x0.cov) if rng.random() < 0.8 else Gaussian(x0.mean, 0 * x0.cov)
    return modes, x0, rng


def full_plant(n, m, seed, **keywords):
    """A plant with whatever else modes may have, each at random: controllers' states, takeovers, noise, costs."""
    rng = np.random.default_rng([7, n, m, seed])
    p = int(rng.integers(1, n + 1))
    E = np.tile(np.eye(n), (m, m, 1, 1))
    for j, i in np.argwhere(~np.eye(m, dtype=bool)):
        E[j, i] = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.7)
    roots = rng.standard_normal((m, n, rng.integers(1, n + 1)))
    noisy = rng.random() < 0.5
    told = {
        "names": [f"mode {i}, é" for i in range(m)],
        "dt": float(rng.choice([0.1, 0.25])) if rng.random() < 0.5 else True,
        "Q": weights(rng, n, m),
        "gains": rng.standard_normal((m, 2, n)) if rng.random() < 0.5 else None,
        "states": [f"s{k}" for k in range(n)] if rng.random() < 0.5 else None,
        "plant_states": p,
        "activation": E if rng.random() < 0.5 else None,
        "initial": np.vstack([np.eye(p), rng.standard_normal((n - p, p))]) if rng.random() < 0.5 else None,
        "estimate_states": p if 2 * p <= n and rng.random() < 0.5 else 0,
        "W": roots @ np.swapaxes(roots, 1, 2) / 10 if noisy else None,
        "offset": rng.exponential(0.1, m) if noisy and rng.random() < 0.5 else None,
        "cost": ("discounted", float(rng.uniform(0.5, 0.99))) if noisy or rng.random() < 0.3 else "total",
    }
    modes = ModeSet(random_modes(rng, n, m, (0.2, 0.9)), **told | keywords)
    return modes, random_gaussian(rng, n), rng


def rotation(rng, n):
    """An orthogonal matrix."""
    return np.linalg.qr(rng.standard_normal((n, n)))[0]


def in_coordinates(modes, x0, T, T_inverse):
    """The same plant in the coordinates T x."""
    turned = ModeSet(T @ modes.A @ T_inverse, dt=modes.dt, Q=T_inverse.T @ modes.Q @ T_inverse)
    return turned, Gaussian(T @ x0.mean, T @ x0.cov @ T.T)


DECIDING = [
    Constant(0),
    PointwiseMinimum(),
    RecedingHorizon(6),
    RecedingHorizon(4, hold=3),
    RecedingHorizon(math.inf, hold=2),
    Rollout(),
]


def criteria(method, modes):
    """What each choice costs, as quadratics of the state, straight from the definition: shape (m, ways, n, n)."""
    n, eye = modes.A.shape[-1], np.eye(modes.A.shape[-1] ** 2)
    A, Q, At = modes.A, modes.Q, np.swapaxes(modes.A, 1, 2)
    P = [np.linalg.solve(eye - np.kron(a.T, a.T), q.ravel()).reshape(n, n) for a, q in zip(A, Q, strict=True)]
    if isinstance(method, Rollout):
        return Q[:, None] + At[:, None] @ np.array(P)[None] @ A[:, None]
    if isinstance(method, RecedingHorizon) and method.horizon == math.inf:
        return np.array(P)[:, None]
    G = Q
    for _ in range(1 if isinstance(method, PointwiseMinimum) else method.horizon):
        G = Q + At @ G @ A
    return G[:, None]


def least_margin(method, modes, x0, sequence):
    """How much the next best mode costs more, as a fraction, where a choice along the run is closest."""
    if isinstance(method, Constant) or len(modes) == 1:
        return math.inf
    C, S, least = criteria(method, modes), np.outer(x0.mean, x0.mean) + x0.cov, math.inf
    for k, mode in enumerate(sequence):
        if k % getattr(method, "hold", 1) == 0:
            first, second = np.sort(np.tensordot(C, S).min(axis=1))[:2]
            least = min(least, (second - first) / first)
        S = modes.A[mode] @ S @ modes.A[mode].T
    return least
