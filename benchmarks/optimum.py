"""The optimum against mixed-integer programs and enumeration: the same finite horizon, in time and in truth."""

import itertools
import sys
from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import block_array, coo_array, csr_array, eye_array, hstack, kron

from switchctl import Gaussian, ModeSet, Optimal, schedule
from switchctl.models import five_mode
from switchctl.moments import Array, moment_maps, svec
from switchctl.tables import text_table

GAP = 1e-6
LIMIT = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
ENUMERATED = 500_000


class Program(NamedTuple):
    """Minimise ``c x`` subject to ``low <= M x <= high`` and the bounds; the last variables are binary."""

    c: Array
    M: csr_array
    low: Array
    high: Array
    least: Array
    most: Array
    binaries: int


def program(modes: ModeSet, S: Array, N: int, hull: bool) -> Program:
    """The moments of every step, and which mode takes it: by the convex hull of the modes, or with big numbers."""
    K, Q = moment_maps(modes.A), svec(modes.Q[0])
    m, d = K.shape[:2]
    # |svec(S_k)| is at most the trace, which grows by at most the greatest squared norm, and which in an optimum is at
    # most what the best single mode costs in all.
    size = np.trace(S) * np.linalg.norm(modes.A, 2, axis=(1, 2)).max() ** (2 * np.arange(N + 1))
    size = np.minimum(size, min(true_cost(modes, S, (i,) * N) for i in range(m)))
    moments, parts, binaries = d * (N + 1), d * m * N if hull else 0, m * N
    rows: list[tuple[csr_array, Array, Array]] = []

    def add(blocks: list[csr_array], low: Array, high: Array) -> None:
        rows.append((hstack([csr_array(block) for block in blocks], format="csr"), low, high))

    nothing = lambda r, c: csr_array((r, c))  # noqa: E731
    s = svec(S)
    first = hstack([eye_array(d), nothing(d, moments - d)])
    add([first, nothing(d, parts), nothing(d, binaries)], s, s)
    one = kron(eye_array(N), np.ones((1, m)))
    add([nothing(N, moments), nothing(N, parts), one], np.ones(N), np.ones(N))
    here, there = (hstack([nothing(d * N, d * k), eye_array(d * N), nothing(d * N, d * (1 - k))]) for k in (0, 1))
    if hull:
        zero = np.zeros(d * N)
        add([there, kron(eye_array(N), -np.hstack(list(K))), nothing(d * N, binaries)], zero, zero)
        add([-here, kron(eye_array(N), np.hstack([np.eye(d)] * m)), nothing(d * N, binaries)], zero, zero)
        bound = kron(csr_array(np.diag(size[:N])), kron(eye_array(m), np.ones((d, 1))))
        for sign in (1, -1):
            empty = np.full(parts, -np.inf)
            add([nothing(parts, moments), sign * eye_array(parts), -bound], empty, np.zeros(parts))
    else:
        for i in range(m):
            chosen = coo_array((np.ones(N), (np.arange(N), np.arange(N) * m + i)), shape=(N, binaries))
            large = kron(csr_array(np.diag(2 * size[1:])), np.ones((d, 1)))
            step = there - block_array([[kron(eye_array(N), K[i]), nothing(d * N, d)]])
            for sign in (1, -1):
                high = np.repeat(2 * size[1:], d)
                add(
                    [sign * step, kron(chosen, np.ones((d, 1))).multiply(large @ np.ones((N, 1)))], -np.inf * high, high
                )
    columns = moments + parts + binaries
    c = np.zeros(columns)
    c[:moments] = np.tile(Q, N + 1)  # the last moment has the weight of a stage
    most = np.concatenate([np.repeat(size, d), np.tile(np.repeat(size[:N], d * m), hull), np.ones(binaries)])
    least = np.concatenate([-most[:-binaries], np.zeros(binaries)])
    matrices, lows, highs = zip(*rows, strict=True)
    M = csr_array(block_array([[matrix] for matrix in matrices]))
    return Program(c, M, np.concatenate(lows), np.concatenate(highs), least, most, binaries)


Answer = tuple[str, float, Array | None]  # status, claimed cost, the binaries


def highs(p: Program) -> Answer:
    """HiGHS, by SciPy."""
    whole = np.append(np.zeros(len(p.c) - p.binaries), np.ones(p.binaries))
    found = milp(
        p.c,
        integrality=whole,
        bounds=Bounds(p.least, p.most),
        constraints=LinearConstraint(p.M, p.low, p.high),
        options={"time_limit": LIMIT, "mip_rel_gap": GAP},
    )
    return ("closed" if found.status == 0 else "time limit"), found.fun or np.nan, found.x


def scip(p: Program) -> Answer:
    """SCIP, by pyscipopt."""
    from pyscipopt import Model, quicksum

    model = Model()
    model.hideOutput()
    model.setParam("limits/time", LIMIT)
    model.setParam("limits/gap", GAP)
    first = len(p.c) - p.binaries
    x = [
        model.addVar(vtype="B" if j >= first else "C", lb=p.least[j], ub=p.most[j], obj=p.c[j]) for j in range(len(p.c))
    ]
    for r in range(p.M.shape[0]):
        part = slice(p.M.indptr[r], p.M.indptr[r + 1])
        row = quicksum(v * x[j] for j, v in zip(p.M.indices[part], p.M.data[part], strict=True))
        model.addCons(row <= p.high[r])
        if p.low[r] == p.high[r]:
            model.addCons(row >= p.low[r])
    model.optimize()
    done = model.getStatus() in ("optimal", "gaplimit")
    if not model.getNSols():
        return "time limit", np.nan, None
    return ("closed" if done else "time limit"), model.getObjVal(), np.array([model.getVal(v) for v in x])


