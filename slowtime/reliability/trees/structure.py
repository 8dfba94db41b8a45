"""Reliability trees: gates over members that fail or work."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool


@dataclasses.dataclass(frozen=True, slots=True)
class Gate:
    """A part of a system that fails once at least so many of its inputs have failed.

    Parameters
    ----------
    failures
        Of the inputs, from which on the gate fails: 1 is a series, all of them are parallel.
    inputs
        Members and gates.
    """

    failures: int
    inputs: "tuple[str | Gate, ...]"

    def __post_init__(self) -> None:
        if not self.inputs:
            raise ValueError("A gate was given no input. Give it at least one member or gate.")
        if not 1 <= self.failures <= len(self.inputs):
            raise ValueError(
                f"A gate of {len(self.inputs)} inputs was told to fail with {self.failures} of "
                f"them. Allowed: 1 to {len(self.inputs)}."
            )


Node: TypeAlias = str | Gate
"""A member, by its name, or a gate."""


def series(*inputs: Node) -> Gate:
    """Fails as soon as one input fails."""
    return Gate(1, inputs)


def parallel(*inputs: Node) -> Gate:
    """Fails once all inputs have failed."""
    return Gate(len(inputs), inputs)


def k_of_n(k: int, *inputs: Node) -> Gate:
    """Work as long as at least `k` inputs work (k-out-of-n:G).

    Examples
    --------
    >>> k_of_n(2, "a", "b", "c").failures
    2
    """
    if not 1 <= k <= len(inputs):
        raise ValueError(
            f"{k} of {len(inputs)} inputs were asked to work. Allowed: 1 to {len(inputs)}."
        )
    return Gate(len(inputs) - k + 1, inputs)


def members(tree: Node) -> tuple[str, ...]:
    """Name each member once, in the order of its first place in the tree.

    Examples
    --------
    >>> members(series("b", parallel("a", "b")))
    ('b', 'a')
    """
    return tuple(dict.fromkeys(_leaves(tree)))


def fails(
    tree: Node, failed: Mapping[str, Bool[np.ndarray, " case"]]
) -> Bool[np.ndarray, " case"]:
    """Tell in which cases the tree fails.

    Parameters
    ----------
    tree
        Tree of members and gates.
    failed
        Of each member, whether it has failed in each case.

    Returns
    -------
    True for each case in which the tree fails.
    """
    if isinstance(tree, str):
        return failed[tree]
    count = np.zeros(len(next(iter(failed.values()))), dtype=np.int64)
    for one in tree.inputs:
        count += fails(one, failed)
    return np.asarray(count >= tree.failures)


def _leaves(tree: Node) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    else:
        for one in tree.inputs:
            yield from _leaves(one)
