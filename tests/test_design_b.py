"""The quadrotor's design B: both tables of the source's numbers."""

import numpy as np
import pytest

from switchctl import FewSwitches, Optimal, Refine, Rollout, Schedule, schedule, single_mode_costs
from switchctl.models import quadrotor

X0 = quadrotor.initial_state()
DITHER = ([1] * 10 + [0] * 10) * 150


@pytest.mark.parametrize(
    ("initial", "greatest", "area", "best", "cost"),
    [
        (None, 32.7, 52.03, 50, 46.66),
        ("zero", 89.7, 51.97, 21, 39.89),
        ("settled", 49.7, 133.9, 32, 43.99),
    ],
)
def test_the_compensators_state_at_the_start_changes_the_answer(initial, greatest, area, best, cost):
    modes = quadrotor.dynamic_modes("closed_loop", initial=initial)
    assert single_mode_costs(modes, X0) == pytest.approx([50.37, area], abs=0.02)
    assert Schedule(modes, X0, [1] * 300).w2.max() == pytest.approx(greatest, abs=0.06)
    found = schedule(modes, X0, FewSwitches(1))
    assert [(s.step, s.before, s.after) for s in found.switches] == [(best, 1, 0)]
    assert found.cost == pytest.approx(cost, abs=0.01)
    assert Schedule(modes, X0, [0]).w2[0] == pytest.approx(27.695)


def continuous_u(lead_settled):
    """Reset maps that make u continuous when C_low takes over from C_high: two of many."""
    C, K = quadrotor.compensator(), quadrotor.high_gain()
    wanted = K - C.D @ np.eye(3, 6)  # H xi is to be this times x
    Z = quadrotor.settled_lead()
    for axis in range(3):
        lead, lag = C.C[axis, 2 * axis : 2 * axis + 2]
        if lead_settled:
            Z[2 * axis + 1] = (wanted[axis] - lead * Z[2 * axis]) / lag
        else:
            Z[2 * axis : 2 * axis + 2] = np.outer([lead, lag], wanted[axis]) / (lead**2 + lag**2)
    return ("reset", Z)


@pytest.mark.parametrize(
    ("inactive", "radius", "area"),
    [
        ("reset", 0.9923, 77.6),
        ("hold", 1.0, 56.9),
        ("run", 0.9995, 55.5),
        (continuous_u(True), 0.9923, 50.0),
        (continuous_u(False), 0.9923, 51.7),
        ("track", 0.9995, 51.8),
    ],
)
def test_what_the_compensator_does_while_inactive_changes_the_answer(inactive, radius, area):
    modes = quadrotor.dynamic_modes("closed_loop", inactive)
    assert modes.spectral_radii[0] == pytest.approx(radius, abs=1e-4)
    assert Schedule(modes, X0, DITHER, tail=(0,)).cost == pytest.approx(area, abs=0.06)
    assert (modes.schur[0] and modes.spectral_radii[0] < 1) or inactive == "hold"
    assert np.isfinite(single_mode_costs(modes, X0)).all()


def test_a_u_made_continuous_by_the_lag_costs_much_when_it_is_left_and_taken_again():
    modes = quadrotor.dynamic_modes("closed_loop", continuous_u(True))
    assert Schedule(modes, X0, [1] * 50 + [0] * 10 + [1]).cost == pytest.approx(109, abs=2)
    assert Schedule(quadrotor.dynamic_modes("closed_loop"), X0, [1] * 50 + [0] * 10 + [1]).cost < 49


def test_the_tracking_of_the_sources_table_is_one_of_other_poles():
    """Its area, 59.3, is that of observer poles near -10 and -20; the gain chosen here does better."""
    C, L = quadrotor.compensator(), np.zeros((6, 3))
    for axis in range(3):
        own = slice(2 * axis, 2 * axis + 2)
        F, H = C.A[own, own], C.C[axis : axis + 1, own]
        # place the poles: (s + 10)(s + 20)
        observability = np.vstack([H, H @ F])
        polynomial = F @ F + 30 * F + 200 * np.eye(2)
        L[own, axis] = polynomial @ np.linalg.solve(observability, [0.0, 1.0])
    modes = quadrotor.dynamic_modes("closed_loop", ("track", L))
    assert modes.spectral_radii[0] == pytest.approx(0.9923, abs=1e-4)
    assert Schedule(modes, X0, DITHER, tail=(0,)).cost == pytest.approx(59.3, abs=0.15)


def test_methods_on_twelve_states():
    modes = quadrotor.dynamic_modes()
    few = schedule(modes, X0, FewSwitches(2)).cost
    refined = schedule(modes, X0, Refine(FewSwitches(1))).cost
    assert refined <= schedule(modes, X0, FewSwitches(1)).cost
    assert few <= schedule(modes, X0, FewSwitches(1)).cost
    assert schedule(modes, X0, Rollout()).cost <= single_mode_costs(modes, X0).min()
    best = schedule(modes, X0, Optimal(gap=0.35, time_limit=100))
    assert 0.65 * best.cost <= best.lower_bound <= min(few, refined, best.cost)
