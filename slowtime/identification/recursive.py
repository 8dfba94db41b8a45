r"""Blocks of a stream in, modes as they are known so far out; bounded memory, bounded work.

Every band of :mod:`.bands` is moved to zero frequency by overlapping frames of the stream and
sampled as slowly as it is wide. Products of the slow series are summed over blocks: of equal
length from the beginning on, two becoming one whenever there are too many (nothing is
forgotten), or fading with age (`memory_s`). The subspace models of a band are solved anew when
it is due. Neither memory nor work per second depends on how long the stream has been running.

The modes are those of subspace models alone. They agree with `identify_modes` of the same
samples within their standard deviations, which are larger than what the likelihood of a whole
record allows.
"""

import dataclasses

import numpy as np
import scipy.fft as fft
from jaxtyping import Complex, Float

from .bands import EDGE, Band, plan
from .correlations import BLOCKS_PER_DRAW, MOST_DRAWS, block_products, combine
from .identified import Measured
from .modes import Mode
from .shapes import mac, normalised
from .ssi import Poles, identify, mixed
from .stabilisation import Candidate, candidates

FRAME = 24.0
"""A frame lasts so many times as long as the fading edge of its band is narrow [1/Hz]."""

MOST_BLOCKS = 2 * BLOCKS_PER_DRAW * MOST_DRAWS
FADED = 5.0
"""What is so many memories old is dropped."""

SURE = 0.5
"""Standard deviations, in half-bandwidths, of the frequency and decay of a mode at most."""

SEEN = 8
"""Orders that must show it."""

STEADY = 5e-4
"""A pole whose damping is below this with 95 % probability is a machine's."""

