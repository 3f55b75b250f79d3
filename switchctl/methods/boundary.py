"""What methods are handed, and what they hand back, checked."""

from typing import Any

import numpy as np
from control import ControlDimension

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph
from switchctl.methods.base import Method, Scheduler
from switchctl.modes import ModeSet, require_modes
from switchctl.validation import shown, symmetric


def require_method(method: Any) -> None:
    """Refuse what is no `Method`."""
    if not isinstance(method, Method):
        made = "; make one of the class: add its settings in ()" if isinstance(method, type) else ""
        raise TypeError(f"method must be a Method such as RecedingHorizon(horizon=50), not {shown(method)}{made}")


def started(method: Method, graph: SwitchingGraph) -> Scheduler:
    """The running scheduler of a method, checked to be one."""
    scheduler = method.start(graph)
    if not isinstance(scheduler, Scheduler):
        raise TypeError(f"{type(method).__name__}.start must return a Scheduler, not {shown(scheduler)}")
    return scheduler


def require_target(modes: ModeSet, target: Any) -> None:
    """Refuse what is no distribution of the plant's state."""
    if not isinstance(target, Gaussian):
        raise TypeError(f"target must be a Gaussian, not a {type(target).__name__}; for a point, x0.about(point)")
    if target.mean.shape != (modes.plant_states,):
        raise ControlDimension(
            f"target has a mean of shape {target.mean.shape}; the plant has {modes.plant_states} states"
        )


def initial_state(modes: ModeSet, x0: Gaussian) -> Gaussian:
    """The Gaussian of all states at the start, from that or from the plant's alone."""
    require_modes(modes)
    if not isinstance(x0, Gaussian):
        raise TypeError(
            f"x0 must be a Gaussian, not a {type(x0).__name__}; a state known exactly has cov = np.zeros((n, n))"
        )
    n, p, M = modes.A.shape[-1], modes.plant_states, modes.initial
    with np.errstate(over="ignore", under="ignore"):
        size = np.sum(x0.mean**2) + np.trace(x0.cov, axis1=-2, axis2=-1).sum()
    if not np.isfinite(size):
        raise FloatingPointError("the second moment of x0 exceeds the floating-point range; scale the state")
    if size < np.finfo(float).tiny and (x0.mean.any() or x0.cov.any()):
        raise FloatingPointError("the second moment of x0 is lost below the floating-point range; scale the state")
    if x0.mean.shape == (n,):
        return x0
    if x0.mean.shape == (p,):
        uncertain = M.copy()
        uncertain[n - modes.estimate_states :] = 0.0
        return Gaussian(M @ x0.mean, symmetric(uncertain @ x0.cov @ uncertain.T, "cov"))
    plant = f", or of the {p} of the plant, so ({p},)" if p < n else ""
    raise ControlDimension(
        f"x0 has a mean of shape {x0.mean.shape}; the modes have {n} states, so expected ({n},){plant}"
    )
