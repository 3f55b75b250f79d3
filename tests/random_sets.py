"""Random sets of matrices of every kind, free or under rules."""

import numpy as np
from random_rules import allowed, budget, budget_window, max_dwell, min_dwell, several, transitions

from switchctl import ModeSet, Rules, SwitchingGraph

KINDS = (
    "gaussian", "integer", "nilpotent", "commuting", "orthogonal", "triangular", "singular", "scaled", "marginal",
    "sparse",
)  # fmt: skip
RULES = (min_dwell, max_dwell, transitions, budget, allowed, budget_window, several)


def random_set(seed):
    """Up to four matrices of up to four states."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 5, 2)
    kind = KINDS[rng.integers(len(KINDS))]
    A = rng.standard_normal((m, n, n))
    if kind == "integer":
        A = rng.integers(-3, 4, (m, n, n)).astype(float)
    elif kind == "nilpotent":
        A = np.triu(A, 1)
    elif kind == "commuting":
        V = rng.standard_normal((n, n)) + 3 * np.eye(n)
        A = V @ (np.eye(n) * rng.standard_normal((m, n, 1))) @ np.linalg.inv(V)
    elif kind == "orthogonal":
        A = np.linalg.qr(A)[0]
    elif kind == "triangular":
        A = np.triu(A)
    elif kind == "singular":
        A[:, :, 0] = A[:, :, -1] * (n > 1)
    elif kind == "scaled":
        scale = 10.0 ** rng.uniform(-3, 3, n)
        A = A * scale[:, None] / scale
    elif kind == "marginal":
        A = A / np.maximum(1e-9, np.abs(np.linalg.eigvals(A)).max(axis=1))[:, None, None]
    elif kind == "sparse":
        A = (rng.random((m, n, n)) < 0.35).astype(float)
    return kind, A


def random_graph(seed):
    """Such matrices, some of which change the state when they take over, in an automaton or under rules."""
    rng = np.random.default_rng([1, seed])
    _, A = random_set([2, seed])
    m, n = A.shape[:2]
    activation = None
    if rng.random() < 0.4:
        activation = np.tile(np.eye(n), (m, m, 1, 1))
        for j, i in np.argwhere(~np.eye(m, dtype=bool)):
            activation[j, i] = rng.standard_normal((n, n))
    modes = ModeSet(A, activation=activation)
    for _ in range(30):
        rule = rng.integers(len(RULES) + 3)
        try:
            if rule < len(RULES):
                return SwitchingGraph(modes, Rules(**RULES[rule](rng, m)))
            V = rng.integers(1, 7)
            edges = [(v, int(rng.integers(V)), i) for v in range(V) for i in range(m) if rng.random() < 0.5]
            if edges:
                return SwitchingGraph.from_edges(modes, edges)
        except ValueError:  # rules that contradict each other, or say nothing
            continue
    return SwitchingGraph(modes)
