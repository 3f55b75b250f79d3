"""One step of a mode and then a mode for ever, against single modes: an inequality a pair, and its dual.

For modes i and q, ``M = Q_i + A_i' P_q A_i`` is what a step of i and then q for ever cost. No moment S has
``tr(M S) < min_p tr(P_p S)`` if and only if some convex combination of the P_p is below M.
"""

from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from switchctl.gramians import tail
from switchctl.modes import ModeSet
from switchctl.moments import Array, smat, svec, transform
from switchctl.optimum.minorants import below
from switchctl.optimum.programs import primal_and_dual, solver
from switchctl.schur import in_units

_WORDS = 4096
_SEEN = 1e-9  # directions of less weight, in units of the states, count as unseen
_ACCURATE = 1e-11
_ROUNDING = float(np.finfo(float).eps)


class Verdict(NamedTuple):
    """What is known of a pair.

    Parameters
    ----------
    alpha : array, shape (r,)
        Weights of the tails.
    violation : float
        The least r found with ``sum_p alpha_p P_p <= M + r W_i``; 0 where the inequality itself is proven.
    moment : array, shape (n, n), or None
        Where it is not: a moment, in scaled states, for which the pair is to cost less than any single mode.
    """

    alpha: Array
    violation: float
    moment: Array | None


