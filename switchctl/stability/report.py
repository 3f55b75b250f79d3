"""Everything known about a set of modes on one page: stability, dwell times, what switching saves."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, graph_under
from switchctl.methods.boundary import initial_state
from switchctl.methods.constant import single_mode_costs
from switchctl.modes import ModeSet, require_modes
from switchctl.moments import Array
from switchctl.rules import Rules
from switchctl.stability.average_dwell_time import AverageDwellTime, average_dwell_time, averaged
from switchctl.stability.dwell_time import (
    DwellTime,
    DwellTimes,
    minimum_dwell_time,
    mode_dependent_dwell_times,
    shortened,
)
from switchctl.stability.growth import GrowthRate, verdict
from switchctl.stability.helps import SwitchingHelp, does_switching_help
from switchctl.stability.joint_spectral_radius import JointSpectralRadius, joint_spectral_radius
from switchctl.stability.report_text import report_html, report_text
from switchctl.stability.switching import schur_stability, stabilising_word
from switchctl.stability.transient_growth import TransientGrowth, transient_growth
from switchctl.validation import frozen, seconds

if TYPE_CHECKING:
    from control import ControlPlot

_TOLERANCE = 1e-4
_DELAY = 2  # seconds before progress is shown
_LEAST = 0.02  # of the time, for a part that comes when it is over


@dataclass(frozen=True, eq=False)
class PairGrowth:
    """How much two modes in alternation grow at worst, for each pair; see `report`.

    Parameters
    ----------
    lower, upper : arrays, shape (m, m)
        Bounds of the joint spectral radius of modes i and j: ``lower`` is the growth per step of the worst alternation
        found. Of the spectral radius on the diagonal. Not a number where a pair was not done.
    """

    lower: Array
    upper: Array

    @property
    def verdicts(self) -> list[list[str]]:
        """Whether every run of the two modes vanishes: "stable", "unstable", "undecided" or "not done", as (m, m)."""
        return [
            ["not done" if np.isnan(low) else verdict(low, high) for low, high in zip(*rows, strict=True)]
            for rows in zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        ]


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """Everything known about a set of modes on one page. `report` makes one.

    A part that failed, does not apply or was not done is None, and ``reasons`` says why. Dwell times, pairs and whether
    switching helps leave the rules aside.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    graph : SwitchingGraph
        The modes under the rules.
    x0 : Gaussian or None
        The initial state.
    spectral_radii : tuple of GrowthRate or None
        Bounds of each mode's spectral radius, with a verdict.
    transient_growth : tuple of TransientGrowth or None
        The greatest ``||A^k||_2`` of each mode, and at which k.
    costs : array, shape (m,), or None
        With x0: what each mode costs, held for ever as soon as the rules allow it.
    pairs : PairGrowth or None
        Which modes destabilise each other.
    joint_spectral_radius : JointSpectralRadius or None
        Growth under arbitrary switching, or under the rules.
    dwell_time : DwellTime or None
        The least dwell time for all modes.
    dwell_times : DwellTimes or None
        A dwell time for each mode.
    average_dwell_time : AverageDwellTime or None
        An average dwell time.
    stabilising_word : GrowthRate or None
        Where a mode may not be held for ever: modes that are stable when repeated for ever.
    switching_help : SwitchingHelp or None
        Whether switching costs less than every single mode, and with x0 by how much.
    reasons : mapping of str to str
        Why a part is None, or pairs are missing.

    Examples
    --------
    >>> from switchctl.stability import report
    >>> found = report(ModeSet([[[0.0, 2.0], [0.0, 0.5]], [[0.5, 0.0], [2.0, 0.0]]]))
    >>> found.joint_spectral_radius.cycle, found.dwell_time.upper, found.reasons["costs"]
    ((0, 1), 3, 'no x0 was given')
    """

    modes: ModeSet
    graph: SwitchingGraph
    x0: Gaussian | None = None
    spectral_radii: tuple[GrowthRate, ...] | None = None
    transient_growth: tuple[TransientGrowth, ...] | None = None
    costs: Array | None = None
    pairs: PairGrowth | None = None
    joint_spectral_radius: JointSpectralRadius | None = None
    dwell_time: DwellTime | None = None
    dwell_times: DwellTimes | None = None
    average_dwell_time: AverageDwellTime | None = None
    stabilising_word: GrowthRate | None = None
    switching_help: SwitchingHelp | None = None
    reasons: Mapping[str, str] = field(default_factory=dict)

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw the page; see `switchctl.plotting.plot_report` for the keywords.

        Parameters
        ----------
        **keywords : title
            As for `plot_report`.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_report

        return plot_report(self, **keywords)

    def __repr__(self) -> str:
        return report_text(self)

    def _repr_html_(self) -> str:
        return report_html(self)


def report(
    modes: ModeSet, x0: Gaussian | None = None, rules: Rules | SwitchingGraph | None = None, *, time_limit: float = 60.0
) -> Report:
    """Gather everything known about a set of modes on one page, as text, HTML and a picture.

    Of each mode its spectral radius, how large it lets a state grow and what it costs; which modes destabilise each
    other; the joint spectral radius; dwell times; and whether switching helps. Parts that end early leave their time to
    those that follow.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian, optional
        An initial state, for costs and what switching saves.
    rules : Rules or SwitchingGraph, optional
        The switching rules, for the joint spectral radius and the costs.
    time_limit : float, optional
        Seconds, about.

    Returns
    -------
    Report
        A part that fails says why in its place. Interrupted by Ctrl-C, the parts done so far; the others are "not
        done".

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or value, or the rules don't fit the modes.

    Examples
    --------
    >>> from switchctl.stability import report
    >>> found = report(ModeSet([[[0.5]], [[0.9]]]), Gaussian([1.0], [[0.0]]))
    >>> found.joint_spectral_radius.verdict, found.dwell_time.upper, found.switching_help.helps
    ('stable', 1, False)
    >>> print(str(found).splitlines()[5])
    A0                0.5         stable            1     0        1.33333  best
    """
    require_modes(modes)
    x0 = None if x0 is None else initial_state(modes, x0)
    page = _Page(Report(modes, graph_under(modes, rules), x0), seconds(time_limit, "time_limit"))
    parts = page.parts()
    begun, bar = time.perf_counter(), tqdm(parts, desc="report", unit="part", delay=_DELAY, leave=False)
    with _noted_interrupts() as interrupted, bar as progress:
        for name, weight, part in progress:
            try:
                progress.set_postfix_str(name.replace("_", " "), refresh=time.perf_counter() > begun + _DELAY)
                if interrupted:
                    raise KeyboardInterrupt
                page.add(name, part(page.seconds(name, parts) if weight else 0.0))
            except KeyboardInterrupt:
                interrupted.append(True)
                page.miss(name, "not done")
            except (ValueError, ArithmeticError) as error:
                page.miss(name, str(error))
    return page.done()


@contextmanager
def _noted_interrupts() -> Iterator[list[bool]]:
    """A list that is no longer empty after Ctrl-C, which a part may answer by returning what it has."""
    noted: list[bool] = []
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield noted
        return

    def note(number: int, frame: Any) -> None:
        noted.append(True)
        before(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


class _NotGiven(ValueError):
    """A part that there is nothing to do for."""


Part = tuple[str, float, Callable[[float], Any]]


class _Page:
    """The report as far as it is written, and the time left for the rest."""

    def __init__(self, empty: Report, time_limit: float) -> None:
        self.report, self.reasons = empty, dict[str, str]()
        self.least, self.end = _LEAST * time_limit, time.perf_counter() + time_limit

    def parts(self) -> list[Part]:
        """The parts in their order, with shares of the time and what makes them in so many seconds."""
        modes, graph, x0 = self.report.modes, self.report.graph, self.report.x0
        return [
            ("spectral_radii", 0, lambda _: schur_stability(modes)),
            ("transient_growth", 0, lambda _: self.transients()),
            ("costs", 0, lambda _: self.costs()),
            ("joint_spectral_radius", 2, lambda seconds: joint_spectral_radius(graph, _TOLERANCE, seconds)),
            ("dwell_time", 2, self.dwell_time),
            ("dwell_times", 3, self.dwell_times),
            ("average_dwell_time", 2, self.average_dwell_time),
            ("stabilising_word", 0, lambda _: self.word()),
            ("switching_help", 2, lambda seconds: does_switching_help(modes, x0, time_limit=seconds)),
            ("pairs", 2, self.pairs),
        ]

    def seconds(self, name: str, parts: list[Part]) -> float:
        """The share that a part has of the time left."""
        later = [weight for _, weight, _ in parts[[part[0] for part in parts].index(name) :]]
        return max(self.least, (self.end - time.perf_counter()) * later[0] / sum(later))

    def add(self, name: str, found: Any) -> None:
        """Write a part."""
        self.report = replace(self.report, **{name: found})

    def miss(self, name: str, why: str) -> None:
        """Say why a part, or some of it, is not there."""
        self.reasons[name] = why

    def done(self) -> Report:
        """The page."""
        return replace(self.report, reasons=dict(self.reasons))

    def transients(self) -> tuple[TransientGrowth, ...]:
        """The transient growth of each mode."""
        rates = self.report.spectral_radii
        if rates is None:
            raise ValueError("the spectral radii are not known")
        modes = self.report.modes
        return tuple(
            transient_growth(A, "undecided" if rate.verdict == "unstable" and not rate.lower > 1 else rate.verdict)
            for A, rate in zip(modes.A, rates, strict=True)
        )

    def costs(self) -> Array:
        """What each mode costs."""
        if self.report.x0 is None:
            raise _NotGiven("no x0 was given")
        return frozen(single_mode_costs(self.report.graph, self.report.x0))

    @property
    def arbitrary(self) -> JointSpectralRadius | None:
        """The joint spectral radius where it proves that arbitrary switching is stable."""
        found = self.report.joint_spectral_radius
        return found if found is not None and found.verdict == "stable" and self.report.graph.free else None

    def dwell_time(self, seconds: float) -> DwellTime:
        """The least dwell time."""
        modes = self.report.modes
        if self.arbitrary is not None:
            return DwellTime(modes, 1, 1, self.arbitrary, None)
        return minimum_dwell_time(modes, seconds)

    def dwell_times(self, seconds: float) -> DwellTimes:
        """A dwell time for each mode."""
        modes, m = self.report.modes, len(self.report.modes)
        if self.arbitrary is not None:
            return DwellTimes(modes, (1,) * m, (True,) * m, self.arbitrary)
        common = self.report.dwell_time
        return mode_dependent_dwell_times(modes, seconds) if common is None else shortened(common, seconds)

    def average_dwell_time(self, seconds: float) -> AverageDwellTime:
        """An average dwell time, where one is needed."""
        if self.arbitrary is not None:
            raise _NotGiven("none is needed: arbitrary switching is stable")
        common = self.report.dwell_time
        return average_dwell_time(self.report.modes, seconds) if common is None else averaged(common, seconds)

    def word(self) -> GrowthRate:
        """A stabilising word, where no mode held for ever is one that serves."""
        modes, graph = self.report.modes, self.report.graph
        if modes.schur.all() and graph.free:
            raise _NotGiven("every mode is stable when held for ever")
        found = stabilising_word(graph)
        if found is None:
            raise ValueError("none was found, which proves nothing")
        return found

    def pairs(self, seconds: float) -> PairGrowth:
        """The growth of each pair; what is done is kept when interrupted."""
        modes, end = self.report.modes, time.perf_counter() + seconds
        m = len(modes)
        found = PairGrowth(np.full((m, m), np.nan), np.full((m, m), np.nan))
        for i, rate in enumerate(self.report.spectral_radii or ()):
            found.lower[i, i], found.upper[i, i] = rate.lower, rate.upper
        self.add("pairs", found)
        whole = self.report.joint_spectral_radius if self.report.graph.free else None
        pairs = [(i, j) for i in range(m) for j in range(i)]
        for done, (i, j) in enumerate(pairs):
            known = m == 2 and whole is not None
            if not known and time.perf_counter() > end:
                break
            share = max(end - time.perf_counter(), self.least) / (len(pairs) - done)
            growth = whole if known else joint_spectral_radius(_only(modes, [j, i]), _TOLERANCE, share)
            assert growth is not None
            if whole is not None and growth.lower > whole.lower:
                whole = replace(whole, lower=growth.lower, cycle=tuple((j, i)[mode] for mode in growth.cycle), node=0)
                self.add("joint_spectral_radius", whole)
            found.lower[i, j] = found.lower[j, i] = growth.lower
            found.upper[i, j] = found.upper[j, i] = growth.upper if whole is None else min(growth.upper, whole.upper)
            if growth.status == "interrupted":
                raise KeyboardInterrupt
        return found


def _only(modes: ModeSet, kept: list[int]) -> ModeSet:
    """Some of the modes, without what they cost."""
    activation = None if modes.activation is None else modes.activation[np.ix_(kept, kept)]
    return ModeSet(modes.A[kept], [modes.names[i] for i in kept], modes.dt, activation=activation)
