"""The verb `plugins`: lists installed parts, each imported in a process of its own."""

import subprocess
import sys

import click

from slowtime_services.plugins import discovery

CHECK = "import sys; from slowtime_services.plugins import find; find(*sys.argv[1:]).load()"


def plugins(timeout_s: float) -> int:
    """List installed parts; 1 where one of them cannot be loaded."""
    rows = [("group", "name", "distribution", "version", "state")]
    for one in discovery.plugins():
        state = _state(one, timeout_s)
        rows.append((one.group, one.name, one.distribution, one.version, state))
    if len(rows) == 1:
        click.echo(f"No parts are installed. Groups: {', '.join(discovery.GROUPS)}.")
        return 0
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        click.echo("  ".join(cells).rstrip())
    return int(any(row[-1] != "loaded" for row in rows[1:]))


def _state(plugin: discovery.Plugin, timeout_s: float) -> str:
    try:
        done = subprocess.run(
            [sys.executable, "-c", CHECK, plugin.group, plugin.name],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"not imported within {timeout_s:g} s"
    if done.returncode == 0:
        return "loaded"
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    last = lines[-1] if lines else f"exit status {done.returncode}"
    return last.removeprefix("slowtime_services.plugins.discovery.PluginError: ")
