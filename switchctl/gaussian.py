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
    FloatingPointError
        From the methods, if what is asked for exceeds the floating-point range.

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
            If there are fewer than two samples, or they have no entries.

        Examples
        --------
        >>> Gaussian.from_samples([[0, 1], [2, 3]]).mean
        array([1., 2.])
        """
        samples = real_array(samples, "samples", (None, None))
        if len(samples) < 2:
            raise ValueError(f"samples has {len(samples)} row(s); a covariance needs at least two, one sample a row")
        if samples.shape[1] == 0:
            raise ControlDimension(f"samples has shape {samples.shape}; expected at least one column, a state each")
        with np.errstate(over="ignore", invalid="ignore"):
            mean, cov = samples.mean(axis=0), np.atleast_2d(np.cov(samples, rowvar=False))
        return cls(_in_range(mean, "the mean of samples"), _in_range(cov, "the covariance of samples"))

    @property
    def second_moment(self) -> Array:
        """``S = mean mean' + cov``, shape (..., n, n)."""
        with np.errstate(over="ignore"):
            return _in_range(second_moment(self.mean, self.cov), "the second moment")

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
        _broadcast(self, np.shape(target)[:-1], "target")
        with np.errstate(over="ignore"):
            shift = self.mean - target
            w2 = np.sum(shift**2, axis=-1) + np.trace(self.cov, axis1=-2, axis2=-1)
        return _in_range(w2, "W2")

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
        with np.errstate(over="ignore"):
            shifted = self.mean - real_array(point, "point", (self.mean.shape[-1],))
        return type(self)(_in_range(shifted, "mean - point"), self.cov)

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
    for name, argument in (("a", a), ("b", b)):
        if not isinstance(argument, Gaussian):
            raise TypeError(f"{name}: wasserstein compares two Gaussians; got a {type(argument).__name__}")
    if a.mean.shape[-1] != b.mean.shape[-1]:
        raise ControlDimension(f"a has dimension {a.mean.shape[-1]} and b has {b.mean.shape[-1]}; expected equal")
    _broadcast(a, b.mean.shape[:-1], "b")
    shift = a.mean / 2 - b.mean / 2  # which is never beyond the range
    size = np.maximum(np.abs(shift).max(axis=-1), np.sqrt(np.maximum(_greatest(a.cov), _greatest(b.cov))))
    unit = np.exp2(np.floor(np.log2(np.where(size > 0, size, 1.0))))[..., None, None]
    A, B = _square_root(a.cov / unit / unit), _square_root(b.cov / unit / unit)
    left, _, right = np.linalg.svd(B @ A)
    bures = A - B @ left @ right
    shift = 2 * (shift / unit[..., 0])
    with np.errstate(over="ignore"):
        distance = unit[..., 0, 0] * np.sqrt(np.sum(shift**2, axis=-1) + np.sum(bures**2, axis=(-2, -1)))
    return _in_range(distance, "the distance")


def _square_root(cov: Array) -> Array:
    eigenvalues, vectors = np.linalg.eigh(cov)
    return (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def _greatest(cov: Array) -> Array:
    """The greatest variance."""
    return np.asarray(np.diagonal(cov, axis1=-2, axis2=-1).max(axis=-1))


def _broadcast(a: Gaussian, batch: tuple[int, ...], name: str) -> None:
    """Refuse a batch that doesn't go with that of a Gaussian."""
    try:
        np.broadcast_shapes(a.mean.shape[:-1], batch)
    except ValueError:
        raise ControlDimension(
            f"{name} is a batch of shape {batch}, and the Gaussian one of {a.mean.shape[:-1]}; they don't broadcast"
        ) from None


def _in_range(value: Any, what: str) -> Any:
    """Refuse what has left the floating-point range."""
    if not np.isfinite(value).all():
        raise FloatingPointError(f"{what} exceeds the floating-point range; scale the state")
    return value
