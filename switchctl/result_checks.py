"""What a `Schedule` is made of, checked."""

from collections.abc import Mapping
from numbers import Integral
from types import MappingProxyType
from typing import Any

from switchctl.graph import SwitchingGraph
from switchctl.validation import listed, number, shown, whole_number

_KINDS: dict[str, tuple[type | tuple[type, ...], str]] = {
    "method": (str, "a text"),
    "status": (str, "a text"),
    "graph": ((SwitchingGraph, type(None)), "a SwitchingGraph(modes, rules)"),
}


def require_kinds(schedule: Any) -> None:
    """Refuse what is of another kind than it must be."""
    for name, (kind, words) in _KINDS.items():
        if not isinstance(value := getattr(schedule, name), kind):
            raise TypeError(f"{name} must be {words}, not {shown(value)}")


def lengthened_holds(value: Any) -> tuple[tuple[int, int], ...]:
    """The holds that a constraint lengthened: the step of each, and the steps added."""
    pairs = []
    for given in listed(value, "lengthened", "pairs (step, steps added)"):
        pair = [whole_number(entry, "an entry of lengthened", 0) for entry in listed(given, "lengthened", "pairs")]
        if len(pair) != 2:
            raise ValueError(f"lengthened holds {shown(given)}; expected pairs (step, steps added)")
        pairs.append((pair[0], pair[1]))
    return tuple(pairs)


def numbers_by_name(value: Any) -> Mapping[str, float]:
    """What a search reports."""
    if not isinstance(value, Mapping):
        raise TypeError(f"statistics must be a dict of numbers, not {shown(value)}")
    told: dict[str, float] = {}
    for name, entry in value.items():
        if not isinstance(name, str):
            raise TypeError(f"statistics has the name {shown(name)}; expected a text")
        real = number(entry, f"statistics[{name!r}]")
        told[name] = int(entry) if isinstance(entry, Integral) else real
    return MappingProxyType(told)
