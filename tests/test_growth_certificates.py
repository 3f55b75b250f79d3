"""Certificates of growth: true claims are accepted, false ones rejected, absurd ones refused soon."""

import copy
import json
import random
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from products import greatest_growth
from random_sets import random_graph, random_set

import switchctl
from switchctl import ModeSet, SwitchingGraph
from switchctl.certificates import Certificate, certify
from switchctl.certificates.check import Rejected, Unreadable, check, digest
from switchctl.models import five_mode
from switchctl.stability import (
    average_dwell_time,
    joint_spectral_radius,
    minimum_dwell_time,
    mode_dependent_dwell_times,
)

CHECKER = Path(switchctl.__file__).parent / "certificates" / "check.py"
JSR, DWELL, AVERAGE = "joint spectral radius", "dwell time", "average dwell time"


def hexed(M):
    return [[float(x).hex() for x in row] for row in M]


ONE = hexed([[1.0]])
PAIR = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]])


@pytest.fixture(scope="module")
def written():
    maps = np.tile(np.eye(2), (2, 2, 1, 1))
    maps[0, 1] = [[1.0, 0.0], [0.5, 1.0]]
    active = ModeSet([[[0.5, 1.0], [0.0, 0.5]], [[0.6, 0.0], [0.7, 0.4]]], activation=maps)
    ahmadi = ModeSet(np.array([[[-1, -1], [-4, 0]], [[3, 3], [-2, 1]]], dtype=float))
    automaton = SwitchingGraph.from_edges(PAIR, [(0, 1, 1), (1, 1, 0), (1, 2, 1), (2, 1, 0)])
    found = [
        joint_spectral_radius(ahmadi, tol=1e-3),
        joint_spectral_radius(automaton, tol=1e-3),
        joint_spectral_radius(active),
        minimum_dwell_time(five_mode.modes()),
        mode_dependent_dwell_times(PAIR, time_limit=5),
        minimum_dwell_time(active),
        average_dwell_time(five_mode.modes(), time_limit=6),
        average_dwell_time(active, time_limit=4),
    ]
    return [certify(one) for one in found]


def test_true_claims_are_accepted(written):
    for certificate in written:
        certificate.check()
        assert is_true(certificate.document)
    assert written[0].lower <= 3.917384715148 + 1e-11 and 3.91738471514 <= written[0].upper <= 3.9214
    assert written[0].lower == pytest.approx(3.917384715148, abs=1e-9)
    assert written[3].claim == {"stable": [3] * 5, "unstable": [2] * 5}


@pytest.mark.parametrize("seed", range(24))
def test_random_results_have_certificates(seed):
    graph = random_graph(seed) if seed % 2 else ModeSet(random_set(seed)[1])
    found = joint_spectral_radius(graph, tol=1e-2, time_limit=1)
    certificate = certify(found)
    certificate.check()
    assert found.upper <= certificate.upper <= max(found.upper * (1 + 2e-4), 0.1 if found.upper < 1e-6 else 0)
    assert 0 <= certificate.lower <= found.lower


def run(path):
    return subprocess.run([sys.executable, "-I", "-S", str(CHECKER), str(path)], capture_output=True, text=True)


def test_the_checker_by_itself(written, tmp_path):
    for certificate in written[2:8:2]:
        path = certificate.save(tmp_path / "claim.json")
        assert run(path).returncode == 0 and run(path).stdout.startswith("accepted: ")
    text = path.read_text()
    document = json.loads(text)
    document["claim"]["stable"] = float(0).hex()
    path.write_text(json.dumps(document))
    assert run(path).returncode == 1 and "was changed" in run(path).stdout
    absurd = {
        "cut short": text[: len(text) // 2],
        "a key twice": text.replace('"version"', '"kind": "x", "version"', 1),
        "another version": text.replace('"version": ', '"version": 9', 1),
        "deep": "[" * 100_000,
        "deep object": '{"a":' * 100_000,
        "long number": "9" * 100_000,
        "no object": "[]",
        "empty": "",
    }
    for name, changed in absurd.items():
        path.write_text(changed)
        result = run(path)
        assert result.returncode == 2 and "Traceback" not in result.stderr, (name, result)
    with open(path, "wb") as file:
        file.truncate(200 << 20)
    begun = time.perf_counter()
    assert run(path).returncode == 2 and time.perf_counter() - begun < 5
    assert run(tmp_path).returncode == 2 and run(tmp_path / "missing").returncode == 2


def sealed(document):
    document["sha256"] = digest(document["data"])
    document["sha256_of_proof"] = digest([document["claim"], document["witness"]])
    return document


def leaves(value, path=()):
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, (*path, key))
    else:
        yield path


