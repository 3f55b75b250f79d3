"""What a `ModeSet` is given, checked."""

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np
from control import ControlDimension
from scipy.sparse import issparse

from switchctl.moments import Array
from switchctl.validation import frozen, number, positive_semidefinite, real_array

Cost = Literal["total", "average"] | tuple[Literal["discounted"], float]


def stack(matrices: Any) -> Array:
    """The A_i in one array, shape (m, n, n)."""
    if isinstance(matrices, np.ndarray) or issparse(matrices):
        array = real_array(matrices, "matrices")
    elif not isinstance(matrices, Iterable) or isinstance(matrices, str | Mapping):
        raise TypeError(f"matrices must be the A_i, shape (m, n, n); got a {type(matrices).__name__}")
    else:
        each = [real_array(matrix, f"matrices[{i}]") for i, matrix in enumerate(matrices)]
        for i, matrix in enumerate(each):
            if matrix.ndim != 2:
                raise ControlDimension(
                    f"matrices[{i}] has shape {matrix.shape}; expected an A_i, n by n, in a list with one for each mode"
                )
        shapes = {matrix.shape for matrix in each}
        if len(shapes) > 1:
            raise ControlDimension(f"matrices have shapes {sorted(shapes)}; expected one n by n for all modes")
        array = np.array(each)
    if array.ndim != 3 or array.shape[1] != array.shape[2] or 0 in array.shape:
        raise ControlDimension(f"matrices has shape {array.shape}; expected (m, n, n), m and n at least 1")
    return array


def activation(value: Any, m: int, n: int) -> Array | None:
    """The maps of switches; None where they all do nothing."""
    if value is None:
        return None
    maps = real_array(value, "activation", (m, m, n, n))
    for i in range(m):
        if not np.array_equal(maps[i, i], np.eye(n)):
            raise ValueError(f"activation[{i}, {i}] must be the identity: a mode that goes on is not activated")
    return None if (maps == np.eye(n)).all() else frozen(maps)


def initial(value: Any, n: int, p: int) -> Array:
    """The state at the start as a function of the plant's."""
    initial = real_array(value, "initial", (n, p))
    if not np.array_equal(initial[:p], np.eye(p)):
        raise ValueError(f"initial must begin with the identity, since the first {p} states are the plant's own")
    return initial


def noise(value: Any, shape: tuple[int, ...]) -> Array:
    """The covariance of each mode's noise."""
    W = real_array(value, "W")
    if W.shape not in (shape, shape[1:]):
        raise ControlDimension(f"W has shape {W.shape}; expected {shape[1:]} or {shape}")
    return np.array(np.broadcast_to(positive_semidefinite(W, "W"), shape))


def cost(value: Any) -> Cost:
    """What is added up for ever."""
    if isinstance(value, str) and value in ("total", "average"):
        return value  # type: ignore[return-value]
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str) and value[0] == "discounted":
        factor = number(value[1], "the discount factor")
        if not 0 < factor < 1:
            raise ValueError(f"the discount factor is {factor}; expected a number strictly between 0 and 1")
        return ("discounted", factor)
    raise ValueError(f"cost is {value!r}; expected 'total', 'average' or ('discounted', factor)")


def names(names: Iterable[str] | None, count: int, argument: str, default: str) -> tuple[str, ...]:
    """Distinct names, or default ones with their numbers."""
    if names is None:
        return tuple(default.format(i) for i in range(count))
    names = tuple(names) if isinstance(names, Iterable) and not isinstance(names, str | set | frozenset) else names
    if not isinstance(names, tuple) or not all(isinstance(name, str) and name for name in names):
        raise TypeError(f"{argument} must be a sequence of non-empty strings; got {names!r}")
    if len(names) != count:
        raise ValueError(f"{argument} has {len(names)} entries; expected {count}")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{argument} holds {name!r} more than once; names must be distinct")
    return names
