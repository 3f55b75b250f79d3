"""Models for the command line: bundled, in a Python file, or as matrices in a .json or .mat file."""

import importlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from switchctl.closed_loop import close_loops
from switchctl.files import FormatError, read_json
from switchctl.gaussian import Gaussian
from switchctl.methods import Method, Rollout
from switchctl.modes import ModeSet


@dataclass(frozen=True)
class Model:
    """Modes, an initial state where there is one, and the method that shows them best."""

    modes: ModeSet
    initial_state: Gaussian | None
    method: Method


def bundled() -> dict[str, str]:
    """Return the names of the bundled models, with their first line of documentation."""
    names = importlib.import_module("switchctl.models").NAMES
    return {name: (importlib.import_module(f"switchctl.models.{name}").__doc__ or "").split("\n")[0] for name in names}


def load_model(name: str) -> Model:
    """Load a bundled model by name, or one from a .py, .json or .mat file.

    Parameters
    ----------
    name : str
        A bundled model or a path. A Python file offers what the bundled models do: ``initial_state()``, and ``modes()``
        or ``plant()`` and ``controllers()``; ``method()`` if it likes. A .json file holds an object with ``A`` and, if
        it likes, ``names``, ``dt``, ``Q``, ``mean`` and ``cov``; a .mat file the same variables, with A of shape
        n x n x m or a cell array of the A_i.

    Returns
    -------
    Model

    Raises
    ------
    FormatError
        If a file is not what its name says.
    ValueError, TypeError
        If what it holds can't be scheduled.
    FileNotFoundError
        If there is neither a bundled model nor a file of that name.
    """
    path = Path(name)
    if name in importlib.import_module("switchctl.models").NAMES:
        return _from_module(importlib.import_module(f"switchctl.models.{name}"), name)
    if not path.is_file():
        raise FileNotFoundError(f"no bundled model and no file is named {name!r}; 'switchctl models' lists the models")
    if path.suffix == ".py":
        return _from_module(_execute(path), name)
    if path.suffix == ".json":
        return _from_matrices(read_json(path), name)
    if path.suffix == ".mat":
        return _from_matrices(_read_mat(path), name)
    raise FormatError(f"{name} ends in {path.suffix!r}; expected .py, .json or .mat")


def _execute(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None  # a .py file always has a loader
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise FormatError(f"{path} does not run: {type(error).__name__}: {error}") from error
    return module


def _from_module(module: ModuleType, name: str) -> Model:
    functions = {f: getattr(module, f, None) for f in ("modes", "plant", "controllers", "initial_state", "method")}
    for f, function in functions.items():
        if function is not None and not callable(function):
            raise FormatError(f"{name}: {f} must be a function; got {function!r}")
    if functions["modes"]:
        modes = functions["modes"]()
    elif functions["plant"] and functions["controllers"]:
        modes = close_loops(functions["plant"](), functions["controllers"]())
    else:
        raise FormatError(f"{name} offers neither modes() nor plant() and controllers()")
    initial_state = functions["initial_state"]() if functions["initial_state"] else None
    method = functions["method"]() if functions["method"] else Rollout()
    expected = (
        ("modes", modes, ModeSet),
        ("initial_state", initial_state, Gaussian),
        ("method", method, Method),
    )
    for f, value, kind in expected:
        if value is not None and not isinstance(value, kind):
            raise FormatError(f"{name}: {f}() returned a {type(value).__name__}; expected a {kind.__name__}")
    return Model(modes, initial_state, method)


def _from_matrices(content: dict[str, Any], name: str) -> Model:
    known = {"A", "names", "dt", "Q", "mean", "cov"}
    if "A" not in content:
        raise FormatError(f"{name} holds no A, the matrices of the modes; it holds {', '.join(content) or 'nothing'}")
    if unknown := set(content) - known:
        raise FormatError(f"{name} holds {sorted(unknown)[0]!r}; expected only {', '.join(sorted(known))}")
    modes = ModeSet(content["A"], content.get("names"), content.get("dt", True), Q=content.get("Q"))
    if "mean" not in content:
        return Model(modes, None, Rollout())
    n = modes.A.shape[-1]
    return Model(modes, Gaussian(content["mean"], content.get("cov", np.zeros((n, n)))), Rollout())


def _read_mat(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        content = {key: value for key, value in loadmat(path).items() if not key.startswith("__")}
    except Exception as error:
        raise FormatError(f"{path} is not a .mat file that scipy reads (version 7 or older): {error}") from None
    if "A" in content:
        A = content["A"]
        # MATLAB stacks along the third axis; a cell array arrives as an array of objects.
        content["A"] = list(A.ravel()) if A.dtype == object else np.moveaxis(np.atleast_3d(A), -1, 0)
    if "names" in content:
        content["names"] = [str(np.squeeze(name)).strip() for name in content["names"].ravel()]
    if "dt" in content:
        content["dt"] = content["dt"].item() if content["dt"].size == 1 else content["dt"]
    if "mean" in content:
        content["mean"] = content["mean"].ravel()
    return content
