"""Schedules on disk: tables, saving, loading, damage, copies."""

import copy
import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_cases import random_gaussian, random_modes

from switchctl import (
    Budget,
    Constant,
    FewSwitches,
    FormatError,
    Gaussian,
    ModeSet,
    RecedingHorizon,
    Rollout,
    Rules,
    Schedule,
    SwitchingGraph,
    schedule,
)
from switchctl.files import digest


def seal(path, document):
    """Write a document as if it had been saved as it is."""
    sealed = digest({key: value for key, value in document.items() if key != "sha256"})
    path.write_text(json.dumps(document | {"sha256": sealed}))


def test_pandas_and_csv_have_one_row_a_step(pair, tmp_path):
    result = schedule(*pair, Rollout(), steps=12)
    table = result.to_pandas()
    assert list(table) == ["time", "index", "name", "w2"]
    assert table.index.name == "k"
    read = pandas.read_csv(result.to_csv(tmp_path / "schedule.csv"), index_col="k")
    pandas.testing.assert_frame_equal(table, read, check_dtype=False)
    assert read["w2"].tolist() == pytest.approx(result.w2, rel=1e-15)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_saving_and_loading_is_the_identity(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    modes = ModeSet(
        random_modes(rng, 3, 2), ["a", 'é,"'], 0.1, Q=np.diag([1.0, 2.0, 0.0]), gains=rng.standard_normal((2, 1, 3))
    )
    original = schedule(modes, random_gaussian(rng, 3), RecedingHorizon(4, decrease=0.3), steps=20)
    loaded = Schedule.load(original.save(tmp_path_factory.mktemp("files") / "schedule.json"))
    for name in ("method", "status", "tail", "lengthened", "cost", "switches"):
        assert getattr(loaded, name) == getattr(original, name)
    for name in ("sequence", "w2", "mean", "cov"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(original, name))
    for name in ("A", "Q", "gains", "names", "states", "dt"):
        np.testing.assert_array_equal(getattr(loaded.modes, name), getattr(modes, name))


@pytest.mark.parametrize(
    "rules",
    [
        Rules(min_dwell={"fast": 3}, max_dwell=[math.inf, 9], switch_cost=[[0, 0.1], [0.2, 0]], start=("calm", 2)),
        Rules(transitions={"fast": ["calm"], "calm": [0]}, switch_cost_per_w2=0.1, price={1: 0.5}, max_switches=9),
        Rules(budget=Budget(use={"calm": 0.1}, limit=0.3, window=4), allowed={"fast": [(0, 9), (12, math.inf)]}),
        Rules(min_dwell=0.3, time_unit="s", allowed={"calm": [(0, 0.4)]}, allowed_period=0.8),
    ],
    ids=str,
)
@pytest.mark.parametrize("edges", [None, [("a", "b", 0), ("b", "b", 0), ("b", 3, "calm"), (3, "b", 0), (3, 3, 1)]])
def test_rules_and_automata_are_saved_with_a_schedule(pair, tmp_path, rules, edges):
    modes, x0 = pair
    if edges is not None:
        rules = SwitchingGraph.from_edges(modes, edges, replace(rules, start=None, allowed=None, allowed_period=None))
    original = schedule(modes, x0, FewSwitches(2) if edges is None else Rollout(), steps=9, rules=rules)
    for twin in (
        Schedule.load(original.save(tmp_path / "s.json")),
        pickle.loads(pickle.dumps(original)),
        copy.deepcopy(original),
    ):
        assert twin.graph.rules == original.graph.rules
        assert (twin.graph.successor == original.graph.successor).all()
        for name in ("cost", "cost_parts", "lead", "tail", "switches", "statistics"):
            assert getattr(twin, name) == getattr(original, name)


def test_a_saved_sequence_against_its_rules_is_refused(pair, tmp_path):
    modes, x0 = pair
    path = schedule(modes, x0, Rollout(), steps=20, rules=Rules(min_dwell=5)).save(tmp_path / "s.json")
    document = json.loads(path.read_text())
    for change, words in (
        ({"sequence": [1, 0] * 10}, "step 1: mode 'fast' is not allowed"),
        ({"rules": {"min_dwell": -1}}, "min_dwell is -1"),
        ({"rules": {"dwell": 1}}, "damaged schedule"),
        ({"rules": 5}, "damaged schedule"),
        ({"rules": {"start": {"by mode": 3}}}, "damaged schedule"),
        ({"edges": [[1]]}, "damaged schedule"),
        ({"lead": [9]}, "damaged schedule"),
        ({"statistics": 7}, "damaged schedule"),
        ({"statistics": [[0.97, 0.0], [0.0, 0.8]]}, "damaged schedule: statistics must be a dict of numbers"),
    ):
        seal(path, document | change)
        with pytest.raises(FormatError, match=words):
            Schedule.load(path)


def test_a_file_without_period_and_with_an_infinite_cost(tmp_path):
    original = schedule(ModeSet([[[1.1]]]), Gaussian([1.0], [[0.0]]), Constant(0), steps=3)
    loaded = Schedule.load(original.save(tmp_path / "s.json"))
    assert loaded.modes.dt is True
    assert loaded.cost == math.inf


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(format="switchctl certificate"), "is not a switchctl schedule"),
        (lambda d: d.update(version=99), "has version 99"),
        (lambda d: d.pop("sequence"), "damaged schedule: it lacks 'sequence'"),
        (lambda d: d["sequence"].__setitem__(0, 7), r"damaged schedule: sequence\[0\]: mode 7 is out of range"),
        (lambda d: d["A"][0][0].pop(), "damaged schedule"),
        (lambda d: d.update(cost=1.0), "states the cost 1.0"),
        (lambda d: d.update(rules=json.loads("[" * 600 + "]" * 600)), "damaged schedule"),
        (lambda d: d.update(cost=[d["cost"]]), "damaged schedule: cost must be a number"),
        (lambda d: d.update(cost=d["cost"] * (1 + 1e-5)), "states the cost"),
        (lambda d: d.update(cov=[[1, 2], [2, 1]]), "least eigenvalue"),
        (lambda d: d.update(cost="abc"), "damaged schedule"),
        (lambda d: d.update(cost=10**400), "damaged schedule"),
        (lambda d: d.update(dt=10**400), "floating-point range"),
        (lambda d: d.update(method=5), "5 stands where a text should"),
        (lambda d: d.update(names={"fast": 1, "calm": 2}), "where a list should"),
        (lambda d: d.update(lengthened=[[1, 2.5]]), "lengthened is 2.5"),
        (lambda d: d.update(A=(1e200 * np.ones((2, 2, 2))).tolist()), "floating-point range"),
    ],
)
def test_a_damaged_file_is_a_format_error(pair, tmp_path, change, words):
    path = schedule(*pair, Rollout(), steps=5).save(tmp_path / "s.json")
    document = json.loads(path.read_text())
    change(document)
    seal(path, document)
    with pytest.raises(FormatError, match=words):
        Schedule.load(path)


