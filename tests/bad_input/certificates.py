"""Rows of `switchctl.certificates`, and of its checker as a program."""

import json
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from pair import modes, x0

from bad_input.table import refused
from switchctl import Constant, Gaussian, ModeSet, RecedingHorizon, schedule
from switchctl.certificates import Certificate, certify, check
from switchctl.files import FormatError
from switchctl.stability import does_switching_help, minimum_dwell_time, policy_stability, schur_stability


@cache
def rate():
    return schur_stability(ModeSet([[[0.5]]]))[0]


@cache
def certificate():
    return certify(rate())


def plan(of=None, start=None, **keywords):
    found = schedule(of or modes(), start or x0(), Constant(0), **keywords)
    repr(found)  # what it remembers of itself is there
    return found


def nothing():
    return plan(start=Gaussian([0, 0], np.zeros((2, 2))), steps=2)


def growing():
    return plan(ModeSet([[[2.0]]]), Gaussian([1.0], [[0.0]]), steps=2)


def parts():
    document = certificate().document
    return {"kind": "mean square", **{name: document[name] for name in ("data", "claim", "witness")}}


def changed(**others):
    return {**certificate().document, **others}


TOO_LOW = {"lower": "0x0.0p+0", "upper": "0x1.0000000000000p-2"}
WRONG = "found must be a Schedule or a result of switchctl.stability"
ACTIVE = np.broadcast_to(np.eye(2), (2, 2, 2, 2)).copy()
ACTIVE[0, 1] *= 2


def with_content(function):
    """A function of a path, given the content of the file there: bytes, a document, or None for no file."""

    def call(content):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "claim.json"
            if content is not None:
                path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
            return function(path)

    return call


class Ended(Exception):
    """How a program ended and what it said."""


