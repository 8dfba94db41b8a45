"""Exceptions of the store."""


class WrongStoreError(RuntimeError):
    """The file is no slowtime store, or of another version; the text says what to do."""


class StoreError(RuntimeError):
    """Nothing can be written, for instance because the disk is full; the text says why."""


class DamagedStoreError(WrongStoreError, StoreError):
    """Stored data are damaged; the text says what to do."""


class StoreInUseError(WrongStoreError):
    """Another twin server has the store; the text says what to do."""
