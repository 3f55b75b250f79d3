"""Certificates of Schur and mean-square stability."""

from typing import Any

from switchctl.certificates import check
from switchctl.certificates.certificate import Certificate, exact, loosened
from switchctl.stability import GrowthRate


def mean_square(found: GrowthRate) -> Certificate:
    """Prove both bounds of the growth of moments."""
    moves: list[list[Any]] = [[] for _ in found.P]
    for k, move in enumerate(found.moves):
        moves[move.tail].append([k, move.head, move.weight.hex()])
    data = {"of": found.of, "A": [exact(move.A) for move in found.moves], "moves": moves}
    node, x = found.start
    witness = {
        "P": [exact(P) for P in found.P],
        "H": [exact(H) for H in found.H],
        "node": node,
        "x": exact(x[:, None]),
    }
    nothing = (0.0).hex()

    def above(rate: float) -> None:
        check.mean_square(data, {"lower": nothing, "upper": rate.hex()}, witness)

    upper = loosened(found.upper, above)
    claim = {"lower": nothing, "upper": upper.hex()}
    if found.lower > 0:

        def both(rate: float) -> None:
            check.mean_square(data, {"lower": rate.hex(), "upper": upper.hex()}, witness)

        claim["lower"] = loosened(found.lower, both, down=True).hex()
    return Certificate.of("mean square", data, claim, witness)
