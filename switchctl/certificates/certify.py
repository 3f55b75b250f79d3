"""Certify: write the certificate of whatever was found."""

from collections.abc import Callable
from typing import Any

from switchctl.certificates.certificate import Certificate
from switchctl.certificates.growth import average_dwell_time, dwell_time, joint_spectral_radius
from switchctl.certificates.mean_square import mean_square
from switchctl.certificates.optimum import optimum
from switchctl.certificates.switching import rollout, switching
from switchctl.result import Schedule
from switchctl.stability import (
    AverageDwellTime,
    DwellTime,
    DwellTimes,
    GrowthRate,
    JointSpectralRadius,
    PolicyStability,
    SwitchingHelp,
)

_WRITERS: dict[type, Callable[[Any], Certificate]] = {
    JointSpectralRadius: joint_spectral_radius,
    DwellTime: dwell_time,
    DwellTimes: dwell_time,
    AverageDwellTime: average_dwell_time,
    GrowthRate: mean_square,
    SwitchingHelp: switching,
    PolicyStability: rollout,
}


def certify(
    found: Any, gap: float | None = None, prefixes: int | None = None, time_limit: float | None = None
) -> Certificate:
    """Prove what was found, in a form that can be checked without this package.

    Of a schedule, how near to the optimum it is: any method's will do; near the optimum the proof is short, and where
    the gap would take a tree of more prefixes, or more time, the claim is what can be proven within them. Of what
    `switchctl.stability` found, its bounds and verdicts; the bounds claimed are loosened by as little as they need to
    hold in exact arithmetic.

    Parameters
    ----------
    found : Schedule or a result of switchctl.stability
        What to prove. A schedule must be of finite cost, with positive definite stage weights.
    gap : float, optional
        Of a schedule: the gap to prove, as a fraction of the cost; 1e-3 by default.
    prefixes : int, optional
        Of a schedule: the most prefixes in the tree, 100,000 by default. The checker takes up to a millisecond for
        each step of each.
    time_limit : float, optional
        Of a schedule: seconds for the search, 60 by default.

    Returns
    -------
    Certificate
        Only whole: Ctrl-C raises KeyboardInterrupt.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or value, the schedule's cost is infinite, a stage weight is singular, or a
        bound doesn't hold in exact arithmetic.

    Examples
    --------
    >>> from switchctl.certificates import certify
    >>> from switchctl.models import five_mode
    >>> modes, x0 = five_mode.modes(), five_mode.initial_state()
    >>> certificate = certify(schedule(modes, x0, PointwiseMinimum()), gap=0.01)
    >>> certificate.check()
    >>> print(f"the least cost lies between {certificate.lower:.2f} and {certificate.upper:.2f}")
    the least cost lies between 77.48 and 77.77
    """
    if isinstance(found, Schedule):
        return optimum(
            found,
            1e-3 if gap is None else gap,
            100_000 if prefixes is None else prefixes,
            60.0 if time_limit is None else time_limit,
        )
    for name, value in (("gap", gap), ("prefixes", prefixes), ("time_limit", time_limit)):
        if value is not None:
            raise ValueError(f"{name} is {value!r}, but it is for schedules; leave it out")
    if type(found) not in _WRITERS:
        raise TypeError(
            "found must be a Schedule or a result of switchctl.stability (of a tuple or a report, one of its entries), "
            f"not a {type(found).__name__}"
        )
    return _WRITERS[type(found)](found)
