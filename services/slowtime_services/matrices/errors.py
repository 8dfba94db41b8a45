"""The error of matrix files."""


class MatrixFileError(ValueError):
    """A file of matrices that cannot be used; the text says what to do."""
