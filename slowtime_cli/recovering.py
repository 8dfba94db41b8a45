"""The verb `recover`: a recording that breaks off in, a sound one out."""

from pathlib import Path

import click

from slowtime_services.record import Recovered
from slowtime_services.record import recover as recover_file

from .terminal import plural


def recover(damaged: Path, out: Path) -> None:
    """Make a recording sound again that was cut short or not closed."""
    click.echo(f"{out}: {_describe(recover_file(damaged, out))}")


def _describe(kept: Recovered) -> str:
    """Say what was kept, and what was not."""
    by_topic = ", ".join(f"{count} of {topic}" for topic, count in sorted(kept.counts.items()))
    said = plural(kept.messages, "message") + (f" ({by_topic})" if by_topic else "")
    if kept.was_sound:
        return f"{said}. The recording was sound; this is a copy."
    lost = []
    if kept.damaged_chunks:
        lost.append(f"{plural(kept.damaged_chunks, 'damaged chunk')} left out")
    if kept.unread_bytes:
        lost.append(f"{plural(kept.unread_bytes, 'byte')} at the end not readable")
    return f"{said}; {', '.join(lost) or 'only its index was missing'}."
