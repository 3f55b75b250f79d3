"""The moves among which stability is decided: a switching graph with its forced steps taken together, and its lifts."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from switchctl.graph import SwitchingGraph
from switchctl.modes import ModeSet
from switchctl.moments import Array

Indices = NDArray[np.intp]
Rounded = tuple[Array, Array]  # a matrix, and by how much rounding may have moved its entries
LEAST = 1e-290  # a norm below this may be that of a product that vanished by rounding
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Moves:
    """Moves ``x+ = A_e x`` from node to node, each by a word of modes.

    Parameters
    ----------
    places : tuple of int
        The node of the switching graph behind each node.
    tail, head : int arrays, shape (E,)
        The nodes that each move leaves and enters.
    A : array, shape (E, n, n)
        The product of its steps.
    words : tuple of E tuples of int
        Its modes.
    lengths : array, shape (E,)
        What it counts; its steps, as a rule.
    wrong : array, shape (E, n, n)
        By how much rounding may have moved each entry of A.
    """

    places: tuple[int, ...]
    tail: Indices
    head: Indices
    A: Array
    words: tuple[tuple[int, ...], ...]
    lengths: Array
    wrong: Array

    @classmethod
    def of(cls, graph: SwitchingGraph) -> "Moves":
        """The moves of a graph between the nodes where there is a choice, of every part that a run can stay in."""
        kept = _choices(graph)
        number = {v: k for k, v in enumerate(kept)}
        tail, head, words, A, wrong = [], [], [], [], []
        for v in kept:
            for mode in np.flatnonzero(graph.successor[v] >= 0).tolist():
                product, at = exactly(np.eye(graph.modes.A.shape[-1])), v
                word: list[int] = []
                while not word or at not in number:
                    mode = int(graph.successor[at].argmax()) if word else mode
                    product = multiplied(exactly(graph.modes.A_after[graph.last_mode[at], mode]), product)
                    word.append(mode)
                    at = int(graph.successor[at, mode])
                tail.append(number[v])
                head.append(number[at])
                words.append(tuple(word))
                A.append(product[0])
                wrong.append(product[1] if len(word) > 1 else np.zeros_like(product[1]))
        lengths = np.array([len(word) for word in words], dtype=float)
        moves = cls(tuple(kept), np.array(tail), np.array(head), np.array(A), tuple(words), lengths, np.array(wrong))
        part = moves.parts
        return moves.of_edges(np.flatnonzero(part[moves.tail] == part[moves.head]))

    @classmethod
    def with_dwell(cls, modes: ModeSet, dwell: Sequence[int]) -> "Moves":
        """The moves where every mode is held for its dwell time: a step on, or a switch and all that it entails.

        A node is the mode that has been held long enough.
        """
        pairs = np.array(list(np.ndindex(len(modes), len(modes))))
        words = tuple((j,) * (1 if i == j else dwell[j]) for i, j in pairs.tolist())
        first = [exactly(modes.A_after[i, j]) for i, j in pairs.tolist()]
        powers = [power(exactly(A), d - 1) if d > 1 else None for A, d in zip(modes.A, dwell, strict=True)]
        products = [
            step if i == j or after is None else multiplied(after, step)
            for (i, j), step, after in zip(pairs.tolist(), first, powers * len(modes), strict=True)
        ]
        A, wrong = (np.array(part) for part in zip(*products, strict=True))
        lengths = np.array([len(word) for word in words], dtype=float)
        return cls(tuple(range(len(modes))), pairs[:, 0], pairs[:, 1], A, words, lengths, wrong)

    def __len__(self) -> int:
        return len(self.places)

    @property
    def parts(self) -> Indices:
        """The strongly connected component of each node; none is left for one with a smaller number."""
        V = len(self)
        links = csr_array((np.ones(len(self.tail)), (self.tail, self.head)), shape=(V, V))
        return np.asarray(connected_components(links, connection="strong")[1], dtype=np.intp)

    def of_edges(self, edges: Indices) -> "Moves":
        """Only these moves, and the nodes on them."""
        kept = np.unique(np.concatenate([self.tail[edges], self.head[edges]]))
        new = np.full(len(self), -1)
        new[kept] = np.arange(len(kept))
        places, words = tuple(self.places[v] for v in kept), tuple(self.words[e] for e in edges)
        tail, head = new[self.tail[edges]], new[self.head[edges]]
        return Moves(places, tail, head, self.A[edges], words, self.lengths[edges], self.wrong[edges])

    def components(self) -> Iterator["Moves"]:
        """The strongly connected components, one by one."""
        part = self.parts
        for number in np.unique(part[self.tail]):
            yield self.of_edges(np.flatnonzero(part[self.tail] == number))

    def seen_in(self, P: Array, gamma: float) -> "Moves":
        """The moves divided by ``gamma ** steps``, in states whose Euclidean norms are ``x' P x`` at each node."""
        T = np.swapaxes(np.linalg.cholesky(P), -1, -2)
        back = np.linalg.inv(T)[self.tail]
        noise = 8 * T.shape[-1] * _EPS
        with np.errstate(over="ignore", invalid="ignore"):
            wrong = np.abs(T[self.head]) @ (noise * np.abs(self.A) + self.wrong) @ np.abs(back)
            return replace(self, A=T[self.head] @ self.A @ back, wrong=wrong).divided(gamma)

    def divided(self, gamma: float) -> "Moves":
        """The moves divided by ``gamma ** steps``."""
        with np.errstate(over="ignore", invalid="ignore"):
            by = gamma ** self.lengths[:, None, None]
            A, wrong = self.A / by, (self.wrong + 2 * _EPS * np.abs(self.A)) / by
        return replace(self, A=A, wrong=np.where((wrong == 0) & (self.A != 0), LEAST, wrong))

    def balanced(self) -> tuple["Moves", Array]:
        """The same in units of the states, powers of two, in which rows and columns are of one size; and the units."""
        with np.errstate(invalid="ignore"):  # of permutations, of which there are none
            unit: Array = matrix_balance(np.abs(self.A).sum(axis=0), permute=False, separate=True)[1][0]
        return replace(self, A=self.A * unit / unit[:, None], wrong=self.wrong * unit / unit[:, None]), unit

    def held(self, times: Iterable[int]) -> "Moves":
        """With moves that come back to their node also taken so many times at once."""
        e = np.flatnonzero(self.tail == self.head)
        parts = [self]
        for count in times:
            (A, wrong), words = power((self.A[e], self.wrong[e]), count), tuple(self.words[i] * count for i in e)
            lengths = self.lengths[e] * count
            parts.append(Moves(self.places, self.tail[e], self.head[e], A, words, lengths, wrong))
        tail, head, A, lengths, wrong = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("tail", "head", "A", "lengths", "wrong")
        )
        return Moves(self.places, tail, head, A, sum((part.words for part in parts), ()), lengths, wrong)

    def lifted(self) -> "Moves":
        """The same runs, with nodes that also remember the last move: the line graph."""
        pairs = [(e, f) for e in range(len(self.tail)) for f in np.flatnonzero(self.tail == self.head[e]).tolist()]
        before, after = (np.array(side, dtype=np.intp) for side in zip(*pairs, strict=True))
        places = tuple(self.places[v] for v in self.head)
        words = tuple(self.words[f] for f in after)
        return Moves(places, before, after, self.A[after], words, self.lengths[after], self.wrong[after])