class Pairs:
    """The inequalities of all pairs, in states scaled by powers of two.

    Parameters
    ----------
    modes : ModeSet
        The modes, some of them with a tail.

    Attributes
    ----------
    finite : list of int
        The modes that have a tail.
    P, error : arrays, shape (r, n, n)
        Their tails, and by how much these may be wrong: the true ones are between ``P - error`` and ``P + error``.
    ahead, ahead_error : arrays, shape (m, r, n, n)
        ``A_i' P_q A_i``, and by how much the error of P makes it wrong.
    """

    def __init__(self, modes: ModeSet) -> None:
        self.finite = [p for p, P in enumerate(modes.tails) if P is not None]
        P = np.array([P for P in modes.tails if P is not None])
        total = P.sum(axis=0) + modes.Q.sum(axis=0) + transform(modes.A[:, None], P).sum(axis=(0, 1))
        size = np.diag(total)
        self.scale = np.exp2(np.round(np.log2(np.where(size > 0, size, 1.0)) / 2))
        units = np.outer(self.scale, self.scale)
        self.A, self.Q, self.P = modes.A * self.scale[:, None] / self.scale, modes.Q / units, P / units
        self.error = np.array([_error(self.A[p], self.Q[p], P) for p, P in zip(self.finite, self.P, strict=True)])
        self.ahead = transform(self.A[:, None], self.P)
        self.ahead_error = transform(self.A[:, None], self.error)

    def scaled(self, S: Array) -> Array:
        """A moment in scaled states."""
        return S * np.outer(self.scale, self.scale)

    def plain(self, S: Array) -> Array:
        """Undo `scaled`."""
        return S / np.outer(self.scale, self.scale)

    @cached_property
    def window(self) -> tuple[bool, list[Array] | None]:
        """Whether V vanishes along runs of finite cost, and weights W_i of violations, where there are any.

        Positive definite stage weights are the W_i themselves. Else every word of t modes must cost at least
        ``tr(M S)``, M positive definite, and all W_i are ``M / t``; or see, definitely, all that some tail sees.
        """
        m, n, _ = self.A.shape
        words, blind = [np.zeros((n, n))], False
        for t in range(1, 2 * n + 1):
            if m**t > _WORDS:
                break
            words = [below(Q, A, L) for Q, A in zip(self.Q, self.A, strict=True) for L in words]
            if t == 1 and all(_definite(Q) for Q in self.Q):
                return True, list(self.Q)
            mean = np.mean(words, axis=0)
            if t > 1 and _definite(mean):
                root = _inverse_root(mean)
                least = float(np.min([_least(L, np.abs(L), root) for L in words])) - _SEEN
                if least > 0:
                    return True, [least * mean / t] * m
            blind = blind or all(self._sees(L) for L in words)
        return blind, None

    def _sees(self, L: Array) -> bool:
        """Whether the cost of a word is definite where it isn't zero, and some tail is zero elsewhere."""
        states = np.abs(L).any(axis=0)
        kept = np.ix_(states, states)
        return _definite(L[kept]) and any(not P[~states].any() for P in self.P)

    def decide(self, i: int, q: int) -> Verdict:
        """Find the combination for a step of mode i and then the q-th tail, or the moment that there is instead."""
        M = self.Q[i] + self.ahead[i, q]
        root, kept = self._units(i, q)
        P, single = np.array([root @ P[kept] @ root.T for P in self.P]), np.eye(len(self.P))
        order = np.argsort([np.linalg.eigvalsh(relative)[-1:].sum() for relative in P], kind="stable")
        alphas, moment = [single[p] for p in order], None
        if self.holds(i, q, alphas[0]):
            return Verdict(alphas[0], 0.0, None)
        found = _combination(P, root @ M[kept] @ root.T)
        if found is not None:
            alphas.append(found[0])
            if self.holds(i, q, alphas[-1]):
                return Verdict(alphas[-1], 0.0, None)
            moment = np.eye(len(M))
            moment[kept] = root.T @ _mixed(found[1], P, root @ M[kept] @ root.T) @ root
        weights = self.window[1]
        if weights is None:
            return Verdict(alphas[-1], np.inf, moment)
        root = _inverse_root(weights[i])
        found = _combination(root @ self.P @ root.T, root @ M @ root.T)
        alphas += [] if found is None else [found[0]]
        violations = [self.violation(i, q, alpha) for alpha in alphas]
        best = int(np.argmin(violations))
        return Verdict(alphas[best], violations[best], moment)

    def _units(self, i: int, q: int) -> tuple[Array, tuple[NDArray[np.intp], ...]]:
        """T with ``T M T' = I``, nearly, on the states that M or some tail sees, and these states."""
        X = self.Q[i] + self.ahead[i, q] + 1e-6 * self.P.mean(axis=0)
        states = np.flatnonzero(np.diag(X))
        kept = np.ix_(states, states)
        return _inverse_root(X[kept] + 1e-12 * np.diag(np.diag(X[kept]))), kept

    def residual(self, i: int, q: int, alpha: Array) -> tuple[Array, Array]:
        """``M - sum_p alpha_p P_p``, and the size of what is added up in it."""
        mixed = np.tensordot(alpha, self.P, 1)
        size = np.abs(self.Q[i]) + np.abs(self.A[i]).T @ np.abs(self.P[q]) @ np.abs(self.A[i])
        return self.Q[i] + self.ahead[i, q] - mixed, size + np.tensordot(alpha, np.abs(self.P), 1)

    def holds(self, i: int, q: int, alpha: Array) -> bool:
        """Whether the combination is below M for certain, of the true tails."""
        left, size = self.residual(i, q, alpha)
        wrong = self.ahead_error[i, q] + np.tensordot(alpha, self.error, 1)
        root, kept = self._units(i, q)
        nowhere_else = np.count_nonzero(np.diag(size + wrong)) == len(root)
        return nowhere_else and _least((left - wrong)[kept], (size + wrong)[kept], root) > 0

    def violation(self, i: int, q: int, alpha: Array) -> float:
        """The r for which the combination of the computed tails is below ``M + r W_i`` for certain."""
        weights = self.window[1]
        if weights is None:
            return np.inf
        root = _inverse_root(weights[i])
        lightest = _least(weights[i], np.abs(weights[i]), root)
        left = _least(*self.residual(i, q, alpha), root)
        return max(0.0, -left) / lightest if lightest > 0 and np.isfinite(left) else np.inf

    def relative_error(self) -> float:
        """The least e found with ``error <= e P`` for all tails."""
        if not all(_definite(P) for P in self.P):
            return np.inf
        roots = [_inverse_root(P) for P in self.P]
        errors = [np.linalg.norm(T @ error @ T.T, 2) for T, error in zip(roots, self.error, strict=True)]
        return 2 * float(np.max(errors)) if np.isfinite(errors).all() else np.inf

    def costs(self, i: int, q: int, S: Array) -> tuple[float, Array, float]:
        """What the pair costs from a moment in scaled states, what the tails cost, and by how much this is certain.

        The last is the least cost of a tail less that of the pair, less all that errors may add to it.
        """
        M = self.Q[i] + self.ahead[i, q]
        cost, single = float(np.sum(M * S)), np.sum(self.P * S, axis=(1, 2))
        rounding = 4 * len(S) ** 2 * _ROUNDING
        size = self.residual(i, q, np.zeros(len(self.P)))[1]
        above = cost + float(np.sum(self.ahead_error[i, q] * S) + rounding * np.sum(size * np.abs(S)))
        doubt = np.sum(self.error * S, axis=(1, 2)) + rounding * np.sum(np.abs(self.P) * np.abs(S), axis=(1, 2))
        return cost, single, float(np.min(single - doubt) - above)

    def different(self) -> list[tuple[int, int]]:
        """The pairs of different modes: the first mode, and the place of the second among the tails."""
        return [(i, q) for i, q in product(range(len(self.A)), range(len(self.P))) if i != self.finite[q]]


