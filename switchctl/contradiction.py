"""Why rules leave no way on: the fewest that together do."""

from collections.abc import Hashable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from switchctl.limits import TooManyNodes, limits
from switchctl.memory import Automaton, Memory, explore, longest_runs
from switchctl.modes import ModeSet
from switchctl.rules import Rules

_DETAILS = ("time_unit", "allowed_period")  # of other rules


def contradiction(modes: ModeSet, rules: Rules, automaton: Automaton | None, place: Hashable) -> str:
    """Name the rules that contradict each other, when no run can obey all.

    Rules are dropped one by one where the rest still leaves no way on, so that those that stay are all needed.
    """
    free: dict[str, Any] = {field.name: field.default for field in fields(Rules) if field.name not in _DETAILS}
    longest = _longest(modes, rules, automaton, place)  # under all of them
    for name in free:
        if getattr(rules, name) == free[name]:
            continue
        fewer: dict[str, Any] = {name: free[name]} | ({"allowed_period": None} if name == "allowed" else {})
        if np.isfinite(_longest(modes, replace(rules, **fewer), automaton, place)):
            rules = replace(rules, **fewer)
    if automaton is not None and np.isfinite(_longest(modes, rules, None, None)):
        automaton = None
    told = [f"{name} = {rules.told(name)}" for name in free if getattr(rules, name) != free[name]]
    told += ["the edges"] * (automaton is not None)
    verdict = "contradict each other" if len(told) > 1 else "can't be met"
    end = f"ends after at most {longest:.0f} step{'s' * (longest != 1)}" if longest else "ends before its first step"
    return f"{' and '.join(told)} {verdict}: every run {end}"


def _longest(modes: ModeSet, rules: Rules, automaton: Automaton | None, place: Hashable) -> float:
    """Steps of the longest run; infinite where there is an end to none, or where that can't be told."""
    try:
        return float(longest_runs(explore(Memory(limits(modes, rules), automaton, place))[0])[0])
    except TooManyNodes:
        return np.inf
