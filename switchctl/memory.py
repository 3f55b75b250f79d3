"""What a run must remember of its past to know which modes the rules let it take next."""

import math
from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from switchctl.limits import NODES, USES, Limits, TooManyNodes

_NODES, _USES = f"has more than {NODES:,} nodes", f"remembers more than {USES:,} uses in the budget's window"

Automaton = Mapping[tuple[Hashable, int], Hashable]
"""The place that follows a place in a mode, for each move allowed."""


class State(NamedTuple):
    """What is remembered; what no rule asks for keeps one value."""

    place: Hashable  # in the automaton
    phase: int  # of the times of availability
    last: int  # the mode before, or -1
    age: int  # the steps it has been held, counted as far as it matters
    switches: int
    used: Any  # of the budget: in all, or in the window before the coming step, as pairs (steps ago, use)


class Memory:
    """The first state of a run under limits, and the state that follows a state in a mode.

    Parameters
    ----------
    limits : Limits
        The rules.
    automaton : dict, optional
        Moves written by hand.
    place : hashable
        Where the automaton starts.
    """

    def __init__(self, limits: Limits, automaton: Automaton | None = None, place: Hashable = None) -> None:
        self.limits, self.automaton = limits, automaton
        self.remembers_mode = limits.remembers_mode
        # The age from which on it makes no difference.
        self.cap = [
            low if math.isinf(high) else int(high) for low, high in zip(limits.min_dwell, limits.max_dwell, strict=True)
        ]
        last, age = -1, 0
        used: Any = 0 if limits.window is None else ()
        if limits.start is not None:
            mode, held = limits.start
            if self.remembers_mode:
                last, age = mode, min(held, self.cap[mode])
            if limits.use is not None and limits.window is not None:
                past = range(min(held, limits.window - 1), 0, -1)
                if limits.use[mode] and len(past) > USES:
                    raise TooManyNodes(_USES)
                used = tuple((ago, limits.use[mode]) for ago in past if limits.use[mode])
        self.first = State(place, 0, last, age, 0, used)

    def after(self, state: State, mode: int) -> State | None:
        """The state after a step in a mode, or None where a rule forbids it."""
        limits = self.limits
        place, phase, last, age, switches, used = state
        if self.automaton is not None:
            if (place, mode) not in self.automaton:
                return None
            place = self.automaton[place, mode]
        if limits.available is not None:
            if not limits.available[phase, mode]:
                return None
            phase += 1
            if phase == len(limits.available):
                phase = 0 if limits.periodic else phase - 1
        if self.remembers_mode:
            if mode == last:
                if age >= limits.max_dwell[mode]:
                    return None
                age = min(age + 1, self.cap[mode])
            else:
                if last >= 0:
                    if age < limits.min_dwell[last] or not limits.transitions[last, mode]:
                        return None
                    if limits.max_switches is not None:
                        if switches == limits.max_switches:
                            return None
                        switches += 1
                last, age = mode, 1
        if limits.use is not None:
            use = limits.use[mode]
            if _total(used) + use > limits.limit:
                return None
            if limits.window is None:
                used += use
            else:
                later = [*((ago + 1, past) for ago, past in used), *[(1, use)] * (use > 0)]
                used = tuple(pair for pair in later if pair[0] < limits.window)
        return State(place, phase, last, age, switches, used)

    def label(self, state: State, names: tuple[str, ...]) -> str:
        """Put a state into words."""
        limits = self.limits
        words = [] if self.automaton is None else [str(state.place)]
        if self.remembers_mode:
            words.append("start" if state.last < 0 else names[state.last])
            if state.last >= 0 and self.cap[state.last] > 1:
                capped = state.age == self.cap[state.last] and math.isinf(limits.max_dwell[state.last])
                words[-1] += f" for {state.age}" + "+" * capped
        if limits.max_switches is not None:
            words.append(f"{limits.max_switches - state.switches} left")
        if limits.use is not None:
            words.append(f"used {float(_total(state.used) * limits.unit):g}")
            if limits.window is not None and state.used:
                ago = [str(steps) for steps, _ in state.used]
                words[-1] += f" {'/'.join(ago[:4])}{'/..' * (len(ago) > 4)} ago"
        if limits.available is not None:
            words.append(f"k={state.phase}" + "+" * (not limits.periodic and state.phase == len(limits.available) - 1))
        return ", ".join(words) or "any"


def _total(used: Any) -> int:
    return used if isinstance(used, int) else sum(use for _, use in used)


def explore(memory: Memory) -> tuple[NDArray[np.intp], list[State]]:
    """The place of each state's successor by mode (-1: not allowed), and the states that can be reached."""
    m = len(memory.limits.min_dwell)
    states, place = [memory.first], {memory.first: 0}
    rows: list[list[int]] = []
    windowed = memory.limits.window is not None
    uses = len(memory.first.used) if windowed else 0
    while len(rows) < len(states):
        row = []
        for mode in range(m):
            head = memory.after(states[len(rows)], mode)
            if head is not None and head not in place:
                uses += len(head.used) if windowed else 0
                if len(states) == NODES or uses > USES:
                    raise TooManyNodes(_NODES if uses <= USES else _USES)
                place[head] = len(states)
                states.append(head)
            row.append(-1 if head is None else place[head])
        rows.append(row)
    return np.array(rows, dtype=np.intp), states


def longest_runs(successor: NDArray[np.intp]) -> NDArray[np.float64]:
    """The number of steps of the longest run from each node; infinite where a run never has to end."""
    V = len(successor)
    steps = np.full(V, np.inf)
    heads = successor[successor >= 0]
    tails = np.nonzero(successor >= 0)[0]
    order = np.argsort(heads, kind="stable")
    tails = tails[order]
    first = np.searchsorted(heads[order], np.arange(V + 1))
    ways = (successor >= 0).sum(axis=1)
    ended = [int(v) for v in np.flatnonzero(ways == 0)]
    steps[ended] = 0
    for v in ended:  # grows as nodes are found from which every way ends; the last way to end is the longest
        for u in tails[first[v] : first[v + 1]]:
            ways[u] -= 1
            if ways[u] == 0:
                steps[u] = steps[v] + 1
                ended.append(int(u))
    return steps
