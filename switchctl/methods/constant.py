"""One mode for ever: the yardstick of every other method."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from switchctl.continuation import Continuations, Nodes, Plan, policy_path, way_to_hold
from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods.base import Method, Scheduler
from switchctl.methods.boundary import initial_state
from switchctl.methods.least import least_cost
from switchctl.modes import Mode, ModeSet
from switchctl.moments import Array
from switchctl.validation import shown
from switchctl.values import cost_of, require_criterion


@dataclass(frozen=True, repr=False)
class Constant(Method):
    """Hold one mode for ever; under switching rules, as soon as they allow it.

    Parameters
    ----------
    mode : int, str or Mode
        Its index or name, or the mode itself.

    Raises
    ------
    TypeError
        If it is none of these.
    KeyError, IndexError
        From `start` and `schedule`, if there is no such mode.
    ValueError
        From `start` and `schedule`, if the rules never let it be held for ever.

    Examples
    --------
    >>> modes = ModeSet([[[0.5]], [[0.9]]])
    >>> Constant("A1").start(modes).step([1.0])
    1
    """

    mode: int | str | Mode
    evaluates: ClassVar[bool] = True

    def __post_init__(self) -> None:
        mode = self.mode.name if isinstance(self.mode, Mode) else self.mode
        if isinstance(mode, bool) or not isinstance(mode, (str, int, np.integer)):
            raise TypeError(f"mode must be the index or the name of a mode, or the mode itself, not {shown(mode)}")
        object.__setattr__(self, "mode", mode if isinstance(mode, str) else int(mode))

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        graph = as_graph(graph)
        mode = graph.modes.index(self.mode)
        policy, _ = way_to_hold(graph, mode)
        if policy[0] < 0:
            raise ValueError(f"mode {graph.modes.names[mode]!r} can't be held for ever under {graph.rules!r}")
        return _ConstantScheduler(graph, policy)


class _ConstantScheduler(Scheduler):
    def __init__(self, graph: SwitchingGraph, policy: Nodes) -> None:
        super().__init__(graph)
        self.policy = policy

    def decide(self, S: Array) -> int:
        return int(self.policy[self.node])

    def tail(self, S: Array) -> Plan:
        return policy_path(self.graph, self.policy, self.node)


def single_mode_costs(modes: ModeSet | SwitchingGraph, x0: Gaussian) -> Array:
    """Cost of each mode held for ever: ``dk * tr(P_i S_0)``, infinite where the mode is not Schur.

    Parameters
    ----------
    modes : ModeSet or SwitchingGraph
        The modes; of a switching graph, each mode held as soon as the rules allow it, with what that costs, infinite
        where they never do.
    x0 : Gaussian
        The initial state.

    Returns
    -------
    array, shape (m,)

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or x0 is not one Gaussian of the modes' dimension.

    Examples
    --------
    >>> single_mode_costs(ModeSet([[[0.5]], [[2.0]]]), Gaussian([3.0], [[0.0]]))
    array([12., inf])
    """
    x0 = initial_state(modes.modes if isinstance(modes, SwitchingGraph) else modes, x0)
    graph = as_graph(modes)
    require_criterion(graph.modes)
    S, costs = x0.second_moment, np.full(len(graph.modes), np.inf)
    ways = Continuations(graph)
    for mode, number in ways.held.items():
        if ways.finite[number, 0]:
            costs[mode] = cost_of(graph.modes, ways.value(0, number), S)
    return costs


def best_single_mode(modes: ModeSet, x0: Gaussian) -> Mode:
    """Return the mode that costs least when held for ever; of modes that tie, the first.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    x0 : Gaussian
        The initial state.

    Returns
    -------
    Mode

    Raises
    ------
    ValueError
        If none costs finitely much (see `tail`).

    Examples
    --------
    >>> best_single_mode(ModeSet([[[0.5]], [[2.0]]]), Gaussian([3.0], [[0.0]])).name
    'A0'
    """
    x0 = initial_state(modes, x0)
    require_schur(modes, "the best single mode")
    costs = single_mode_costs(modes, x0)
    if not np.isfinite(costs).any():
        raise ValueError(
            "no mode costs finitely much for ever: each pays an offset at every step; see ModeSet(cost=..)"
        )
    return modes[least_cost(costs, np.isfinite(costs))]


def require_schur(modes: ModeSet, what: str) -> None:
    """Raise unless at least one mode costs finitely much for ever: is Schur stable, as far as the cost sees it."""
    if all(P is None for P in modes.tails):
        radii = ", ".join(f"{n}: {r:.6g}" for n, r in zip(modes.names, modes.spectral_radii, strict=True))
        raise ValueError(
            f"{what} needs a Schur mode (spectral radius below 1), and none of these is: {radii}; "
            "stabilise one, or use a method with a finite horizon"
        )
