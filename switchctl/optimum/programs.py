"""The semidefinite program for a lower bound, and the check of what its solver returns."""

import sys
from typing import Any

import numpy as np
from scipy import sparse

from switchctl.moments import Array, moment_maps, smat, svec, transform
from switchctl.optimum.decisions import Decisions

_ROUNDING = np.finfo(float).eps
_FEASIBLE = 1e-10


def solver() -> Any:
    """Clarabel, imported where it is first needed; an import that Ctrl-C cuts short leaves nothing half done."""
    try:
        import clarabel
    except BaseException:
        for name in [name for name in sys.modules if name.split(".")[0] == "clarabel"]:
            del sys.modules[name]
        raise
    return clarabel


def primal_and_dual(
    objective: Array,
    matrix: Any,
    vector: Array,
    cones: list[Any],
    quadratic: Any = None,
    feasible: float | None = None,
    gap: float | None = None,
) -> tuple[Array, Array] | None:
    """What the solver returns for a conic program, not to be trusted; None if it fails or returns no finite numbers."""
    clarabel = solver()

    size = len(objective)
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    if feasible is not None:
        settings.tol_feas = feasible
    if gap is not None:
        settings.tol_gap_abs = settings.tol_gap_rel = gap
    quadratic = sparse.csc_matrix((size, size)) if quadratic is None else quadratic
    try:
        found = clarabel.DefaultSolver(quadratic, objective, matrix, vector, cones, settings).solve()
        primal, dual = np.array(found.x), np.array(found.z)
    except KeyboardInterrupt:
        raise
    except BaseException:  # a panic of the solver is no Exception
        return None
    right = primal.shape == (size,) and dual.shape == vector.shape
    return (primal, dual) if right and np.isfinite(primal).all() and np.isfinite(dual).all() else None


def solution(
    objective: Array, matrix: Any, vector: Array, cones: list[Any], quadratic: Any = None, feasible: float | None = None
) -> Array | None:
    """The primal part of `primal_and_dual`."""
    found = primal_and_dual(objective, matrix, vector, cones, quadratic, feasible)
    return None if found is None else found[0]


