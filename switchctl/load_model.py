"""Models for the command line: bundled, in a Python file, or as matrices in a .json or .mat file."""

import importlib
import importlib.util
import json
import os
import re
import subprocess
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from switchctl.closed_loop import close_loops
from switchctl.files import FormatError, read_json
from switchctl.gaussian import Gaussian
from switchctl.mat_reader import KNOWN
from switchctl.methods import Method, Rollout
from switchctl.modes import ModeSet
from switchctl.rules import Rules

_SECONDS, _BYTES = 30, 1 << 31  # that reading a .mat file may take
FUNCTIONS = ("modes", "plant", "controllers", "initial_state", "method", "rules")


@dataclass(frozen=True)
class Model:
    """Modes, an initial state and rules where there are any, and the method that shows them best."""

    modes: ModeSet
    initial_state: Gaussian | None
    method: Method
    rules: Rules | None = None


def bundled() -> dict[str, str]:
    """Return the names of the bundled models, with their first line of documentation."""
    names = importlib.import_module("switchctl.models").NAMES
    return {name: (importlib.import_module(f"switchctl.models.{name}").__doc__ or "").split("\n")[0] for name in names}


def load_model(name: str) -> Model:
    """Load a bundled model by name, or one from a .py, .json or .mat file.

    Parameters
    ----------
    name : str
        A bundled model or a path. A Python file offers what the bundled models do: ``initial_state()``, and
        ``modes()`` or ``plant()`` and ``controllers()``; ``method()`` and ``rules()`` if it likes. A .json file holds
        an object with ``A`` and, if it likes, ``names``, ``states``, ``dt``, ``Q``, ``mean`` and ``cov``; a .mat file
        the same variables, with matrices for each mode stacked along the third axis or in a cell array.

    Returns
    -------
    Model

    Raises
    ------
    FormatError
        If a file is not what its name says, or what it holds can't be scheduled.
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
    """Run a file as Python runs a script: its folder on the path; no module that is called as it is is replaced."""
    name = f"model_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # a .py file always has a loader
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent.resolve()))
    _call(spec.loader.exec_module, str(path), module)
    return module


def _call(function: Callable[..., Any], name: str, *arguments: Any) -> Any:
    """Call what a user's file offers; an error says where in the file it arose."""
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename).resolve() == Path(name).resolve()
        ]
        where = f", line {lines[-1]}" if lines else ""
        raise FormatError(f"{name}{where}: {type(error).__name__}: {error}") from error


def _from_module(module: ModuleType, name: str) -> Model:
    functions = {f: getattr(module, f, None) for f in FUNCTIONS}
    for f, function in functions.items():
        if function is not None and not callable(function):
            raise FormatError(f"{name}: {f} must be a function; got {function!r}")

    def made(f: str) -> Any:
        function = functions[f]
        return None if function is None else _call(function, name)

    modes = made("modes")
    if functions["modes"] is None:
        if not (functions["plant"] and functions["controllers"]):
            raise FormatError(f"{name} offers neither modes() nor plant() and controllers()")
        modes = _call(close_loops, name, made("plant"), made("controllers"))
    initial_state, method, rules = made("initial_state"), made("method"), made("rules")
    for f, value, kind in (
        ("modes", modes, ModeSet),
        ("initial_state", initial_state, Gaussian),
        ("method", method, Method),
        ("rules", rules, Rules),
    ):
        if functions[f] is not None and not isinstance(value, kind):
            raise FormatError(f"{name}: {f}() returned a {type(value).__name__}; expected a {kind.__name__}")
    return Model(modes, initial_state, method or Rollout(), rules)


def _from_matrices(content: dict[str, Any], name: str) -> Model:
    if "A" not in content:
        raise FormatError(f"{name} holds no A, the matrices of the modes; it holds {', '.join(content) or 'nothing'}")
    if unknown := set(content) - KNOWN:
        kind, first = content.get("format"), min(unknown)
        what = f"is a {kind}, no model" if isinstance(kind, str) and len(kind) < 40 else f"holds {first!r}"
        raise FormatError(f"{name} {what}; expected only {', '.join(sorted(KNOWN))}")
    told = content["A"], content.get("names"), content.get("dt", True)
    modes = _held(name, ModeSet, *told, Q=content.get("Q"), states=content.get("states"))
    if "cov" in content and "mean" not in content:
        raise FormatError(f"{name} holds cov without mean; give both, or neither and --mean")
    if "mean" not in content:
        return Model(modes, None, Rollout())
    n = modes.A.shape[-1]
    return Model(modes, _held(name, Gaussian, content["mean"], content.get("cov", np.zeros((n, n)))), Rollout())


def _held(name: str, kind: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
    """Make what a file holds; an error names the file, and its A, which is the argument `matrices`."""
    try:
        return kind(*arguments, **keywords)
    except (ValueError, TypeError) as error:
        raise FormatError(f"{name}: {re.sub('^matrices', 'A', str(error))}") from error


def _read_mat(path: Path) -> dict[str, Any]:
    """Have `mat_reader` read the file; whatever becomes of it, this process goes on."""
    command = [sys.executable, "-P", str(Path(__file__).with_name("mat_reader.py")), str(path), str(_BYTES)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each of its threads reserves memory
    try:
        read = subprocess.run(command, capture_output=True, timeout=_SECONDS, env=environment)
    except subprocess.TimeoutExpired:
        raise FormatError(f"{path} could not be read in {_SECONDS} s; save it again, or as .json") from None
    if read.returncode:
        lines = read.stderr.decode(errors="replace").strip().splitlines()
        why = lines[-1] if lines and read.returncode == 1 else f"its reader ended with code {read.returncode}"
        raise FormatError(f"{path} is not a .mat file of a model (version 7 or older, save -v7): {why}")
    content: dict[str, Any] = json.loads(read.stdout)
    return content
