"""The command line: run a model, compare methods, report on its modes, list the models."""

import argparse
import io
import json
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from switchctl import __version__
from switchctl.certificates import certify
from switchctl.comparison import Comparison, compare
from switchctl.files import write_bytes, write_text
from switchctl.gaussian import Gaussian
from switchctl.load_model import Model, bundled, load_model
from switchctl.methods import FewSwitches, Method, Optimal, PointwiseMinimum, RecedingHorizon, Refine, Rollout
from switchctl.methods.prediction import INTERRUPTED
from switchctl.modes import ModeSet
from switchctl.result import Schedule
from switchctl.rules import Rules
from switchctl.stability import report

METHODS = {
    "receding-horizon": RecedingHorizon,
    "pointwise": PointwiseMinimum,
    "rollout": Rollout,
    "few-switches": FewSwitches,
    "refine": Refine,
    "optimal": Optimal,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the command's name; those of the process by default.

    Returns
    -------
    int
        0 for success, 2 for a mistake in what was asked, 130 when interrupted.
    """
    parser = _parser()
    asked = parser.parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # not every terminal knows the branches of a tree
    try:
        if not asked.command(asked):
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        print("switchctl: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output has gone; say nothing more
        return 0
    except (ValueError, TypeError, LookupError, ArithmeticError, OSError, ImportError, MemoryError) as error:
        told = error.args[0] if isinstance(error, KeyError) and error.args else error
        print(f"switchctl: error: {' '.join(str(told).split())}", file=sys.stderr)
        return 2
    except Exception as error:  # of a method in a user's file, as a rule: say where
        frame = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{frame.filename}, line {frame.lineno}: {type(error).__name__}: {error}"
        print(f"switchctl: error: {' '.join(told.split())}", file=sys.stderr)
        return 2
    return 0


def _joined(words: Sequence[str]) -> list[str]:
    """Join options with values that may begin with a minus, which argparse would take for options themselves."""
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] in ("--mean", "--cov"):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


class _Parser(argparse.ArgumentParser):
    """A parser that tells a mistake in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())} (usage: {self.prog} --help)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="switchctl", description="Decide which controller should act at each sample.", allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"switchctl {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="schedule a model's modes by one method", allow_abbrev=False)
    _model_arguments(run)
    run.add_argument("--method", choices=METHODS, help="default: the model's own")
    run.add_argument("--horizon", type=_horizon, metavar="T", help="steps, or 'inf' (receding-horizon)")
    run.add_argument("--hold", type=int, metavar="N", help="steps between decisions (receding-horizon)")
    run.add_argument("--decrease", type=float, metavar="X", help="stability constraint, 0 to 1 (receding-horizon)")
    run.add_argument("--gap", type=float, metavar="X", help="gap to prove, default 1e-3 (optimal)")
    run.add_argument("--time-limit", type=float, metavar="S", help="seconds, default 60 (optimal)")
    run.add_argument(
        "--save",
        metavar="DIR",
        help="write schedule.csv, schedule.json, w2.png and area.png there, and with optimal certificate.json",
    )
    run.set_defaults(command=_run)

    comparison = commands.add_parser("compare", help="run several methods on a model, and its own", allow_abbrev=False)
    _model_arguments(comparison)
    comparison.set_defaults(command=_compare)

    page = commands.add_parser("report", help="tell everything known about a model's modes", allow_abbrev=False)
    _system_arguments(page)
    page.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="seconds, default 60")
    page.add_argument("--save", metavar="DIR", help="write report.txt, report.png and certificates there")
    page.set_defaults(command=_report)

    models = commands.add_parser("models", help="list the bundled models", allow_abbrev=False)
    models.add_argument("--json", action="store_true", help="print JSON")
    models.set_defaults(command=_models)
    return parser


def _model_arguments(parser: argparse.ArgumentParser) -> None:
    _system_arguments(parser)
    parser.add_argument("--steps", type=int, metavar="N", help="default: until W2 is 1e-12 of its start")
    parser.add_argument("--json", action="store_true", help="print JSON")


def _system_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "model",
        metavar="MODEL",
        help="a bundled model (see 'switchctl models'), a Python file with modes() (or plant() and "
        "controllers()), initial_state() and perhaps method() and rules(), or a .json or .mat file with the matrices A",
    )
    parser.add_argument("--mean", type=_numbers, metavar="X,X,..", help="mean of the initial state")
    parser.add_argument(
        "--cov",
        type=_numbers,
        metavar="X,..",
        help="its covariance: one variance for all, one each, or all entries by rows",
    )
    parser.add_argument("--no-rules", action="store_true", help="leave out the model's own switching rules")
    parser.add_argument("--min-dwell", type=int, metavar="N", help="least steps in a mode once taken")
    parser.add_argument("--switch-cost", type=float, metavar="X", help="cost of a switch")
    parser.add_argument("--max-switches", type=int, metavar="N", help="greatest number of switches")


