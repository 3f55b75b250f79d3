"""Docstring examples assume ``import numpy as np``, ``import control`` and ``from switchctl import *``."""

from typing import Any

import control
import matplotlib
import numpy as np
import pytest

import switchctl

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def _examples(doctest_namespace: dict[str, Any]) -> None:
    doctest_namespace.update({name: getattr(switchctl, name) for name in switchctl.__all__})
    doctest_namespace.update(np=np, control=control)
