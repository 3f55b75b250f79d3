"""The algebra of closing loops: a plant and what runs beside it, as one matrix for each controller."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import control
import numpy as np

from switchctl.controllers import Controllers
from switchctl.moments import Array
from switchctl.sampling import exact_step, sampled_noise

_ILL_POSED = 1e8


class Loops(NamedTuple):
    """Closed loops: ``z+ = A z + noise v`` and ``u = -(gains z + by_noise v)``, v the measurement noise."""

    A: Array
    gains: Array
    noise: Array
    by_noise: Array


def closed(plant: control.StateSpace, controllers: Controllers) -> Loops:
    """The loops of one plant with each controller, in the whole state z = (x, zeta)."""
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    with np.errstate(over="ignore", invalid="ignore"):
        loop = np.eye(plant.ninputs) + controllers.Hy @ D
    for name, Hy, each in zip(controllers.names, controllers.Hy, loop, strict=True):
        least = float(np.linalg.norm(each, -2)) if np.isfinite(each).all() else 0.0
        # relative to what cancels where the loop is ill-posed
        condition = (1 + float(np.linalg.norm(Hy, 2)) * float(np.linalg.norm(D, 2))) / least if least else np.inf
        if not condition < _ILL_POSED:
            raise ValueError(
                f"the loop of controllers[{name!r}] is ill-posed, or nearly so: I + K D, D the plant's feedthrough, "
                f"has condition number {condition:.3g} (at most {_ILL_POSED:.0e} is accepted); change the gain or "
                "the feedthrough"
            )
    with np.errstate(over="ignore", invalid="ignore"):
        gains = np.linalg.solve(loop, np.concatenate([controllers.Hx + controllers.Hy @ C, controllers.Hz], axis=2))
    by_noise = np.linalg.solve(loop, controllers.Hy)
    m, z = len(gains), len(controllers.states)
    # x+ = A x + B u and zeta+ = F zeta + Gx x + Gy (C x + D u + v) + Gu u, with u = -gains z - by_noise v
    x_part, nothing = np.broadcast_to(A, (m, *A.shape)), np.zeros((len(A), z))
    open_loop = blocks(x_part, nothing, controllers.Gx + controllers.Gy @ C, controllers.F)
    into = np.concatenate([np.broadcast_to(B, (m, *B.shape)), controllers.Gu + controllers.Gy @ D], axis=1)
    direct = np.concatenate([np.zeros((m, len(A), len(C))), controllers.Gy], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        loops = Loops(open_loop - into @ gains, gains, direct - into @ by_noise, by_noise)
    for name, *parts in zip(controllers.names, *loops, strict=True):
        if not all(np.isfinite(part).all() for part in parts):
            raise ValueError(
                f"the loop of controllers[{name!r}] exceeds the floating-point range; scale the states or the inputs"
            )
    return loops


def blocks(A: Array, B: Array, C: Array, D: Array) -> Array:
    """The matrices [[A, B], [C, D]], one for each of a batch."""
    B = np.broadcast_to(B, (*A.shape[:-2], *B.shape[-2:]))
    return np.concatenate([np.concatenate([A, B], axis=-1), np.concatenate([C, D], axis=-1)], axis=-2)


def waiting(n: int, each: list[Any], behaviours: list[Any]) -> Iterator[tuple[Any, slice, str]]:
    """Of each controller that is held or waits for a reset: the modes in which it does, its states, and which."""
    begin = n
    for j, c in enumerate(each):
        own = slice(begin, begin := begin + len(c.F))
        kind = behaviours[j] if isinstance(behaviours[j], str) else behaviours[j][0]
        if kind in ("hold", "reset") and len(c.F):
            yield np.flatnonzero(np.arange(len(each)) != j), own, kind


def sampled_loops(A: Array, W: Array, period: float, waits: list[tuple[Any, slice, str]]) -> tuple[Array, Array]:
    """Loops closed in continuous time, and the intensities of their noise, at the samples.

    What sampling can't know or rounds is made good: the states held, and those that wait for a reset at zero.
    """
    noise = np.stack([sampled_noise(Ai, Wi, period) for Ai, Wi in zip(A, W, strict=True)])
    steps = np.stack([exact_step(Ai, period) for Ai in A])
    for others, own, kind in waits:
        noise[others, own] = 0.0
        noise[others, :, own] = 0.0
        steps[others, own] = 0.0
        steps[others, own, own] = np.eye(own.stop - own.start) * (kind == "hold")
    return steps, noise
