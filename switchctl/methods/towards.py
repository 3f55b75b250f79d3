"""Plans by the Wasserstein distance to a Gaussian target, which is no linear functional of the second moment."""

import numpy as np

from switchctl.gaussian import Gaussian
from switchctl.graph import SwitchingGraph
from switchctl.moments import Array
from switchctl.predicted import factors_along, squared_distances


def towards(graph: SwitchingGraph, node: int, plans: list[list[int]], F: Array, target: Gaussian) -> Array:
    """What plans cost, per dk, with the squared distance to a target in the place of the stage weight.

    Parameters
    ----------
    graph : SwitchingGraph
        The modes, and what switches cost.
    node : int
        Where the plans begin.
    plans : list of list of int
        The modes of each.
    F : array, shape (n, n + 1)
        The moment factor at the beginning.
    target : Gaussian
        Of the plant's state.

    Returns
    -------
    array, shape (r,)
    """
    modes, costs = graph.modes, []
    for plan in plans:
        before = np.array([int(graph.last_mode[node]), *plan[:-1]])
        *factors, _ = factors_along(modes, before, plan, F)
        distances = squared_distances(modes, np.array(factors), target)
        switches = graph.switch_cost[before, plan] + graph.switch_cost_per_w2[before, plan] * distances
        each = distances + graph.price[plan] + switches / modes.dk
        costs.append(modes.discount ** np.arange(len(plan)) @ each)
    return np.array(costs)
