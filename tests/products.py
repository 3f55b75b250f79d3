"""Products of matrices along runs, by brute force: an independent view of growth."""

import numpy as np


def radius(M):
    return float(np.abs(np.linalg.eigvals(M)).max())


def free(A):
    """Moves of arbitrary switching: (tail, head, matrix, mode)."""
    return [(0, 0, M, i) for i, M in enumerate(A)]


def moves_of(graph):
    """The moves of a graph, from its successors and the modes alone."""
    modes = graph.modes
    return [
        (v, int(graph.successor[v, i]), step(modes, int(graph.last_mode[v]), int(i)), int(i))
        for v, i in np.argwhere(graph.successor >= 0).tolist()
    ]


def step(modes, before, mode):
    """The matrix of a step in a mode after another (-1: none)."""
    if modes.activation is None or before < 0 or before == mode:
        return modes.A[mode]
    return modes.A[mode] @ modes.activation[before, mode]


def greatest_growth(moves, longest, most=200_000):
    """The greatest rho(M)^(1/k) of a cycle, and the least of the greatest norms^(1/k), over all runs up to a length."""
    tail, head = (np.array([move[i] for move in moves]) for i in range(2))
    A = np.array([move[2] for move in moves])
    after = {v: np.flatnonzero(tail == v) for v in set(head.tolist()) | set(tail.tolist())}
    start, end, products = tail, head, A
    lower, upper = 0.0, np.inf
    for k in range(1, longest + 1):
        closed = start == end
        if closed.any():
            lower = max(lower, float(np.abs(np.linalg.eigvals(products[closed])).max()) ** (1 / k))
        norms = np.linalg.norm(products, 2, axis=(1, 2))
        upper = min(upper, float(norms.max()) ** (1 / k))
        ways = [after[v] for v in end.tolist()]
        if sum(map(len, ways)) > most or not sum(map(len, ways)):
            break
        parent, edge = np.repeat(np.arange(len(end)), [len(way) for way in ways]), np.concatenate(ways)
        start, end, products = start[parent], head[edge], A[edge] @ products[parent]
    return lower, upper


def product_of(modes, word):
    """The product of a word repeated for ever, its first step after its last mode."""
    M = np.eye(modes.A.shape[-1])
    for before, mode in zip(word[-1:] + word[:-1], word, strict=True):
        M = step(modes, before, mode) @ M
    return M


def shortest_hold(word):
    """How long each mode of a word repeated for ever is held at least; nothing for one that never switches."""
    if len(set(word)) == 1:
        return {}
    shift = next(k for k in range(len(word)) if word[k] != word[k - 1])
    word, held = word[shift:] + word[:shift], {}
    count = 0
    for mode, following in zip(word, word[1:] + word[:1], strict=True):
        count += 1
        if mode != following:
            held[mode], count = min(count, held.get(mode, count)), 0
    return held
