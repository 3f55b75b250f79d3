"""Certificates of mean squares, of whether switching helps, of rollout: accepted as written, rejected when false."""

import copy

import numpy as np
import pytest

from switchctl import Constant, ModeSet, PointwiseMinimum, Rollout, Rules, SwitchingGraph
from switchctl.certificates import Certificate, certify
from switchctl.certificates.check import Rejected, Unreadable, check, digest
from switchctl.models import five_mode, medium_access, quadrotor, servo, suspension
from switchctl.stability import (
    does_switching_help,
    policy_stability,
    random_stability,
    schur_stability,
    stabilising_word,
    word_stability,
)


def random_modes(rng, m=None, n=None, most=1.05):
    m, n = m or int(rng.integers(2, 5)), n or int(rng.integers(1, 5))
    A = rng.normal(size=(m, n, n))
    radii = np.abs(np.linalg.eigvals(A)).max(axis=1)
    return ModeSet(A * (rng.uniform(0.4, most, size=m) / radii)[:, None, None])


def forged(certificate, change):
    """A certificate changed by a function of its document, with digests that fit."""
    document = copy.deepcopy(certificate.document)
    change(document)
    return Certificate.of(*(document[key] for key in ("kind", "data", "claim", "witness"))).document


def number(value, factor):
    return (float.fromhex(value) * factor).hex()


@pytest.mark.parametrize("seed", range(40))
def test_growth_of_moments(seed):
    rng = np.random.default_rng(seed)
    modes = random_modes(rng)
    chain = rng.dirichlet(np.ones(len(modes)), size=len(modes))
    word = rng.integers(len(modes), size=int(rng.integers(1, 6)))
    for found in (
        *schur_stability(modes),
        word_stability(modes, word),
        random_stability(modes, chain[0]),
        random_stability(modes, chain),
    ):
        certificate = certify(found)
        certificate.check()
        assert certificate.lower <= found.upper and found.lower <= certificate.upper
        assert certificate.gap < 1e-6
        for name, factor in (("upper", 1 - 1e-5), ("lower", 1 + 1e-5)):

            def change(document, name=name, factor=factor):
                document["claim"][name] = number(document["claim"][name], factor)

            with pytest.raises(Rejected):
                check(forged(certificate, change))


def test_growth_of_other_modes_is_rejected():
    certificate = certify(schur_stability(ModeSet([[[0.9, 1.0], [0.0, 0.5]]]))[0])

    def change(document):
        document["data"]["A"][0][0][0] = (0.91).hex()

    with pytest.raises(Rejected, match="may grow faster"):
        check(forged(certificate, change))


def test_a_mode_that_vanishes_at_once():
    for A in (np.zeros((2, 2)), np.diag([1.0], 1)):
        certificate = certify(schur_stability(ModeSet([A]))[0])
        certificate.check()
        assert certificate.lower == 0 and certificate.upper < 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_whether_switching_helps(seed):
    rng = np.random.default_rng(100 + seed)
    modes = random_modes(rng)
    found = does_switching_help(modes)
    if found.helps is None:
        return
    certificate = certify(found)
    certificate.check()
    claim = certificate.claim
    if found.helps:
        S = np.array(claim["moment"])
        path, costs = [*claim["lead"], *claim["word"] * 4000], []
        for sequence in (path, *([p] * 4000 for p in range(len(modes)))):
            X, total = S, 0.0
            for mode in sequence:
                total += float(np.sum(modes.Q[mode] * X))
                X = modes.A[mode] @ X @ modes.A[mode].T
            costs.append(total)
        assert costs[0] <= claim["cost"] * (1 + 1e-9) and claim["cost"] < min(costs[1:])

        def cheaper(document):
            document["claim"]["cost"] = number(document["claim"]["cost"], 1 - 1e-6)

        with pytest.raises(Rejected, match="costs more"):
            check(forged(certificate, cheaper))
    if claim["gain"] is not None:
        assert claim["gain"] == pytest.approx(found.gain, abs=1e-3)

        def less(document):
            document["claim"]["gain"] = (claim["gain"] * 0.999 - 1e-9).hex()

        with pytest.raises(Rejected):
            check(forged(certificate, less))