def set_at(document, path, value):
    for key in path[:-1]:
        document = document[key]
    document[path[-1]] = value


def at(document, path):
    for key in path:
        document = document[key]
    return document


def mutant(document, generator):
    """One leaf changed, or one part left out or given twice."""
    changed = copy.deepcopy({key: document[key] for key in ("data", "claim", "witness")})
    path = generator.choice([path for path in leaves(changed) if path[:2] != ("data", "names")])
    value = at(changed, path)
    if isinstance(value, str):
        x = float.fromhex(value)
        new = generator.choice([-x, x * 1.01, x * 0.99, x * 1.5, 0.0, x + 0.05, x - 0.05, x * (1 + 1e-9)]).hex()
    elif isinstance(value, int):
        new = value + generator.choice([-1, 1, 2])
    else:
        new = [1, 1]
    holder = at(changed, path[:-1])
    way = generator.random()
    if isinstance(holder, list) and way < 0.2:
        del holder[path[-1]]
    elif isinstance(holder, list) and way < 0.3:
        holder.append(value)
    else:
        set_at(changed, path, new)
    return {**document, **changed}


def is_true(document):
    """Brute force over all products up to a length doesn't contradict the claim."""
    return holds(*(json.dumps(document[key]) for key in ("kind", "data", "claim")))


@cache  # many mutants differ in their witnesses alone
def holds(*parts):
    kind, data, claim = map(json.loads, parts)
    A = [np.array([[float.fromhex(x) for x in row] for row in M]) for M in data["A"]]
    if kind == JSR:
        moves = [(v, w, A[k], k) for v, ways in enumerate(data["moves"]) for k, w in ways]
        lower, upper = greatest_growth(moves, 10, 20_000)
        return lower <= float.fromhex(claim["upper"]) * (1 + 1e-9) and float.fromhex(claim["lower"]) <= upper * (
            1 + 1e-9
        )
    first = [[A[i] for i in range(len(A))] for _ in A]
    if data["first"] is not None:
        first = [[np.array([[float.fromhex(x) for x in row] for row in M]) for M in ways] for ways in data["first"]]

    def moves(dwell):
        node = {pair: k for k, pair in enumerate((i, c) for i in range(len(A)) for c in range(dwell[i]))}
        for (i, c), v in node.items():
            yield v, node[i, min(c + 1, dwell[i] - 1)], A[i], i
            if c == dwell[i] - 1:
                yield from ((v, node[j, 0], first[i][j], j) for j in range(len(A)) if j != i)

    if kind == DWELL:
        stable = claim["stable"] is None or greatest_growth(list(moves(claim["stable"])), 14, 20_000)[0] < 1
        unstable = claim["unstable"]
        return stable and (unstable is None or greatest_growth(list(moves(unstable)), 14, 20_000)[1] > 1 - 1e-9)
    if float.fromhex(claim["stable"]) <= 1:
        return greatest_growth(list(moves([1] * len(A))), 10, 20_000)[0] < 1
    tau = int(np.ceil(float.fromhex(claim["stable"])))  # signals that dwell so long have that average too
    return greatest_growth(list(moves([tau] * len(A))), 14, 20_000)[0] < 1


def verdict(document):
    try:
        check(document)
    except Rejected:
        return "rejected"
    except Unreadable:
        return "unreadable"
    return "accepted"


def check_mutants(certificate, count, seed):
    generator = random.Random(seed)
    seen = {"accepted": 0, "rejected": 0, "unreadable": 0}
    for _ in range(count):
        changed = mutant(certificate.document, generator)
        same = all(changed[key] == certificate.document[key] for key in ("data", "claim", "witness"))
        if not same:
            assert verdict(changed) in ("rejected", "unreadable")
        told = verdict(sealed(changed))
        seen[told] += 1
        if told == "accepted":
            assert is_true(changed), changed["claim"]
    assert seen["rejected"] > 0
    return seen


def test_mutants_are_rejected_or_true(written):
    for number, certificate in enumerate(written):
        check_mutants(certificate, 25, number)


@pytest.mark.slow
def test_many_mutants_are_rejected_or_true(written):
    for number, certificate in enumerate(written):
        print(number, check_mutants(certificate, 400, 100 + number))


