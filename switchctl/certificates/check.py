"""Decide a certificate: exact arithmetic, the standard library alone.

    python check.py claim.json

Exit code 0: accepted, the claim is proven; 1: rejected; 2: unreadable. README.md beside this file has the argument.

Numbers are hexadecimal floats, so they are exact; matrices are kept as integers over a power of two.
"""

import hashlib
import json
import sys
from collections.abc import Callable
from fractions import Fraction
from operator import mul
from typing import Any

VERSION = 2
LARGEST = 10_000  # bits of a moment, steps of a word
BITS = 160  # of a moment below the size of the first one
BYTES = 1 << 27  # of a file
STATES = 100
NODES = 100_000
WORK = 5 * 10**9  # multiplications, and bits of the numbers in a matrix
EXACT = 40_000  # bits of a determinant
PARTS = "format version kind data claim witness sha256 sha256_of_proof"


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
        need(shift * len(self.rows) ** 2 <= WORK // 5, "numbers differ in size beyond all use")
        return Matrix([[entry << shift for entry in row] for row in self.rows], exponent)

    def __add__(self, other: "Matrix") -> "Matrix":
        exponent = max(self.exponent, other.exponent)
        pairs = zip(self.at(exponent).rows, other.at(exponent).rows, strict=True)
        return Matrix([[a + b for a, b in zip(x, y, strict=True)] for x, y in pairs], exponent)

    def __neg__(self) -> "Matrix":
        return Matrix([[-entry for entry in row] for row in self.rows], self.exponent)

    def __matmul__(self, other: "Matrix") -> "Matrix":
        columns = list(zip(*other.rows, strict=True))
        rows = [[sum(map(mul, row, column)) for column in columns] for row in self.rows]
        return Matrix(rows, self.exponent + other.exponent)

    def transposed(self) -> "Matrix":
        """Rows as columns."""
        return Matrix([list(column) for column in zip(*self.rows, strict=True)], self.exponent)

    def symmetric(self) -> bool:
        """Whether it equals its transpose."""
        return all(self.rows[i][j] == self.rows[j][i] for i in range(len(self.rows)) for j in range(i))

    def coarse(self, up: bool) -> "Matrix":
        """The same rounded in the Loewner order, up or down, to so many bits of its greatest entry."""
        excess = max(abs(entry).bit_length() for row in self.rows for entry in row) - BITS
        return self.rounded(self.exponent - excess, up) if excess > 0 else self

    def times(self, factor: Fraction) -> "Matrix":
        """The same times a number over a power of two."""
        top, exponent = factor.numerator, factor.denominator.bit_length() - 1
        return Matrix([[entry * top for entry in row] for row in self.rows], self.exponent + exponent)

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

    def surely_definite(self) -> bool:
        """Whether it is seen to be positive definite by an elimination that rounds down in the Loewner order."""
        M = self.coarse(up=False).rows
        while M:
            pivot = M[0][0]
            if pivot <= 0:
                return False
            M = [[M[i][j] - -(-M[0][i] * M[0][j] // pivot) for j in range(1, len(M))] for i in range(1, len(M))]
            for i in range(len(M)):
                M[i][i] -= len(M)
        return True

    def definite(self, strictly: bool = False) -> bool:
        """Whether it is positive semidefinite (or definite): by elimination without fractions where it isn't clear."""
        if self.surely_definite():
            return True
        if len(self.rows) * max(abs(entry).bit_length() for row in self.rows for entry in row) > EXACT:
            return False
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


def transformed(A: Matrix, P: Matrix) -> Matrix:
    """``A' P A``."""
    return A.transposed() @ P @ A


def identity(n: int, factor: float) -> Matrix:
    """A multiple of the identity."""
    return Matrix([[int(i == j) for j in range(n)] for i in range(n)], 0).times(Fraction(factor))


def number(text: Any) -> float:
    """Read a hexadecimal number."""
    if not isinstance(text, str) or len(text) > 40 or not text.lstrip("+-").startswith("0x"):
        raise Unreadable(f"{text!r:.50} stands where a hexadecimal number should")
    try:
        value = float.fromhex(text)
        if value - value != 0 or value.hex() != text:  # what is rounded when it is read would not be what is claimed
            raise ValueError
    except (ValueError, OverflowError):
        raise Unreadable(f"{text!r} is not a finite hexadecimal number as float.hex writes it") from None
    return value


def listed(value: Any) -> list[Any]:
    """Read a list."""
    if not isinstance(value, list):
        raise Unreadable(f"{value!r:.50} stands where a list should")
    return value


def matrices(value: Any) -> list[Matrix]:
    """Read matrices that are square and of one size."""
    n = len(listed(listed(value)[0])) if value else 0
    if not (1 <= n <= STATES and len(value) <= NODES):
        raise Unreadable(f"{len(value)} matrices with {n} states; expected 1 to {NODES} with 1 to {STATES}")
    return [Matrix.read(M, n) for M in value]


def need(holds: bool, why: str) -> None:
    """Reject the claim unless something holds."""
    if not holds:
        raise Rejected(why)


class Problem:
    """Modes, moves and costs: minimise the sum over a run of ``weight tr(Q S) + constant``, and what switches cost."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.A = matrices(data["A"])
        self.n = n = len(self.A[0].rows)
        self.Q = [Matrix.read(Q, n) for Q in data["Q"]]
        self.period = Fraction(number(data["period"]))
        self.moves = [[tuple(map(whole, move)) for move in moves] for moves in data["moves"]]
        self.last = [whole(mode) for mode in data["last"]]
        self.switch = [[number(x) for x in row] for row in data["switch_cost"]]
        self.by_w2 = [[number(x) for x in row] for row in data["switch_cost_per_w2"]]
        self.price = [number(x) for x in data["price"]]
        self.terminal = None if data["terminal"] is None else Matrix.read(data["terminal"], n)
        self.end = Matrix([], 0) if self.terminal is None else self.terminal.times(self.period)
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
        weight = self.Q[mode].times(self.period) + identity(self.n, self.by_w2[before][mode])
        return weight, self.period * Fraction(self.price[mode]) + Fraction(self.switch[before][mode])

    def before(self, v: int, mode: int, L: Matrix) -> Matrix:
        """``Q + A' L A``."""
        A = self.A[mode]
        return self.step(v, mode)[0] + transformed(A, L)


def whole(value: Any) -> int:
    """Read a whole number."""
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > 10**9:
        raise Unreadable(f"{value!r:.50} stands where a whole number should")
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
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def optimum(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Every run costs at least ``lower``, and one at most ``upper``."""
    problem = Problem(data)
    lower, upper = (Fraction(number(claim[name])) for name in ("lower", "upper"))
    need(lower <= proven_lower(problem, witness), "a run may cost less than claimed")
    need(proven_upper(problem, witness) <= upper, "the run costs more than claimed")


class Graph:
    """Steps ``x+ = A x`` from node to node: for each node the matrices and the nodes after."""

    def __init__(self, A: list[Matrix], moves: list[list[tuple[int, int]]]) -> None:
        self.A, self.moves = A, moves
        need(all(0 <= k < len(A) and 0 <= w < len(moves) for ways in moves for k, w in ways), "a move leads nowhere")
        need(bool(moves) and all(moves), "a run comes to an end")

    @classmethod
    def read(cls, data: dict[str, Any]) -> "Graph":
        """Read the moves of a graph."""
        if len(listed(data["moves"])) > NODES:
            raise Unreadable(f"the graph has more than {NODES} nodes")
        return cls(matrices(data["A"]), [[(whole(k), whole(w)) for k, w in ways] for ways in data["moves"]])

    @classmethod
    def with_dwell(cls, data: dict[str, Any], dwell: list[int]) -> "Graph":
        """The runs in which each mode i is held for ``dwell[i]`` steps; ``data.first[j][i]`` is its step after j."""
        A = matrices(data["A"])
        m = len(A)
        need(len(dwell) == m and min(dwell) >= 1, "the dwell times are not one for each mode")
        if sum(dwell) > NODES or m * m > NODES:
            raise Unreadable(f"the dwell times need more than {NODES} nodes")
        begin = [sum(dwell[:i]) for i in range(m)]
        first = [[i for i in range(m)] for _ in range(m)]
        if data["first"] is not None:
            A = A + [Matrix.read(M, len(A[0].rows)) for row in data["first"] for M in row]
            need([len(row) for row in data["first"]] == [m] * m, "the first steps are incomplete")
            first = [[i if i == j else m + m * j + i for i in range(m)] for j in range(m)]
        moves = []
        for j in range(m):
            moves += [[(j, begin[j] + c)] for c in range(1, dwell[j])]
            last = begin[j] + dwell[j] - 1
            moves.append([(first[j][i], last if i == j else begin[i]) for i in range(m)])
        return cls(A, moves)

    def grows_at_most(self, bound: float, witness: dict[str, Any]) -> None:
        """Every run grows by at most a constant times ``bound ** k``: ``A R A' <= bound^(2 steps) R`` from cut to cut.

        The R are the inverses of quadratic norms at the nodes.
        """
        n, rank = len(self.A[0].rows), [whole(r) for r in witness["rank"]]
        need(bound >= 0 and len(rank) == len(self.moves), "the bound is negative, or a node has no rank")
        norms = [(whole(v), Matrix.read(R, n)) for v, R in listed(witness["norms"])]
        need(all(0 <= v < len(rank) and R.symmetric() and R.definite(True) for v, R in norms), "a norm is not one")
        need(len(listed(witness["trees"])) == len(norms), "a norm has no tree")
        if sum(map(len, witness["trees"])) * n**3 > WORK:
            raise Unreadable("the trees would take too long")
        need(all(rank[w] <= rank[v] for v, ways in enumerate(self.moves) for _, w in ways), "a rank rises")
        self.meets_a_norm({v for v, _ in norms}, rank)
        for (v, R), tree in zip(norms, witness["trees"], strict=True):
            tokens = iter(listed(tree))
            stack = [(w, k, R, 1) for k, w in reversed(self.moves[v]) if rank[w] == rank[v]]
            while stack:
                u, k, X, steps = stack.pop()
                X = (self.A[k] @ X @ self.A[k].transposed()).coarse(up=True)
                token = whole(next(tokens, -2))
                if token == -1:
                    need(steps < LARGEST, "a run is cut too late")
                    stack += [(w, k, X, steps + 1) for k, w in reversed(self.moves[u]) if rank[w] == rank[u]]
                    continue
                need(0 <= token < len(norms) and norms[token][0] == u, "a run is cut where there is no norm")
                most = norms[token][1].times(power(bound, 2 * steps, up=False))
                need((most + -X).definite(), f"a run grows by more than {bound}")
            need(next(tokens, None) is None, "a tree goes on after its end")

    def meets_a_norm(self, known: set[int], rank: list[int]) -> None:
        """Every run comes to a node with a norm, or to one of lower rank, again and again."""
        left = {v: sum(rank[w] == rank[v] for _, w in ways) for v, ways in enumerate(self.moves) if v not in known}
        into: dict[int, list[int]] = {}
        for v in left:
            for _, w in self.moves[v]:
                if rank[w] == rank[v]:
                    into.setdefault(w, []).append(v)
        ready = [*known, *(v for v, count in left.items() if count == 0)]
        while ready:
            for v in into.pop(ready.pop(), []):
                left[v] -= 1
                ready += [v] if left[v] == 0 else []
        need(not any(left.values()), "a run may go on for ever without a norm")

    def may_grow(self, bound: float, witness: dict[str, Any]) -> None:
        """A cycle repeated for ever grows by at least ``bound`` a step: ``M' H M >= bound^(2 steps) H``, x' H x > 0."""
        start = v = whole(witness["node"])
        word: list[int] = []
        for way in listed(witness["moves"]):
            need(0 <= v < len(self.moves) and 0 <= whole(way) < len(self.moves[v]), "the cycle leaves the graph")
            k, v = self.moves[v][way]
            word.append(k)
        need(v == start and 0 < len(word) <= LARGEST, "the cycle is not closed, or too long")
        if len(word) * len(self.A[0].rows) ** 3 > WORK:
            raise Unreadable("the cycle would take too long")
        H = X = indefinite(witness, len(self.A[0].rows))
        for k in reversed(word):
            X = transformed(self.A[k], X).coarse(up=False)
        least = H.times(power(bound, 2 * len(word), up=True))
        need((X + -least).definite(), f"the cycle may grow by less than {bound}")


def indefinite(witness: dict[str, Any], n: int) -> Matrix:
    """Read a symmetric matrix H and a vector x with ``x' H x > 0``."""
    H, x = Matrix.read(witness["H"], n), Matrix.read(witness["x"], n, 1)
    need(H.symmetric() and (x.transposed() @ H @ x).rows[0][0] > 0, "x' H x is not positive")
    return H


def power(base: float, exponent: int, up: bool) -> Fraction:
    """A number close to a power, above or below it."""
    factor, bottom = base.as_integer_ratio()
    value, places = 1, 0  # value / 2 ** places
    for bit in bin(exponent)[2:]:
        value, places = value * value * (factor if bit == "1" else 1), 2 * places
        places += bottom.bit_length() - 1 if bit == "1" else 0
        shift = max(0, value.bit_length() - BITS)
        value, places = (value >> shift) + (up and shift > 0), places - shift
    need(abs(places) <= 200 * LARGEST, "a power is beyond all use")
    return Fraction(value, 1 << places) if places >= 0 else Fraction(value << -places)


def joint_spectral_radius(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Every run of the graph grows by at most ``upper`` a step, and one by at least ``lower``."""
    graph = Graph.read(data)
    graph.grows_at_most(number(claim["upper"]), witness["upper"])
    if number(claim["lower"]) != 0:
        graph.may_grow(positive(claim["lower"]), witness["lower"])


def dwell_time(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Every signal with dwell times ``stable`` vanishes; one with dwell times ``unstable`` does not."""
    need(claim["stable"] is not None or claim["unstable"] is not None, "nothing is claimed")
    if claim["stable"] is not None:
        rate = number(witness["rate"])
        need(rate < 1, "the growth is not below one")
        Graph.with_dwell(data, [whole(d) for d in claim["stable"]]).grows_at_most(rate, witness["stable"])
    if claim["unstable"] is not None:
        Graph.with_dwell(data, [whole(d) for d in claim["unstable"]]).may_grow(1.0, witness["unstable"])


def average_dwell_time(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Every signal with an average dwell time ``stable`` vanishes; one with ``unstable`` does not."""
    graph = Graph.with_dwell(data, [1] * len(data["A"]))
    decay, jump = positive(witness["decay"]), positive(witness["jump"])
    top, bottom = number(claim["stable"]).as_integer_ratio()
    need(0 <= top <= 10**6 and bottom <= 64 and jump >= 1, "the time is not in 64ths of a step, or the jump below one")
    enough = power(jump, bottom, up=True) * power(decay, top, up=True) < 1 or (jump == 1 and decay < 1)
    need(enough, "the norms grow more than they shrink")
    P = [Matrix.read(P, len(graph.A[0].rows)) for P in witness["P"]]
    need(len(P) == len(graph.moves) and all(X.symmetric() and X.definite(True) for X in P), "a norm is not one")
    for j, ways in enumerate(graph.moves):
        for k, i in ways:
            most = P[j].times(Fraction(decay) ** 2 * (1 if i == j else Fraction(jump) ** 2))
            need((most + -transformed(graph.A[k], P[i])).definite(), "a norm grows more than it should")
    if claim["unstable"] is not None:
        graph.may_grow(1.0, witness["unstable"])
        ways = witness["unstable"]["moves"]
        switches = sum(a != b for a, b in zip(ways, ways[1:] + ways[:1], strict=True))
        need(switches * Fraction(number(claim["unstable"])) <= len(ways), "the word switches more often")


def mean_square(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Moments that move by weighted sums of ``A S A'`` grow by at most ``upper ** 2`` and at least ``lower ** 2``."""
    A = matrices(data["A"])
    n, moves = len(A[0].rows), [[(whole(k), whole(w), number(p)) for k, w, p in ways] for ways in data["moves"]]
    need(
        all(0 <= k < len(A) and 0 <= w < len(moves) and p >= 0 for ways in moves for k, w, p in ways), "a move is none"
    )

    def before(v: int, X: list[Matrix]) -> Matrix:
        total = identity(n, 0.0)
        for k, w, weight in moves[v]:
            total = total + transformed(A[k], X[w]).times(Fraction(weight))
        return total

    lower, upper = (Fraction(number(claim[name])) for name in ("lower", "upper"))
    need(upper >= 0 and bool(moves), "the bound is negative, or there is no node")
    P = [Matrix.read(X, n) for X in witness["P"]]
    need(len(P) == len(moves) and all(X.symmetric() and X.definite(True) for X in P), "a P is not positive definite")
    need(all((X.times(upper**2) + -before(v, P)).definite() for v, X in enumerate(P)), "moments may grow faster")
    if lower != 0:
        H = [Matrix.read(X, n) for X in witness["H"]]
        need(lower > 0 and len(H) == len(moves) and all(X.symmetric() for X in H), "an H is missing or not symmetric")
        need(0 <= whole(witness["node"]) < len(H), "x stands at no node")
        indefinite({"H": witness["H"][witness["node"]], "x": witness["x"]}, n)
        need(all((before(v, H) + -X.times(lower**2)).definite() for v, X in enumerate(H)), "moments may grow slower")


class Costs:
    """Modes with stage weights: what they cost for ever, and means of that."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.A = matrices(data["A"])
        self.n = len(self.A[0].rows)
        self.Q = [Matrix.read(Q, self.n) for Q in data["Q"]]
        need(len(self.Q) == len(self.A), "the data is incomplete")
        need(all(Q.symmetric() and Q.definite() for Q in self.Q), "a stage weight is not positive semidefinite")
        self.effort = 0

    def read(self, value: Any) -> Matrix:
        """Read a symmetric matrix."""
        M = Matrix.read(value, self.n)
        need(M.symmetric(), "a matrix is not symmetric")
        return M

    def before(self, word: list[int], P: Matrix, up: bool) -> Matrix:
        """What modes one after the other cost, and then P; or a matrix above (or below) that."""
        if len(word) > LARGEST:
            raise Unreadable(f"a word of more than {LARGEST} modes")
        for i in reversed(word):
            need(0 <= i < len(self.A), "a word names no mode")
            self.effort += self.n**3
            P = (self.Q[i] + transformed(self.A[i], P)).coarse(up)
            need(abs(P.exponent) <= 2 * LARGEST, "a cost is beyond all use")
            if self.effort > WORK // 200:
                raise Unreadable("the words would take too long")
        return P

    def above(self, value: Any, word: list[int]) -> Matrix:
        """Read a matrix above what a word costs, repeated for ever."""
        P = self.read(value)
        need(
            bool(word) and P.definite() and (P + -self.before(word, P, True)).definite(),
            "a cost may be higher than told",
        )
        return P

    def mean(self, weights: Any, P: list[Matrix]) -> Matrix:
        """A combination with weights of at least zero and one in all: not less than the least, of any moment."""
        alpha = [Fraction(number(a)) for a in listed(weights)]
        need(len(alpha) == len(P) and min(alpha) >= 0 and sum(alpha) >= 1, "weights are missing, or below one in all")
        total = identity(self.n, 0.0)
        for a, X in zip(alpha, P, strict=True):
            total = total + X.times(a)
        return total


def switching(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """No sequence costs less than ``1 - gain`` times the best single mode; from a moment, one costs less than it."""
    costs = Costs(data)
    need(claim["gain"] is not None or claim["moment"] is not None, "nothing is claimed")
    if claim["gain"] is not None:
        need(all(Q.definite(True) for Q in costs.Q), "a stage weight is not positive definite")
        modes = [whole(p) for p in listed(witness["gain"]["modes"])]
        above = [costs.above(P, [p]) for p, P in zip(modes, witness["gain"]["above"], strict=True)]
        below = [costs.read(P) for P in witness["gain"]["below"]]
        kept = 1 - Fraction(number(claim["gain"]))
        need(kept >= 0 and len(below) == len(modes) > 0, "the gain is more than everything, or a bound is missing")
        for P, most in zip(below, above, strict=True):
            need((P + -most.times(kept)).definite(), "a single mode may cost more than is kept of it")
        for i, row in zip(range(len(costs.A)), witness["gain"]["combinations"], strict=True):
            for L, weights in zip(below, row, strict=True):
                need(
                    (costs.before([i], L, False) + -costs.mean(weights, below)).definite(),
                    "a step may lead below the bound",
                )
    if claim["moment"] is None:
        need(claim["cost"] is claim["lead"] is claim["word"] is None, "a cost is claimed from no moment")
    else:
        S, cost = costs.read(claim["moment"]), Fraction(number(claim["cost"]))
        need(S.definite(), "the moment is not positive semidefinite")
        word = [whole(i) for i in listed(claim["word"])]
        lead = costs.before([whole(i) for i in listed(claim["lead"])], costs.above(witness["tail"], word), True)
        need(dot(lead, S) <= cost, "the sequence costs more than claimed")
        need(len(listed(witness["single"])) == len(costs.A), "a mode is left out")
        for i, proof in enumerate(witness["single"]):
            need(dot(single_below(costs, i, proof), S) > cost, f"mode {i} alone may cost no more")


def single_below(costs: Costs, i: int, proof: dict[str, Any]) -> Matrix:
    """A matrix below what a mode held for ever costs: its cost over some steps, or L no greater than ``Q + A' L A``.

    The latter of a Schur mode, in a norm that shrinks, so that what is left of L vanishes.
    """
    if "steps" in proof:
        L = identity(costs.n, 0.0)
        need(0 < whole(proof["steps"]) <= 10 * LARGEST, "the steps are too many")
        for _ in range(proof["steps"]):
            L = costs.before([i], L, False)
        return L
    L, X = costs.read(proof["below"]), costs.read(proof["norm"])
    shrinks = X.definite(True) and (X + -transformed(costs.A[i], X)).definite(True)
    need(shrinks and (costs.before([i], L, False) + -L).definite(), f"mode {i} may cost less than told")
    return L


def rollout(data: dict[str, Any], claim: dict[str, Any], witness: dict[str, Any]) -> None:
    """Under the least over one step and then one mode for ever, the least cost of a mode falls by ``rate ** 2``."""
    costs, share = Costs(data), Fraction(number(witness["share"]))
    modes = [whole(p) for p in listed(witness["modes"])]
    above = [costs.above(P, [p]) for p, P in zip(modes, witness["above"], strict=True)]
    need(0 < share <= 1 and Fraction(positive(claim["rate"])) ** 2 >= 1 - share, "the rate does not follow")
    need(all(P.definite(True) for P in above), "a cost is not positive definite")
    for Q, weights in zip(costs.Q, witness["combinations"], strict=True):
        need((Q + -costs.mean(weights, above).times(share)).definite(), "a step may cost less than that share")


def positive(text: Any) -> float:
    """Read a number above zero."""
    value = number(text)
    need(value > 0, f"{value} is not above zero")
    return value


KINDS: dict[str, tuple[Callable[[dict[str, Any], dict[str, Any], dict[str, Any]], None], str]] = {
    "optimum": (optimum, "lower upper"),
    "joint spectral radius": (joint_spectral_radius, "lower upper"),
    "dwell time": (dwell_time, "stable unstable"),
    "average dwell time": (average_dwell_time, "stable unstable"),
    "mean square": (mean_square, "lower upper"),
    "switching": (switching, "gain moment cost lead word"),
    "rollout": (rollout, "rate"),
}


def opened(document: dict[str, Any]) -> tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]:
    """The kind, data, claim and witness of a certificate that is whole and as it was written."""
    if document["format"] != "switchctl certificate" or document["version"] != VERSION:
        raise Unreadable("not a switchctl certificate of this version")
    if foreign := document.keys() - set(PARTS.split()):
        raise Unreadable(f"it holds {min(foreign)!r:.50}; expected only {PARTS}")
    kind, data, claim, witness = (document[name] for name in ("kind", "data", "claim", "witness"))
    if not isinstance(kind, str) or kind not in KINDS:
        raise Unreadable(f"a certificate of an unknown kind, {kind!r:.50}")
    if not all(isinstance(part, dict) for part in (data, claim, witness)):
        raise Unreadable("its data, claim and witness are not objects")
    need(document["sha256"] == digest(data), "the data was changed")
    need(document["sha256_of_proof"] == digest([claim, witness]), "the claim or the witness was changed")
    if set(claim) != set(KINDS[kind][1].split()):
        raise Unreadable(f"the claim is of {', '.join(claim)}; expected {KINDS[kind][1]}")
    return kind, data, claim, witness


def check(document: dict[str, Any]) -> None:
    """Raise `Rejected` unless the claim is proven, `Unreadable` where the document is no certificate."""
    try:
        kind, data, claim, witness = opened(document)
        KINDS[kind][0](data, claim, witness)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError) as error:
        raise Unreadable(f"not a certificate: {type(error).__name__} {error}") from None


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a JSON file, no key of which may come twice."""
    if len(dict(pairs)) < len(pairs):
        raise Unreadable("a key comes twice")
    return dict(pairs)


def told(value: Any) -> str:
    """A part of a claim, in decimals."""
    if isinstance(value, list):
        return f"[{', '.join(map(told, value))}]"
    return repr(float.fromhex(value)) if isinstance(value, str) else "none" if value is None else str(value)


def main(arguments: list[str]) -> int:
    """Decide the file named."""
    if len(arguments) != 1:
        print("usage: python check.py claim.json", file=sys.stderr)
        return 2
    try:
        with open(arguments[0], "rb") as file:
            content = file.read(BYTES + 1)
        if len(content) > BYTES:
            raise Unreadable(f"a file of more than {BYTES} bytes")
        document = json.loads(content.decode(), object_pairs_hook=once)
        check(document)
    except Rejected as error:
        print(f"rejected: {error}")
        return 1
    except (Unreadable, OSError, ValueError, RecursionError, MemoryError) as error:
        print(f"unreadable: {error}")
        return 2
    except KeyboardInterrupt:
        print("interrupted: nothing is decided", file=sys.stderr)
        return 130
    claims = [f"{key} = {told(value)}" for key, value in document["claim"].items()]
    print(f"accepted: {document['kind']}, {', '.join(claims)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
