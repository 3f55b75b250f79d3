"""What a controller with a state of its own does while another one acts, and when it takes over."""

from typing import Any, Literal, NamedTuple

import numpy as np
from control import ControlDimension
from scipy.linalg import solve_continuous_are, solve_discrete_are

from switchctl.gramians import tail
from switchctl.moments import Array
from switchctl.schur import is_schur
from switchctl.validation import real_array

Inactive = Literal["track", "reset", "hold", "run"] | tuple[Literal["track", "reset"], Any]
"""``"track"`` or ``("track", L)``, ``"reset"`` or ``("reset", Z)``, ``"hold"``, ``"run"``: see `close_loops`."""
KINDS = ("track", "reset", "hold", "run")
_MEMORY = 1000  # samples in which the state of a tracking controller gathers noise
_SEEN = 1e-2  # of the noise on the output a tracking controller sees, as a fraction of what its state's makes of it


def inactive_behaviour(value: Any, label: str) -> tuple[str, Any]:
    """The kind and, where it is given, the gain or map."""
    kind, matrix = value if isinstance(value, tuple) and len(value) == 2 else (value, None)
    if not isinstance(kind, str) or kind not in KINDS or (matrix is not None and kind not in ("track", "reset")):
        raise ValueError(
            f"inactive of {label} is {value!r}; expected 'track', ('track', L) with an observer gain, 'reset', "
            "('reset', Z) with the state it is reset to as a linear function of the plant's, 'hold' or 'run'"
        )
    return kind, matrix


class TrackingNoise(NamedTuple):
    """Covariances of the noise for which a tracking gain is designed: on the controller's state and output.

    Intensities of the noise where the controller is continuous.
    """

    state: Array
    output: Array
    sampled: bool = True


def tracking_noise(F: Array, G: Array, H: Array) -> TrackingNoise:
    """The noise for a sampled controller: what white noise on its input gathers in it in about a thousand samples.

    So slow states are moved more than fast ones, which follow by themselves; and the output is seen through a hundredth
    of what this makes of it. It changes with the coordinates of the state, and with its units, as a gain must.
    """
    state: Array | None = None
    memory = float(_MEMORY)
    while state is None and memory > 1:
        try:
            state = tail(np.sqrt(1 - 1 / memory) * F.T, G @ G.T / memory)
        except np.linalg.LinAlgError:
            pass
        memory /= 4  # of an unstable controller for a shorter time
    state = G @ G.T if state is None else state
    output = H @ state @ H.T
    variances = np.diag(output)
    floor = 1e-9 * np.diag(np.where(variances > 0, variances, 1.0))
    return TrackingNoise(state, _SEEN * output + floor)


def tracking_gain(F: Array, H: Array, noise: TrackingNoise, gain: Any, label: str) -> Array:
    """The L by which a controller follows: ``x+ = F x + G y + L (v - H x - D y)``, v the output that acts instead.

    Parameters
    ----------
    F, H : arrays
        The controller, sampled or continuous as the noise is.
    noise : TrackingNoise
        What the Kalman gain is computed for.
    gain : array, shape (states, outputs), or None
        L, where the user gives it.
    label : str
        The controller's name in messages.

    Returns
    -------
    array, shape (states, outputs)
    """
    L: Array | None = None
    if gain is not None:
        L = gain
    else:
        try:
            if noise.sampled:
                P = solve_discrete_are(F.T, H.T, noise.state, noise.output)
                L = np.asarray(np.linalg.solve(H @ P @ H.T + noise.output, H @ P @ F.T).T, dtype=float)
            else:
                P = solve_continuous_are(F.T, H.T, noise.state, noise.output)
                L = np.asarray(np.linalg.solve(noise.output, H @ P).T, dtype=float)
        except (ValueError, np.linalg.LinAlgError):
            pass
    if L is not None:
        eigenvalues = np.linalg.eigvals(F - L @ H)
        if is_schur(F - L @ H) if noise.sampled else bool((eigenvalues.real < 0).all()):
            return L
    if L is None or gain is None:
        raise ValueError(
            f"no tracking gain was found for {label}: a part of it that doesn't decay can't be seen at its output "
            "or moved by its input; give one, ('track', L), or another choice of inactive"
        )
    told = (
        f"spectral radius {np.abs(eigenvalues).max():.6g}"
        if noise.sampled
        else f"an eigenvalue with real part {eigenvalues.real.max():.6g}"
    )
    raise ValueError(
        f"the tracking gain leaves {label} unstable while it is inactive: F - L H has {told}; choose another gain"
    )


def check_initial(value: Any, label: str) -> None:
    """Refuse words that say nothing of a controller's state at the start."""
    if isinstance(value, str) and value not in ("zero", "settled"):
        raise ValueError(f"initial of {label} is {value!r}; expected 'zero', 'settled' or a matrix")


def initial_map(value: Any, F: Array, GC: Array, label: str, sampled: bool = True) -> Any:
    """A controller's state at the start as a function of the plant's: "zero", "settled" or a matrix."""
    if isinstance(value, str) and value == "zero":
        return np.zeros_like(GC)
    if isinstance(value, str) and value == "settled":
        away = np.eye(len(F)) - F if sampled else -F
        if len(F) and np.linalg.cond(away) > 1e12:
            raise ValueError(
                f"{label} can't start settled: it has an integrator, whose state no constant input tells; give its "
                "initial state as a matrix, or 'zero'"
            )
        return np.linalg.solve(away, GC)
    matrix = real_array(value, f"initial of {label}")
    if matrix.shape != GC.shape:
        raise ControlDimension(f"initial of {label} has shape {matrix.shape}; expected {GC.shape}, states by plant's")
    return matrix
