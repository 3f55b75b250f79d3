"""Linear systems as they come from python-control: realised, checked and sampled."""

from collections.abc import Callable
from functools import partial
from typing import Any

import control
import numpy as np
from scipy.linalg import block_diag, expm, matrix_balance

from switchctl.moments import Array
from switchctl.validation import number, real_array, sampling_period

Sampling = str | tuple[str, float]
"""A method of `control.sample_system`, or a method and the frequency in rad/s at which it is to be exact."""
_METHODS = ("tustin", "bilinear", "zoh", "foh", "euler", "backward_diff", "impulse")


def realised(system: control.StateSpace | control.TransferFunction, name: str) -> control.StateSpace:
    """A system in state space, its entries checked; transfer functions of any size are realised entry by entry."""
    if isinstance(system, control.TransferFunction):
        for (i, j), numerator in np.ndenumerate(system.num_array):
            if len(np.trim_zeros(numerator, "f")) > len(np.trim_zeros(system.den_array[i, j], "f")):
                raise ValueError(
                    f"{name} is improper: its numerator has a higher degree than its denominator, so it has no "
                    "realisation; filter it, as a derivative s is to s / (1 + s tau)"
                )
        system = control.ss(system) if system.issiso() else _by_entries(system)
    finite_named(system, name)
    return system


def _by_entries(system: control.TransferFunction) -> control.StateSpace:
    """A realisation of several inputs and outputs, with states for each pair of them."""
    p, q = system.noutputs, system.ninputs
    parts = [(i, j, control.ss(system[i, j])) for i in range(p) for j in range(q)]
    A = block_diag(*[part.A for _, _, part in parts])
    B, C = np.zeros((len(A), q)), np.zeros((p, len(A)))
    D, at = np.zeros((p, q)), 0
    for i, j, part in parts:
        states = slice(at, at := at + part.nstates)
        B[states, j], C[i, states], D[i, j] = part.B[:, 0], part.C[0], part.D[0, 0]
    return control.ss(A, B, C, D, system.dt)


def finite_named(system: control.StateSpace, name: str) -> None:
    """Refuse a system with entries that are not finite, or signals that share a name."""
    for matrix in "ABCD":
        real_array(getattr(system, matrix), f"{name}.{matrix}")
    for what, labels, count in (
        ("states", system.state_labels, system.nstates),
        ("inputs", system.input_labels, system.ninputs),
        ("outputs", system.output_labels, system.noutputs),
    ):
        if len(labels) != count:  # python-control keeps one of those that share a name
            raise ValueError(f"{name} has {count} {what} with names {', '.join(labels)}; give each a name of its own")


def recipe(system: control.StateSpace) -> Callable[[], control.StateSpace]:
    """What makes a copy of a system and can be pickled, as python-control's systems themselves can't."""
    return partial(
        control.ss,
        *(np.array(getattr(system, matrix)) for matrix in "ABCD"),
        system.dt,
        name=system.name,
        inputs=list(system.input_labels),
        outputs=list(system.output_labels),
        states=list(system.state_labels),
    )


def plant_system(plant: Any) -> control.StateSpace:
    """A plant in state space, with at least one state and one input, and a timebase."""
    if isinstance(plant, control.TransferFunction):
        if not plant.issiso():
            raise ValueError(
                "plant is a transfer function with several inputs or outputs, which python-control can't realise "
                "without slycot; give it as a StateSpace"
            )
        plant = realised(plant, "plant")
    if not isinstance(plant, control.StateSpace):
        hint = ""
        if isinstance(plant, control.NonlinearIOSystem):
            hint = "; linearise it about an equilibrium first: plant.linearize(x_equilibrium, u_equilibrium)"
        raise TypeError(f"plant must be a StateSpace or TransferFunction, not a {type(plant).__name__}{hint}")
    plant = realised(plant, "plant")
    if plant.nstates == 0 or plant.ninputs == 0:
        raise control.ControlDimension(
            f"plant has {plant.nstates} states and {plant.ninputs} inputs; expected at least one of each"
        )
    if plant.dt is None or plant.dt is False:
        raise ValueError(f"plant.dt is {plant.dt}; say whether the plant is continuous (dt=0) or sampled (its period)")
    return plant


