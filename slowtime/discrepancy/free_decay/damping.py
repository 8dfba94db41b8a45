"""Damping along the free decays of a campaign, before any model is fitted."""

from collections.abc import Iterator, Sequence

from slowtime.discrepancy.records import Trial
from slowtime.identification.free_decay.amplitude_law import decay_law
from slowtime.identification.free_decay.envelope import decay_envelope


def describe_damping(trials: Sequence[Trial]) -> Iterator[str]:
    """Tell of each free decay whether damping and frequency depend on amplitude."""
    for number, trial in enumerate(trials, start=1):
        complete = trial.used.all(axis=0)
        if not complete.any():
            continue
        try:
            law = decay_law(decay_envelope(trial.outputs[:, complete], trial.rate_hz))
        except ValueError:  # too few cycles above the noise
            continue
        at = f"{law.frequency_hz[len(law.frequency_hz) // 2]:.4g} Hz"
        yield f"Free decay {number}, mode at {at}: {law.sentence}"
