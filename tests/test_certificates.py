"""Certificates: written ones are accepted, false ones rejected, and the checker needs nothing else."""

import copy
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from enumeration import graph_of
from random_rules import KINDS, instances, takeover

import switchctl
from switchctl import Constant, FormatError, Gaussian, ModeSet, Optimal, RecedingHorizon, Refine, Rules, schedule
from switchctl.certificates import Certificate, certify
from switchctl.certificates import check as checker
from switchctl.certificates.check import Rejected, Unreadable, digest
from switchctl.models import five_mode

CHECKER = Path(switchctl.__file__).parent / "certificates" / "check.py"


@pytest.fixture(scope="module")
def pair():
    return ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], dt=0.1, names=["fast", "calm"])


@pytest.fixture(scope="module")
def x0():
    return Gaussian([1.0, 1.0], 0.01 * np.eye(2))


@pytest.fixture(scope="module")
def five():
    return certify(schedule(five_mode.modes(), five_mode.initial_state(), Optimal(gap=1e-9)), gap=1e-9)


def test_example_1_is_certified_to_a_billionth(five):
    assert five.gap <= 1e-9
    assert five.lower <= 77.773698147481 <= five.upper
    five.check()


def run(path):
    return subprocess.run([sys.executable, "-I", "-S", str(CHECKER), str(path)], capture_output=True, text=True)


def test_the_checker_runs_by_itself(five, tmp_path):
    path = five.save(tmp_path / "claim.json")
    result = run(path)
    assert result.returncode == 0 and result.stdout.startswith("accepted: optimum, lower = ")
    document = json.loads(path.read_text())
    document["claim"]["lower"] = float(five.upper * 1.0001).hex()
    path.write_text(json.dumps(sealed(document)))
    result = run(path)
    assert result.returncode == 1
    assert "rejected: a run may cost less than claimed" in result.stdout
    for text in ("{", "[]", "{}", '{"format": "switchctl certificate", "version": 1}', "\x00"):
        path.write_text(text)
        assert run(path).returncode == 2, text
    assert run(tmp_path / "not there").returncode == 2


def sealed(document):
    """With the digest of its claim and witness, as a forger would."""
    return {**document, "sha256_of_proof": digest([document["claim"], document["witness"]])}


def check(document):
    checker.check(sealed(document))


def test_a_changed_claim_or_witness_breaks_the_seal(five):
    for part in ("claim", "witness"):
        document = copy.deepcopy(five.document)
        key = next(iter(document[part]))
        document[part][key], note = 0, document[part][key]
        with pytest.raises(Rejected, match="the claim or the witness was changed"):
            checker.check(document)
        document[part][key] = note
        check(document)


def test_any_schedule_has_a_certificate(pair, x0):
    for method in (Constant("fast"), RecedingHorizon(20), Refine()):
        found = schedule(pair, x0, method)
        certificate = certify(found, gap=0.01)
        certificate.check()
        assert certificate.upper == pytest.approx(found.cost, rel=1e-8)
    assert certificate.gap <= 0.01


@pytest.mark.parametrize("method", [Constant("fast"), Constant("calm"), RecedingHorizon(1)], ids=repr)
def test_the_gap_asked_for_is_that_to_the_schedule(pair, x0, method):
    """Also where the schedule costs far more than the least cost that the search for bounds comes to know."""
    found, best = schedule(pair, x0, method), schedule(pair, x0, Optimal(gap=1e-5))
    least = 1 - best.lower_bound / found.cost
    for gap in ((1 + least) / 2, 0.9 * least + 0.1, least + 2e-3 * (1 - least)):
        certificate = certify(found, gap)
        certificate.check()
        assert least * (1 - 1e-4) <= certificate.gap <= gap


def test_rounding_does_not_take_from_the_gap():
    """A pendulum's three loops, one a lead whose state weighs little: the bounds lose 2e-4 of the cost when rounded."""
    A = [
        [[0.991, 0.008966, 0.0], [-1.797, 0.7936, 0.0], [0.01604, -0.0005602, 0.00592]],
        [[0.999, 0.009545, 0.0], [-0.1972, 0.9093, 0.0], [0.02045, -0.0002414, 0.00592]],
        [[0.9764, 0.009983, 1.079], [-4.716, 0.997, 215.6], [0.008, 0.0, 0.6]],
    ]
    modes, start = ModeSet(A, Q=np.diag([20, 1, 1e-3]), dt=0.01), Gaussian([0.5, 2.0, 0.0], np.diag([0.01, 0.04, 0.0]))
    found = schedule(modes, start, Optimal(gap=1e-2), rules=Rules(min_dwell=5, switch_cost=0.005))
    for gap in (0.01, 0.02):
        assert certify(found, gap).gap <= gap


