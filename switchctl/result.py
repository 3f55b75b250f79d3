"""Schedule: the answer, and everything that follows from it."""

import csv
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from switchctl.files import FormatError, read_document, write_document, write_text
from switchctl.gaussian import Gaussian
from switchctl.gramians import word_tail
from switchctl.methods.base import check_state
from switchctl.modes import ModeSet
from switchctl.moments import Array, moment_factor, trajectory
from switchctl.tables import html_table
from switchctl.validation import frozen, whole_number

if TYPE_CHECKING:
    import pandas
    from control import ControlPlot

_VERSION = 1


class Switch(NamedTuple):
    """A change of mode: the first step of the new mode, and the modes before and after."""

    step: int
    before: int
    after: int


@dataclass(frozen=True, eq=False)
class Schedule:
    """Which mode acts at each step, and what follows from it. `switchctl.schedule` makes one.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.
    sequence : sequence of int, length N
        The mode of each step, by index.
    tail : tuple of int, optional
        The word of modes that follows the last step, repeated for ever; by default the last mode, held.
    method : str, optional
        What made the schedule.
    status : str, optional
        Why it ends where it does.
    lengthened : sequence of (int, int), optional
        The updates at which a stability constraint lengthened the hold: the step, and the steps added.

    Notes
    -----
    The one cost convention of the package: ``cost = dk * (sum_{k=0}^{N-1} tr(Q_sk S_k) + tr(P S_N))``, with P the
    cost matrix of the tail; it is infinite where the tail is not Schur. ``dk`` is dt, or 1 where dt carries no
    period. Arrays over time have one entry a step, for the state at its beginning.

    Examples
    --------
    >>> modes = ModeSet([[[0.5]], [[0.9]]], dt=0.1)
    >>> Schedule(modes, Gaussian([1.0], [[0.0]]), [1, 1, 0])
    Schedule: 3 steps (0.3 s)
    ├── cost      0.26848  (with A0 held after the last step)
    ├── W2        1 -> 0.164025
    ├── switches  1 (A1 -> A0 at step 2)
    └── use       A0 33.3 %, A1 66.7 %
    """

    modes: ModeSet
    x0: Gaussian
    sequence: Any
    tail: tuple[int, ...] = ()
    method: str = ""
    status: str = ""
    lengthened: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        check_state(self.modes, self.x0)
        sequence = np.array([self.modes.index(mode) for mode in self.sequence], dtype=np.intp)
        if len(sequence) == 0:
            raise ValueError("sequence is empty; a schedule has at least one step")
        tail = tuple(self.modes.index(mode) for mode in self.tail) or (int(sequence[-1]),)
        object.__setattr__(self, "sequence", frozen(sequence))
        object.__setattr__(self, "tail", tail)
        object.__setattr__(
            self,
            "lengthened",
            tuple(
                (whole_number(k, "lengthened", 0), whole_number(added, "lengthened", 0)) for k, added in self.lengthened
            ),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        fields = (self.modes, self.x0, self.sequence, self.tail, self.method, self.status, self.lengthened)
        return type(self), fields  # so that copies are checked and read-only too

    def __len__(self) -> int:
        return len(self.sequence)

    @cached_property
    def _run(self) -> tuple[Array, Array, Gaussian]:
        """W2 and stage cost of each step, and the Gaussian after the last."""
        A, Q = self.modes.A, self.modes.Q
        F = moment_factor(self.x0.mean, self.x0.cov)
        w2, stage = np.empty(len(self)), np.empty(len(self))
        with np.errstate(over="ignore", invalid="ignore"):
            for k, mode in enumerate(self.sequence):
                w2[k] = np.vdot(F, F)
                stage[k] = np.vdot(F, Q[mode] @ F)
                F = A[mode] @ F
            left = np.flatnonzero(~np.isfinite([*w2, np.vdot(F, F)]))
        if len(left):
            raise FloatingPointError(f"W2 exceeds the floating-point range after step {left[0] - 1}")
        return frozen(w2), frozen(stage), Gaussian(F[:, 0], F[:, 1:] @ F[:, 1:].T)

    @property
    def time(self) -> Array:
        """Time of each step in seconds (or its number, where the modes carry no period), shape (N,)."""
        return np.arange(len(self), dtype=float) * self.modes.dk

    @property
    def w2(self) -> Array:
        """Squared Wasserstein distance to the origin, ``tr S_k``, shape (N,)."""
        return self._run[0]

    @cached_property
    def mean(self) -> Array:
        """Mean of the state, shape (n, N): time runs along the last axis, as in python-control."""
        return frozen(trajectory(self.modes.A, self.sequence[:-1], self.x0.mean[:, None])[:, :, 0].T)

    @cached_property
    def cov(self) -> Array:
        """Covariance of the state, shape (N, n, n)."""
        root = moment_factor(self.x0.mean, self.x0.cov)[:, 1:]
        roots = trajectory(self.modes.A, self.sequence[:-1], root)
        return frozen(roots @ np.swapaxes(roots, -1, -2))

    @property
    def final(self) -> Gaussian:
        """The state after the last step."""
        return self._run[2]

    @cached_property
    def tail_cost(self) -> float:
        """Cost of what follows the last step, ``dk * tr(P S_N)``; infinite where the tail is not Schur."""
        P = word_tail(self.modes.A, self.modes.Q, self.tail)
        return np.inf if P is None else float(self.modes.dk * np.sum(P * self.final.second_moment))

    @cached_property
    def cost(self) -> float:
        """``dk * sum_k tr(Q S_k)`` to the end of time (see Notes for the convention)."""
        cost = float(self.modes.dk * self._run[1].sum() + self.tail_cost)
        if np.isnan(cost):
            raise FloatingPointError("the cost exceeds the floating-point range; scale the weights")
        return cost

    @property
    def _known_cost(self) -> float | None:
        """The cost where it is a finite number, else None."""
        try:
            return self.cost if np.isfinite(self.cost) else None
        except (ArithmeticError, np.linalg.LinAlgError):
            return None

    def area(self, start: int = 0, stop: int | None = None) -> float:
        """Area under W2 over a range of steps: ``dk * sum_{k=start}^{stop-1} W2(k)``, the paper's finite sum.

        Parameters
        ----------
        start, stop : int, optional
            The steps, half-open as in Python; the whole schedule by default.

        Returns
        -------
        float
        """
        stop = len(self) if stop is None else whole_number(stop, "stop", 0)
        start = whole_number(start, "start", 0)
        if not start <= stop <= len(self):
            raise ValueError(f"start = {start}, stop = {stop}; expected 0 <= start <= stop <= {len(self)}")
        return float(self.modes.dk * self.w2[start:stop].sum())

    @cached_property
    def switches(self) -> tuple[Switch, ...]:
        """Every change of mode: its step, the mode before and the mode after."""
        s = self.sequence
        return tuple(Switch(int(k), int(s[k - 1]), int(s[k])) for k in np.flatnonzero(np.diff(s)) + 1)

    @property
    def dwell_times(self) -> NDArray[np.intp]:
        """Lengths in steps of the runs of one mode, first to last (the last is cut by the schedule's end)."""
        return np.diff([0, *(switch.step for switch in self.switches), len(self)]).astype(np.intp)

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the schedule as a table with one row a step: k, time, index, name, w2. Needs pandas.

        Returns
        -------
        pandas.DataFrame
            Indexed by k.
        """
        import pandas

        columns = {
            "time": self.time,
            "index": self.sequence,
            "name": [self.modes.names[mode] for mode in self.sequence],
            "w2": self.w2,
        }
        return pandas.DataFrame(columns, index=pandas.RangeIndex(len(self), name="k"))

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write one row a step: k, time, index, name, w2.

        Parameters
        ----------
        path : path-like
            The file to write.

        Returns
        -------
        pathlib.Path
        """
        text = io.StringIO()
        writer = csv.writer(text)
        writer.writerow(["k", "time", "index", "name", "w2"])
        rows = zip(self.time.tolist(), self.sequence.tolist(), self.w2.tolist(), strict=True)
        writer.writerows([k, t, mode, self.modes.names[mode], w2] for k, (t, mode, w2) in enumerate(rows))
        return write_text(path, text.getvalue())

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the schedule, with its modes and initial state, as versioned JSON.

        Parameters
        ----------
        path : path-like
            The file to write.

        Returns
        -------
        pathlib.Path
        """
        modes = self.modes
        content = {
            "method": self.method,
            "status": self.status,
            "cost": self._known_cost,
            "dt": modes.dt,
            "names": modes.names,
            "states": modes.states,
            "mean": self.x0.mean.tolist(),
            "cov": self.x0.cov.tolist(),
            "A": modes.A.tolist(),
            "Q": modes.Q.tolist(),
            "gains": None if modes.gains is None else modes.gains.tolist(),
            "tail": self.tail,
            "lengthened": self.lengthened,
            "sequence": self.sequence.tolist(),
        }
        return write_document(path, "schedule", _VERSION, content)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a schedule that `save` wrote.

        Parameters
        ----------
        path : path-like
            The file to read.

        Returns
        -------
        Schedule

        Raises
        ------
        FormatError
            If the file is not a schedule of this version, or contradicts itself.
        """
        document = read_document(path, "schedule", _VERSION)
        try:
            modes = ModeSet(
                document["A"],
                _list(document["names"]),
                document["dt"],
                Q=document["Q"],
                gains=document["gains"],
                states=_list(document["states"]),
            )
            schedule = cls(
                modes,
                Gaussian(document["mean"], document["cov"]),
                _list(document["sequence"]),
                tuple(_list(document["tail"])),
                _text(document["method"]),
                _text(document["status"]),
                document["lengthened"],
            )
            stored = document["cost"]
            if stored is not None and not np.isclose(schedule.cost, stored, rtol=1e-6, atol=0):
                raise ValueError(f"it states the cost {stored}, its sequence costs {schedule.cost}")
        except (LookupError, TypeError, ValueError, ArithmeticError) as error:
            raise FormatError(f"{path} is a damaged schedule: {error}") from None
        return schedule

    def plot(self, **keywords: Any) -> "ControlPlot":
        """Draw W2 with the active mode under it; see `switchctl.plotting.plot_w2` for the keywords.

        Returns
        -------
        control.ControlPlot
        """
        from switchctl.plotting import plot_w2

        return plot_w2(self, **keywords)

    def _facts(self) -> list[tuple[str, str]]:
        names = self.modes.names
        after = " ".join(names[mode] for mode in self.tail) + (" held" if len(self.tail) == 1 else " repeated")
        switches = [f"{names[s.before]} -> {names[s.after]} at step {s.step}" for s in self.switches[:3]]
        more = f", .. {len(self.switches) - 3} more" if len(self.switches) > 3 else ""
        share = np.bincount(self.sequence, minlength=len(names)) / len(self)
        facts = [
            ("method", self.method),
            ("cost", _told(lambda: f"{self.cost:.6g}  (with {after} after the last step)")),
            ("W2", _told(lambda: f"{self.w2[0]:.6g} -> {self.final.w2():.6g}")),
            ("switches", f"{len(self.switches)}" + (f" ({', '.join(switches)}{more})" if switches else "")),
            ("use", ", ".join(f"{name} {100 * s:.1f} %" for name, s in zip(names, share, strict=True) if s)),
            ("ends", self.status),
        ]
        if self.lengthened:
            steps = ", ".join(str(k) for k, _ in self.lengthened[:5]) + ", .." * (len(self.lengthened) > 5)
            holds = f"{len(self.lengthened)} hold{'s' * (len(self.lengthened) > 1)}"
            facts.append(("lengthened", f"{holds}, for stability, at step {steps}"))
        return [(key, value) for key, value in facts if value]

    def _heading(self) -> str:
        duration = "" if self.modes.dt is True else f" ({len(self) * self.modes.dk:g} s)"
        return f"Schedule: {len(self)} step{'s' * (len(self) > 1)}{duration}"

    def __repr__(self) -> str:
        facts = self._facts()
        width = max(len(key) for key, _ in facts)
        branches = ["├──"] * (len(facts) - 1) + ["└──"]
        lines = [f"{branch} {key:<{width}}  {value}" for branch, (key, value) in zip(branches, facts, strict=True)]
        return "\n".join([self._heading(), *lines])

    def _repr_html_(self) -> str:
        return html_table(["", ""], self._facts(), self._heading())


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"{value!r} stands where a list should")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} stands where a text should")
    return value


def _told(value: Callable[[], str]) -> str:
    """A value for a person to read, or why there is none: what can't be computed must not hide the rest."""
    try:
        return value()
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return f"not available: {error}"
