"""The pictures: what they hold, where they are drawn, that they fit."""

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import FancyArrowPatch
from random_cases import random_gaussian, random_modes

import switchctl.plotting
from switchctl import (
    Budget,
    Constant,
    ModeSet,
    Optimal,
    RecedingHorizon,
    Rollout,
    Rules,
    SwitchingGraph,
    compare,
    monte_carlo,
    schedule,
    sweep,
    trade_off,
)
from switchctl.certificates import certify
from switchctl.plotting import (
    plot_area,
    plot_bounds,
    plot_ellipses,
    plot_graph,
    plot_monte_carlo,
    plot_schematic,
    plot_sweep,
    plot_switching,
    plot_trade_off,
    plot_tree,
    plot_w2,
)
from switchctl.plotting.style import COLOURS, mode_style


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def pictures(modes, x0):
    result, comparison = schedule(modes, x0, RecedingHorizon(20)), compare(modes, x0, [RecedingHorizon(20), Rollout()])
    return {
        plot_w2: result,
        plot_area: comparison,
        plot_switching: result,
        plot_ellipses: result,
        plot_schematic: result,
        plot_sweep: sweep(modes, x0, [1, 20], [1, 5]),
        plot_graph: SwitchingGraph(modes, Rules(min_dwell=2)),
        plot_trade_off: trade_off(modes, x0, values=[0, 1]),
        plot_monte_carlo: monte_carlo(comparison, 50),
        plot_bounds: search_of(modes, x0)[0],
        plot_tree: search_of(modes, x0)[1],
    }


def search_of(modes, x0):
    rungs = []
    found = schedule(modes, x0, Optimal(gap=1e-4, callback=rungs.append))
    return rungs, certify(found, 0.05)


def test_every_picture_is_a_control_plot_and_takes_its_keywords(pair):
    for plot, data in pictures(*pair).items():
        made = plot(data)
        assert isinstance(made, control.ControlPlot)
        figure, ax = plt.subplots()
        given = plot(data, ax=ax, title="A title", legend_loc=False)
        assert given.figure is figure
        assert given.axes[0, 0] is ax
        assert ax.get_title() == "A title"
        assert ax.get_legend() is None
        with pytest.raises(TypeError, match="colour"):
            plot(data, colour="red")
        with pytest.raises(ValueError, match="one matplotlib Axes"):
            plot(data, ax=plt.subplots(1, 2)[1])
        assert plot is plot_graph or all(axis.get_xlabel() for axis in made.axes[-1])
        plt.close("all")


def drawn_inside(figure):
    """Whether everything drawn stays inside the figure."""
    figure.canvas.draw()
    drawn, page = figure.get_tightbbox(figure.canvas.get_renderer()), figure.bbox_inches
    return drawn.x0 >= -0.01 and drawn.y0 >= -0.01 and drawn.x1 <= page.x1 + 0.01 and drawn.y1 <= page.y1 + 0.01


@pytest.mark.parametrize("m", [2, 10])
@pytest.mark.parametrize("width", [6.4, 3.4])
def test_everything_fits_at_notebook_and_column_width(m, width):
    rng = np.random.default_rng(1)
    modes, x0 = ModeSet(random_modes(rng, 3, m)), random_gaussian(rng, 3)
    comparison = compare(modes, x0, {"rollout": Rollout()})
    result = comparison.schedules["rollout"]
    with plt.rc_context({"font.size": 10 if width > 5 else 7}):
        for plot, data in {
            plot_w2: comparison,
            plot_area: comparison,
            plot_switching: result,
            plot_ellipses: result,
        }.items():
            _, ax = plt.subplots(figsize=(width, 0.66 * width), layout="constrained")
            assert drawn_inside(plot(data, ax=ax).figure)


def test_w2_draws_every_mode_the_schedule_and_the_signal(pair):
    modes, x0 = pair
    comparison = compare(modes, x0, {"rollout": Rollout()})
    plot = comparison.plot(stop=30)
    w2, band = plot.axes[:, 0]
    lines = {line.get_label(): line for line in w2.get_lines()}
    assert list(lines) == ["fast", "calm", "rollout"]
    np.testing.assert_allclose(lines["rollout"].get_ydata(), comparison.schedules["rollout"].w2[:30])
    np.testing.assert_allclose(lines["calm"].get_ydata(), comparison.single_w2[1, :30])
    assert [lines[name].get_color() for name in modes.names] == list(COLOURS[:2])
    assert [label.get_text() for label in band.get_yticklabels()] == ["fast", "calm"]
    assert band.get_xlim() == (0, 3.0)
    assert plt.rcParams["axes.grid"] is False