def test_a_small_tree_proves_less(pair, x0):
    found = schedule(pair, x0, Optimal(gap=1e-6))
    small, large = certify(found, 1e-6, prefixes=5), certify(found, 1e-6)
    for certificate in (small, large):
        certificate.check()
    assert len(small.document["witness"]["tree"]) <= 5
    assert small.lower < large.lower


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind is not takeover], ids=lambda kind: kind.__name__)
def test_under_every_kind_of_rule(kind):
    written = 0
    for number, (modes, start, rules, _rng) in enumerate(instances(kind, 12, 9)):
        graph = graph_of(modes, rules)
        if graph is None or (np.linalg.eigvalsh(modes.Q)[:, 0] < 1e-3).any():
            continue
        steps, M = (None, None) if number % 2 else (6, np.eye(len(start.mean)))
        try:
            found = schedule(modes, start, Optimal(gap=0.1), steps, graph, terminal=M)
        except ValueError:  # no way on of finite cost
            continue
        if found.cost == math.inf:
            continue
        certificate = certify(found, gap=0.1)
        certificate.check()
        assert certificate.lower <= found.cost <= certificate.upper * (1 + 1e-9)
        assert certificate.upper <= found.cost * (1 + 1e-7)
        if rules.switch_cost == 0 and rules.price is None:
            assert certificate.gap <= 0.1 + 1e-9
        written += 1
    assert written >= 2


def changed(document, rng):
    """The document with one number, token or part of the claim changed."""
    document = copy.deepcopy(document)
    places = []

    def walk(value, path):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            if isinstance(entry, dict | list):
                walk(entry, (*path, key))
            else:
                places.append((*path, key))

    walk(document, ())
    *path, last = places[rng.integers(len(places))]
    here = document
    for key in path:
        here = here[key]
    old = here[last]
    if isinstance(old, str) and old.lstrip("-").startswith("0x"):
        value = float.fromhex(old)
        here[last] = (value * (1 + 1e-3 * rng.choice([-1, 1])) if value else 1e-3).hex()
    elif isinstance(old, int):
        here[last] = old + int(rng.choice([-1, 1]))
    elif isinstance(old, str):
        here[last] = old + "x"
    else:
        here[last] = 0
    return (*path, last), old, document


def test_what_was_changed_so_that_it_is_false_is_rejected(five, pair, x0):
    """Data changed without its digest, a greater lower bound, a smaller upper one, a cut tree; 600 changes in all."""
    rng = np.random.default_rng(0)
    ruled = certify(schedule(pair, x0, Optimal(gap=1e-4), rules=Rules(min_dwell=3, switch_cost=0.1)), gap=1e-3)
    refused = 0
    for certificate in (five, ruled):
        for _ in range(300):
            path, _old, document = changed(certificate.document, rng)
            try:
                check(document)
            except (Rejected, Unreadable):
                refused += 1
                continue
            # What is still accepted must still be true: a witness may be changed for another one that does.
            assert path[0] in ("witness", "claim", "sha256_of_proof"), path
            if path[0] == "claim":
                value = float.fromhex(document["claim"][path[1]])
                assert value <= certificate.lower if path[1] == "lower" else value >= certificate.upper
    assert refused > 300


def test_a_claim_about_other_data_is_rejected(five):
    """With a digest of the changed data the claim itself must fail: the modes are a little worse."""
    document = copy.deepcopy(five.document)
    document["data"]["A"][0][0][0] = (float.fromhex(document["data"]["A"][0][0][0]) * 1.01).hex()
    document["sha256"] = digest(document["data"])
    with pytest.raises(Rejected):
        check(document)


def test_a_singular_weight_is_refused_by_the_writer_and_the_checker(five):
    modes = ModeSet([[[0.5, 1.0], [0.0, 0.4]], [[0.4, 0.0], [1.0, 0.5]]], Q=np.diag([1.0, 0.0]))
    found = schedule(modes, Gaussian([1.0, 1.0], np.eye(2)), Optimal())
    with pytest.raises(ValueError, match="positive definite stage weights"):
        certify(found)
    document = copy.deepcopy(five.document)
    for Q in document["data"]["Q"]:
        Q[1] = [(0.0).hex(), (0.0).hex()]
        Q[0][1] = (0.0).hex()
    document["sha256"] = digest(document["data"])
    with pytest.raises(Rejected, match="not positive definite"):
        check(document)


