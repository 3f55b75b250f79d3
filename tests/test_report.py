"""The page of a report: its facts, what is told where a part fails or is not done, and its picture."""

import signal
import sys

import control
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import Rectangle
from random_cases import random_modes

import switchctl.stability
from switchctl import Gaussian, ModeSet, Rules, SwitchingGraph, single_mode_costs
from switchctl.models import five_mode, quadrotor, servo
from switchctl.plotting import plot_report
from switchctl.stability import AverageDwellTime, Report, joint_spectral_radius, report
from switchctl.stability.transient_growth import power_norms, transient_growth

MODULE = sys.modules["switchctl.stability.report"]
ALTERNATING = ModeSet([[[0.0, 2.0], [0.0, 0.5]], [[0.5, 0.0], [2.0, 0.0]]], names=["up", "down"], dt=0.1)
UNSTABLE = ModeSet([[[2.0, 0.0], [0.0, 0.25]], [[0.25, 0.0], [0.0, 2.0]]])
X0 = Gaussian([1.0, 1.0], 0.01 * np.eye(2))
PARTS = (
    "spectral_radii transient_growth costs joint_spectral_radius dwell_time dwell_times average_dwell_time "
    "stabilising_word switching_help pairs"
).split()


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def paper():
    return report(five_mode.modes(), five_mode.initial_state(), time_limit=20)


def rows(text, start):
    """The words of the first line that begins so."""
    return next(line for line in text.splitlines() if line.strip("├└─ │").startswith(start)).split()


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("radius", [0.5, 0.99, 0.999])
@pytest.mark.parametrize("kind", ["dense", "triangular", "slow", "skewed"])
def test_transient_growth_is_that_of_all_powers(n, radius, kind):
    rng = np.random.default_rng([n, int(1000 * radius)])
    A = rng.standard_normal((n, n))
    if kind == "triangular":
        A = np.triu(A)
    elif kind == "slow":
        A = np.eye(n) + 1e-3 * A
    elif kind == "skewed":
        D = np.diag(10.0 ** rng.uniform(-2, 2, n))
        A = np.linalg.inv(D) @ np.linalg.qr(A)[0] @ D
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    powers, M = [], np.eye(n)
    while not powers or (np.linalg.norm(M) > 1e-6 and len(powers) < 30_000):
        powers.append(np.linalg.norm(M, 2))
        M = A @ M
    found = transient_growth(A, "stable")
    assert found.lower == pytest.approx(max(powers), rel=2e-9)
    assert max(powers) <= found.upper * (1 + 1e-9)
    assert found.upper <= found.lower * (1 + 1e-6)
    assert powers[found.step] == pytest.approx(found.lower, rel=1e-9)


def test_transient_growth_far_away():
    r = 1 - 1e-6  # k r^(k-1) is greatest at 1 / -ln(r)
    found = transient_growth(np.array([[r, 1.0], [0.0, r]]), "stable")
    assert found.step == pytest.approx(1e6, rel=1e-2)
    assert found.lower == pytest.approx(1e6 / np.e, rel=1e-4)
    assert np.isfinite(found.upper)
    plateau = transient_growth(np.array([[1 - 1e-9, 1.0], [0.0, 0.5]]), "stable")
    assert plateau.lower == pytest.approx(np.sqrt(5), rel=1e-6)
    assert plateau.upper == pytest.approx(np.sqrt(5), rel=1e-6)


def test_transient_growth_of_what_is_not_stable():
    assert transient_growth(np.array([[1.1]]), "unstable") == (np.inf, np.inf, None)
    turning = transient_growth(np.array([[0.0, 2.0], [-0.5, 0.0]]), "undecided")
    assert (turning.lower, turning.upper, turning.step) == (2.0, np.inf, 1)
    assert str(turning) == "2 to inf"


def test_power_norms():
    A = random_modes(np.random.default_rng(1), 3, 1)[0]
    k = np.array([0, 1, 2, 7, 64])
    expected = [np.linalg.norm(np.linalg.matrix_power(A, j), 2) for j in k.tolist()]
    np.testing.assert_allclose(power_norms(A, k), expected)


def test_the_papers_first_example(paper):
    assert all(getattr(paper, part) is not None for part in PARTS if part != "stabilising_word")
    text = repr(paper)
    assert max(map(len, text.splitlines())) <= 100
    assert rows(text, "A5") == ["A5", "0.818035", "stable", "1.84126", "2", "818.477"]
    assert rows(text, "A2")[-1] == "best"
    assert "not stable: the worst cycle does not vanish" in text
    assert rows(text, "all modes alike")[-2:] == ["3", "steps"]
    assert "saves 43.1 to 43.2 % of the best single mode's cost" in text
    assert "stabilising word" not in text
    pair = ModeSet(paper.modes.A[[2, 4]])
    assert paper.pairs.lower[2, 4] == paper.pairs.lower[4, 2] == pytest.approx(joint_spectral_radius(pair).lower)
    assert "1.1013*" in text
    np.testing.assert_allclose(np.diag(paper.pairs.lower), paper.modes.spectral_radii)
    verdicts = np.array(paper.pairs.verdicts)
    assert {tuple(pair) for pair in np.argwhere(verdicts == "unstable").tolist()} == {(2, 4), (4, 2)}
    assert (verdicts != "undecided").all()


