"""How long modes must be held on average, so that every switching signal that does so is stable."""

import time
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from scipy.optimize import minimize_scalar

from switchctl.gramians import tail
from switchctl.modes import ModeSet, require_modes
from switchctl.moments import Array
from switchctl.stability.dwell_time import DwellTime, minimum_dwell_time
from switchctl.stability.joint_spectral_radius import held, proven_radius
from switchctl.stability.moves import LEAST, Moves, exactly, multiplied, power
from switchctl.stability.quadratic import quadratic_norms
from switchctl.tables import Summary
from switchctl.validation import seconds

_ACCURACY = 1e-6
_TRIED = 25  # rates of decay
_HELD = 32  # steps for which one of two modes is held


@dataclass(frozen=True, eq=False, repr=False)
class AverageDwellTime(Summary):
    """An average dwell time that makes every switching signal stable; see `average_dwell_time`.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    lower, upper : float
        With an average dwell time of ``upper`` steps or more every signal is stable; with ``lower`` one is not.
    word : tuple of int
        The one that is not: modes to repeat for ever; () where none is known.
    decay, jump : float
        The norms shrink by ``decay`` at every step, and grow by at most ``jump`` at a switch:
        ``upper = -ln(jump) / ln(decay)``.
    P : array, shape (m, n, n)
        The norms ``sqrt(x' P_i x)``.
    status : str
        "done", or "interrupted" by Ctrl-C.
    """

    modes: ModeSet
    lower: float
    upper: float
    word: tuple[int, ...]
    decay: float
    jump: float
    P: Array
    status: str = "done"

    def _facts(self) -> list[tuple[str, str]]:
        facts = [("stable from", f"{self.upper:.6g} steps on average")]
        facts.append(("norms", f"shrink by {self.decay:.6g} a step, grow by at most {self.jump:.6g} at a switch"))
        if self.word:
            facts.append(("not stable at", f"{self.lower:.6g} steps: {held(self.word, self.modes.names)}"))
        return facts if self.status == "done" else [*facts, ("status", self.status)]

    def _heading(self) -> str:
        return "AverageDwellTime"


def average_dwell_time(modes: ModeSet, time_limit: float = 30.0) -> AverageDwellTime:
    """Find an average dwell time, in steps, that makes every switching signal stable.

    A signal has the average dwell time tau if it switches at most ``N0 + k / tau`` times in any k steps, whatever N0
    (Hespanha and Morse, CDC 1999). With norms that shrink by a factor ``decay`` at each step and grow by ``jump`` at
    each switch, it is stable where ``jump * decay ** tau < 1``. For each of a number of decays the norms of the least
    jump are found by a semidefinite program.

    Parameters
    ----------
    modes : ModeSet
        The modes, each Schur stable.
    time_limit : float, optional
        Seconds after which no further decay is tried.

    Returns
    -------
    AverageDwellTime

    Raises
    ------
    TypeError, ValueError, numpy.linalg.LinAlgError
        As `minimum_dwell_time`.

    Examples
    --------
    >>> from switchctl.stability import average_dwell_time
    >>> found = average_dwell_time(ModeSet([[[0.9, 0.0], [0.0, 0.5]], [[0.5, 0.0], [0.0, 0.9]]]))
    >>> print(found.upper)  # one norm serves both
    0.0
    """
    require_modes(modes)
    return averaged(minimum_dwell_time(modes, seconds(time_limit, "time_limit") / 2), time_limit / 2)


def averaged(found: DwellTime, time_limit: float) -> AverageDwellTime:
    """Find an average dwell time, given the least one, whose word shows what is too short."""
    modes, end = found.modes, time.perf_counter() + (0.0 if found.status == "interrupted" else time_limit)
    lower, word = _unstable(modes, found.word)
    common = Moves.with_dwell(modes, (1,) * len(modes))
    one_node = replace(common, places=(0,), tail=0 * common.tail, head=0 * common.head)
    gamma, P = quadratic_norms(one_node, np.eye(modes.A.shape[-1])[None], 0.0, 1 - _ACCURACY, _ACCURACY, end)
    if gamma < 1:
        return AverageDwellTime(modes, 0.0, 0.0, (), max(gamma, LEAST), 1.0, np.tile(P[0], (len(modes), 1, 1)))
    slowest = -np.log(max(float(modes.spectral_radii.max()), 1e-3))
    best = AverageDwellTime(modes, lower, np.inf, word, 1.0, np.inf, np.empty(0))

    def least(part: float) -> float:
        nonlocal best
        if time.perf_counter() > end and best.P.size:
            return best.upper
        decay = float(np.exp(-part * slowest))
        try:
            norms = [tail(A / decay, np.eye(len(A))) for A in modes.A]
        except np.linalg.LinAlgError:
            return np.inf
        if any(P is None for P in norms):
            return np.inf
        wrong = common.wrong / decay + np.finfo(float).eps * np.abs(common.A)
        moves = replace(common, A=common.A / decay, wrong=wrong, lengths=(common.tail != common.head).astype(float))
        jump, P = quadratic_norms(moves, np.array(norms), 1.0, 1.0, _ACCURACY, max(end, time.perf_counter() + 1))
        jump = max(jump, 1.0)
        upper = float(np.log(jump) / (part * slowest)) * (1 + 1e-9)
        if upper < best.upper:
            best = replace(best, upper=upper, decay=decay, jump=jump, P=P)
        return upper

    try:
        minimize_scalar(least, bounds=(0.01, 0.99), method="bounded", options={"maxiter": _TRIED, "xatol": 1e-3})
    except KeyboardInterrupt:
        if not best.P.size:
            raise
        return replace(best, status="interrupted")
    return replace(best, status=found.status)


def switch_count(word: tuple[int, ...]) -> int:
    """How often a word switches in a period, when repeated for ever."""
    return sum(mode != before for mode, before in zip(word, word[-1:] + word[:-1], strict=True))


def _unstable(modes: ModeSet, word: tuple[int, ...]) -> tuple[float, tuple[int, ...]]:
    """The greatest average dwell time met of a word that doesn't contract: the one given, or of two modes in turn."""
    switches = switch_count(word)
    best = (len(word) / switches, word) if switches else (0.0, word)
    powers = [np.broadcast_to(np.eye(modes.A.shape[-1]), modes.A.shape)]
    for _ in range(_HELD - 1):
        powers.append(powers[-1] @ modes.A)
    held_for = np.stack(powers, axis=1)
    for i in range(len(modes)):
        for j in range(i):
            first, second = held_for[i] @ modes.A_after[j, i], held_for[j] @ modes.A_after[i, j]
            products = first[:, None] @ second[None]
            radii = np.abs(np.linalg.eigvals(products)).max(axis=-1)
            for a, b in sorted(np.argwhere(radii >= 1).tolist(), key=sum, reverse=True):
                average = (a + b + 2) / 2
                if average <= best[0]:
                    break
                after = [power(exactly(modes.A[k]), count) if count else None for k, count in ((i, a), (j, b))]
                steps = exactly(modes.A_after[i, j]), after[1], exactly(modes.A_after[j, i]), after[0]
                if proven_radius(reduce(lambda M, step: multiplied(step, M), filter(None, steps))) >= 1:
                    best = average, (j,) * (b + 1) + (i,) * (a + 1)
    return best
