"""Modes measured with several sensor set-ups."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.identification.automatic.set_ups import JointModes, merge_records
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.merging import MergedMode, SetUp
from slowtime.identification.mode_shapes.merging import merge as merge_modes
from slowtime.identification.modes import Mode
from slowtime.identification.subspace.setup_merging import SetUpRecord
from slowtime.signals.decimation import PASS, decimated
from slowtime_api.arguments import existing_file
from slowtime_api.modal_estimates import Modes
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_schemas.files.modes import FoundMode, ModesFile
from slowtime_services.argument_checks import checked
from slowtime_services.documents.bounds import RESULT, DocumentError
from slowtime_services.documents.document_files import read_checked_json
from slowtime_services.files import Record, bridged

FEWEST_LAGS, MOST_LAGS = 20, 60
"""Lags in a block row [samples]: a period of the lowest frequency of the band, within bounds
that keep a run to a minute."""

HIGHEST_ORDER = 30
"""Highest model order: two for each mode, and as many again for noise [1]."""

RATES_ALIKE = 1e-4
"""Relative difference of two sampling rates [1] that is rounding, or that of a crystal from
day to day. Source: stated tolerance of crystals, 100 ppm, by which frequencies are wrong."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MergedModes(Result):
    """Modes of a structure over the channels of all set-ups.

    Parameters
    ----------
    modes
        Modes that all set-ups show, ascending in frequency, with shapes over `channels`.
    partial
        Modes that a part of the set-ups shows, over the channels of these.
    channels
        Channels of all set-ups, references first.
    setups
        Number of set-ups.
    notes
        What was assumed, and why modes are partial.
    heading_of_file
        What a modes file says of the records: name, rate [Hz], duration [s].
    """

    modes: tuple[Mode, ...]
    partial: tuple[MergedMode, ...]
    channels: tuple[str, ...]
    setups: int
    notes: tuple[str, ...]
    heading_of_file: dict[str, Any]

    def __len__(self) -> int:
        return len(self.modes)

    @property
    def heading(self) -> str:
        """What was merged, in a line."""
        return f"{len(self)} modes of {self.setups} set-ups over {len(self.channels)} channels"

    def table(self) -> list[tuple[Mode, int, int]]:
        """Return all modes, partial ones too, ascending in frequency.

        Returns
        -------
        Each mode with its number of set-ups and of channels.
        """
        rows = [(mode, self.setups, len(self.channels)) for mode in self.modes]
        rows += [(one.mode, len(one.setups), len(one.channels)) for one in self.partial]
        return sorted(rows, key=lambda row: row[0].frequency_hz.value)

    def rows(self) -> list[dict[str, Any]]:
        """Return each mode, partial ones too.

        Returns
        -------
        One dictionary per mode: ``frequency_hz`` and ``frequency_sd`` [Hz], ``damping_ratio``
        and ``damping_sd`` [1] (None where not known), ``setups``, ``channels`` and ``flags``.
        """
        rows = []
        for mode, setups, channels in self.table():
            f, z = mode.frequency_hz, mode.damping_ratio
            damped = math.isfinite(z.value)
            rows.append(
                {
                    "frequency_hz": f.value, "frequency_sd": f.sd,
                    "damping_ratio": z.value if damped else None,
                    "damping_sd": z.sd if damped else None,
                    "setups": setups, "channels": channels, "flags": ", ".join(mode.flags),
                }
            )  # fmt: skip
        return rows

    def file(self) -> ModesFile:
        """Return the complete modes as content of a modes file.

        Returns
        -------
        Model of a modes file, as `slowtime.update` reads it.
        """
        return ModesFile.model_validate(self.document())

    def document(self) -> dict[str, Any]:
        """Return the complete modes as plain values.

        Returns
        -------
        What a modes file holds.
        """
        span = (0.0, self.heading_of_file["duration_s"])
        return self.heading_of_file | {"modes": [_entry(mode, span) for mode in self.modes]}

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the shapes of the complete modes over all channels.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        for mode in self.modes:
            label = f"{mode.frequency_hz.value:.4g} Hz"
            axes.errorbar(
                range(len(self.channels)), mode.shape.real, yerr=mode.shape_sd, marker="o",
                capsize=2, label=label,
            )  # fmt: skip
        axes.set_xticks(range(len(self.channels)), self.channels)
        axes.set(xlabel="channel", ylabel="mode shape, real part (unit norm)")
        axes.legend()
        return save(axes, path)