def positive_definite(S: Array) -> bool:
    """Whether a matrix is positive definite for certain."""
    if not (np.diag(S) > 0).all():
        return False
    try:
        return _least(S, np.abs(S), _inverse_root(S)) > 0
    except np.linalg.LinAlgError:
        return False


def _mixed(S: Array, P: Array, M: Array) -> Array:
    """A moment moved into the cone as far as that leaves what it saves next to unchanged."""
    weights, vectors = np.linalg.eigh(S)
    S, centre = (vectors * np.maximum(weights, 0.0)) @ vectors.T, np.eye(len(S)) / len(S)

    def saved(S: Array) -> float:
        return 1 - float(np.sum(M * S) / np.min(np.sum(P * S, axis=(1, 2))))

    share = 1e-2
    while share > 1e-9 and not saved((1 - share) * S + share * centre) >= 0.99 * saved(S):
        share /= 10
    return (1 - share) * S + share * centre


def _definite(S: Array) -> bool:
    """Whether the least eigenvalue of a matrix is above rounding, its diagonal made 1."""
    size = np.diag(S)
    if not (size > 0).all():
        return False
    unit = S / np.sqrt(np.outer(size, size))
    return not len(S) or bool(np.linalg.eigvalsh(unit)[0] > _SEEN)


def _error(A: Array, Q: Array, P: Array) -> Array:
    """By how much a tail may be wrong, by its residual (docs/theory.md, "Tails")."""
    size = np.abs(A).T @ np.abs(P) @ np.abs(A) + np.abs(P) + np.abs(Q)
    weight = np.sqrt(np.diag(size))
    D = np.diag(np.diag(size))
    left, size = in_units(Q + transform(A, P) - P, D), in_units(size, D)
    r = float(np.linalg.norm(left, 2)) + 4 * (len(A) + 2) * _ROUNDING * float(np.linalg.norm(size))
    spread = tail(A, np.diag(np.where(np.diag(P) > 0, weight**2, 0.0)))
    assert spread is not None  # A has a tail
    return 2 * r * spread


def _inverse_root(X: Array) -> Array:
    """T with ``T X T' = I``, about."""
    unit = 1 / np.sqrt(np.diag(X))
    return np.linalg.inv(np.linalg.cholesky(X * np.outer(unit, unit))) * unit


def _least(X: Array, size: Array, T: Array) -> float:
    """Below the least eigenvalue of ``T X T'``, X being known to rounding of what was added up in it."""
    if not len(X):
        return np.inf
    relative = T @ X @ T.T
    added = float(np.linalg.norm(np.abs(T) @ size @ np.abs(T).T))
    return float(np.linalg.eigvalsh((relative + relative.T) / 2)[0]) - 4 * (len(X) + 4) * _ROUNDING * added


def _combination(P: Array, M: Array) -> tuple[Array, Array] | None:
    """Weights alpha with the least r such that ``sum_p alpha_p P_p <= M + r I``, and the dual moment of trace 1."""
    clarabel = solver()

    r, n, _ = P.shape
    # variables (alpha, r); sum alpha = 1, alpha >= 0, and M + r I - sum_p alpha_p P_p semidefinite
    rows = [
        np.append(np.ones(r), 0.0)[None],
        np.column_stack([-np.eye(r), np.zeros(r)]),
        np.column_stack([svec(P).T, -svec(np.eye(n))]),
    ]
    b = np.concatenate([[1.0], np.zeros(r), svec(M)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(r), clarabel.PSDTriangleConeT(n)]
    objective = np.append(np.zeros(r), 1.0)
    found = primal_and_dual(
        objective, sparse.csc_matrix(np.concatenate(rows)), b, cones, feasible=_ACCURATE, gap=_ACCURATE
    )
    if found is None:
        return None
    alpha, S = np.maximum(found[0][:r], 0.0), smat(found[1][1 + r :])
    if not (alpha.sum() > 0.5 and np.trace(S) > 0.5):
        return None
    return alpha / alpha.sum(), S / np.trace(S)
