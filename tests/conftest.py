"""The paper's examples and a small pair of modes."""

import signal

import numpy as np
import pytest

from switchctl import Gaussian, ModeSet

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell; tests interrupt themselves
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def example():
    """The paper's first example."""
    from switchctl.models import five_mode

    return five_mode.modes(), five_mode.initial_state()


@pytest.fixture
def quadrotor():
    """The paper's second example, closed in continuous time and then sampled."""
    from switchctl.models import quadrotor

    return quadrotor.modes("closed_loop"), quadrotor.initial_state()


@pytest.fixture
def pair():
    """Two modes of which one switch helps."""
    modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"], dt=0.1)
    return modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2))
