"""Docstring examples assume ``import numpy as np``, ``import control`` and ``from switchctl import *``."""

import os
import sys
from collections.abc import Iterator
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the tests themselves run in parallel

import control
import matplotlib
import numpy as np
import pytest

import switchctl

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def _examples(doctest_namespace: dict[str, Any]) -> Iterator[None]:
    doctest_namespace.update({name: getattr(switchctl, name) for name in switchctl.__all__})
    doctest_namespace.update(np=np, control=control)
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
