"""Whether switching helps at all: the paper's first question, decided for all initial states at once."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from tqdm import tqdm

from switchctl.gaussian import Gaussian
from switchctl.gramians import tail, word_tail
from switchctl.graph import SwitchingGraph
from switchctl.methods.boundary import initial_state
from switchctl.methods.constant import single_mode_costs
from switchctl.methods.optimal import OPTIMAL, Optimal
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet, require_modes
from switchctl.moments import Array, smat, transform
from switchctl.optimum.decisions import Decisions
from switchctl.optimum.upper import contracting_walk
from switchctl.result import Schedule
from switchctl.scheduling import schedule
from switchctl.stability.pairs import Pairs, Verdict, positive_definite
from switchctl.tables import Summary
from switchctl.validation import frozen
from switchctl.values import require_plain_total

_LONGEST = 2**47


@dataclass(frozen=True, eq=False, repr=False)
class SwitchingHelp(Summary):
    """Whether some switching sequence costs less than every single mode. `does_switching_help` makes one.

    Costs are per dk: ``tr(P S)``.

    Parameters
    ----------
    modes : ModeSet
        The modes. ``modes.tails`` are the P of single modes.
    helps : bool or None
        True: from ``moment`` a sequence costs less than every single mode. False: from no initial state does any cost
        less, but for the share ``gain``, at most 1e-9. None: neither is proven.
    why : str
        The reason in words.
    gain : float
        No sequence costs less than ``1 - gain`` times the best single mode, from any initial state; 1 where nothing is
        proven.
    combinations : mapping of (int, int) to array of shape (m,)
        For the modes (i, q), q with a tail: the weights alpha of the tails with ``sum_p alpha_p P_p <= Q_i + A_i' P_q
        A_i``, or nearly so.
    dominant : int or None
        A mode that is the best from every initial state, up to ``gain``: its ``P <= Q_i + A_i' P A_i`` for all i.
    paper_test : int or None
        The mode a of the paper's test: ``rho(A_a) < rho(A_b)`` and ``A_a' A_a < A_b' A_b`` for all other b. It proves
        nothing (docs/theory.md).
    pair : (int, int) or None
        Of a True: one step of the first mode, then the second for ever, cost less from ``moment``.
    word : tuple of int or None
        Of a True without any mode of finite cost: modes that cost finitely much, repeated for ever.
    moment : array, shape (n, n), or None
        Of a True: the second moment S of the initial state, positive definite, of trace 1; I with a word.
    cost : float or None
        Of a True: what the pair or the word cost from there.
    best_single : float or None
        Of a True: what the best single mode costs from there.
    outlasted : mapping of int to int
        Of a True: the modes without a tail, and a number of steps within which each costs more than that from there.
    schedule : Schedule or None
        With x0: the best sequence found from there.
    saves_at_least, saves_at_most : float or None
        With x0: what the best sequence saves, as shares of the best single mode's cost.
    status : str
        "done", "time limit", or "interrupted" by Ctrl-C.
    """

    modes: ModeSet
    helps: bool | None
    why: str
    gain: float = 1.0
    combinations: Mapping[tuple[int, int], Array] = field(default_factory=dict)
    dominant: int | None = None
    paper_test: int | None = None
    pair: tuple[int, int] | None = None
    word: tuple[int, ...] | None = None
    moment: Array | None = None
    cost: float | None = None
    best_single: float | None = None
    outlasted: Mapping[int, int] = field(default_factory=dict)
    schedule: Schedule | None = None
    saves_at_least: float | None = None
    saves_at_most: float | None = None
    status: str = "done"

    def _heading(self) -> str:
        return f"SwitchingHelp: {({True: 'yes', False: 'no', None: 'undecided'})[self.helps]}"

    def _facts(self) -> list[tuple[str, str]]:
        names, most = self.modes.names, f"at most {_percent(self.gain)}, from any state"
        most = {0.0: "", 1.0: "no upper bound proven"}.get(self.gain, most)
        told = [
            ("why", self.why),
            ("saves", most),
            ("dominant", "" if self.dominant is None else names[self.dominant]),
            ("paper's test", "names none" if self.paper_test is None else f"names {names[self.paper_test]}"),
        ]
        if self.schedule is not None:
            assert self.saves_at_least is not None and self.saves_at_most is not None
            span = f"{_percent(self.saves_at_least)} to {_percent(self.saves_at_most)}"
            told.append(("from x0", f"saves {span} of the best single mode's cost"))
        if self.status != "done":
            told.append(("status", self.status))
        return [(key, value) for key, value in told if value]


def does_switching_help(
    modes: ModeSet, x0: Gaussian | None = None, *, gap: float = 1e-3, time_limit: float = 10.0
) -> SwitchingHelp:
    """Decide whether any switching sequence costs less than every single mode, from any initial state.

    The paper's first question. With P_p what a mode costs for ever, no sequence helps if and only if for all modes i
    and q some convex combination of the P_p is below ``Q_i + A_i' P_q A_i``; else there is an initial moment from which
    one step of i and then q for ever cost less than every single mode (docs/theory.md, "Whether switching helps"). One
    small semidefinite program a pair finds either; what it returns is checked with bounds of the rounding, and where
    these leave both open, so does the answer.

    Parameters
    ----------
    modes : ModeSet
        The modes, with total costs, without noise, and without `ModeSet.activation`.
    x0 : Gaussian, optional
        An initial state: by how much switching helps from there is asked of `Optimal`, too.
    gap, time_limit : float, optional
        The gap to prove of that, as a fraction of the cost, and seconds, about, for all.

    Returns
    -------
    SwitchingHelp
        Interrupted by Ctrl-C, what is known so far, marked so.

    Raises
    ------
    TypeError
        If modes is no `ModeSet` or x0 no `Gaussian`.
    ValueError
        If the modes have noise, an offset, another cost than the total, or switches that change the state.

    Examples
    --------
    >>> from switchctl.stability import does_switching_help
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> found = does_switching_help(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)))
    >>> found.helps, found.pair
    (True, (0, 1))
    >>> print(round(found.saves_at_least, 3))
    0.274
    >>> does_switching_help(ModeSet([[[0.5]], [[0.9]]]))
    SwitchingHelp: no
    ├── why           A0 is the best mode from every initial state
    ├── dominant      A0
    └── paper's test  names A0
    """
    require_modes(modes)
    require_plain_total(modes, "does_switching_help")
    if modes.activation is not None:
        raise ValueError("does_switching_help is for modes whose switches leave the state as it is (no activation)")
    x0 = None if x0 is None else initial_state(modes, x0)
    method = Optimal(gap=gap, time_limit=time_limit)
    deadline = time.perf_counter() + method.time_limit
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            found = _decided(modes, deadline)
        except np.linalg.LinAlgError as error:
            found = SwitchingHelp(modes, None, f"rounding hides it: {error}")
        found = replace(found, paper_test=_paper_test(modes))
    if x0 is None or found.status == INTERRUPTED:
        return found
    left = max(deadline - time.perf_counter(), 0.1 * method.time_limit)
    try:
        return _from(found, x0, replace(method, time_limit=left))
    except KeyboardInterrupt:
        return replace(found, status=INTERRUPTED)


def _decided(modes: ModeSet, deadline: float) -> SwitchingHelp:
    if len(modes) == 1:
        own = {} if modes.tails[0] is None else {(0, 0): frozen(np.ones(1))}
        return SwitchingHelp(modes, False, "there is one mode", 0.0, own, 0 if own else None)
    if all(P is None for P in modes.tails):
        return _by_word(modes)
    pairs, verdicts, cut = Pairs(modes), dict[tuple[int, int], Verdict](), "time limit"
    try:
        for i, q in tqdm(pairs.different(), desc="pairs of modes", delay=2, leave=False):
            if time.perf_counter() > deadline:
                break
            verdicts[i, q] = pairs.decide(i, q)
    except KeyboardInterrupt:
        cut = INTERRUPTED
    found = _bound(modes, pairs, verdicts, cut)
    return _witness(found, pairs, verdicts) or found


def _bound(modes: ModeSet, pairs: Pairs, verdicts: Mapping[tuple[int, int], Verdict], cut: str) -> SwitchingHelp:
    """What the combinations prove: how much switching may help at most."""
    finite, m = pairs.finite, len(modes)
    weights = {(i, q): verdict.alpha for (i, q), verdict in verdicts.items()}
    weights |= {(p, q): single for q, (p, single) in enumerate(zip(finite, np.eye(len(finite)), strict=True))}
    combinations = {}
    for (i, q), alpha in sorted(weights.items()):
        whole = np.zeros(m)
        whole[finite] = alpha
        combinations[i, finite[q]] = frozen(whole)
    told = SwitchingHelp(modes, None, "", 1.0, combinations)
    if len(verdicts) < len(pairs.different()):
        why = f"{cut} after {len(verdicts)} of {len(pairs.different())} pairs of modes"
        return replace(told, why=why, status=cut)
    vanishes, _ = pairs.window
    if not vanishes:
        return replace(told, why="a run may cost little and not come to rest: the weights don't see every state")
    by_one = [_share(pairs, _dominance(pairs, p)) for p in range(len(finite))]
    dominant = int(np.argmin(by_one))
    by_pairs = _share(pairs, {pair: verdict.violation for pair, verdict in verdicts.items()})
    told = replace(told, gain=min(by_pairs, *by_one))
    if told.gain > OPTIMAL:
        return replace(told, why="what switching may save is within the accuracy of the solver or of rounding")
    if by_one[dominant] > OPTIMAL:
        return replace(told, helps=False, why="no step of another mode helps, whatever the initial state")
    name = modes.names[finite[dominant]]
    why = f"{name} is the best mode from every initial state"
    return replace(told, helps=False, why=why, dominant=finite[dominant])


def _dominance(pairs: Pairs, p: int) -> dict[tuple[int, int], float]:
    """By how much one tail is not below a step of any mode before it."""
    alpha = np.eye(len(pairs.finite))[p]
    others = [i for i in range(len(pairs.A)) if i != pairs.finite[p]]
    return {(i, p): 0.0 if pairs.holds(i, p, alpha) else pairs.violation(i, p, alpha) for i in others}


def _share(pairs: Pairs, violations: Mapping[tuple[int, int], float]) -> float:
    """What switching may save, as a share of the best single mode's cost, given the violations of pairs."""
    if not any(violations.values()):
        return 0.0
    each = np.eye(len(pairs.finite))
    own = [pairs.violation(p, q, each[q]) for q, p in enumerate(pairs.finite)]  # of the tails' own equations
    r, e = max(*violations.values(), *own), pairs.relative_error()
    return 1 - (1 - e) / (1 + r) if np.isfinite(r) and e < 1 else 1.0


