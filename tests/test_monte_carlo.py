"""Samples against the prediction: that they agree where they must, whatever the executor, and after Ctrl-C."""

import importlib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from random_cases import random_gaussian, random_modes

from switchctl import (
    Constant,
    Gaussian,
    ModeSet,
    MonteCarlo,
    PointwiseMinimum,
    RecedingHorizon,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    close_loops,
    compare,
    monte_carlo,
    schedule,
    simulate,
)
from switchctl.models import five_mode, quadrotor
from switchctl.plotting import plot_monte_carlo
from switchctl.simulation.estimates import Tally

DT = 0.1
MODULE = importlib.import_module("switchctl.simulation.monte_carlo")  # the function has its name


def pendulum(t, x, u, params):
    return np.array([x[1], np.sin(x[0]) + u[0]])


def angle(t, x, u, params):
    return x[:1]


def plant(function=pendulum):
    return control.nlsys(function, angle, inputs=1, states=["angle", "rate"], outputs=["angle"], name="pendulum")


def near(x):
    """Of a state that is not far from upright."""
    return 1.4 - abs(x[0])


def loops():
    gains = {"stiff": [[20.0, 6.0]], "soft": [[3.0, 2.0]], "lead": control.tf([40, 60], [1, 12])}
    return close_loops(plant().linearize([0, 0], [0]), gains, DT)


def planned(scale=1.0):
    modes = loops()
    x0 = Gaussian([0.6 * scale, 0.0], scale**2 * np.diag([0.04, 0.01]))
    return compare(modes, x0, {"rollout": Rollout(), "soft first": RecedingHorizon(5)}, 20)


@pytest.mark.parametrize("model", [five_mode, quadrotor])
def test_the_prediction_is_inside_the_band_as_often_as_stated(model):
    modes, x0 = model.modes(), model.initial_state()
    result = schedule(modes, x0, model.method() if model is quadrotor else PointwiseMinimum(), 100)
    found = monte_carlo(result, samples=100_000, confidence=0.99)
    np.testing.assert_array_equal(found.predicted[0], result.w2)
    np.testing.assert_allclose(found.mean, found.predicted, rtol=0.05)
    assert found.inside[0] > 0.9
    # over independent seeds, at one step
    inside = [monte_carlo(result, samples=500, steps=10, seed=seed, confidence=0.9).band for seed in range(400)]
    hits = np.mean([(low[0] <= result.w2[:10]) & (result.w2[:10] <= high[0]) for low, high in inside], axis=0)
    assert (hits > 0.84).all()
    assert (hits < 0.95).all()


def test_the_mean_and_its_error_are_those_of_the_runs():
    rng = np.random.default_rng(1)
    modes = ModeSet(random_modes(rng, 3, 2), plant_states=2, activation=activation(rng))
    x0, sequence = random_gaussian(rng, 3), rng.integers(0, 2, 12)
    found = monte_carlo(Schedule(modes, x0, sequence), samples=3000, seed=5)
    runs = []
    for x in found_draws(x0, 3000, 5):
        before, w2 = -1, []
        for mode in sequence:
            w2.append(x[0] ** 2 + x[1] ** 2)
            x = modes.A_after[before, mode] @ x
            before = mode
        runs.append(w2)
    np.testing.assert_allclose(found.mean[0], np.mean(runs, axis=0), rtol=1e-10)
    np.testing.assert_allclose(found.standard_error[0], np.std(runs, axis=0, ddof=1) / np.sqrt(3000), rtol=1e-9)
    low, high = found.band
    np.testing.assert_allclose((high - low) / 2, 2.5758293 * found.standard_error, rtol=1e-6)
    np.testing.assert_array_equal(found.counted, 3000)
    np.testing.assert_array_equal(found.time, np.arange(12))


def activation(rng):
    maps = np.tile(np.eye(3), (2, 2, 1, 1))
    maps[0, 1, 2], maps[1, 0, 2] = rng.standard_normal((2, 3))
    return maps


def found_draws(x0, samples, seed):
    """The samples, from the same normal numbers: symmetric about the mean, of the right covariance."""
    from switchctl.moments import moment_factor

    normal = np.random.default_rng(seed).standard_normal((samples, len(x0.mean)))
    return x0.mean + normal @ moment_factor(x0.mean, x0.cov)[:, 1:].T


