"""What `simulate` refuses, and in which words."""

import control
import numpy as np
import pytest
from plants import DT, dynamic, linear

from switchctl import Constant, Gaussian, ModeSet, Rules, Schedule, SwitchingGraph, close_loops, simulate


def static_modes(dt=DT, **keywords):
    return close_loops(linear(), {"gain": [[2.0, 1.0]]}, dt, **keywords)


def planned(modes):
    return Schedule(modes, Gaussian(np.ones(2), np.eye(2)), [0])


MODES = static_modes()


def nonlinear(**keywords):
    return control.nlsys(
        lambda t, x, u, p: -x, lambda t, x, u, p: x[:1], **({"inputs": 1, "states": 2, "outputs": 1} | keywords)
    )


def wrong(**changes):
    return {"plant": linear(), "modes": MODES, "method": Constant(0), "x0": [1.0, 0.0], "steps": 5} | changes


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (wrong(plant=control.tf([1], [1, 1])), TypeError, "not a TransferFunction; control.ss"),
        (wrong(plant="plant"), TypeError, "not a str"),
        (wrong(plant=nonlinear(inputs=2)), ValueError, "2 states, 2 inputs and 1 outputs; .* one of 2, 1 and 1"),
        (wrong(plant=nonlinear(states=3)), ValueError, "3 states"),
        (wrong(plant=nonlinear(outputs=2)), ValueError, "2 outputs"),
        (wrong(plant=nonlinear(dt=0.2)), ValueError, r"dt = 0.2, and the modes with dt = 0.1"),
        (wrong(plant=nonlinear(dt=None)), ValueError, "plant.dt is None"),
        (wrong(modes=close_loops(linear().sample(DT), [[[1.0, 1.0]]]), plant=linear().sample(0.3)), ValueError, "0.3"),
        (
            wrong(modes=close_loops(control.ss(linear().sample(DT), dt=True), [[[1.0, 1.0]]])),
            ValueError,
            "no sampling period",
        ),
        (
            wrong(
                plant=control.nlsys(lambda t, x, u, p: [1.0], lambda t, x, u, p: x[:1], inputs=1, states=2, outputs=1)
            ),
            ValueError,
            "expected 2",
        ),
        (wrong(modes=ModeSet(MODES.A)), TypeError, "not a ModeSet: a plain ModeSet.*knows no plant"),
        (wrong(modes=linear()), TypeError, "what close_loops returns"),
        (wrong(modes=static_modes(discretize="closed_loop")), ValueError, 'discretize="plant"'),
        (wrong(method="rollout"), TypeError, "method must be a Method"),
        (wrong(method=planned(MODES), rules=Rules()), ValueError, "leave them out"),
        (wrong(method=planned(static_modes(0.2))), ValueError, "other modes"),
        (wrong(rules=SwitchingGraph(static_modes())), ValueError, "other modes"),
        (wrong(x0=[1.0]), ValueError, r"x0 has shape \(1,\); the plant has 2 states"),
        (wrong(x0=[1.0, np.nan]), ValueError, r"x0\[1\] is nan"),
        (wrong(x0=Gaussian([1.0], [[1.0]])), ValueError, r"shape \(1,\)"),
        (wrong(x0="here"), TypeError, "x0 must hold real numbers"),
        (wrong(steps=0), ValueError, "at least 1"),
        (wrong(steps=1.5), ValueError, "whole number"),
        (wrong(saturation=1.0), TypeError, "must be \\(low, high\\)"),
        (wrong(saturation=(1.0, -1.0)), ValueError, "low <= high"),
        (wrong(saturation=(np.nan, 1.0)), ValueError, "low <= high"),
        (wrong(saturation=(np.inf, np.inf)), ValueError, "low <= high"),
        (wrong(saturation=([0.0, 0.0], 1.0)), ValueError, r"low has shape \(2,\)"),
        (wrong(saturation=("a", 1.0)), TypeError, "real numbers"),
        (wrong(delay=0.5), TypeError, "True or False"),
        (wrong(noise=0.1), ValueError, "don't measure it"),
        (wrong(modes=dynamic(linear()), noise=-0.1), ValueError, "noise is not positive semidefinite"),
        (wrong(modes=dynamic(linear()), noise=np.eye(2)), ValueError, r"noise has shape \(2, 2\)"),
        (wrong(operating_point=3), TypeError, "find_operating_point"),
        (wrong(operating_point=([1.0], [1.0])), ValueError, r"state of operating_point has shape \(1,\)"),
        (wrong(operating_point=([1.0, 0.0], np.ones((1, 6)))), ValueError, r"expected \(1,\), or \(1, 5\)"),
        (wrong(operating_point=(np.ones((2, 5)), [1.0])), ValueError, r"expected \(2,\), or \(2, 6\)"),
        (wrong(operating_point=([1.0, np.inf], [1.0])), ValueError, "inf"),
        (wrong(domain=1.0), TypeError, "domain must be a function"),
        (wrong(seed=None), TypeError, "seed"),
        (wrong(seed=-1), ValueError, "seed is -1"),
        (wrong(rtol=0), ValueError, "rtol is 0"),
        (wrong(atol=np.nan), ValueError, "atol is nan"),
        (wrong(atol="1"), TypeError, "atol"),
        (wrong(saturated=True), TypeError, "saturated"),
    ],
)
def test_wrong_input(arguments, error, words):
    with pytest.raises(error, match=words):
        simulate(**arguments)
