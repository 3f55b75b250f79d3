"""Decide a certificate: exact arithmetic, the standard library alone.

    python check.py claim.json

Exit code 0: accepted, the claim is proven; 1: rejected; 2: unreadable. README.md beside this file has the argument.

Numbers are hexadecimal floats, so they are exact; matrices are kept as integers over a power of two.
"""

import hashlib
import json
import sys
from fractions import Fraction
from typing import Any

VERSION = 1
LARGEST = 10_000  # bits
BITS = 160  # of a moment below the size of the first one


class Rejected(Exception):
    """The claim does not follow from the witness."""


class Unreadable(Exception):
    """The document is not a certificate."""


class Matrix:
    """A symmetric or square matrix of integers over ``2 ** exponent``."""

    def __init__(self, rows: list[list[int]], exponent: int) -> None:
        self.rows, self.exponent = rows, exponent

    @classmethod
    def read(cls, value: Any, n: int, columns: int | None = None) -> "Matrix":
        """Read hexadecimal numbers, n by n or n by as many columns."""
        columns = n if columns is None else columns
        if not isinstance(value, list) or len(value) != n or any(len(listed(row)) != columns for row in value):
            raise Unreadable(f"a matrix is not {n} by {columns}")
        ratios = [[number(entry).as_integer_ratio() for entry in row] for row in value]
        exponent = max(bottom.bit_length() - 1 for row in ratios for _, bottom in row)
        rows = [[top << (exponent - bottom.bit_length() + 1) for top, bottom in row] for row in ratios]
        return cls(rows, exponent)

    def at(self, exponent: int) -> "Matrix":
        """The same over a greater power of two."""
        shift = exponent - self.exponent
        return Matrix([[entry << shift for entry in row] for row in self.rows], exponent)

    def __add__(self, other: "Matrix") -> "Matrix":
        exponent = max(self.exponent, other.exponent)
        pairs = zip(self.at(exponent).rows, other.at(exponent).rows, strict=True)
        return Matrix([[a + b for a, b in zip(x, y, strict=True)] for x, y in pairs], exponent)

    def __neg__(self) -> "Matrix":
        return Matrix([[-entry for entry in row] for row in self.rows], self.exponent)

    def __matmul__(self, other: "Matrix") -> "Matrix":
        columns = list(zip(*other.rows, strict=True))
        rows = [[sum(a * b for a, b in zip(row, column, strict=True)) for column in columns] for row in self.rows]
        return Matrix(rows, self.exponent + other.exponent)

    def transposed(self) -> "Matrix":
        """Rows as columns."""
        return Matrix([list(column) for column in zip(*self.rows, strict=True)], self.exponent)

    def symmetric(self) -> bool:
        """Whether it equals its transpose."""
        return all(self.rows[i][j] == self.rows[j][i] for i in range(len(self.rows)) for j in range(i))

    def rounded(self, exponent: int, up: bool = False) -> "Matrix":
        """A matrix over a smaller power of two, below this one in the Loewner order (or above it).

        Each entry is rounded down by less than one unit, which changes the matrix by less than n units times the
        identity, up or down; n units are taken from the diagonal (or added). So the trace of what is lost is at most
        2 n^2 units.
        """
        n, shift = len(self.rows), self.exponent - exponent
        if shift <= 0:
            return self.at(exponent)
        rows = [[entry >> shift for entry in row] for row in self.rows]
        for i in range(n):
            rows[i][i] += n if up else -n
        return Matrix(rows, exponent)

    def definite(self, strictly: bool = False) -> bool:
        """Whether it is positive semidefinite (or definite), by elimination without fractions."""
        M, last = [row[:] for row in self.rows], 1
        for k in range(len(M)):
            pivot = M[k][k]
            if pivot < 0 or (pivot == 0 and (strictly or any(M[k][k:]))):
                return False
            for i in range(k + 1, len(M)):
                for j in range(i, len(M)):
                    if pivot:
                        M[i][j] = (M[i][j] * pivot - M[k][i] * M[k][j]) // last
                    M[j][i] = M[i][j]
            last = pivot or last
        return True