def test_html_is_one_caption_and_small_tables(paper):
    html = paper._repr_html_()
    assert html.count("<strong>") == 1
    assert html.count("<table>") == html.count("</table>") == 5
    assert "1.84126" in html and "1.1013*" in html
    odd = report(ModeSet([[[0.5]]], names=["<b>"]))
    assert "<b>" not in odd._repr_html_()


def test_where_arbitrary_switching_is_stable_no_dwell_time_is_needed():
    found = report(servo.modes(), servo.initial_state())
    assert found.joint_spectral_radius.verdict == "stable"
    assert (found.dwell_time.lower, found.dwell_time.upper) == (1, 1)
    assert found.dwell_times.dwell == (1, 1)
    assert found.average_dwell_time is None
    assert found.reasons["average_dwell_time"] == "none is needed: arbitrary switching is stable"
    assert found.pairs.verdicts == [["stable", "stable"]] * 2
    assert "23 (0.023 s)" in repr(found)


def test_a_search_for_the_side_of_1_decides_what_the_bounds_leave_open():
    found = report(quadrotor.modes("closed_loop"), time_limit=30)
    assert found.joint_spectral_radius.verdict == "stable"
    assert found.joint_spectral_radius.lower == pytest.approx(found.modes.spectral_radii.max())


def test_unstable_modes():
    found = report(UNSTABLE, X0)
    text = repr(found)
    assert "mode 'A0' is not Schur stable" in text
    assert text.count("is not Schur stable") == 1
    assert "A0 A1 repeated, rate 0.707107 a step" in text
    assert all(growth.lower == np.inf for growth in found.transient_growth)
    assert np.isinf(found.costs).all() and "best" not in text.splitlines()[4]
    found.plot().figure.canvas.draw()


def test_under_rules():
    rules = Rules(min_dwell=3)
    graph = SwitchingGraph(ALTERNATING, rules)
    for given in (rules, graph):
        found = report(ALTERNATING, X0, given)
        assert found.joint_spectral_radius.verdict == "stable"
        assert found.joint_spectral_radius.upper == joint_spectral_radius(graph).upper
        np.testing.assert_allclose(found.costs, single_mode_costs(graph, X0))
        assert (found.pairs.verdicts[0][1], found.dwell_time.upper) == ("unstable", 3)
        text = repr(found)
        assert "Rules(min_dwell=3)" in text and "Switching under the rules" in text and "without the rules" in text
        assert "under the rules" in found.plot().axes[0, 0].get_legend().get_texts()[1].get_text()
    assert report(ALTERNATING).joint_spectral_radius.cycle == (0, 1)


def test_what_is_not_defined_is_told_in_its_place():
    noisy = report(ModeSet(ALTERNATING.A, W=0.1 * np.eye(2)), X0)
    assert noisy.switching_help is None and noisy.costs is None
    for part in ("switching_help", "costs"):
        assert "noise" in noisy.reasons[part]
    assert "noise" in repr(noisy) and "noise" in noisy._repr_html_()
    assert noisy.dwell_time.upper == 3
    swap = np.tile(np.eye(2), (2, 2, 1, 1))
    swap[0, 1] = [[0.0, 1.0], [1.0, 0.0]]
    activated = report(ModeSet(ALTERNATING.A, activation=swap))
    assert "no activation" in activated.reasons["switching_help"]
    assert activated.pairs.lower[0, 1] == activated.joint_spectral_radius.lower
    assert report(ALTERNATING).reasons["costs"] == "no x0 was given"
    for found in (noisy, activated):
        found.plot()


ATTRIBUTES = {
    "spectral_radii": "schur_stability",
    "transient_growth": "transient_growth",
    "costs": "single_mode_costs",
    "joint_spectral_radius": "joint_spectral_radius",
    "dwell_time": "minimum_dwell_time",
    "dwell_times": "shortened",
    "average_dwell_time": "averaged",
    "switching_help": "does_switching_help",
    "pairs": "_only",
}
THREE = ModeSet([*ALTERNATING.A, 0.5 * np.eye(2)])


@pytest.fixture
def quick(monkeypatch):
    """An average dwell time that is known already."""
    known = AverageDwellTime(THREE, 0.0, 9.0, (), 0.5, 2.0, np.empty(0))
    monkeypatch.setattr(MODULE, "averaged", lambda *arguments: known)


@pytest.mark.parametrize("number, part", list(enumerate(ATTRIBUTES)))
def test_a_part_that_fails_says_so(number, part, quick, monkeypatch):
    error = (ValueError, np.linalg.LinAlgError, FloatingPointError)[number % 3]

    def fails(*arguments, **keywords):
        raise error("rounding hides it")

    monkeypatch.setattr(MODULE, ATTRIBUTES[part], fails)
    found = report(THREE, X0)
    if part == "pairs":
        assert np.isnan(found.pairs.lower[0, 1]) and found.pairs.lower[2, 2] == pytest.approx(0.5)
    else:
        assert getattr(found, part) is None
    assert found.reasons[part] == "rounding hides it"
    assert "rounding hides it" in repr(found)
    assert found.switching_help is not None or part == "switching_help"
    found.plot().figure.canvas.draw()


