"""Figures of speed, memory and accuracy, each a ratio to a peer or a limit of the same run."""
