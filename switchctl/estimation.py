"""A Kalman filter in the loop: its gain, and how uncertain its estimate stays."""

from typing import Any

import control
import numpy as np
from scipy.linalg import matrix_balance, solve_discrete_are

from switchctl.gramians import tail
from switchctl.moments import Array
from switchctl.schur import is_schur
from switchctl.validation import positive_semidefinite, real_array

_ROUNDS = 100


def filter_gain(plant: control.StateSpace, estimator: Any, W: Array, V: Array | None) -> Array:
    """The L of ``xe+ = A xe + B u + L (y - C xe - D u)``: the steady Kalman gain, or the one given.

    Parameters
    ----------
    plant : control.StateSpace
        The sampled plant.
    estimator : "kalman" or array_like, shape (n, p)
        Which.
    W : array, shape (m, n, n)
        Covariance of the process noise in each mode.
    V : array, shape (p, p), or None
        Covariance of the measurement noise.

    Returns
    -------
    array, shape (n, p)

    Raises
    ------
    ValueError
        If noise is missing or singular where the gain is to be computed, or the estimate doesn't converge.
    """
    if isinstance(estimator, str):
        if estimator != "kalman":
            raise ValueError(f"estimator is {estimator!r}; expected 'kalman' or a gain of shape (states, outputs)")
        if (W != W[0]).any():
            raise ValueError("estimator='kalman' needs one W for all modes; give the gain where they differ")
        if V is None or not _definite(V):
            raise ValueError("estimator='kalman' needs V, the covariance of the measurement noise, positive definite")
        try:
            L = _kalman_gain(plant.A, plant.C, W[0], V)
        except (ValueError, ArithmeticError) as error:
            raise ValueError(
                f"no Kalman gain was found ({' '.join(str(error).split())}); the plant may have an unstable state that "
                "its output doesn't show, or one on the unit circle that no noise moves (give W)"
            ) from None
    else:
        L = real_array(estimator, "estimator", (plant.nstates, plant.noutputs))
    if not is_schur(plant.A - L @ plant.C):
        radius = np.abs(np.linalg.eigvals(plant.A - L @ plant.C)).max()
        raise ValueError(
            f"the estimate doesn't converge: A - L C has spectral radius {radius:.6g}; the plant may have an unstable "
            "state that its output doesn't show, or one on the unit circle that no noise moves (give W)"
        )
    return L


def _kalman_gain(A: Array, C: Array, W: Array, V: Array) -> Array:
    """The steady gain, computed where A is balanced, V has a diagonal of 1 and C the norm 1.

    SciPy's solution of the Riccati equation is sure in such units only. The gain is improved by Hewer's iteration (IEEE
    Transactions on Automatic Control 16, 1971), which converges from any stable one and shows that it has: it is the
    best for the error that it leaves itself.
    """
    outputs, states = np.sqrt(np.diag(V)), matrix_balance(A, permute=False, separate=True)[1][0]
    states = states / (float(np.linalg.norm(C * states / outputs[:, None])) or 1.0)
    A, C = A * states / states[:, None], C * states / outputs[:, None]
    W, V = W / states / states[:, None], V / outputs / outputs[:, None]
    start = W / (float(np.abs(W).max()) or 1.0)  # any noise that reaches as far gives a stable gain
    L = _best(A, C, np.asarray(solve_discrete_are(A.T, C.T, start, V)), V)
    for _ in range(_ROUNDS):
        P = tail((A - L @ C).T, W + L @ V @ L.T)
        if P is None:
            break  # not stable: the caller says so
        last, L = L, _best(A, C, P, V)
        unit = np.sqrt(np.diag(P))[:, None] + np.finfo(float).tiny
        if (np.abs(L - last) / unit).max() <= 1e-9 * (np.abs(L) / unit).max():
            break
    else:
        raise ArithmeticError("rounding hides it")
    return L * states[:, None] / outputs


def _best(A: Array, C: Array, P: Array, V: Array) -> Array:
    """The gain that is best for the next step, where the error has the covariance P."""
    return np.asarray(np.linalg.solve(C @ P @ C.T + V, C @ P @ A.T).T)


def _definite(V: Array) -> bool:
    """Whether a covariance is positive definite, in whatever units."""
    unit = np.sqrt(np.diag(V))
    return bool((unit > 0).all() and np.linalg.eigvalsh(V / np.outer(unit, unit))[0] > 1e-12)


def error_covariance(plant: control.StateSpace, L: Array, W: Array, V: Array | None) -> Array:
    """The steady covariance of the estimate's error, before the measurement of the sample is used.

    ``P = (A - L C) P (A - L C)' + W + L V L'``, with the mean of the modes' W.
    """
    noise = W.mean(axis=0) + (0.0 if V is None else L @ V @ L.T)
    P = tail((plant.A - L @ plant.C).T, positive_semidefinite(noise, "the noise"))
    assert P is not None  # filter_gain has made sure
    return P
