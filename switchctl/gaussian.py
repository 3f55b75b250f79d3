"""Gaussians: an uncertain state, and how far two of them are apart."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from control import ControlDimension
from numpy.typing import ArrayLike

from switchctl.moments import Array, second_moment
from switchctl.validation import frozen, positive_semidefinite, real_array


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Gaussian:
    """A Gaussian ``N(mean, cov)``: an uncertain state, or a batch of them.

    Parameters
    ----------
    mean : array_like, shape (..., n)
        Mean, in the units of the state.
    cov : array_like, shape (..., n, n)
        Covariance: symmetric, positive semidefinite, possibly singular; zero for a state known exactly.

    Raises
    ------
    ValueError
        If shapes don't fit, an entry is not finite, or the covariance is not symmetric or not positive
        semidefinite.
    TypeError
        If the entries are not real numbers.

    Examples
    --------
    >>> x0 = Gaussian([5, 5], [[2.25, 0], [0, 2.25]])
    >>> print(x0.w2())
    54.5
    """

    mean: Array
    cov: Array

    def __init__(self, mean: ArrayLike, cov: ArrayLike) -> None:
        mean, cov = real_array(mean, "mean"), real_array(cov, "cov")
        n = mean.shape[-1] if mean.ndim else 0
        if n == 0 or cov.shape != (*mean.shape, n):
            raise ControlDimension(
                f"mean has shape {mean.shape} and cov has shape {cov.shape}; expected (n,) and (n, n), "
                "or a batch of them, (.., n) and (.., n, n)"
            )
        object.__setattr__(self, "mean", frozen(mean))
        object.__setattr__(self, "cov", frozen(positive_semidefinite(cov, "cov")))

    @classmethod
    def from_samples(cls, samples: Any) -> Self:
        """Fit a Gaussian to samples: their mean and unbiased covariance (divided by N - 1, as `numpy.cov` does).

        Parameters
        ----------
        samples : array_like, shape (N, n)
            One sample a row, at least two.

        Returns
        -------
        Gaussian

        Raises
        ------
        ValueError
            If there are fewer than two samples.

        Examples
        --------
        >>> Gaussian.from_samples([[0, 1], [2, 3]]).mean
        array([1., 2.])
        """
        samples = real_array(samples, "samples", (None, None))
        if len(samples) < 2:
            raise ValueError(f"samples has {len(samples)} row(s); a covariance needs at least two, one sample a row")
        return cls(samples.mean(axis=0), np.atleast_2d(np.cov(samples, rowvar=False)))

    @property
    def second_moment(self) -> Array:
        """``S = mean mean' + cov``, shape (..., n, n)."""
        return second_moment(self.mean, self.cov)

    def w2(self, target: Any = 0.0) -> Any:
        """Squared Wasserstein distance to a point: ``||mean - target||^2 + tr cov`` (Proposition 2 of the paper).

        Parameters
        ----------
        target : array_like, shape (..., n) or scalar, optional
            The point; the origin by default.

        Returns
        -------
        float, or array for a batch

        Raises
        ------
        ValueError
            If target has another dimension.
        """
        target = real_array(target, "target")
        if target.ndim and target.shape[-1] != self.mean.shape[-1]:
            raise ControlDimension(f"target has shape {target.shape}; expected (..., {self.mean.shape[-1]})")
        shift = self.mean - target
        return np.sum(shift**2, axis=-1) + np.trace(self.cov, axis1=-2, axis2=-1)

    def about(self, point: Any) -> Self:
        """The same Gaussian in deviations from a point, such as an operating point that is to be reached.

        Parameters
        ----------
        point : array_like, shape (n,)
            The point.

        Returns
        -------
        Gaussian

        Examples
        --------
        >>> Gaussian([5.0, 1.0], np.eye(2)).about([4.0, 0.0]).mean
        array([1., 1.])
        """
        return type(self)(self.mean - real_array(point, "point", (self.mean.shape[-1],)), self.cov)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.mean, self.cov)  # so that copies are checked and read-only too

    def __repr__(self) -> str:
        return f"Gaussian(mean={self.mean.tolist()}, cov={self.cov.tolist()})"


def wasserstein(a: Gaussian, b: Gaussian) -> Any:
    """2-Wasserstein distance between Gaussians, one or a batch (a distance: not squared).

    The square is ``||mean_a - mean_b||^2 + min_U ||A - B U||^2`` over orthogonal U, with A and B the square roots
    of the covariances (the Bures distance; Bhatia, Jain and Lim, Expo. Math. 37, 2019). The minimiser is the polar
    factor of ``B A``, and the norm of the difference keeps the digits that the usual
    ``tr(cov_a) + tr(cov_b) - 2 tr(A cov_b A)^(1/2)`` loses for close covariances. Where a covariance is singular, its
    square root, and so the distance, is known to about 1e-8 standard deviations.

    Parameters
    ----------
    a, b : Gaussian
        With batch shapes that broadcast.

    Returns
    -------
    float, or array for a batch

    Raises
    ------
    TypeError
        If an argument is not a `Gaussian`.
    ValueError
        If the dimensions differ.

    Examples
    --------
    >>> a = Gaussian([3, 0], [[1, 0], [0, 0]])
    >>> b = Gaussian([0, 4], [[1, 0], [0, 0]])
    >>> print(wasserstein(a, b))
    5.0
    """
    for argument in (a, b):
        if not isinstance(argument, Gaussian):
            raise TypeError(f"wasserstein compares two Gaussians; got a {type(argument).__name__}")
    if a.mean.shape[-1] != b.mean.shape[-1]:
        raise ControlDimension(f"a has dimension {a.mean.shape[-1]} and b has {b.mean.shape[-1]}; expected equal")
    A, B = _square_root(a.cov), _square_root(b.cov)
    left, _, right = np.linalg.svd(B @ A)
    bures = A - B @ left @ right
    return np.sqrt(np.sum((a.mean - b.mean) ** 2, axis=-1) + np.sum(bures**2, axis=(-2, -1)))


def _square_root(cov: Array) -> Array:
    eigenvalues, vectors = np.linalg.eigh(cov)
    return (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
