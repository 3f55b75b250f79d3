"""How second moments move over a graph of random or periodic switching: the operator and its adjoint.

From a node v to a node w, a move e of weight ``p_e`` takes the step ``A_e``. The operator T moves the moments at the
nodes, ``(T S)_w = sum_e p_e A_e S_v A_e'``; its adjoint moves cost matrices back,
``(T* P)_v = sum_e p_e A_e' P_w A_e``.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, matrix_balance, schur, solve_triangular
from scipy.sparse.linalg import LinearOperator, eigs

from switchctl.moments import Array, moment_maps, smat, svec, transform

_DENSE = 1000  # rows up to which all eigenvalues are computed


class Move(NamedTuple):
    """One move: from a node to a node by a step A in a mode, with its probability (1 in a word).

    Parameters
    ----------
    tail, head : int
        The nodes.
    mode : int
        Index of the mode.
    weight : float
        The probability.
    A : array, shape (n, n)
        The step.
    """

    tail: int
    head: int
    mode: int
    weight: float
    A: Array


class MomentOperator:
    """T and T* of some moves, and the solution of ``(T* - g) X = R``.

    Parameters
    ----------
    moves : sequence of Move
        The moves; those of weight 0 make no difference.
    nodes : int
        How many nodes there are, from 0.
    """

    def __init__(self, moves: Sequence[Move], nodes: int) -> None:
        moves = [move for move in moves if move.weight > 0]
        self.nodes = nodes
        self.tails = np.array([move.tail for move in moves], dtype=np.intp)
        self.heads = np.array([move.head for move in moves], dtype=np.intp)
        self.weights = np.array([move.weight for move in moves])
        self.A = np.array([move.A for move in moves])
        self.n = self.A.shape[-1]

    def units(self) -> tuple[NDArray[np.int_], int]:
        """Units of the states that balance rows and columns of the steps, and one of the steps, as powers of two.

        The greatest entry of a step is about 1 in them.
        """
        shift = int(np.frexp(np.abs(self.A).max())[1])
        whole = np.einsum("e,eij->ij", np.sqrt(self.weights), np.ldexp(np.abs(self.A), -shift))
        unit = np.frexp(matrix_balance(whole, permute=False, separate=True)[1][0])[1] - 1
        exponents = np.frexp(self.A)[1] + unit - unit[:, None]
        return unit, int(exponents[self.A != 0].max()) if self.A.any() else 0

    def rescaled(self, unit: NDArray[np.int_], step: int) -> "MomentOperator":
        """The same in other units of the states and of the steps: without rounding, where nothing underflows."""
        A = np.ldexp(self.A, unit - unit[:, None] - step)
        moves = zip(self.tails, self.heads, self.weights, A, strict=True)
        return MomentOperator([Move(int(t), int(h), -1, float(w), A) for t, h, w, A in moves], self.nodes)

    def reversed(self) -> "MomentOperator":
        """The operator whose adjoint is this one."""
        moves = zip(self.heads, self.tails, self.weights, np.swapaxes(self.A, -1, -2), strict=True)
        return MomentOperator([Move(int(t), int(h), -1, float(w), A) for t, h, w, A in moves], self.nodes)

    def before(self, P: Array) -> Array:
        """``T* P``: cost matrices at the nodes before a step, shape (nodes, n, n)."""
        found = np.zeros((self.nodes, self.n, self.n))
        np.add.at(found, self.tails, self.weights[:, None, None] * transform(self.A, P[self.heads]))
        return found

    def size(self, P: Array) -> Array:
        """What is added up in `before`, by its size: entries of ``sum_e p_e |A_e|' |P| |A_e|``."""
        found = np.zeros((self.nodes, self.n, self.n))
        np.add.at(found, self.tails, self.weights[:, None, None] * transform(np.abs(self.A), np.abs(P[self.heads])))
        return found

    @cached_property
    def _resolvent(self) -> "_Cycle | _Dense":
        around = np.zeros(self.nodes, dtype=np.intp)
        around[self.tails] = np.arange(len(self.tails))
        order = [0]
        if len(self.tails) == self.nodes == len(set(self.tails.tolist())) == len(set(self.heads.tolist())):
            while (then := int(self.heads[around[order[-1]]])) != 0:
                order.append(then)
        if len(order) == self.nodes == len(self.tails):
            return _Cycle(np.sqrt(self.weights)[around[order], None, None] * self.A[around[order]], np.array(order))
        return _Dense(self)

    @cached_property
    def radius(self) -> float:
        """An estimate of the spectral radius of T."""
        return self._resolvent.radius()

    def solve(self, g: float, R: Array) -> Array:
        """``(T* - g) X = R`` at the nodes, with one step of iterative refinement; not finite where it can't be done."""
        X = self._resolvent.solve(g, R)
        X = X + self._resolvent.solve(g, R - (self.before(X) - g * X))
        return (X + np.swapaxes(X, -1, -2)) / 2


