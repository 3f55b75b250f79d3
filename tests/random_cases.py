"""Random mode sets and initial states."""

import numpy as np

from switchctl import Gaussian


def random_modes(rng, n, m, radius=(0.3, 0.98)):
    """Gaussian matrices scaled to spectral radii in a range."""
    A = rng.standard_normal((m, n, n))
    radii = np.abs(np.linalg.eigvals(A)).max(axis=-1)
    return A * (rng.uniform(*radius, m) / radii)[:, None, None]


def random_gaussian(rng, n):
    root = rng.standard_normal((n, n))
    return Gaussian(rng.standard_normal(n), root @ root.T / n)
