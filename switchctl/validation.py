"""The boundary: what users hand in becomes float64 arrays, once, or an error that says what to do."""

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import islice
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np
from control import ControlDimension
from scipy.sparse import issparse

from switchctl.moments import Array

Frozen = TypeVar("Frozen", bound=np.ndarray)

GREATEST = 2**53
"""Whole numbers up to this one are told apart in floating point; a greater one is refused."""

SETTINGS = 1000
"""The most settings that are tried in one call."""

_TINY = 2.0**-1000


def real_array(value: Any, name: str, shape: Sequence[int | None] | None = None) -> Array:
    """Copy ``value`` into a finite float64 array of the given shape (None: any length along that axis)."""
    array = float_array(value, name)
    if shape is not None and not (
        array.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        wanted = ", ".join("any" if want is None else str(want) for want in shape)
        raise ControlDimension(f"{name} has shape {array.shape}; expected ({wanted}{',' * (len(shape) == 1)})")
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ValueError(f"{where} is {array[index]}; every entry must be finite")
    return array


def float_array(value: Any, name: str) -> Array:
    """Copy ``value`` into a float64 array, whatever its shape, finite or not."""
    if issparse(value):
        raise TypeError(f"{name} is a sparse matrix; convert it with .toarray()")
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array; fill its masked entries with .filled(value)")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} is not rectangular: {error}") from None
    if array.dtype.kind not in "biuf":
        kind = (
            f"a {type(value).__name__}"
            if array.shape == () and array.dtype == object
            else f"{array.dtype.name} entries"
        )
        raise TypeError(f"{name} must hold real numbers, not {kind}")
    with np.errstate(over="ignore"):
        return np.array(array, dtype=float, order="C", subok=False)


def symmetric(array: Array, name: str) -> Array:
    """Refuse matrices that are not symmetric; symmetrise rounding."""
    if (array == np.swapaxes(array, -1, -2)).all():
        return array
    half = array / 2
    gap = np.abs(half - np.swapaxes(half, -1, -2))  # half of the difference, which is never beyond the range
    if (gap > 0.5e-10 * _greatest_linked(array)[..., None] + _lost(array)).any():
        index = tuple(int(i) for i in np.unravel_index(gap.argmax(), gap.shape))
        where, (i, j) = _member(name, index[:-2]), index[-2:]
        raise ValueError(
            f"{where} is not symmetric: entries [{i}, {j}] and [{j}, {i}] differ by {2 * float(gap.max()):.3g}; "
            f"pass ({where} + {where}.T) / 2 if that is what you mean"
        )
    return half + np.swapaxes(half, -1, -2)


def positive_semidefinite(array: Array, name: str) -> Array:
    """Refuse symmetric matrices with an eigenvalue below zero (beyond rounding).

    States that no entry links are judged apart, so that great ones don't hide small ones.
    """
    array = symmetric(array, name)
    greatest = _greatest_linked(array)
    scale = np.where(greatest > 0, np.maximum(greatest, _TINY), 1.0)
    eigenvalues, vectors = np.linalg.eigh(array / scale[..., None])
    least = eigenvalues[..., 0]
    if (least >= 0).all():
        return array
    weight = vectors[..., 0] ** 2
    share = np.sum(weight * np.where(greatest > 0, np.minimum(greatest, _TINY) / _TINY, 1.0), axis=-1)
    if (least < -1e-12 * share * np.abs(eigenvalues).max(axis=-1, initial=1.0) - _lost(array) / _TINY).any():
        index = np.unravel_index(least.argmin(), least.shape)
        worst = float(least[index] * scale[index][weight[index].argmax()])
        where = _member(name, tuple(int(i) for i in index))
        raise ValueError(f"{where} is not positive semidefinite: its least eigenvalue is {worst:.6g}; it must be >= 0")
    return array


def _lost(array: Array) -> float:
    """What sums of so many products lose to the spacing of the least numbers, whatever their size."""
    return 32.0 * array.shape[-1] * float(np.finfo(float).smallest_subnormal)


