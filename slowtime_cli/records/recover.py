"""The verb `recover`: repairs a recording that was cut short or damaged."""

from pathlib import Path

import click

from slowtime_cli.shared.terminal import note, plural
from slowtime_services.record import Recovered
from slowtime_services.record import recover as recover_file


def recover(damaged: Path, out: Path) -> int:
    """Repair a recording; the exit status is 1 if no message was readable."""
    kept = recover_file(damaged, out)
    if kept.messages == 0:
        out.unlink(missing_ok=True)
        note(
            f"nothing was recovered: {damaged} holds no whole message "
            f"({_losses(kept) or 'it is empty'}); {out} is not written."
        )
        return 1
    click.echo(f"{out}: {_describe(kept)}")
    return 0


def _describe(kept: Recovered) -> str:
    """Describe what was kept and what was lost."""
    by_topic = ", ".join(f"{count} of {topic}" for topic, count in sorted(kept.counts.items()))
    said = plural(kept.messages, "message") + (f" ({by_topic})" if by_topic else "")
    if kept.was_sound:
        return f"{said}. The recording was sound; this is a copy."
    return f"{said}; {_losses(kept) or 'only its index was missing'}."


def _losses(kept: Recovered) -> str:
    lost = []
    if kept.damaged_chunks:
        lost.append(f"{plural(kept.damaged_chunks, 'damaged chunk')} left out")
    if kept.nameless:
        lost.append(f"{plural(kept.nameless, 'message')} of unknown channels left out")
    if kept.torn_chunks:
        lost.append(f"{plural(kept.torn_chunks, 'chunk')} cut short and kept as far as written")
    if kept.unread_bytes:
        lost.append(f"{plural(kept.unread_bytes, 'byte')} at the end not readable")
    return ", ".join(lost)
