"""Quadratic norms at the nodes in which every move grows by little: ``A_e' P_head A_e <= gamma^(2 length) P_tail``.

One node is a common quadratic Lyapunov function; the nodes of a lift are a path-complete one (Ahmadi, Jungers, Parrilo
and Roozbehani, SIAM J. Control Optim. 2014). The solver's answer is never trusted: gamma is computed from P.
"""

import time
from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.optimize import root_scalar

from switchctl.moments import Array, moment_maps, smat, svec, transform
from switchctl.optimum.programs import solution, solver
from switchctl.stability.moves import LEAST, Moves

_DENSE = 3000  # unknowns of a linear system solved for a first P


def growth(moves: Moves, P: Array) -> float:
    """The least gamma that these norms prove; infinite where a P is not positive definite, or there is none."""
    try:
        seen = moves.seen_in(P, 1.0)
    except np.linalg.LinAlgError:
        return np.inf
    room = rounding(P)
    if not (room < np.inf and np.isfinite(seen.A).all() and np.isfinite(seen.wrong).all()):
        return np.inf
    norms = (np.linalg.norm(seen.A, 2, axis=(1, 2)) + seen.wrong.sum(axis=(1, 2))) * room
    norms = np.where(((seen.A != 0) | (seen.wrong != 0)).any(axis=(1, 2)), np.maximum(norms, LEAST), 0.0)
    counted = moves.lengths > 0
    if (norms[~counted] > 1).any():
        return np.inf
    return float((norms[counted] ** (1 / moves.lengths[counted])).max(initial=0.0))


def rounding(P: Array) -> float:
    """A factor for what rounding may take from a growth computed in these norms."""
    diagonal, noise = np.einsum("vii->vi", P), 8 * P.shape[-1] * np.finfo(float).eps
    if not (np.isfinite(P).all() and (diagonal > 0).all()):
        return np.inf
    unit = np.exp2(np.round(np.log2(diagonal) / 2))
    eigenvalues = np.linalg.eigvalsh(P / unit[:, :, None] / unit[:, None, :])  # factors don't depend on units
    least = eigenvalues[:, 0] - noise * eigenvalues[:, -1]
    return 1 + noise * float(np.sqrt(eigenvalues[:, -1] / least).max()) if (least > 0).all() else np.inf


def lifting_norms(moves: Moves) -> Array:
    """Norms by Kronecker lifting: ``sum_e A_e' P_head A_e <= g P_tail`` at each node, g nearly the sum's radius.

    Each move alone then grows by no more (Blondel and Nesterov, SIAM J. Matrix Anal. Appl. 27, 2005).

    Returns
    -------
    array, shape (nodes, n, n)
    """
    V, n = len(moves), moves.A.shape[-1]
    d = n * (n + 1) // 2
    identity = np.tile(np.eye(n), (V, 1, 1))
    unit = growth(moves, identity)
    if V * d > _DENSE or unit == 0:
        return identity
    K = moment_maps(moves.divided(unit).A)
    blocks = np.zeros((V, V, d, d))
    np.add.at(blocks, (moves.tail, moves.head), np.swapaxes(K, -1, -2))
    T = blocks.transpose(0, 2, 1, 3).reshape(V * d, V * d)
    radius = float(np.abs(np.linalg.eigvals(T)).max())
    shifted = (radius * (1 + 1e-6) + 1e-12) * np.eye(V * d) - T
    try:
        P: Array = smat(np.asarray(np.linalg.solve(shifted, svec(identity).ravel()), dtype=float).reshape(V, d))
    except np.linalg.LinAlgError:  # of moves that vanish, too near to singular
        return identity
    return P / np.trace(P, axis1=1, axis2=2).max() if np.isfinite(growth(moves, P)) else identity


