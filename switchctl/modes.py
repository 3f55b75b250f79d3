"""Modes: the closed loops among which a schedule chooses."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from control import ControlDimension
from numpy.typing import NDArray

from switchctl import mode_checks as checks
from switchctl.gramians import tail
from switchctl.mode_checks import Cost
from switchctl.moments import Array, root, transform
from switchctl.schur import is_schur
from switchctl.tables import html_table
from switchctl.validation import frozen, positive_semidefinite, real_array, sampling_period, whole_number

if TYPE_CHECKING:
    from control import StateSpace


@dataclass(frozen=True, eq=False)
class Mode:
    """One closed loop ``x+ = A x`` with stage cost ``x' Q x``: an entry of a `ModeSet`.

    Parameters
    ----------
    index : int
        Its place in the set, from 0.
    name : str
        Its name.
    A, Q : arrays, shape (n, n)
        The closed loop and its stage weight.
    K : array, shape (inputs, n), or None
        The gain ``u = -K x`` where it is known.
    dt : float or True
        Sampling period in seconds, or True for none.
    states : tuple of str
        The names of the states.

    Examples
    --------
    >>> ModeSet([[[0.5]], [[0.9]]], names=["fast", "slow"])["slow"].spectral_radius
    0.9
    """

    index: int
    name: str
    A: Array
    Q: Array
    K: Array | None
    dt: float | bool
    states: tuple[str, ...]

    @property
    def spectral_radius(self) -> float:
        """``rho(A)``, the greatest modulus of an eigenvalue."""
        return float(np.abs(np.linalg.eigvals(self.A)).max())

    def to_ss(self) -> "StateSpace":
        """Return the mode as a python-control `StateSpace` without inputs, whose outputs are its states.

        Returns
        -------
        control.StateSpace
            Of the mode's name, with "_" for ".", which python-control doesn't allow there.
        """
        import control

        n = len(self.A)
        no_input = np.zeros((n, 0))
        name = self.name.replace(".", "_")
        return control.ss(self.A, no_input, np.eye(n), no_input, self.dt, name=name, states=list(self.states))


_VERDICTS = {
    "yes": "",
    "no": "  not Schur",
    "where seen": "  Schur where the cost sees it",
    "undecided": "  Schur undecided",
}


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ModeSet:
    """The modes of a switched system ``x(k+1) = A_i x(k)``, with what a sample in each of them costs.

    `close_loops` makes one from a plant and its controllers; the constructor takes the A_i themselves.

    Parameters
    ----------
    matrices : array_like, shape (m, n, n)
        The A_i.
    names : sequence of str, optional
        Distinct names; "A0", "A1", .. by default.
    dt : float or True, optional
        Sampling period in seconds, or True (default) for steps without one.
    Q : array_like, shape (n, n) or (m, n, n), optional
        Stage weight, symmetric positive semidefinite, for all modes or one each: a sample in mode i costs
        ``tr(Q_i S)``. By default the identity on the plant's states, which makes the cost the squared Wasserstein
        distance.
    gains : array_like, shape (m, inputs, n), optional
        The gains ``u = -K_i x`` behind the modes, where known.
    states : sequence of str, optional
        Names of the states; "x[0]", "x[1]", .. by default.
    plant_states : int, optional
        How many of the states, the first ones, are the plant's: W2 is their distance. All by default. Those of
        controllers follow them.
    activation : array_like, shape (m, m, n, n), optional
        What a switch does to the state: where mode i takes over from mode j, its first step begins from
        ``activation[j, i] @ x``. The identity, nothing, by default; also needed for i = j.
    initial : array_like, shape (n, plant_states), optional
        The state at the start as a linear function of the plant's; by default controllers' states begin at zero.
    estimate_states : int, optional
        How many of the states, the last ones, are an estimate of the plant's: they begin at its mean. 0 by default.
    W : array_like, shape (n, n) or (m, n, n), optional
        Covariance of the process noise of a step, for all modes or one each; none by default.
    offset : array_like, shape (m,), optional
        What a sample in each mode costs besides ``tr(Q_i S)``; nothing by default.
    cost : "total", ("discounted", factor) or "average", optional
        What is added up for ever: every sample alike (default); the k-th one times ``factor ** k``, ``0 < factor < 1``;
        or the average of a step. With noise the total is infinite.

    Raises
    ------
    ValueError
        If shapes don't fit, an entry is not finite, a name is repeated or dt is not a sampling period.
    TypeError
        If the entries are not real numbers or a name is not a string.

    Examples
    --------
    >>> ModeSet([[[0.9, 0.1], [0.0, 0.8]], [[0.5, 2.0], [0.0, 1.1]]], names=["slow", "fast"], dt=0.1)
    ModeSet: 2 modes, 2 states, dt = 0.1 s
    ├── 0  slow  spectral radius 0.9
    └── 1  fast  spectral radius 1.1  not Schur
    """

    A: Array
    names: tuple[str, ...]
    dt: float | bool
    Q: Array
    gains: Array | None
    states: tuple[str, ...]
    plant_states: int
    activation: Array | None
    initial: Array
    estimate_states: int
    W: Array
    offset: Array
    cost: Cost

    def __init__(
        self,
        matrices: Any,
        names: Iterable[str] | None = None,
        dt: float | bool = True,
        *,
        Q: Any = None,
        gains: Any = None,
        states: Iterable[str] | None = None,
        plant_states: int | None = None,
        activation: Any = None,
        initial: Any = None,
        estimate_states: int = 0,
        W: Any = None,
        offset: Any = None,
        cost: Cost = "total",
    ) -> None:
        A = checks.stack(matrices)
        m, n, _ = A.shape
        p = n if plant_states is None else whole_number(plant_states, "plant_states")
        if p > n:
            raise ValueError(f"plant_states is {p}, but the modes have {n} states")
        weight = np.diag((np.arange(n) < p).astype(float)) if Q is None else real_array(Q, "Q")
        if weight.shape not in ((n, n), (m, n, n)):
            raise ControlDimension(f"Q has shape {weight.shape}; expected {(n, n)} or {(m, n, n)}")
        fields: dict[str, Any] = {
            "A": frozen(A),
            "names": checks.names(names, m, "names", "A{}"),
            "dt": sampling_period(dt),
            "Q": np.broadcast_to(positive_semidefinite(weight, "Q"), A.shape),
            "gains": None if gains is None else frozen(real_array(gains, "gains", (m, None, n))),
            "states": checks.names(states, n, "states", "x[{}]"),
            "plant_states": p,
            "activation": checks.activation(activation, m, n),
            "initial": frozen(np.eye(n, p) if initial is None else checks.initial(initial, n, p)),
            "estimate_states": whole_number(estimate_states, "estimate_states", 0),
            "W": frozen(np.zeros_like(A) if W is None else checks.noise(W, A.shape)),
            "offset": frozen(np.zeros(m) if offset is None else real_array(offset, "offset", (m,))),
            "cost": checks.cost(cost),
        }
        if fields["estimate_states"] not in (0, p) or p + fields["estimate_states"] > n:
            raise ValueError(f"estimate_states is {estimate_states}; expected 0, or {p} after the plant's states")
        if (fields["offset"] < 0).any():
            raise ValueError(f"offset is {fields['offset'].tolist()}; expected costs of at least 0")
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        rest = "Q gains states plant_states activation initial estimate_states W offset cost".split()
        rebuild = partial(type(self), **{name: getattr(self, name) for name in rest})
        return rebuild, (self.A, self.names, self.dt)  # so that copies are checked and read-only too

    @property
    def dk(self) -> float:
        """The weight of a sample in every cost (the paper's dk): dt in seconds, or 1 where dt is True."""
        return 1.0 if self.dt is True else float(self.dt)

    @property
    def discount(self) -> float:
        """What the cost of a step counts beside that of the one before."""
        return self.cost[1] if isinstance(self.cost, tuple) else 1.0

    @cached_property
    def noisy(self) -> bool:
        """Whether there is process noise."""
        return bool(self.W.any())

    @cached_property
    def noise_roots(self) -> Array | None:
        """Factors of the process noise, ``R_i R_i' = W_i``, shape (m, n, n); None without."""
        return frozen(np.stack([root(W) for W in self.W])) if self.noisy else None

    @cached_property
    def A_after(self) -> Array:
        """The first step of a mode that takes over, ``A_i activation[j, i]``, by the mode before and the mode.

        Shape (m + 1, m, n, n); the last row, -1, is for none before.
        """
        if self.activation is None:
            return np.broadcast_to(self.A, (len(self) + 1, *self.A.shape))
        return frozen(np.concatenate([self.A @ self.activation, self.A[None]]))

    @cached_property
    def Q_after(self) -> Array:
        """What that step costs, as a weight of the state before the switch, shape (m + 1, m, n, n)."""
        if self.activation is None:
            return np.broadcast_to(self.Q, (len(self) + 1, *self.Q.shape))
        return frozen(np.concatenate([transform(self.activation, self.Q), self.Q[None]]))

    @cached_property
    def every_step(self) -> tuple[Array, Array]:
        """All different steps that a run may take: their matrices and weights, those without a switch first."""
        if self.activation is None:
            return self.A, self.Q
        pairs = [
            (j, i)
            for j, i in np.ndindex(self.activation.shape[:2])
            if not np.array_equal(self.activation[j, i], np.eye(self.A.shape[-1]))
        ]
        j, i = (np.array(indices) for indices in zip(*pairs, strict=True))
        return np.concatenate([self.A, self.A_after[j, i]]), np.concatenate([self.Q, self.Q_after[j, i]])

    @cached_property
    def distance(self) -> Array:
        """The weight D of the distance, ``W2 = tr(D S)``: 1 for the plant's states, shape (n, n)."""
        return frozen(np.diag((np.arange(self.A.shape[-1]) < self.plant_states).astype(float)))

    @cached_property
    def spectral_radii(self) -> Array:
        """``rho(A_i)``, shape (m,)."""
        return frozen(np.abs(np.linalg.eigvals(self.A)).max(axis=-1))

    @cached_property
    def tails(self) -> tuple[Array | None, ...]:
        """What each mode costs for ever, ``P_i = Q_i + g A_i' P_i A_i``, or None where that is infinite (see `tail`).

        g is the discount, 1 without; what noise adds is left out.

        Raises `numpy.linalg.LinAlgError` where one can't be computed well enough.
        """
        A = np.sqrt(self.discount) * self.A
        tails = [self._of_mode(i, tail, A[i], self.Q[i]) for i in range(len(self))]
        return tuple(None if P is None else frozen(P) for P in tails)

    @cached_property
    def schur(self) -> NDArray[np.bool_]:
        """Whether each mode is Schur stable, shape (m,); `numpy.linalg.LinAlgError` where rounding hides it."""
        return frozen(np.array([self._of_mode(i, is_schur, self.A[i]) for i in range(len(self))]))

    def _of_mode(self, i: int, function: Callable[..., Any], *arguments: Array) -> Any:
        try:
            return function(*arguments)
        except np.linalg.LinAlgError as error:
            raise np.linalg.LinAlgError(f"mode {self.names[i]!r}: {error}") from None

    def _verdict(self, i: int) -> str:
        try:
            if is_schur(self.A[i]):
                return "yes"
            return "no" if self.tails[i] is None else "where seen"
        except np.linalg.LinAlgError:
            return "undecided"

    def index(self, mode: int | str | Mode) -> int:
        """Index of a mode given by index, by name or as one of this set.

        Parameters
        ----------
        mode : int, str or Mode
            Index from 0 (negative from the end, as in Python), name, or mode (known by its name).

        Returns
        -------
        int

        Raises
        ------
        KeyError
            If no mode has the name.
        IndexError
            If the index is out of range.
        """
        mode = mode.name if isinstance(mode, Mode) else mode
        if isinstance(mode, str):
            if mode not in self.names:
                raise KeyError(f"no mode is named {mode!r}; the modes are {', '.join(self.names)}")
            return self.names.index(mode)
        if isinstance(mode, np.ndarray) and mode.ndim == 0:
            mode = mode[()]
        if isinstance(mode, bool) or not isinstance(mode, (int, np.integer)):
            raise TypeError(f"a mode is given by its index or its name, not {mode!r} ({type(mode).__name__})")
        if not -len(self) <= mode < len(self):
            raise IndexError(f"mode {mode} is out of range; there are {len(self)} modes, counted from 0")
        return int(mode) % len(self)

    def __getitem__(self, mode: int | str | Mode) -> Mode:
        i = self.index(mode)
        K = None if self.gains is None else self.gains[i]
        return Mode(i, self.names[i], self.A[i], self.Q[i], K, self.dt, self.states)

    def __contains__(self, mode: object) -> bool:
        return (mode.name if isinstance(mode, Mode) else mode) in self.names

    def __len__(self) -> int:
        return len(self.A)

    def __iter__(self) -> Iterator[Mode]:
        return (self[i] for i in range(len(self)))

    def _heading(self) -> str:
        period = "no sampling period" if self.dt is True else f"dt = {self.dt:g} s"
        m, n = self.A.shape[:2]
        return f"ModeSet: {m} mode{'s' * (m > 1)}, {n} state{'s' * (n > 1)}, {period}"

    def __repr__(self) -> str:
        width = max(map(len, self.names))
        lines = [self._heading()]
        for i, (name, radius) in enumerate(zip(self.names, self.spectral_radii, strict=True)):
            branch = "└──" if i == len(self) - 1 else "├──"
            verdict = _VERDICTS[self._verdict(i)]
            lines.append(f"{branch} {i}  {name:<{width}}  spectral radius {radius:.6g}{verdict}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = [
            [i, name, f"{radius:.6g}", self._verdict(i)]
            for i, (name, radius) in enumerate(zip(self.names, self.spectral_radii, strict=True))
        ]
        return html_table(["index", "mode", "spectral radius", "Schur"], rows, self._heading())


def require_modes(modes: Any) -> None:
    """Refuse what is no `ModeSet`."""
    if not isinstance(modes, ModeSet):
        raise TypeError(f"modes must be a ModeSet (see close_loops), not a {type(modes).__name__}")