class Program:
    """Maximise ``tr(L_v S)`` subject to ``L_v <= Q_e + A_e' L_w A_e`` on every move, in states fit for it.

    What comes back is never trusted. If its left-hand sides ``R = Q + A' L A - L`` are above ``-t W``, and those of
    another solution, the interior one, above ``s W``, then a mean of both, t to s, is a solution. Where the weights
    are positive definite, the interior solution is 0, and W the least of them.

    Parameters
    ----------
    decisions : Decisions
        The choices and moves.
    per_choice : bool
        Whether every choice has its own L; else one serves all, for single steps in every mode.
    reference : array, shape (n, n)
        A positive definite cost matrix, which is to be the identity.
    guard : float
        L must not be below ``-guard`` times the identity.
    terminal : array, shape (n, n), optional
        L at the end of a run that ends.
    least : array, shape (n, n), optional
        A positive definite matrix below every stage weight, where there is one.
    ceiling : array, shape (n, n), optional
        What L must be below.
    """

    def __init__(
        self,
        decisions: Decisions,
        per_choice: bool,
        reference: Array,
        guard: float,
        terminal: Array | None,
        least: Array | None,
        ceiling: Array | None = None,
    ) -> None:
        clarabel = solver()

        self.clarabel, self.guard, self.ceiling = clarabel, guard, ceiling
        n, d = decisions.n, len(decisions.identity)
        choices = range(len(decisions.places) if per_choice else 1)
        self.ended = np.array([terminal is not None and decisions.ended(u) for u in choices])
        self.fixed = np.zeros((len(choices), n, n))
        if terminal is not None:
            self.fixed[self.ended] = terminal
        if per_choice:
            moves = [(u, move) for u in choices for move in decisions.moves(u)]
            self.tail, self.head = np.array([u for u, _ in moves]), np.array([move.head for _, move in moves])
            self.A, self.Q = np.array([move.A for _, move in moves]), np.array([move.Q for _, move in moves])
            slips = np.array([(move.slip, move.cost_slip) for _, move in moves])
        else:
            self.tail = self.head = np.zeros(len(decisions.A), dtype=int)
            self.A, self.Q, slips = decisions.A, decisions.Q, np.zeros((len(decisions.A), 2))
        self.slip, self.cost_slip = slips.T
        self.T: Array = np.linalg.cholesky(reference).T.astype(float)
        self.back: Array = np.linalg.inv(self.T).astype(float)
        K = moment_maps(self.T @ self.A @ self.back)
        column = np.cumsum(~self.ended) - 1
        self.free = np.flatnonzero(~self.ended)
        E, size = len(self.A), len(self.free) * d
        b = svec(transform(self.back, self.Q))
        rows, columns, entries = [], [], []
        i, j = np.divmod(np.arange(d * d), d)
        for e in range(E):
            rows.append(e * d + np.arange(d))
            columns.append(column[self.tail[e]] * d + np.arange(d))
            entries.append(np.ones(d))
            if self.ended[self.head[e]]:
                b[e] += K[e].T @ svec(transform(self.back, self.fixed[self.head[e]]))
            else:
                rows.append(e * d + i)
                columns.append(column[self.head[e]] * d + j)
                entries.append(-K[e].T.ravel())
        parts = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        self.matrix = sparse.csc_matrix(parts, shape=(E * d, size))
        self.vector = b.ravel()
        if ceiling is not None:
            self.matrix = sparse.vstack([self.matrix, sparse.eye(size)], format="csc")
            self.vector = np.concatenate([self.vector, np.tile(svec(transform(self.back, ceiling)), len(self.free))])
        self.cones = [clarabel.PSDTriangleConeT(n)] * (len(self.vector) // d)
        self.root: Array = self.back.T if least is None else np.linalg.inv(np.linalg.cholesky(least)).astype(float)
        self.interior, self.slack = self.fixed, 1.0
        if least is None:
            self._find_interior()

    def solve(self, u: int, S: Array) -> Array | None:
        """Rows of L at every choice, greatest for S at one of them; None where nothing came of it."""
        n, d = S.shape[-1], len(svec(S))
        target = svec(self.T @ S @ self.T.T)
        if not (self.slack > 0 and np.isfinite(target).all() and np.any(target)):
            return None
        wanted = np.tile(svec(np.eye(n)) * 1e-4 / (n * len(self.free)), (len(self.free), 1))
        wanted[np.searchsorted(self.free, u)] += target / np.linalg.norm(target)
        found = solution(-wanted.ravel(), self.matrix, self.vector, self.cones, feasible=_FEASIBLE)
        return None if found is None else self._mended(self._read(found, d))

    def _read(self, found: Array, d: int) -> Array:
        L = self.fixed.copy()
        L[self.free] = transform(self.T, smat(found.reshape(-1, d)))
        return L

    def _find_interior(self) -> None:
        """The solution whose left-hand sides are furthest inside: ``R >= s I`` in the program's states, s at most 1."""
        n, d = self.T.shape[0], len(svec(self.T))
        size = self.matrix.shape[1]
        inside = np.tile(svec(np.eye(n)), len(self.cones))[:, None]
        below = sparse.csc_matrix(np.append(np.zeros(size), 1.0)[None])
        matrix = sparse.vstack([sparse.hstack([self.matrix, sparse.csc_matrix(inside)]), below], format="csc")
        quadratic = sparse.diags(np.append(np.full(size, 1e-9), 0.0), format="csc")
        objective, vector = np.append(np.zeros(size), -1.0), np.append(self.vector, 1.0)
        cones = [*self.cones, self.clarabel.NonnegativeConeT(1)]
        found = solution(objective, matrix, vector, cones, quadratic, _FEASIBLE)
        self.slack = 0.0
        if found is not None:
            self.interior = self._read(found[:-1], d)
            self.slack = -self._violation(self.interior)

    def _violation(self, L: Array) -> float:
        """The least t with ``Q + A' L A - L >= -t W`` on every move, rounding included; infinite if there is none.

        The same where L must be below a ceiling.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            left = self.Q + transform(self.A, L[self.head]) - L[self.tail]
            size = np.abs(self.Q) + transform(np.abs(self.A), np.abs(L[self.head])) + np.abs(L[self.tail])
            wrong = 16 * (len(L[0]) + 4) * _ROUNDING * np.linalg.norm(size, axis=(1, 2))
            wrong += self.slip * np.linalg.norm(L[self.head], axis=(1, 2)) + self.cost_slip
            if self.ceiling is not None:
                free = L[self.free]
                left = np.concatenate([left, self.ceiling - free])
                size = np.linalg.norm(free, axis=(1, 2)) + np.linalg.norm(self.ceiling)
                wrong = np.append(wrong, 4 * _ROUNDING * size)
            relative = self.root @ left @ self.root.T
            if not np.isfinite(relative).all():
                return np.inf
            heaviest = float(np.linalg.norm(self.root, 2)) ** 2
            return float((2 * wrong * heaviest - np.linalg.eigvalsh(relative)[:, 0]).max())

    def _mended(self, L: Array) -> Array | None:
        """A bound near L that holds: a mean with the interior solution, and with none at all so that it is guarded."""
        t = max(0.0, self._violation(L))
        if not t < self.slack:
            return None
        share = t / (t + self.slack)
        L = (1 - share) * L + share * self.interior
        negative = float((-np.linalg.eigvalsh(L)[:, 0] + 1e-14 * np.linalg.norm(L, axis=(1, 2))).max())
        return svec(np.where(self.ended[:, None, None], L, L * min(1.0, self.guard / max(negative, 1e-300))))
