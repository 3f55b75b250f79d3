"""Damaged files: every bit flipped, every truncation, failed and killed writes. Nothing is silently wrong or lost."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from switchctl import Budget, FormatError, Gaussian, ModeSet, Refine, Rollout, Rules, Schedule, schedule
from switchctl.certificates import Certificate, certify, check
from switchctl.files import LARGEST

SMALL = ModeSet([[[0.5, 0.25], [0.0, 0.5]], [[0.75, 0.0], [0.0, 0.25]]], dt=0.5)
START = Gaussian([1.0, 2.0], np.diag([0.125, 0.0]))


def saved(folder):
    """A schedule with rules, and a certificate."""
    rules = Rules(min_dwell=2, price=[0.1, 0], budget=Budget(use=[1, 0], limit=0.9, window=3))
    return (
        (schedule(SMALL, START, Rollout(), 6, rules=rules).save(folder / "schedule.json"), Schedule.load),
        (certify(schedule(SMALL, START, Refine()), gap=1e-2).save(folder / "certificate.json"), Certificate.load),
    )


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1], ids=["schedule", "certificate"])
def test_every_flipped_bit_is_noticed_or_changes_nothing(tmp_path, which):
    path, load = saved(tmp_path)[which]
    content = path.read_bytes()
    document, refused, same = json.loads(content), 0, 0
    with open(path, "r+b", buffering=0) as file:
        for place, byte in enumerate(content):
            for bit in range(8):
                os.pwrite(file.fileno(), bytes([byte ^ 1 << bit]), place)
                try:
                    load(path)
                except FormatError:
                    refused += 1
                    continue
                assert json.loads(path.read_bytes()) == document
                same += 1
            os.pwrite(file.fileno(), bytes([byte]), place)
    load(path)
    assert refused + same == 8 * len(content)
    assert same < refused / 100  # digits of a number beyond its precision


@pytest.mark.parametrize("which", [0, 1], ids=["schedule", "certificate"])
def test_every_truncation_is_noticed(tmp_path, which):
    path, load = saved(tmp_path)[which]
    content = path.read_bytes().rstrip()
    for length in range(len(content) - 1, -1, -1):
        os.truncate(path, length)
        with pytest.raises(FormatError):
            load(path)


def test_the_checker_accepts_no_flipped_bit(tmp_path, capsys):
    path, _ = saved(tmp_path)[1]
    content = path.read_bytes()
    for place in range(0, len(content), 7):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        if json_or_none(path) != json.loads(content):
            assert check.main([str(path)]) in (1, 2)
    capsys.readouterr()


def json_or_none(path):
    try:
        return json.loads(path.read_bytes())
    except ValueError:
        return None


@pytest.mark.parametrize("call", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=repr)
def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, call, error):
    paths = saved(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr(f"os.{call}", lambda *_: (_ for _ in ()).throw(error))
        for path, load in paths:
            thing = load(path)
            with pytest.raises(type(error)):
                thing.save(path)
            with pytest.raises(type(error)):
                thing.save(tmp_path / "new.json")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
from switchctl import Rollout, Schedule, schedule
from switchctl.models import five_mode

path = Path(sys.argv[1])
both = [schedule(five_mode.modes(), five_mode.initial_state(), Rollout(), steps) for steps in (300, 3000)]
both[0].save(path)
random.seed(7)
for kill in range(60):
    child = os.fork()
    if child == 0:
        while True:
            for each in both:
                each.save(path)
    time.sleep(random.uniform(0, 0.03))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert len(Schedule.load(path)) in (300, 3000)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_killed_write_leaves_a_whole_file(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "s.json")], check=True, timeout=120)


FULL = """
import resource, signal, sys
from pathlib import Path
from switchctl import Rollout, Schedule, schedule
from switchctl.models import five_mode

path = Path(sys.argv[1])
long, short = (schedule(five_mode.modes(), five_mode.initial_state(), Rollout(), steps) for steps in (9000, 30))
short.save(path)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    long.save(path)
except OSError:
    assert len(Schedule.load(path)) == 30 and len(list(path.parent.iterdir())) == 1
    print("refused")
"""


def test_a_file_that_is_too_large_for_the_disk_leaves_the_old_one(tmp_path):
    pytest.importorskip("resource")
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path / "s.json")], capture_output=True, text=True)
    assert done.stdout == "refused\n", done.stderr


def test_large_files_and_keys_that_come_twice_are_refused(tmp_path, monkeypatch):
    path, load = saved(tmp_path)[0]
    text = path.read_text()
    path.write_text(text.replace('"dt":', '"dt": 0.5, "dt":', 1))
    with pytest.raises(FormatError, match="the key 'dt' comes twice"):
        load(path)
    with open(path, "wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(FormatError, match=f"more than {LARGEST} bytes"):
        load(path)
    with pytest.raises(FormatError, match="is not a JSON file"):
        path.write_text("[" * 100_000)
        load(path)
    monkeypatch.setattr("switchctl.files.LARGEST", 1000)
    with pytest.raises(ValueError, match=r"would take \d+ bytes; of more than 1000 it could not be read again"):
        schedule(SMALL, START, Rollout(), 500).save(path)
    assert path.read_text() == "[" * 100_000
