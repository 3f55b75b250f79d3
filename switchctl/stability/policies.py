"""Which methods are proven to be mean-square stable, at which rate, and by what."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from switchctl.continuation import Continuations, policy_path, way_to_hold
from switchctl.graph import SwitchingGraph, as_graph
from switchctl.methods import (
    Constant,
    FewSwitches,
    Method,
    Optimal,
    PointwiseMinimum,
    Policy,
    RecedingHorizon,
    Refine,
    Rollout,
)
from switchctl.modes import ModeSet
from switchctl.moments import Array, smat, transform
from switchctl.stability.falling import Fall, fall, largest_share, rounding, spread, walks
from switchctl.stability.growth import Verdict, definite, transient
from switchctl.stability.holds import longest_hold
from switchctl.stability.switching import word_stability
from switchctl.tables import Summary

_MOVES = 1024  # of a graph up to which a rate is looked for


@dataclass(frozen=True, eq=False, repr=False)
class PolicyStability(Summary):
    """What is proven of a method on some modes: the answer of `policy_stability`.

    Parameters
    ----------
    method : Method
        The method.
    verdict : "stable", "unstable" or "undecided"
        "stable": from every initial state W2 falls to zero. "undecided": not proven, which is no proof of the contrary.
    why : str
        The argument, or what is missing.
    rate, constant : float or None
        The bound ``tr S(k) <= constant * rate^(2k) * tr S(0)`` for every initial state, where there is one that holds
        for all alike; it may be far from sharp, and the constant is infinite where rounding hides it. tr S is W2
        where all states are the plant's, else above it.
    fall : Fall or None
        The value that falls, and by which share, where that is the argument.
    graph : SwitchingGraph
        The modes, and the rules.

    Examples
    --------
    >>> from switchctl.stability import policy_stability
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 1.1]]])
    >>> rollout = policy_stability(modes, Rollout())
    >>> rollout.verdict, round(rollout.rate, 4)
    ('stable', 0.9914)
    >>> print(policy_stability(modes, RecedingHorizon(5)))
    PolicyStability: undecided
    ├── method  RecedingHorizon(horizon=5)
    └── why     no theorem without a constraint at a finite horizon; use decrease=.., an infinite horizon or Rollout
    """

    method: Method
    verdict: Verdict
    why: str
    rate: float | None
    constant: float | None
    fall: Fall | None
    graph: SwitchingGraph

    def _facts(self) -> list[tuple[str, str]]:
        rate = [] if self.rate is None else [("rate", f"{self.rate:.9g} per step")]
        return [("method", repr(self.method)), *rate, ("why", self.why)]

    def _heading(self) -> str:
        return f"PolicyStability: {self.verdict}"


def policy_stability(modes: ModeSet | SwitchingGraph, method: Method) -> PolicyStability:
    """Say whether a method is proven to be mean-square stable on some modes, from every initial state.

    Parameters
    ----------
    modes : ModeSet or SwitchingGraph
        The modes, with or without rules.
    method : Method
        The method.

    Returns
    -------
    PolicyStability

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        Where the method refuses the modes.

    Examples
    --------
    >>> from switchctl.stability import policy_stability
    >>> from switchctl.models import five_mode
    >>> policy_stability(five_mode.modes(), Rollout()).verdict
    'stable'
    """
    graph = as_graph(modes)
    if not isinstance(method, Method):
        raise TypeError(f"method must be a Method such as Rollout(), not {method!r}")
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # what is not finite proves nothing
        method.start(graph)
        try:
            verdict, why, rate, constant, falling = _judge(graph, method)
        except np.linalg.LinAlgError as error:
            verdict, why, rate, constant, falling = _undecided(f"rounding hides it: {error}")
    return PolicyStability(method, verdict, why, rate, constant, falling, graph)


_Answer = tuple[Verdict, str, float | None, float | None, Fall | None]


def _undecided(why: str) -> _Answer:
    return "undecided", why, None, None, None


def _judge(graph: SwitchingGraph, method: Method) -> _Answer:
    if graph.modes.noisy:
        return _undecided("with process noise W2 does not fall to zero; ask for the same modes without W")
    if isinstance(method, Constant):
        return _constant(graph, graph.modes.index(method.mode))
    if graph.modes.cost == "average" and (graph.price.any() or graph.modes.offset.any()):
        return _undecided(
            "an average cost may prefer a cheap mode for ever to a stable one; leave out prices and offsets"
        )
    if isinstance(method, Rollout):
        return _rollout(graph)
    if isinstance(method, Policy):
        return _policy(graph, method)
    if isinstance(method, FewSwitches | Optimal | Refine):
        return _plan(graph, type(method).__name__)
    if isinstance(method, PointwiseMinimum):
        return _pointwise(graph)
    if isinstance(method, RecedingHorizon):
        return _receding_horizon(graph, method)
    return _undecided(f"there is no theorem about {type(method).__name__}; judge a schedule's tail by word_stability")


def _constant(graph: SwitchingGraph, mode: int) -> _Answer:
    """The rate of the mode, and what the way to it may do before."""
    modes = graph.modes
    lead, word = policy_path(graph, way_to_hold(graph, mode)[0], 0)
    growth = word_stability(modes, word)
    if growth.verdict != "stable":
        what = "is not Schur" if growth.verdict == "unstable" else "has a spectral radius too near 1 to decide"
        return growth.verdict, f"mode {modes.names[mode]!r} {what}; hold another one", None, None, None
    rate = growth.upper + (1 - growth.upper) / 10  # at the rate itself there may be no constant
    constant = transient(growth.moves, 1, rate)
    before, moved, most = graph.start_mode, np.eye(modes.A.shape[-1]), 1.0
    for k, i in enumerate([*lead, *word], 1):
        most = max(most, float(np.linalg.norm(moved, 2)) ** 2 / rate ** (2 * (k - 1)))
        moved, before = modes.A_after[before, i] @ moved, i
    most = max(most, float(np.linalg.norm(moved, 2)) ** 2 / rate ** (2 * (len(lead) + 1)))
    why = f"mode {modes.names[mode]!r} is Schur, and held from step {len(lead)} on"
    return "stable", why, rate, float(constant * most) * (1 + 1e-6), None


def _hidden(discount: float) -> _Answer:
    return _undecided(
        "the discount lets states grow; take a greater one"
        if discount < 1
        else "rounding hides it; rescale the states, or leave out modes whose spectral radius is too near 1"
    )


def _blind(graph: SwitchingGraph) -> _Answer:
    return _undecided(
        "the stage weights leave states unseen, which may grow; give every stage weight a positive definite Q"
        if graph.modes.activation is None
        else "the stage weights leave states unseen, those of controllers perhaps, which may grow"
    )


def _values(graph: SwitchingGraph) -> tuple[dict[int, Array], dict[int, Array], list[Array]]:
    """The ways on from each node that has any: their matrices, those of the ways without constants, the residuals."""
    ways = Continuations(graph)
    everything, without, residuals = {}, {}, []
    for v in range(len(graph)):
        numbers, _, constants = ways.table(v)
        if not numbers:
            continue
        everything[v] = np.array([ways.value(v, number).P for number in numbers])
        without[v] = everything[v][constants == 0]
        for number, P in zip(numbers, everything[v], strict=True):
            mode = int(ways.ways[number].policy[v])
            after = ways.value(int(graph.successor[v, mode]), number)
            residuals.append(ways.before(v, mode, after).P - P)
    return everything, without, residuals


def _rollout(graph: SwitchingGraph) -> _Answer:
    everything, without, residuals = _values(graph)
    if not _seen(graph, everything):
        return _blind(graph)
    what = "the cost of the best way on" if len(graph) > 1 else "the cost of the best single mode"
    moves = [edge for edge in graph.edges() if edge.tail in everything and edge.head in everything]
    if len(moves) > _MOVES or not all(map(len, without.values())):
        return _finite(graph, what)
    g, dk = graph.modes.discount, graph.modes.dk
    least = [P for each in everything.values() for P in each]
    compared = [edge.Q / dk + g * transform(edge.A, P) for edge in moves for P in everything[edge.head]]
    return _falling(graph, without, least, rounding(least, compared, residuals), what)


def _seen(graph: SwitchingGraph, nodes: Iterable[int]) -> int:
    """After how many steps the cost has seen every state, whatever the steps; 0 where it need not."""
    return next((found.steps for found in walks(graph, nodes)), 0)


def _falling(graph: SwitchingGraph, above: dict[int, Array], least: list[Array], slack: float, what: str) -> _Answer:
    """The rate of a value that pays for every step, between the least of ``least`` and those ``above`` at each node."""
    g = graph.modes.discount
    found = fall(graph, above, slack)
    if found is None:
        return _hidden(g)
    constant = spread([_least(each) for each in above.values()], least)
    constant *= ((1 + slack) / g / found.rate**2) ** (found.steps - 1)
    steps = "every step" if found.steps == 1 else f"every {found.steps} steps"
    return "stable", f"{what} falls by a share of {found.share:.6g} at {steps}", found.rate, float(constant), found


def _least(matrices: Iterable[Array]) -> Array:
    """The matrix of the least greatest eigenvalue."""
    return min(matrices, key=lambda P: float(np.linalg.eigvalsh(P)[-1]))


def _finite(graph: SwitchingGraph, what: str) -> _Answer:
    """Without a rate: what a run costs is finite, and sees every state."""
    if graph.modes.discount < 1:
        return _undecided("a discounted cost stays finite where states grow slowly; ask for the total")
    return "stable", f"{what} is finite, and pays for every state", None, None, None


def _policy(graph: SwitchingGraph, method: Policy) -> _Answer:
    if not _seen(graph, range(len(graph))):
        return _blind(graph)
    what = "the cost that the policy promises"
    if not graph.free or 0 not in method.tables:
        return _finite(graph, what)
    P = smat(method.tables[0][1])
    return _falling(graph, {0: P}, list(P), rounding(list(P), list(P), []), what)


def _plan(graph: SwitchingGraph, name: str) -> _Answer:
    if graph.modes.discount < 1:
        return _undecided("a plan of finite discounted cost may grow; judge its schedule's tail by word_stability")
    if not _seen(graph, range(len(graph))):
        return _blind(graph)
    if not Continuations(graph).finite[:, 0].any():
        return _undecided(f"no way on at finite cost is known, so {name} may find no plan")
    why = f"{name} returns plans of finite cost, along which W2 falls to zero as their tail does"
    return "stable", why, None, None, None


def _pointwise(graph: SwitchingGraph) -> _Answer:
    modes = graph.modes
    if not graph.free or graph.price.any() or modes.offset.any():
        return _undecided("the pointwise minimum under rules or prices has no theorem; use Rollout")
    Q = modes.Q[0]
    if not ((modes.Q == Q).all() and definite(Q, np.zeros_like(Q))):
        return _undecided("the pointwise minimum has a theorem for one positive definite Q alone; use Rollout")
    nexts = transform(modes.A, Q)
    share, _ = largest_share(Q, nexts)
    contraction = 1 / share + rounding([Q], list(Q + nexts), []) if share > 0 else np.inf
    if not contraction < 1:
        return _undecided(
            "no mean of the modes' next W2 is below the present one, so it may rise whatever mode is taken; use "
            "Rollout, or RecedingHorizon(.., decrease=..)"
        )
    why = f"a mean of what the modes make of it is {1 / share:.6g} of tr(Q S), and the least is below the mean"
    return "stable", why, math.sqrt(contraction), spread([Q], [Q]), None


def _receding_horizon(graph: SwitchingGraph, method: RecedingHorizon) -> _Answer:
    if method.decrease is not None:
        return _constrained(graph, method.hold, method.decrease)
    if len(graph.modes) == 1:
        return _constant(graph, 0)
    if method.horizon == 1 and method.hold == 1:
        return _pointwise(graph)
    if method.horizon == math.inf:
        return _for_ever(graph)
    return _undecided(
        "no theorem without a constraint at a finite horizon; use decrease=.., an infinite horizon or Rollout"
    )


def _for_ever(graph: SwitchingGraph) -> _Answer:
    """The cost of the way that is followed falls, and at an update it is changed for one of no greater cost."""
    everything, without, residuals = _values(graph)
    steps = _seen(graph, everything)
    if not steps:
        return _blind(graph)
    what = "the cost of the way that is followed"
    if len(graph) > 1 or steps > 1 or len(without[0]) < len(everything[0]):
        return _finite(graph, what)
    least = list(everything[0])
    modes, g = graph.modes, graph.modes.discount
    free_of_charge = (graph.price + modes.offset) == 0
    held = [(modes.Q[i], P) for i, P in enumerate(modes.tails) if P is not None and free_of_charge[i]]
    share = min(largest_share(Q, P[None])[0] for Q, P in held)
    contraction = (1 - share + rounding(least, least, residuals)) / g
    if not contraction < 1:
        return _hidden(g)
    why = f"{what} falls by a share of {share:.6g} at every step"
    return "stable", why, math.sqrt(contraction), spread([_least(least)], least), None


def _constrained(graph: SwitchingGraph, hold: int, decrease: float) -> _Answer:
    modes = graph.modes
    if modes.plant_states < modes.A.shape[-1] or modes.activation is not None:
        return _undecided("the constraint's theorem counts all states, and here controllers have states of their own")
    found = longest_hold(graph, hold, decrease)
    if found is None:
        return _undecided("how long holds may have to be is not found; drop the slowest modes or those with a price")
    longest, growth = found
    rate = (1 - decrease) ** (1 / (4 * longest))
    constant = growth * (1 - decrease) ** (-(longest - 1) / (2 * longest)) * (1 + 1e-6)
    why = f"the constraint lowers W2 by a factor of {1 - decrease:.6g} every two updates, at most {longest} steps apart"
    return "stable", why, rate * (1 + 1e-12), constant, None