def test_other_files_are_format_errors(tmp_path):
    for content in (b"", b"{", b"\xff\xfe", b"[1, 2]", b"k,time\n0,0\n"):
        (tmp_path / "s.json").write_bytes(content)
        with pytest.raises(FormatError):
            Schedule.load(tmp_path / "s.json")
    with pytest.raises(FileNotFoundError):
        Schedule.load(tmp_path / "none.json")


def test_a_failed_write_leaves_the_old_file_and_no_other(pair, tmp_path, monkeypatch):
    path = tmp_path / "s.json"
    first = schedule(*pair, Rollout(), steps=5)
    first.save(path)
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        schedule(*pair, Rollout(), steps=6).save(path)
    assert len(Schedule.load(path)) == 5
    assert [p.name for p in tmp_path.iterdir()] == ["s.json"]


def test_a_cost_beyond_the_range_is_an_error_and_the_rest_can_be_saved(tmp_path):
    Q = [[1e308, -9e307], [-9e307, 1e308]]
    result = Schedule(ModeSet([[[0.5, 0.1], [0.1, 0.5]]], Q=Q), Gaussian([1e3, 1e3], np.zeros((2, 2))), [0])
    with np.errstate(all="ignore"):
        with pytest.raises((FloatingPointError, np.linalg.LinAlgError)):
            result.cost  # noqa: B018
        assert Schedule.load(result.save(tmp_path / "s.json")).w2.tolist() == result.w2.tolist()


def test_copies_are_read_only_too(pair):
    for original in (schedule(*pair, Rollout()), pair[1]):
        for twin in (pickle.loads(pickle.dumps(original)), copy.deepcopy(original)):
            np.testing.assert_array_equal(twin.mean, original.mean)
            with pytest.raises(ValueError, match="read-only"):
                twin.mean[0] = 1.0


def test_a_link_stays_a_link(pair, tmp_path):
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    target.write_text("old")
    target.chmod(0o600)
    link.symlink_to(target)
    schedule(*pair, Rollout()).save(link)
    assert link.is_symlink() and len(Schedule.load(target)) > 1
    assert target.stat().st_mode & 0o777 == 0o600