def program(*arguments):
    """Run the checker; a traceback is never an answer."""
    done = subprocess.run(
        [sys.executable, "-I", check.__file__, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    assert "Traceback" not in done.stdout + done.stderr
    raise Ended(f"exit code {done.returncode}: {done.stdout}{done.stderr}")


def checked(path):
    """What the checker's program says of a file, in this process."""
    import contextlib
    import io

    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = check.main([str(path)])
    raise Ended(f"exit code {code}: {said.getvalue()}")


FILES = [  # the content, what loading it says, what the program says
    ("binary", bytes(range(256)), "is not a JSON file", "unreadable"),
    ("empty", b"", "is not a JSON file", "unreadable"),
    ("a list", b"[]", "holds a JSON list; expected an object", "unreadable"),
    ("null", b"null", "holds a JSON NoneType", "unreadable"),
    ("an empty object", b"{}", "its format is None", "unreadable"),
    ("deep nesting", b"[" * 100_000, "is not a JSON file", "unreadable"),
    ("deep nesting in an object", b'{"a":' * 100_000, "is not a JSON file", "unreadable"),
    ("a key twice", b'{"a": 1, "a": 2}', "'a' comes twice", "unreadable: a key comes twice"),
    ("UTF-16", "{}".encode("utf-16"), "is not a JSON file", "unreadable"),
    ("a number of 10,000 digits", b'{"version": ' + b"9" * 10_000 + b"}", "is not a JSON file", "unreadable"),
    ("more after its end", b"{}x", "is not a JSON file", "unreadable"),
    ("another version", lambda: changed(version=99), "version 99", "of this version"),
    ("another format", lambda: changed(format="switchctl schedule"), "not a switchctl certificate", "unreadable"),
    (
        "a changed claim",
        lambda: changed(claim=TOO_LOW),
        "was changed",
        "1: rejected",
    ),
    ("changed data", lambda: changed(data={}), "the data was changed", "1: rejected: the data was changed"),
]

ROWS = [
    *refused(
        "certify",
        certify,
        lambda: {"found": plan(steps=2), "time_limit": 0.1},
        ("nothing", {"found": None, "time_limit": None}, TypeError, WRONG, "not a NoneType"),
        ("modes", {"found": lambda: modes(), "time_limit": None}, TypeError, WRONG, "not a ModeSet"),
        ("a tuple of rates", {"found": lambda: (rate(),), "time_limit": None}, TypeError, WRONG, "not a tuple"),
        ("a certificate", {"found": lambda: certificate(), "time_limit": None}, TypeError, WRONG, "not a Certificate"),
        ("the class", {"found": Certificate, "time_limit": None}, TypeError, WRONG, "not a type"),
        ("a gap for a rate", {"found": lambda: rate(), "gap": 0.1, "time_limit": None}, ValueError, "gap is 0.1"),
        ("a time for a rate", {"found": lambda: rate()}, ValueError, "time_limit is 0.1", "for schedules"),
        ("gap zero", {"gap": 0}, ValueError, "gap = 0", "0 < gap < 1"),
        ("gap one", {"gap": 1}, ValueError, "gap = 1", "0 < gap < 1"),
        ("gap nan", {"gap": np.nan}, ValueError, "gap is nan"),
        ("gap a string", {"gap": "1e-3"}, TypeError, "gap must be a number", "'1e-3'"),
        ("prefixes zero", {"prefixes": 0}, ValueError, "prefixes is 0", "at least 1"),
        ("prefixes fractional", {"prefixes": 1.5}, ValueError, "prefixes is 1.5", "whole number"),
        ("prefixes True", {"prefixes": True}, TypeError, "prefixes must be a whole number"),
        ("time_limit zero", {"time_limit": 0}, ValueError, "time_limit = 0", "above 0"),
        ("time_limit nan", {"time_limit": np.nan}, ValueError, "time_limit is nan"),
        ("an infinite cost", {"found": lambda: growing()}, ValueError, "cost is infinite", "nothing to prove"),
        ("no cost", {"found": lambda: nothing()}, ValueError, "costs nothing", "nothing to prove"),
        (
            "a discounted cost",
            {"found": lambda: plan(modes(cost=("discounted", 0.9)), steps=2)},
            ValueError,
            "total costs without noise",
            "discounted",
        ),
        (
            "noise",
            {"found": lambda: plan(modes(W=np.eye(2)), steps=2, terminal=np.eye(2))},
            ValueError,
            "total costs without noise",
        ),
        ("a target", {"found": lambda: plan(target=x0(), steps=2)}, ValueError, "a distance to a target"),
        (
            "switches that change",
            {"found": lambda: plan(modes(activation=ACTIVE))},
            ValueError,
            "no ModeSet.activation",
        ),
        (
            "a policy of which nothing is proven",
            {"found": lambda: policy_stability(modes(), RecedingHorizon(5)), "time_limit": None},
            ValueError,
            "nothing was proven of RecedingHorizon(horizon=5)",
        ),
        (
            "a policy without a certificate of its own",
            {"found": lambda: policy_stability(modes(), Constant(0)), "time_limit": None},
            ValueError,
            "only Rollout has one",
        ),
        (
            "help that is undecided",
            {"found": lambda: does_switching_help(ModeSet([[[1e300]]])), "time_limit": None},
            ValueError,
            "nothing can be proven in exact arithmetic",
        ),
    ),
    *refused(
        "certify",
        lambda Q: certify(plan(modes(Q=Q)), time_limit=0.1),
        dict,
        ("unseen states", {"Q": np.diag([1.0, 0])}, ValueError, "needs positive definite stage weights"),
    ),
    *refused(
        "Certificate",
        Certificate,
        lambda: {"document": certificate().document},
        ("nothing", {"document": None}, TypeError, "document must be a dict", "None", "Certificate.load"),
        ("a path", {"document": "claim.json"}, TypeError, "document must be a dict", "'claim.json'"),
        ("an empty document", {"document": {}}, TypeError, "document must be a dict with kind, data"),
    ),
    *refused(
        "Certificate.of",
        Certificate.of,
        parts,
        ("an unknown kind", {"kind": "stable"}, ValueError, "kind is 'stable'", "mean square"),
        ("kind None", {"kind": None}, ValueError, "kind is None"),
        ("kind a list", {"kind": []}, ValueError, "kind is []"),
        ("data None", {"data": None}, TypeError, "data must be a dict", "None"),
        ("claim a string", {"claim": "stable"}, TypeError, "claim must be a dict", "'stable'"),
        ("witness a list", {"witness": []}, TypeError, "witness must be a dict", "[]"),
        ("an array in data", {"data": {"A": np.eye(2)}}, TypeError, "data must hold what JSON can", "ndarray"),
        ("nan in the claim", {"claim": {"upper": np.nan}}, ValueError, "claim must hold what JSON can"),
    ),
    *refused(
        "Certificate.check",
        lambda **given: Certificate.of(**given).check(),
        parts,
        ("another kind's data", {"kind": "optimum"}, check.Unreadable, "not a certificate", "'Q'"),
        (
            "a claim of something else",
            {"claim": {"rate": "0x1.0000000000000p-1"}},
            check.Unreadable,
            "expected lower upper",
        ),
        ("too low a bound", {"claim": TOO_LOW}, check.Rejected, ""),
        ("numbers in decimals", {"claim": {"lower": "0", "upper": "0.6"}}, check.Unreadable, ""),
        ("no witness", {"witness": {}}, check.Unreadable, "not a certificate", "KeyError"),
    ),
    *refused(
        "Certificate.upper",
        lambda: certify(minimum_dwell_time(ModeSet([[[0.5]]]))).upper,
        dict,
        ("of a dwell time", {}, AttributeError, "kind 'dwell time' has no 'upper'", "its claim is"),
    ),
    *refused(
        "Certificate.load",
        with_content(Certificate.load),
        lambda: {"content": None},
        ("no file", {}, FileNotFoundError, "claim.json"),
        *[(what, {"content": content}, FormatError, words) for what, content, words, _ in FILES],
    ),
    *refused(
        "Certificate.load",
        Certificate.load,
        dict,
        ("path None", {"path": None}, TypeError, "not None"),
        ("the number of an open file", {"path": 1}, TypeError, "not 1"),
        ("a folder", {"path": tempfile.gettempdir()}, IsADirectoryError, tempfile.gettempdir()),
        ("a device without an end", {"path": "/dev/zero"}, FormatError, "/dev/zero", "bytes"),
    ),
    *refused(
        "Certificate.save",
        lambda path: certificate().save(path),
        dict,
        ("path None", {"path": None}, TypeError, "not None"),
        ("the number of an open file", {"path": 1}, TypeError, "not 1"),
        ("a folder that is missing", {"path": "/nowhere/claim.json"}, FileNotFoundError, "there is no folder"),
        ("a folder", {"path": tempfile.gettempdir()}, IsADirectoryError, tempfile.gettempdir()),
    ),
    *refused(
        "check.py",
        with_content(checked),
        lambda: {"content": None},
        ("no file", {}, Ended, "exit code 2: unreadable", "No such file"),
        *[(what, {"content": content}, Ended, "exit code", words) for what, content, _, words in FILES],
        ("a proof", {"content": lambda: certificate().document}, Ended, "exit code 0: accepted", "upper"),
    ),
    *refused(
        "check.py as a program",
        lambda arguments: program(*arguments),
        dict,
        ("no argument", {"arguments": []}, Ended, "exit code 2", "usage: python check.py claim.json"),
        ("two arguments", {"arguments": ["a", "b"]}, Ended, "exit code 2", "usage"),
        ("a folder", {"arguments": [tempfile.gettempdir()]}, Ended, "exit code 2: unreadable"),
        ("a device without an end", {"arguments": ["/dev/zero"]}, Ended, "exit code 2: unreadable", "more than"),
    ),
]
