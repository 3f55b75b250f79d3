"""Two suspended balls on one channel: the plant against its equations, the schedules against plain simulation."""

import json
from itertools import groupby

import numpy as np
import pytest
from scipy.linalg import expm

from switchctl import (
    Gaussian,
    RecedingHorizon,
    Refine,
    Rollout,
    Schedule,
    SwitchingGraph,
    cli,
    schedule,
    single_mode_costs,
)
from switchctl.models import medium_access

METHODS = [medium_access.method(), RecedingHorizon(20), Rollout(), Refine(), Refine(RecedingHorizon(30))]
RULES = medium_access.rules()
EQUILIBRIUM = np.array([0.01, 0.0, medium_access.CURRENT])


@pytest.fixture(scope="module")
def balls():
    return medium_access.modes(), medium_access.initial_state()


def rates(x, voltage):
    """``m h'' = m g - K i^2 / h`` and ``L i' = V - R i``, for gap, speed and current."""
    h, speed, i = x
    return np.array([speed, 9.81 - 1e-4 * i**2 / h / 0.05, (voltage - i) / 0.01])


def round_robin(modes, x0, turn=1, first=0):
    word = [first] * turn + [1 - first] * turn
    return Schedule(modes, x0, word, tail=word)


def length_of_runs(modes):
    return [len(list(run)) for _, run in groupby(modes)]


def test_the_plant_is_the_linearisation_of_its_equations():
    ball, step = medium_access.ball(), 1e-30
    np.testing.assert_allclose(rates(EQUILIBRIUM, EQUILIBRIUM[2]), 0, atol=1e-12)
    for j in range(3):
        x = EQUILIBRIUM.astype(complex)
        x[j] += 1j * step
        np.testing.assert_allclose(ball.A[:, j], rates(x, EQUILIBRIUM[2]).imag / step, rtol=1e-12)
    np.testing.assert_allclose(ball.B[:, 0], rates(EQUILIBRIUM, EQUILIBRIUM[2] + 1j * step).imag / step, rtol=1e-12)
    # The tutorial prints these, rounded.
    np.testing.assert_allclose(ball.A, [[0, 1, 0], [980, 0, -2.8], [0, 0, -100]], rtol=2e-3)
    np.testing.assert_allclose(ball.B, [[0], [0], [100]])


def test_one_ball_is_served_and_the_other_falls(balls):
    modes, x0 = balls
    free = expm(medium_access.ball().A * 0.002)
    for i, mode in enumerate(modes):
        served, other = slice(3 * i, 3 * i + 3), slice(3 - 3 * i, 6 - 3 * i)
        np.testing.assert_allclose(mode.A[other, other], free, rtol=1e-9)
        assert np.abs(np.linalg.eigvals(mode.A[served, served])).max() < 0.96
        assert not mode.A[served, other].any() and not mode.A[other, served].any()
        assert mode.spectral_radius == pytest.approx(np.exp(np.sqrt(9.81 / 0.01) * 0.002))
    assert not modes.schur.any()
    assert np.isinf(single_mode_costs(modes, x0)).all()


def test_the_schedule_converges_and_costs_less_than_round_robin(balls):
    modes, x0 = balls
    result = schedule(modes, x0, medium_access.method(), rules=RULES)
    assert result.status == "converged"
    plain = min(round_robin(modes, x0, first=first).cost for first in (0, 1))
    assert result.cost < 0.77 * plain
    turns = [round_robin(modes, x0, turn, first).cost for turn in range(2, 16) for first in (0, 1)]
    assert result.cost < min(turns)