def _horizon(text: str) -> int | float:
    return float("inf") if text == "inf" else int(text)


_horizon.__name__ = "horizon"  # argparse names the type in its message


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.replace(",", " ").split()])


_numbers.__name__ = "list of numbers"


def _method(asked: argparse.Namespace, model: Model) -> Method:
    """The method asked for, with the settings asked for, on top of the model's own."""
    own = model.method
    kind = METHODS[asked.method] if asked.method else type(own)
    settings, search = (
        {name: getattr(asked, name) for name in names if getattr(asked, name) is not None}
        for names in (("horizon", "hold", "decrease"), ("gap", "time_limit"))
    )
    if search and kind is not Optimal:
        raise ValueError(f"--{next(iter(search)).replace('_', '-')} goes with --method optimal")
    if kind is Optimal and not settings:
        return replace(own, **search) if isinstance(own, Optimal) else Optimal(**search)
    if kind is FewSwitches and not settings:
        if asked.max_switches is not None:
            return FewSwitches(asked.max_switches)
        if isinstance(own, FewSwitches):
            return own
        raise ValueError("few-switches needs --max-switches N")
    if kind is Refine and not settings:
        return Refine(own) if not isinstance(own, Refine) else own
    if kind is not RecedingHorizon:
        if settings and asked.method is None:
            kind = RecedingHorizon
        elif settings:
            raise ValueError(f"--{next(iter(settings))} goes with --method receding-horizon, not {asked.method}")
        else:
            return kind() if asked.method else own
    if isinstance(own, RecedingHorizon):
        settings = {"horizon": own.horizon, "hold": own.hold, "decrease": own.decrease} | settings
    if "horizon" not in settings:
        raise ValueError("a receding horizon needs --horizon T")
    return RecedingHorizon(**settings)


def _rules(asked: argparse.Namespace, model: Model) -> Rules:
    """The model's own rules, and those asked for on top."""
    own = Rules() if asked.no_rules or model.rules is None else model.rules
    told = {name: getattr(asked, name) for name in ("min_dwell", "switch_cost", "max_switches")}
    if asked.min_dwell is not None and own.time_unit == "s":
        told["min_dwell"] = asked.min_dwell * model.modes.dk
    return replace(own, **{name: value for name, value in told.items() if value is not None})


def _initial_state(asked: argparse.Namespace, model: Model) -> Gaussian:
    given = model.initial_state
    n = model.modes.plant_states
    mean = asked.mean if asked.mean is not None else None if given is None else given.mean
    if mean is None:
        raise ValueError(f"{asked.model} has no initial state; give --mean (and --cov)")
    if len(mean) != n:
        told = "--mean" if asked.mean is not None else f"the initial state in {asked.model}"
        raise ValueError(f"{told} has {len(mean)} numbers; expected {n}, one for each state")
    if asked.cov is None:
        return Gaussian(mean, np.zeros((n, n)) if given is None else given.cov)
    sizes: dict[int, Any] = {1: lambda v: np.diag(np.full(n, v[0])), n: np.diag, n * n: lambda v: v.reshape(n, n)}
    if asked.cov.size not in sizes:
        raise ValueError(f"--cov has {asked.cov.size} numbers; expected 1, {n} or {n * n}, for {n} states")
    return Gaussian(mean, sizes[asked.cov.size](asked.cov))


def _run(asked: argparse.Namespace) -> bool:
    """Schedule, print and save; False where Ctrl-C cut the schedule short."""
    model = load_model(asked.model)
    method, x0 = _method(asked, model), _initial_state(asked, model)
    folder = _made(asked.save)
    comparison = compare(model.modes, x0, {"schedule": method}, asked.steps, _rules(asked, model))
    (schedule,) = comparison.schedules.values()
    saved: list[Path] = []
    try:
        if folder:
            _save(folder, comparison, schedule, saved)
    finally:  # the schedule is told even where a file can't be written, or Ctrl-C comes meanwhile
        _tell(comparison, schedule, saved, asked.json)
    return comparison.status != INTERRUPTED


def _tell(comparison: Comparison, schedule: Schedule, saved: list[Path], as_json: bool) -> None:
    if as_json:
        print(json.dumps(_record(comparison) | {"files": [str(path) for path in saved]}, indent=1, allow_nan=False))
        return
    best = comparison.single_costs.min()
    print(comparison)
    print(f"\n{schedule!r}")
    if np.isfinite(best) and best > 0:
        gain = round(100 * (1 - schedule.cost / best), 2) + 0.0  # no -0.00
        print(f"\ngain over the best single mode: {gain:.2f} %")
    for path in saved:
        print(f"saved {path}")


