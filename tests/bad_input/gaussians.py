"""Rows of `Gaussian` and `wasserstein`."""

import numpy as np
from control import ControlDimension

from bad_input.arrays import faults, forms, symmetric_faults
from bad_input.table import refused, same
from switchctl import Gaussian, wasserstein

HUGE = 10**400


def good():
    return {"mean": np.array([1.0, 2.0]), "cov": np.array([[3.0, 1.0], [1.0, 2.0]])}


def one():
    return Gaussian(**good())


def batch(size):
    return Gaussian(np.ones((size, 2)), np.tile(np.eye(2), (size, 1, 1)))


def numbers(**given):
    made = Gaussian(**given)
    return made.mean, made.cov, made.second_moment


def kept(change):
    """Whether a Gaussian stays as it is while the arrays that it was made of are changed."""
    given = good()
    made = Gaussian(**given)
    given[change][...] = 7.0
    return made.mean, made.cov


def samples():
    return {"samples": np.array([[0.0, 1.0], [2.0, 3.0], [1.0, -2.0]])}


def of_samples(**given):
    made = Gaussian.from_samples(**given)
    return made.mean, made.cov


ROWS = [
    *refused(
        "Gaussian",
        Gaussian,
        good,
        *faults("mean", good()["mean"]),
        *symmetric_faults("cov", good()["cov"]),
        ("no mean", {"mean": None}, TypeError, "mean must hold real numbers, not a NoneType"),
        ("no cov", {"cov": None}, TypeError, "cov must hold real numbers, not a NoneType"),
        ("a Gaussian as mean", {"mean": one}, TypeError, "mean must hold real numbers, not a function"),
        ("the class as cov", {"cov": Gaussian}, TypeError, "cov must hold real numbers, not a type"),
        ("a generator as mean", {"mean": lambda: (x for x in (1, 2))}, TypeError, "mean", "not a generator"),
        ("a number as mean", {"mean": 1.0}, ControlDimension, "mean has shape ()", "expected (n,) and (n, n)"),
        ("integers beyond float64", {"mean": [HUGE, 1]}, TypeError, "mean must hold real numbers"),
        ("a longdouble beyond float64", {"mean": np.longdouble([1e300, 1]) ** 2}, ValueError, "mean[0] is inf"),
        ("no states", {"mean": [], "cov": np.zeros((0, 0))}, ControlDimension, "mean has shape (0,)"),
        ("variances as cov", {"cov": [1.0, 1.0]}, ControlDimension, "mean has shape (2,) and cov has shape (2,)"),
        (
            "indefinite beside much greater",
            {"mean": np.zeros(3), "cov": [[1e40, 0, 0], [0, 1, 2], [0, 2, 1]]},
            ValueError,
            "least eigenvalue is -1;",
        ),
        (
            "asymmetric beside much greater",
            {"mean": np.zeros(3), "cov": [[1e40, 0, 0], [0, 1, 0.5], [0, 0.4, 1]]},
            ValueError,
            "entries [1, 2] and [2, 1] differ by 0.1",
        ),
        ("negative beside much greater", {"cov": np.diag([1e40, -1e-3])}, ValueError, "least eigenvalue is -0.001"),
        (
            "indefinite and near the end of the range",
            {"cov": 0.8e308 * np.array([[1, 2], [2, 1]])},
            ValueError,
            "least eigenvalue is -8e+307",
        ),
        ("indefinite and subnormal", {"cov": 1e-310 * np.array([[1, 2], [2, 1]])}, ValueError, "not positive"),
        ("one of a batch", {"mean": np.zeros((2, 2)), "cov": [np.eye(2), -np.eye(2)]}, ValueError, "cov[1] is not"),
        ("unknown keyword", {"covariance": 1}, TypeError, "covariance"),
    ),
    *refused("Gaussian", lambda mean: Gaussian(mean), lambda: {"mean": [1.0]}, ("no cov at all", {}, TypeError, "cov")),
    *same("Gaussian", numbers, good, *forms("mean", good()["mean"]), *forms("cov", good()["cov"])),
    *same(
        "Gaussian",
        numbers,
        good,
        ("ulps of asymmetry", {"cov": [[3.0, 1.0 + 2e-16], [1.0 - 1e-16, 2.0]]}),
        ("a tuple", {"mean": (1, 2)}),
        ("a range", {"mean": range(1, 3)}),
    ),
    *same(
        "Gaussian",
        kept,
        lambda: {"change": "cov"},
        ("arrays changed afterwards", {"change": "mean"}),
    ),
    *refused(
        "Gaussian.from_samples",
        Gaussian.from_samples,
        samples,
        *faults("samples", samples()["samples"], any_shape=True),
        ("one sample", {"samples": [[1.0, 2.0]]}, ValueError, "samples has 1 row(s)", "at least two"),
        ("no samples", {"samples": np.zeros((0, 2))}, ValueError, "samples has 0 row(s)"),
        ("a row", {"samples": [1.0, 2.0]}, ControlDimension, "samples has shape (2,)"),
        ("no states", {"samples": np.zeros((3, 0))}, ControlDimension, "samples has shape (3, 0)"),
        (
            "samples whose covariance overflows",
            {"samples": [[1e300], [-1e300]]},
            FloatingPointError,
            "samples",
            "scale",
        ),
        ("unknown keyword", {"weights": 1}, TypeError, "weights"),
    ),
    *same("Gaussian.from_samples", of_samples, samples, *forms("samples", samples()["samples"])),
    *refused(
        "Gaussian.w2",
        lambda **given: one().w2(**given),
        lambda: {"target": np.zeros(2)},
        *faults("target", np.zeros(2)),
        ("no target", {"target": None}, TypeError, "target must hold real numbers, not a NoneType"),
        ("a Gaussian", {"target": lambda: one()}, TypeError, "target must hold real numbers, not a Gaussian"),
        ("NaN", {"target": np.nan}, ValueError, "target is nan"),
        ("a target too far away", {"target": [1e200, 0]}, FloatingPointError, "W2 exceeds the floating-point range"),
    ),
    *refused(
        "Gaussian.w2",
        lambda target: batch(3).w2(target),
        lambda: {"target": np.zeros(2)},
        ("another batch", {"target": np.zeros((2, 2))}, ControlDimension, "target", "(2,)", "(3,)", "don't broadcast"),
    ),
    *same(
        "Gaussian.w2",
        lambda **given: one().w2(**given),
        lambda: {"target": 2},
        *forms("target", [2, 2]),
        ("a numpy scalar", {"target": np.float32(2)}),
        ("an array without axes", {"target": np.array(2)}),
    ),
    *refused(
        "Gaussian.about",
        lambda **given: one().about(**given),
        lambda: {"point": np.zeros(2)},
        *faults("point", np.zeros(2)),
        ("a number", {"point": 1.0}, ControlDimension, "point has shape (); expected (2,)"),
    ),
    *refused(
        "Gaussian.about",
        lambda point: Gaussian([1e308], [[1.0]]).about(point),
        lambda: {"point": [0.0]},
        ("a point too far away", {"point": [-1e308]}, FloatingPointError, "mean - point exceeds"),
    ),
    *same(
        "Gaussian.about",
        lambda **given: one().about(**given).mean,
        lambda: {"point": [1.0, -2.0]},
        *forms("point", [1, -2]),
    ),
    *refused(
        "wasserstein",
        wasserstein,
        lambda: {"a": one(), "b": one()},
        ("no a", {"a": None}, TypeError, "a: ", "got a NoneType"),
        ("a mean as b", {"b": [1.0, 2.0]}, TypeError, "b: ", "got a list"),
        ("the class", {"b": Gaussian}, TypeError, "b: ", "got a type"),
        ("other dimensions", {"b": Gaussian([1.0], [[1.0]])}, ControlDimension, "a has dimension 2 and b has 1"),
        ("other batches", {"a": batch(2), "b": batch(3)}, ControlDimension, "(2,)", "(3,)", "don't broadcast"),
        (
            "a distance beyond the range",
            {"a": Gaussian([1.5e308, 0], np.eye(2)), "b": Gaussian([-1.5e308, 0], np.eye(2))},
            FloatingPointError,
            "the distance exceeds",
        ),
        ("unknown keyword", {"p": 1}, TypeError, "p"),
    ),
]
