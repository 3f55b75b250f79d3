"""Modes, rules, graphs and schedules as the plain values of a JSON document, and back."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph
from switchctl.modes import ModeSet
from switchctl.rules import Budget, Rules

if TYPE_CHECKING:
    from switchctl.result import Schedule

VERSION = 5
"""Of schedule files."""
_NEEDED = "cost edges lead lengthened lower_bound method rules sequence statistics status tail target terminal"


def plain_system(graph: SwitchingGraph, x0: Gaussian) -> dict[str, Any]:
    """The modes, the initial state and the rules."""
    modes = graph.modes
    return {
        "dt": modes.dt,
        "names": modes.names,
        "states": modes.states,
        "mean": x0.mean.tolist(),
        "cov": x0.cov.tolist(),
        "A": modes.A.tolist(),
        "Q": modes.Q.tolist(),
        "gains": None if modes.gains is None else modes.gains.tolist(),
        "plant_states": modes.plant_states,
        "activation": None if modes.activation is None else modes.activation.tolist(),
        "initial": modes.initial.tolist(),
        "estimate_states": modes.estimate_states,
        "W": modes.W.tolist() if modes.noisy else None,
        "offset": modes.offset.tolist() if modes.offset.any() else None,
        "criterion": modes.cost,
        "rules": _plain_record(graph.rules),
        "edges": graph.automaton_edges,
    }


def read_system(document: Mapping[str, Any]) -> tuple[SwitchingGraph, Gaussian]:
    """Undo `plain_system`."""
    modes = ModeSet(
        document["A"],
        read_list(document["names"]),
        document["dt"],
        Q=document["Q"],
        gains=document["gains"],
        states=read_list(document["states"]),
        plant_states=document["plant_states"],
        activation=document["activation"],
        initial=document["initial"],
        estimate_states=document["estimate_states"],
        W=document["W"],
        offset=document["offset"],
        cost=tuple(cost) if isinstance(cost := document["criterion"], list) else cost,
    )
    told = _read(document["rules"])
    if not isinstance(told, dict):
        raise TypeError(f"{told!r} stands where rules should")
    if told.get("budget") is not None:
        told["budget"] = Budget(**told["budget"])
    rules, edges = Rules(**told), document["edges"]
    if edges is None:
        graph = SwitchingGraph(modes, rules)
    else:
        graph = SwitchingGraph.from_edges(modes, [tuple(edge) for edge in read_list(edges)], rules)
    return graph, Gaussian(document["mean"], document["cov"])


def plain_schedule(schedule: "Schedule") -> dict[str, Any]:
    """A schedule with its modes, rules and initial state."""
    try:
        cost = schedule.cost if math.isfinite(schedule.cost) else None
    except (ArithmeticError, ValueError):  # it has none, or none that can be told
        cost = None
    target = schedule.target
    return {
        "method": schedule.method,
        "status": schedule.status,
        "cost": cost,
        **plain_system(schedule.graph, schedule.x0),
        "tail": schedule.tail,
        "lead": schedule.lead,
        "lengthened": schedule.lengthened,
        "statistics": dict(schedule.statistics),
        "lower_bound": schedule.lower_bound,
        "terminal": None if schedule.terminal is None else schedule.terminal.tolist(),
        "target": None if target is None else [target.mean.tolist(), target.cov.tolist()],
        "sequence": schedule.sequence.tolist(),
    }


def read_schedule(document: Mapping[str, Any]) -> tuple[Any, ...]:
    """What makes a `Schedule`, in its order."""
    lacking = set(_NEEDED.split()) - document.keys()
    if lacking:
        raise ValueError(f"it lacks {min(lacking)!r}")
    graph, x0 = read_system(document)
    return (
        graph.modes,
        x0,
        read_list(document["sequence"]),
        tuple(read_list(document["tail"])),
        read_text(document["method"]),
        read_text(document["status"]),
        document["lengthened"],
        tuple(read_list(document["lead"])),
        graph,
        document["statistics"],
        document["lower_bound"],
        document["terminal"],
        None if document["target"] is None else Gaussian(*read_list(document["target"])),
    )


def read_list(value: Any) -> list[Any]:
    """Check a list."""
    if not isinstance(value, list):
        raise TypeError(f"{value!r} stands where a list should")
    return value


def read_text(value: Any) -> str:
    """Check a text."""
    if not isinstance(value, str):
        raise TypeError(f"{value!r} stands where a text should")
    return value


def _plain_record(record: Rules | Budget) -> dict[str, Any]:
    changed = {field.name: getattr(record, field.name) for field in fields(record)}
    return {field.name: _plain(changed[field.name]) for field in fields(record) if changed[field.name] != field.default}


def _plain(value: Any) -> Any:
    """JSON knows no infinity and no keys but strings: the one becomes {"infinite": true}, a dict a list of pairs."""
    if isinstance(value, Budget):
        return _plain_record(value)
    if isinstance(value, Mapping):
        return {"by mode": [[mode, _plain(entry)] for mode, entry in value.items()]}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return {"infinite": True} if isinstance(value, float) and math.isinf(value) else value


def _read(value: Any) -> Any:
    if isinstance(value, list):
        return [_read(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    if "infinite" in value:
        return math.inf
    if "by mode" in value:
        return {mode: _read(entry) for mode, entry in value["by mode"]}
    return {name: _read(entry) for name, entry in value.items()}
