"""The messages that travel, their streams and their versions."""
