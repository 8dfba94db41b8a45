"""Running sums of products of a series, in stretches of equal length.

The mean of all products is what a model is made of; how the sums of stretches scatter about it
says how well it is known. Of a stream of any length between half of `MOST` stretches and `MOST`
are kept, all of equal length.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex

from slowtime.identification.subspace.correlations import (
    BLOCKS_PER_DRAW,
    Correlations,
    combine_products,
)

MOST = 32
"""Largest number of sums kept."""

FEWEST = 16
"""Least number of sums for an estimate of the errors."""

FADED = 5.0
"""Age after which a sum is dropped [memories]."""

Products = Complex[np.ndarray, "lag direction direction"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ProductSum:
    """Sum of products, of how many pairs, and when the last of them came [s]."""

    products: Products
    pairs: float
    end_s: float

    def __add__(self, later: "ProductSum") -> "ProductSum":
        """Both as one."""
        return ProductSum(self.products + later.products, self.pairs + later.pairs, later.end_s)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ProductSums:
    """Stretches of `length` additions each, and one that is still growing."""

    whole: tuple[ProductSum, ...] = ()
    growing: ProductSum | None = None
    additions: int = 0
    length: int = 1

    def added(self, more: ProductSum, memory_s: float | None) -> "ProductSums":
        """Add a sum; drop those that are too old, and join pairs where there are too many.

        With `memory_s` None, everything is kept.
        """
        growing = more if self.growing is None else self.growing + more
        if self.additions + 1 < self.length:
            return dataclasses.replace(self, growing=growing, additions=self.additions + 1)
        # Rounding of single precision is far below what the stretches scatter by.
        closed = dataclasses.replace(growing, products=growing.products.astype(np.complex64))
        whole = (*self.whole, closed)
        if memory_s is not None:
            oldest = more.end_s - FADED * memory_s
            whole = tuple(stretch for stretch in whole if stretch.end_s >= oldest)
        if len(whole) < MOST:
            return ProductSums(whole, length=self.length)
        joined = (a + b for a, b in zip(whole[::2], whole[1::2], strict=True))
        return ProductSums(tuple(joined), length=2 * self.length)

    def correlations(
        self, *, rate_hz: float, centre_hz: float, memory_s: float | None
    ) -> Correlations | None:
        """Correlation matrices and draws of their error; None with too few sums."""
        stretches = self.whole if self.growing is None else (*self.whole, self.growing)
        if len(stretches) < FEWEST:
            return None
        ends = np.array([stretch.end_s for stretch in stretches])
        weight = (
            np.ones(len(ends)) if memory_s is None else np.exp((ends - ends[-1]) / memory_s)
        )
        pairs = weight * np.array([stretch.pairs for stretch in stretches])
        products = np.stack([stretch.products for stretch in stretches]).astype(complex)
        found = combine_products(
            products * weight[:, None, None, None],
            np.repeat(pairs[:, None], products.shape[1], axis=1),
            rate_hz=rate_hz,
            centre_hz=centre_hz,
            draws=len(stretches) // BLOCKS_PER_DRAW,
        )
        # So many seconds of equal weight would know as much.
        worth = pairs.sum() ** 2 / np.sum(pairs * weight) / rate_hz
        return dataclasses.replace(found, duration_s=float(worth))