@pytest.mark.parametrize("part", ATTRIBUTES)
@pytest.mark.parametrize("swallowed", [False, True])
def test_interrupted_it_has_the_parts_done_so_far(part, swallowed, quick, monkeypatch):
    before = signal.getsignal(signal.SIGINT)
    original = getattr(MODULE, ATTRIBUTES[part])

    def interrupted(*arguments, **keywords):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if not swallowed:
                raise
        return original(*arguments, **keywords)

    monkeypatch.setattr(MODULE, ATTRIBUTES[part], interrupted)
    found = report(THREE, X0)
    place = PARTS.index(part)
    done = place + swallowed
    for name in PARTS[:done]:
        assert found.reasons.get(name) != "not done"
    for name in PARTS[max(done, place + 1) :]:
        assert found.reasons[name] == "not done"
        assert getattr(found, name) is None
    assert "not done" in repr(found) or part == "pairs"
    found._repr_html_()
    found.plot().figure.canvas.draw()
    assert signal.getsignal(signal.SIGINT) is before


def test_pairs_that_were_not_done_are_marked(quick, monkeypatch):
    only, count = MODULE._only, []

    def interrupted(*arguments):
        count.append(1)
        if len(count) == 2:
            raise KeyboardInterrupt
        return only(*arguments)

    monkeypatch.setattr(MODULE, "_only", interrupted)
    found = report(THREE)
    assert found.pairs.verdicts[0][1] == "unstable"
    assert found.pairs.verdicts[0][2] == "not done"
    assert "- not done" in repr(found)
    found.plot()


def test_many_modes_list_their_worst_pairs():
    rng = np.random.default_rng(3)
    A = [r * np.linalg.qr(rng.standard_normal((2, 2)))[0] for r in np.linspace(0.4, 0.9, 8)]
    modes = ModeSet(A, names=[f"controller {i}" for i in range(8)])
    text = repr(report(modes, time_limit=20))
    assert max(map(len, text.splitlines())) <= 100
    assert "the worst 10" in text


def test_wrong_input():
    with pytest.raises(TypeError, match="modes must be a ModeSet"):
        report([[0.5]])
    with pytest.raises(TypeError, match="x0 must be a Gaussian"):
        report(ALTERNATING, [1.0, 1.0])
    with pytest.raises(TypeError, match="rules must be Rules"):
        report(ALTERNATING, rules=3)
    with pytest.raises(ValueError, match="of other modes"):
        report(ALTERNATING, rules=SwitchingGraph(UNSTABLE))
    with pytest.raises(ValueError, match="time_limit is 0"):
        report(ALTERNATING, time_limit=0)
    with pytest.raises(TypeError, match="plot_report draws a Report"):
        plot_report(ALTERNATING)


def test_the_picture_says_what_it_shows(paper):
    plot = paper.plot(title="A title")
    assert isinstance(plot, control.ControlPlot) and plot.axes.shape == (2, 2)
    assert plot.figure.get_suptitle() == "A title"
    radii, transients, pairs, dwell = plot.axes.ravel()
    assert radii.get_xlabel() == "spectral radius (growth per step)"
    assert [bar.get_width() + 1 for bar in radii.patches[:5]] == pytest.approx(paper.modes.spectral_radii)
    assert [label.get_text() for label in dwell.get_yticklabels()] == list(paper.modes.names)
    assert (transients.get_xlabel(), transients.get_yscale()) == ("step k", "log")
    assert transients.get_lines()[0].get_ydata()[0] == 1
    assert dwell.get_xlabel() == "dwell time (steps)"
    assert [text.get_text() for text in pairs.texts][3 * 5 - 1] == "1.1013"
    outlined = [patch for patch in pairs.patches if isinstance(patch, Rectangle)]
    assert {tuple(np.floor(patch.get_xy()).astype(int)) for patch in outlined} == {(2, 4), (4, 2)}
    plot.figure.canvas.draw()
    drawn = plot.figure.get_tightbbox(plot.figure.canvas.get_renderer())
    assert drawn.x0 >= -0.01 and drawn.x1 <= plot.figure.get_figwidth() + 0.01


def test_time_is_in_seconds_where_there_is_a_period():
    found = report(ALTERNATING, time_limit=60)
    axes = found.plot().axes
    assert axes[0, 1].get_xlabel() == "time (s)"
    assert axes[1, 1].get_xlabel() == "dwell time (s)"
    assert axes[1, 1].get_lines()[0].get_xdata()[0] == pytest.approx(0.3)
    assert [bar.get_width() for bar in axes[1, 1].patches] == pytest.approx(0.1 * np.array(found.dwell_times.dwell))


def test_it_is_exported():
    assert {"Report", "report", "PairGrowth", "TransientGrowth"} <= set(switchctl.stability.__all__)
    assert isinstance(report(ModeSet([[[0.5]]])), Report)
