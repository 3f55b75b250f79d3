"""Every bundled model offers the same functions, and its method is worth showing."""

import importlib

import numpy as np
import pytest

import switchctl
from switchctl import models


@pytest.mark.parametrize("name", models.NAMES)
def test_a_model_offers_what_it_should(name):
    module = importlib.import_module(f"switchctl.models.{name}")
    modes, x0, method = module.modes(), module.initial_state(), module.method()
    assert set(module.controllers()) == set(modes.names)
    plant = module.plant()
    assert plant is None or plant.nstates == modes.A.shape[-1]
    assert modes.schur.all()
    result = switchctl.schedule(modes, x0, method)
    assert result.status == "converged"
    assert result.cost < 0.93 * switchctl.single_mode_costs(modes, x0).min()


def test_every_module_is_listed():
    from pathlib import Path

    files = {path.stem for path in Path(models.__file__).parent.glob("*.py")} - {"__init__"}
    assert files == set(models.NAMES)


def test_suspension_weighs_acceleration_and_deflection():
    from switchctl.models import suspension

    modes, x = suspension.modes(), np.array([0.01, -0.2, 0.005, 0.3])
    plant = suspension.plant()
    for mode, c in zip(modes, suspension.SETTINGS.values(), strict=True):
        force = -c * (x[1] - x[3])
        acceleration = (plant.A @ x + plant.B[:, 0] * force)[1]
        assert x @ mode.Q @ x == pytest.approx(acceleration**2 + (x[2] / 0.02) ** 2)