def test_no_switching_helps_with_a_mean_of_two():
    """Each mode is the best somewhere, no cost alone is below a step of the other, and nothing helps."""
    modes = ModeSet([np.diag([0.5, 0.6]), np.diag([0.6, 0.5])], Q=[np.diag([4.0, 1.0]), np.diag([1.0, 4.0])])
    certificate = certify(does_switching_help(modes))
    certificate.check()
    assert certificate.claim["gain"] < 1e-9 and certificate.claim["moment"] is None

    def change(document):  # the weights of another pair
        rows = document["witness"]["gain"]["combinations"]
        rows[0][1] = rows[1][1]

    with pytest.raises(Rejected, match="below the bound"):
        check(forged(certificate, change))

    def lighter(document):
        rows = document["witness"]["gain"]["combinations"]
        rows[0][1] = [number(a, 0.9) for a in rows[0][1]]

    with pytest.raises(Rejected, match="below one in all"):
        check(forged(certificate, lighter))


def test_a_mode_left_out_is_rejected():
    certificate = certify(does_switching_help(five_mode.modes()))

    def change(document):
        document["witness"]["single"].pop()

    with pytest.raises(Rejected, match="left out"):
        check(forged(certificate, change))

    def unproven(document):  # a matrix below the costs needs a norm that shrinks
        proof = document["witness"]["single"][0]
        proof["norm"] = [[number(x, -1) for x in row] for row in proof["norm"]]

    with pytest.raises(Rejected, match="may cost less"):
        check(forged(certificate, unproven))


def test_models_with_singular_weights():
    for modes in (servo.modes(), suspension.modes(), quadrotor.modes("closed_loop")):
        certificate = certify(does_switching_help(modes))
        certificate.check()
        assert certificate.claim["moment"] is not None
    try:
        certify(does_switching_help(medium_access.modes())).check()
    except ValueError as error:  # its weights are of rank one, and come from a Riccati solver
        assert "indefinite by rounding" in str(error)


@pytest.mark.parametrize("seed", range(20))
def test_rollout(seed):
    modes = random_modes(np.random.default_rng(200 + seed), most=0.99)
    certificate = certify(policy_stability(modes, Rollout()))
    certificate.check()
    share = 1 - certificate.claim["rate"] ** 2
    rng, P = np.random.default_rng(seed), modes.tails
    for _ in range(20):
        F = rng.normal(size=modes.A.shape[1:])
        S = F @ F.T
        best = min(float(np.sum(X * S)) for X in P)
        after = [
            min(float(np.sum(Q * S) + np.sum(X * (A @ S @ A.T))) for X in P)
            for A, Q in zip(modes.A, modes.Q, strict=True)
        ]
        i = int(np.argmin(after))
        S = modes.A[i] @ S @ modes.A[i].T
        assert min(float(np.sum(X * S)) for X in P) <= (1 - share) * best * (1 + 1e-9)

    def faster(document):
        document["claim"]["rate"] = number(document["claim"]["rate"], 1 - 1e-6)

    with pytest.raises(Rejected, match="does not follow"):
        check(forged(certificate, faster))


def test_what_has_no_certificate_says_so():
    modes = five_mode.modes()
    ruled = SwitchingGraph(modes, Rules(min_dwell=3))
    for graph, method in ((modes, Constant(0)), (modes, PointwiseMinimum()), (ruled, Rollout())):
        with pytest.raises(ValueError, match="no certificate of its own"):
            certify(policy_stability(graph, method))
    with pytest.raises(ValueError, match="is for schedules"):
        certify(schur_stability(modes)[0], gap=0.1)
    with pytest.raises(TypeError, match=r"a result of switchctl\.stability"):
        certify(schur_stability(modes))


def test_a_stabilising_word():
    found = stabilising_word(ModeSet([np.diag([2.0, 0.25]), np.diag([0.25, 2.0])]))
    certificate = certify(found)
    certificate.check()
    assert certificate.upper < 1
    assert "the rate of the root mean square" in repr(certificate)
    assert stabilising_word(ModeSet([[[1.5]], [[2.0]]])) is None


