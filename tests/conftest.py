"""The paper's examples and a small pair of modes."""

import signal

import pytest
from pair import modes, x0

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
    return modes(), x0()
