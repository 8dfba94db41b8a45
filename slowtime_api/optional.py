"""Packages that only some functions need."""

import importlib
from types import ModuleType

INSTALL = {
    "matplotlib.pyplot": "plots",
    "pandas": "tables",
    "xarray": "tables",
    "mcap": "analysis",
    "numba": "analysis",
    "plotly": "analysis",
    "yaml": "analysis",
}
"""Extra of slowtime that installs a package."""


def optional(module: str) -> ModuleType:
    """Import a package that an extra installs.

    Parameters
    ----------
    module
        Name of the module.

    Returns
    -------
    The module.

    Raises
    ------
    ImportError
        If it is not installed; the message says what to install.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f"This needs {package}, which is not installed. Install it with: "
            f"pip install 'slowtime[{INSTALL[module]}]'"
        ) from error
