"""The pointwise minimum: the receding horizon at its shortest."""

from dataclasses import dataclass
from typing import ClassVar

from switchctl.graph import SwitchingGraph
from switchctl.methods.base import Method, Scheduler
from switchctl.methods.receding_horizon import RecedingHorizon
from switchctl.modes import ModeSet


@dataclass(frozen=True, repr=False)
class PointwiseMinimum(Method):
    """Take, at every sample, the mode whose next W2 is least (the paper's case T = 0).

    With stage weights other than the identity, the mode whose present and next sample cost least together: in either
    case the receding horizon with T = 1, re-decided every step. It does not look ahead, and may do worse than a poor
    mode held for ever.

    Examples
    --------
    >>> modes = ModeSet([[[0.5]], [[0.9]]])
    >>> PointwiseMinimum().start(modes).step([1.0])
    0
    """

    evaluates: ClassVar[bool] = True

    def start(self, graph: SwitchingGraph | ModeSet) -> Scheduler:  # noqa: D102
        return RecedingHorizon(horizon=1).start(graph)