def test_false_claims_are_rejected(written):
    def claims(number, **changed):
        document = copy.deepcopy(written[number].document)
        document["claim"].update(changed)
        return verdict(sealed(document))

    assert claims(0, upper=(3.9173).hex()) == "rejected"
    assert claims(0, lower=(3.9174).hex()) == "rejected"
    assert claims(0, upper=(-4.0).hex()) == "rejected"
    assert claims(0, lower=(-4.0).hex()) == "rejected"
    assert claims(3, stable=[2] * 5) == "rejected"
    assert claims(3, unstable=[3] * 5) == "rejected"
    assert claims(3, stable=[3] * 4) == "rejected"
    assert claims(3, stable=None, unstable=None) == "rejected"
    assert claims(3, stable=[True] * 5) == "unreadable"
    assert claims(3, stable=[3.0] * 5) == "unreadable"
    assert claims(3, stable=[10**8] * 5) == "unreadable"
    assert claims(3, stable=[-3] * 5) == "rejected"
    assert claims(3, stable=[]) == "rejected"
    average = written[6].claim["stable"]
    assert claims(6, stable=(np.ceil(average * 64) / 64 - 2 / 64).hex()) == "rejected"
    assert claims(6, stable=(average - 1e-9).hex()) == "rejected"  # in 64ths
    assert claims(6, unstable=(written[6].claim["unstable"] * 1.01).hex()) == "rejected"
    assert claims(6, stable=(-1.0).hex()) == "rejected"
    for number in range(len(written)):
        for key in list(written[number].document["claim"]):
            document = copy.deepcopy(written[number].document)
            del document["claim"][key]
            assert verdict(sealed(document)) == "unreadable"


def radius_document(A, moves, upper, lower="0x0.0p+0", proof=None, cycle=None):
    proof = {"rank": [0], "norms": [[0, ONE]], "trees": [[0]]} if proof is None else proof
    witness = {"upper": proof, "lower": cycle}
    data = {"names": [], "A": A, "moves": moves}
    return Certificate.of(JSR, data, {"lower": lower, "upper": upper}, witness).document


def test_what_an_adversary_may_try():
    half, two, loop = hexed([[0.5]]), hexed([[2.0]]), [[[0, 0]]]
    h = float.hex
    assert verdict(radius_document([half], loop, h(0.5))) == "accepted"
    both = hexed([[2.0, 0.0], [0.0, 0.5]])
    flat = {"rank": [0], "norms": [[0, hexed([[0.0, 0.0], [0.0, 1.0]])]], "trees": [[0]]}
    skew = {"rank": [0], "norms": [[0, hexed([[1.0, 9.0], [0.0, 1.0]])]], "trees": [[0]]}
    cycle = {"node": 0, "moves": [0], "H": ONE, "x": ONE}
    attempts = {
        "no nodes": radius_document([half], [], h(0.0), proof={"rank": [], "norms": [], "trees": []}),
        "no norms": radius_document([two], loop, h(0.5), proof={"rank": [0], "norms": [], "trees": []}),
        "a way left out": radius_document([half, two], [[[0, 0], [1, 0]]], h(0.5)),
        "a norm at no node": radius_document(
            [two], loop, h(0.5), proof={"rank": [0], "norms": [[-1, ONE]], "trees": [[0]]}
        ),
        "a singular norm": radius_document([both], loop, h(0.5), proof=flat),
        "no symmetric norm": radius_document([both], loop, h(0.5), proof=skew),
        "a rank that rises": radius_document(
            [two], [[[0, 1]], [[0, 0]]], h(0.5), proof={"rank": [1, 0], "norms": [], "trees": []}
        ),
        "two norms": radius_document(
            [two], loop, h(0.5), proof={"rank": [0], "norms": [[0, ONE], [0, hexed([[99.0]])]], "trees": [[1], [0]]}
        ),
        "a cut at another node": radius_document(
            [half, two],
            [[[0, 1]], [[1, 1]]],
            h(0.5),
            proof={"rank": [0, 0], "norms": [[0, hexed([[99.0]])], [1, ONE]], "trees": [[0], [0]]},
        ),
        "a tree too long": radius_document(
            [half], loop, h(0.5), proof={"rank": [0], "norms": [[0, ONE]], "trees": [[0, 0]]}
        ),
        "a tree too short": radius_document(
            [half], loop, h(0.5), proof={"rank": [0], "norms": [[0, ONE]], "trees": [[-1]]}
        ),
        "x of nothing": radius_document([half], loop, h(0.5), h(1.0), cycle={**cycle, "x": hexed([[0.0]])}),
        "H below zero and x of nothing": radius_document(
            [half], loop, h(0.5), h(1.0), cycle={**cycle, "H": hexed([[-1.0]]), "x": hexed([[0.0]])}
        ),
        "H below zero": radius_document([half], loop, h(0.5), h(1.0), cycle={**cycle, "H": hexed([[-1.0]])}),
        "a way from the end": radius_document([half], loop, h(0.5), h(0.5), cycle={**cycle, "moves": [-1]}),
        "no cycle": radius_document([half], loop, h(0.5), h(0.5), cycle={**cycle, "moves": []}),
        "a negative move": radius_document([half], [[[-1, 0]]], h(0.5)),
        "a negative bound": radius_document([half], loop, h(-0.5)),
    }
    for name, document in attempts.items():
        assert verdict(document) == "rejected", name