class _Dense:
    """The adjoint as one matrix on the half-vectorised matrices of all nodes."""

    def __init__(self, operator: MomentOperator) -> None:
        self.nodes, n = operator.nodes, operator.n
        self.d = n * (n + 1) // 2
        blocks = np.zeros((self.nodes, self.nodes, self.d, self.d))
        maps = operator.weights[:, None, None] * moment_maps(np.swapaxes(operator.A, -1, -2))
        np.add.at(blocks, (operator.tails, operator.heads), maps)
        self.matrix = blocks.transpose(0, 2, 1, 3).reshape(self.nodes * self.d, -1)
        self._factors: tuple[float, tuple[Array, Array]] | None = None

    def radius(self) -> float:
        if not np.isfinite(self.matrix).all():
            return np.inf
        if len(self.matrix) <= _DENSE:
            return float(np.abs(np.linalg.eigvals(self.matrix)).max(initial=0.0))
        product = LinearOperator(self.matrix.shape, matvec=lambda x: self.matrix @ x, dtype=float)
        start = np.tile(svec(np.eye(int(np.sqrt(2 * self.d)))), self.nodes)
        return float(np.abs(eigs(product, k=4, v0=start, return_eigenvectors=False)).max())

    def solve(self, g: float, R: Array) -> Array:
        if self._factors is None or self._factors[0] != g:
            factored, pivots, _ = lapack.dgetrf(self.matrix - g * np.eye(len(self.matrix)), overwrite_a=1)
            self._factors = g, (factored, pivots)
        x, _ = lapack.dgetrs(*self._factors[1], svec(R).ravel())
        return smat(x.reshape(self.nodes, self.d))


class _Cycle:
    """A single cycle: once around it, ``(T* - g) X = R`` is a Stein equation of the product of its steps."""

    def __init__(self, A: Array, order: np.ndarray) -> None:
        self.A, self.order = A, order
        self.product, self.exponent = np.eye(A.shape[-1]), 0  # the product is product * 2 ** exponent
        for step in A:
            self.product = step @ self.product
            shift = int(np.frexp(np.abs(self.product).max())[1])
            self.product, self.exponent = np.ldexp(self.product, -shift), self.exponent + shift
        if np.isfinite(self.product).all():
            self.triangle, self.vectors = schur(self.product, output="complex")
        else:
            self.triangle = self.vectors = np.full(self.product.shape, np.inf + 0j)

    def radius(self) -> float:
        around = float(np.abs(np.diag(self.triangle)).max())
        if not 0 < around < np.inf:
            return around
        return float(np.exp2(2 * (np.log2(around) + self.exponent) / len(self.A)))

    def solve(self, g: float, R: Array) -> Array:
        R = R[self.order]
        around = np.zeros_like(R[0])
        for step, weight in zip(self.A[::-1], R[::-1], strict=True):
            around = (transform(step, around) + weight) / g
        X = [self._stein(float(np.exp2(len(R) * np.log2(g) - 2 * self.exponent)), around)]
        for step, weight in zip(self.A[:0:-1], R[:0:-1], strict=True):
            X.append((transform(step, X[-1]) - weight) / g)
        found = np.empty_like(R)
        found[self.order] = [X[0], *X[:0:-1]]
        return found

    def _stein(self, c: float, R: Array) -> Array:
        """``M' X M - c X = c R`` for the product M, column by column in the coordinates in which it is triangular."""
        U, Z = self.triangle, self.vectors
        if not (np.isfinite(R).all() and np.isfinite(c)):
            return np.full_like(R, np.nan)
        F, Y = c * (Z.conj().T @ R @ Z), np.zeros_like(U)
        lower, unit = U.conj().T, np.eye(len(U))
        for j in range(len(U)):
            known = F[:, j] - lower @ (Y[:, :j] @ U[:j, j])
            try:
                Y[:, j] = solve_triangular(U[j, j] * lower - c * unit, known, lower=True, check_finite=False)
            except np.linalg.LinAlgError:
                return np.full_like(R, np.nan)
        return (Z @ Y @ Z.conj().T).real