ALIKE = 0.8


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandState:
    """What is kept of one band.

    Parameters
    ----------
    next_frame
        Index of the first sample of the next frame.
    hops
        Frames done.
    scale, directions
        Of the channels, fixed by the first frame.
    recent
        Last instants of the slow series, for lags that reach into the next frame.
    products, pairs, born
        Sums of products of each block, numbers of pairs, and end of each block [s].
    modes
        As last solved, at `solved_s`.
    """

    next_frame: int
    hops: int
    scale: Float[np.ndarray, " channel"] | None
    directions: Complex[np.ndarray, "channel direction"] | None
    recent: Complex[np.ndarray, "recent direction"] | None
    products: tuple[Complex[np.ndarray, "lag direction direction"], ...]
    pairs: tuple[float, ...]
    born: tuple[float, ...]
    modes: tuple[Mode, ...]
    solved_s: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RecursiveState:
    """The last samples, how many there were, and what is kept of every band."""

    tail: Float[np.ndarray, "time channel"] | None
    count: int
    bands: tuple[BandState, ...]

    @property
    def modes(self) -> tuple[Mode, ...]:
        """All modes known so far, ascending in frequency."""
        found = [mode for band in self.bands for mode in band.modes]
        return tuple(sorted(found, key=lambda mode: mode.frequency_hz.value))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RecursiveModes:
    """Modes of an endless stream.

    Parameters
    ----------
    rate_hz
        Samples per second [Hz].
    band_hz
        Where modes are looked for [Hz]; the lower edge sets the delay, about 30 of its cycles.
    memory_s
        Time in which old samples lose their weight by e [s]; None forgets nothing.
    every_s
        A band is solved no more often than this [s].
    rows, order, most_directions
        Block rows, highest order and combinations of channels of the subspace models.
    """

    rate_hz: float
    band_hz: tuple[float, float]
    memory_s: float | None = None
    every_s: float = 60.0
    rows: int = 12
    order: int = 20
    most_directions: int = 8

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not 0 < low < high < EDGE * self.rate_hz / 2:
            raise ValueError(
                f"band_hz=({low:g}, {high:g}) is not a band between 0 and "
                f"{EDGE * self.rate_hz / 2:g} Hz, nearly half the sampling rate. Give "
                "0 < low < high < that, or sample faster."
            )
        if self.memory_s is not None and self.memory_s * low < 50:
            raise ValueError(
                f"memory_s={self.memory_s:g} holds {self.memory_s * low:.0f} cycles of the "
                f"lowest frequency. Give at least {50 / low:g} s, or a higher band."
            )

    @property
    def bands(self) -> tuple[Band, ...]:
        """Bands, widest and last at the top."""
        return plan(*self.band_hz, self.rate_hz, resolution_hz=0.0)

    def start(self) -> RecursiveState:
        """Nothing seen yet."""
        empty = BandState(0, 0, None, None, None, (), (), (), (), -np.inf)
        return RecursiveState(None, 0, tuple(empty for _ in self.bands))

    def step(
        self, state: RecursiveState, block: Float[np.ndarray, "time channel"]
    ) -> tuple[RecursiveState, tuple[Mode, ...]]:
        """Take in one block, however long; give all modes as they are known now."""
        if not np.isfinite(block).all():
            raise ValueError(
                "A block with NaN or infinite samples was given. Start anew after the gap."
            )
        tail = block if state.tail is None else np.concatenate([state.tail, block])
        count = state.count + len(block)
        first = count - len(tail)
        bands = []
        for band, of_band in zip(self.bands, state.bands, strict=True):
            frame = _Frame.of(band, self.rate_hz)
            while of_band.next_frame + frame.length <= count:
                at = of_band.next_frame - first
                samples = tail[at : at + frame.length]
                of_band = self._taken_in(of_band, frame, samples)
            bands.append(self._solved(of_band, frame, count / self.rate_hz))
        keep = count - min(band.next_frame for band in bands)
        state = RecursiveState(tail[len(tail) - min(keep, len(tail)) :], count, tuple(bands))
        return state, state.modes

    def _taken_in(self, state: BandState, frame: "_Frame", samples: np.ndarray) -> BandState:
        """Slow series of the middle half of a frame, and its products with what came before."""
        slow = frame.moved_to_zero(samples, state.hops)
        if state.directions is None:
            scale = np.sqrt(np.mean(np.abs(slow) ** 2, axis=0))
            scale = np.where(scale > 0, scale, 1.0)
            number = min(self.most_directions, slow.shape[1])
            turned = np.linalg.svd(slow / scale, full_matrices=True)[2]
            directions = turned[:number].conj().T
        else:
            scale, directions = state.scale, state.directions
        slow = (slow / scale) @ directions
        lags = 2 * self.rows
        series = slow if state.recent is None else np.concatenate([state.recent, slow])
        ready = len(series) - lags + 1
        products, pairs, born = state.products, state.pairs, state.born
        if ready > 0:
            made = block_products(series, series[:ready], lags=lags, length=ready)[0]
            end = (state.next_frame + 0.75 * frame.length) / self.rate_hz
            products, pairs, born = (*products, made), (*pairs, float(ready)), (*born, end)
            products, pairs, born = self._bounded(products, pairs, born)
            series = series[ready:]
        return dataclasses.replace(
            state,
            next_frame=state.next_frame + frame.length // 2,
            hops=state.hops + 1,
            scale=scale,
            directions=directions,
            recent=series,
            products=products,
            pairs=pairs,
            born=born,
        )

    def _bounded(
        self,
        products: tuple[np.ndarray, ...],
        pairs: tuple[float, ...],
        born: tuple[float, ...],
    ) -> tuple[tuple[np.ndarray, ...], tuple[float, ...], tuple[float, ...]]:
        """Forget what has faded; join blocks into longer ones where there are too many."""
        if self.memory_s is not None:
            old = sum(end < born[-1] - FADED * self.memory_s for end in born)
            products, pairs, born = products[old:], pairs[old:], born[old:]
        longest = max(pairs)
        # A block is still growing until it is as long as the longest.
        if len(pairs) > 1 and pairs[-2] + pairs[-1] <= longest and len(pairs) > MOST_BLOCKS / 2:
            products = (*products[:-2], products[-2] + products[-1])
            pairs = (*pairs[:-2], pairs[-2] + pairs[-1])
            born = (*born[:-2], born[-1])
        if len(pairs) > MOST_BLOCKS:
            even = len(pairs) - len(pairs) % 2
            rest = products[even:], pairs[even:], born[even:]
            joined = tuple(products[k] + products[k + 1] for k in range(0, even, 2))
            sums = tuple(pairs[k] + pairs[k + 1] for k in range(0, even, 2))
            products, pairs = joined + rest[0], sums + rest[1]
            born = born[1:even:2] + rest[2]
        return products, pairs, born

    def _solved(self, state: BandState, frame: "_Frame", now_s: float) -> BandState:
        """Models of a band that is due, or the state as it is."""
        due = now_s - state.solved_s >= self.every_s
        if not due or len(state.pairs) < 16 or state.directions is None or state.scale is None:
            return state
        weight = np.ones(len(state.pairs))
        if self.memory_s is not None:
            weight = np.exp((np.array(state.born) - state.born[-1]) / self.memory_s)
        pairs = np.array(state.pairs) * weight
        products = np.stack(state.products) * weight[:, None, None, None]
        correlations = combine(
            products,
            np.repeat(pairs[:, None], products.shape[1], axis=1),
            rate_hz=frame.rate_hz,
            centre_hz=frame.centre_hz,
        )
        effective = pairs.sum() ** 2 / np.sum(pairs * weight) / frame.rate_hz
        correlations = dataclasses.replace(correlations, duration_s=float(effective))
        poles = identify(
            correlations,
            block_rows=self.rows,
            orders=range(1, self.order + 1),
            weighting="both",
        )
        band = frame.band
        found = candidates(poles, low_hz=band.low_hz, high_hz=band.high_hz)
        found = _distinct([c for c in found if _is_mode(c)])
        modes: tuple[Mode, ...] = ()
        if found:
            again = identify(
                correlations,
                block_rows=self.rows,
                orders=[int(poles.order[c.index]) for c in found],
                weighting="both",
                shapes=True,
            )
            back = state.scale[:, None] * state.directions.conj()
            modes = _modes(found, mixed(again, back))
        return dataclasses.replace(state, modes=modes, solved_s=now_s)


