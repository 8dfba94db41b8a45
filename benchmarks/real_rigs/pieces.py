"""Pieces of measured records, under the names of a model file's channels."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEARN, JUDGE = "learn", "judge"


@dataclasses.dataclass(frozen=True, eq=False)
class Piece:
    """Part of a record.

    Parameters
    ----------
    rate_hz
        Samples per second.
    channels
        Samples [time] by channel of the model file, in the units stated there.
    """

    rate_hz: float
    channels: Mapping[str, Array]

    def __post_init__(self) -> None:
        lengths = {len(values) for values in self.channels.values()}
        if len(lengths) != 1:
            raise ValueError(
                f"Channels of one piece have {sorted(lengths)} samples. Give all the same."
            )
        for name, values in self.channels.items():
            if not np.isfinite(values).all():
                raise ValueError(f"Channel {name!r} is not finite. Cut the piece elsewhere.")

    def __len__(self) -> int:
        return len(next(iter(self.channels.values())))

    def part(self, from_s: float = 0.0, to_s: float = np.inf) -> "Piece":
        """Return the samples from one instant to before another [s from the beginning]."""
        first = round(from_s * self.rate_hz)
        last = len(self) if np.isinf(to_s) else round(to_s * self.rate_hz)
        if not 0 <= first < last <= len(self):
            raise ValueError(
                f"A piece of {len(self) / self.rate_hz:g} s has no part from {from_s:g} to "
                f"{to_s:g} s."
            )
        return Piece(self.rate_hz, {n: v[first:last] for n, v in self.channels.items()})

    def every(self, stride: int) -> "Piece":
        """Return every `stride`-th sample, without a filter."""
        return Piece(self.rate_hz / stride, {n: v[::stride] for n, v in self.channels.items()})

    def centred(self) -> "Piece":
        """Return the piece without the mean of each channel."""
        return Piece(self.rate_hz, {n: v - v.mean() for n, v in self.channels.items()})

    def with_channel(self, name: str, values: Array) -> "Piece":
        """Return the piece with one channel more."""
        return Piece(self.rate_hz, {**self.channels, name: values})


@dataclasses.dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces to train on (`learn`), and held-out pieces (`judge`)."""

    learn: tuple[Piece, ...]
    judge: tuple[Piece, ...]

    def write(self, folder: Path) -> None:
        """Write one ``.npz`` file a piece, as `slowtime diagnose` reads it."""
        folder.mkdir(parents=True, exist_ok=True)
        for kind, pieces in ((LEARN, self.learn), (JUDGE, self.judge)):
            for number, piece in enumerate(pieces, 1):
                arrays = {name: np.asarray(v) for name, v in piece.channels.items()}
                path = folder / f"{kind}_{number}.npz"
                np.savez(path, rate_hz=np.array(piece.rate_hz), **arrays)  # type: ignore[arg-type]


def files_of(folder: Path, kind: str) -> list[Path]:
    """Return the files of the pieces that are learnt from, or held out, in order."""
    return sorted(folder.glob(f"{kind}_*.npz"), key=lambda p: int(p.stem.split("_")[1]))


def read_piece(path: Path) -> Piece:
    """Read a piece that was written."""
    with np.load(path) as arrays:
        channels = {n: np.asarray(arrays[n], float) for n in arrays.files if n != "rate_hz"}
        return Piece(float(arrays["rate_hz"]), channels)