def same_period(a: float | bool, b: float | bool) -> bool:
    """Whether two discrete timebases agree; True, a period not told, agrees with any."""
    return a is True or b is True or bool(np.isclose(a, b, rtol=1e-9, atol=0))


def common_period(plant: control.StateSpace, dt: Any, controllers: list[Any], default: float) -> float | bool:
    """The sampling period of the modes: the plant's, the argument's or, where neither tells, a controller's."""
    given = None if dt is None else sampling_period(dt)
    if plant.dt == 0:
        if given is True:
            raise ValueError("dt is True, but the plant is continuous; expected a sampling period in seconds")
        return default if given is None else given
    own = sampling_period(plant.dt, "plant.dt")
    if own is True and given in (None, True):
        told = (getattr(controller, "dt", None) for controller in controllers)
        return next((sampling_period(dt) for dt in told if dt not in (None, True, 0)), True)
    if given is None or same_period(own, given):
        return given if own is True and given is not None else own
    raise ValueError(f"dt is {given} s, but the plant is sampled with dt = {own} s; expected the same, or no dt")


def sampling_method(how: Any) -> Sampling:
    """Check how a controller is to be sampled."""
    if isinstance(how, tuple) and len(how) == 2 and isinstance(how[0], str):
        sampling_method(how[0])
        return how[0], number(how[1], "the frequency in sampling")
    if isinstance(how, str):
        if how not in _METHODS:
            raise ValueError(f"sampling is {how!r}; expected one of {', '.join(_METHODS)}")
        return how
    raise TypeError(f"sampling is {how!r}; expected a method such as 'tustin', or ('tustin', frequency in rad/s)")


def sampled(system: control.StateSpace, period: float, how: Sampling, name: str) -> control.StateSpace:
    """A continuous system at the samples."""
    method, prewarp = (how, None) if isinstance(how, str) else how
    if prewarp is not None and not (method in ("tustin", "bilinear") and 0 < prewarp < np.pi / period):
        raise ValueError(
            f"{name} can't be sampled by {how!r} with dt = {period} s; a frequency at which sampling is exact is for "
            f"'tustin' and below pi / dt = {np.pi / period:.6g} rad/s"
        )
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = control.sample_system(system, period, method=method, prewarp_frequency=prewarp)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ValueError(f"{name} can't be sampled by {how!r} with dt = {period} s: {error}") from None
    if not all(np.isfinite(getattr(found, matrix)).all() for matrix in "ABCD"):
        raise ValueError(f"{name} can't be sampled with dt = {period} s, it overflows; choose a shorter period")
    return found


def exact_step(A: Array, period: float) -> Array:
    """``expm(A period)``, exactly zero where no power of A can be otherwise."""
    with np.errstate(over="ignore", invalid="ignore"):
        step = expm(A * period)
    linked = (A != 0) | np.eye(A.shape[-1], dtype=bool)
    for _ in range(A.shape[-1].bit_length()):
        linked = linked @ linked
    return np.where(linked, step, 0.0)


def sampled_noise(A: Array, W: Array, period: float) -> Array:
    """The covariance that white noise of intensity W adds in a period, ``int_0^period e^(A t) W e^(A' t) dt``.

    By one matrix exponential (C. Van Loan, Computing integrals involving the matrix exponential, IEEE Transactions on
    Automatic Control 23, 1978), of the balanced A, over a part of the period that keeps it accurate, and doubling.

    Parameters
    ----------
    A, W : arrays, shape (n, n)
        The system and the intensity.
    period : float
        In seconds.

    Returns
    -------
    array, shape (n, n)
        Infinite beyond the floating-point range.
    """
    n, states = len(A), matrix_balance(A, permute=False, separate=True)[1][0]
    units = np.outer(states, states)
    A, W = A * states / states[:, None], W / units
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(A, 1)) * period
    if not np.isfinite(size):
        return np.full_like(W, np.inf)
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300)))))
    greatest = 2.0 ** np.frexp(np.abs(W).max())[1]
    whole = np.block([[-A, W / greatest], [np.zeros((n, n)), A.T]]) * (period / 2**halvings)
    both = expm(whole)
    step = both[n:, n:].T
    covariance = step @ both[:n, n:]
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(halvings):
            covariance, step = covariance + step @ covariance @ step.T, step @ step
        return (covariance + covariance.T) / 2 * greatest * units