@dataclasses.dataclass(frozen=True, slots=True)
class _Frame:
    """How a band is cut out of the stream: bins `first` to `last` of `length` samples."""

    band: Band
    length: int
    first: int
    number: int
    sampling_hz: float

    @staticmethod
    def of(band: Band, rate_hz: float) -> "_Frame":
        edge = min(band.low_hz - band.from_hz, band.to_hz - band.high_hz)
        length = 2 * fft.next_fast_len(int(np.ceil(FRAME / edge * rate_hz / 2)), real=True)
        spacing = rate_hz / length
        first = int(np.ceil(band.from_hz / spacing))
        last = int(np.floor(band.to_hz / spacing))
        number = fft.next_fast_len(last - first + 1)
        while number % 4:
            number = fft.next_fast_len(number + 1)
        return _Frame(band, length, first, number, rate_hz)

    @property
    def rate_hz(self) -> float:
        """Of the slow series [Hz]."""
        return self.number * self.sampling_hz / self.length

    @property
    def centre_hz(self) -> float:
        """Frequency that is moved to zero [Hz]."""
        return self.first * self.sampling_hz / self.length

    def moved_to_zero(self, samples: np.ndarray, hop: int) -> np.ndarray:
        """Slow series of the middle half, phase running on from frame to frame."""
        spectrum = fft.rfft(samples, axis=0)
        stop = min(self.first + self.number, len(spectrum))
        index = np.arange(self.first, stop)
        gain = self.band.gain(index * self.sampling_hz / self.length)
        padded = np.zeros((self.number, samples.shape[1]), dtype=complex)
        padded[: len(index)] = spectrum[index] * gain[:, None]
        slow = fft.ifft(padded, axis=0) * (2.0 * self.number / self.length)
        quarter = self.number // 4
        # Each hop is half a frame, in which the lowest bin turns by so many half turns.
        turn = -1.0 if self.first * hop % 2 else 1.0
        return np.asarray(turn * slow[quarter : 3 * quarter])


def _is_mode(candidate: Candidate) -> bool:
    width = candidate.damping_ratio * candidate.frequency_hz
    sure = candidate.frequency_sd_hz < SURE * width
    sure = sure and candidate.damping_sd < SURE * candidate.damping_ratio
    return bool(candidate.orders >= SEEN and (sure or _is_steady(candidate)))


def _is_steady(candidate: Candidate) -> bool:
    return candidate.damping_ratio + 1.64 * candidate.damping_sd < STEADY


def _distinct(found: list[Candidate]) -> list[Candidate]:
    kept: list[Candidate] = []
    for one in sorted(found, key=lambda c: c.frequency_sd_hz):
        near = [c for c in kept if abs(c.pole - one.pole) < -one.pole.real - c.pole.real]
        if all(mac(one.shape, c.shape) < ALIKE for c in near):
            kept.append(one)
    return kept


def _modes(found: list[Candidate], poles: Poles) -> tuple[Mode, ...]:
    sd_f, sd_z, correlation = poles.standard_deviations()
    shape_sd = poles.shape_sd()
    modes = []
    for candidate in found:
        k = int(np.argmin(np.abs(poles.pole - candidate.pole)))
        modes.append(
            Mode(
                frequency_hz=Measured(candidate.frequency_hz, float(sd_f[k])),
                damping_ratio=Measured(candidate.damping_ratio, float(sd_z[k])),
                correlation=float(correlation[k]),
                shape=normalised(poles.shape[:, k]),
                shape_sd=shape_sd[:, k],
                kind="harmonic" if _is_steady(candidate) else "structural",
                quality=min(candidate.share, 1.0),
            )
        )
    return tuple(modes)