def test_the_signal_is_filled_while_a_mode_is_active(pair):
    result = schedule(*pair, RecedingHorizon(20))
    (switch,) = result.switches
    ax = plot_switching(result, stop=20).axes[0, 0]
    fast, calm = (c.get_paths() for c in ax.collections)
    assert calm[0].get_extents().x1 == pytest.approx(fast[0].get_extents().x0) == pytest.approx(0.1 * switch.step)
    assert fast[0].get_extents().x1 == pytest.approx(2.0)


def test_ellipses_hold_the_probability_they_say(pair):
    modes, x0 = pair
    result = schedule(modes, x0, RecedingHorizon(20))
    ax = plot_ellipses(result, probability=0.8).axes[0, 0]
    samples = np.random.default_rng(1).multivariate_normal(x0.mean, x0.cov, 20_000)
    assert ax.patches[0].get_path().contains_points(samples).mean() == pytest.approx(0.8, abs=0.01)
    by_name = plot_ellipses(result, states=("x[1]", "x[0]")).axes[0, 0]
    assert by_name.get_xlabel().startswith("x[1]")


def test_unstable_modes_and_states_at_the_target_can_be_drawn():
    modes = ModeSet([[[1.5, 0.0], [0.0, 1.5]], [[0.5, 0.0], [0.0, 0.5]]])
    x0 = random_gaussian(np.random.default_rng(1), 2)
    comparison = compare(modes, x0, [Rollout()], steps=2000)
    comparison.plot(stop=2000).figure.canvas.draw()
    texts = [t.get_text() for t in comparison.plot_area().axes[0, 0].texts]
    assert texts[0] == "infinite"
    at_target = schedule(modes, type(x0)([0.0, 0.0], np.zeros((2, 2))), Rollout(), steps=3)
    for plot in (plot_w2, plot_switching, plot_ellipses):
        plot(at_target).figure.canvas.draw()


def test_wrong_input(pair):
    result = schedule(*pair, RecedingHorizon(20))
    with pytest.raises(ValueError, match="never switches"):
        plot_schematic(schedule(*pair, Constant(0)))
    for states in ((0, 0), (0, 2), ("x[0]", "y"), (0,), (0, -1)):
        with pytest.raises(ValueError, match="two different ones of"):
            plot_ellipses(result, states=states)
    with pytest.raises(ValueError, match="probability is 1"):
        plot_ellipses(result, probability=1)
    for plot in (plot_w2, plot_area, plot_switching, plot_ellipses, plot_schematic, plot_sweep):
        with pytest.raises(TypeError, match=f"{plot.__name__} draws a"):
            plot([1, 2])
    for stop in (1, 2, 3):
        plot_schematic(result, stop=stop)
    with pytest.raises(ValueError, match="stop is 0"):
        plot_w2(result, stop=0)


def test_names_stand_as_they_are():
    modes = ModeSet([[[0.5]], [[0.6]]], names=["$\\foo$", "a_b"], states=["$x$"])
    x0 = random_gaussian(np.random.default_rng(1), 1)
    comparison = compare(modes, x0, {"$\\bar": Rollout()})
    for picture in (comparison.plot(), comparison.plot_area(), plot_switching(comparison.schedules["$\\bar"])):
        picture.figure.canvas.draw()