def _witness(found: SwitchingHelp, pairs: Pairs, verdicts: Mapping[tuple[int, int], Verdict]) -> SwitchingHelp | None:
    """The pair that saves the greatest share of the best single mode's cost, where one does for certain."""
    modes, saved = found.modes, 0.0
    best: SwitchingHelp | None = None
    for (i, q), verdict in verdicts.items():
        if verdict.moment is None:
            continue
        S = pairs.plain(verdict.moment)
        S = (S + S.T) / (2 * np.trace(S))
        scaled = pairs.scaled(S)
        cost, single, certain = pairs.costs(i, q, scaled)
        share = 1 - cost / float(single.min())
        if not (certain > 0 and share > saved and positive_definite(scaled)):
            continue
        outlasted = _outlasted(modes, pairs.A, pairs.Q, scaled, float(single.min()))
        if outlasted is None:
            continue
        saved, pair = share, (i, pairs.finite[q])
        first, then = (modes.names[mode] for mode in pair)
        best = replace(
            found,
            helps=True,
            why=f"{first} once and then {then} for ever save {_percent(saved)}, from some moment",
            dominant=None,
            pair=pair,
            moment=frozen(S),
            cost=cost,
            best_single=float(single.min()),
            outlasted=outlasted,
        )
    return best


def _outlasted(modes: ModeSet, A: Array, Q: Array, S: Array, cost: float) -> Mapping[int, int] | None:
    """Steps within which each mode without a tail costs more than that; None where one isn't seen to."""
    found = {i: _steps_beyond(A[i], Q[i], S, cost) for i, P in enumerate(modes.tails) if P is None}
    known = {i: steps for i, steps in found.items() if steps is not None}
    return known if len(known) == len(found) else None