def test_under_rules_that_cost():
    """Prices of switches don't matter to stability; dwell times do."""
    modes = ModeSet([np.diag([1.2, 0.7]), np.diag([0.7, 1.2])])
    graph = SwitchingGraph(modes, Rules(min_dwell=3, switch_cost=1.0))
    found = stabilising_word(graph)
    assert found.verdict == "stable" and len(found.word) % 2 == 0 and len(found.word) >= 6
    certify(found).check()


@pytest.mark.parametrize("seed", range(10))
def test_whatever_is_changed_is_rejected_or_still_true(seed):
    """One number changed, with digests that fit: what the checker accepts must follow from a valid witness."""
    rng = np.random.default_rng(300 + seed)
    modes = random_modes(rng, m=2, n=2, most=0.99)
    certificates = [
        certify(found)
        for found in (
            does_switching_help(modes),
            schur_stability(modes)[0],
            random_stability(modes, [0.5, 0.5]),
            policy_stability(modes, Rollout()),
        )
    ]
    for certificate in certificates:
        places = [path for path in numbers(certificate.document["claim"])]
        for path in places:

            def change(document, path=path):
                at = document["claim"]
                for key in path[:-1]:
                    at = at[key]
                at[path[-1]] = "0x1.8p+0" if isinstance(at[path[-1]], str) else 7

            changed = forged(certificate, change)
            try:
                check(changed)
            except (Rejected, Unreadable):
                continue
            if path[0] == "lower":
                assert 1.5 <= float.fromhex(certificate.document["claim"]["lower"])
            elif path[0] != "moment":  # a smaller one is proven for itself
                assert path[0] in ("upper", "gain", "rate", "cost")
                assert 1.5 >= float.fromhex(certificate.document["claim"][path[0]])


def numbers(value, path=()):
    if isinstance(value, dict | list):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(entry, (*path, key))
    elif value is not None:
        yield path


def test_the_digest_is_of_what_is_claimed():
    certificate = certify(schur_stability(five_mode.modes())[0])
    document = copy.deepcopy(certificate.document)
    document["claim"]["upper"] = (0.1).hex()
    with pytest.raises(Rejected, match="was changed"):
        check(document)
    document["sha256_of_proof"] = digest([document["claim"], document["witness"]])
    with pytest.raises(Rejected, match="may grow faster"):
        check(document)


def test_what_a_policy_pays_besides_has_no_certificate():
    for graph, words in (
        (ModeSet([[[0.1]], [[0.9]]], offset=[1.0, 0.0]), "total costs"),
        (SwitchingGraph(ModeSet([[[0.1]], [[0.9]]]), Rules(price=[1.0, 0.0])), "no certificate of its own"),
        (ModeSet([[[0.1]], [[0.9]]], cost=("discounted", 0.5)), "total costs"),
    ):
        with pytest.raises(ValueError, match=words):
            certify(policy_stability(graph, Rollout()))


def test_a_claim_has_the_keys_of_its_kind():
    certificate = certify(does_switching_help(five_mode.modes()))
    claim = {**certificate.document["claim"], "lower": (1.0).hex()}
    with pytest.raises(Unreadable, match="expected gain moment"):
        check(
            Certificate.of("switching", certificate.document["data"], claim, certificate.document["witness"]).document
        )
    with pytest.raises(AttributeError, match="no 'lower'"):
        _ = certificate.lower

    def nowhere(document):
        document["claim"]["moment"] = None

    with pytest.raises(Rejected, match="from no moment"):
        check(forged(certificate, nowhere))


def test_endless_work_is_refused():
    A = [[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]], 2.0**100 * np.eye(2)
    certificate = certify(does_switching_help(ModeSet([*A])))
    certificate.check()

    def endless(document):
        document["witness"]["single"][2] = {"steps": 100_000}

    with pytest.raises(Rejected, match="beyond all use"):
        check(forged(certificate, endless))

    def long(document):
        document["claim"]["lead"] = [1] * 10**6

    with pytest.raises((Rejected, Unreadable)):
        check(forged(certify(does_switching_help(quadrotor.modes("closed_loop"))), long))
