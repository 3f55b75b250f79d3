"""Rows of the bad-input table, and what they are made of."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import control
import numpy as np
from scipy.sparse import issparse

from switchctl import Gaussian, ModeSet


@dataclass(frozen=True)
class Refused:
    """An input that `name` refuses, by an error that holds all of the `words`."""

    name: str
    what: str
    call: Callable[..., Any]
    arguments: Callable[[], dict[str, Any]]
    error: type[Exception]
    words: tuple[str, ...]


@dataclass(frozen=True)
class Same:
    """An input that `name` takes, with just the answer (as `call` returns it) that the `plain` input has."""

    name: str
    what: str
    call: Callable[..., Any]
    arguments: Callable[[], dict[str, Any]]
    plain: Callable[[], dict[str, Any]]


def refused(name, call, good, *rows):
    """Rows of one callable: each (what, changed arguments, error, words..) beside the good arguments.

    Values that are functions without a name of their own (lambdas of no argument) are called to make the argument.
    """
    return [
        Refused(name, what, call, lambda change=change: {**good(), **made(change)}, error, words)
        for what, change, error, *words in rows
    ]


def same(name, call, good, *rows):
    """Rows of one callable: each (what, changed arguments), with the answer that the good arguments have."""
    return [Same(name, what, call, lambda change=change: {**good(), **made(change)}, good) for what, change in rows]


def made(change: Mapping[str, Any]) -> dict[str, Any]:
    """The changed arguments."""
    return {key: value() if getattr(value, "__name__", "") == "<lambda>" else value for key, value in change.items()}


def state_of(thing: Any, known: dict[int, int] | None = None) -> Any:
    """All that can be seen of an object, to be compared with what can be seen of it later."""
    known = {} if known is None else known
    if isinstance(thing, np.ndarray):
        if thing.dtype == object:
            return "objects", thing.shape, [state_of(entry, known) for entry in thing.ravel()]
        return type(thing).__name__, thing.dtype.str, thing.shape, thing.strides, thing.flags.writeable, thing.tobytes()
    if issparse(thing):
        return "sparse", thing.shape, thing.toarray().tobytes()
    if thing is None or isinstance(thing, bool | int | float | complex | str | bytes | np.generic):
        return repr(thing)
    if id(thing) in known:
        return "seen", known[id(thing)]
    known[id(thing)] = len(known)
    if isinstance(thing, Mapping):
        return [(repr(key), state_of(value, known)) for key, value in thing.items()]
    if isinstance(thing, list | tuple):
        return type(thing).__name__, [state_of(entry, known) for entry in thing]
    if isinstance(thing, control.InputOutputSystem | ModeSet | Gaussian) or hasattr(thing, "__dict__"):
        return type(thing).__name__, {key: state_of(value, known) for key, value in vars(thing).items()}
    return repr(type(thing))


def unchanged(before: Any, after: Any) -> bool:
    """Whether an object is as it was; what it has come to remember beside that (a cached answer) is no change."""
    if isinstance(before, dict) and isinstance(after, dict):
        return all(key in after and unchanged(value, after[key]) for key, value in before.items())
    if isinstance(before, list | tuple) and isinstance(after, list | tuple):
        return len(before) == len(after) and all(map(unchanged, before, after))
    return before == after


def plant() -> control.StateSpace:
    """A double integrator whose states are measured."""
    return control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0, states=["position", "speed"])
