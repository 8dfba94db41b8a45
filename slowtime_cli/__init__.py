"""The command `slowtime`: a composition root above the processes, one verb per job."""

import os
from importlib import metadata

# Its matrices are small: more threads cost an edge six times the work, and sums that depend on
# how many there are would not replay bit for bit. Read by OpenBLAS when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def version() -> str:
    """Version of the installed distribution."""
    return metadata.version("slowtime")
