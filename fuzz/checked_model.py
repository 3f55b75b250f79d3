"""What a model that was read must be, or how it must be refused."""

import json
import linecache
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import atheris
import numpy as np

with atheris.instrument_imports(include=["switchctl"]):
    import switchctl
    from switchctl import Gaussian, Rollout, schedule
    from switchctl.load_model import Model

PACKAGE = Path(switchctl.__file__).parent


def seeds() -> list[str]:
    """Models as .json files hold them."""
    A = [[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]]
    each = [[[1.0, 0.0], [0.0, 2.0]], [[1.0, 0.5], [0.5, 0.5]]]
    models: list[dict[str, Any]] = [
        {"A": A},
        {"A": A, "names": ["fast", "calm"], "dt": 0.1, "mean": [1.0, 2.0], "cov": [[0.1, 0.0], [0.0, 0.2]]},
        {"A": A, "Q": [[1.0, 0.0], [0.0, 2.0]], "states": ["angle", "rate"], "dt": True, "mean": [1.0, 1.0]},
        {"A": A, "Q": each, "names": ["a", "b"], "mean": [0.0, 1.0]},
        {"A": [[[0.5]]], "mean": [3.0], "cov": [[0.0]], "dt": 1},
    ]
    return [json.dumps(model) for model in models]


def try_model(load: Callable[[], Model]) -> None:
    """Load it, copy it, and schedule its modes; what is refused must be refused by the package itself."""
    try:
        model = load()
    except (ValueError, TypeError) as error:
        refused(error)
        return
    copy = pickle.loads(pickle.dumps(model))
    assert np.array_equal(copy.modes.A, model.modes.A) and np.array_equal(copy.modes.Q, model.modes.Q)
    assert (copy.modes.names, copy.modes.states, copy.modes.dt) == (
        model.modes.names,
        model.modes.states,
        model.modes.dt,
    )
    assert np.isfinite(model.modes.A).all() and np.isfinite(model.modes.Q).all()
    repr(model)
    if len(model.modes.A[0]) > 8 or len(model.modes) > 8:
        return
    x0 = model.initial_state or Gaussian(np.ones(model.modes.A.shape[1]), np.eye(model.modes.A.shape[1]))
    try:
        repr(schedule(model.modes, x0, Rollout(), steps=4))
    except (ValueError, ArithmeticError) as error:
        refused(error)


def refused(error: Exception) -> None:
    """Whether the package meant to refuse: it says so by a ``raise`` of its own."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    assert trace is not None
    place = Path(trace.tb_frame.f_code.co_filename)
    line = "".join(linecache.getline(str(place), n) for n in range(trace.tb_lineno - 8, trace.tb_lineno + 1))
    if PACKAGE not in place.parents or "raise " not in line or not str(error):
        raise error