def test_axes_say_what_they_show(pair):
    modes, x0 = pair
    ellipses = plot_ellipses(schedule(modes, x0, RecedingHorizon(20))).axes[0, 0]
    assert (ellipses.get_xlabel(), ellipses.get_ylabel()) == ("x[0] (state units)", "x[1] (state units)")
    assert "area" in compare(modes, x0, Rollout()).plot_area().axes[0, 0].get_xlabel()
    weighted = ModeSet(modes.A, modes.names, Q=np.diag([1.0, 0.5]))
    assert compare(weighted, x0, Rollout()).plot_area().axes[0, 0].get_xlabel() == "total cost (weighted units)"
    swept = sweep(modes, x0, [1, np.inf], [1, 5])
    ax = swept.plot().axes[0, 0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["1", "∞"]
    assert [text.get_text() for text in ax.texts] == [f"{100 * value:.1f}" for value in swept.relative.ravel()]


def test_a_mode_keeps_its_colour_in_every_picture(pair):
    modes, x0 = pair
    result = schedule(modes, x0, RecedingHorizon(20))
    comparison = compare(modes, x0, {"a": RecedingHorizon(20), "b": Rollout()})
    assert [
        plt.matplotlib.colors.to_hex(bar.get_facecolor()).upper() for bar in comparison.plot_area().lines[0, 0]
    ] == [
        *COLOURS[:2],
        "#000000",
        "#000000",
    ]
    strips = comparison.plot().axes[1, 0].collections
    for strip, shown in zip(strips, comparison.schedules.values(), strict=True):
        runs = [0, *(switch.step for switch in shown.switches)]
        colours = [plt.matplotlib.colors.to_hex(c).upper() for c in strip.get_facecolor()]
        assert colours == [COLOURS[shown.sequence[k]] for k in runs]
    ellipses = plot_ellipses(result).axes[0, 0].patches
    edges = [plt.matplotlib.colors.to_hex(patch.get_edgecolor()).upper() for patch in ellipses]
    assert edges[0] == COLOURS[result.sequence[0]] and edges[-1] == COLOURS[result.sequence[-1]]
    schematic = plot_schematic(result).axes[0, 0]
    assert [line.get_label() for line in schematic.get_lines()[:3]] == ["fast alone", "calm alone", "switched"]
    assert schematic.get_lines()[3].get_xdata()[0] == pytest.approx(0.1 * result.switches[0].step)


def test_time_is_in_seconds_where_there_is_a_period(pair):
    modes, x0 = pair
    seconds, steps = schedule(modes, x0, Rollout()), schedule(ModeSet(modes.A), x0, Rollout())
    for plot in (plot_w2, plot_switching, plot_schematic):
        assert plot(seconds).axes[-1, 0].get_xlabel() == "time (s)"
        assert plot(steps).axes[-1, 0].get_xlabel() == "step k"
    assert plot_w2(seconds, stop=11).axes[0, 0].get_lines()[0].get_xdata()[-1] == pytest.approx(1.0)
    assert len(plot_w2(schedule(modes, x0, Rollout(), steps=5), stop=50).axes[0, 0].get_lines()[0].get_xdata()) == 5


def test_a_graph_shows_every_node_and_move(pair):
    modes, _ = pair
    graph = SwitchingGraph(modes, Rules(min_dwell=3))
    plot = graph.plot(title="dwell")
    ax = plot.axes[0, 0]
    assert len(ax.texts) == len(graph)
    arrows = [patch for patch in ax.patches if isinstance(patch, FancyArrowPatch)]
    colours = [to_hex(arrow.get_edgecolor()).upper() for arrow in arrows]
    for edge_mode in (0, 1):
        edges = [e for e in graph.edges() if e.mode == edge_mode]
        assert colours.count(mode_style(edge_mode)["color"]) == len(edges)
    places = {text.get_position() for text in ax.texts}
    assert len(places) == len(graph)
    with pytest.raises(ValueError, match=r"nodes, a picture shows at most 60; graph.to_networkx\(\) hands it"):
        SwitchingGraph(modes, Rules(min_dwell=40)).plot()
    with pytest.raises(TypeError, match="plot_graph draws a SwitchingGraph"):
        switchctl.plotting.plot_graph(modes)


@pytest.mark.parametrize(
    ("over", "label"),
    [("switch_cost", "switches"), ("min_dwell", "least dwell time (steps)"), ("budget", "limit of the budget")],
)
def test_a_trade_off_shows_its_points(pair, over, label):
    modes, x0 = pair
    rules = Rules(budget=Budget(use={"calm": 1}, limit=10))
    trade = trade_off(modes, x0, rules, over=over, values=[0, 5, 10] if over == "budget" else [1, 3])
    ax = trade.plot().axes[0, 0]
    assert ax.get_xlabel().startswith(label)
    assert ax.get_ylabel() == "cost of the state (state units$^2$ · s)"
    assert ax.lines[0].get_ydata() == pytest.approx([row["state"] for row in trade.rows()])
    with pytest.raises(TypeError, match="plot_trade_off draws a TradeOff"):
        switchctl.plotting.plot_trade_off(modes)


def test_a_trade_off_without_a_finite_cost_has_no_picture(pair):
    modes, x0 = pair
    trade = trade_off(modes, x0, Rules(max_dwell=2), over="min_dwell", values=[3])
    with pytest.raises(ValueError, match="no setting has a schedule of finite cost"):
        trade.plot()


def test_the_tree_has_every_prefix(pair):
    rungs, certificate = search_of(*pair)
    ax = plot_tree(certificate).axes[0, 0]
    *_, ends = ax.get_lines()
    tree = certificate.document["witness"]["tree"]
    assert len(ends.get_xdata()) == sum(token >= 0 for token in tree)
    with pytest.raises(TypeError, match="plot_tree draws a Certificate"):
        plot_tree(rungs)
    with pytest.raises(TypeError, match="a list of Rung"):
        plot_bounds([])
    found, proven = plot_bounds(rungs).axes[0, 0].get_lines()
    assert found.get_ydata()[-1] == proven.get_ydata()[-1] == pytest.approx(rungs[-1].gap)
