"""The command line, as a user at a shell meets it."""

import csv
import json
import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.io

from switchctl import Schedule
from switchctl.certificates.check import check
from switchctl.cli import main
from switchctl.models import five_mode

PYTHON_MODEL = """
import control, numpy as np, switchctl
def plant(): return control.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), 0)
def controllers(): return {"stiff": [[40, 10]], "soft": [[1, 1]]}
def initial_state(): return switchctl.Gaussian([1, 0], 0.01 * np.eye(2))
"""


def run(capsys, *words):
    code = main(list(words))
    out, err = capsys.readouterr()
    return code, out, err


def test_run_prints_a_table_and_saves_its_files(capsys, tmp_path):
    code, out, err = run(capsys, "run", "quadrotor", "--save", str(tmp_path / "deep" / "out"))
    assert (code, err) == (0, "")
    assert "high" in out and "1 (low -> high at step 50)" in out and "gain over the best single mode: 8.83 %" in out
    assert sorted(p.name for p in (tmp_path / "deep" / "out").iterdir()) == [
        "area.png", "schedule.csv", "schedule.json", "w2.png",
    ]  # fmt: skip
    assert f"saved {tmp_path / 'deep' / 'out' / 'schedule.csv'}" in out
    result = Schedule.load(tmp_path / "deep" / "out" / "schedule.json")
    assert (tmp_path / "deep" / "out" / "w2.png").stat().st_size > 20_000
    with open(tmp_path / "deep" / "out" / "schedule.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["k", "time", "index", "name", "w2"]
    assert [int(row["index"]) for row in rows] == result.sequence.tolist()
    assert rows[50]["name"] == "high"


def test_options_reach_the_method(capsys):
    words = ["--method", "receding-horizon", "--horizon", "5", "--hold", "5", "--json"]
    _, out, _ = run(capsys, "run", "five_mode", *words)
    record = json.loads(out)["schedules"][0]
    assert record["method"] == "RecedingHorizon(horizon=5, hold=5)"
    assert record["cost"] == pytest.approx(117.760, abs=5e-4)
    _, out, _ = run(capsys, "run", "quadrotor", "--hold", "25", "--json")
    assert json.loads(out)["schedules"][0]["method"] == "RecedingHorizon(horizon=150, hold=25)"
    _, out, _ = run(capsys, "run", "five_mode", "--horizon", "inf", "--decrease", "0.1", "--steps", "4", "--json")
    assert json.loads(out)["schedules"][0]["method"] == "RecedingHorizon(horizon=inf, decrease=0.1)"
    assert json.loads(out)["schedules"][0]["steps"] == 4


@pytest.mark.parametrize(("cov", "trace"), [("2", 4), ("1,3", 4), ("1,0.5,0.5,3", 4), ("1 3", 4)])
def test_the_initial_state_can_be_given(capsys, tmp_path, cov, trace):
    run(capsys, "run", "five_mode", "--mean", "-1,2", "--cov", cov, "--save", str(tmp_path))
    x0 = Schedule.load(tmp_path / "schedule.json").x0
    assert x0.mean.tolist() == [-1, 2]
    assert np.trace(x0.cov) == trace


def test_compare_and_models(capsys):
    code, out, _ = run(capsys, "compare", "five_mode")
    assert code == 0 and "Rollout()" in out and "PointwiseMinimum()" in out
    assert len(json.loads(run(capsys, "compare", "suspension", "--json")[1])["schedules"]) == 5
    code, out, _ = run(capsys, "models")
    assert code == 0 and "quadrotor" in out
    assert set(json.loads(run(capsys, "models", "--json")[1])) == {
        "five_mode",
        "medium_access",
        "quadrotor",
        "servo",
        "suspension",
    }


def test_files_are_named_as_they_were_asked_for(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out = run(capsys, "run", "servo", "--save", "out")[1]
    saved = [line for line in out.splitlines() if line.startswith("saved ")]
    assert saved == [f"saved out/{name}" for name in ("schedule.csv", "schedule.json", "w2.png", "area.png")]


def test_a_python_file(capsys, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(PYTHON_MODEL)
    code, out, _ = run(capsys, "run", str(path))
    assert code == 0 and "stiff" in out and "Rollout()" in out


def test_a_python_file_may_import_its_neighbours_and_hold_its_own_method(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "neighbour_of_mine.py").write_text(PYTHON_MODEL)
    (tmp_path / "with_method.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "import switchctl\n"
        "from neighbour_of_mine import plant, controllers, initial_state\n"
        "@dataclass(frozen=True, repr=False)\n"
        "class Mine(switchctl.Method):\n"
        "    mode: int = 1\n"
        "    def start(self, modes): return switchctl.Constant(self.mode).start(modes)\n"
        "def method(): return Mine()\n"
    )
    code, out, err = run(capsys, "run", str(tmp_path / "with_method.py"))
    assert (code, err) == (0, "") and "Mine()" in out


def test_matrices_in_json_and_mat_files_are_the_same_model(capsys, tmp_path):
    A = [five_mode.A1, five_mode.A2, five_mode.A3, five_mode.A4, five_mode.A5]
    names = ["A1", "A2", "A3", "A4", "A5"]
    mean, cov = [5.0, 5.0], [[2.25, 0.0], [0.0, 2.25]]
    (tmp_path / "m.json").write_text(json.dumps({"A": A, "names": names, "mean": mean, "cov": cov}))
    scipy.io.savemat(tmp_path / "stack.mat", {"A": np.moveaxis(np.array(A), 0, -1), "mean": mean, "cov": cov})
    cells = np.empty((1, 5), dtype=object)
    cells[0, :] = [np.array(a) for a in A]
    named = np.empty((1, 5), dtype=object)
    named[0, :] = names
    scipy.io.savemat(
        tmp_path / "steps.mat", {"A": np.moveaxis(np.array(A), 0, -1), "dt": True, "mean": mean, "cov": cov}
    )
    scipy.io.savemat(tmp_path / "cells.mat", {"A": cells, "names": named, "dt": 1.0, "mean": mean, "cov": cov})
    outs = []
    for file in ("m.json", "stack.mat", "cells.mat", "steps.mat"):
        code, out, err = run(capsys, "run", str(tmp_path / file), "--method", "pointwise", "--json")
        assert (code, err) == (0, "")
        outs.append(json.loads(out))
    costs = [out["schedules"][0]["cost"] for out in outs]
    assert costs == pytest.approx([77.77369815] * 4, abs=1e-8)
    assert [m["name"] for m in outs[2]["modes"]] == names
    assert outs[2]["dt"] == 1.0 and outs[3]["dt"] is True


def test_weights_in_a_mat_file_are_stacked_as_its_matrices(capsys, tmp_path):
    A, Q = np.stack([0.5 * np.eye(2), 0.6 * np.eye(2)]), np.stack([np.diag([1.0, 3.0]), np.diag([2.0, 0.0])])
    for file, weight in (("stack.mat", np.moveaxis(Q, 0, -1)), ("one.mat", Q[0])):
        content = {"A": np.moveaxis(A, 0, -1), "Q": weight, "mean": [1.0, 1.0], "states": np.array(["a", "b"])}
        scipy.io.savemat(tmp_path / file, content)
        assert run(capsys, "run", str(tmp_path / file), "--save", str(tmp_path))[0] == 0
        modes = Schedule.load(tmp_path / "schedule.json").modes
        np.testing.assert_array_equal(modes.Q, Q if file == "stack.mat" else np.stack([Q[0]] * 2))
        assert modes.states == ("a", "b")


def test_an_unstable_mode_is_reported(capsys, tmp_path):
    (tmp_path / "m.json").write_text(json.dumps({"A": [[[1.1]], [[0.5]]], "mean": [1.0]}))
    code, out, _ = run(capsys, "run", str(tmp_path / "m.json"))
    assert code == 0 and "inf" in out
    assert json.loads(run(capsys, "run", str(tmp_path / "m.json"), "--json")[1])["modes"][0]["cost"] is None
    (tmp_path / "m.json").write_text(json.dumps({"A": [[[1.1]]], "mean": [1.0]}))
    code, out, _ = run(capsys, "compare", str(tmp_path / "m.json"))
    assert code == 2


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run", "octocopter"], "no bundled model and no file is named 'octocopter'"),
        (["run", "{}/a.py"], "offers neither modes() nor plant() and controllers()"),
        (["run", "{}/broken.py"], "broken.py: SyntaxError"),
        (["run", "{}/raises.py"], "raises.py, line 2: ZeroDivisionError: division by zero"),
        (["run", "{}/wrong.py"], "modes() returned a int; expected a ModeSet"),
        (["run", "{}/data.py"], "modes must be a function"),
        (["run", "{}/nothing.json"], "holds no A"),
        (["run", "{}/more.json"], "holds 'B'; expected only A, Q"),
        (["run", "{}/text.json"], "is not a JSON file"),
        (["run", "{}/cov.json", "--mean", "1"], "holds cov without mean"),
        (["run", "{}/list.json"], "holds a JSON list"),
        (["run", "{}/nan.json"], "nan.json: A[0][0, 0] is nan"),
        (["run", "{}/text.mat"], "is not a .mat file"),
        (["run", "{}/readme.md"], "ends in '.md'"),
        (["run", "{}"], "no file is named"),
        (["run", "{}/stateless.json"], "has no initial state; give --mean"),
        (["run", "five_mode", "--mean", "1,2,3"], "--mean has 3 numbers; expected 2"),
        (["run", "five_mode", "--cov", "1,2,3"], "--cov has 3 numbers; expected 1, 2 or 4"),
        (["run", "five_mode", "--cov=-1"], "least eigenvalue is -1"),
        (["run", "five_mode", "--cov", "1,2,0,1"], "not symmetric"),
        (["run", "five_mode", "--mean", "1,nan"], "mean[1] is nan"),
        (["run", "five_mode", "--steps", "0"], "steps is 0"),
        (["run", "five_mode", "--horizon", "0"], "horizon is 0"),
        (["run", "five_mode", "--method", "receding-horizon"], "a receding horizon needs --horizon T"),
        (["run", "five_mode", "--method", "rollout", "--hold", "3"], "--hold goes with --method receding-horizon"),
        (["run", "five_mode", "--decrease", "2", "--horizon", "3"], "decrease is 2.0"),
        (["run", "five_mode", "--save", "{}/readme.md"], "readme.md' names no folder"),
        (["run", "five_mode", "--save", "{}/readme.md/sub"], "sub' names no folder; name one that"),
    ],
)
def test_a_users_mistake_is_one_line_and_exit_code_2(capsys, tmp_path, words, told):
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "broken.py").write_text("def modes(:\n")
    (tmp_path / "raises.py").write_text("def modes():\n    return 1 / 0\n")
    (tmp_path / "wrong.py").write_text("def modes(): return 3\n")
    (tmp_path / "data.py").write_text("modes = 3\n")
    (tmp_path / "nothing.json").write_text("{}")
    (tmp_path / "more.json").write_text('{"A": [[[0.5]]], "B": 1}')
    (tmp_path / "text.json").write_text("A = 3")
    (tmp_path / "cov.json").write_text('{"A": [[[0.5]]], "cov": [[1]]}')
    (tmp_path / "list.json").write_text("[1]")
    (tmp_path / "nan.json").write_text('{"A": [[[NaN]]], "mean": [1]}')
    (tmp_path / "stateless.json").write_text('{"A": [[[0.5]]]}')
    (tmp_path / "text.mat").write_text("A = 3")
    (tmp_path / "readme.md").write_text("A = 3")
    code, out, err = run(capsys, *(word.replace("{}", str(tmp_path)) for word in words))
    assert (code, out) == (2, "")
    assert err.startswith("switchctl: error: ") and err.count("\n") == 1
    assert told in err