def _member(name: str, index: tuple[int, ...]) -> str:
    """One matrix of a batch."""
    return f"{name}[{', '.join(map(str, index))}]" if index else name


def _greatest_linked(array: Array) -> Array:
    """The greatest entry among the states that a state is linked with by entries other than zero, for each state."""
    size = np.abs(array)
    size = np.maximum(size, np.swapaxes(size, -1, -2))
    greatest = size.max(axis=-1, initial=0.0)
    while True:
        further = np.maximum(greatest, np.where(size > 0, greatest[..., None, :], 0.0).max(axis=-1, initial=0.0))
        if (further == greatest).all():
            return greatest
        greatest = further


def matrix_or_number(value: Any, name: str, n: int) -> Array:
    """An array of any shape; a number will do for one by one."""
    array = real_array(value, name)
    return array.reshape(1, 1) if array.ndim == 0 and n == 1 else array


def semidefinite(value: Any, name: str, n: int) -> Array:
    """Check a symmetric positive semidefinite matrix, n by n; a number will do for one by one."""
    return positive_semidefinite(real_array(matrix_or_number(value, name, n), name, (n, n)), name)


def frozen(array: Frozen) -> Frozen:
    """Make an array read-only."""
    array.flags.writeable = False
    return array


def shown(value: Any) -> str:
    """What came, for a message: as it is written where that is short, or else its type."""
    if isinstance(value, int) and abs(value) > GREATEST:
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 80 and "\n" not in text else f"a {type(value).__name__}"


def whole_number(value: Any, name: str, least: int = 1) -> int:
    """Check an integer of at least ``least``."""
    value = _real(value, name, "a whole number")
    if not isinstance(value, Integral) and not (abs(value) < math.inf and value % 1 == 0):
        raise ValueError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise ValueError(f"{name} is {shown(value)}; expected at least {least}")
    if value > GREATEST:
        raise ValueError(f"{name} exceeds {GREATEST}, the greatest whole number that may be asked for")
    return int(value)


def number(value: Any, name: str) -> float:
    """Check a real number that is not NaN."""
    try:
        real = float(_real(value, name, "a number"))
    except OverflowError:
        raise ValueError(f"{name} exceeds the floating-point range") from None
    if math.isnan(real):
        raise ValueError(f"{name} is nan; expected a number")
    return real


def _real(value: Any, name: str, what: str) -> Any:
    """Check a real number, which may come as an array without axes."""
    value = value[()] if type(value) is np.ndarray and value.ndim == 0 else value
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise TypeError(f"{name} must be {what}, not {shown(value)}")
    return value


def listed(value: Any, name: str, what: str, most: int = 10**7) -> list[Any]:
    """The entries of a sequence, or of anything else that has an order and an end."""
    unordered = isinstance(value, str | bytes | Mapping | Set) or issparse(value) or not isinstance(value, Iterable)
    if unordered or (isinstance(value, np.ndarray) and value.ndim == 0):
        raise TypeError(f"{name} must be a sequence of {what}, not {shown(value)}")
    entries = list(islice(value, most + 1))
    if len(entries) > most:
        raise ValueError(f"{name} has more than {most:,} entries, the most there may be")
    return entries


def flag(value: Any, name: str) -> bool:
    """Check a choice between True and False."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def seconds(value: Any, name: str) -> float:
    """Check a time limit."""
    limit = number(value, name)
    if not limit > 0:
        raise ValueError(f"{name} is {value!r}; expected seconds above 0")
    return limit


def sampling_period(dt: Any, name: str = "dt") -> float | bool:
    """Check a discrete timebase: a period in seconds, or True for steps without one."""
    if dt is True or (isinstance(dt, np.bool_) and dt):
        return True
    if dt is None or isinstance(dt, (bool, np.bool_)):
        raise ValueError(f"{name} is {dt!r}; expected a sampling period in seconds, or True for none")
    period = number(dt, name)
    if not (math.isfinite(period) and period > 0):
        raise ValueError(f"{name} is {dt!r}; expected a positive, finite sampling period in seconds, or True")
    return period