def test_wrong_arguments(pair, x0):
    found = schedule(pair, x0, Refine())
    with pytest.raises(TypeError, match="must be a Schedule or a result"):
        certify(pair)
    for wrong in ({"gap": 0}, {"gap": 1}, {"time_limit": 0}, {"prefixes": 0}, {"gap": math.nan}):
        with pytest.raises(ValueError):
            certify(found, **wrong)
    unstable = ModeSet([[[1.1]]])
    with pytest.raises(ValueError, match="infinite"):
        certify(schedule(unstable, Gaussian([1.0], [[0.0]]), Constant(0), 5))


def test_saving_and_loading(five, tmp_path):
    path = five.save(tmp_path / "claim.json")
    assert Certificate.load(path).document == five.document
    path.write_text("{}")
    with pytest.raises(FormatError):
        Certificate.load(path)


def test_forgeries(five, tmp_path):
    """A key that comes twice, decimals, a run that need not end, nesting without end."""
    path = tmp_path / "claim.json"
    text = json.dumps(five.document)
    path.write_text(text.replace('"claim": {', '"claim": {}, "claim": {', 1))
    assert run(path).returncode == 2
    document = copy.deepcopy(five.document)
    document["claim"]["upper"] = "78"
    with pytest.raises(Unreadable):
        check(document)
    document = copy.deepcopy(five.document)
    document["data"]["terminal"] = document["data"]["Q"][0]
    document["sha256"] = digest(document["data"])
    with pytest.raises(Rejected, match="never end"):
        check(document)
    path.write_text("[" * 100_000)
    assert run(path).returncode == 2


def test_a_guard_below_zero_is_rejected(five):
    document = copy.deepcopy(five.document)
    document["witness"]["guards"][0] = (-1.0).hex()
    with pytest.raises(Rejected, match="below zero"):
        check(document)


@pytest.mark.parametrize("size", [1e30, 1e-30])
def test_great_and_small_states(pair, size):
    found = schedule(pair, Gaussian([size, size], np.zeros((2, 2))), Optimal())
    certificate = certify(found, 1e-3)
    certificate.check()
    assert certificate.gap <= 2e-3


def forged(five, **witness):
    document = copy.deepcopy(five.document)
    document["witness"] |= witness
    return document


def scaled(matrix, factor):
    return [[(float.fromhex(entry) * factor).hex() for entry in row] for row in matrix]


def test_bounds_that_do_not_hold_are_rejected(five):
    """Greater than a step allows: they would prove more than is true."""
    bounds = [{v: scaled(L, 1.3) for v, L in given.items()} for given in five.document["witness"]["bounds"]]
    document = forged(five, bounds=bounds)
    document["claim"]["lower"] = document["claim"]["upper"] = (five.upper * 1.1).hex()
    with pytest.raises(Rejected, match="exceeds what a step"):
        check(document)


def test_a_tail_that_costs_more_is_rejected(five):
    with pytest.raises(Rejected, match="the tail costs more"):
        check(forged(five, tail=scaled(five.document["witness"]["tail"], 0.5)))


def test_a_tree_must_be_whole(five):
    tree = five.document["witness"]["tree"]
    with pytest.raises(Rejected, match="goes on after its end"):
        check(forged(five, tree=[*tree, 0]))
    with pytest.raises(Rejected, match="cut short"):
        check(forged(five, tree=tree[:-1]))


def test_a_run_against_the_moves_is_rejected(pair, x0):
    document = certify(schedule(pair, x0, Refine(), rules=Rules(min_dwell=4)), 0.05).document
    lead = document["witness"]["lead"]
    with pytest.raises(Rejected, match="a move that is not there"):
        check({**document, "witness": {**document["witness"], "lead": [1 - lead[0], *lead[:1], *lead[2:]]}})


@pytest.mark.parametrize("unit", [2.0**-110, 2.0**-120, 2.0**-190])
def test_what_exact_arithmetic_cannot_prove_is_a_value_error(unit):
    modes = ModeSet([[[-0.75]]], Q=[[unit]])
    found = schedule(modes, Gaussian([1.0], [[0.0]]), Optimal(gap=0.1), steps=4, terminal=[[unit]])
    try:
        certify(found, 0.5).check()
    except ValueError as error:
        assert "exact arithmetic" in str(error)
