"""How right a cost for ever is, ``P = Q + A' P A``, beside other solvers, against integers of as many digits as needed.

``python benchmarks/accuracy.py picture.png`` draws the picture, too.
"""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov

from switchctl.gramians import tail
from switchctl.moments import Array
from switchctl.tables import text_table

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from accuracy_cases import FAMILIES
from fixed_point import errors, exact_tail, ratios

STEPS = 10_000  # of the plain sum, at most
EPS = float(np.finfo(float).eps)
LIMIT = 1e18  # of the condition: beyond, no digit is left
NONE = 1e-17  # where a picture shows no error at all


class Answer(NamedTuple):
    """What a solver made of a mode: the greatest relative error on the diagonal, None where it refused."""

    hard: float
    error: float | None
    warned: bool = False
    indefinite: bool = False


def plain_sum(A: Array, Q: Array) -> Array:
    """Horner's rule until nothing changes, or for 10,000 steps."""
    P = Q
    for _ in range(STEPS):
        before, P = P, Q + A.T @ P @ A
        if np.array_equal(before, P):
            break
    return P


def slycot() -> Callable[[Array, Array], Array] | None:
    """python-control's solver by slycot, where that is installed."""
    try:
        import slycot  # noqa: F401
        from control import dlyap
    except ImportError:
        print("slycot is not installed: left out\n")
        return None
    return lambda A, Q: np.asarray(dlyap(A.T, Q, method="slycot"))


def indefinite(P: Array) -> bool:
    """Whether an eigenvalue is negative beyond rounding, in units fit for each state, or a diagonal entry negative."""
    diagonal = np.diag(P)
    if not (diagonal > 0).all():
        return True
    unit = np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh((P + P.T) / 2 / unit / unit[:, None]).min() < -1e-13 * len(P))


def condition(P: Array, A: Array, Q: Array) -> float:
    """``max Z_ii / P_ii``, ``Z = D + A' Z A``: what the rounding of a step is worth in the end."""
    size = np.abs(A)
    Z, M = np.diag(np.diag(size.T @ np.abs(P) @ size + np.abs(P) + np.abs(Q))), A
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(60):
            if np.linalg.norm(M) < 1e-20:
                break
            Z, M = Z + M.T @ Z @ M, M @ M
    worst = np.max(np.diag(Z) / np.diag(P))
    return float(worst) if worst < LIMIT else np.inf


def asked(solve: Callable[[Array, Array], Array | None], A: Array, Q: Array, exact: Any, bits: int) -> Answer:
    """Put a mode to a solver. A cost of a mode that rounding has made unstable is infinitely wrong."""
    hard = np.inf if exact is None else condition(ratios(exact, np.full(exact.shape, 1 << bits, dtype=object)), A, Q)
    with warnings.catch_warnings(record=True) as caught, np.errstate(over="ignore", invalid="ignore"):
        warnings.simplefilter("always")
        try:
            P = solve(A, Q)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError, Warning):
            return Answer(hard, None)
    if P is None or not np.isfinite(P).all():
        return Answer(hard, None)
    error = np.inf if exact is None else float(errors(P, exact, bits)[0])
    return Answer(hard, error, any(issubclass(w.category, LinAlgWarning) for w in caught), indefinite(P))


def row(solver: str, answers: list[Answer]) -> list[str]:
    told = [a.error for a in answers if a.error is not None]
    wrong = [a.warned for a in answers if a.error is not None and a.error > 1e-2]
    counts = len(answers) - len(told), sum(a.indefinite for a in answers), sum(wrong), len(wrong) - sum(wrong)
    return [solver, f"{np.median(told):.1e}", f"{max(told):.1e}", *map(str, counts)]


