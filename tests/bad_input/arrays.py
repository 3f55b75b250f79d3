"""The faults that any argument that is an array can have, and the forms in which it is taken."""

import numpy as np
from control import ControlDimension
from scipy import sparse


class Subclass(np.ndarray):
    """An array of a class of one's own."""


def faults(argument, right, shown=None, *, any_shape=False):
    """Rows for one argument: each (what, changed arguments, error, words..).

    Parameters
    ----------
    argument : str
        Its name.
    right : array_like
        A value that is taken.
    shown : str, optional
        What messages call it, where that is not its name.
    any_shape : bool, optional
        Whether more of everything is taken too.
    """
    right, shown = np.asarray(right, dtype=float), shown or argument
    last = tuple(size - 1 for size in right.shape)
    at = f"[{', '.join(map(str, last))}]"

    def with_entry(entry):
        wrong = right.copy()
        wrong[last] = entry
        return wrong

    masked = np.ma.array(right, mask=with_entry(1.0) == 1.0)
    longer = np.zeros((*right.shape[:-1], right.shape[-1] + 1))
    return [
        (f"NaN in {argument}", {argument: with_entry(np.nan)}, ValueError, f"{shown}{at} is nan", "finite"),
        (f"infinity in {argument}", {argument: with_entry(-np.inf)}, ValueError, f"{shown}{at} is -inf"),
        (f"complex {argument}", {argument: right + 1j}, TypeError, f"{shown} must hold real numbers", "complex128"),
        (f"objects in {argument}", {argument: right.astype(object)}, TypeError, shown, "not object entries"),
        (f"text in {argument}", {argument: right.astype(str)}, TypeError, f"{shown} must hold real numbers", "str"),
        (f"a word as {argument}", {argument: "nine"}, TypeError, shown, "str"),
        (f"an object as {argument}", {argument: object()}, TypeError, shown, "object"),
        (f"masked {argument}", {argument: masked}, TypeError, f"{shown} is a masked array", ".filled(value)"),
        *(
            [(f"shape of {argument}", {argument: longer}, ControlDimension, shown, str(longer.shape), "expected")]
            if not any_shape
            else []
        ),
        *(
            [
                (
                    f"sparse {argument}",
                    {argument: sparse.csr_matrix(right)},
                    TypeError,
                    f"{shown} is a sparse",
                    ".toarray()",
                )
            ]
            if right.ndim == 2
            else []
        ),
        *(
            [(f"ragged {argument}", {argument: [[1.0, 2.0], [3.0]]}, ValueError, f"{shown} is not rectangular")]
            if right.ndim < 3
            else []
        ),
    ]


def symmetric_faults(argument, right, shown=None):
    """Faults of an array that must be symmetric and positive semidefinite as well."""
    shown, n = shown or argument, len(right)
    asymmetric, indefinite = np.array(right, dtype=float), np.array(right, dtype=float)
    asymmetric[0, -1] += 1e-3
    indefinite[0, -1] = indefinite[-1, 0] = 2 * np.abs(indefinite).max()
    rows = [
        (
            f"indefinite {argument}",
            {argument: indefinite},
            ValueError,
            f"{shown} is not positive",
            "least eigenvalue is -",
        ),
        (f"asymmetric {argument}", {argument: asymmetric}, ValueError, f"{shown} is not symmetric", "differ by 0.001"),
    ]
    return [*faults(argument, right, shown), *(rows if n > 1 else [])]


def forms(argument, right):
    """The same array in other forms: rows (what, changed arguments). For whole numbers."""
    right = np.array(right, dtype=float)
    spread = np.zeros(tuple(2 * size for size in right.shape))
    spread[tuple(slice(None, None, 2) for _ in right.shape)] = right
    fixed = right.copy()
    fixed.flags.writeable = False
    return [
        (f"{argument} of float32", {argument: right.astype(np.float32)}),
        (f"{argument} of integers", {argument: right.astype(np.int16)}),
        (f"{argument} of the other byte order", {argument: right.astype(">f8")}),
        (f"strided {argument}", {argument: spread[tuple(slice(None, None, 2) for _ in right.shape)]}),
        (f"Fortran-ordered {argument}", {argument: np.asfortranarray(right)}),
        (f"read-only {argument}", {argument: fixed}),
        (f"{argument} of a subclass", {argument: right.view(Subclass)}),
        (f"{argument} as lists", {argument: right.tolist()}),
        *([(f"{argument} as np.matrix", {argument: right.view(np.matrix)})] if right.ndim == 2 else []),
    ]