def test_several_schedules_share_samples_and_go_on_with_their_tails():
    modes, x0 = five_mode.modes(), five_mode.initial_state()
    comparison = compare(modes, x0, {"short": PointwiseMinimum(), "third": Constant(2)}, 8)
    short = Schedule(modes, x0, comparison.schedules["short"].sequence[:3], tail=(1, 2))
    both = monte_carlo({"short": short, "third": comparison.schedules["third"]}, 500)
    assert both.labels == ("short", "third")
    assert both.mean.shape == (2, 8)
    assert both.mean[0, 0] == both.mean[1, 0]
    listed = Schedule(modes, x0, [*short.sequence, 1, 2, 1, 2, 1])
    np.testing.assert_array_equal(both.predicted[0], listed.w2)
    np.testing.assert_array_equal(both.mean[0], monte_carlo(listed, 500).mean[0])
    np.testing.assert_array_equal(monte_carlo(comparison, 500).labels, ["short", "third"])
    cut = monte_carlo(listed, 500, steps=2)
    np.testing.assert_array_equal(cut.mean, monte_carlo(listed, 500).mean[:, :2])
    assert monte_carlo(listed, 500, seed=1).mean[0, 0] != cut.mean[0, 0]


def test_a_state_known_exactly_is_predicted_to_rounding():
    modes = five_mode.modes()
    found = monte_carlo(Schedule(modes, Gaussian([5.0, 5.0], np.zeros((2, 2))), [0, 1, 2]), 100)
    assert found.inside[0] == 1
    np.testing.assert_allclose(found.standard_error, 0, atol=1e-12)


def test_the_first_step_may_be_a_switch():
    rng = np.random.default_rng(4)
    modes = ModeSet(random_modes(rng, 3, 2), plant_states=2, activation=activation(rng))
    graph = SwitchingGraph(modes, Rules(start=(1, 1)))
    result = Schedule(modes, Gaussian([1.0, 2.0, 3.0], np.zeros((3, 3))), [0, 0, 1], graph=graph)
    np.testing.assert_allclose(monte_carlo(result, 5).mean[0], result.w2, rtol=1e-12)


def test_blocks_merge_to_what_all_runs_give(monkeypatch):
    result = schedule(five_mode.modes(), five_mode.initial_state(), PointwiseMinimum(), 10)
    whole = monte_carlo(result, 1000)
    monkeypatch.setattr(MODULE, "_BLOCK", 7)
    parts = monte_carlo(result, 1000)
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(parts.standard_error, whole.standard_error, rtol=1e-10)
    tally, runs = Tally(3), np.array([[1.0, 5.0, 2.0], [3.0, np.nan, np.nan], [5.0, 6.0, np.nan]])
    tally.add_runs(runs[:1])
    tally.add_runs(runs[1:])
    mean, error = tally.estimates()
    np.testing.assert_array_equal(tally.count, [3, 2, 1])
    np.testing.assert_allclose(mean, [3, 5.5, 2])
    np.testing.assert_allclose(error, [2 / np.sqrt(3), 0.5, np.nan])


def test_runs_of_a_plant_are_simulated_ones():
    modes, x0 = loops(), planned().x0
    x0 = Gaussian(x0.mean[:2], x0.cov[:2, :2])
    schedules = {"rollout": schedule(modes, x0, Rollout(), 20), "lead": schedule(modes, x0, Constant("lead"), 20)}
    found = monte_carlo(schedules, 12, plant=plant(), saturation=(-2, 2), delay=True, noise=0.01, seed=3)
    draws = found_draws(schedules["lead"].x0, 12, 3)
    for i, result in enumerate(schedules.values()):
        w2 = [
            simulate(
                plant(),
                result.modes,
                result,
                x,
                20,
                saturation=(-2, 2),
                delay=True,
                noise=0.01,
                seed=np.random.SeedSequence(3, spawn_key=(j,)),
            ).w2[:20]
            for j, x in enumerate(draws)
        ]
        np.testing.assert_allclose(found.mean[i], np.mean(w2, axis=0), rtol=1e-9)
        np.testing.assert_allclose(found.standard_error[i], np.std(w2, axis=0, ddof=1) / np.sqrt(12), rtol=1e-9)
    assert found.plant == "pendulum"


def test_a_small_state_sees_the_linear_plant():
    """The linear prediction holds for small states, and the same samples show it to many digits."""
    comparison = planned(1e-3)
    linear, simulated = monte_carlo(comparison, 16), monte_carlo(comparison, 16, plant=plant())
    np.testing.assert_allclose(simulated.mean, linear.mean, rtol=1e-4)
    assert not np.allclose(monte_carlo(planned(), 16, plant=plant()).mean, monte_carlo(planned(), 16).mean, rtol=1e-2)


