"""Certificates of whether switching helps, and of how fast rollout falls."""

import math
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from switchctl.certificates import check
from switchctl.certificates.certificate import SHARES, Certificate, exact, holds
from switchctl.gramians import word_tail
from switchctl.methods import Rollout
from switchctl.modes import ModeSet
from switchctl.moments import Array, transform
from switchctl.stability import PolicyStability, SwitchingHelp
from switchctl.stability.falling import largest_share
from switchctl.values import require_definite_weights, require_plain_total

_STEPS = 10_000  # of a mode held, added up by the checker


def switching(found: SwitchingHelp) -> Certificate:
    """Prove how much switching may help at most, and that it does from a moment."""
    data = _data(found.modes)
    claim: dict[str, Any] = dict.fromkeys(("gain", "moment", "cost", "lead", "word"))
    witness: dict[str, Any] = dict.fromkeys(("gain", "tail", "single"))
    finite = [p for p, P in enumerate(found.modes.tails) if P is not None]
    for share, kept in product(SHARES, [finite, *([p] for p in finite)] if found.combinations else ()):
        part = _gain(found, share, kept)
        if holds(partial(check.switching, data, {**claim, "gain": part[0]}, {**witness, "gain": part[1]})):
            claim["gain"], witness["gain"] = part
            break
    if found.helps:
        for share in SHARES:
            parts = _moment(found, share)
            if holds(partial(check.switching, data, {**claim, **parts[0]}, {**witness, **parts[1]})):
                claim, witness = {**claim, **parts[0]}, {**witness, **parts[1]}
                break
    if claim["moment"] is None and (found.helps or claim["gain"] is None):
        raise ValueError(
            f"nothing can be proven in exact arithmetic ({found.why}): a stage weight may be indefinite by rounding, "
            "and a bound of what switching saves needs definite ones; add a small multiple of the identity to Q"
        )
    return Certificate.of("switching", data, claim, witness)


def _data(modes: ModeSet) -> dict[str, Any]:
    return {"names": list(modes.names), "A": [exact(A) for A in modes.A], "Q": [exact(Q) for Q in modes.Q]}


def _gain(found: SwitchingHelp, share: float, finite: list[int]) -> tuple[str, dict[str, Any]]:
    """The most that switching may save, with costs moved by a share, and the proof, by the costs of some modes."""
    modes = found.modes
    P = np.array([modes.tails[p] for p in finite])
    kept = (1 - found.gain) * (1 - 4 * share)
    above, below = P * (1 + share), P * (1 - found.gain) * (1 - share)
    combinations = []
    for i in range(len(modes)):
        rows = [found.combinations[i, q][finite] if len(finite) > 1 else np.ones(1) for q in finite]
        combinations.append([[(max(a, 0.0) * (1 + 1e-15)).hex() for a in row / row.sum()] for row in rows])
    proof = {
        "modes": finite,
        "above": [exact(M) for M in above],
        "below": [exact(M) for M in below],
        "combinations": combinations,
    }
    return math.nextafter(1 - kept, 1.0).hex(), proof


def _moment(found: SwitchingHelp, share: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """The moment from which a sequence costs less than every mode alone, with costs moved by a share, and the proof."""
    modes, S = found.modes, found.moment
    lead, word = ([found.pair[0]], [found.pair[1]]) if found.pair else ([], list(found.word or ()))
    assert S is not None  # switching helps
    P, norm = _tail(modes, tuple(word))
    tail = cost = P + share * (P + norm)
    for mode in lead:
        cost = modes.Q[mode] + transform(modes.A[mode], cost)
    told = float(np.sum(cost * S)) * (1 + share)
    claim = {"moment": exact(S), "cost": told.hex(), "lead": lead, "word": word}
    single: list[dict[str, Any]] = []
    for p in range(len(modes)):
        if modes.tails[p] is not None and modes.schur[p]:
            P, norm = _tail(modes, (p,))
            single.append({"below": exact(P - share * (P + norm)), "norm": exact(norm)})
        else:
            single.append({"steps": min(found.outlasted.get(p, _STEPS), _STEPS)})
    return claim, {"tail": exact(tail), "single": single}


def _tail(modes: ModeSet, word: tuple[int, ...]) -> tuple[Array, Array]:
    """What a word repeated for ever costs, and a norm of that size that shrinks by every round."""
    identity = np.broadcast_to(np.eye(modes.A.shape[-1]), modes.A.shape)
    P, norm = word_tail(modes.A, modes.Q, word), word_tail(modes.A, identity, word)
    assert P is not None and norm is not None  # the word contracts
    return P, norm * (np.linalg.norm(P) / np.linalg.norm(norm))


def rollout(found: PolicyStability) -> Certificate:
    """Prove how fast the least cost of a mode falls under rollout."""
    graph, modes = found.graph, found.graph.modes
    if found.verdict != "stable":
        raise ValueError(f"nothing was proven of {found.method!r}, so there is nothing to certify: {found.why}")
    require_plain_total(modes, "a certificate of rollout")
    paid = graph.price.any() or graph.switch_cost.any() or graph.switch_cost_per_w2.any()
    plain = graph.free and modes.activation is None and not paid
    if not (isinstance(found.method, Rollout) and found.fall is not None and plain):
        raise ValueError(
            f"{found.method!r} has no certificate of its own here; only Rollout has one, without rules, prices and "
            "activation. Certify what stability rests on: schur_stability(modes)[i], word_stability(modes, word)"
        )
    require_definite_weights(modes, "a certificate of rollout")
    finite = [p for p, P in enumerate(modes.tails) if P is not None]
    for slack in SHARES[1:]:
        P = np.array([modes.tails[p] for p in finite]) * (1 + slack)
        shares, mixes = zip(*(largest_share(Q, P) for Q in modes.Q), strict=True)
        share = min(shares) * (1 - slack)
        witness = {
            "modes": finite,
            "above": [exact(M) for M in P],
            "combinations": [[(a * (1 + 1e-15)).hex() for a in mix] for mix in mixes],
            "share": share.hex(),
        }
        claim = {"rate": math.nextafter(math.sqrt(1 - share) * (1 + 1e-15), math.inf).hex()}
        if share > 0 and holds(partial(check.rollout, _data(modes), claim, witness)):
            return Certificate.of("rollout", _data(modes), claim, witness)
    raise ValueError("the rate is too ill-conditioned to be proven in exact arithmetic")
