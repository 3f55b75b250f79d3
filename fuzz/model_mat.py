"""Model files of MATLAB: what is done with the variables once scipy has read them, of whatever types they are.

python fuzz/model_mat.py -max_total_time=600
"""

import json
import random
from typing import Any

import numpy as np
import scipy.io
from checked_model import seeds, try_model
from mutations import run
from scipy.sparse import csc_array

from switchctl import mat_reader
from switchctl.load_model import _from_matrices

KINDS = ("as it is", "cells", "stacked", "int8", "uint8", "float32", "complex128", "sparse", "struct", "text", "empty")


def sealed(text: str) -> str:
    """Models have no digest."""
    return text


def cells(values: list[Any], rng: random.Random) -> Any:
    """A cell array, as scipy reads one."""
    array = np.empty((1, len(values)), dtype=object)
    for i, value in enumerate(values):
        array[0, i] = matlab(value, rng)
    return array


def matlab(value: Any, rng: random.Random) -> Any:
    """A value as scipy might read it: an array of at least two axes."""
    kind = rng.choice(KINDS) if rng.random() < 0.1 else "as it is"
    if isinstance(value, list) and (kind == "cells" or any(isinstance(entry, str | dict) for entry in value)):
        return cells(value, rng)
    if isinstance(value, str | dict | bool) or value is None:
        return np.atleast_1d(np.array(value if isinstance(value, str) else bool(value), dtype=None))
    try:
        array = np.atleast_2d(np.array(value, dtype=float))
    except (ValueError, TypeError, OverflowError):
        return cells(value, rng) if isinstance(value, list) else np.array([[0.0]])
    if array.ndim > 2 and kind != "stacked":
        array = np.moveaxis(array, 0, -1)
    if kind in ("int8", "uint8", "float32", "complex128"):
        with np.errstate(all="ignore"):
            return np.nan_to_num(array).clip(-100, 100).astype(kind)
    if kind == "sparse" and array.ndim == 2:
        return csc_array(array)
    if kind == "struct":
        return np.array([[(array,)]], dtype=[("field", object)])
    return {"text": np.array([str(value)[:20]]), "empty": np.empty((0, 0))}.get(kind, array)


def try_input(data: bytes) -> None:
    """Make variables of a JSON object, and read them."""
    try:
        tree = json.loads(data)
        rng = random.Random(data)
        told = {str(name): matlab(value, rng) for name, value in tree.items()}
    except (ValueError, AttributeError, RecursionError):
        return
    scipy.io.loadmat = lambda path: {"__header__": b"", **told}
    try:
        text = json.dumps(mat_reader.variables("model.mat"))
    except Exception:  # of any kind: `load_model` tells it as a FormatError
        return
    try_model(lambda: _from_matrices(json.loads(text), "model.mat"))


if __name__ == "__main__":
    run(seeds(), sealed, try_input)
