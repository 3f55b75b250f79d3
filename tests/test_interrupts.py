"""Ctrl-C at any moment of any long call: what there is so far, marked so, or KeyboardInterrupt and nothing half done.

Whatever it does, no input changes, nothing global stays changed, no file is left in parts, and asked again it answers
as if there had been no interrupt.
"""

import gc
import inspect
import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from answers import digest
from interrupt_cases import CASES, LIMIT, X0, small
from pair import modes as pair

import switchctl
from switchctl import (
    FewSwitches,
    Optimal,
    RecedingHorizon,
    Refine,
    Rollout,
    Rules,
    SwitchingGraph,
    schedule,
    stability,
)
from switchctl.certificates import certify, check
from switchctl.cli import main
from switchctl.files import write_text
from switchctl.methods.refine import LocalSearch

PACKAGE = str(Path(switchctl.__file__).parent)
GENERATOR = inspect.CO_GENERATOR


class Interrupt:
    """SIGINT at a number of calls, of those within the package."""

    def __init__(self, at=0):
        self.at, self.count = at, 0

    def __call__(self, frame, event, arg):
        code = frame.f_code
        if event == "c_return" or (event == "call" and not code.co_flags & GENERATOR):  # one may be closing
            if not code.co_filename.startswith(PACKAGE):
                return
            self.count += 1
            if self.count == self.at:
                signal.raise_signal(signal.SIGINT)

    def __enter__(self):
        self.handler = signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.setprofile(self)

    def __exit__(self, *error):
        sys.setprofile(None)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, self.handler)


def interrupted(ask, at):
    """The answer (None: KeyboardInterrupt came out), and the calls made."""
    interrupt = Interrupt(at)
    try:
        with interrupt:
            found = ask()
    except KeyboardInterrupt:
        return None, interrupt.count
    return found, interrupt.count


def marked(found):
    """Whether an answer says that it was cut short."""
    if isinstance(found, switchctl.Sweep):
        return bool(np.isnan(found.cost).any())
    if isinstance(found, stability.Report):
        return "not done" in found.reasons.values() or any(
            getattr(getattr(found, name), "status", "") == "interrupted" for name in vars(found)
        )
    return getattr(found, "status", "") == "interrupted"


LONG = {"report", "average_dwell_time", "dwell_times", "dwell_time", "few_three", "trading"}


def true(found, whole):
    """Whether the bounds of an answer cut short agree with those of the whole one."""
    if getattr(found, "lower_bound", None) is not None:
        assert found.lower_bound <= whole.cost * (1 + 1e-12)
        assert found.cost >= whole.lower_bound * (1 - 1e-12)
    elif hasattr(found, "upper"):
        assert found.lower <= whole.upper * (1 + 1e-12)
        assert found.upper >= whole.lower * (1 - 1e-12)
    elif isinstance(found, switchctl.Comparison):
        done = {label: plan.cost for label, plan in found.schedules.items() if "(interrupted)" not in label}
        assert done == {label: whole.schedules[label].cost for label in done}


def files(folder):
    """Every file is whole, and none is left of the writing."""
    for path in Path(folder).iterdir():
        assert path.suffix in (".json", ".csv", ".txt", ".png")
        content = path.read_bytes()
        if path.suffix == ".json":
            json.loads(content)
        elif path.suffix == ".png":
            assert content.endswith(b"IEND\xaeB`\x82")
        else:
            assert content.endswith(b"\n")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LONG else []) for name in CASES]
)
def test_at_any_moment(name, tmp_path):
    CASES[name](tmp_path)[0]()  # imports
    ask, _ = CASES[name](tmp_path)
    whole, total = interrupted(ask, -1)
    expected, errors, parameters = digest(whole), np.geterr(), dict(plt.rcParams)
    for share in (0.001, 0.2, 0.45, 0.7, 0.9):
        ask, modes = CASES[name](tmp_path)
        before = digest(vars(modes)["A"])
        at = max(1, round(share * total))
        found, count = interrupted(ask, at)
        assert count >= at
        if found is not None:
            assert marked(found)
            true(found, whole)
            assert np.geterr() == errors
        assert dict(plt.rcParams) == parameters
        assert digest(vars(modes)["A"]) == before
        files(tmp_path)
        if share in (0.45, 0.9):  # nothing that was cached is half done
            assert digest(ask()) == expected
    plt.close("all")


@pytest.mark.parametrize("seconds", [0.02, 0.15, 0.6])
def test_at_any_time(seconds):
    """By the clock, without anything watching: a long search has a schedule, and its bound is true."""
    from switchctl.models import quadrotor

    modes, x0 = quadrotor.modes(), quadrotor.initial_state()
    handler = signal.signal(signal.SIGALRM, signal.default_int_handler)
    hooks = gc.callbacks[:]
    gc.callbacks.clear()  # hypothesis hooks one in, and what is raised in there is lost
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        found = schedule(modes, x0, Optimal(gap=1e-6, time_limit=60))
    except KeyboardInterrupt:
        found = None  # before there was any
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
        gc.callbacks[:] = hooks
    if found is not None:
        assert found.status == "interrupted"
        assert found.lower_bound <= 45.8205 <= found.cost * (1 + 1e-6)  # the optimum


