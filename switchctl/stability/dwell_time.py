"""How long a mode must be held, so that every switching signal that does so is stable."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from switchctl.modes import ModeSet, require_modes
from switchctl.stability.joint_spectral_radius import Bounds, bounded, held
from switchctl.stability.moves import Moves
from switchctl.tables import Summary
from switchctl.validation import seconds

_LONGEST = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class DwellTime(Summary):
    """The least dwell time that makes every switching signal stable; see `minimum_dwell_time`.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    lower, upper : int
        Its bounds, in steps: with a dwell time of ``upper`` every signal is stable, with ``lower - 1`` one is not.
    stable : Bounds
        The growth of a step with the dwell time ``upper``.
    unstable : Bounds or None
        The growth of a step with ``lower - 1``; None where lower is 1.
    status : str
        "done", or "interrupted" by Ctrl-C.
    """

    modes: ModeSet
    lower: int
    upper: int
    stable: Bounds
    unstable: Bounds | None
    status: str = "done"

    @property
    def word(self) -> tuple[int, ...]:
        """Modes, each held for ``lower - 1`` steps at least, that don't vanish when repeated for ever; () for none."""
        return () if self.unstable is None else self.unstable.cycle

    def _facts(self) -> list[tuple[str, str]]:
        names, dt = self.modes.names, self.modes.dt
        seconds = "" if dt is True else f", {self.upper * dt:.6g} s"
        exact = f"{self.upper} step{'s' * (self.upper > 1)}{seconds}"
        proven = "" if self.lower == self.upper else f" or less, at least {self.lower}"
        facts = [("least", exact + proven)]
        facts.append(
            (f"dwell {self.upper}", f"every signal vanishes, at a rate of {self.stable.upper:.8g} a step or less")
        )
        if self.unstable is not None:
            word = held(self.word, names)
            facts.append((f"dwell {self.lower - 1}", f"{word} does not: rate {self.unstable.lower:.8g} a step"))
        return facts if self.status == "done" else [*facts, ("status", self.status)]

    def _heading(self) -> str:
        return "DwellTime"


def minimum_dwell_time(modes: ModeSet, time_limit: float = 30.0) -> DwellTime:
    """Find the least dwell time, in steps, that makes every switching signal stable.

    A dwell time is stable where a quadratic norm for each mode falls at every step, switches with all the steps they
    entail included, ``A_i' P_i A_i < P_i`` and ``(A_j^d)' P_j A_j^d < P_i`` (Geromel and Colaneri, Int. J. Control 79,
    2006), or else norms with more memory or over longer words do (see `joint_spectral_radius`); it is not where a word
    that may be repeated for ever doesn't contract.

    Parameters
    ----------
    modes : ModeSet
        The modes, each Schur stable.
    time_limit : float, optional
        Seconds after which no further dwell time is tried.

    Returns
    -------
    DwellTime
        Ctrl-C ends the search with the bounds found so far.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or value, or a mode is not Schur stable: no dwell time makes up for that.
    numpy.linalg.LinAlgError
        If rounding hides whether a mode is.

    Examples
    --------
    >>> from switchctl.stability import minimum_dwell_time
    >>> from switchctl.models import five_mode
    >>> found = minimum_dwell_time(five_mode.modes())
    >>> print(found.lower, found.upper, found.word)  # with a dwell time of two steps, A5 A5 A3 A3 is not stable
    3 3 (4, 4, 2, 2)
    """
    search = _Search(modes, time_limit)
    m, most = len(modes), 1
    while search.verdict((most,) * m) != "stable":
        if most > _LONGEST:
            late = "" if search.time_left else f" within {time_limit:g} s; raise time_limit"
            raise ValueError(f"no dwell time up to {_LONGEST:,} steps was found that makes every signal stable{late}")
        most *= 2
    upper = _least(lambda d: search.verdict((d,) * m) == "stable", 1, most)
    lower = _least(lambda d: search.verdict((d,) * m) != "unstable", 1, upper)
    while lower < upper and search.time_left:
        if search.verdict((upper - 1,) * m, again=True) == "stable":
            upper -= 1
        elif search.verdict((lower,) * m, again=True) == "unstable":
            lower += 1
        elif upper - 1 == lower or not search.time_left:
            break
    stable, unstable = search.found[(upper,) * m], search.found[(lower - 1,) * m] if lower > 1 else None
    return DwellTime(modes, lower, upper, stable, unstable, search.status)


def _least(holds: Callable[[int], bool], low: int, high: int) -> int:
    """The least number up to ``high``, where it holds, from which on it does, by bisection."""
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return high


def require_schur(modes: ModeSet) -> None:
    """Refuse modes that may not be held for ever."""
    require_modes(modes)
    if not modes.schur.all():
        name = modes.names[int(modes.schur.argmin())]
        raise ValueError(
            f"mode {name!r} is not Schur stable; a signal may stay in it, so no dwell time makes every signal "
            "stable; stabilising_word looks for a signal that is"
        )


