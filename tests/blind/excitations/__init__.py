"""The same rigs with the same effects, excited in every way that is usual in a laboratory."""
