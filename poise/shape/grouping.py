"""Which things hang together."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from poise.types import Indices


def linked(count: int, pairs: Indices) -> Indices:
    """(N,) the group, from 0 on, of each of N things that pairs (P, 2) connect."""
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