def test_the_other_ball_low_is_the_same_with_the_names_exchanged(balls):
    modes, x0 = balls
    swap = [3, 4, 5, 0, 1, 2]
    mirrored = Gaussian(x0.mean[swap], x0.cov[np.ix_(swap, swap)])
    result, other = (schedule(modes, x, medium_access.method(), rules=RULES) for x in (x0, mirrored))
    np.testing.assert_array_equal(other.sequence[:100], 1 - result.sequence[:100])
    assert other.cost == pytest.approx(result.cost, rel=1e-3)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_the_rules_are_obeyed_for_ever(balls, method):
    """Turns of 2 to 10 samples, in the schedule and in what follows it."""
    modes, x0 = balls
    result = schedule(modes, x0, method, rules=RULES)
    assert result.status == "converged"
    assert result.cost < 0.77 * round_robin(modes, x0).cost
    runs = length_of_runs([*result.sequence, *result.lead, *(20 * result.tail)])
    assert min(runs[:-1]) >= 2 and max(runs) <= 10  # the last run is cut


@pytest.mark.parametrize("slots", [4, 6, 10])
def test_a_frame_with_free_slots_is_no_worse_than_round_robin(balls, slots):
    modes, x0 = balls
    free = [(k, (k + 1) % slots, i) for k in range(2, slots) for i in (0, 1)]
    frame = SwitchingGraph.from_edges(modes, [(0, 1, 0), (1, 2, 1), *free])
    robin = Schedule(modes, x0, [0, 1], tail=(0, 1), graph=frame).cost
    for method in (RecedingHorizon(30), Rollout(), Refine()):
        result = schedule(modes, x0, method, rules=frame)
        assert set(result.sequence[0::slots]) == {0} and set(result.sequence[1::slots]) == {1}
        assert np.isfinite(result.cost)
        assert result.cost <= robin or isinstance(method, RecedingHorizon)  # which promises nothing of the kind


def test_the_costs_are_those_of_plain_simulation(balls):
    """Sampled initial states, each ball stepped by itself: voltages where it is served, none where it is not."""
    modes, x0 = balls
    rng, ball, gain = np.random.default_rng(7), medium_access.ball(), medium_access.gain()[0]
    step = expm(np.block([[ball.A, ball.B], [np.zeros((1, 4))]]) * 0.002)
    drift, push = step[:3, :3], step[:3, 3]
    start = rng.multivariate_normal(x0.mean, x0.cov, size=20_000)
    for result in (schedule(modes, x0, medium_access.method(), rules=RULES), round_robin(modes, x0)):
        states, costs = [start[:, :3], start[:, 3:]], np.zeros(len(start))
        for served in [*result.sequence, *result.lead, *(200 * result.tail)]:
            for b, x in enumerate(states):
                voltage = -x @ gain * (b == served)
                costs += 0.002 * ((x[:, 0] / 1e-3) ** 2 + voltage**2)
                states[b] = x @ drift.T + np.outer(voltage, push)
        assert max(np.abs(x).max() for x in states) < 1e-6
        assert result.cost == pytest.approx(costs.mean(), rel=0.02)


def test_the_schedule_suspends_the_balls_of_the_nonlinear_equations(balls):
    modes, x0 = balls
    result, rng = schedule(modes, x0, medium_access.method(), rules=RULES), np.random.default_rng(3)
    rest = EQUILIBRIUM[:, None, None]
    x = rest + rng.multivariate_normal(x0.mean, x0.cov, size=100).reshape(100, 2, 3).transpose(2, 0, 1)
    gain, step = medium_access.gain()[0], 0.002 / 4
    for served in result.sequence:
        voltage = rest[2] - np.tensordot(gain, x - rest, 1) * (np.arange(2) == served)
        assert (voltage > 0).all() and (np.abs(x - rest)[0] < 0.002).all()
        for _ in range(4):
            k1 = rates(x, voltage)
            k2 = rates(x + step / 2 * k1, voltage)
            k3 = rates(x + step / 2 * k2, voltage)
            x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + step * k3, voltage))
    np.testing.assert_allclose(x - rest, np.zeros_like(x), atol=1e-6)


def test_the_command_line_runs_it(capsys):
    assert cli.main(["run", "medium_access", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [mode["cost"] for mode in record["modes"]] == [None, None]
    assert 0 < record["schedules"][0]["cost"] < 0.1
    assert cli.main(["compare", "medium_access"]) == 0
