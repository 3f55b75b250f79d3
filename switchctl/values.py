"""What goes on costs: an affine functional of the second moment, and what a step makes of it.

With the discount g (1 for a total or an average), ``V(S) = tr(P S) + c`` after a step of mode i is worth
``tr((Q_i + g A_i' P A_i) S) + r_i + g (c + tr(P W_i))`` before it: W_i is the process noise, r_i the constant cost.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.gramians import seen, tail, word_tail
from switchctl.graph import SwitchingGraph
from switchctl.modes import ModeSet
from switchctl.moments import Array, transform


class Value(NamedTuple):
    """A cost ``dk * (tr(P S) + constant)``.

    Where costs are averages, ``rate`` is the average per step, and P and the constant tell how much more or less than
    that the run costs at the beginning.
    """

    P: Array
    constant: float
    rate: float = 0.0


def before_step(graph: SwitchingGraph, mode: int, value: Value) -> Value:
    """What a step in a mode and then something of known value cost, after the switch to the mode."""
    modes = graph.modes
    paid = float(graph.price[mode] + modes.offset[mode]) - value.rate
    with np.errstate(over="ignore", invalid="ignore"):
        P = modes.Q[mode] + modes.discount * transform(modes.A[mode], value.P)
    if not np.isfinite(P).all():
        raise FloatingPointError(
            f"a step of mode {modes.names[mode]!r} and what follows it cost more than the floating-point range holds "
            f"(greatest entry {np.abs(modes.A[mode]).max():.3g}); scale the states, or leave that mode out"
        )
    return Value(P, paid + modes.discount * (value.constant + float(np.sum(value.P * modes.W[mode]))), value.rate)


def switched(graph: SwitchingGraph, v: int, mode: int, value: Value) -> Value:
    """The value of what begins with a mode, before the switch to it at a node and with what that costs."""
    before, dk = graph.last_mode[v], graph.modes.dk
    fixed, by_w2 = graph.switch_cost[before, mode] / dk, graph.switch_cost_per_w2[before, mode] / dk
    P = value.P
    if graph.modes.activation is not None and before >= 0:
        P = transform(graph.modes.activation[before, mode], P)
    P = P + by_w2 * graph.modes.distance if by_w2 else P
    return Value(P, float(value.constant + fixed), value.rate)


def word_value(graph: SwitchingGraph, word: tuple[int, ...]) -> Value | None:
    """What a word repeated for ever costs per dk, after the switch to its first mode; None where that is infinite."""
    modes, dk, here, before = graph.modes, graph.modes.dk, np.array(word), np.array([word[-1], *word[:-1]])
    Q = modes.Q_after[before, here] + graph.switch_cost_per_w2[before, here, None, None] / dk * modes.distance
    r = modes.offset[here] + graph.price[here] + graph.switch_cost[before, here] / dk
    first = modes.Q[word[0]], float(modes.offset[word[0]] + graph.price[word[0]])
    return repeated(modes, word, Q, r, first)


def repeated(modes: ModeSet, word: tuple[int, ...], Q: Array, r: Array, first: tuple[Array, float]) -> Value | None:
    """What a word costs, repeated for ever at the charges Q and r, per dk.

    Parameters
    ----------
    modes : ModeSet
        The modes.
    word : tuple of int
        The modes of a period.
    Q, r : arrays, shapes (p, n, n) and (p,)
        What its steps cost, as weights of the state before each switch and as constants.
    first : array and float
        What the first step costs of the state after its switch.

    Returns
    -------
    Value or None
        Of the state after the first switch; None where it is infinite.
    """
    g, here, before = modes.discount, np.array(word), np.array([word[-1], *word[:-1]])
    A, W, p = modes.A_after[before, here], modes.W[here], len(word)
    if p == 1 and np.array_equal(Q[0], modes.Q[word[0]]):
        P = modes.tails[word[0]]  # already solved for
    else:
        P = word_tail(np.sqrt(g) * A, Q, tuple(range(p))) if Q.any() else np.zeros_like(Q[0])
    if P is None:
        return None
    ahead = [P]  # the matrices after each step, from the last one on
    for k in range(p - 1, 0, -1):
        ahead.append(Q[k] + g * transform(A[k], ahead[-1]))
    ahead.reverse()
    paid = r + g * np.einsum("kij,kij->k", np.array(ahead), W)
    rate = 0.0
    if modes.cost == "average":
        rate = float(paid.mean())
        paid = paid - rate
    period = float(g ** np.arange(p) @ paid)
    if g < 1:
        constant = period / (1 - g**p)
    elif modes.cost == "average":
        constant = -float(np.sum(P * _stationary(A, W, Q)))
    elif period > 0:
        return None
    else:
        constant = 0.0
    later = constant
    for k in range(p - 1, 0, -1):
        later = float(paid[k] + g * later)
    last = first[1] - rate + g * (later + float(np.sum(ahead[0] * W[0])))
    return Value(first[0] + g * transform(modes.A[word[0]], ahead[0]), last, rate)


def _stationary(A: Array, W: Array, Q: Array) -> Array:
    """The moment at the beginning of each period that comes back after it, of the states that the cost sees."""
    product, noise, weight = np.eye(A.shape[-1]), np.zeros_like(W[0]), np.zeros_like(Q[0])
    for Ak, Wk, Qk in zip(A, W, Q, strict=True):
        weight = weight + transform(product, Qk)
        product, noise = Ak @ product, Ak @ noise @ Ak.T + Wk
    states: NDArray[np.bool_] = seen(product, weight)
    kept = np.outer(states, states)
    found = tail((product * kept).T, noise * kept)
    assert found is not None  # the same powers summed as for P
    return found


def cost_of(modes: ModeSet, value: Value, S: Array) -> float:
    """A value for a moment in the unit of `Schedule.cost`: an average per step, or else dk times the sum."""
    if modes.cost == "average":
        return value.rate
    with np.errstate(over="ignore", invalid="ignore"):
        cost = float(modes.dk * (np.sum(value.P * S) + value.constant))
    if not math.isfinite(cost):
        raise FloatingPointError("a cost exceeds the floating-point range; scale the state or the weights")
    return cost


def require_criterion(modes: ModeSet) -> None:
    """Refuse a total for ever of what noise makes infinite."""
    if modes.noisy and modes.cost == "total":
        raise ValueError(
            "with noise the total cost for ever is infinite; say which cost is meant: cost=('discounted', 0.99) or "
            "cost='average' in close_loops or ModeSet; or a run that ends, schedule(.., steps=N, terminal=M), by "
            "RecedingHorizon, PointwiseMinimum, or Refine of one of these"
        )


def require_plain_total(modes: ModeSet, what: str, instead: str = "") -> None:
    """Refuse noise, discounts and averages where only a total cost of the state alone is understood."""
    if modes.noisy or modes.offset.any() or modes.cost != "total":
        raise ValueError(
            f"{what} is for total costs without noise, and these modes have "
            f"{'noise' if modes.noisy else 'an offset' if modes.offset.any() else f'cost={modes.cost!r}'}{instead}"
        )


def require_definite_weights(modes: ModeSet, what: str, share: float = 0.0) -> None:
    """Refuse stage weights with an eigenvalue of no more than this share of the greatest; say what they leave out."""
    least, greatest = np.linalg.eigvalsh(modes.Q).T[[0, -1]]
    if (least > share * greatest).all():
        return
    worst = int(np.divide(least, greatest, out=np.zeros_like(least), where=greatest > 0).argmin())
    free = [name for name, row in zip(modes.states, modes.Q[worst], strict=True) if not row.any()]
    told = f" (no weight on {', '.join(free)})" if free else ""
    raise ValueError(
        f"{what} needs positive definite stage weights, and that of {modes.names[worst]!r} is singular{told}; give a Q "
        f"with some weight on all {len(modes.states)} states"
    )


def refuse_average(modes: ModeSet, what: str) -> None:
    """Refuse averages where it is the beginning of a run that is planned, which no average shows."""
    if modes.cost == "average":
        raise ValueError(f"{what} plans the beginning of a run, which cost='average' doesn't see; use Rollout")
