"""Samples of a schedule all at once and a nonlinear run, against loops over samples and python-control's responses."""

from collections.abc import Callable
from time import perf_counter

import control
import numpy as np
from timing import ratio, require_equal

from switchctl import Constant, Schedule, monte_carlo, schedule, simulate
from switchctl.models import quadrotor
from switchctl.moments import Array, moment_factor
from switchctl.tables import text_table

SAMPLES, STEPS = 10_000, 1000
SUBSET = 10  # samples that the slower two are timed on
TURNS = 5
TOLERANCES = {"rtol": 1e-8, "atol": 1e-10}


def seconds(*functions: Callable[[], object]) -> Array:
    """Seconds of each function at each turn, shape (functions, turns); they take turns, so a slow moment hits all."""
    times = np.empty((len(functions), TURNS))
    for turn in range(TURNS):
        for j in range(len(functions))[:: 1 - 2 * (turn % 2)]:
            start = perf_counter()
            functions[j]()
            times[j, turn] = perf_counter() - start
    return times


def looped(result: Schedule, starts: Array) -> Array:
    """Mean of ``||x||^2``, sample by sample and step by step."""
    A, w2 = result.modes.A, np.zeros((len(starts), len(result)))
    for j, x in enumerate(starts):
        for k, mode in enumerate(result.sequence.tolist()):
            w2[j, k] = x @ x
            x = A[mode] @ x
    return w2.mean(axis=0)


def responses(result: Schedule, starts: Array) -> Array:
    """The same by `control.initial_response`, one for each sample and run of a mode."""
    systems = [mode.to_ss() for mode in result.modes]
    w2 = np.zeros((len(starts), len(result)))
    ends = [*result.run_starts[1:].tolist(), len(result)]
    for j, x in enumerate(starts):
        for begin, end in zip(result.run_starts.tolist(), ends, strict=True):
            points = np.arange(end - begin + 1) * result.modes.dk
            states = control.initial_response(systems[result.sequence[begin]], points, x).states
            w2[j, begin:end] = np.sum(np.square(states[:, :-1]), axis=0)
            x = states[:, -1]
    return w2.mean(axis=0)


def linear() -> None:
    """Monte Carlo runs of the modes."""
    modes, x0 = quadrotor.modes(), quadrotor.initial_state()
    result = schedule(modes, x0, quadrotor.method(), STEPS)
    normal = np.random.default_rng(0).standard_normal((SUBSET, 6))
    starts = x0.mean + normal @ moment_factor(x0.mean, x0.cov)[:, 1:].T
    mean = monte_carlo(result, SUBSET).mean[0]
    require_equal(looped(result, starts), mean, "a loop over samples")
    require_equal(responses(result, starts), mean, "control.initial_response")
    ours, loop, response = seconds(
        lambda: monte_carlo(result, SAMPLES), lambda: looped(result, starts), lambda: responses(result, starts)
    )
    rows = []
    for name, times, samples in (
        ("monte_carlo", ours, SAMPLES),
        ("loop over samples and steps", loop, SUBSET),
        ("control.initial_response", response, SUBSET),
    ):
        each = times / samples
        rows.append([name, f"{samples:,}", f"{np.median(times):.3f}", f"{1e6 * np.median(each):,.1f}"])
        rows[-1].append(ratio(each, ours / SAMPLES))
    header = [f"n = 6, {STEPS} steps", "samples", "seconds", "us a sample", "to monte_carlo"]
    print(text_table(header, rows))
    print(f"\nThe slower two ran {SUBSET} samples, with the same mean to 1e-9; their ratio is that of a sample.\n")


def sample_by_sample(plant: control.NonlinearIOSystem, K: Array, x: Array, dt: float) -> Array:
    """A sampled-data run by `control.input_output_response`, one call for each period."""
    states = [x]
    for _ in range(STEPS):
        u = np.repeat((-K @ states[-1])[:, None], 2, axis=1)
        response = control.input_output_response(plant, [0.0, dt], u, states[-1], solve_ivp_kwargs=TOLERANCES)
        states.append(response.states[:, -1])
    return np.array(states).T


def nonlinear() -> None:
    """One run of the quadrotor under its static gain."""
    modes, x0, plant = quadrotor.modes(), 0.1 * quadrotor.initial_state().mean, quadrotor.nonlinear_plant()
    K, points = modes.gains[0], np.arange(STEPS + 1) * modes.dk
    loop = control.nlsys(
        lambda t, x, u, params: plant.dynamics(t, x, -K @ x), None, inputs=0, states=6, outputs=6, name="loop"
    )
    exact = Constant("high")
    run = simulate(plant, modes, exact, x0, STEPS, **TOLERANCES)
    error = np.abs(sample_by_sample(plant, K, x0, modes.dk) - run.x).max()
    if error > 1e-7:
        raise ArithmeticError(f"the sampled-data runs differ by {error:.2g}")

    def continuous() -> object:
        return control.input_output_response(loop, points, 0, x0, solve_ivp_kwargs=TOLERANCES)

    ours, pieces, whole = seconds(
        lambda: simulate(plant, modes, exact, x0, STEPS, **TOLERANCES),
        lambda: sample_by_sample(plant, K, x0, modes.dk),
        continuous,
    )
    rows = [
        [name, f"{np.median(times):.3f}", f"{1e6 * np.median(times) / STEPS:,.0f}", ratio(times, ours)]
        for name, times in (
            ("simulate", ours),
            ("control.input_output_response, a call a period", pieces),
            ("control.input_output_response, in continuous time", whole),
        )
    ]
    print(text_table(["quadrotor, 10 s at 0.01 s", "seconds", "us a period", "to simulate"], rows))
    print(f"\nThe first two agree to {error:.0e}. The last closes the loop in continuous time: another run, without")
    print("samples, which an integrator crosses in fewer and longer steps.")


if __name__ == "__main__":
    linear()
    nonlinear()
