"""A schedule in words."""

from collections.abc import Callable
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from switchctl.rules import Rules

if TYPE_CHECKING:
    from switchctl.result import Schedule


def heading(schedule: "Schedule") -> str:
    """How long it is."""
    steps, modes = len(schedule), schedule.modes
    duration = "" if modes.dt is True else f" ({steps * modes.dk:g} s)"
    return f"Schedule: {steps} step{'s' * (steps > 1)}{duration}"


def facts(schedule: "Schedule") -> list[tuple[str, str]]:
    """What is to be told of it; nothing that can't be computed hides the rest."""
    names, rules, switches = schedule.modes.names, schedule.graph.rules, schedule.switches
    first = [f"{names[s.before]} -> {names[s.after]} at step {s.step}" for s in switches[:3]]
    more = f", .. {len(switches) - 3} more" if len(switches) > 3 else ""
    share = np.bincount(schedule.sequence, minlength=len(names)) / len(schedule)
    told = [
        ("method", schedule.method),
        ("rules", "" if rules == Rules() else repr(rules)),
        ("automaton", "" if schedule.graph.automaton_edges is None else f"{len(schedule.graph)} nodes"),
        ("cost", _told(lambda: f"{schedule.cost:.6g}  (with {_after(schedule)})")),
        ("of which", _told(lambda: _parts(schedule))),
        ("proven", _told(lambda: _proven(schedule))),
        (
            "W2",
            _told(lambda: f"{schedule.w2[0]:.6g} -> {schedule.final_w2:.6g}"),
        ),
        ("switches", f"{len(switches)}" + (f" ({', '.join(first)}{more})" if switches else "")),
        ("use", ", ".join(f"{name} {100 * s:.1f} %" for name, s in zip(names, share, strict=True) if s)),
        ("budget", _budget(schedule)),
        ("ends", schedule.status),
        ("search", _search(schedule)),
        ("lengthened", _lengthened(schedule)),
    ]
    return [(key, value) for key, value in told if value]


def _proven(schedule: "Schedule") -> str:
    if schedule.lower_bound is None:
        return ""
    return f"no sequence costs less than {schedule.lower_bound:.8g} (gap {schedule.gap:.2g})"


def _after(schedule: "Schedule") -> str:
    if schedule.target is not None:
        return "the distance to the target after the last step"
    if schedule.terminal is not None:
        return "the weight of the state after the last step"
    names, word = schedule.modes.names, schedule.tail
    lead = f"{_runs(schedule.lead, names)}, then " if schedule.lead else ""
    if len(word) == 1:
        return f"{lead}{names[word[0]]} held after the last step"
    repeated = _runs(word, names) if len(word) > 6 else " ".join(names[mode] for mode in word)
    return f"{lead}{repeated} repeated after the last step"


def _runs(sequence: tuple[int, ...], names: tuple[str, ...]) -> str:
    runs = [f"{names[mode]} for {len(list(run))}" for mode, run in groupby(sequence)]
    return ", ".join(runs[:3]) + ", .." * (len(runs) > 3)


def _parts(schedule: "Schedule") -> str:
    parts = schedule.cost_parts
    told = [f"state {parts.state:.6g}", f"switches {parts.switching:.6g}", f"running price {parts.running:.6g}"]
    return ", ".join(told) if parts.switching or parts.running else ""


def _budget(schedule: "Schedule") -> str:
    use, budget, window = schedule.resource_use, schedule.graph.rules.budget, schedule.graph.window
    if use is None or budget is None:
        return ""
    if window is None:
        return f"{use.sum():g} of {budget.limit:g} used"
    greatest = np.convolve(use, np.ones(min(window, len(use)))).max()
    return f"at most {greatest:g} of {budget.limit:g} used in any {window} steps"


def _search(schedule: "Schedule") -> str:
    counts = {name: value for name, value in schedule.statistics.items() if "seconds" not in name}
    return ", ".join(f"{name} {value if isinstance(value, int) else f'{value:.6g}'}" for name, value in counts.items())


def _lengthened(schedule: "Schedule") -> str:
    count = len(schedule.lengthened)
    if not count:
        return ""
    steps = ", ".join(str(k) for k, _ in schedule.lengthened[:5]) + ", .." * (count > 5)
    return f"{count} hold{'s' * (count > 1)}, for stability, at step {steps}"


def _told(value: Callable[[], str]) -> str:
    """A value for a person to read, or why there is none."""
    try:
        return value()
    except (ArithmeticError, ValueError) as error:
        return f"not available: {error}"
