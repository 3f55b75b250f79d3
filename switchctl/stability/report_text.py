"""A report in words: the same blocks for a terminal and for a notebook."""

from html import escape
from textwrap import wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from switchctl.rules import Rules
from switchctl.stability.dwell_time import held
from switchctl.tables import html_table, text_table, tree

if TYPE_CHECKING:
    from switchctl.stability.report import Report

_WIDTH = 100
_WORST = 10  # pairs, where there are too many for a matrix
_MARK = {"stable": "", "unstable": "*", "undecided": "?", "not done": ""}


class _Block(NamedTuple):
    """A heading with facts, or with a table where there is a header."""

    heading: str
    header: tuple[str, ...]
    rows: list[tuple[Any, ...]]


def report_text(report: "Report") -> str:
    """The page as text for a terminal of 100 columns."""
    return "\n\n".join([_title(report), *(_as_text(block) for block in _blocks(report))])


def report_html(report: "Report") -> str:
    """The page as small HTML tables under one caption."""
    tables = "".join(html_table(block.header or ("", ""), block.rows, block.heading) for block in _blocks(report))
    return f"<div><p><strong>{escape(_title(report))}</strong></p>{tables}</div>"


def _as_text(block: _Block) -> str:
    if block.header:
        return f"{block.heading}\n{text_table(block.header, block.rows)}"
    width = max(len(key) for key, _ in block.rows)
    last = len(block.rows) - 1
    facts = []
    for number, (key, value) in enumerate(block.rows):
        indent = "\n" + ("│" if number < last else " ") + " " * (width + 5)
        facts.append((key, indent.join(wrap(value, _WIDTH - width - 6) or [""])))
    return tree(block.heading, facts)


def _title(report: "Report") -> str:
    modes = report.modes
    m, n = modes.A.shape[:2]
    period = "no sampling period" if modes.dt is True else f"dt = {modes.dt:g} s"
    return f"Report: {m} mode{'s' * (m > 1)}, {n} state{'s' * (n > 1)}, {period}"


def _blocks(report: "Report") -> list[_Block]:
    blocks = [_modes(report), _switching(report), _pairs(report), _dwell(report), _help(report)]
    if not report.graph.free:
        V, E = len(report.graph), int((report.graph.successor >= 0).sum())
        facts = [("rules", repr(report.graph.rules))] if report.graph.rules != Rules() else []
        blocks.insert(1, _Block("Rules", (), [*facts, ("graph", f"{V} node{'s' * (V > 1)}, {E} edges")]))
    return blocks


def _modes(report: "Report") -> _Block:
    """A row for each mode."""
    modes, missing = report.modes, report.reasons
    rates, growths, costs = report.spectral_radii, report.transient_growth, report.costs
    header, columns = ["mode", "spectral radius", "held for ever"], [list(modes.names)]
    if rates is None:
        columns += [[f"{radius:.6g}" for radius in modes.spectral_radii], ["not known"] * len(modes)]
    else:
        columns += [[f"{rate.upper:.6g}" for rate in rates], [rate.verdict for rate in rates]]
    if growths is not None:
        header += ["max ||A^k||", "at k" if modes.dt is True else "at k (time)"]
        columns += [[str(growth) for growth in growths], [_when(modes.dt, growth.step) for growth in growths]]
    if costs is not None:
        best = int(np.argmin(costs)) if np.isfinite(costs).any() else -1
        header += ["cost for ever", ""]
        columns += [[f"{cost:.6g}" for cost in costs], ["best" * (i == best) for i in range(len(modes))]]
    told = [
        f"{what}: {missing[name]}"
        for name, what in (
            ("spectral_radii", "spectral radii"),
            ("transient_growth", "transient growth"),
            ("costs", "costs"),
        )
        if name in missing and not (name == "costs" and report.x0 is None)
    ]
    return _Block("; ".join(["Modes", *told]), tuple(header), list(zip(*columns, strict=True)))


def _when(dt: float | bool, step: int | None) -> str:
    if step is None:
        return "-"
    return str(step) if dt is True else f"{step} ({step * dt:.4g} s)"


def _switching(report: "Report") -> _Block:
    """Growth under arbitrary switching, or under the rules."""
    found, free = report.joint_spectral_radius, report.graph.free
    heading = "Arbitrary switching" if free else "Switching under the rules"
    if found is None:
        return _Block(heading, (), [("joint spectral radius", report.reasons["joint_spectral_radius"])])
    verdicts = {
        "stable": "stable: every run vanishes",
        "unstable": "not stable: the worst cycle does not vanish",
        "undecided": "undecided: 1 lies between the bounds",
    }
    bounds = f"{found.lower:.8g} to {found.upper:.8g} per step"
    ended = "" if found.status == "tolerance reached" else f" ({found.status})"
    cycle = held(found.cycle, report.modes.names) if found.cycle else "none"
    return _Block(
        heading,
        (),
        [("verdict", verdicts[found.verdict]), ("joint spectral radius", bounds + ended), ("worst cycle found", cycle)],
    )