@pytest.mark.parametrize(
    "words", [[], ["fly"], ["run"], ["run", "servo", "--horizon", "x"], ["run", "servo", "--mean", "a"]]
)
def test_wrong_usage_exits_with_2(capsys, words):
    with pytest.raises(SystemExit) as exit_:
        main(words)
    assert exit_.value.code == 2
    assert "usage: switchctl" in capsys.readouterr().err


def test_as_a_process():
    command = [sys.executable, "-m", "switchctl.cli"]
    good = subprocess.run([*command, "run", "five_mode"], capture_output=True, text=True, encoding="utf-8")
    assert good.returncode == 0 and "77.7737" in good.stdout
    bad = subprocess.run([*command, "run", "nowhere"], capture_output=True, text=True)
    assert bad.returncode == 2 and "Traceback" not in bad.stderr
    version = subprocess.run([*command, "--version"], capture_output=True, text=True)
    assert version.stdout.startswith("switchctl ")


def test_an_interrupted_schedule_is_shown_and_the_exit_code_tells(capsys, tmp_path):
    (tmp_path / "cut.py").write_text(
        PYTHON_MODEL + "def horizon(j):\n    if j == 3: raise KeyboardInterrupt\n    return 5\n"
        "def method(): return switchctl.RecedingHorizon(horizon)\n"
    )
    code, out, err = run(capsys, "run", str(tmp_path / "cut.py"))
    assert (code, err) == (130, "switchctl: interrupted\n")
    assert "schedule (interrupted)" in out and "3 steps" in out


