"""What gap the optimum is proven to, in what time: easy cases and the hard end."""

import control
import numpy as np
from scipy.linalg import expm

from switchctl import Gaussian, ModeSet, Optimal, Rules, schedule
from switchctl.models import five_mode, medium_access, quadrotor, servo, suspension
from switchctl.tables import text_table


def row(name: str, modes: ModeSet, x0: Gaussian, gap: float, rules: Rules | None = None) -> list[str]:
    """Search for a minute at most."""
    found = schedule(modes, x0, Optimal(gap=gap), rules=rules)
    nodes, seconds = found.statistics["nodes"], found.statistics["seconds"]
    assert found.lower_bound is not None
    told = [f"{found.cost:.8g}", f"{found.lower_bound:.8g}", f"{found.gap:.1e}", f"{seconds:.2f}"]
    return [name, *told, f"{nodes:,.0f}", found.status]


def masses(h: float) -> tuple[ModeSet, Gaussian]:
    """A chain of three masses between walls, its first one forced, under fast and slow poles; sampled closed loops."""
    k, c = 8.0, 0.05
    springs = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    F = np.block([[np.zeros((3, 3)), np.eye(3)], [-k * springs, -c * springs]])
    G = np.zeros((6, 1))
    G[3] = 1
    poles = [[-5 + 3j, -5 - 3j, -4 + 5j, -4 - 5j, -3, -6], [-0.5 + 2j, -0.5 - 2j, -0.7 + 4j, -0.7 - 4j, -0.6, -1]]
    A = [expm(h * (F - G @ control.place(F, G, p))) for p in poles]
    S = 1e-6 * np.eye(6)
    S[0, 0] += 1
    return ModeSet(A, ["fast", "slow"], h), Gaussian(np.zeros(6), S)


def many(kind: str, n: int, m: int, count: int) -> list[str]:
    """Random modes: how many were proven to 1e-6 within ten seconds, and in what time."""
    rng, times, proven = np.random.default_rng(0), [], 0
    for _ in range(count):
        if kind == "sampled":
            F = rng.standard_normal((m, n, n))
            shift = np.linalg.eigvals(F).real.max(axis=1) + rng.uniform(0.1, 1.0, m)
            A = expm(0.1 * (F - shift[:, None, None] * np.eye(n)))
        else:
            A = rng.standard_normal((m, n, n))
            if kind == "orthogonal":
                A = np.linalg.qr(A)[0] * rng.uniform(0.3, 1.2, (m, 1, n))
            A *= (rng.uniform(0.8, 0.98, m) / np.abs(np.linalg.eigvals(A)).max(axis=1))[:, None, None]
        x0 = Gaussian(rng.standard_normal(n), 0.1 * np.eye(n))
        found = schedule(ModeSet(A), x0, Optimal(gap=1e-6, time_limit=10))
        assert found.gap is not None
        proven += found.gap <= 1e-6
        times.append(found.statistics["seconds"])
    return [f"{kind}, n = {n}, m = {m}", f"{proven} of {count}", f"{np.median(times):.3f}", f"{max(times):.2f}"]


if __name__ == "__main__":
    schedule(five_mode.modes(), five_mode.initial_state(), Optimal())  # the first one imports the solver
    quad = quadrotor.modes("closed_loop"), quadrotor.initial_state()
    rows = [
        row("example 1", five_mode.modes(), five_mode.initial_state(), 1e-9),
        row("quadrotor", *quad, 3e-4),
        row("quadrotor, a minute", *quad, 1e-5),
    ]
    rows += [row(f"quadrotor, dwell {dwell}", *quad, 1e-6, Rules(min_dwell=dwell)) for dwell in (5, 10, 25, 50)]
    rows += [row(model.__name__[17:], model.modes(), model.initial_state(), 1e-3) for model in (servo, suspension)]
    rows.append(row("medium_access", medium_access.modes(), medium_access.initial_state(), 1e-3, medium_access.rules()))
    rows.append(row("three masses, h = 0.05", *masses(0.05), 1e-6))
    for dwell, gap in ((25, 1e-6), (10, 1e-6), (5, 3e-3), (1, 1e-2)):
        rows.append(row(f"three masses, h = 0.01, dwell {dwell}", *masses(0.01), gap, Rules(min_dwell=dwell)))
    print(text_table(["", "cost", "proven", "gap", "s", "moments", "status"], rows))
    print()
    rows = [many("Gaussian", n, m, 30) for n in (2, 4, 8) for m in (2, 5)]
    rows += [many("orthogonal", n, m, 30) for n in (2, 4, 8) for m in (2, 5)]
    rows += [many("sampled", n, 2, 30) for n in (2, 4, 6)]
    print(text_table(["", "proven to 1e-6", "median (s)", "longest (s)"], rows))
