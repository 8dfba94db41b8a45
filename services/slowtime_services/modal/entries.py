"""Entries of a modes file."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.estimates import Measured


def mode_entry(
    frequency_hz: Measured,
    damping_ratio: Measured,
    correlation: float,
    *,
    kind: str,
    method: str,
    span_s: tuple[float, float],
    flags: Sequence[str],
    shape: tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]] | None = None,
    quality: float | None = None,
    snr_db: float | None = None,
) -> dict[str, Any]:
    """Return one mode as a modes file has it.

    Parameters
    ----------
    frequency_hz, damping_ratio, correlation
        Estimates with standard deviations, and the correlation of their errors. A damping
        ratio that is not finite was not sought: it is written as 0.
    kind
        ``"structural"`` or ``"harmonic"``.
    method
        Method of identification.
    span_s
        Part of the record that was used [s].
    flags
        Reasons to distrust the mode.
    shape
        Mode shape and its standard deviations; None where there is none.
    quality
        Share of model orders that show the mode [1]; None where it was not judged.
    snr_db
        Signal over noise [dB]; None where it was not found.

    Returns
    -------
    Entry of `slowtime_schemas.files.modes.ModesFile`.
    """
    damped = bool(np.isfinite(damping_ratio.value))
    ratio = damping_ratio if damped else Measured(0.0, 0.0)
    components = None
    if shape is not None:
        components = {
            "re": shape[0].real.tolist(),
            "im": shape[0].imag.tolist(),
            "sd": shape[1].tolist(),
        }
    return {
        "frequency_hz": {"value": frequency_hz.value, "sd": frequency_hz.sd},
        "damping_ratio": {"value": ratio.value, "sd": ratio.sd},
        "correlation": correlation if damped else 0.0,
        "shape": components,
        "kind": kind,
        "quality": quality,
        "snr_db": snr_db if snr_db is None or np.isfinite(snr_db) else None,
        "method": method,
        "span_s": list(span_s),
        "flags": list(flags),
    }
