"""What a controller with a state of its own does while another one acts, and when it takes over."""

from typing import Any, Literal

import numpy as np
from control import ControlDimension
from scipy.linalg import solve_continuous_are, solve_discrete_are

from switchctl.gramians import is_schur
from switchctl.moments import Array
from switchctl.validation import real_array

Inactive = Literal["track", "reset", "hold", "run"] | tuple[Literal["track", "reset"], Any]
"""``"track"`` or ``("track", L)``, ``"reset"`` or ``("reset", Z)``, ``"hold"``, ``"run"``: see `close_loops`."""
KINDS = ("track", "reset", "hold", "run")
_NOISE = 1e-2  # of the output a tracking controller sees, as a fraction of what its input's noise makes of it


def inactive_behaviour(value: Any, label: str) -> tuple[str, Any]:
    """The kind and, where it is given, the gain or map."""
    kind, matrix = value if isinstance(value, tuple) and len(value) == 2 else (value, None)
    if not isinstance(kind, str) or kind not in KINDS or (matrix is not None and kind not in ("track", "reset")):
        raise ValueError(
            f"inactive of {label} is {value!r}; expected 'track', ('track', L) with an observer gain, 'reset', "
            "('reset', Z) with the state it is reset to as a linear function of the plant's, 'hold' or 'run'"
        )
    return kind, matrix


def tracking_gain(F: Array, G: Array, H: Array, D: Array, gain: Any, label: str, scale: Array | None = None) -> Any:
    """The L by which a controller follows: ``x+ = F x + G y + L (v - H x - D y)``, v the output that acts instead.

    By default the Kalman gain for white noise that enters the state as y does, v seen through a hundredth of the noise
    that this makes of it. So it doesn't depend on the coordinates of x or on units, and the output follows within a
    few samples.

    Parameters
    ----------
    F, G, H, D : arrays
        The controller, sampled; or continuous where there is a scale.
    gain : array_like, shape (states, outputs), or None
        L, where the user gives it.
    label : str
        The controller's name in messages.
    scale : array, shape (outputs, outputs), optional
        Of a continuous controller: what the noise makes of the output.

    Returns
    -------
    array, shape (states, outputs)
    """
    if gain is not None:
        L = real_array(gain, f"the tracking gain of {label}", (len(F), len(H)))
    else:
        L = None
        noise = _NOISE * (output_scale(F, G, H) if scale is None else scale)
        try:
            if scale is None:
                P = solve_discrete_are(F.T, H.T, G @ G.T, noise)
                L = np.asarray(np.linalg.solve(H @ P @ H.T + noise, H @ P @ F.T).T, dtype=float)
            else:
                P = solve_continuous_are(F.T, H.T, G @ G.T, noise)
                L = np.asarray(np.linalg.solve(noise, H @ P).T, dtype=float)
        except (ValueError, np.linalg.LinAlgError):
            pass
    if L is not None:
        eigenvalues = np.linalg.eigvals(F - L @ H)
        if is_schur(F - L @ H) if scale is None else bool((eigenvalues.real < 0).all()):
            return L
    if L is None or gain is None:
        raise ValueError(
            f"no tracking gain was found for {label}: a part of it that doesn't decay can't be seen at its output "
            "or moved by its input; give one, ('track', L), or another choice of inactive"
        )
    told = (
        f"spectral radius {np.abs(eigenvalues).max():.6g}"
        if scale is None
        else f"an eigenvalue with real part {eigenvalues.real.max():.6g}"
    )
    raise ValueError(
        f"the tracking gain leaves {label} unstable while it is inactive: F - L H has {told}; choose another gain"
    )


def output_scale(F: Array, G: Array, H: Array) -> Array:
    """What unit white noise on the state of a sampled controller, by its input, makes of its output."""
    total, response = np.zeros((len(H), len(H))), G
    for _ in range(len(F)):
        total, response = total + H @ response @ response.T @ H.T, F @ response
    scale = float(np.trace(total)) or 1.0
    return total + 1e-6 * scale * np.eye(len(total))


def reset_map(value: Any, states: int, plant_states: int, label: str) -> Array:
    """The state that a controller is reset to, as a function of the plant's."""
    if value is None:
        return np.zeros((states, plant_states))
    return real_array(value, f"the reset of {label}", (states, plant_states))


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
    if isinstance(value, str):
        raise ValueError(f"initial of {label} is {value!r}; expected 'zero', 'settled' or a matrix of shape {GC.shape}")
    matrix = real_array(value, f"initial of {label}")
    if matrix.shape != GC.shape:
        raise ControlDimension(f"initial of {label} has shape {matrix.shape}; expected {GC.shape}, states by plant's")
    return matrix
