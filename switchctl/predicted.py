"""The moments along a run, and how far they are from where they should be."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from switchctl.gaussian import Gaussian, wasserstein
from switchctl.modes import ModeSet
from switchctl.moments import Array, stepped

Indices = NDArray[np.intp]


def next_factor(modes: ModeSet, before: int, mode: int, F: Array) -> Array:
    """The moment factor after a step in a mode that follows another (-1 for none), with the mode's noise."""
    noise = modes.noise_roots
    return stepped(F, modes.A_after[before, mode], None if noise is None else noise[mode])


def factors_along(modes: ModeSet, before: Iterable[int], sequence: Iterable[int], F: Array) -> Iterator[Array]:
    """The moment factor at each step of a run and after the last.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    before, sequence : iterables of int, length N
        The mode before each step (-1 for none), and the mode of the step.
    F : array, shape (n, n + 1)
        The moment factor at the first.

    Yields
    ------
    array, shape (n, n + 1)
    """
    yield F
    for last, mode in zip(before, sequence, strict=True):
        F = next_factor(modes, last, mode, F)
        yield F


def overflow(modes: ModeSet, F: Array, k: int) -> str:
    """Say which states have become too great after a step."""
    with np.errstate(over="ignore", invalid="ignore"):
        great = np.flatnonzero(~np.isfinite(np.sum(F**2, axis=1)))
    if len(great) and great[0] >= modes.plant_states:
        return (
            f"a controller's state, {modes.states[great[0]]!r}, exceeds the floating-point range after step {k}: it "
            "grows while another controller acts; choose inactive='track' or 'reset' for it"
        )
    if k < 0:
        return "W2 exceeds the floating-point range at the start; scale the state"
    return f"W2 exceeds the floating-point range after step {k}; use a method that keeps the state bounded"


def predicted(
    modes: ModeSet, before: Indices, sequence: Indices, F: Array, target: Gaussian | None
) -> tuple[Array, Array, Gaussian]:
    """W2 and the state's cost at each step of a run, and the state after the last.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    before, sequence : int arrays, shape (N,)
        The mode before each step, and the mode of the step.
    F : array, shape (n, n + 1)
        The moment factor at the first.
    target : Gaussian, optional
        What W2 is the distance to, and the state's cost too; the origin by default.

    Returns
    -------
    w2, stage : arrays, shape (N,)
    final : Gaussian
    """
    Q, plant, kept = modes.Q_after, modes.plant_states, []
    w2, stage = np.empty(len(sequence) + 1), np.empty(len(sequence))
    with np.errstate(over="ignore", invalid="ignore"):
        for k, F in enumerate(factors_along(modes, before, sequence, F)):  # noqa: B020
            w2[k] = np.vdot(F, F) if k == len(stage) else np.vdot(F[:plant], F[:plant])
            if not np.isfinite(w2[k]) or (plant < len(F) and not np.isfinite(F).all()):
                raise FloatingPointError(overflow(modes, F, k - 1))
            if k < len(stage):
                stage[k] = np.vdot(F, Q[before[k], sequence[k]] @ F)
                if target is not None:
                    kept.append(F)
    w2 = w2[:-1]
    if target is not None:
        w2 = stage = squared_distances(modes, np.array(kept), target)
    return w2, stage, Gaussian(F[:, 0], F[:, 1:] @ F[:, 1:].T)


def squared_distances(modes: ModeSet, factors: Array, target: Gaussian) -> Array:
    """Squared Wasserstein distance of the plant's state to a target, for a batch of moment factors.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    factors : array, shape (N, n, n + 1)
        Moment factors of the whole state.
    target : Gaussian
        Of the plant's state.

    Returns
    -------
    array, shape (N,)
    """
    plant = factors[:, : modes.plant_states]
    roots = plant[:, :, 1:]
    reached = Gaussian(plant[:, :, 0], roots @ np.swapaxes(roots, 1, 2))
    return np.asarray(wasserstein(reached, target) ** 2)