def draw(answers: dict[str, list[Answer]], path: str) -> None:
    """One panel a solver: relative error against the condition."""
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from switchctl.plotting.style import COLOURS

    top, refused = 1e3, 1e5
    figure, axes = plt.subplots(2, 3, figsize=(9, 5.6), sharex=True, sharey=True, layout="constrained")
    for ax, colour, marker, (solver, points) in zip(axes.ravel(), COLOURS, "osD^v", answers.items(), strict=False):
        points = [a._replace(hard=min(a.hard, LIMIT)) for a in points]
        ax.axhspan(1e-2, 1e4, color="#D55E00", alpha=0.12, linewidth=0)
        ax.plot([1, 1e18], [EPS, EPS * 1e18], color="0.45", linestyle="--", linewidth=1)
        sound = [a for a in points if a.error is not None and not (a.indefinite or a.warned)]
        doubted = [a for a in points if a.warned and not a.indefinite]
        unsound = [a for a in points if a.indefinite]
        silent = [a for a in points if a.error is None]
        look = {"linestyle": "none", "marker": marker, "color": colour, "markersize": 4}

        def place(some: list[Answer]) -> tuple[list[float], list[float]]:
            return [a.hard for a in some], [float(np.clip(a.error or 0.0, NONE, top)) for a in some]

        ax.plot(*place(sound), **look, alpha=0.75, markeredgewidth=0)
        ax.plot(*place(doubted), **look, markerfacecolor="none")
        ax.plot(*place(unsound), "kx", markersize=6)
        ax.plot(
            [a.hard for a in silent], [refused] * len(silent), linestyle="none", marker="|", color="0.2", markersize=8
        )
        ax.set_title(solver, fontsize="medium")
        ax.grid(True, alpha=0.3)
    axes[0, 0].set(xscale="log", yscale="log", xlim=(0.8, 3e18), ylim=(NONE / 3, 2e6))
    axes[0, 0].set_xticks([1, 1e6, 1e12, 1e18], ["1", "$10^6$", "$10^{12}$", r"$\geq 10^{18}$"])
    axes[0, 0].set_yticks(
        [NONE, 1e-12, 1e-7, 1e-2, top, refused], ["exact", "$10^{-12}$", "$10^{-7}$", "1 %", "$\\geq 10^3$", "refused"]
    )
    axes[0, 0].minorticks_off()
    for ax in axes[:, 0]:
        ax.set_ylabel("relative error of the cost")
    for ax in (axes[1, 0], axes[1, 1], axes[0, 2]):
        ax.set_xlabel("condition of the problem")
    axes[0, 2].tick_params(labelbottom=True)
    axes[1, 2].axis("off")
    handles = [
        Line2D([], [], linestyle="none", marker="o", color="0.4", markersize=5, label="an answer"),
        Line2D([], [], linestyle="none", marker="o", color="0.4", mfc="none", markersize=5, label="with a warning"),
        Line2D([], [], linestyle="none", marker="x", color="k", markersize=6, label="indefinite: a negative cost"),
        Line2D([], [], linestyle="none", marker="|", color="0.2", markersize=8, label="refused, by an error"),
        Line2D([], [], linestyle="--", color="0.45", label="condition times rounding"),
        Patch(color="#D55E00", alpha=0.12, label="wrong by more than 1 %"),
    ]
    axes[1, 2].legend(handles=handles, loc="center", frameon=False, fontsize="medium")
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    solvers: dict[str, Callable[[Array, Array], Array | None]] = {
        "switchctl": tail,
        "scipy, direct": lambda A, Q: np.asarray(solve_discrete_lyapunov(A.T, Q, method="direct")),
        "scipy, bilinear": lambda A, Q: np.asarray(solve_discrete_lyapunov(A.T, Q, method="bilinear")),
    }
    theirs = slycot()
    if theirs is not None:
        solvers["control, slycot"] = theirs
    solvers["plain sum"] = plain_sum
    every: dict[str, list[Answer]] = {solver: [] for solver in solvers}
    heading = ["median error", "worst", "refused", "indefinite", "wrong, warned", "silently wrong"]
    for family, cases in FAMILIES.items():
        here: dict[str, list[Answer]] = {solver: [] for solver in solvers}
        for case in cases():
            states = np.ix_(case.seen, case.seen)
            A, Q = case.A[states], case.Q[states]
            exact, bits = exact_tail([(A, Q)])
            for solver, solve in solvers.items():
                here[solver].append(asked(solve, A, Q, exact, bits))
        count = len(here["switchctl"])
        print(
            text_table([f"{family}, {count} modes", *heading], [row(*told) for told in here.items()]) + "\n", flush=True
        )
        for solver, told in here.items():
            every[solver] += told
    print(text_table([f"all, {len(every['switchctl'])} modes", *heading], [row(*told) for told in every.items()]))
    if len(sys.argv) > 1:
        draw(every, sys.argv[1])