def _steps_beyond(A: Array, Q: Array, S: Array, cost: float) -> int | None:
    """A number of steps of a mode that cost more than that for certain, by doubling."""
    try:
        fit = tail(A / (1.01 * float(np.abs(np.linalg.eigvals(A)).max())), np.eye(len(A)))
    except np.linalg.LinAlgError:
        return None
    assert fit is not None
    T: Array = np.linalg.cholesky(fit).T.astype(float)  # states in which powers grow little more than they must
    back: Array = np.linalg.inv(T).astype(float)
    A, Q, S = T @ A @ back, transform(back, Q), T @ S @ T.T
    unit = 4 * (len(A) + 2) * float(np.finfo(float).eps)
    moved, wrong = (2 * unit * float(np.linalg.cond(T) * np.linalg.norm(X, 2)) for X in (A, Q))  # errors of M and G
    G, M, steps = Q, A, 1
    with np.errstate(over="ignore", invalid="ignore"):
        while not np.sum(G * S) - wrong * np.trace(S) > 2 * cost:
            if not (steps < _LONGEST and np.isfinite(G).all() and np.isfinite(M).all() and np.isfinite(wrong)):
                return None
            weight, size = float(np.linalg.norm(G, 2)), float(np.linalg.norm(M, 2))
            square, doubt = size * size, moved * (2 * size + moved)
            wrong += wrong * (square + doubt) + weight * (doubt + unit * (1 + square))
            moved = doubt + unit * square
            G, M, steps = G + transform(M, G), M @ M, 2 * steps
    return steps


