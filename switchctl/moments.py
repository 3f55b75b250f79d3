"""The kernel: Gaussian moments moved by modes, in NumPy alone.

A mode ``x+ = A x`` moves a Gaussian by ``mean+ = A mean``, ``cov+ = A cov A'`` (equations 11 and 12 of Lee
and Bhattacharya, DSCC 2014), and so its second moment ``S = mean mean' + cov`` by ``S+ = A S A'``. Symmetric
matrices are flattened by the isometric half-vectorisation `svec`, in which a step of a mode is one matrix and a
cost ``tr(Q S)`` one dot product.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from switchctl.storage import affordable

Array = NDArray[np.float64]


@lru_cache(maxsize=64)
def _triangle(n: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    rows, columns = np.tril_indices(n)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def svec(X: Array) -> Array:
    """Half-vectorise symmetric matrices isometrically: ``tr(X Y) = svec(X) . svec(Y)``.

    Parameters
    ----------
    X : array, shape (..., n, n)
        Symmetric matrices; the lower triangle is read.

    Returns
    -------
    array, shape (..., n (n + 1) / 2)
        The triangle row by row, off-diagonal entries times sqrt(2).

    Examples
    --------
    >>> X, Y = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([[0.0, 4.0], [4.0, 5.0]])
    >>> print(svec(X) @ svec(Y), np.trace(X @ Y))
    23.0 23.0
    """
    rows, columns, weights = _triangle(X.shape[-1])
    return X[..., rows, columns] * weights


def smat(s: Array) -> Array:
    """Undo `svec`: vectors of length n (n + 1) / 2 to symmetric n by n matrices.

    Parameters
    ----------
    s : array, shape (..., n (n + 1) / 2)
        Half-vectorised symmetric matrices.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> smat(svec(np.array([[2.0, 1.0], [1.0, 3.0]])))
    array([[2., 1.],
           [1., 3.]])
    """
    n = int(np.sqrt(2 * s.shape[-1]))
    rows, columns, weights = _triangle(n)
    place = np.empty((n, n), dtype=np.intp)
    place[rows, columns] = place[columns, rows] = np.arange(len(rows))
    return (s / weights)[..., place]


def moment_maps(A: Array) -> Array:
    """Symmetric Kronecker maps: the matrix K with ``svec(A S A') = K svec(S)``.

    The paper's ``A (x) A`` on ``vec(S)`` without its redundancy. N moments, the rows of an array, move at
    once by ``moments @ K.T``.

    Parameters
    ----------
    A : array, shape (..., n, n)
        Modes.

    Returns
    -------
    array, shape (..., d, d), with d = n (n + 1) / 2

    Raises
    ------
    MemoryError
        If they would need too much.

    Examples
    --------
    >>> A, S = np.array([[1.0, 2.0], [0.0, 3.0]]), np.array([[2.0, 1.0], [1.0, 3.0]])
    >>> np.allclose(moment_maps(A) @ svec(S), svec(A @ S @ A.T))
    True
    """
    n = A.shape[-1]
    d = n * (n + 1) // 2
    affordable(
        4 * 8 * d * d * (A.size // (n * n)),
        f"the moment maps of {n} states, {d} by {d} for each mode,",
        "use fewer states",
    )
    i, j, weights = _triangle(n)

    def entries(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
        return A[..., rows[:, None], columns]

    symmetric = entries(i, i) * entries(j, j) + entries(i, j) * entries(j, i)
    return symmetric * np.outer(weights, weights) / 2


def moment_factor(mean: Array, cov: Array) -> Array:
    """A factor ``F = [mean, L]`` of the second moment, ``S = F F'``, with ``L L' = cov``.

    A step of a mode is ``F+ = A F``, equations (11) and (12) of the paper at once. The covariance ``L L'`` can't lose
    symmetry or definiteness on the way, and ``W2 = ||F||^2`` can't become negative.

    Parameters
    ----------
    mean, cov : arrays, shapes (n,) and (n, n)
        A Gaussian.

    Returns
    -------
    array, shape (n, n + 1)

    Examples
    --------
    >>> F = moment_factor(np.array([3.0]), np.array([[4.0]]))
    >>> F @ F.T
    array([[13.]])
    """
    return np.column_stack([mean, root(cov)])


def second_moment(mean: Array, cov: Array) -> Array:
    """``S = mean mean' + cov``, for one Gaussian or a batch.

    Parameters
    ----------
    mean, cov : arrays, shapes (..., n) and (..., n, n)
        The Gaussians.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> second_moment(np.array([3.0]), np.array([[4.0]]))
    array([[13.]])
    """
    return mean[..., :, None] * mean[..., None, :] + cov


def stepped(F: Array, A: Array, noise_root: Array | None = None) -> Array:
    """A moment factor one step on: ``F+ = A F``, and with noise the covariance ``A L L' A' + R R'`` factored anew.

    Parameters
    ----------
    F : array, shape (n, n + 1)
        A moment factor.
    A : array, shape (n, n)
        The step.
    noise_root : array, shape (n, n), optional
        A factor R of the covariance of the noise.

    Returns
    -------
    array, shape (n, n + 1)

    Examples
    --------
    >>> stepped(np.array([[3.0, 2.0]]), np.array([[0.5]]))
    array([[1.5, 1. ]])
    """
    moved = A @ F
    if noise_root is None:
        return moved
    wide = np.concatenate([moved[:, 1:], noise_root], axis=1)
    return np.column_stack([moved[:, 0], np.asarray(np.linalg.qr(wide.T, mode="r")).T])


def trajectory(A: Array, steps: Iterable[Any], F: Array) -> Array:
    """Moment factors along a run.

    Parameters
    ----------
    A : array, shape (..., n, n)
        The matrices of steps.
    steps : iterable of N indices
        Which of them each step takes.
    F : array, shape (n, n + 1)
        The initial moment factor.

    Returns
    -------
    array, shape (N + 1, n, n + 1)

    Examples
    --------
    >>> trajectory(np.array([[[0.5]], [[2.0]]]), [0, 1], np.array([[4.0, 0.0]]))[:, 0, 0]
    array([4., 2., 4.])
    """
    factors = [F]
    for step in steps:
        factors.append(A[step] @ factors[-1])
    return np.array(factors)


def constant_w2(A: Array, S: Array, steps: int, plant_states: int | None = None) -> Array:
    """W2 of every mode held from the start, ``tr(A^k S A'^k)``, all modes at once.

    Parameters
    ----------
    A : array, shape (m, n, n)
        The modes.
    S : array, shape (n, n)
        The initial second moment.
    steps : int
        The number of samples, k = 0 .. steps - 1.
    plant_states : int, optional
        How many of the states, the first ones, count; all by default.

    Returns
    -------
    array, shape (m, steps)
        Infinite beyond the floating-point range.

    Examples
    --------
    >>> constant_w2(np.array([[[0.5]], [[2.0]]]), np.array([[4.0]]), 3)
    array([[ 4.  ,  1.  ,  0.25],
           [ 4.  , 16.  , 64.  ]])
    """
    w2 = np.empty((len(A), steps))
    F = np.broadcast_to(root(S), A.shape)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(steps):
            counted = F[:, :plant_states]
            w2[:, k] = np.einsum("mij,mij->m", counted, counted)
            F = A @ F
    return np.where(np.isnan(w2), np.inf, w2)  # inf - inf is beyond the range


def root(S: Array) -> Array:
    """A factor L of a positive semidefinite matrix, ``L L' = S``, computed in units fit for each state.

    Parameters
    ----------
    S : array, shape (n, n)
        The matrix.

    Returns
    -------
    array, shape (n, n)

    Examples
    --------
    >>> L = root(np.array([[4.0, 2.0], [2.0, 1.0]]))  # singular
    >>> np.allclose(L @ L.T, [[4.0, 2.0], [2.0, 1.0]])
    True
    """
    diagonal = np.diag(S)
    uncertain = diagonal > 0
    unit = np.exp2(np.round(np.log2(np.where(uncertain, diagonal, 1.0)) / 2))
    eigenvalues, vectors = np.linalg.eigh(S / unit / unit[:, None])
    return (uncertain * unit)[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))


def closed_form_w2(A: Array, sequence: NDArray[np.intp], S: Array) -> float:
    """Proposition 3 of the paper, evaluated as it stands: W2(k) after a switching sequence.

    ``W2(k) = vec(I)' (A_sk (x) A_sk) .. (A_s1 (x) A_s1) vec(S)``, with the transpose that the paper's print
    omits and the latest factor on the left. The matrices are n^2 by n^2; `trajectory` and `constant_w2` give the
    same at a fraction of the cost.

    Parameters
    ----------
    A : array, shape (m, n, n)
        The modes.
    sequence : int array, shape (k,)
        The modes s1 .. sk.
    S : array, shape (n, n)
        The initial second moment.

    Returns
    -------
    float

    Examples
    --------
    >>> A = np.array([[[0.5, 0.0], [0.0, 0.5]], [[0.0, 2.0], [1.0, 0.0]]])
    >>> closed_form_w2(A, np.array([0, 1]), np.eye(2))
    1.25
    """
    n = A.shape[-1]
    affordable(3 * 8 * n**4, f"the Kronecker products of {n} states, {n * n} by {n * n},", "use `trajectory`")
    product = np.eye(n * n)
    for mode in sequence:
        product = np.kron(A[mode], A[mode]) @ product
    return float(np.eye(n).ravel() @ product @ S.ravel())


def transform(M: Array, G: Array) -> Array:
    """``M' G M``, symmetrised: what a cost matrix G is worth before a step M.

    Parameters
    ----------
    M, G : arrays, shape (..., n, n)
        A mode (or a power of one), and a symmetric matrix.

    Returns
    -------
    array, shape (..., n, n)

    Examples
    --------
    >>> transform(np.array([[0.5]]), np.array([[4.0]]))
    array([[1.]])
    """
    product = np.swapaxes(M, -1, -2) @ G @ M
    return (product + np.swapaxes(product, -1, -2)) / 2
