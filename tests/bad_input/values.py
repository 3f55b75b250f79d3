"""Values that many arguments can't take, with what the refusal must say."""

import math
from decimal import Decimal

import numpy as np
from scipy import sparse

HUGE = 10**400
WRONG_NUMBERS = {
    "None": (None, TypeError),
    "a text": ("3", TypeError),
    "a list": ([3], TypeError),
    "a boolean": (True, TypeError),
    "complex": (3j, TypeError),
    "a decimal": (Decimal(3), TypeError),
    "NaN": (math.nan, ValueError),
    "beyond the range": (HUGE, ValueError),
}
WRONG_ARRAYS = {
    "NaN": (np.full((2, 2), np.nan), ValueError, "[0, 0] is nan"),
    "infinite": (np.full((2, 2), np.inf), ValueError, "[0, 0] is inf"),
    "complex": (np.eye(2) * 1j, TypeError, "complex128"),
    "objects": (np.full((2, 2), None), TypeError, "object entries"),
    "texts": ([["1", "0"], ["0", "1"]], TypeError, "real numbers"),
    "sparse": (sparse.eye(2), TypeError, ".toarray()"),
    "masked": (np.ma.masked_array(np.eye(2), mask=np.eye(2)), TypeError, ".filled"),
    "ragged": ([[1.0, 0.0], [0.0]], ValueError, "not rectangular"),
    "of another shape": (np.eye(3), ValueError, "(3, 3)", "(2, 2)"),
    "asymmetric": ([[1.0, 0.5], [0.0, 1.0]], ValueError, "not symmetric", "[0, 1]"),
    "indefinite": ([[1.0, 2.0], [2.0, 1.0]], ValueError, "least eigenvalue is -1"),
}


class Matrix(np.ndarray):
    """A subclass of one's own."""


SAME_ARRAYS = {  # of the identity, twice
    "integers": lambda: np.eye(2, dtype=int) * 2,
    "float32": lambda: 2 * np.eye(2, dtype=np.float32),
    "lists": lambda: [[2, 0], [0, 2]],
    "in Fortran's order": lambda: np.asfortranarray(2 * np.eye(2)),
    "strided": lambda: np.repeat(2 * np.eye(2), 2, axis=0)[::2],
    "np.matrix": lambda: (2 * np.eye(2)).view(np.matrix),
    "of a subclass": lambda: (2 * np.eye(2)).view(Matrix),
    "asymmetric by rounding": lambda: np.array([[2.0, 0.0], [1e-16, 2.0]]),
}


def wrong_numbers(argument, name=None):
    """Rows of an argument that is a number."""
    name = name or argument
    return [(f"{argument}: {what}", {argument: value}, error, name) for what, (value, error) in WRONG_NUMBERS.items()]


def wrong_arrays(argument, name=None):
    """Rows of an argument that is a positive semidefinite 2 by 2 matrix."""
    name = name or argument
    return [
        (f"{argument}: {what}", {argument: value}, error, name, *words)
        for what, (value, error, *words) in WRONG_ARRAYS.items()
    ]


def whole_numbers(argument, least, name=None):
    """Rows of an argument that is a whole number of at least so much."""
    name = name or argument
    return [
        *wrong_numbers(argument, name),
        (f"{argument}: a fraction", {argument: 2.5}, ValueError, name, "2.5", "whole number"),
        (f"{argument}: infinite", {argument: math.inf}, ValueError, name),
        (f"{argument}: too small", {argument: least - 1}, ValueError, name, f"at least {least}"),
    ]
