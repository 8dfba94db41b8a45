"""The command `slowtime`: a composition root above the processes, one verb per job."""

from importlib import metadata


def version() -> str:
    """Version of the installed distribution."""
    return metadata.version("slowtime")
