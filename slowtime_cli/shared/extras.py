"""Extras of the distribution that bring a missing library."""

import importlib.util
from collections.abc import Mapping

LIBRARIES: Mapping[str, tuple[str, ...]] = {
    "anyio": ("twin",),
    "fastapi": ("twin",),
    "h5py": ("hdf5", "formats"),
    "mcap": ("analysis", "twin"),
    "numba": ("analysis", "twin"),
    "plotly": ("analysis", "twin"),
    "pythonfmu": ("fmu",),
    "ray": ("ray",),
    "rich": ("analysis", "twin"),
    "starlette": ("twin",),
    "uvicorn": ("twin",),
    "yaml": ("analysis", "twin"),
}
"""Name to import → extras of slowtime that bring it; the first is named where none is asked."""


def missing_extra(verb: str, extra: str | None, error: ModuleNotFoundError) -> str | None:
    """Return which extra a verb needs; None if the missing module belongs to none.

    Parameters
    ----------
    verb
        As it was typed, such as `slowtime twin`.
    extra
        What the verb needs as a whole, if anything.

    Examples
    --------
    >>> said = missing_extra("slowtime twin", "twin", ModuleNotFoundError(name="mcap.writer"))
    >>> "slowtime[twin]" in (said or ""), "mcap is missing" in (said or "")
    (True, True)
    >>> missing_extra("slowtime twin", "twin", ModuleNotFoundError(name="antigravity")) is None
    True
    """
    library = (error.name or "").partition(".")[0]
    if library not in LIBRARIES:
        return None
    holding = LIBRARIES[library]
    named = extra if extra in holding else holding[0]
    return (
        f"`{verb}` needs the parts that `pip install 'slowtime[{named}]'` installs: "
        f"{library} is missing."
    )


def require(*libraries: str) -> None:
    """Check for libraries that only a process of its own will import.

    Raises
    ------
    ModuleNotFoundError
        Naming the first that is not installed.
    """
    for library in libraries:
        if importlib.util.find_spec(library) is None:
            raise ModuleNotFoundError(f"No module named {library!r}", name=library)
