"""Recursive sums of products of one band, and the modes last read from them."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.modes import Mode
from slowtime.identification.subspace.bands import Passband
from slowtime.identification.subspace.correlations import block_products

from .band_solution import ModelSizes, solve_band, strongest_directions
from .forgetting import FadingCoefficients, FrequencyGrid
from .frames import BinRange
from .product_sums import ProductSum, ProductSums

LEARNT = 150
"""Instants after which the combinations of channels are chosen."""

Slow = Complex[np.ndarray, "instant series"]
Earlier = Complex[np.ndarray, "_ _"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandState:
    """What is kept of one band.

    Parameters
    ----------
    next_frame
        Index of the first sample of the next frame.
    into
        Combinations of the channels that are looked at; None until enough has been seen.
    waiting
        Stretches of slow series, apart by gaps, seen before these were chosen.
    sums
        Of lagged products, over stretches.
    modes, age
        As last solved, and frames since.
    """

    next_frame: int = 0
    frames: int = 0
    into: Complex[np.ndarray, "channel direction"] | None = None
    waiting: tuple[Earlier, ...] = ()
    recent: Earlier | None = None
    sums: ProductSums = dataclasses.field(default_factory=ProductSums)
    fading: FadingCoefficients | None = None
    modes: tuple[Mode, ...] = ()
    age: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class BandStep:
    """How one band takes in its frames."""

    band: Passband
    raster: FrequencyGrid
    models: ModelSizes
    memory_s: float | None
    every: int
    """Frames after which models are solved anew."""

    @property
    def frame(self) -> BinRange:
        """How the band is cut out of the stream."""
        return self.raster.frame

    def step(
        self, state: BandState, samples: Float[np.ndarray, "time channel"]
    ) -> tuple[BandState, bool]:
        """Process the next frame.

        Says, too, whether the band is due for a solution.
        """
        slow = self.frame.moved_to_zero(samples, state.frames)
        end_s = (state.next_frame + 0.75 * self.frame.length) / self.frame.sampling_hz
        state = dataclasses.replace(
            state,
            next_frame=state.next_frame + self.frame.hop,
            frames=state.frames + 1,
            age=state.age + 1,
        )
        if state.into is None:
            state = self._learning(state, slow, end_s)
        else:
            state = self._taken_in(state, state.into, slow, end_s)
        due = state.age >= self.every and state.into is not None
        return dataclasses.replace(state, age=0 if due else state.age), due

    def after_gap(self, state: BandState, index: int) -> BandState:
        """State after a gap in the stream; nothing is joined across it."""
        waiting, fading = state.waiting, state.fading
        if state.into is None and state.recent is not None:
            waiting = (*waiting, state.recent)
        return dataclasses.replace(
            state,
            next_frame=index,
            frames=0,
            waiting=waiting,
            recent=None,
            fading=None if fading is None else self.raster.after_gap(fading),
        )

    def solved(self, state: BandState) -> tuple[Mode, ...]:
        """Modes of the band, ascending in frequency; none while too little is known."""
        correlations = state.sums.correlations(
            rate_hz=self.frame.rate_hz,
            centre_hz=self.frame.centre_hz,
            memory_s=self.memory_s,
        )
        if correlations is None or state.into is None or state.fading is None:
            return ()
        if state.fading.weight == 0:
            return ()
        seen = self.raster.seen(state.fading, state.into)
        return solve_band(correlations, seen, self.band, self.models)

    def _learning(self, state: BandState, slow: Slow, end_s: float) -> BandState:
        recent = slow if state.recent is None else np.concatenate([state.recent, slow])
        seen = (*state.waiting, recent)
        if sum(map(len, seen)) < LEARNT:
            return dataclasses.replace(state, recent=recent)
        into = strongest_directions(np.concatenate(seen), self.models.most_directions)
        fading = self.raster.start(*into.shape)
        state = dataclasses.replace(state, into=into, fading=fading, waiting=())
        for series in seen:
            state = dataclasses.replace(
                state, recent=None, fading=self.raster.after_gap(fading)
            )
            hops = np.split(series, len(series) // (self.frame.number // 2))
            for hop in hops:
                state = self._taken_in(state, into, hop, end_s)
            fading = state.fading or fading
        return state

    def _taken_in(
        self,
        state: BandState,
        into: Complex[np.ndarray, "series direction"],
        slow: Slow,
        end_s: float,
    ) -> BandState:
        fading = state.fading
        if fading is not None:
            fading = self.raster.step(fading, slow, into, self.memory_s)
        slow = slow @ into
        series = slow if state.recent is None else np.concatenate([state.recent, slow])
        state = dataclasses.replace(state, fading=fading, recent=series)
        ready = len(series) - self.models.lags + 1
        if ready <= 0:
            return state
        made = block_products(series, series, lags=self.models.lags, length=ready)[0]
        sums = state.sums.added(ProductSum(made, float(ready), end_s), self.memory_s)
        return dataclasses.replace(state, sums=sums, recent=series[ready:])
