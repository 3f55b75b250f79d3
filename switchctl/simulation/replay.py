"""A schedule over so many steps: its sequence, its lead, and the word that its tail repeats."""

from dataclasses import replace
from itertools import chain, cycle, islice

from switchctl.result import Schedule
from switchctl.storage import affordable


def lasting(schedule: Schedule, steps: int) -> Schedule:
    """The schedule with at least so many steps listed; the same run for ever."""
    extra = steps - len(schedule)
    if extra <= 0:
        return schedule
    if not schedule.tail:
        raise ValueError(
            f"steps is {steps}, and the schedule ends after {len(schedule)}: it has a terminal weight or a target, and "
            "no tail"
        )
    affordable(200 * steps, f"a schedule of {steps} steps", "ask for fewer steps")
    lead, tail = schedule.lead, schedule.tail
    more = islice(chain(lead, cycle(tail)), extra)
    turn = max(extra - len(lead), 0) % len(tail)
    return replace(schedule, sequence=[*schedule.sequence, *more], lead=lead[extra:], tail=(*tail[turn:], *tail[:turn]))
