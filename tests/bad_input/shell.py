"""Rows of the command line: one line that says what to do, exit code 2, nothing written."""

import contextlib
import io
import os
import tempfile
from pathlib import Path

from bad_input.table import refused
from switchctl.cli import main

MODES = '{"A": [[[0.8, 3], [0, 0.5]], [[0.97, 0], [0, 0.8]]], "mean": [1, 1], "names": ["fast", "calm"]}'
START = "import switchctl\ndef modes(): return switchctl.ModeSet([[[0.5]]])\n"
STATE = START + "def initial_state(): return switchctl.Gaussian([1], [[0]])\n"
METHOD = "def method(): return M()\n"
FILES = {
    "m.json": MODES,
    "file": "text",
    "readme.md": "text",
    "empty.json": "",
    "null.json": "null",
    "cut.json": MODES[:20],
    "twice.json": '{"A": [[[0.5]]], "A": [[[0.6]]], "mean": [1]}',
    "texts.json": '{"A": "x"}',
    "ragged.json": '{"A": [[[0.5, 1], [0]]]}',
    "oblong.json": '{"A": [[[0.5, 1]]]}',
    "great.json": '{"A": [[[1e999]]]}',
    "none.json": '{"A": []}',
    "period.json": '{"A": [[[0.5]]], "dt": 0}',
    "weight.json": '{"A": [[[0.5]]], "Q": [[-1]]}',
    "mean.json": '{"A": [[[0.5]]], "mean": [1, 2]}',
    "deep.json": "[" * 100_000,
    "digits.json": '{"A": [[[1' + "0" * 5000 + "]]]}",
    "exits.py": "import sys\nsys.exit(0)\n",
    "nan.py": START.replace("0.5", "float('nan')"),
    "other.py": START + "def initial_state(): return switchctl.Gaussian([1, 2], [[1, 0], [0, 1]])\n",
    "rules.py": STATE + "def rules(): return switchctl.Rules(min_dwell={'slow': 3})\n",
    "dict.py": STATE + "def rules(): return {'min_dwell': 3}\n",
    "class.py": STATE + "def method(): return switchctl.Rollout\n",
    "lazy.py": STATE + "class M(switchctl.Method):\n    def start(self, graph): return None\n" + METHOD,
    "fails.py": STATE
    + "class S(switchctl.Scheduler):\n    def decide(self, S): return S.nothing\n"
    + "class M(switchctl.Method):\n    def start(self, graph): return S(graph)\n"
    + METHOD,
    "memory.py": "def modes(): raise MemoryError\n",
    "old.mat": "text",
}


class Refusal(Exception):
    """What the command line says of a mistake."""


def shell(words):
    """Run the command line in a folder with these files."""
    out, err = io.StringIO(), io.StringIO()
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for name in {word for word in words if word in FILES} | {"m.json", "file"}:
                Path(name).write_text(FILES[name])
            there = sorted(os.listdir())
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                try:
                    code = main(words)
                except SystemExit as end:
                    code = end.code
            assert sorted(os.listdir()) == there
        finally:
            os.chdir(before)
    told = err.getvalue()
    assert (code, out.getvalue()) == (2, "")
    assert told.startswith("switchctl") and told.count("\n") == 1 and "Traceback" not in told
    raise Refusal(told)


def rows(command, *cases):
    """Rows of a command: the words after it, and words of the refusal."""
    return refused(
        f"switchctl {command}",
        shell,
        dict,
        *[
            (
                " ".join(word[:30] for word in words) or repr(words),
                {"words": [command, *words]},
                Refusal,
                *told,
            )
            for words, *told in cases
        ],
    )


