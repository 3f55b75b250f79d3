"""Lower bounds on what goes on from a choice: quadratics that a step never beats.

If ``L_v <= Q_e + A_e' L_w A_e`` on every move e from v to w, then every run from v costs at least ``tr(L_v S)``,
provided that ``tr(L_v S)`` comes to nothing along a run of finite cost. It does where some ``M > 0`` is below the cost
of so many steps, whatever they are: the least stage weight, or a minorant of several steps where the weights are
singular. Where there is none, since a mode may be blind to some state for ever (that of a controller which does not
act), ``L_v <= C`` is asked for too, C a multiple of the least stage weight. L need not be definite, and is not where
modes chatter.
"""

import time
from functools import reduce

import numpy as np

from switchctl.moments import Array, smat, svec
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.minorants import below, definite_minorant, lower_bounds, minorant
from switchctl.optimum.programs import Program

VARIABLES = 3000
"""Beyond so many unknowns, or STATES states, one L serves all choices, or none is solved for."""
STATES = 25
_DEFINITE = 1e-10
_SEEN = 1e-9


class LowerBounds:
    """A bank of lower bounds at every choice, which grows where the search asks for it.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves.
    reference : array, shape (n, n)
        A cost matrix of about the size of the bounds, positive definite: the units of the programs.
    terminal : array, shape (n, n), optional
        The cost of the state at the end of a run that ends, in scaled states.

    Attributes
    ----------
    least : array, shape (n, n)
        Below every stage weight.
    definite : bool
        Whether it is positive definite.
    count : int
        How many bounds there are at each choice.
    guard : float
        No bound is below ``-guard`` times the identity.
    seconds : float
        The time spent on programs.
    """

    def __init__(self, decisions: Decisions, reference: Array, terminal: Array | None = None) -> None:
        self.decisions, self.reference, self.terminal = decisions, reference, terminal
        self.least = decisions.Q[0]
        for Q in decisions.Q[1:]:
            self.least = self.least if np.array_equal(Q, self.least) else minorant(self.least, Q)
        self.definite = _definite(self.least)
        few = decisions.n <= STATES
        self.per_choice = few and decisions.reachable(VARIABLES // len(decisions.identity))
        self.seconds, self.count = 0.0, 0
        self._bank: list[Array] = []  # (choices or 1, d) each
        self._chain: list[Array] = []  # by the steps taken
        self._ceiling: Array | None = None
        vanishes = self.definite
        if terminal is not None and not (self.per_choice and self.definite):
            self._chain = self._backwards(terminal)
        elif self.definite:
            self._add(np.array([self._base(u) for u in range(len(decisions.places) if self.per_choice else 1)]))
        else:
            M = definite_minorant(decisions.A, decisions.Q)
            if M is None:
                self._ceiling = _ceiling(reference, self.least)
            vanishes = M is not None or self._ceiling is not None
            for row in [svec(M)] if M is not None else lower_bounds(decisions.A, decisions.Q)[[0, -1]]:
                self._add(np.repeat(row[None], len(decisions.places) if self.per_choice else 1, axis=0))
        self.solves = few and (vanishes if terminal is None else self.per_choice and self.definite)
        self.guard = 4 * float(np.linalg.eigvalsh(reference)[-1]) if self.solves else 0.0
        self._program: Program | None = None

    def _add(self, rows: Array) -> None:
        self._bank.append(rows)
        self.count = len(self._bank)

    def _base(self, u: int) -> Array:
        """The least stage weight, which every run pays at once."""
        return svec(self.terminal if self.terminal is not None and self.decisions.ended(u) else self.least)

    def _semidefinite(self, L: Array) -> Array:
        """A bound as a row; where it is indefinite by its margins, a mean with the least stage weight, or nothing."""
        negative = -float(np.linalg.eigvalsh(L)[0])
        if negative <= 0:
            return svec(L)
        if not self.definite:
            return svec(np.zeros_like(L))
        share = negative / (negative + float(np.linalg.eigvalsh(self.least)[0]))
        return svec((1 - share) * L + share * self.least)

    def _backwards(self, terminal: Array) -> list[Array]:
        """One bound for each number of steps taken, by minorants from the end on, as rows."""
        decisions = self.decisions
        assert decisions.steps is not None
        L, rows = terminal, [svec(terminal)]
        self.count = 1
        for _ in range(decisions.steps):
            each = [below(Q, A, L) for Q, A in zip(decisions.Q, decisions.A, strict=True)]
            rows.append(self._semidefinite(reduce(minorant, each)))
            L = smat(rows[-1])
        return rows[::-1]

    def rows(self, u: int) -> Array:
        """The bounds at a choice, as rows for ``svec(S)``, shape (count, d)."""
        if self.terminal is not None and self.decisions.ended(u):
            return np.repeat(svec(self.terminal)[None], self.count, axis=0)
        if self._chain:
            return self._chain[self.decisions.places[u][0]][None]
        return np.array([rows[u if self.per_choice else 0] for rows in self._bank])

    def improve(self, u: int, s: Array) -> bool:
        """Add the bound that is greatest for a moment at a choice; whether it gains anything.

        Parameters
        ----------
        u : int
            The choice.
        s : array, shape (d,)
            The moment.

        Returns
        -------
        bool
        """
        if not self.solves or self.decisions.ended(u):
            return False
        begun = time.perf_counter()
        if self._program is None:
            least = self.least if self.definite else None
            self._program = Program(
                self.decisions, self.per_choice, self.reference, self.guard, self.terminal, least, self._ceiling
            )
        place = u if self.per_choice else 0
        L = self._program.solve(place, smat(s))
        self.seconds += time.perf_counter() - begun
        if L is None or not L[place] @ s > (1 + 1e-6) * float((self.rows(u) @ s).max()):
            return False
        self._add(L)
        return True


def _ceiling(reference: Array, least: Array) -> Array | None:
    """A multiple of the least stage weight, well above the reference where it sees the state; None if it sees none."""
    unit = np.sqrt(np.diag(reference))
    if not (unit > 0).all():
        return None
    weights, vectors = np.linalg.eigh(least / np.outer(unit, unit))
    vectors = vectors[:, weights > _SEEN] / np.sqrt(weights[weights > _SEEN])
    if vectors.shape[1] == 0:
        return None
    return 2 * float(np.linalg.eigvalsh(vectors.T @ (reference / np.outer(unit, unit)) @ vectors)[-1]) * least


def _definite(M: Array) -> bool:
    weights = np.linalg.eigvalsh(M)
    return bool(weights[0] > _DEFINITE * weights[-1])
