"""What a method is: an immutable record of settings that starts a running scheduler."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from control import ControlDimension
from numpy.typing import NDArray

from switchctl.continuation import Continuations, Plan, wander
from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.limits import find, indices
from switchctl.methods.least import least_cost
from switchctl.modes import ModeSet
from switchctl.moments import Array, second_moment, svec
from switchctl.validation import positive_semidefinite, real_array, whole_number


class InfiniteCostError(ValueError):
    """No way on costs finitely much, and the method needs one."""


class Scheduler(ABC):
    """A running method: told the state's moments once a sample, it names the mode to use.

    Parameters
    ----------
    graph : SwitchingGraph or ModeSet
        The modes to choose from, and the moves that the rules allow.

    Attributes
    ----------
    modes : ModeSet
        The modes.
    graph : SwitchingGraph
        The moves allowed; one node where there are no rules.
    node : int
        The node of the graph that the run has come to.
    lengthened : int
        Steps added to the hold begun at this sample to meet a stability constraint.
    statistics : dict
        What a method that plans reports of its search: numbers by name.
    interrupted : bool
        Whether Ctrl-C cut that search short.
    status : str
        What a search says of its end; empty where the run alone says why it ends.
    lower_bound : float or None
        What every run from the first sample costs at least, where the method proves it.
    terminal : array, shape (n, n), or None
        The weight of the state after the last step of a run that ends there; None where the run goes on.
    steps : int or None
        The length of the run, where it is known before it begins.
    initial : array, shape (n, n), or None
        The second moment at the first sample, where it is known more exactly than by the factor of a prediction.
    target : Gaussian or None
        The distribution of the plant's state that is wanted; None for the origin.
    moment_factor : array, shape (n, n + 1), or None
        Where there is a target, the moment factor at the sample, which tells mean and covariance apart.
    """

    lengthened: int = 0
    interrupted: bool = False
    status: str = ""
    lower_bound: float | None = None
    terminal: Array | None = None
    steps: int | None = None
    initial: Array | None = None
    target: Gaussian | None = None
    moment_factor: Array | None = None

    def __init__(self, graph: SwitchingGraph | ModeSet) -> None:
        self.graph = as_graph(graph)
        self.modes = self.graph.modes
        self.statistics: dict[str, float] = {}
        self.reset()

    @abstractmethod
    def decide(self, S: Array) -> int:
        """Choose the mode for one step, among those `allowed`.

        Parameters
        ----------
        S : array, shape (n, n)
            The current second moment, which `step` has checked.

        Returns
        -------
        int
            Index of the mode.
        """

    def reset(self) -> None:
        """Begin anew: the next sample is the first."""
        self.node, self.last = 0, -1
        self.interrupted, self.statistics, self.status, self.lower_bound = False, {}, "", None
        self.forget()

    def recover(self, sequence: Sequence[int]) -> None:
        """Stand where a sequence of steps from the start leads, for `tail`.

        Parameters
        ----------
        sequence : sequence of int
            The modes taken.
        """
        modes = indices(self.modes, sequence, "sequence")
        self.node, self.last = int(self.graph.walk(modes)[-1]), modes[-1] if modes else -1

    def forget(self) -> None:  # noqa: B027  a scheduler without memory has nothing to forget
        """Forget what the method itself remembers; `reset` calls it."""

    @property
    def memory(self) -> Array:
        """What the scheduler remembers from one sample to the next, as numbers; all zero before the first sample.

        Assigned to a scheduler of the same method and graph, it takes that one to the same place: it decides from there
        as this one would. The entries are the node, the last mode counted from 1, and what the method has `remembered`;
        their number never changes.
        """
        return np.array([self.node, self.last + 1, *self.remembered()], dtype=float)

    @memory.setter
    def memory(self, values: Any) -> None:
        entries = real_array(values, "memory", (len(self.memory),)).tolist()
        node, last = whole_number(entries[0], "memory[0]", 0), whole_number(entries[1], "memory[1]", 0)
        if node >= len(self.graph) or last > len(self.modes):
            raise ValueError(
                f"memory begins with {node}, {last}; expected a node below {len(self.graph)} and a mode, counted from "
                f"1, up to {len(self.modes)}"
            )
        before = vars(self).copy()
        try:
            self.node, self.last, self.interrupted = node, last - 1, False
            self.recall(entries[2:])
        except BaseException:
            vars(self).update(before)
            raise

    def remembered(self) -> Sequence[float]:
        """What the method itself remembers, for `memory`: as many numbers at each sample, all zero before the first.

        Returns
        -------
        sequence of float

        Raises
        ------
        TypeError
            If a method has something to `forget`, and doesn't say what.
        """
        if type(self).forget is not Scheduler.forget:
            raise TypeError(
                f"{type(self).__name__} has something to forget, and doesn't say as numbers what it remembers; give it "
                "remembered() and recall(values)"
            )
        return ()

    def recall(self, values: Sequence[float]) -> None:
        """Take up what the method itself `remembered`, after `node` and `last`.

        Parameters
        ----------
        values : sequence of float
            The numbers.

        Raises
        ------
        TypeError, ValueError
            If it has not remembered such numbers; it stays as it is then.
        """
        self._numbers(values)

    def _numbers(self, values: Any) -> list[float]:
        """What is to be recalled, checked to be as many numbers as are remembered."""
        return real_array(values, "values", (len(self.remembered()),)).tolist()

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Which modes the rules let the coming step take, shape (m,). After each of them there is a way on."""
        return self.graph.successor[self.node] >= 0

    @cached_property
    def continuations(self) -> Continuations:
        """The ways to go on for ever."""
        return Continuations(self.graph)

    def choose(self, S: Array) -> int:
        """Decide, and take the step in the switching graph.

        Parameters
        ----------
        S : array, shape (n, n)
            The current second moment.

        Returns
        -------
        int
            Index of the mode.

        Raises
        ------
        ValueError
            If S is no second moment, or `decide` chose a mode that is not there or that the rules don't allow.
        TypeError
            If S doesn't hold real numbers, or `decide` returned no index.
        """
        return self.take(positive_semidefinite(self._moment(S), "S"))

    def take(self, S: Array) -> int:
        """Do as `choose` does, for a second moment that has been checked.

        Parameters
        ----------
        S : array, shape (n, n)
            The current second moment.

        Returns
        -------
        int
            Index of the mode.

        Raises
        ------
        TypeError, LookupError, ValueError
            If `decide` chose what is no mode, or one that the rules don't allow.
        """
        mode = find(self.modes, chosen := self.decide(S), f"{type(self).__name__}.decide")
        if mode != chosen and not isinstance(chosen, str):
            raise IndexError(f"{type(self).__name__}.decide returned {chosen}; modes are counted from 0")
        head = int(self.graph.successor[self.node, mode])
        if head < 0:
            raise ValueError(f"{type(self).__name__} chose against the rules: {self.graph.refusal(self.node, mode)}")
        self.node, self.last = head, mode
        return mode

    def tail(self, S: Array) -> Plan:
        """Name the modes that follow a schedule's last step.

        Parameters
        ----------
        S : array, shape (n, n)
            The second moment after the last step.

        Returns
        -------
        lead, word : tuples of int
            The modes taken once, and those repeated for ever after. Unless a method knows better: without rules the
            last mode, held; under rules the cheapest way on.

        Raises
        ------
        ValueError
            If no step has been taken.
        """
        if self.last < 0:
            raise ValueError("no step has been taken, so nothing follows the last one; call tail after step")
        if self.graph.free and self.graph.price[self.last] == 0:
            return (), (self.last,)
        held = np.isinf(self.graph.holds[self.node, self.last])
        return self.cheapest_way(S) or (((), (self.last,)) if held else wander(self.graph, self.node))

    def cheapest_way(self, S: Array) -> Plan | None:
        """The way on that costs least, as `tail` names it; None where none costs finitely much.

        Parameters
        ----------
        S : array, shape (n, n)
            The current second moment.

        Returns
        -------
        lead, word : tuples of int, or None
        """
        numbers, rows, constants = self.continuations.table(self.node)
        if not numbers:
            return None
        return self.continuations.path(self.node, numbers[least_cost(rows @ svec(self._moment(S)) + constants)])

    def _moment(self, S: Any) -> Array:
        """A second moment that was handed in, checked to be finite and of the modes' dimension."""
        return real_array(S, "S", self.modes.A.shape[1:])

    def step(self, mean: Any, cov: Any = None) -> int:
        """Choose the mode for the coming sample, from the state's mean and covariance; call it once a sample.

        Parameters
        ----------
        mean : array_like, shape (n,)
            Mean of the state (or the measured state). Where the last states of the modes are an estimate of the
            plant's, it may be left out: the mean of the plant's state is the estimate.
        cov : array_like, shape (n, n), optional
            Its covariance, or that of the plant's states alone; zero by default: the state is known.

        Returns
        -------
        int
            Index of the mode.

        Raises
        ------
        ValueError
            If a shape doesn't fit, an entry is not finite, or cov is not symmetric positive semidefinite.
            Nothing is decided then, and the next call continues as if this one hadn't been.
        FloatingPointError
            If the second moment or a cost exceeds the floating-point range; nothing is decided then either.
        KeyboardInterrupt
            On Ctrl-C, also during a search; nothing is decided then either.
        """
        mean, cov = self._told(mean, cov)
        with np.errstate(over="ignore", invalid="ignore"):
            S = second_moment(mean, cov)
            if not np.isfinite(S).all():
                raise FloatingPointError("the second moment exceeds the floating-point range; scale the state")
            before = vars(self).copy()
            try:
                mode = self.take(S)
                if self.interrupted and not before["interrupted"]:
                    raise KeyboardInterrupt  # the loop that calls is meant, not the search alone
            except BaseException:
                vars(self).update(before)
                raise
        return mode

    def _told(self, mean: Any, cov: Any) -> tuple[Array, Array]:
        """The mean and covariance of the whole state, from what a filter knows."""
        n, p, e = self.modes.A.shape[-1], self.modes.plant_states, self.modes.estimate_states
        mean = real_array(mean, "mean")
        if e and mean.shape == (n - e,):
            mean = np.append(mean, mean[:p])
        if mean.shape != (n,):
            less = f", or ({n - e},) without the estimate" if e else ""
            all_of = f": of the controllers' states too, {', '.join(self.modes.states[p:])}" if p < n else ""
            raise ControlDimension(f"mean has shape {mean.shape}; expected ({n},){less}{all_of}")
        whole = np.zeros((n, n))
        if cov is not None:
            cov = real_array(cov, "cov")
            if cov.shape not in ((n, n), (p, p)):
                plant = f", or {(p, p)} of the plant's states alone" if p < n else ""
                raise ControlDimension(f"cov has shape {cov.shape}; expected {(n, n)}{plant}")
            whole[: len(cov), : len(cov)] = positive_semidefinite(cov, "cov")
        return mean, whole