def dot(X: Matrix, Y: Matrix) -> Fraction:
    """The trace of a product of symmetric matrices."""
    top = sum(a * b for x, y in zip(X.rows, Y.rows, strict=True) for a, b in zip(x, y, strict=False))
    exponent = X.exponent + Y.exponent
    return Fraction(top, 1 << exponent) if exponent >= 0 else Fraction(top << -exponent)


def identity(n: int, factor: float) -> Matrix:
    """A multiple of the identity."""
    top, bottom = factor.as_integer_ratio()
    rows = [[top if i == j else 0 for j in range(n)] for i in range(n)]
    return Matrix(rows, bottom.bit_length() - 1)


def number(text: Any) -> float:
    """Read a hexadecimal number."""
    if not isinstance(text, str) or not text.lstrip("+-").startswith("0x"):
        raise Unreadable(f"{text!r} stands where a hexadecimal number should")
    try:
        value = float.fromhex(text)
        if value - value != 0:
            raise ValueError
    except (ValueError, OverflowError):
        raise Unreadable(f"{text!r} is not a finite hexadecimal number") from None
    return value


def listed(value: Any) -> list[Any]:
    """Read a list."""
    if not isinstance(value, list):
        raise Unreadable(f"{value!r} stands where a list should")
    return value


def need(holds: bool, why: str) -> None:
    """Reject the claim unless something holds."""
    if not holds:
        raise Rejected(why)


class Problem:
    """Modes, moves and costs: minimise the sum over a run of ``weight tr(Q S) + constant``, and what switches cost."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.n = n = len(data["mean"])
        self.A = [Matrix.read(A, n) for A in data["A"]]
        self.Q = [Matrix.read(Q, n) for Q in data["Q"]]
        self.period = number(data["period"])
        self.moves = [[tuple(map(whole, move)) for move in moves] for moves in data["moves"]]
        self.last = [whole(mode) for mode in data["last"]]
        self.switch = [[number(x) for x in row] for row in data["switch_cost"]]
        self.by_w2 = [[number(x) for x in row] for row in data["switch_cost_per_w2"]]
        self.price = [number(x) for x in data["price"]]
        self.terminal = None if data["terminal"] is None else Matrix.read(data["terminal"], n)
        self.end = Matrix([], 0) if self.terminal is None else scaled(self.terminal, self.period)
        mean = Matrix.read(data["mean"], n, 1)
        self.S = mean @ mean.transposed() + Matrix.read(data["cov"], n)
        m = len(self.A)
        need(len(self.Q) == m and len(self.price) == m and len(self.last) == len(self.moves), "the data is incomplete")
        need(all(Q.symmetric() and Q.definite() for Q in self.Q), "a stage weight is not positive semidefinite")
        need(self.S.symmetric() and self.S.definite(), "the initial moment is not positive semidefinite")
        need(self.period > 0 and min(self.price) >= 0, "the period or a price is negative")
        costs = [x for row in self.switch + self.by_w2 for x in row]
        need(len(costs) == 2 * m * (m + 1) and min(costs) >= 0, "the costs of switches are incomplete or negative")
        for moves in self.moves:
            need(all(0 <= mode < m and 0 <= head < len(self.moves) for mode, head in moves), "a move leads nowhere")
            need(len({mode for mode, _ in moves}) == len(moves), "a mode is offered twice")
        if self.terminal is not None:
            need(all(head > v for v, moves in enumerate(self.moves) for _, head in moves), "a run may never end")
            need(self.terminal.symmetric() and self.terminal.definite(), "the terminal weight is indefinite")
        else:
            need(all(self.moves), "a run that goes on for ever comes to an end")

    def step(self, v: int, mode: int) -> tuple[Matrix, Fraction]:
        """The weight and the constant of a step."""
        before = self.last[v]
        weight = scaled(self.Q[mode], self.period) + identity(self.n, self.by_w2[before][mode])
        return weight, Fraction(self.period) * Fraction(self.price[mode]) + Fraction(self.switch[before][mode])

    def before(self, v: int, mode: int, L: Matrix) -> Matrix:
        """``Q + A' L A``."""
        A = self.A[mode]
        return self.step(v, mode)[0] + A.transposed() @ L @ A


