"""The command `slowtime`: a composition root above the processes, one verb per job."""
