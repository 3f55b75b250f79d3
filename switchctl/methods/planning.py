"""Schedulers that plan the whole run at its first sample, and then follow the plan."""

from abc import abstractmethod
from collections.abc import Sequence

from switchctl.continuation import shortest
from switchctl.methods.base import Scheduler
from switchctl.moments import Array

Plan = tuple[tuple[int, ...], tuple[int, ...]]
"""The modes taken once, and those repeated for ever after."""


class PlanningScheduler(Scheduler):
    """A scheduler that plans once, for the moments of its first sample, and doesn't look at later ones."""

    @abstractmethod
    def search(self, S: Array) -> Plan:
        """Plan a run from the start of the graph.

        Parameters
        ----------
        S : array, shape (n, n)
            The second moment at the start.

        Returns
        -------
        lead, word : tuples of int
            The modes taken once, and those repeated for ever after.
        """

    def forget(self) -> None:  # noqa: D102
        self.plan: Plan | None = None
        self.k = 0

    def recover(self, sequence: Sequence[int]) -> None:  # noqa: D102
        super().recover(sequence)
        self.k = len(sequence)

    def decide(self, S: Array) -> int:  # noqa: D102
        if self.plan is None:
            self.plan = self.search(S)
        lead, word = self.plan
        k, self.k = self.k, self.k + 1
        return lead[k] if k < len(lead) else word[(k - len(lead)) % len(word)]

    def tail(self, S: Array) -> Plan:  # noqa: D102
        assert self.plan is not None  # a schedule has a step
        lead, word = self.plan
        turn = max(self.k - len(lead), 0) % len(word)
        return shortest(lead[self.k :], word[turn:] + word[:turn])