def test_a_terminal_that_knows_no_trees():
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "switchctl.cli", "run", "servo"]
    ran = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert ran.returncode == 0 and "gain over" in ran.stdout


def test_interrupted(capsys, monkeypatch):
    monkeypatch.setattr("switchctl.cli.load_model", lambda name: (_ for _ in ()).throw(KeyboardInterrupt))
    assert run(capsys, "run", "servo") == (130, "", "switchctl: interrupted\n")


def test_everything_in_a_json_file_counts(capsys, tmp_path):
    content = {"A": [[[0.5]], [[0.9]]], "dt": 0.1, "Q": [[4.0]], "mean": [2.0], "states": ["level"]}
    (tmp_path / "m.json").write_text(json.dumps(content))
    assert run(capsys, "run", str(tmp_path / "m.json"), "--save", str(tmp_path))[0] == 0
    saved = Schedule.load(tmp_path / "schedule.json")
    assert (saved.modes.dt, saved.modes.states, saved.modes.Q[1].tolist()) == (0.1, ("level",), [[4.0]])
    assert saved.x0.cov.tolist() == [[0.0]]
    assert saved.cost == pytest.approx(0.1 * 4 * 4 / 0.75)


def test_a_mat_file_with_one_mode(capsys, tmp_path):
    scipy.io.savemat(tmp_path / "one.mat", {"A": 0.5 * np.eye(2), "mean": [1.0, 1.0], "names": np.array(["only "])})
    record = json.loads(run(capsys, "run", str(tmp_path / "one.mat"), "--json")[1])
    assert [mode["name"] for mode in record["modes"]] == ["only"]


