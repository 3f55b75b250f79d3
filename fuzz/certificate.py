"""Certificates: `load` and `check`, and the checker run on the file, agree; what is accepted is saved as it is.

python fuzz/certificate.py -max_total_time=600
"""

import contextlib
import io
import json
import tempfile
from pathlib import Path

import atheris
from mutations import resealed, run

with atheris.instrument_imports(include=["switchctl"]):
    from switchctl import FormatError, Gaussian, ModeSet, Refine, Rollout, SwitchingGraph, schedule, stability
    from switchctl.certificates import Certificate, certify, check

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
BOUNDS = "lower", "upper"


def seeds() -> list[str]:
    """A certificate of every kind, as `save` writes it."""
    modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]])
    x0 = Gaussian([1.0, 1.0], [[0.01, 0.0], [0.0, 0.01]])
    maps = [[[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.5, 1.0]]], [[[1.0, 0.0], [0.0, 1.0]]] * 2]
    active = ModeSet([[[0.5, 1.0], [0.0, 0.5]], [[0.6, 0.0], [0.7, 0.4]]], activation=maps)
    automaton = SwitchingGraph.from_edges(modes, [(0, 1, 1), (1, 1, 0), (1, 2, 1), (2, 1, 0)])
    tame = ModeSet([[[0.5, 1.0], [0.0, 0.4]], [[0.4, 0.0], [1.0, 0.5]]])
    made = [
        certify(schedule(tame, x0, Refine()), gap=0.1),
        certify(schedule(tame, x0, Refine(), rules=None, steps=3, terminal=[[1.0, 0.0], [0.0, 1.0]]), gap=0.05),
        certify(stability.does_switching_help(tame, x0)),
        certify(stability.word_stability(modes, [0, 1])),
        certify(stability.random_stability(tame, [0.5, 0.5])),
        certify(stability.policy_stability(tame, Rollout())),
        certify(stability.joint_spectral_radius(tame, tol=0.05)),
        certify(stability.joint_spectral_radius(automaton, tol=0.1)),
        certify(stability.minimum_dwell_time(tame)),
        certify(stability.minimum_dwell_time(active)),
        certify(stability.average_dwell_time(tame, time_limit=2)),
    ]
    return [path.read_text() for path in (one.save(FOLDER / "seed.json") for one in made)]


def sealed(text: str) -> str:
    """With the digests of the content as it is now."""
    document = json.loads(text)
    data, *proof = (document.get(name) for name in ("data", "claim", "witness"))
    return resealed(text, sha256=check.digest(data), sha256_of_proof=check.digest(proof))


def decided(certificate: Certificate) -> int:
    """What the checker's exit code should be."""
    try:
        certificate.check()
    except check.Rejected:
        return 1
    except check.Unreadable:
        return 2
    return 0


def try_input(data: bytes) -> None:
    """Load and check it, and run the checker on it."""
    given = FOLDER / "given.json"
    given.write_bytes(data)
    with contextlib.redirect_stdout(io.StringIO()) as told:
        code = check.main([str(given)])
    assert told.getvalue().split(":")[0] == ("accepted", "rejected", "unreadable")[code]
    try:
        certificate = Certificate.load(given)
    except FormatError:
        assert code != 0, "what is no certificate was accepted"
        return
    assert decided(certificate) == code
    again = Certificate.load(certificate.save(FOLDER / "saved.json"))
    assert again.document == certificate.document and repr(again) == repr(certificate)
    if code == 0 and set(BOUNDS) <= set(certificate.claim):
        assert certificate.lower <= certificate.upper, "a lower bound above the upper one was accepted"


if __name__ == "__main__":
    run(seeds(), sealed, try_input)
