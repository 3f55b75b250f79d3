"""Many runs from drawn initial states, and what they say of the predicted W2."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import control
import numpy as np
from tqdm import tqdm

from switchctl.closed_loop import digital
from switchctl.comparison import Comparison
from switchctl.methods.prediction import INTERRUPTED
from switchctl.moments import Array, moment_factor
from switchctl.result import Schedule
from switchctl.sampling import recipe
from switchctl.simulation.estimates import MonteCarlo, Tally, norm
from switchctl.simulation.plants import fitting
from switchctl.simulation.replay import lasting
from switchctl.simulation.run import simulate
from switchctl.simulation.surroundings import operating_point as _operating_point
from switchctl.storage import affordable
from switchctl.validation import flag, number, whole_number

if TYPE_CHECKING:
    from concurrent.futures import Executor

_BLOCK = 2048  # samples moved at once: they stay in the cache
_RUNS = 8  # simulated in one task


def monte_carlo(
    schedules: Schedule | Mapping[str, Schedule] | Comparison,
    samples: int = 10_000,
    *,
    steps: int | None = None,
    seed: int = 0,
    confidence: float = 0.99,
    plant: Any = None,
    saturation: Any = None,
    delay: bool = False,
    noise: Any = None,
    operating_point: Any = None,
    domain: Callable[[Array], float] | None = None,
    executor: "Executor | None" = None,
) -> MonteCarlo:
    """Draw initial states, run schedules from each, and set the mean of ``||x||^2`` beside the predicted W2.

    Without a plant the runs are those of the modes, all samples at once by matrix products: a check of the prediction.
    With a plant each is a `simulate`: what the prediction is worth where the loop is not linear, is saturated or late.

    Parameters
    ----------
    schedules : Schedule, dict of Schedule, or Comparison
        What to run; several must be of the same modes and initial state. All start from the same samples.
    samples : int, optional
        Number of samples, at least 2.
    steps : int, optional
        Number of steps; those of the longest schedule by default. After its own steps a schedule goes on with its tail.
    seed : int, optional
        Of the samples. The samples, and the result, don't depend on the executor.
    confidence : float, optional
        Of the band about the mean at each step, between 0 and 1.
    plant : control.NonlinearIOSystem or control.StateSpace, optional
        What to simulate in the place of the modes.
    saturation, delay, noise, operating_point, domain : optional
        As for `simulate`; only with a plant. The schedules' initial state is that about the operating point.
    executor : concurrent.futures.Executor, optional
        Where to simulate; its ``map`` is used. In this process by default. For one of processes, plant and domain have
        to be picklable: functions of a module, no lambdas.

    Returns
    -------
    MonteCarlo
        Interrupted by Ctrl-C, with the samples done so far, and marked so. A run of a plant that stops early is counted
        in ``left``; the mean after that is of the others, which ``counted`` tells and ``inside`` leaves out.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of range; as `simulate` does.
    MemoryError
        If so many steps would need too much memory.

    Examples
    --------
    >>> modes = ModeSet([[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]], names=["fast", "calm"])
    >>> comparison = compare(modes, Gaussian([1.0, 1.0], 0.01 * np.eye(2)), {"T = 20": RecedingHorizon(20)})
    >>> monte_carlo(comparison, samples=1000, steps=50)
    MonteCarlo: 1000 samples, 50 steps
    ├── runs of  the modes
    ├── T = 20   W2 inside the 99 % band at 100.0 % of steps
    └── ends     completed
    """
    labelled = _labelled(schedules)
    first = next(iter(labelled.values()))
    samples, seed = whole_number(samples, "samples", 2), whole_number(seed, "seed", 0)
    steps = max(map(len, labelled.values())) if steps is None else whole_number(steps, "steps")
    confidence = number(confidence, "confidence")
    if not (0 < confidence and (1 + confidence) / 2 < 1):
        raise ValueError(f"confidence is {confidence!r}; expected a number between 0 and 1, such as 0.99")
    affordable(8 * 6 * steps * len(labelled), f"{len(labelled)} schedules of {steps} steps", "ask for fewer")
    long = [lasting(schedule, steps) for schedule in labelled.values()]
    settings = {
        "saturation": saturation,
        "delay": delay,
        "noise": noise,
        "operating_point": operating_point,
        "domain": domain,
    }
    draw = _Draws(first, samples, seed)
    if plant is None:
        for name, value in [*settings.items(), ("executor", executor)]:
            if not (value is None or (name == "delay" and not flag(value, name))):
                raise ValueError(f"{name} is for runs of a plant; give that too")
        blocks = _linear(long, steps, draw)
    else:
        modes = digital(first.modes)
        fitting(plant, modes)
        reference = _operating_point(operating_point, modes.plant_states, plant.ninputs, steps)
        draw.shift[: modes.plant_states] = reference.at(0)[0]
        made = recipe(plant) if isinstance(plant, control.StateSpace) else partial(_as_it_is, plant)
        task = partial(_simulated, made, long, steps, seed, settings)
        blocks = _spread(task, draw, executor)
    return _gathered(blocks, labelled, long, samples, steps, confidence, "" if plant is None else plant.name)


class _Draws:
    """The initial states, in blocks; the same whatever the size of a block."""

    def __init__(self, schedule: Schedule, samples: int, seed: int) -> None:
        self.factor = moment_factor(schedule.x0.mean, schedule.x0.cov)
        self.samples, self.seed, self.shift = samples, seed, np.zeros(len(self.factor))

    def blocks(self, size: int) -> Iterator[tuple[int, Array]]:
        """The number of each block's first sample, and its samples, shape (n, up to ``size``)."""
        random = np.random.default_rng(self.seed)
        for begin in range(0, self.samples, size):
            normal = random.standard_normal((min(size, self.samples - begin), len(self.factor)))
            yield begin, self.shift[:, None] + self.factor[:, :1] + self.factor[:, 1:] @ normal.T


