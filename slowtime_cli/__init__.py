"""The command `slowtime`: a composition root above the processes, one verb per job."""

import os

# Its matrices are small: more threads cost an edge six times the work, and sums that depend on
# how many there are would not replay bit for bit. Read by OpenBLAS when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
