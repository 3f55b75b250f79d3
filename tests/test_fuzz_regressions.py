"""What fuzzing (fuzz/) found: inputs that got past the boundary, or weren't refused in words."""

import json

import numpy as np
import pytest

from switchctl import FormatError, Gaussian, ModeSet, Rollout, Schedule, schedule
from switchctl.certificates import Certificate, certify, check
from switchctl.files import write_document
from switchctl.gramians import tail, word_tail
from switchctl.load_model import load_model
from switchctl.moments import root
from switchctl.stability import word_stability

A = [[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]]


def test_a_schedule_whose_cost_exceeds_the_range_is_a_format_error(tmp_path):
    modes = ModeSet(A, W=0.1 * np.eye(2), offset=[0.1, 0.2], cost=("discounted", 0.9))
    path = schedule(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), Rollout(), steps=6).save(tmp_path / "s.json")
    document = json.loads(path.read_text())
    document["cov"][1][1] = 1.7e308
    content = {key: value for key, value in document.items() if key not in ("format", "version", "sha256")}
    write_document(path, "schedule", document["version"], content)
    with pytest.raises(FormatError, match="floating-point range"):
        Schedule.load(path)
    with pytest.raises(FloatingPointError, match="floating-point range"):
        Schedule(modes, Gaussian([1.0, 1.0], np.diag([0.01, 1.7e308])), [1] * 6).cost  # noqa: B018


def test_a_schedule_without_a_cost_is_printed_and_saved(tmp_path):
    """Under noise, where nobody said which cost is meant."""
    plan = Schedule(ModeSet(A, W=0.1 * np.eye(2)), Gaussian([1.0, 1.0], 0.01 * np.eye(2)), [1] * 6)
    with pytest.raises(ValueError, match="with noise the total cost for ever is infinite"):
        plan.cost  # noqa: B018
    assert "cost      not available: with noise" in repr(plan)
    loaded = Schedule.load(plan.save(tmp_path / "s.json"))
    assert repr(loaded) == repr(plan)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["data"].update(more=float("nan")),
        lambda d: d["witness"].update(more=float("-inf")),
        lambda d: d.update(more=float("inf")),
        lambda d: d.update(more=1),
        lambda d: d.update(kind=["mean square"]),
        lambda d: d.update(claim=["lower", "upper"]),
        lambda d: d.update(claim={}),
        lambda d: d.update(kind="optimum", claim={}),
        lambda d: d.update(data=[], witness=[]),
        lambda d: d["claim"].update(lower=10**400),
        lambda d: d["claim"].update(upper="0x1p+2000"),
    ],
)
def test_what_is_no_certificate_is_refused_where_it_is_read_and_by_the_checker(tmp_path, capsys, change):
    path = certify(word_stability(ModeSet(A), [0, 1])).save(tmp_path / "c.json")
    assert check.main([str(path)]) == 0
    document = json.loads(path.read_text())
    change(document)
    document["sha256"] = json_digest(document["data"])
    document["sha256_of_proof"] = json_digest([document["claim"], document["witness"]])
    path.write_text(json.dumps(document))
    with pytest.raises(FormatError, match="damaged certificate"):
        Certificate.load(path)
    assert check.main([str(path)]) == 2
    assert "unreadable" in capsys.readouterr().out


def json_digest(value):
    import hashlib

    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@pytest.mark.parametrize(
    "content", [{"A": [[[0.5, 1e200], [0.0, 0.5]]]}, {"A": [[[0.5, 1e5], [0.0, 0.5]]], "Q": 1e308}]
)
def test_models_whose_costs_exceed_the_range_are_refused(tmp_path, content):
    if "Q" in content:
        content["Q"] = [[content["Q"], 0.0], [0.0, content["Q"]]]
    (tmp_path / "m.json").write_text(json.dumps(content | {"mean": [1.0, 1.0]}))
    model = load_model(str(tmp_path / "m.json"))
    with pytest.raises(np.linalg.LinAlgError, match="mode 'A0'"):
        schedule(model.modes, model.initial_state, Rollout(), steps=4)


@pytest.mark.parametrize("scale", [1e160, 1e-200])
def test_the_residual_of_a_cost_is_not_lost_where_squares_leave_the_range(scale):
    P = tail(np.array([[0.9, 1.0], [0.0, 0.5]]), np.eye(2))
    np.testing.assert_allclose(tail(np.array([[0.9, 1.0], [0.0, 0.5]]), scale * np.eye(2)), scale * P, rtol=1e-14)


def test_a_state_known_exactly_has_no_uncertainty_of_rounding():
    rng = np.random.default_rng(1)
    for _ in range(20):
        x = rng.standard_normal((4, 1))
        x[rng.integers(4)] = 0.0
        assert not root(x @ x.T)[x[:, 0] == 0].any()


@pytest.mark.parametrize(
    ("A", "verdict"),
    [
        ([[-1e308, 0.5], [0.8, 3.0]], "Schur undecided"),
        ([[0.8, 3.0], [-1e308, 0.5]], "not Schur"),
        ([[-1e308] * 3] * 3, "Schur undecided"),
    ],
)
def test_verdicts_near_the_end_of_the_range(A, verdict):
    assert verdict in repr(ModeSet([A]))


@pytest.mark.parametrize("entry", [1e90, 1e153, 1e155, 1e200, 1e307])
def test_words_of_great_entries_are_right_or_refused(entry):
    A = np.array([[[0.5, entry], [0.0, 0.5]], [[0.5, 0.0], [0.0, 0.5]], [[0.5, 0.0], [1 / entry, 0.5]]])
    Q = np.array([np.eye(2)] * 3)
    for word in ((0,), (0, 1), (1, 0), (0, 2), (2, 0), (0, 0, 1)):
        try:
            P = word_tail(A, Q, word)
        except np.linalg.LinAlgError:
            assert entry > 1e90 or word in ((0, 2), (2, 0))
            continue
        if {0, 2} <= set(word):
            assert P is None  # a pole at 1.16
            continue
        period = np.zeros((2, 2))
        for mode in reversed(word):
            period = Q[mode] + A[mode].T @ period @ A[mode]
        assert (np.diag(P) >= np.diag(period) * (1 - 1e-12)).all() and np.isfinite(P).all()
