"""A certificate: a claim with its data and its witness, as JSON, which `check.py` decides by itself."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from switchctl.certificates import check
from switchctl.files import FormatError, read_document, write_json
from switchctl.moments import Array

SHARES = 0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4  # that bounds are loosened by, until they hold exactly
_DAMAGE = check.Rejected, check.Unreadable, LookupError, TypeError, ValueError, ArithmeticError, RecursionError


@dataclass(frozen=True, eq=False)
class Certificate:
    """A claim with what it takes to check it.

    Parameters
    ----------
    document : dict
        Data, claim and witness, as the file has them.

    Raises
    ------
    TypeError
        If a part is missing.

    Examples
    --------
    >>> from switchctl.certificates import certify
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> found = schedule(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), Refine())
    >>> certificate = certify(found, gap=1e-5)
    >>> certificate.check()
    >>> print(round(certificate.lower, 3), round(certificate.upper, 3))
    14.442 14.442
    """

    document: dict[str, Any]

    def __post_init__(self) -> None:
        parts = ("kind", "data", "claim", "witness")
        if not isinstance(self.document, dict) or not all(part in self.document for part in parts):
            raise TypeError(
                f"document must be a dict with {', '.join(parts)}, as the file has it, not {self.document!r:.80}; "
                "certify makes a certificate, Certificate.load reads one"
            )

    @classmethod
    def of(cls, kind: str, data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> "Certificate":
        """Seal a claim: with the sha256 of its data, and of itself with its witness.

        Parameters
        ----------
        kind : str
            What is claimed: one of `check.KINDS`.
        data, claim, witness : dict
            As the file has them.

        Returns
        -------
        Certificate

        Raises
        ------
        TypeError, ValueError
            If a part is no dict of what JSON can hold, or the kind is not known.
        """
        if kind not in list(check.KINDS):
            raise ValueError(f"kind is {kind!r}; expected one of {', '.join(check.KINDS)}")
        for name, part in (("data", data), ("claim", claim), ("witness", witness)):
            if not isinstance(part, dict):
                raise TypeError(f"{name} must be a dict, as the file has it, not {part!r:.80}")
            try:
                json.dumps(part, allow_nan=False)
            except (TypeError, ValueError) as error:
                raise type(error)(f"{name} must hold what JSON can: {error}") from None
        head = {"format": "switchctl certificate", "version": check.VERSION, "kind": kind}
        seals = {"sha256": check.digest(data), "sha256_of_proof": check.digest([claim, witness])}
        return cls({**head, "data": data, "claim": claim, "witness": witness, **seals})

    @property
    def kind(self) -> str:
        """What is claimed: "optimum", "joint spectral radius", "dwell time", .."""
        return str(self.document["kind"])

    @property
    def claim(self) -> dict[str, Any]:
        """The claim, in numbers."""
        return {key: _number(value) for key, value in self.document["claim"].items()}

    @property
    def lower(self) -> float:
        """The lower bound claimed: of the least cost, or of a growth."""
        return self._bound("lower")

    @property
    def upper(self) -> float:
        """The upper bound claimed."""
        return self._bound("upper")

    def _bound(self, name: str) -> float:
        if name not in self.claim:
            raise AttributeError(f"a certificate of kind {self.kind!r} has no {name!r}; its claim is {self.claim}")
        return float(self.claim[name])

    @property
    def gap(self) -> float:
        """``1 - lower / upper``."""
        return 1 - self.lower / self.upper if self.upper > 0 else 0.0

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Certificate":
        """Read what `save` wrote; `check` decides it.

        Parameters
        ----------
        path : path-like
            The file to read.

        Returns
        -------
        Certificate

        Raises
        ------
        FormatError
            If the file is no certificate, or was changed after it was written.
        """
        document = read_document(path, "certificate", check.VERSION)
        try:
            check.opened(document)
            certificate = cls(document)
            repr(certificate)
        except _DAMAGE as error:
            raise FormatError(f"{path} is a damaged certificate, take another copy or make it anew: {error}") from None
        return certificate

    def check(self) -> None:
        """Decide the claim in exact arithmetic, as ``check.py`` does.

        Raises
        ------
        switchctl.certificates.check.Rejected
            If it isn't proven.
        """
        check.check(self.document)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write it as JSON, for ``python check.py PATH``.

        Parameters
        ----------
        path : path-like
            The file to write.

        Returns
        -------
        pathlib.Path
        """
        return write_json(path, self.document)

    def __repr__(self) -> str:
        return f"Certificate claiming that {self._statement()}"

    def _statement(self) -> str:
        claim, witness = self.claim, self.document["witness"]
        if self.kind == "optimum":
            count = len(witness["tree"])
            prefixes = f"{count} prefix{'es' * (count != 1)}"
            return f"the least cost lies between {self.lower:.8g} and {self.upper:.8g} (gap {self.gap:.2g}), {prefixes}"
        if self.kind == "joint spectral radius":
            return f"the joint spectral radius lies between {self.lower:.10g} and {self.upper:.10g}"
        if self.kind == "mean square":
            return f"the rate of the root mean square lies between {self.lower:.10g} and {self.upper:.10g} a step"
        if self.kind == "rollout":
            return f"under rollout the least cost of a mode shrinks to {claim['rate'] ** 2:.8g} of itself a step"
        if self.kind == "switching":
            gain, helps = claim["gain"], claim["moment"] is not None
            parts = [f"switching saves at most {100 * gain:.3g} %"] if gain is not None else []
            return ", ".join([*parts, *(["it helps from the moment given"] if helps else [])])
        parts = [f"every signal with {self.kind} {claim['stable']} is stable"] if claim["stable"] is not None else []
        parts += [f"one with {claim['unstable']} is not"] if claim["unstable"] is not None else []
        return ", ".join(parts)


def loosened(bound: float, prove: Callable[[float], None], down: bool = False) -> float:
    """A bound near the one given, above or below it, that holds in exact arithmetic."""
    near = [bound * (1 - share if down else 1 + share) for share in SHARES] if bound else []
    small = [*SHARES, 1e-2, 0.1] if bound < 1e-6 and not down else []  # a weaker claim beside what is hardly above zero
    for claimed in [*near, *(least for least in small if least >= bound)]:
        if holds(partial(prove, claimed)):
            return claimed
    raise ValueError(f"the bound {bound} is too ill-conditioned to be proven in exact arithmetic")


def holds(prove: Callable[[], None]) -> bool:
    """Whether the checker accepts a proof."""
    try:
        prove()
    except check.Rejected:
        return False
    return True


def _number(value: Any) -> Any:
    """Hexadecimal numbers as floats; anything else as it is."""
    if isinstance(value, list):
        return [_number(entry) for entry in value]
    return float.fromhex(value) if isinstance(value, str) else value


def exact(matrix: Array) -> list[list[str]]:
    """A matrix in hexadecimal numbers."""
    return [[float(entry).hex() for entry in row] for row in matrix]
