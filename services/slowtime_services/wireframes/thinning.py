"""A graph of many nodes → few nodes that outline it, and the lines between them."""

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.csgraph import dijkstra


def spread_nodes(
    places: Float[np.ndarray, "node 3"], kept: Int[np.ndarray, " kept"], count: int
) -> Int[np.ndarray, " chosen"]:
    """Choose nodes that are far from each other (farthest-point sampling).

    Parameters
    ----------
    places
        Position of each node [m].
    kept
        Nodes that are chosen in any case.
    count
        How many nodes in total; all where there are no more.

    Returns
    -------
    Numbers of the chosen nodes, ascending.

    References
    ----------
    .. [1] T. F. Gonzalez, "Clustering to minimize the maximum intercluster distance",
       Theoretical Computer Science 38 (1985) 293-306.
    """
    if len(places) <= count:
        return np.arange(len(places))
    start = int(np.argmax(np.linalg.norm(places - places.mean(axis=0), axis=1)))
    chosen = list(dict.fromkeys(kept.tolist())) or [start]
    away = np.full(len(places), np.inf)
    for node in chosen:
        away = np.minimum(away, np.linalg.norm(places - places[node], axis=1))
    while len(chosen) < count:
        farthest = int(np.argmax(away))
        chosen.append(farthest)
        away = np.minimum(away, np.linalg.norm(places - places[farthest], axis=1))
    return np.array(sorted(set(chosen)))


def contracted(
    lines: Int[np.ndarray, "line 2"],
    groups: tuple[str, ...],
    places: Float[np.ndarray, "node 3"],
    chosen: Int[np.ndarray, " chosen"],
) -> tuple[Int[np.ndarray, "few 2"], tuple[str, ...]]:
    """Join chosen nodes whose neighbourhoods touch.

    Every node belongs to the chosen node that is nearest along the lines. Two chosen nodes are
    joined if a line joins a node of one with a node of the other.

    Parameters
    ----------
    lines
        Pairs of nodes.
    groups
        Parameter of each line; empty for none.
    places
        Position of each node [m].
    chosen
        Numbers of the chosen nodes, ascending.

    Returns
    -------
    Pairs of positions in `chosen`, each once, and the group of each: that of most lines.
    """
    size = len(places)
    length = np.linalg.norm(places[lines[:, 0]] - places[lines[:, 1]], axis=1)
    length = np.maximum(length, 1e-9 * max(float(length.max(initial=0.0)), 1e-300))
    # Two lines between the same nodes would be added up.
    pairs, first = np.unique(np.sort(lines, axis=1), axis=0, return_index=True)
    graph = sparse.csr_array((length[first], (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    _, _, source = dijkstra(
        graph, directed=False, indices=chosen, min_only=True, return_predecessors=True
    )
    owner = np.where(source >= 0, np.searchsorted(chosen, np.maximum(source, 0)), -1)
    ends = np.sort(owner[lines], axis=1)
    joins = (ends[:, 0] >= 0) & (ends[:, 0] != ends[:, 1])
    votes: dict[tuple[int, int], dict[str, int]] = {}
    for number in np.flatnonzero(joins).tolist():
        pair = (int(ends[number, 0]), int(ends[number, 1]))
        votes.setdefault(pair, {}).setdefault(groups[number], 0)
        votes[pair][groups[number]] += 1
    ordered = sorted(votes)
    named = tuple(
        max(votes[pair].items(), key=lambda one: (one[1], one[0]))[0] for pair in ordered
    )
    return np.array(ordered, dtype=int).reshape(-1, 2), named