class _Search:
    """What is known of dwell times, and the time to find more."""

    def __init__(self, modes: ModeSet, time_limit: float) -> None:
        require_schur(modes)
        self.modes, self.end = modes, time.perf_counter() + seconds(time_limit, "time_limit")
        self.share = time_limit / 20
        self.found: dict[tuple[int, ...], Bounds] = {}
        self.interrupted = False

    @property
    def status(self) -> str:
        """How the search ended."""
        return "interrupted" if self.interrupted else "done"

    @property
    def time_left(self) -> bool:
        """Whether there is time, and nobody has asked to stop."""
        return time.perf_counter() < self.end and not self.interrupted

    def verdict(self, dwell: tuple[int, ...], again: bool = False) -> str:
        """Whether dwell times are stable, by what is known or can be found in a share of the time."""
        if dwell not in self.found and self.interrupted:
            return "undecided"
        if dwell not in self.found or (again and self.found[dwell].verdict == "undecided" and self.time_left):
            end = min(time.perf_counter() + self.share * (5 if again else 1), max(self.end, time.perf_counter() + 1))
            self.found[dwell] = bounded(Moves.with_dwell(self.modes, dwell), None, end)
            self.interrupted = self.found[dwell].status == "interrupted"
            if self.interrupted and not any(f.verdict == "stable" for f in self.found.values()):
                raise KeyboardInterrupt
        return self.found[dwell].verdict


@dataclass(frozen=True, eq=False, repr=False)
class DwellTimes(Summary):
    """A dwell time for each mode; see `mode_dependent_dwell_times`.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    dwell : tuple of int
        The dwell time of each, in steps, with which every switching signal is stable.
    least : tuple of bool
        Whether it is proven that with one step less for this mode alone, a signal is not.
    stable : Bounds
        The growth of a step with these dwell times.
    status : str
        "done", or "interrupted" by Ctrl-C.
    """

    modes: ModeSet
    dwell: tuple[int, ...]
    least: tuple[bool, ...]
    stable: Bounds
    status: str = "done"

    def _facts(self) -> list[tuple[str, str]]:
        facts = [
            (name, f"{d} step{'s' * (d > 1)}" + ("" if least else " (perhaps less)"))
            for name, d, least in zip(self.modes.names, self.dwell, self.least, strict=True)
        ]
        facts.append(("with these", f"every signal vanishes, at a rate of {self.stable.upper:.8g} a step or less"))
        return facts if self.status == "done" else [*facts, ("status", self.status)]

    def _heading(self) -> str:
        return "DwellTimes"


def mode_dependent_dwell_times(modes: ModeSet, time_limit: float = 30.0) -> DwellTimes:
    """Find a dwell time for each mode, none of which can be less alone, that make every switching signal stable.

    Beginning with the least one for all modes (see `minimum_dwell_time`), each mode's in turn is made as short as it
    can be. Other orders may end elsewhere: there is no one least set of dwell times.

    Parameters
    ----------
    modes : ModeSet
        The modes, each Schur stable.
    time_limit : float, optional
        Seconds after which no further dwell time is tried.

    Returns
    -------
    DwellTimes
        Ctrl-C ends the search with the dwell times found so far, once any are.

    Raises
    ------
    TypeError, ValueError, numpy.linalg.LinAlgError
        As `minimum_dwell_time`.

    Examples
    --------
    >>> from switchctl.stability import mode_dependent_dwell_times
    >>> from switchctl.models import five_mode
    >>> mode_dependent_dwell_times(five_mode.modes()).dwell
    (2, 3, 3, 2, 3)
    """
    require_modes(modes)
    common = minimum_dwell_time(modes, seconds(time_limit, "time_limit") / 2)
    return shortened(common, time_limit / 2)


def shortened(common: DwellTime, time_limit: float) -> DwellTimes:
    """Make the dwell time of each mode in turn as short as it can be, from the least for all on."""
    modes, search = common.modes, _Search(common.modes, time_limit)
    dwell = (common.upper,) * len(modes)
    search.found[dwell] = common.stable
    search.interrupted = common.status == "interrupted"
    for i in range(len(dwell)):
        others = dwell[:i], dwell[i + 1 :]

        def stable(d: int, i: int = i, others: tuple[tuple[int, ...], tuple[int, ...]] = others) -> bool:
            return search.verdict((*others[0], d, *others[1])) == "stable"

        dwell = (*others[0], _least(stable, 1, dwell[i]), *others[1])
    least = tuple(
        d == 1 or search.verdict((*dwell[:i], d - 1, *dwell[i + 1 :])) == "unstable" for i, d in enumerate(dwell)
    )
    return DwellTimes(modes, dwell, least, search.found[dwell], search.status)
