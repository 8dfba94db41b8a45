"""Effects of the library fitted along a motion and a force that were recovered at a place."""