def _pairs(report: "Report") -> _Block:
    """A matrix, or the worst pairs where that is too wide."""
    found, names = report.pairs, report.modes.names
    heading = "Growth per step of the worst alternation found of two modes"
    if found is None:
        return _Block(heading, (), [("pairs", report.reasons["pairs"])])
    cells = [
        [
            "-" if verdict == "not done" else f"{_entry(value)}{_MARK[verdict] or ' '}"
            for value, verdict in zip(*row, strict=True)
        ]
        for row in zip(found.lower.tolist(), found.verdicts, strict=True)
    ]
    marks = [verdict for row in found.verdicts for verdict in row]
    legend = [
        text for verdict, text in (("unstable", "* not stable"), ("undecided", "? undecided")) if verdict in marks
    ]
    legend += ["- not done"] * ("not done" in marks)
    heading += f" ({', '.join(legend)})" if legend else " (all stable)"
    why = report.reasons.get("pairs", "not done")
    heading += "" if why == "not done" else f": {why}"
    table = _Block(heading, ("", *names), [(name, *row) for name, row in zip(names, cells, strict=True)])
    if max(map(len, text_table(table.header, table.rows).splitlines())) <= _WIDTH:
        return table
    order = sorted(
        ((i, j) for i in range(len(names)) for j in range(i)), key=lambda pair: -np.nan_to_num(found.lower[pair])
    )
    rows = [(f"{names[j]}, {names[i]}", cells[i][j]) for i, j in order[:_WORST]]
    return _Block(heading.replace("two modes", f"two modes, the worst {len(rows)}"), ("pair", "growth"), rows)


def _entry(growth: float) -> str:
    return f"{growth:.4f}" if growth < 1000 else f"{growth:.4g}"


def _dwell(report: "Report") -> _Block:
    """Dwell times, and a stabilising word where there are none."""
    modes, why = report.modes, report.reasons
    facts = []
    if report.dwell_time is not None:
        low, high = report.dwell_time.lower, report.dwell_time.upper
        facts.append(
            ("all modes alike", _long(modes.dt, high) + (f" (perhaps less, at least {low})" if low < high else ""))
        )
    if report.dwell_times is not None:
        each = zip(modes.names, report.dwell_times.dwell, report.dwell_times.least, strict=True)
        told = ", ".join(f"{name} {steps}{'' if least else ' (perhaps less)'}" for name, steps, least in each)
        facts.append(("each its own", f"{told} steps"))
    if report.average_dwell_time is not None:
        average = report.average_dwell_time
        unstable = f"; with {average.lower:.4g} a signal is not stable" if average.word else ""
        enough = _long(modes.dt, average.upper) if average.upper > 1 else "any number of switches"
        facts.append(("on average", enough + unstable))
    reasons: dict[str, list[str]] = {}
    for name, key in (
        ("dwell_time", "all modes alike"),
        ("dwell_times", "each its own"),
        ("average_dwell_time", "on average"),
    ):
        if name in why:
            reasons.setdefault(why[name], []).append(key)
    facts += [("none" if len(keys) == 3 else ", ".join(keys), reason) for reason, keys in reasons.items()]
    if report.stabilising_word is not None:
        word = report.stabilising_word
        names = held(word.word, modes.names)
        facts.append(("stabilising word", f"{names} repeated, rate {word.upper:.6g} a step"))
    elif why["stabilising_word"] != "every mode is stable when held for ever":
        facts.append(("stabilising word", why["stabilising_word"]))
    return _Block("Dwell times with which every signal is stable", (), facts)


def _long(dt: float | bool, steps: float) -> str:
    return f"{steps:.4g} step{'s' * (steps != 1)}" + ("" if dt is True else f" ({steps * dt:.4g} s)")


def _help(report: "Report") -> _Block:
    """Whether switching helps, and by how much."""
    heading = "Whether switching costs less than every single mode"
    heading += "" if report.graph.free else ", without the rules"
    found = report.switching_help
    if found is None:
        return _Block(heading, (), [("not told", report.reasons["switching_help"])])
    facts = [({True: "yes", False: "no", None: "undecided"}[found.helps], found.why)]
    if 0 < found.gain < 1:
        facts.append(("saves at most", f"{100 * found.gain:.3g} %, from any initial state"))
    if found.saves_at_least is not None and found.saves_at_most is not None:
        low, high = (f"{100 * share:.3g}" for share in (found.saves_at_least, found.saves_at_most))
        facts.append(
            ("from x0", f"saves {low if low == high else f'{low} to {high}'} % of the best single mode's cost")
        )
    return _Block(heading, (), facts)