class _Block(NamedTuple):
    """Some samples under every schedule, in the order of the samples."""

    samples: int
    tallies: list[Tally]
    stops: list[list[tuple[int, str]]]
    interrupted: bool = False


def _linear(schedules: list[Schedule], steps: int, draw: _Draws) -> Iterator[_Block]:
    """Runs of the modes, block by block."""
    modes = schedules[0].modes
    A, plant, noise = modes.A_after, modes.plant_states, modes.noise_roots
    for begin, start in draw.blocks(_BLOCK):
        tallies = []
        for place, schedule in enumerate(schedules):
            random = np.random.default_rng(np.random.SeedSequence(draw.seed, spawn_key=(begin, place)))
            before, X = int(schedule.graph.last_mode[0]), start
            mean, spread = np.empty(steps), np.empty(steps)
            for k, mode in enumerate(schedule.sequence[:steps].tolist()):
                with np.errstate(over="ignore", invalid="ignore"):
                    w2 = np.einsum("ij,ij->j", X[:plant], X[:plant])
                    mean[k] = (w2 / len(w2)).sum()
                    spread[k] = norm(w2 - mean[k])
                    X = A[before, mode] @ X
                    if noise is not None:
                        X += noise[mode] @ random.standard_normal(X.shape)
                before = mode
            tallies.append(Tally(steps))
            tallies[-1].add(start.shape[1], mean, spread)
        yield _Block(start.shape[1], tallies, [[] for _ in schedules])


def _spread(task: Callable[..., _Block], draw: _Draws, executor: Any) -> Iterator[_Block]:
    """Runs of a plant, task by task, here or wherever the executor has them run."""
    if executor is None:
        return (task(begin, start) for begin, start in draw.blocks(_RUNS))
    if isinstance(executor, type) or not hasattr(executor, "map"):
        raise TypeError(f"executor must be a concurrent.futures.Executor, not a {type(executor).__name__}")
    begins, starts = zip(*draw.blocks(_RUNS), strict=True)
    return iter(executor.map(task, begins, starts))


def _as_it_is(plant: Any) -> Any:
    return plant