def test_compare_passes_its_options_on(capsys):
    record = json.loads(run(capsys, "compare", "five_mode", "--steps", "4", "--mean", "1,0", "--cov", "0", "--json")[1])
    assert {schedule["steps"] for schedule in record["schedules"]} == {4}
    assert record["modes"][1]["cost"] < 10


def test_a_mode_that_does_not_exist_is_told_without_quotes(capsys, tmp_path):
    (tmp_path / "m.py").write_text(PYTHON_MODEL + "def method(): return switchctl.Constant('medium')\n")
    assert run(capsys, "run", str(tmp_path / "m.py"))[2] == (
        "switchctl: error: no mode is named 'medium'; the modes are stiff, soft\n"
    )


def test_a_reader_that_leaves_early_is_no_error():
    command = f"{sys.executable} -m switchctl.cli compare five_mode | head -1"
    piped = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True)
    assert "Traceback" not in piped.stderr


def test_rules_at_the_shell(capsys, tmp_path):
    code, out, _ = run(capsys, "run", "five_mode", "--method", "few-switches", "--max-switches", "2", "--json")
    (told,) = json.loads(out)["schedules"]
    assert code == 0
    assert (told["method"], len(told["switches"])) == ("FewSwitches(max_switches=2)", 2)
    words = ("run", "five_mode", "--method", "refine", "--min-dwell", "3", "--switch-cost", "0.5")
    code, out, _ = run(capsys, *words, "--save", str(tmp_path))
    assert "Rules(min_dwell=3, switch_cost=0.5)" in out
    assert min(Schedule.load(tmp_path / "schedule.json").dwell_times[:-1]) >= 3
    code, out, _ = run(capsys, "compare", "five_mode", "--min-dwell", "2")
    assert (code, "Rollout()" in out) == (0, True)
    path = tmp_path / "plant.py"
    path.write_text(PYTHON_MODEL + "def rules(): return switchctl.Rules(max_dwell=7)\n")
    code, out, _ = run(capsys, "run", str(path), "--min-dwell", "2")
    assert (code, "Rules(min_dwell=2, max_dwell=7)" in out) == (0, True)
    code, out, _ = run(capsys, "run", str(path), "--no-rules")
    assert (code, "Rules" in out) == (0, False)
    for rules in ('start=("soft", 2)', 'start=("soft", 0.02), time_unit="s"'):  # steps in whatever unit the model has
        path.write_text(PYTHON_MODEL + f"def rules(): return switchctl.Rules({rules})\n")
        _, out, _ = run(capsys, "run", str(path), "--min-dwell", "7", "--save", str(tmp_path))
        planned = Schedule.load(tmp_path / "schedule.json")
        assert planned.graph.least_dwells == [7, 7]