def _by_word(modes: ModeSet) -> SwitchingHelp:
    """Where no mode costs finitely much: whether a word of modes is found that does."""
    decisions = Decisions(SwitchingGraph(modes))
    walk = contracting_walk(decisions)
    word = () if walk is None else tuple(decisions.moves(0)[number].word[0] for number in walk[1])
    P = word_tail(modes.A, modes.Q, word) if word else None
    S = np.eye(modes.A.shape[-1])
    cost = None if P is None else float(np.sum(P * S))
    scaled = smat(decisions.scaled(S))
    outlasted = None if cost is None else _outlasted(modes, decisions.A, decisions.Q, scaled, cost)
    if outlasted is None:
        return SwitchingHelp(modes, None, "no mode costs finitely much, and no word of modes that does was found")
    names = " ".join(modes.names[mode] for mode in word)
    why = f"no mode costs finitely much, and {names} repeated for ever does"
    return SwitchingHelp(
        modes, True, why, word=word, moment=frozen(S), cost=cost, best_single=np.inf, outlasted=outlasted
    )


def _paper_test(modes: ModeSet) -> int | None:
    """The mode with the least spectral radius, whose step is also the shortest from every state."""
    a, radii = int(np.argmin(modes.spectral_radii)), modes.spectral_radii
    squares = transform(modes.A, np.broadcast_to(np.eye(modes.A.shape[-1]), modes.A.shape))
    for b in (b for b in range(len(modes)) if b != a):
        if not (radii[a] < radii[b] and positive_definite(squares[b] - squares[a])):
            return None
    return a


def _from(found: SwitchingHelp, x0: Gaussian, method: Optimal) -> SwitchingHelp:
    """By how much switching helps from one initial state."""
    best = float(single_mode_costs(found.modes, x0).min())
    run = schedule(found.modes, x0, method)
    lower = max(run.lower_bound or 0.0, (1 - found.gain) * best if np.isfinite(best) else 0.0)
    if best == 0:
        least = most = 0.0
    elif not np.isfinite(best):
        least, most = float(np.isfinite(run.cost)), 1.0
    else:
        most = max(0.0, 1 - lower / best)
        least = min(max(0.0, 1 - run.cost / best), most)
    status = INTERRUPTED if run.status == INTERRUPTED else found.status
    return replace(found, schedule=run, saves_at_least=least, saves_at_most=most, status=status)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if share > 1e-9 or share == 0 else "less than 1e-7 %"