def _simulated(
    made: Callable[[], Any],
    schedules: list[Schedule],
    steps: int,
    seed: int,
    settings: dict[str, Any],
    begin: int,
    start: Array,
) -> _Block:
    """Some runs of a plant, numbered from ``begin``: a task."""
    w2: list[list[Array]] = []
    stops: list[list[tuple[int, str]]] = [[] for _ in schedules]
    modes: Any = schedules[0].modes
    plant = made()
    try:
        for j, x0 in enumerate(start.T, begin):
            runs = []
            for schedule in schedules:
                noise = np.random.SeedSequence(seed, spawn_key=(j,))
                run = simulate(plant, modes, schedule, x0, steps, seed=noise, **settings)
                if run.status == INTERRUPTED:
                    raise KeyboardInterrupt
                runs.append(run)
            for run, stopped in zip(runs, stops, strict=True):
                if run.status != "completed":
                    stopped.append((j, run.status))
            w2.append([np.append(run.w2, np.full(steps, np.nan))[:steps] for run in runs])
    except KeyboardInterrupt:
        return _Block(len(w2), _tallied(w2, len(schedules), steps), stops, True)
    return _Block(len(w2), _tallied(w2, len(schedules), steps), stops)


def _tallied(w2: list[list[Array]], schedules: int, steps: int) -> list[Tally]:
    tallies = [Tally(steps) for _ in range(schedules)]
    if w2:
        for i, tally in enumerate(tallies):
            tally.add_runs(np.array([runs[i] for runs in w2]))
    return tallies


def _gathered(
    blocks: Iterator[_Block],
    labelled: Mapping[str, Schedule],
    schedules: list[Schedule],
    samples: int,
    steps: int,
    confidence: float,
    plant: str,
) -> MonteCarlo:
    """Add the blocks up, as far as they come."""
    tallies = [Tally(steps) for _ in labelled]
    stops: list[list[tuple[int, str]]] = [[] for _ in labelled]
    done = 0
    predicted = np.array([schedule.w2[:steps] for schedule in schedules])
    try:
        with tqdm(total=samples, desc="samples", unit="sample", delay=2, leave=False) as progress:
            for block in blocks:
                added = [total + tally for total, tally in zip(tallies, block.tallies, strict=True)]
                all_stops = [known + found for known, found in zip(stops, block.stops, strict=True)]
                tallies, stops, done = added, all_stops, done + block.samples  # all at once: Ctrl-C may come between
                progress.update(block.samples)
                if block.interrupted:
                    break
    except KeyboardInterrupt:
        pass
    finally:
        if hasattr(blocks, "close"):
            blocks.close()  # what an executor hasn't begun, it need not do
    if done == 0:
        raise KeyboardInterrupt
    mean, error = np.array([tally.estimates() for tally in tallies]).swapaxes(0, 1)
    counted = np.array([tally.count for tally in tallies])
    ends = tuple(map(tuple, stops))
    first = schedules[0].modes
    return MonteCarlo(first, tuple(labelled), predicted, mean, error, counted, ends, done, samples, confidence, plant)


def _labelled(schedules: Any) -> dict[str, Schedule]:
    """Schedules of the same modes and initial state, by label."""
    if isinstance(schedules, Comparison):
        schedules = schedules.schedules
    elif isinstance(schedules, Schedule):
        schedules = {schedules.method or "schedule": schedules}
    if not isinstance(schedules, Mapping) or not schedules:
        what = "an empty dict" if isinstance(schedules, Mapping) else f"a {type(schedules).__name__}"
        raise TypeError(f"schedules must be a Schedule, a dict of them or a Comparison, and not empty; got {what}")
    first = None
    for label, schedule in schedules.items():
        if not isinstance(label, str) or not isinstance(schedule, Schedule):
            raise TypeError(f"schedules[{label!r}] is a {type(schedule).__name__}; expected Schedules by their labels")
        first = first or schedule
        if schedule.target is not None:
            raise ValueError(f"schedules[{label!r}] has a target, and what is drawn is the distance to the origin")
        if schedule.modes is not first.modes:
            raise ValueError(f"schedules[{label!r}] is of other modes than the first; run them one by one")
        same = (schedule.x0.mean == first.x0.mean).all() and (schedule.x0.cov == first.x0.cov).all()
        if not same:
            raise ValueError(f"schedules[{label!r}] has another initial state than the first; run them one by one")
    return dict(schedules)
