"""What each mode costs over a horizon, from a node of the switching graph."""

import math
from collections.abc import Iterator
from functools import cached_property
from itertools import chain, cycle, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.continuation import as_rows
from switchctl.gramians import Block, affine_gramians, regrouped_gramians
from switchctl.methods.base import InfiniteCostError, Scheduler
from switchctl.methods.constant import require_schur
from switchctl.moments import Array, transform
from switchctl.storage import affordable
from switchctl.values import Value, switched

_TABLES = 1024
_ACCURACY = 1e-3  # by how much two ways of adding a horizon's costs up may differ; it is about the error of each


class Candidates(NamedTuple):
    """What an update may choose from: row r dotted with svec(S), plus its constant, is what plan r costs.

    A plan is the modes until the next update; it is shorter than a hold where the rules end it sooner.
    """

    rows: Array
    constants: Array
    plans: list[list[int]]


class HorizonCosts:
    """The candidates of a receding horizon, by node and horizon.

    Parameters
    ----------
    scheduler : Scheduler
        Whose graph and ways to go on for ever they are.
    hold : int
        Steps between updates.
    """

    def __init__(self, scheduler: Scheduler, hold: int) -> None:
        self.scheduler, self.graph, self.hold = scheduler, scheduler.graph, hold
        self.blocks: dict[int, Block] = {}
        self.candidates: dict[tuple[int, int | float], Candidates] = {}

    def at(self, node: int, T: int | float) -> Candidates:
        """The candidates at a node for the horizon T."""
        if (node, T) not in self.candidates:
            if len(self.candidates) == _TABLES:  # a horizon that keeps changing must not fill the memory
                self.candidates.clear()
                self.blocks.clear()
            self.candidates[node, T] = self._for_ever(node) if T == math.inf else self._over(node, int(T))
        return self.candidates[node, T]

    def _for_ever(self, node: int) -> Candidates:
        """Every way to go on at finite cost."""
        if self.graph.free:
            require_schur(self.graph.modes, "an infinite horizon")
        ways = self.scheduler.continuations
        numbers, rows, constants = ways.table(node)
        if not numbers:
            raise InfiniteCostError(
                f"an infinite horizon needs a way to go on at finite cost; under {self.graph.rules!r} none was found"
            )
        paths = (ways.path(node, number) for number in numbers)
        return Candidates(rows, constants, [list(islice(chain(lead, cycle(word)), self.hold)) for lead, word in paths])

    def _over(self, node: int, T: int) -> Candidates:
        """Every mode held over ``k = 0 .. T``, or as long as the rules allow and then another that they allow."""
        graph = self.graph
        values, plans = [], []
        for i, h, j in self._holds(node, T):
            rest = None
            if j is None:
                plans.append([i] * int(min(graph.holds[node, i], self.hold)))
            else:
                then = int(graph.walk([i] * h, node)[-1])
                rest = switched(graph, then, j, self._held(j, T + 1 - h))
                plans.append(([i] * h + [j] * int(min(graph.holds[then, j], self.hold)))[: self.hold])
            values.append(switched(graph, node, i, self._held(i, h, rest)))
        return Candidates(*as_rows(graph, values), plans)

    def _holds(self, node: int, T: int) -> Iterator[tuple[int, int, int | None]]:
        """A mode, the steps for which it is held, and the mode that follows; None where it fills the horizon."""
        graph = self.graph
        for i in np.flatnonzero(self.moves[node]).tolist():
            h = int(min(graph.holds[node, i], T + 1))
            if h == T + 1:
                yield i, h, None
                continue
            for j in np.flatnonzero(self.moves[int(graph.walk([i] * h, node)[-1])]).tolist():
                yield i, h, j

    def plans(self, node: int, T: int | float) -> list[list[int]]:
        """The modes of each candidate over ``k = 0 .. T``, as far as the rules allow them."""
        if T == math.inf:
            raise ValueError("a target needs a finite horizon: the distance to it doesn't add up to a finite cost")
        graph, found = self.graph, []
        n, m = graph.modes.A.shape[-1], len(graph.modes)
        size = 8.0 * m * (T + 1) * (n * (n + 1) + 2)
        affordable(size, f"the plans over a horizon of {T} steps", "with a target choose a shorter horizon")
        for i, h, j in self._holds(node, int(T)):
            then = int(graph.walk([i] * h, node)[-1])
            found.append([i] * h + ([] if j is None else [j] * int(min(graph.holds[then, j], T + 1 - h))))
        return found

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """Which modes may be chosen at each node: where there is a way on at finite cost, those that keep one."""
        heads = self.graph.successor
        if self.graph.free:
            return heads >= 0
        reaching: NDArray[np.bool_] = np.logical_or.reduce(self.scheduler.continuations.finite)
        lasting = (heads >= 0) & reaching[heads]
        return np.where(lasting.any(axis=1)[:, None], lasting, heads >= 0)

    def _block(self, steps: int) -> Block:
        """So many steps of each mode; an error where rounding hides what they cost."""
        modes = self.graph.modes
        with np.errstate(over="ignore", invalid="ignore"):
            block = affine_gramians(modes.A, modes.Q, modes.W, self.graph.price + modes.offset, modes.discount, steps)
            again = regrouped_gramians(np.sqrt(modes.discount) * modes.A, modes.Q, steps)
            costs, difference = (np.diagonal(G, axis1=-2, axis2=-1) for G in (block.G, np.abs(block.G - again)))
            hidden = np.flatnonzero((difference > _ACCURACY * costs).any(axis=-1))
        if hidden.size:
            raise np.linalg.LinAlgError(
                f"rounding hides what mode {modes.names[hidden[0]]!r} costs over a horizon of {steps - 1} steps, for "
                "its powers grow so much before they shrink; rescale the states, or choose a shorter horizon"
            )
        return block

    def _held(self, mode: int, steps: int, after: Value | None = None) -> Value:
        """What a mode costs over some steps, and then perhaps something of known value."""
        modes = self.graph.modes
        if steps not in self.blocks:
            self.blocks[steps] = self._block(steps)
        block = self.blocks[steps]
        P, paid = block.G[mode], float(block.constant[mode])
        if after is not None:
            P = P + transform(block.A[mode], after.P)
            paid += float(np.sum(after.P * block.W[mode]) + modes.discount**steps * after.constant)
        if not np.isfinite(P).all():
            raise ValueError(
                f"the cost of mode {modes.names[mode]!r} over a horizon of {steps - 1} steps exceeds the "
                f"floating-point range (spectral radius {modes[mode].spectral_radius:.6g}); choose a shorter "
                "horizon, or leave that mode out"
            )
        return Value(P, paid)
