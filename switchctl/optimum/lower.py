"""Lower bounds on what goes on from a choice: quadratics that a step never beats.

If ``L_v <= Q_e + A_e' L_w A_e`` on every move e from v to w, then every run from v costs at least ``tr(L_v S)``: along
a run of finite cost ``tr(L S_k) -> 0`` where the stage weights are positive definite. L need not be definite, and is
not where modes chatter. For one moment the best L is a semidefinite program; what the solver returns is checked, and
mended where it fails by rounding.
"""

import time
from typing import Any

import numpy as np
from scipy import sparse

from switchctl.gramians import transform
from switchctl.moments import Array, moment_maps, smat, svec
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.minorants import below, lower_bounds, minorant

VARIABLES = 3000
"""Beyond so many unknowns, or STATES states, one L serves all choices, or none is solved for."""
STATES = 25
_ROUNDING = np.finfo(float).eps


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
    count : int
        How many bounds there are at each choice.
    guard : float
        No bound is below ``-guard`` times the identity.
    seconds : float
        The time spent on programs.
    """

    def __init__(self, decisions: Decisions, reference: Array, terminal: Array | None = None) -> None:
        self.decisions, self.reference, self.terminal = decisions, reference, terminal
        n, d = decisions.n, len(decisions.identity)
        self.least = decisions.Q[0]
        for Q in decisions.Q[1:]:
            self.least = self.least if np.array_equal(Q, self.least) else minorant(self.least, Q)
        weight = np.linalg.eigvalsh(self.least)
        self.definite = bool(weight[0] > 1e-10 * weight[-1])
        each = n <= STATES and decisions.reachable(VARIABLES // d)
        self.solves = self.definite and n <= STATES and (each or terminal is None)
        self.per_choice = self.solves and each
        self._bank: list[Array] = []  # (choices or 1, d) each
        self._program: _Program | None = None
        self.guard = 4 * float(np.linalg.eigvalsh(reference)[-1]) if self.solves else 0.0
        self.seconds = 0.0
        if self.definite and not (terminal is not None and not self.solves):
            self._add(np.array([self._base(u) for u in range(len(decisions.places) if self.per_choice else 1)]))
        elif terminal is None:
            for row in lower_bounds(decisions.A, decisions.Q):
                self._add(self._semidefinite(smat(row))[None])
        else:
            self._chain = self._backwards(terminal)
        self.count = max(len(self._bank), 1)

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
        for _ in range(decisions.steps):
            each = [below(Q, A, L) for Q, A in zip(decisions.Q, decisions.A, strict=True)]
            L = each[0]
            for X in each[1:]:
                L = minorant(L, X)
            rows.append(self._semidefinite(L))
            L = smat(rows[-1])
        return rows[::-1]

    def rows(self, u: int) -> Array:
        """The bounds at a choice, as rows for ``svec(S)``, shape (count, d)."""
        if self.terminal is not None and self.decisions.ended(u):
            return np.repeat(svec(self.terminal)[None], self.count, axis=0)
        if not self._bank:
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
            self._program = _Program(self)
        place = u if self.per_choice else 0
        L = self._program.solve(place, smat(s))
        self.seconds += time.perf_counter() - begun
        if L is None or not L[place] @ s > (1 + 1e-6) * float((self.rows(u) @ s).max()):
            return False
        self._add(L)
        return True


class _Program:
    """The semidefinite program over L at every choice, in states where the reference is the identity."""

    def __init__(self, bounds: LowerBounds) -> None:
        import clarabel

        decisions, terminal = bounds.decisions, bounds.terminal
        n, d = decisions.n, len(decisions.identity)
        choices = range(len(decisions.places) if bounds.per_choice else 1)
        self.base = np.array([smat(bounds._base(u)) for u in choices])
        self.ended = np.array([bounds.per_choice and decisions.ended(u) for u in choices])
        if bounds.per_choice:
            moves = [(u, move) for u in choices for move in decisions.moves(u)]
            self.tail, self.head = np.array([u for u, _ in moves]), np.array([move.head for _, move in moves])
            self.A, self.Q = np.array([move.A for _, move in moves]), np.array([move.Q for _, move in moves])
            slips = np.array([(move.slip, move.cost_slip) for _, move in moves])
        else:
            self.tail = self.head = np.zeros(len(decisions.A), dtype=int)
            self.A, self.Q, slips = decisions.A, decisions.Q, np.zeros((len(decisions.A), 2))
        self.slip, self.cost_slip = slips.T
        self.root = np.linalg.inv(np.linalg.cholesky(bounds.least))
        self.lightest = float(np.linalg.eigvalsh(bounds.least)[0])
        self.guard = bounds.guard
        self.T: Array = np.linalg.cholesky(bounds.reference).T.astype(float)
        back: Array = np.linalg.inv(self.T).astype(float)
        K = moment_maps(self.T @ self.A @ back)
        column = np.cumsum(~self.ended) - 1
        self.free = np.flatnonzero(~self.ended)
        E, size = len(self.A), len(self.free) * d
        b = svec(transform(back, self.Q))
        rows, columns, entries = [], [], []
        i, j = np.divmod(np.arange(d * d), d)
        for e in range(E):
            rows.append(e * d + np.arange(d))
            columns.append(column[self.tail[e]] * d + np.arange(d))
            entries.append(np.ones(d))
            if self.ended[self.head[e]]:
                assert terminal is not None
                b[e] += K[e].T @ svec(transform(back, terminal))
            else:
                rows.append(e * d + i)
                columns.append(column[self.head[e]] * d + j)
                entries.append(-K[e].T.ravel())
        parts = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        self.matrix = sparse.csc_matrix(parts, shape=(E * d, size))
        self.vector = b.ravel()
        self.cones = [clarabel.PSDTriangleConeT(n)] * E
        self.quadratic = sparse.csc_matrix((size, size))
        self.settings = clarabel.DefaultSettings()
        self.settings.verbose = False
        self.settings.max_threads = 1
        self.solver: Any = clarabel.DefaultSolver

    def solve(self, u: int, S: Array) -> Array | None:
        """Rows of L at every choice, greatest for S at one of them; None where nothing came of it."""
        n, d = S.shape[-1], len(svec(S))
        target = svec(self.T @ S @ self.T.T)
        if not np.isfinite(target).all() or not np.any(target):
            return None
        wanted = np.tile(svec(np.eye(n)) * 1e-4 / (n * len(self.free)), (len(self.free), 1))
        wanted[np.searchsorted(self.free, u)] += target / np.linalg.norm(target)
        try:
            problem = (self.quadratic, -wanted.ravel(), self.matrix, self.vector, self.cones, self.settings)
            found = np.array(self.solver(*problem).solve().x)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a panic of the solver is no Exception; without it there is one bound less
            return None
        if found.shape != (len(self.free) * d,) or not np.isfinite(found).all():
            return None
        L = self.base.copy()
        L[self.free] = transform(self.T, smat(found.reshape(-1, d)))
        return self._mended(L)

    def _mended(self, L: Array) -> Array | None:
        """A bound near L that holds, rounding included: ``Q + A' L A - L >= -t Q`` makes ``L / (1 + t)`` one.

        It is enough to have it with the least stage weight in the place of Q on the right. And a mean with the least
        stage weight, which is one, is not below the guard.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            left = self.Q + transform(self.A, L[self.head]) - L[self.tail]
            size = np.abs(self.Q) + transform(np.abs(self.A), np.abs(L[self.head])) + np.abs(L[self.tail])
            wrong = 16 * (len(L[0]) + 4) * _ROUNDING * np.linalg.norm(size, axis=(1, 2))
            wrong += self.slip * np.linalg.norm(L[self.head], axis=(1, 2)) + self.cost_slip
            relative = self.root @ left @ self.root.T
            if not np.isfinite(relative).all():
                return None
            t = max(0.0, float((2 * wrong / self.lightest - np.linalg.eigvalsh(relative)[:, 0]).max()))
            if not t < 0.5:
                return None
            L = np.where(self.ended[:, None, None], L, L / (1 + t))
            negative = float((-np.linalg.eigvalsh(L)[:, 0] + 1e-14 * np.linalg.norm(L, axis=(1, 2))).max())
            share = min(1.0, self.guard / max(negative, 1e-300))
            return svec(share * L + (1 - share) * self.base)