WHOLE, REAL = ("x", "", "1.5", "nan"), ("x", "")
OPTIONS = [
    *[
        (["m.json", f"{option}={text}"], f"argument {option}: invalid", f"'{text}'")
        for option, texts in (
            ("--steps", WHOLE),
            ("--horizon", WHOLE),
            ("--hold", WHOLE),
            ("--min-dwell", WHOLE),
            ("--max-switches", WHOLE),
            ("--decrease", REAL),
            ("--gap", REAL),
            ("--time-limit", REAL),
            ("--switch-cost", REAL),
            ("--mean", ("x",)),
            ("--cov", ("1;2",)),
        )
        for text in texts
    ],
    (["m.json", "--steps=0"], "steps is 0; expected at least 1"),
    (["m.json", "--steps=1000000000000"], "3.2e+13 bytes", "ask for fewer steps"),
    (["m.json", f"--steps=1{'0' * 400}"], "steps exceeds 9007199254740992"),
    (["m.json", "--horizon=-1"], "horizon is -1"),
    (["m.json", f"--horizon=1{'0' * 400}"], "horizon exceeds 9007199254740992"),
    (["m.json", "--horizon=3", "--hold=0"], "hold is 0"),
    (["m.json", "--horizon=3", "--hold=1000000000"], "at most 100,000 steps"),
    (["m.json", "--horizon=3", "--decrease=nan"], "decrease is nan"),
    (["m.json", "--horizon=3", "--decrease=1"], "decrease is 1.0"),
    (["m.json", "--method=optimal", "--gap=0"], "gap is 0.0"),
    (["m.json", "--method=optimal", "--gap=nan"], "gap is nan"),
    (["m.json", "--method=optimal", "--time-limit=-1"], "time_limit is -1.0"),
    (["m.json", "--min-dwell=0"], "min_dwell is 0"),
    (["m.json", "--switch-cost=-1"], "switch_cost is -1.0"),
    (["m.json", "--switch-cost=inf"], "switch_cost is inf"),
    (["m.json", "--max-switches=-1"], "max_switches is -1"),
    (["m.json", "--mean=1"], "--mean has 1 numbers; expected 2"),
    (["m.json", "--mean=1,inf"], "mean[1] is inf"),
    (["m.json", "--mean=1e200,1"], "x0 exceeds the floating-point range"),
    (["m.json", "--mean=1e-200,0"], "lost below the floating-point range"),
    (["m.json", "--mean"], "--mean: expected one argument"),
    (["m.json", "--cov=1,2,3"], "--cov has 3 numbers; expected 1, 2 or 4"),
    (["m.json", "--cov=1,2,2,1"], "least eigenvalue is -1"),
    (["m.json", "--cov=1e308"], "x0 exceeds the floating-point range"),
    (["m.json", "--method=few-switches"], "few-switches needs --max-switches N"),
    (["m.json", "--method=receding-horizon"], "needs --horizon T"),
    (["m.json", "--method=rollout", "--horizon=3"], "--horizon goes with --method receding-horizon, not rollout"),
    (["m.json", "--method=optimal", "--hold=3"], "--hold goes with --method receding-horizon, not optimal"),
    (["m.json", "--method=rollout", "--gap=0.1"], "--gap goes with --method optimal"),
    (["m.json", "--method=best"], "invalid choice: 'best'", "rollout"),
    (["m.json", "--best"], "unrecognized arguments: --best"),
    (["m.json", "other.json"], "unrecognized arguments: other.json"),
    (["m.json", "--save=file"], "--save 'file' names no folder"),
    (["m.json", "--save=file/deep"], "names no folder; name one that is there or can be made"),
    (["m.json", "--save="], "--save '' names no folder"),
    ([], "required: MODEL", "usage: switchctl run"),
]
MODELS = [
    (["octocopter"], "no bundled model and no file is named 'octocopter'", "'switchctl models' lists the models"),
    ([""], "no file is named ''"),
    (["readme.md"], "ends in '.md'; expected .py, .json or .mat"),
    (["empty.json"], "empty.json is not a JSON file"),
    (["null.json"], "null.json holds a JSON NoneType; expected an object"),
    (["cut.json"], "cut.json is not a JSON file"),
    (["twice.json"], "the key 'A' comes twice"),
    (["texts.json"], "texts.json: A must be the A_i, shape (m, n, n); got a str"),
    (["ragged.json"], "ragged.json: A[0] is not rectangular"),
    (["oblong.json"], "shape (1, 1, 2)"),
    (["great.json"], "great.json: A[0][0, 0] is inf"),
    (["none.json"], "m and n at least 1"),
    (["period.json"], "dt is 0"),
    (["weight.json"], "least eigenvalue is -1"),
    (["mean.json"], "mean has shape (2,)"),
    (["deep.json"], "deep.json is not a JSON file"),
    (["digits.json"], "digits.json is not a JSON file"),
    (["exits.py"], "exits.py, line 2: SystemExit: 0"),
    (["nan.py"], "nan.py, line 2: ValueError: matrices[0][0, 0] is nan"),
    (["other.py"], "the initial state in other.py has 2 numbers; expected 1"),
    (["rules.py"], "min_dwell: no mode is named 'slow'"),
    (["dict.py"], "rules() returned a dict; expected a Rules"),
    (["class.py"], "expected a Method"),
    (["lazy.py"], "M.start must return a Scheduler, not None"),
    (["fails.py"], "fails.py, line 5: AttributeError"),
    (["memory.py"], "memory.py", "MemoryError"),
]
ROWS = [
    *rows("run", *OPTIONS, *MODELS),
    *rows("run", (["old.mat"], "old.mat is not a .mat file")),
    *rows(
        "compare",
        (["octocopter"], "no bundled model"),
        (["m.json", "--steps=0"], "steps is 0"),
        (["m.json", "--steps=1000000000000"], "3.2e+13 bytes"),
        (["m.json", "--method=rollout"], "unrecognized arguments: --method=rollout"),
        (["m.json", "--save=out"], "unrecognized arguments: --save=out"),
        (["lazy.py"], "M.start must return a Scheduler"),
    ),
    *rows(
        "report",
        (["octocopter"], "no bundled model"),
        (["m.json", "--time-limit=0"], "time_limit is 0.0; expected seconds above 0"),
        (["m.json", "--time-limit=nan"], "time_limit is nan"),
        (["m.json", "--save=file"], "--save 'file' names no folder"),
        (["m.json", "--json"], "unrecognized arguments: --json"),
        (["m.json", "--mean=1"], "--mean has 1 numbers; expected 2"),
    ),
    *rows("models", (["x"], "unrecognized arguments: x"), (["--save=x"], "unrecognized arguments: --save=x")),
    *rows("schedule", (["m.json"], "invalid choice: 'schedule'", "'run', 'compare', 'report', 'models'")),
]