def gurobi(p: Program) -> Answer:
    """Gurobi, whose restricted licence takes 2000 variables and rows."""
    import gurobipy

    with gurobipy.Env(params={"OutputFlag": 0}) as env, gurobipy.Model(env=env) as model:
        model.Params.TimeLimit, model.Params.MIPGap, model.Params.Threads = LIMIT, GAP, 1
        kinds = np.array(["C"] * (len(p.c) - p.binaries) + ["B"] * p.binaries)
        x = model.addMVar(len(p.c), lb=p.least, ub=p.most, obj=p.c, vtype=kinds)
        equal = p.low == p.high
        model.addMConstr(p.M[equal], x, "=", p.high[equal])
        model.addMConstr(p.M[~equal], x, "<", p.high[~equal])
        try:
            model.optimize()
        except gurobipy.GurobiError:
            return "too large for its licence", np.nan, None
        if not model.SolCount:
            return "time limit", np.nan, None
        return ("closed" if model.Status == 2 else "time limit"), model.ObjVal, x.X


HEADING = ["problem", "solver", "s", "to Optimal", "status", "claimed", "true cost of its answer"]
SOLVERS: dict[str, Callable[[Program], Answer]] = {"HiGHS": highs, "SCIP": scip, "Gurobi": gurobi}


def true_cost(modes: ModeSet, S: Array, sequence: tuple[int, ...]) -> float:
    """The sum of W2 from k = 0 to N, from the modes alone."""
    cost = np.trace(S)
    for mode in sequence:
        S = modes.A[mode] @ S @ modes.A[mode].T
        cost += np.trace(S)
    return float(cost)


def compare(name: str, modes: ModeSet, x0: Gaussian, N: int) -> list[list[str]]:
    """One row for each way to solve a problem."""
    S, m, n = x0.second_moment, len(modes), len(x0.mean)
    schedule(modes, x0, Optimal(gap=0.5), N, terminal=np.eye(n))  # the first one imports the solver
    begun = perf_counter()
    best = schedule(modes, x0, Optimal(gap=GAP, time_limit=LIMIT), N, terminal=np.eye(n))
    ours = perf_counter() - begun
    truth = true_cost(modes, S, tuple(best.sequence.tolist()))
    title = f"{name}, N = {N}"
    told = [[title, "Optimal", f"{ours:.3f}", "1", best.status, f"{best.cost:.7f}", f"{truth:.7f}"]]
    if m**N <= ENUMERATED:
        begun = perf_counter()
        least = min(true_cost(modes, S, sequence) for sequence in itertools.product(range(m), repeat=N))
        spent = perf_counter() - begun
        told.append(
            ["", "enumeration", f"{spent:.2f}", f"{spent / ours:,.0f}", "closed", f"{least:.7f}", f"{least:.7f}"]
        )
    for solver, solve in SOLVERS.items():
        for hull in (True, False):
            label = f"{solver}, {'hull' if hull else 'big M'}"
            p = program(modes, S, N, hull)
            begun = perf_counter()
            try:
                status, claimed, x = solve(p)
            except ImportError:
                told.append(["", label, "", "", "not installed", "", ""])
                continue
            spent = perf_counter() - begun
            row = ["", label, f"{spent:.2f}"]
            if x is None:
                told.append([*row, "", status, "", ""])
                continue
            ratio = f"{'' if status == 'closed' else '> '}{spent / ours:,.0f}"
            true = true_cost(modes, S, tuple(x[-p.binaries :].reshape(N, m).argmax(axis=1).tolist()))
            # Its own sequence doesn't cost what it says, or it says that it has closed above the optimum.
            wrong = abs(true - claimed) > 1e-6 * true or (status == "closed" and true > truth * 1.00001)
            told.append([*row, ratio, status, f"{claimed:.7f}", f"{true:.7f}{' FALSE' if wrong else ''}"])
    return told


def sampled(n: int, seed: int) -> tuple[ModeSet, Gaussian]:
    """Two random Hurwitz matrices, sampled at 0.1 s."""
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((2, n, n))
    shift = np.linalg.eigvals(F).real.max(axis=1) + rng.uniform(0.1, 1.0, 2)
    A = expm(0.1 * (F - shift[:, None, None] * np.eye(n)))
    return ModeSet(A), Gaussian(rng.standard_normal(n), 0.1 * np.eye(n))


if __name__ == "__main__":
    problems = [("example 1", five_mode.modes(), five_mode.initial_state(), N) for N in (5, 8, 10, 15)]
    problems += [("expm(0.1 F), n = 4", *sampled(4, 5), N) for N in (20, 40)]
    for problem in problems:
        rows = compare(*problem)
        print(
            text_table(["problem", "solver", "s", "to Optimal", "status", "claimed", "true cost of its answer"], rows)
        )
        print(flush=True)