def test_about_an_operating_point_the_initial_state_is_the_deviation():
    x_e, u_e = np.array([0.7, 0.0]), np.array([-np.sin(0.7)])
    gains = {"stiff": [[20.0, 6.0]], "lead": control.tf([40, 60], [1, 12])}
    modes = close_loops(plant().linearize(x_e, u_e), gains, DT, initial="settled")
    result = schedule(modes, Gaussian([1e-3, 0.0], 1e-7 * np.eye(2)), Rollout(), 20)
    found = monte_carlo(result, 16, plant=plant(), operating_point=(x_e, u_e))
    np.testing.assert_allclose(found.mean, monte_carlo(result, 16).mean, rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_results_do_not_depend_on_the_executor(pool, monkeypatch):
    settings = {"plant": plant(), "noise": 0.01, "domain": near, "saturation": (-3, 3)}
    comparison = planned()
    here = monte_carlo(comparison, 20, **settings)
    with pool(2) as executor:
        there = monte_carlo(comparison, 20, executor=executor, **settings)
        linear = monte_carlo(comparison, 10, executor=executor, plant=loops().plant)
    for name in ("mean", "standard_error", "counted", "predicted"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert here.stops == there.stops
    np.testing.assert_allclose(linear.mean, monte_carlo(comparison, 10).mean, rtol=1e-9)
    monkeypatch.setattr(MODULE, "_RUNS", 3)
    chunked = monte_carlo(comparison, 20, **settings)
    np.testing.assert_allclose(chunked.mean, here.mean, rtol=1e-12)
    assert chunked.stops == here.stops


def test_runs_that_leave_their_domain_are_counted_and_left_out_of_later_means():
    result = planned().schedules["soft first"]
    domain = lambda x: 0.75 - x[0]  # noqa: E731
    found = monte_carlo(result, 40, plant=plant(), domain=domain)
    whole = monte_carlo(result, 40, plant=plant())
    draws = found_draws(result.x0, 40, 0)
    outside = np.flatnonzero(draws[:, 0] >= 0.75)
    assert 0 < len(outside) < 40
    assert found.left[0] >= len(outside)
    assert set(outside) <= {sample for sample, _ in found.stops[0]}
    assert all(why.startswith("left its domain at") for _, why in found.stops[0])
    assert found.counted[0, 0] == 40
    assert found.counted[0, -1] == 40 - found.left[0]
    assert (np.diff(found.counted[0]) <= 0).all()
    assert found.mean[0, 0] == pytest.approx(whole.mean[0, 0])
    stay = [j for j in range(40) if j not in {sample for sample, _ in found.stops[0]}]
    w2 = [simulate(plant(), result.modes, result, draws[j], 20).w2[:20] for j in stay]
    np.testing.assert_allclose(found.mean[0, -1], np.mean(w2, axis=0)[-1], rtol=1e-9)
    within = (found.band[0] <= found.predicted)[0] & (found.predicted <= found.band[1])[0]
    assert found.inside[0] == pytest.approx(within[found.counted[0] == 40].mean())
    assert f"{found.left[0]} runs stopped early" in repr(found)
    assert f"% of the {np.count_nonzero(found.counted[0] == 40)} step" in repr(found)
    none = monte_carlo(result, 4, plant=plant(), domain=lambda x: -1.0)
    assert np.isnan(none.mean[0, 1:]).all()
    assert "% of the 1 step before a run stopped" in repr(none)
    for shown in (found, none):
        shown.plot()
    plt.close("all")


def test_inside_counts_the_steps_before_any_run_stopped():
    ones = np.ones((1, 4))
    found = MonteCarlo(
        modes=five_mode.modes(),
        labels=("one",),
        predicted=ones,
        mean=np.array([[1.0, 1.2, 1.2, np.nan]]),
        standard_error=0.01 * ones,
        counted=np.array([[9, 9, 5, 0]]),
        stops=(((3, "left its domain at 2 s"), (4, "..")),),
        samples=9,
        asked=9,
        confidence=0.99,
    )
    np.testing.assert_array_equal(found.inside, [0.5])
    np.testing.assert_array_equal(found.left, [2])


class Interrupts:
    """A plant's function that is interrupted at a call."""

    def __init__(self, calls):
        self.left = calls

    def __call__(self, t, x, u, params):
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        return pendulum(t, x, u, params)


def test_ctrl_c_returns_the_samples_done():
    result = planned().schedules["rollout"]
    counting = Interrupts(10**9)
    whole = monte_carlo(result, 12, plant=plant(counting))
    calls = 10**9 - counting.left
    cut = monte_carlo(result, 12, plant=plant(Interrupts(calls // 2)))
    assert 2 <= cut.samples < 12
    assert cut.asked == 12
    assert cut.status == "interrupted"
    assert whole.status == "completed"
    np.testing.assert_allclose(cut.mean, monte_carlo(result, cut.samples, plant=plant()).mean, rtol=1e-12)
    assert f"interrupted after {cut.samples} of 12" in repr(cut)
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(result, 12, plant=plant(Interrupts(1)))
    with ThreadPoolExecutor(1) as executor:
        there = monte_carlo(result, 12, plant=plant(Interrupts(calls // 2)), executor=executor)
    assert there.status == "interrupted"
    assert there.samples == cut.samples


def test_ctrl_c_between_blocks_returns_the_blocks_done(monkeypatch):
    result = schedule(five_mode.modes(), five_mode.initial_state(), PointwiseMinimum(), 10)
    monkeypatch.setattr(MODULE, "_BLOCK", 100)
    add, blocks = Tally.add, []

    def interrupted(self, *block):
        blocks.append(block)
        if len(blocks) == 6:  # every block is added twice: to its own tally and to the whole
            raise KeyboardInterrupt
        add(self, *block)

    monkeypatch.setattr(Tally, "add", interrupted)
    cut = monte_carlo(result, 1000)
    assert cut.samples == 200
    assert cut.status == "interrupted"


def test_it_tells_what_it_found():
    comparison = planned()
    found = monte_carlo(comparison, 100)
    assert repr(found).startswith("MonteCarlo: 100 samples, 20 steps (2 s)\n├── runs of     the modes\n├── rollout")
    assert "└── ends" in repr(found)
    assert "<table>" in found._repr_html_()
    assert repr(monte_carlo(comparison, 3, plant=plant())).count("pendulum, simulated") == 1
    assert "rollout" not in repr(monte_carlo(comparison.schedules["rollout"], 10))


def test_the_picture_shows_prediction_and_band():
    found = monte_carlo(planned(), 200)
    plot = plot_monte_carlo(found, stop=15)
    ax, strips = plot.axes.ravel()
    black = [line for line in ax.get_lines() if line.get_color() == "black"]
    assert [line.get_label() for line in black] == ["$W^2$, rollout", "$W^2$, soft first"]
    for line, predicted in zip(black, found.predicted, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), predicted[:15])
    assert len({str(line.get_linestyle()) + str(line._dash_pattern) for line in black}) == 2
    assert ax.get_yscale() == "log"
    assert "state units" in ax.get_ylabel()
    assert strips.get_xlabel() == "time (s)"
    assert [text.get_text() for text in strips.get_yticklabels()] == ["rollout", "soft first"]
    labels = [label.get_text() for axis in strips.child_axes for label in axis.get_yticklabels()]
    scale = float(labels[0].strip("+ %")) / 100
    found_low, found_high = ((edge / found.predicted - 1)[0, :15] for edge in found.band)
    edges = -strips.collections[0].get_paths()[0].vertices[:, 1] / 0.42 * scale
    assert edges.min() == pytest.approx(found_low.min())
    assert edges.max() == pytest.approx(found_high.max())
    assert found.plot(legend_loc=False, title="A title").axes[0, 0].get_title() == "A title"
    plt.close("all")


ONE = planned().schedules["rollout"]


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"schedules": loops()}, TypeError, "schedules must be a Schedule, a dict of them or a Comparison"),
        ({"schedules": {}}, TypeError, "not empty"),
        ({"schedules": {1: ONE}}, TypeError, "labels"),
        ({"schedules": {"a": Rollout()}}, TypeError, r"schedules\['a'\] is a Rollout"),
        ({"schedules": {"a": ONE, "b": planned().schedules["rollout"]}}, ValueError, "other modes"),
        (
            {"schedules": {"a": ONE, "b": schedule(ONE.modes, Gaussian([1.0, 0], np.eye(2)), Rollout(), 3)}},
            ValueError,
            "another initial state",
        ),
        ({"samples": 1}, ValueError, "at least 2"),
        ({"samples": 2.5}, ValueError, "whole number"),
        ({"steps": 0}, ValueError, "at least 1"),
        ({"seed": -1}, ValueError, "seed is -1"),
        ({"seed": None}, TypeError, "seed"),
        ({"confidence": 1.0}, ValueError, "between 0 and 1"),
        ({"confidence": 99}, ValueError, "between 0 and 1"),
        ({"confidence": np.nan}, ValueError, "nan"),
        ({"delay": True}, ValueError, "delay is for runs of a plant"),
        ({"domain": near}, ValueError, "domain is for runs of a plant"),
        ({"executor": ThreadPoolExecutor(1)}, ValueError, "executor is for runs of a plant"),
        ({"executor": 2, "plant": plant()}, TypeError, "not a int"),
        ({"plant": "pendulum"}, TypeError, "not a str"),
        ({"plant": plant(), "saturation": (1, -1)}, ValueError, "low <= high"),
        ({"plant": plant(), "operating_point": 3}, TypeError, "find_operating_point"),
        ({"plant": plant(), "noise": -1.0}, ValueError, "noise is not positive"),
        (
            {"plant": plant(), "schedules": schedule(*(five_mode.modes(), five_mode.initial_state()), Rollout(), 3)},
            TypeError,
            "plain ModeSet",
        ),
    ],
)
def test_wrong_input(arguments, error, words):
    with pytest.raises(error, match=words):
        monte_carlo(**({"schedules": ONE, "samples": 10} | arguments))
