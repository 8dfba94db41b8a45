"""The tables of the store: how each is written, read and checked."""
