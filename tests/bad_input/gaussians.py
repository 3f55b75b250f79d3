"""Rows of `Gaussian` and `wasserstein`."""

import numpy as np
from control import ControlDimension
from scipy import sparse

from bad_input.table import refused, same
from switchctl import Gaussian


def good():
    return {"mean": np.array([1.0, 2.0]), "cov": np.array([[2.0, 0.5], [0.5, 1.0]])}


ROWS = [
    *refused(
        "Gaussian",
        Gaussian,
        good,
        ("NaN in mean", {"mean": [1.0, np.nan]}, ValueError, "mean[1] is nan"),
        ("infinity in cov", {"cov": [[1.0, 0.0], [0.0, np.inf]]}, ValueError, "cov[1, 1] is inf"),
        ("sparse cov", {"cov": sparse.eye(2)}, TypeError, "cov", ".toarray()"),
        ("complex mean", {"mean": [1j, 0]}, TypeError, "mean", "complex128"),
        ("wrong shape of cov", {"cov": np.eye(3)}, ControlDimension, "mean has shape (2,)", "cov has shape (3, 3)"),
        ("indefinite cov", {"cov": [[1.0, 2.0], [2.0, 1.0]]}, ValueError, "least eigenvalue is -1"),
        ("unknown keyword", {"covariance": 1}, TypeError, "covariance"),
    ),
    *same(
        "Gaussian",
        lambda **given: (Gaussian(**given).mean, Gaussian(**given).cov),
        good,
        ("float32", {"cov": lambda: good()["cov"].astype(np.float32)}),
        ("strided cov", {"cov": lambda: np.repeat(np.repeat(good()["cov"], 2, 0), 2, 1)[::2, ::2]}),
    ),
]