class _Shape(tuple[int, ...]):
    """An array as the record of a method tells it."""

    def __repr__(self) -> str:
        return f"<{' by '.join(map(str, self))}>"


class Method(ABC):
    """A way to schedule: settings, fixed once made. Methods are interchangeable in `schedule` and `compare`.

    Attributes
    ----------
    evaluates : bool
        Whether it can work towards a Gaussian target: whether it needs no cost that is linear in the second moment.
    """

    evaluates: ClassVar[bool] = False

    @abstractmethod
    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:
        """Start the running scheduler.

        Parameters
        ----------
        graph : SwitchingGraph or ModeSet
            The modes to choose from, with or without rules.

        Returns
        -------
        Scheduler

        Raises
        ------
        TypeError
            If graph is neither.
        ValueError
            If the method can't work with these modes and rules.
        """

    def __repr__(self) -> str:
        """Name the settings that differ from their defaults."""
        defaults: dict[str, Any] = (
            {field.name: field.default for field in fields(self) if field.repr} if is_dataclass(self) else {}
        )
        values = {name: getattr(self, name) for name in defaults}
        changed = {n: v for n, v in values.items() if isinstance(v, np.ndarray) or v != defaults[n]}
        changed = {n: _Shape(v.shape) if isinstance(v, np.ndarray) else v for n, v in changed.items()}
        told = [f"{name}={getattr(value, '__qualname__', repr(value))}" for name, value in changed.items()]
        return f"{type(self).__name__}({', '.join(told)})"