@checked
def merge(
    modes: Sequence[Modes | str | Path], *, references: Sequence[str] | None = None
) -> MergedModes:
    """Merge the modes of several sensor set-ups with common reference channels.

    Parameters
    ----------
    modes
        Modes with shapes, or paths of modes files, one for each set-up. A channel has the same
        name in two set-ups only if it is at the same place and direction.
    references
        Channels that stayed in place; those that all set-ups have where not given.

    Returns
    -------
    Modes over all channels.

    Raises
    ------
    ValueError
        If set-ups share no reference channel, no mode is common, or modes have no shapes.

    References
    ----------
    .. [1] M. Doehler, X.-B. Lam and L. Mevel, "Uncertainty quantification for modal parameters
       from stochastic subspace identification on multi-setup measurements", Mechanical Systems
       and Signal Processing 36 (2013) 562-581.
    """
    read = [
        _with_shapes(one.file(), f"modes[{i}]") if isinstance(one, Modes) else modes_file(one)
        for i, one in enumerate(modes)
    ]
    setups = [SetUp(modes=modes_in(one), channels=tuple(one.channels)) for one in read]
    found = merge_modes(setups, None if references is None else tuple(references))
    if not found:
        raise ValueError(
            "The set-ups have no structural mode in common. Check the modes file of each "
            "set-up."
        )
    channels = max((mode.channels for mode in found), key=len)
    heading = {
        "slowtime_modes": 1,
        "record": " + ".join(one.record for one in read)[:200],
        "rate_hz": min(one.rate_hz for one in read),
        "channels": list(channels),
        "duration_s": max(one.duration_s for one in read),
    }
    partial = tuple(mode for mode in found if mode.channels != channels)
    return MergedModes(
        modes=tuple(mode.mode for mode in found if mode.channels == channels),
        partial=partial, channels=channels, setups=len(read), heading_of_file=heading,
        notes=tuple(
            f"{mode.mode.frequency_hz.value:.4g} Hz was found in {len(mode.setups)} of "
            f"{len(read)} set-ups, and is left out of the file."
            for mode in partial
        ),
    )  # fmt: skip


@checked
def merge_signals(
    signals: Sequence[Signals],
    band_hz: tuple[float, float],
    *,
    references: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
) -> MergedModes:
    """Identify modes from the records of all sensor set-ups at once (PreGER).

    Parameters
    ----------
    signals
        Records of one rate, one for each set-up.
    band_hz
        Lowest and highest frequency of the modes [Hz].
    references
        Channels that stayed in place; those that all records have where not given.
    names
        Names of the records, for messages and files.

    Returns
    -------
    Modes over all channels.

    Raises
    ------
    ValueError
        If rates differ, the band does not fit them, set-ups share no reference channel, or no
        mode stands out from the noise.

    References
    ----------
    .. [1] M. Doehler and L. Mevel, "Modular subspace-based system identification from
       multi-setup measurements", IEEE Transactions on Automatic Control 57 (2012) 2951-2956.
    """
    if not signals:
        raise ValueError("signals=[] was given. Give the records of at least two set-ups.")
    told = [f"record {i + 1}" for i in range(len(signals))] if names is None else list(names)
    bridges = [bridged(one.record) for one in signals]
    read = [record for record, _ in bridges]
    for name, record in zip(told, read, strict=True):
        if record.gaps:
            raise ValueError(
                f"{name} has {len(record.gaps)} gaps that are too long to be filled. Cut the "
                "record there."
            )
    rate = _common_rate(read, band_hz)
    found = _joint_modes(read, rate, band_hz, references)
    if not found.modes:
        raise ValueError(
            "No mode stands out from the noise. Give longer records, or another --band-hz."
        )
    heading = {
        "slowtime_modes": 1,
        "record": " + ".join(told)[:200],
        "rate_hz": rate,
        "channels": list(found.channels),
        "duration_s": max(one.duration_s for one in read),
        "assumptions": list(found.notes),
    }
    notes = [said for _, said in bridges if said]
    notes += [f"not found in all records together: {text}" for text in found.notes]
    return MergedModes(
        modes=found.modes, partial=found.partial, channels=found.channels, setups=len(read),
        notes=tuple(notes), heading_of_file=heading,
    )  # fmt: skip


