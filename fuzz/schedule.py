"""Schedule files: what is loaded is refused by a `FormatError`, or valid, and saved and loaded again as it is.

python fuzz/schedule.py -max_total_time=600
"""

import json
import math
import tempfile
from pathlib import Path

import atheris
from mutations import resealed, run

with atheris.instrument_imports(include=["switchctl"]):
    from switchctl import (
        Budget,
        Constant,
        FewSwitches,
        FormatError,
        Gaussian,
        ModeSet,
        Optimal,
        RecedingHorizon,
        Rollout,
        Rules,
        Schedule,
        SwitchingGraph,
        schedule,
    )
    from switchctl.files import digest

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
A = [[[0.8, 3.0], [0.0, 0.5]], [[0.97, 0.0], [0.0, 0.8]]]
NAMES = ["fast", "calm"]


def seeds() -> list[str]:
    """Schedules of every kind, as `save` writes them."""
    modes = ModeSet(A, NAMES, 0.1, gains=[[[1.0, 2.0]], [[0.5, 0.0]]], states=["angle", "rate"])
    x0 = Gaussian([1.0, 1.0], [[0.01, 0.0], [0.0, 0.01]])
    noisy = ModeSet(A, NAMES, W=[[0.1, 0.0], [0.0, 0.1]], offset=[0.1, 0.2], cost=("discounted", 0.9))
    average = ModeSet(A, NAMES, 0.1, Q=[[1.0, 0.0], [0.0, 0.0]], W=[[0.1, 0.0], [0.0, 0.1]], cost="average")
    maps = [[[[1.0, 0.0], [0.0, 1.0]]] * 2, [[[1.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]]]]
    active = ModeSet(A, NAMES, plant_states=1, activation=maps, initial=[[1.0], [0.5]])
    automaton = SwitchingGraph.from_edges(modes, [("a", "b", 0), ("b", "b", 1), ("b", "a", 0)])
    rules = [
        Rules(min_dwell={"fast": 3}, max_dwell=[math.inf, 9], switch_cost=[[0, 0.1], [0.2, 0]], start=("calm", 2)),
        Rules(transitions={"fast": ["calm"], "calm": [0]}, switch_cost_per_w2=0.1, price={1: 0.5}, max_switches=4),
        Rules(budget=Budget(use={"calm": 0.1}, limit=0.3, window=4), allowed={"fast": [(0, 9), (12, math.inf)]}),
        Rules(min_dwell=0.3, time_unit="s", allowed={"calm": [(0, 0.4)]}, allowed_period=0.8),
    ]
    made = [
        schedule(modes, x0, RecedingHorizon(4, decrease=0.3), steps=9),
        schedule(modes, x0, FewSwitches(2), steps=9, rules=rules[0]),
        *(schedule(modes, x0, Rollout(), steps=9, rules=rule) for rule in rules),
        schedule(modes, x0, Rollout(), steps=9, rules=automaton),
        schedule(modes, x0, Optimal(gap=0.05, time_limit=10)),
        schedule(modes, x0, RecedingHorizon(4), steps=6, terminal=[[2.0, 0.0], [0.0, 1.0]]),
        schedule(modes, x0, RecedingHorizon(4), steps=6, target=Gaussian([0.1, 0.1], [[0.1, 0.0], [0.0, 0.1]])),
        schedule(noisy, x0, Rollout(), steps=6),
        schedule(average, x0, Rollout(), steps=6),
        schedule(active, Gaussian([1.0], [[0.5]]), Rollout(), steps=6),
        schedule(ModeSet([[[1.1]]]), Gaussian([1.0], [[0.0]]), Constant(0), steps=3),
    ]
    return [path.read_text() for path in (one.save(FOLDER / "seed.json") for one in made)]


def sealed(text: str) -> str:
    """With the digest of the content as it is now."""
    document = json.loads(text)
    return resealed(text, sha256=digest({key: value for key, value in document.items() if key != "sha256"}))


def try_input(data: bytes) -> None:
    """Load it, and what was loaded."""
    given = FOLDER / "given.json"
    given.write_bytes(data)
    try:
        loaded = Schedule.load(given)
    except FormatError:
        return
    again = Schedule.load(loaded.save(FOLDER / "saved.json"))
    first = (FOLDER / "saved.json").read_text()
    assert again.save(FOLDER / "again.json").read_text() == first, "another file is saved"
    assert repr(again) == repr(loaded)
    stated = json.loads(data)["cost"]
    assert stated is None or math.isclose(loaded.cost, stated, rel_tol=1e-5), f"{loaded.cost}, not {stated}"


if __name__ == "__main__":
    run(seeds(), sealed, try_input)