def once(function):
    """The function, interrupted at its first call alone."""
    calls = []

    def called(*arguments, **keywords):
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return function(*arguments, **keywords)

    return called


def test_within_the_local_search_of_a_search(monkeypatch):
    monkeypatch.setattr(sys.modules["switchctl.methods.optimal"], "_HARD", 1)
    monkeypatch.setattr(LocalSearch, "_sweep", once(LocalSearch._sweep))
    found = schedule(pair(), X0, Optimal(gap=1e-6, time_limit=LIMIT))
    assert found.status == "interrupted"
    assert found.lower_bound < found.cost


def test_in_the_base_of_a_run_that_ends(monkeypatch):
    """A part of a run that ends is no plan."""
    calls = []

    def horizon(j):
        calls.append(j)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return 3

    method = Refine(RecedingHorizon(horizon))
    with pytest.raises(KeyboardInterrupt):
        schedule(pair(), X0, method, 12, terminal=np.eye(2))
    assert schedule(pair(), X0, method, 12, terminal=np.eye(2)).status == "number of steps reached"


def test_between_the_halves_of_a_growth(monkeypatch):
    """The tolerance needs half of the time; what is interrupted in the other half is marked, too."""
    module = sys.modules["switchctl.stability.joint_spectral_radius"]
    bounded, calls = module.bounded, []

    def twice(*arguments):
        calls.append(arguments)
        found = bounded(*arguments)
        return replace(found, lower=0.9, upper=1.1, status=("time limit", "interrupted")[len(calls) - 1])

    monkeypatch.setattr(module, "bounded", twice)
    assert stability.joint_spectral_radius(small()).status == "interrupted"
    assert len(calls) == 2


@pytest.mark.parametrize("method", [Optimal(gap=1e-2), Refine(), FewSwitches(2), RecedingHorizon(5, hold=3), Rollout()])
@pytest.mark.parametrize("share", [0.01, 0.3, 0.6, 0.97])
def test_a_step_online_is_taken_or_not(method, share):
    """Interrupted, it is not: the scheduler is where it was, and decides as if nothing had been."""
    graph = SwitchingGraph(pair(), Rules(min_dwell=2))
    states = [[1.0, 1.0], [0.6, 0.8], [0.4, 0.7], [0.3, 0.5]]
    twin, scheduler = method.start(graph), method.start(graph)
    expected = [twin.step(x) for x in states]
    for k, x in enumerate(states):
        trial = method.start(graph)
        trial.memory = scheduler.memory
        _, total = interrupted(lambda trial=trial, x=x: trial.step(x), -1)
        before = scheduler.memory
        found, _ = interrupted(lambda x=x: scheduler.step(x), max(1, round(share * total)))
        if found is None:
            np.testing.assert_array_equal(scheduler.memory, before)
            found = scheduler.step(x)
        assert found == expected[k]
    np.testing.assert_array_equal(scheduler.memory, twin.memory)


@pytest.mark.parametrize("where", ["os.replace", "shutil.copymode"])
@pytest.mark.parametrize("late", [False, True])
def test_a_file_is_the_old_one_or_the_new_one(monkeypatch, tmp_path, where, late):
    path = tmp_path / "file.txt"
    path.write_text("old")
    name, attribute = where.split(".")
    function = getattr(sys.modules[name], attribute)

    def called(*arguments):
        if late:
            function(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules[name], attribute, called)
    with pytest.raises(KeyboardInterrupt):
        write_text(path, "new")
    assert path.read_text() == ("new" if late and attribute == "replace" else "old")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("words", [["run", "five_mode", "--method", "optimal", "--save"], ["compare", "servo"]])
def test_the_command_line(words, tmp_path, capsys):
    folder = [str(tmp_path)] if words[-1] == "--save" else []
    code, total = interrupted(lambda: main([*words, *folder]), -1)
    assert code == 0
    for old in tmp_path.iterdir():
        old.unlink()
    capsys.readouterr()
    for share in (0.002, 0.3, 0.9):
        code, _ = interrupted(lambda: main([*words, *folder]), round(share * total))
        assert (code, capsys.readouterr().err.splitlines()[-1]) == (130, "switchctl: interrupted")
        files(tmp_path)
    plt.close("all")


def test_the_checker(tmp_path, capsys, monkeypatch):
    path = certify(stability.schur_stability(small())[0]).save(tmp_path / "claim.json")
    monkeypatch.setattr(check, "check", once(check.check))
    assert check.main([str(path)]) == 130
    assert capsys.readouterr() == ("", "interrupted: nothing is decided\n")
    assert check.main([str(path)]) == 0


@pytest.mark.parametrize("delay", [0.0, pytest.param(0.4, marks=pytest.mark.slow)])
def test_a_real_signal_at_a_shell(tmp_path, delay):
    """The folder is made once the model is there; then the search begins."""
    words = ["run", "quadrotor", "--method", "optimal", "--gap", "1e-7", "--time-limit", "600", "--save"]
    folder = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "switchctl.cli", *words, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    end = time.monotonic() + 60
    while not folder.exists() and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.decode().splitlines()[-1].endswith("switchctl: interrupted")
    assert b"Traceback" not in err
    files(folder)
