"""What a run is given besides its plant and its loops: operating point, actuator limits, noise, seed, start."""

from typing import Any, NamedTuple

import numpy as np
from control import ControlDimension

from switchctl.closed_loop import ClosedLoops
from switchctl.gaussian import Gaussian
from switchctl.moments import Array, moment_factor
from switchctl.validation import float_array, real_array, semidefinite, whole_number


class OperatingPoint(NamedTuple):
    """State and input that the loops are closed about: constant, or one at each sample along the last axis."""

    states: Array
    inputs: Array

    def at(self, k: int) -> tuple[Array, Array]:
        """State and input at a sample; the last input is held."""
        x, u = self.states, self.inputs
        return (x if x.ndim == 1 else x[:, k]), (u if u.ndim == 1 else u[:, min(k, u.shape[1] - 1)])


def operating_point(value: Any, n: int, q: int, steps: int) -> OperatingPoint:
    """Read an operating point or a reference trajectory; the origin by default."""
    if value is None:
        return OperatingPoint(np.zeros(n), np.zeros(q))
    try:
        states, inputs = (value.states, value.inputs) if hasattr(value, "states") else value
    except (TypeError, ValueError):
        raise TypeError(
            "operating_point must be (state, input), as control.find_operating_point returns it, not a "
            f"{type(value).__name__}"
        ) from None
    parts = []
    for part, what, size, count in ((states, "state", n, steps + 1), (inputs, "input", q, steps)):
        array = real_array(part, f"the {what} of operating_point")
        if array.shape not in ((size,), (size, count)):
            raise ControlDimension(
                f"the {what} of operating_point has shape {array.shape}; expected {(size,)}, or {(size, count)} "
                f"for a trajectory of {steps} steps"
            )
        parts.append(array)
    return OperatingPoint(*parts)


def limits(value: Any, q: int) -> tuple[Array, Array]:
    """Actuator limits, shapes (q,); infinite where there are none."""
    if value is None:
        return np.full(q, -np.inf), np.full(q, np.inf)
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise TypeError(f"saturation must be (low, high), not {value!r}")
    sides = []
    for side, name in zip(value, ("low", "high"), strict=True):
        array = float_array(side, f"saturation's {name}")
        if array.shape not in ((), (1,), (q,)):
            raise ControlDimension(f"saturation's {name} has shape {array.shape}; expected a number or ({q},)")
        sides.append(np.broadcast_to(array, (q,)))
    low, high = sides
    if not (low <= high).all() or np.isposinf(low).any() or np.isneginf(high).any():
        raise ValueError(f"saturation is ({low.tolist()}, {high.tolist()}); expected low <= high for every input")
    return low, high


def noise_root(value: Any, modes: ClosedLoops) -> Array | None:
    """A root of the covariance of measurement noise, shape (p, p)."""
    assert modes.plant is not None and modes.controllers is not None
    if value is None:
        return None
    if not modes.controllers.by_output:
        raise ValueError("noise is of the plant's output, and these controllers don't measure it, but the state")
    if isinstance(value, (bool, np.bool_)):
        raise TypeError(
            f"noise is {value!r}; expected a covariance, False for none, or nothing for what the modes know"
        )
    p = modes.plant.noutputs
    return moment_factor(np.zeros(p), semidefinite(value, "noise", p))[:, 1:]


def generator(seed: Any) -> np.random.Generator:
    """A random generator from a seed: a whole number, or a numpy SeedSequence; a generator would be changed."""
    if not isinstance(seed, np.random.SeedSequence):
        seed = whole_number(seed, "seed", 0)
    return np.random.default_rng(seed)


def start(x0: Any, modes: ClosedLoops, x_e: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """The plant's and the controllers' states at the start."""
    assert modes.controllers is not None
    n, whole = modes.plant_states, modes.A.shape[-1]
    shape = x0.mean.shape if isinstance(x0, Gaussian) else (x0 := real_array(x0, "x0")).shape
    if shape not in ((n,), (whole,)):
        controllers = f", or ({whole},) with those of the controllers" if whole > n else ""
        raise ControlDimension(f"x0 has shape {shape}; the plant has {n} states, so expected ({n},){controllers}")
    mean = x0.mean if isinstance(x0, Gaussian) else x0
    if isinstance(x0, Gaussian):
        x0 = mean + moment_factor(mean, x0.cov)[:, 1:] @ random.standard_normal(shape[0])
    x = x0[:n]
    if shape != (n,):
        return x, x0[n:]
    zeta = modes.controllers.initial @ (x - x_e)
    if modes.estimate_states:  # only the mean is known
        zeta[-n:] = mean - x_e
    return x, zeta
