"""Run: the response of a simulated loop."""

from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from switchctl.moments import Array
from switchctl.tables import Summary


class Run(Summary, control.TimeResponseData):
    """The response of a simulated loop, as python-control's, with what the switching did. `simulate` makes one.

    Parameters
    ----------
    time : array, shape (N + 1,)
        The samples, in seconds (or their numbers, where the modes carry no period).
    outputs : array, shape (p + 1, N + 1)
        The plant's outputs, without noise, and the index of the controller that acts.
    states : array, shape (n + z, N + 1)
        The plant's states and the controllers'.
    inputs : array, shape (q, N + 1)
        The plant's inputs, as they act from each sample on.
    sequence : int array, shape (N,)
        The mode of each step; of a run that stopped within a step, that step's too.
    w2 : array, shape (N + 1,)
        Squared distance of the plant's state to the operating point.
    status : str
        "completed", or when and why the run stopped.
    names : tuple of str
        Of the modes.
    labels : dict
        The keywords by which `control.TimeResponseData` is told the names of signals.
    """

    def __init__(
        self,
        time: Array,
        outputs: Array,
        states: Array,
        inputs: Array,
        *,
        sequence: NDArray[np.intp],
        w2: Array,
        status: str,
        names: tuple[str, ...],
        labels: dict[str, Any],
    ) -> None:
        success = status == "completed"
        super().__init__(time, outputs, states, inputs, success=success, message=status, issiso=False, **labels)
        self.sequence, self.w2, self.status, self.names = sequence, w2, status, names

    def _facts(self) -> list[tuple[str, str]]:
        use = np.bincount(self.sequence, minlength=len(self.names))
        told = [
            ("plant", self.sysname or ""),
            ("W2", f"{self.w2[0]:.6g} -> {self.w2[-1]:.6g}"),
            ("switches", f"{np.count_nonzero(np.diff(self.sequence))}"),
            ("use", ", ".join(f"{n} {100 * c / use.sum():.1f} %" for n, c in zip(self.names, use, strict=True) if c)),
            ("ends", self.status),
        ]
        return [(key, value) for key, value in told if value]

    def _heading(self) -> str:
        return f"Run: {len(self.t)} samples, from {self.t[0]:g} to {self.t[-1]:g}"