def _joint_modes(
    read: Sequence[Record],
    rate: float,
    band_hz: tuple[float, float],
    references: Sequence[str] | None,
) -> JointModes:
    """Identify all records at the rate that the band needs."""
    common = [name for name in read[0].channels if all(name in one.channels for one in read)]
    factor = max(1, math.floor(0.5 * PASS * rate / band_hz[1]))
    lower = rate / factor
    return merge_records(
        [_setup(one, factor) for one in read],
        lower,
        tuple(common if references is None else references),
        block_rows=min(max(round(lower / band_hz[0]), FEWEST_LAGS), MOST_LAGS),
        orders=range(2, HIGHEST_ORDER + 1),
        band_hz=band_hz,
    )


def _common_rate(read: Sequence[Record], band_hz: tuple[float, float]) -> float:
    """Return the sampling rate of all records [Hz]; refuse other rates and bands above it."""
    rate = read[0].rate_hz
    other = next((one for one in read if abs(one.rate_hz / rate - 1) > RATES_ALIKE), None)
    if other is not None or not 0 < band_hz[0] < band_hz[1] < 0.5 * rate:
        rates = ", ".join(f"{one.rate_hz:g}" for one in read)
        raise ValueError(
            f"Records of {rates} Hz and a band of {band_hz[0]:g} to {band_hz[1]:g} Hz were "
            "given. Merging before identification needs one rate and a band below half of it."
        )
    return rate


def _setup(record: Record, factor: int) -> SetUpRecord:
    samples = np.asarray(record.samples, dtype=float)
    if factor > 1:
        samples = decimated(samples, record.rate_hz, factor).samples
    return SetUpRecord(samples=samples - samples.mean(axis=0), channels=tuple(record.channels))


def modes_file(path: str | Path) -> ModesFile:
    """Read a modes file of a whole record with shapes.

    Raises
    ------
    ValueError
        Where it is another file, or has no shapes.
    """
    path = existing_file(path)
    try:
        found = read_checked_json(path, ModesFile, RESULT)
    except DocumentError as error:
        raise ValueError(
            f"{path.name} is not a valid modes file ({error!s:.400}). Give what `slowtime "
            "identify RECORD --method modes --out modes.json` wrote."
        ) from None
    return _with_shapes(found, path.name)


def _with_shapes(found: ModesFile, name: str) -> ModesFile:
    """Refuse modes of windows, and modes without shapes."""
    if found.modes is None:
        raise ValueError(
            f"{name} holds modes for each window of a record. Give modes of whole records."
        )
    if all(mode.shape is None for mode in found.modes):
        raise ValueError(
            f"{name} holds no shapes. Identify with --method modes and several channels."
        )
    return found


def modes_in(found: ModesFile) -> list[Mode]:
    """Return the modes with shapes of a modes file."""
    return [_mode(mode) for mode in found.modes or () if mode.shape is not None]


def _mode(mode: FoundMode) -> Mode:
    assert mode.shape is not None
    return Mode(
        frequency_hz=Measured(mode.frequency_hz.value, mode.frequency_hz.sd),
        damping_ratio=Measured(mode.damping_ratio.value, mode.damping_ratio.sd),
        correlation=mode.correlation,
        shape=np.array(mode.shape.re) + 1j * np.array(mode.shape.im),
        shape_sd=np.array(mode.shape.sd),
        kind=mode.kind,
        quality=1.0 if mode.quality is None else mode.quality,
        flags=tuple(mode.flags),
    )


def _entry(mode: Mode, span: tuple[float, float]) -> dict[str, Any]:
    """Return a merged mode as a modes file holds it."""
    return {
        "frequency_hz": {"value": mode.frequency_hz.value, "sd": mode.frequency_hz.sd},
        "damping_ratio": {"value": mode.damping_ratio.value, "sd": mode.damping_ratio.sd},
        "correlation": mode.correlation,
        "shape": {
            "re": mode.shape.real.tolist(),
            "im": mode.shape.imag.tolist(),
            "sd": mode.shape_sd.tolist(),
        },
        "kind": mode.kind,
        "quality": mode.quality,
        "snr_db": None,
        "method": "merged",
        "span_s": list(span),
        "flags": list(mode.flags),
    }
