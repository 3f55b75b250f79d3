"""Prefixes of a run under search: those still open, and the tree of the moves that led to them."""

import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array

Indices = NDArray[np.intp]
_LARGE = 1_000_000


class Stack:
    """Prefixes that end at one choice: their moments, costs and places in the tree, contiguous, last in first out."""

    def __init__(self, d: int) -> None:
        self.moments, self.costs, self.places = np.empty((0, d)), np.empty(0), np.empty(0, dtype=np.int64)
        self.count = 0

    def push(self, moments: Array, costs: Array, places: Indices) -> None:
        """Put prefixes on top."""
        old, self.count = self.count, self.count + len(costs)
        if self.count > len(self.costs):
            room = max(self.count, 2 * len(self.costs), 256)
            for name in ("moments", "costs", "places"):
                held = getattr(self, name)
                grown = np.empty((room, *held.shape[1:]), held.dtype)
                grown[:old] = held[:old]
                setattr(self, name, grown)
        self.moments[old : self.count], self.costs[old : self.count] = moments, costs
        self.places[old : self.count] = places

    def pop(self, most: int) -> tuple[Array, Array, Indices]:
        """Take so many off the top, at most."""
        begin, end = max(self.count - most, 0), self.count
        self.count = begin
        if len(self.costs) > _LARGE and self.count < len(self.costs) // 8:  # give memory back
            for name in ("moments", "costs", "places"):
                setattr(self, name, getattr(self, name)[: len(self.costs) // 2].copy())
        return self.moments[begin:end].copy(), self.costs[begin:end].copy(), self.places[begin:end].copy()

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self.moments.nbytes + self.costs.nbytes + self.places.nbytes


class Tree:
    """The moves that led to each prefix: for each its parent and the number of its last move."""

    def __init__(self) -> None:
        self.parent, self.number = np.full(1024, -1, dtype=np.int64), np.zeros(1024, dtype=np.int16)
        self.count = 1  # the root

    def add(self, parents: Indices, number: int) -> Indices:
        """Add one prefix for each parent."""
        old, self.count = self.count, self.count + len(parents)
        if self.count > len(self.parent):
            room = max(self.count, 2 * len(self.parent))
            self.parent, self.number = np.resize(self.parent, room), np.resize(self.number, room)
        self.parent[old : self.count], self.number[old : self.count] = parents, number
        return np.arange(old, self.count)

    def path(self, place: int) -> list[int]:
        """The numbers of the moves to a prefix."""
        numbers = []
        while place > 0:
            numbers.append(int(self.number[place]))
            place = int(self.parent[place])
        return numbers[::-1]

    def keep(self, stacks: list[Stack]) -> None:
        """Drop what leads to no prefix still on a stack."""
        needed = np.zeros(self.count, dtype=bool)
        needed[0] = True
        front = np.unique(np.concatenate([stack.places[: stack.count] for stack in stacks]))
        while len(front):
            front = front[~needed[front]]
            needed[front] = True
            front = np.unique(self.parent[front])
        place = np.cumsum(needed) - 1
        kept = np.flatnonzero(needed)
        parent = self.parent[kept]
        parent[1:] = place[parent[1:]]
        self.parent, self.number, self.count = parent, self.number[kept], len(kept)
        for stack in stacks:
            stack.places[: stack.count] = place[stack.places[: stack.count]]