def scaled(M: Matrix, factor: float) -> Matrix:
    """A matrix times a number."""
    top, bottom = factor.as_integer_ratio()
    return Matrix([[entry * top for entry in row] for row in M.rows], M.exponent + bottom.bit_length() - 1)


def whole(value: Any) -> int:
    """Read a whole number."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise Unreadable(f"{value!r} stands where a whole number should")
    return value


def bounds_at(problem: Problem, given: dict[str, Any], unit: int) -> dict[int, Matrix]:
    """One lower bound at every node: given, or of the one move from there; checked on every move."""
    L: dict[int, Matrix] = {}
    V = len(problem.moves)
    for node, value in given.items():
        L[int(node)] = Matrix.read(value, problem.n)
        need(L[int(node)].symmetric(), "a bound is not symmetric")
    if problem.terminal is not None:
        L |= {v: problem.end for v in range(V) if not problem.moves[v]}
    for v in range(V):
        path: list[int] = []
        while v not in L:
            need(len(problem.moves[v]) == 1 and len(path) <= V, "a node with several moves has no bound")
            path.append(v)
            v = problem.moves[v][0][1]
        for u in reversed(path):
            mode, head = problem.moves[u][0]
            L[u] = problem.before(u, mode, L[head]).rounded(unit)
    for v, moves in enumerate(problem.moves):
        for mode, head in moves:
            left = problem.before(v, mode, L[head]) + -L[v]
            need(left.definite(), f"a bound at node {v} exceeds what a step in mode {mode} may cost")
    return L


def resolution(problem: Problem) -> int:
    """The power of two that moments are kept over: so many bits below the first one."""
    trace = dot(problem.S, identity(problem.n, 1.0))
    return BITS - trace.numerator.bit_length() + trace.denominator.bit_length()


def proven_lower(problem: Problem, witness: dict[str, Any]) -> Fraction:
    """What every run costs at least: it begins with a prefix that the tree gives up for a bound of what follows."""
    n = problem.n
    if problem.terminal is None:  # then what is left of a run of finite cost vanishes
        need(all(Q.definite(strictly=True) for Q in problem.Q), "a stage weight is not positive definite")
    unit = resolution(problem)
    chosen = {int(v) for v in witness["bounds"][0]}
    need(all({int(v) for v in given} == chosen for given in witness["bounds"]), "the bounds are at different nodes")
    bounds = [bounds_at(problem, given, max(unit, BITS)) for given in witness["bounds"]]
    guards = [number(x) for x in listed(witness["guards"])]
    need(len(guards) == len(bounds) and min(guards) >= 0, "a guard for each bound is needed, none below zero")
    for L, guard in zip(bounds, guards, strict=True):
        need(all((M + identity(n, guard)).definite() for M in L.values()), "a bound is below its guard")
    lost = Fraction(2 * n * n, 1 << unit) if unit >= 0 else Fraction(2 * n * n << -unit)
    stack, tree = [(0, problem.S.rounded(unit), Fraction(0), 1)], iter(listed(witness["tree"]))
    least: Fraction | None = None
    while stack:
        v, S, paid, rounds = stack.pop()
        moves = problem.moves[v]
        if not moves:
            worth = paid + dot(problem.end, S)
            least = worth if least is None else min(least, worth)
            continue
        need(v in chosen or len(moves) == 1, "a node with several moves has no bound")
        token = next(tree, None) if v in chosen else -1
        if token is None:
            raise Rejected("the tree is cut short")
        if token != -1:
            need(0 <= whole(token) < len(bounds), "the tree names a bound that is not there")
            worth = paid + dot(bounds[token][v], S) - Fraction(guards[token]) * lost * rounds
            least = worth if least is None else min(least, worth)
            continue
        for mode, head in reversed(moves):
            weight, constant = problem.step(v, mode)
            A = problem.A[mode]
            after = (A @ S @ A.transposed()).rounded(unit)
            need(abs(after.rows[0][0]).bit_length() < LARGEST, "a moment grows beyond all use")
            stack.append((head, after, paid + dot(weight, S) + constant, rounds + 1))
    need(next(tree, None) is None, "the tree goes on after its end")
    assert least is not None
    return least


def proven_upper(problem: Problem, witness: dict[str, Any]) -> Fraction:
    """What the run given costs at most."""
    unit = resolution(problem)
    v, S, paid = 0, problem.S.rounded(unit, up=True), Fraction(0)
    for mode in witness["lead"]:
        weight, constant = problem.step(v, mode)
        paid += dot(weight, S) + constant
        A, v = problem.A[mode], move_to(problem, v, mode)
        S = (A @ S @ A.transposed()).rounded(unit, up=True)
    if problem.terminal is not None:
        need(not problem.moves[v], "the run is cut short")
        return paid + dot(problem.end, S)
    P, u = Matrix.read(witness["tail"], problem.n), v
    need(P.symmetric() and P.definite() and witness["word"], "the cost of the tail is not one")
    costs = []
    for mode in witness["word"]:
        costs.append((u, mode))
        need(problem.step(u, mode)[1] == 0, "the tail pays a constant cost for ever")
        u = move_to(problem, u, mode)
    need(u == v, "the tail can't be repeated")
    period = P
    for node, mode in reversed(costs):
        period = problem.before(node, mode, period)
    need((P + -period).definite(), "the tail costs more than its matrix says")
    return paid + dot(P, S)


def move_to(problem: Problem, v: int, mode: int) -> int:
    """The node that a move leads to."""
    heads = [head for offered, head in problem.moves[v] if offered == mode]
    need(bool(heads), "the run takes a move that is not there")
    return heads[0]


def digest(data: Any) -> str:
    """The sha256 of the data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def check(document: dict[str, Any]) -> None:
    """Raise `Rejected` unless the claim is proven, `Unreadable` where the document is no certificate."""
    try:
        if document["format"] != "switchctl certificate" or document["version"] != VERSION:
            raise Unreadable("not a switchctl certificate of this version")
        data, claim, witness = document["data"], document["claim"], document["witness"]
        need(document["sha256"] == digest(data), "the data was changed")
        problem = Problem(data)
        lower, upper = (Fraction(number(claim[name])) for name in ("lower", "upper"))
        need(lower <= proven_lower(problem, witness), "a run may cost less than claimed")
        need(proven_upper(problem, witness) <= upper, "the run costs more than claimed")
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError) as error:
        raise Unreadable(f"not a certificate: {type(error).__name__} {error}") from None


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a JSON file, no key of which may come twice."""
    if len(dict(pairs)) < len(pairs):
        raise Unreadable("a key comes twice")
    return dict(pairs)


def main(arguments: list[str]) -> int:
    """Decide the file named."""
    if len(arguments) != 1:
        print("usage: python check.py claim.json", file=sys.stderr)
        return 2
    try:
        with open(arguments[0], encoding="utf-8") as file:
            check(json.load(file, object_pairs_hook=once))
    except Rejected as error:
        print(f"rejected: {error}")
        return 1
    except (Unreadable, OSError, ValueError, RecursionError, MemoryError) as error:
        print(f"unreadable: {error}")
        return 2
    print("accepted")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