def exactly(A: Array) -> Rounded:
    """A matrix that is not rounded."""
    return A, np.zeros_like(A)


def multiplied(left: Rounded, right: Rounded) -> Rounded:
    """The product of matrices (or stacks of them), each with a bound of the errors of its entries, and the product's.

    Parameters
    ----------
    left, right : pairs of arrays, shape (..., n, n)
        The matrices and the bounds.

    Returns
    -------
    pair of arrays, shape (..., n, n)
    """
    (A, a), (B, b) = left, right
    with np.errstate(over="ignore", invalid="ignore"):
        return A @ B, np.abs(A) @ b + a @ (np.abs(B) + b) + 0.51 * A.shape[-1] * _EPS * (np.abs(A) @ np.abs(B))


def power(A: Rounded, count: int) -> Rounded:
    """A power of a matrix, or of each of a stack, at least the first, with a bound of its errors."""
    found = A
    for bit in bin(count)[3:]:
        found = multiplied(found, found)
        found = multiplied(A, found) if bit == "1" else found
    return found


def _choices(graph: SwitchingGraph) -> list[int]:
    """The nodes with a choice, and one on every way that goes round without."""
    allowed = graph.successor >= 0
    kept = set(np.flatnonzero(allowed.sum(axis=1) > 1).tolist())
    passed: set[int] = set()
    for v in range(len(graph)):
        way: list[int] = []
        while v not in kept and v not in passed:
            passed.add(v)
            way.append(v)
            v = int(graph.successor[v].max())
        if v in way:
            kept.add(v)
    return sorted(kept)