def quadratic_norms(
    moves: Moves, P: Array, lower: float, enough: float, accuracy: float, deadline: float
) -> tuple[float, Array]:
    """Norms of nearly the least gamma.

    A program that always has a solution finds, for a given gamma, the P of trace n with the greatest slack t,
    ``gamma^(2 length) P_tail - A' P_head A >= t I``; its t changes sign at the least gamma. It is written in states in
    which the P known so far are the identity.

    Parameters
    ----------
    moves : Moves
        The moves.
    P : array, shape (nodes, n, n)
        Where to begin.
    lower : float
        A lower bound of gamma.
    enough : float
        Stop at this gamma.
    accuracy : float
        Stop where gamma is known so well, relative.
    deadline : float
        Stop at this reading of `time.perf_counter`.

    Returns
    -------
    gamma : float
    P : array, shape (nodes, n, n)
    """
    best = growth(moves, P)
    if not np.isfinite(best):
        P = np.broadcast_to(np.eye(P.shape[-1]), P.shape)
        best = growth(moves, P)
    if best == 0:
        return best, P
    lower = max(lower, best * 1e-6)
    while best > max(enough, lower * (1 + accuracy)):
        program = _Program(moves, P, deadline)
        found = program.least(lower, best, max(accuracy, 1e-3 * (best / lower - 1)))
        gamma = growth(moves, found)
        better, best = best / gamma - 1, min(best, gamma)
        P = found if better > 0 else P
        if better <= accuracy or time.perf_counter() > deadline:
            break
    return best, P


class _Program:
    def __init__(self, moves: Moves, P: Array, deadline: float) -> None:
        clarabel = solver()

        self.moves, self.deadline = moves, deadline
        self.T = np.swapaxes(np.linalg.cholesky(P), -1, -2)
        back = np.linalg.inv(self.T)
        self.A = self.T[moves.head] @ moves.A @ back[moves.tail]
        V, n, E = len(moves), P.shape[-1], len(moves.tail)
        self.n, self.d = n, n * (n + 1) // 2
        identity = svec(np.eye(n))
        size = V * self.d + 1
        self.objective = np.append(np.zeros(size - 1), -1.0)
        trace = sparse.csc_matrix(np.append(np.tile(identity, V), 0.0)[None])
        self.rest = sparse.vstack([-sparse.eye(V * self.d, size), trace], format="csc")
        self.vector = np.append(np.zeros((E + V) * self.d), float(V * n))
        self.cones = [clarabel.PSDTriangleConeT(n)] * (E + V) + [clarabel.ZeroConeT(1)]
        self.best: tuple[float, Array] = np.inf, P

    def least(self, lower: float, upper: float, accuracy: float) -> Array:
        """The norms of the least gamma that was met on the way to the root of t."""
        try:
            root_scalar(self.slack, bracket=(lower, upper), xtol=accuracy * lower, rtol=1e-15, maxiter=30)
        except (ValueError, TimeoutError):  # no change of sign within the solver's accuracy, or no time left
            pass
        return self.best[1]

    def slack(self, gamma: float) -> float:
        """The greatest t of a gamma, relative to gamma squared."""
        if time.perf_counter() > self.deadline:
            raise TimeoutError
        moves, E = self.moves, len(self.A)
        K = moment_maps(replace(moves, A=self.A).divided(gamma).A)
        rows, columns = np.divmod(np.arange(self.d * self.d), self.d)
        e = np.arange(E)[:, None] * self.d
        own = np.arange(self.d)
        identity = svec(np.eye(self.n))
        parts = [
            (np.swapaxes(K, -1, -2).reshape(E, -1), e + rows, moves.head[:, None] * self.d + columns),
            (-np.ones((E, self.d)), e + own, moves.tail[:, None] * self.d + own),
            (np.tile(identity, (E, 1)), e + own, np.full((E, self.d), len(moves) * self.d)),
        ]
        entries, row, column = (np.concatenate([part[i].ravel() for part in parts]) for i in range(3))
        matrix = sparse.csc_matrix((entries, (row, column)), shape=(E * self.d, len(self.objective)))
        matrix = sparse.vstack([matrix, self.rest], format="csc")
        found = solution(self.objective, matrix, self.vector, self.cones, feasible=1e-12)
        if found is None:
            return -1.0 if gamma < self.best[0] else 1.0
        P = transform(self.T, smat(found[:-1].reshape(len(moves), self.d)))
        proven = growth(moves, P)
        if proven < self.best[0]:
            self.best = proven, P
        return float(found[-1])