@pytest.mark.parametrize("text", ["0x1p-5000", "0x0.fffffffffffffff8p0", "0x1.00000000000001p0", "0x1p0", " 0x1p0"])
def test_numbers_that_would_be_rounded_are_refused(text):
    """What is read must be what is written: such a claim could be false by what its rounding takes."""
    loop = [[[0, 0]]]
    assert verdict(radius_document([ONE], loop, text)) == "unreadable"
    assert verdict(radius_document([[[text]]], loop, float(0).hex())) == "unreadable"


@pytest.mark.parametrize(
    "text", ["inf", "nan", "0x1p5000", "1.5", "", "0x", 1.5, None, True, "+-0x1p0", "0x" + "1" * 99]
)
def test_what_is_no_number_is_refused(text):
    assert verdict(radius_document([[[text]]], [[[0, 0]]], float(9).hex())) == "unreadable"


def test_a_bound_of_moments_below_zero_is_no_bound():
    data = {"A": [hexed([[0.5]])], "moves": [[[0, 0, float(1).hex()]]]}
    claim = {"lower": float(0).hex(), "upper": (0.5).hex()}
    assert verdict(Certificate.of("mean square", data, claim, {"P": [ONE]}).document) == "accepted"
    claim["upper"] = (-0.5).hex()
    assert verdict(Certificate.of("mean square", data, claim, {"P": [ONE]}).document) == "rejected"
    empty = {**data, "moves": []}
    assert (
        verdict(Certificate.of("mean square", empty, {**claim, "upper": "0x0.0p+0"}, {"P": []}).document) == "rejected"
    )


def test_first_steps_must_be_one_for_each_pair():
    half = hexed([[0.5]])
    witness = {"rank": [0, 0], "norms": [[0, ONE], [1, ONE]], "trees": [[0, 1], [0, 1]]}
    three = hexed([[3.0]])
    for first, told in (
        ([[half, half], [half, half]], "accepted"),
        ([[half] * 3, [half]], "rejected"),
        ([[half, three], [half, half]], "rejected"),
        ([[half, half], [three, half]], "rejected"),
        ([[three, half], [half, three]], "accepted"),  # what goes on is not taken over
    ):
        data = {"names": [], "A": [half, half], "first": first}
        claim, proof = {"stable": [1, 1], "unstable": None}, {"stable": witness, "unstable": None, "rate": (0.5).hex()}
        assert verdict(Certificate.of(DWELL, data, claim, proof).document) == told


def test_absurd_work_is_refused_soon():
    half, loop, tiny = hexed([[0.5]]), [[[0, 0]]], float(2.0**-1074).hex()
    rng = np.random.default_rng(0)
    B, eye = hexed(rng.standard_normal((60, 60))), hexed(np.eye(60))
    W = np.where(np.eye(60) > 0, 2.0**1020, 2.0 ** rng.integers(-1000, 1000, (60, 60)))
    W = np.tril(W) + np.tril(W, -1).T
    W[0, 0] = 2.0**-1070

    def average(decay, jump):
        data = {"names": [], "A": [half], "first": None}
        claim = {"stable": float(10**6).hex(), "unstable": None}
        return Certificate.of(
            AVERAGE, data, claim, {"P": [ONE], "decay": decay, "jump": jump, "unstable": None}
        ).document

    deep = {"rank": [0], "norms": [[0, ONE]], "trees": [[-1] * 9000 + [0]]}
    wide = {"rank": [0], "norms": [[0, eye]], "trees": [[-1] * 30_000 + [0]]}
    cycle = {"node": 0, "moves": [0] * 30_000, "H": eye, "x": hexed(np.ones((60, 1)))}
    documents = [
        average(tiny, float(1).hex()),
        average(tiny, float(2).hex()),
        radius_document([[[tiny]]], loop, tiny, proof=deep),
        radius_document([[[float(2.0**1000).hex()]]], loop, tiny, proof=deep),
        radius_document([B], loop, float(20).hex(), proof=wide),
        radius_document([B], loop, float(99).hex(), float(1).hex(), {**wide, "trees": [[0]]}, cycle),
        radius_document([B], loop, float(99).hex(), proof={**wide, "norms": [[0, hexed(W)]], "trees": [[0]]}),
    ]
    begun = time.perf_counter()
    assert all(verdict(document) in ("rejected", "unreadable") for document in documents)
    assert time.perf_counter() - begun < 10
