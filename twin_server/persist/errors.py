"""Exceptions of the store."""


class WrongStoreError(RuntimeError):
    """The file is no store of ours, or of another version; the text says what to do."""


class StoreError(RuntimeError):
    """Nothing can be written now, as with a full disk; the text says what is wrong."""


class DamagedStoreError(WrongStoreError, StoreError):
    """Stored data are damaged; the text says what to do."""
