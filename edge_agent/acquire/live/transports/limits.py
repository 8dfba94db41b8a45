"""Limits that transports share."""

POLL_S = 0.2
"""Time that data are waited for before `stop` is looked at [s]. Source: judgement, short for a
person who stops the agent; no study is recorded."""

AT_ONCE = 65_536
"""Bytes that are read at once, at most. Source: capacity of a pipe of Linux, pipe(7);
for other transports judgement, no study is recorded."""
