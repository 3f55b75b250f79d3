"""The digital side of a run: what is decided and computed at a sample."""

from collections.abc import Callable

import control
import numpy as np

from switchctl.closed_loop import ClosedLoops
from switchctl.moments import Array
from switchctl.simulation.feedthrough import closed_input
from switchctl.simulation.plants import Plant, Stopped
from switchctl.simulation.surroundings import OperatingPoint


class Computer:
    """Scheduler and controllers, sample by sample.

    Parameters
    ----------
    plant : Plant
        What is measured.
    modes : ClosedLoops
        The loops whose controllers run.
    decide : callable
        The mode, by the whole state, as far as it is known.
    before : int
        The mode that acted before the start, or -1.
    zeta : array, shape (z,)
        The controllers' states at the start.
    reference : OperatingPoint
        What they see deviations from.
    saturation : (array, array)
        The least and the greatest input.
    delay : bool
        Whether an input acts one sample after it is computed.
    noise : callable
        Draws the noise of a measurement, shape (p,).
    """

    def __init__(
        self,
        plant: Plant,
        modes: ClosedLoops,
        decide: Callable[[Array], int],
        before: int,
        zeta: Array,
        *,
        reference: OperatingPoint,
        saturation: tuple[Array, Array],
        delay: bool,
        noise: Callable[[], Array],
    ) -> None:
        assert modes.controllers is not None and modes.plant is not None
        self.plant, self.controllers, self.dk = plant, modes.controllers, modes.dk
        self.decide, self.before, self.zeta = decide, before, zeta
        self.estimated, self.n = modes.estimate_states > 0, modes.plant_states
        self.reference, self.saturation, self.noise = reference, saturation, noise
        linear = plant.system if isinstance(plant.system, control.StateSpace) else modes.plant
        self.feedthrough = np.array(linear.D)
        self.pending = self.limit(reference.at(0)[1]) if delay else None

    def limit(self, u: Array) -> Array:
        """The input that the actuators make of what is asked for."""
        return np.clip(u, *self.saturation)

    def sample(self, k: int, x: Array) -> tuple[int, Array, Array]:
        """Decide, compute and move on: the mode, the plant's output and the input that acts from this sample on."""
        controllers, t, (x_e, u_e) = self.controllers, k * self.dk, self.reference.at(k)
        dx = x - x_e
        known = self.zeta[-self.n :] if self.estimated else dx
        mode = self.decide(np.concatenate([known, self.zeta]))
        zeta = controllers.activated(self.before, mode, self.zeta, dx)
        away = self.noise()
        if controllers.by_output:
            away = away - self._expected(t, x_e, u_e)

        def asked(y: Array) -> Array:
            return u_e + controllers.output(mode, zeta, dx, y + away)

        loop = controllers.Hy[mode] @ self.feedthrough
        if self.pending is not None:
            applied = self.pending
            y = self.plant.output(t, x, applied)
            command = self.pending = self.limit(asked(y))
        elif loop.any():
            command = applied = self.limit(
                closed_input(lambda u: asked(self.plant.output(t, x, u)), loop, u_e, self.limit)
            )
            y = self.plant.output(t, x, applied)
        else:
            y = self.plant.output(t, x, u_e)
            command = applied = self.limit(asked(y))
            if self.feedthrough.any():  # this mode doesn't see it, others may
                y = self.plant.output(t, x, applied)
        zeta = controllers.updated(mode, zeta, dx, y + away, command - u_e)
        if not (np.isfinite(command).all() and np.isfinite(zeta).all()):
            raise Stopped("the controllers' output or state is not finite", what="stopped")
        self.before, self.zeta = mode, zeta
        return mode, y, applied

    def _expected(self, t: float, x_e: Array, u_e: Array) -> Array:
        """The output at the operating point."""
        try:
            return self.plant.output(t, x_e, u_e)
        except Stopped as stopped:
            raise ValueError(f"at operating_point, {stopped}; give the one that the plant was linearised at") from None
