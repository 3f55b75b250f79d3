"""A tour of the package by real calls: run as a program, it says whether they left anything outside it changed."""

import contextlib
import io
import locale
import logging
import os
import random
import signal
import sys
import tempfile
import warnings
from pathlib import Path

import clarabel  # noqa: F401  what others change when they are imported is theirs
import control
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas  # noqa: F401
import scipy.integrate
import scipy.linalg
import scipy.optimize
import scipy.sparse.csgraph
import scipy.special  # noqa: F401


def tour(folder):
    """Call what there is, once at least."""
    import switchctl
    from switchctl import certificates, cli, plotting, stability
    from switchctl.models import five_mode, quadrotor

    modes, x0 = five_mode.modes(), five_mode.initial_state()
    rungs: list[switchctl.Rung] = []
    methods = [
        switchctl.Constant(0),
        switchctl.PointwiseMinimum(),
        switchctl.RecedingHorizon(5, hold=2, decrease=0.1),
        switchctl.Rollout(),
        switchctl.FewSwitches(1),
        switchctl.Refine(),
        switchctl.Optimal(gap=0.05, callback=rungs.append),
    ]
    schedules = [switchctl.schedule(modes, x0, method) for method in methods]
    found = schedules[-1]
    schedules[0].save(folder / "schedule.json")
    found.to_csv(folder / "schedule.csv")
    found.to_pandas()
    found.area()
    graph = switchctl.SwitchingGraph(modes, switchctl.Rules(min_dwell=2, switch_cost=0.1))
    graph.to_networkx()
    comparison = switchctl.compare(modes, x0, methods[1:4])
    sweep = switchctl.sweep(modes, x0, [1, 5], [1, 2])
    trade_off = switchctl.trade_off(modes, x0, over="min_dwell", values=[1, 2])
    drawn = switchctl.monte_carlo(found, 100)
    loops = quadrotor.modes()
    switchctl.simulate(quadrotor.nonlinear_plant(), loops, methods[3], quadrotor.initial_state(), steps=20)
    switchctl.simulate(quadrotor.nonlinear_plant(), loops, methods[3], [9.0] * 6, steps=20, saturation=(-1, 1))
    switchctl.scheduler_system(methods[1], modes)
    switchctl.switched_controller(methods[3], loops)
    switchctl.wasserstein(x0, x0)
    policy = switchctl.Optimal(gap=0.3).policy(modes, quadratics=10)
    policy.start(modes).step([1.0, 1.0])
    pair = switchctl.ModeSet(modes.A[:2])
    report = stability.report(pair, x0, time_limit=0.5)
    certificate = certificates.certify(found, gap=0.1)
    certificates.Certificate.load(certificate.save(folder / "claim.json")).check()
    with np.errstate(all="ignore"), warnings.catch_warnings(record=True):
        switchctl.schedule(switchctl.ModeSet([[[1.5]]]), switchctl.Gaussian([1.0], [[0.0]]), methods[0], 5)
    pictures = {
        plotting.plot_area: comparison,
        plotting.plot_bounds: rungs,
        plotting.plot_ellipses: found,
        plotting.plot_graph: graph,
        plotting.plot_monte_carlo: drawn,
        plotting.plot_report: report,
        plotting.plot_schematic: found,
        plotting.plot_sweep: sweep,
        plotting.plot_switching: found,
        plotting.plot_trade_off: trade_off,
        plotting.plot_tree: certificate,
        plotting.plot_w2: comparison,
    }
    assert {plot.__name__ for plot in pictures} == set(plotting.__all__)
    for plot, data in pictures.items():
        plot(data)
    plt.close("all")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert cli.main(["run", "five_mode", "--save", str(folder / "out")]) == 0
        assert cli.main(["run", "none_such"]) == 2


def state():
    """What is not the package's to change."""
    drawn = np.random.get_state()  # noqa: NPY002
    return {
        "numpy.geterr": np.geterr(),
        "numpy.random": (drawn[0], drawn[1].tolist(), *drawn[2:]),
        "numpy.printoptions": np.get_printoptions(),
        "random": random.getstate(),
        "matplotlib.rcParams": dict(matplotlib.rcParams),
        "warnings.filters": list(warnings.filters),
        "warnings.showwarning": warnings.showwarning,
        "logging": (logging.root.level, list(logging.root.handlers), logging.root.manager.disable),
        "os.environ": dict(os.environ),
        "os.umask": umask(),
        "locale": locale.setlocale(locale.LC_ALL),
        "signal": {number: signal.getsignal(number) for number in signal.valid_signals()},
        "sys.getrecursionlimit": sys.getrecursionlimit(),
        "sys.path": list(sys.path),
        "sys hooks": (sys.excepthook, sys.displayhook, sys.gettrace()),
        "streams": (sys.stdout, sys.stderr, sys.stdin),
        "current directory": os.getcwd(),
        "control.config.defaults": dict(control.config.defaults),
        "open figures": plt.get_fignums(),
    }


def umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


if __name__ == "__main__":
    matplotlib.use("Agg")
    before = state()
    with tempfile.TemporaryDirectory() as folder:
        tour(Path(folder))
    after = state()
    changed = [name for name in before if before[name] != after[name]]
    sys.exit(f"changed: {', '.join(changed)}" if changed else 0)