def _made(folder: str | None) -> Path | None:
    """The folder to save into, made where it isn't there; before the work, so that none is lost."""
    if folder is None:
        return None
    path = Path(folder)
    try:
        if folder:
            path.mkdir(parents=True, exist_ok=True)
            return path
    except (FileExistsError, NotADirectoryError):
        pass
    raise ValueError(f"--save {folder!r} names no folder; name one that is there or can be made")


def _certified(found: Any, path: Path) -> list[Path]:
    """Write a certificate, or say on stderr why there is none; an older one does not stay."""
    path.unlink(missing_ok=True)
    if found is None:
        return []
    try:
        gap = (found.gap or 1e-9) if isinstance(found, Schedule) else None
        return [certify(found, gap).save(path)]
    except ValueError as error:
        print(f"switchctl: no certificate: {error}", file=sys.stderr)
        return []


def _compare(asked: argparse.Namespace) -> bool:
    model = load_model(asked.model)
    methods: list[Method] = [PointwiseMinimum(), RecedingHorizon(10), RecedingHorizon(50)]
    if any(P is not None for P in model.modes.tails):
        methods += [RecedingHorizon(np.inf), Rollout()]
    labelled = {repr(method): method for method in [*methods, model.method]}
    comparison = compare(model.modes, _initial_state(asked, model), labelled, asked.steps, _rules(asked, model))
    print(json.dumps(_record(comparison), indent=1, allow_nan=False) if asked.json else comparison)
    return comparison.status != INTERRUPTED


def _report(asked: argparse.Namespace) -> bool:
    """Print the report, and save it with a certificate of every guarantee that has one."""
    model = load_model(asked.model)
    x0 = None if asked.mean is None and model.initial_state is None else _initial_state(asked, model)
    folder = _made(asked.save)
    found = report(model.modes, x0, _rules(asked, model), time_limit=asked.time_limit)
    print(found)
    if folder:
        saved = [write_text(folder / "report.txt", f"{found}\n"), folder / "report.png"]
        _draw(found.plot, saved[-1])
        for name in ("joint_spectral_radius", "dwell_time", "dwell_times", "average_dwell_time", "switching_help"):
            saved += _certified(getattr(found, name), folder / f"{name}.json")
        for path in saved:
            print(f"saved {path}")
    return "not done" not in found.reasons.values()


def _models(asked: argparse.Namespace) -> bool:
    described = bundled()
    if asked.json:
        print(json.dumps(described, indent=1))
    else:
        width = max(map(len, described))
        print("\n".join(f"{name:<{width}}  {line}" for name, line in described.items()))
    return True


def _record(comparison: Comparison) -> dict[str, Any]:
    modes: ModeSet = comparison.modes
    return {
        "modes": [
            {"name": name, "spectral_radius": float(radius), "cost": _finite(cost)}
            for name, radius, cost in zip(modes.names, modes.spectral_radii, comparison.single_costs, strict=True)
        ],
        "dt": modes.dt,
        "schedules": [
            {
                "label": label,
                "method": schedule.method,
                "status": schedule.status,
                "steps": len(schedule),
                "cost": _finite(schedule.cost),
                "lower_bound": schedule.lower_bound,
                "switches": [switch._asdict() for switch in schedule.switches],
                "lead": schedule.lead,
                "tail": schedule.tail,
            }
            for label, schedule in comparison.schedules.items()
        ],
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _save(folder: Path, comparison: Comparison, schedule: Schedule, files: list[Path]) -> None:
    """Write everything, and note each file once it is there."""
    files.append(schedule.to_csv(folder / "schedule.csv"))
    files.append(schedule.save(folder / "schedule.json"))
    for name, draw in (("w2.png", comparison.plot), ("area.png", comparison.plot_area)):
        files.append(_draw(draw, folder / name))
    proven = schedule.status in ("optimal", "gap reached")
    files += _certified(schedule if proven else None, folder / "certificate.json")
    if schedule.lower_bound is not None and not proven:
        print(
            f"switchctl: no certificate: the search ended before its gap was proven ({schedule.status})",
            file=sys.stderr,
        )


def _draw(draw: Callable[[], Any], path: Path) -> Path:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, picture = draw().figure, io.BytesIO()
    figure.savefig(picture, format="png", dpi=150)
    plt.close(figure)
    return write_bytes(path, picture.getvalue())


if __name__ == "__main__":
    sys.exit(main())