def test_a_schedule_is_no_model(capsys, tmp_path):
    run(capsys, "run", "five_mode", "--save", str(tmp_path))
    code, _, err = run(capsys, "run", str(tmp_path / "schedule.json"))
    assert (code, "is a switchctl schedule, no model; expected only A" in err) == (2, True), err


def test_a_models_own_few_switches_are_run(capsys, tmp_path):
    path = tmp_path / "plant.py"
    path.write_text(PYTHON_MODEL + "def method(): return switchctl.FewSwitches(1)\n")
    code, out, _ = run(capsys, "run", str(path))
    assert (code, "FewSwitches(max_switches=1)" in out) == (0, True)
    code, out, _ = run(capsys, "run", str(path), "--method", "few-switches", "--max-switches", "2")
    assert (code, "FewSwitches(max_switches=2)" in out) == (0, True)
    path.write_text(PYTHON_MODEL + "def rules(): return 5\n")
    for words, told in (
        (("run", "five_mode", "--method", "few-switches"), "few-switches needs --max-switches N"),
        (("run", "five_mode", "--method", "optimal", "--gap", "0"), "gap is 0.0; expected"),
        (("run", "five_mode", "--method", "rollout", "--time-limit", "3"), "--time-limit goes with --method optimal"),
        (("run", "five_mode", "--method", "optimal", "--horizon", "3"), "--horizon goes with --method receding"),
        (("run", "five_mode", "--min-dwell", "0"), "min_dwell is 0; expected at least 1"),
        (("run", "five_mode", "--method", "refine", "--horizon", "3"), "--horizon goes with --method receding-horizon"),
        (("run", str(path)), "rules() returned a int; expected a Rules"),
    ):
        code, _, err = run(capsys, *words)
        assert (code, told in err) == (2, True), err


def test_the_optimum_at_the_shell(capsys, tmp_path):
    code, out, _ = run(capsys, "run", "five_mode", "--method", "optimal", "--gap", "1e-6", "--save", str(tmp_path))
    assert (code, "no sequence costs less than" in out) == (0, True)
    assert "saved" in out
    check(json.loads((tmp_path / "certificate.json").read_text()))
    code, out, _ = run(capsys, "run", "five_mode", "--method", "optimal", "--json")
    (told,) = json.loads(out)["schedules"]
    assert 0 <= told["cost"] - told["lower_bound"] <= 1e-3 * told["cost"]
    _, out, err = run(capsys, "run", "five_mode", "--method", "rollout", "--save", str(tmp_path))
    assert (err, (tmp_path / "certificate.json").exists()) == ("", False)  # an older one is of another schedule
    words = ("--method", "optimal", "--gap", "1e-12", "--time-limit", "0.01")
    code, _, err = run(capsys, "run", "quadrotor", *words, "--save", str(tmp_path))
    assert "no certificate: the search ended before its gap was proven (time limit)" in err


def test_a_report_with_its_certificates(tmp_path, capsys):
    assert main(["report", "five_mode", "--time-limit", "5", "--save", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "Report: 5 modes" in out and "worst cycle found" in out
    claims = sorted(tmp_path.glob("*.json"))
    assert {path.stem for path in claims} >= {"joint_spectral_radius", "dwell_time", "switching_help"}
    for path in claims:
        check(json.loads(path.read_text()))
    assert (tmp_path / "report.txt").read_text().startswith("Report: 5 modes")
    assert (tmp_path / "report.png").stat().st_size > 10_000
    assert main(["report", "nowhere"]) == 2
