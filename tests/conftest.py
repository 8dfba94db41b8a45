"""Where the measurements and reference tables are, on a machine that has them."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The default suite takes the same examples each time; `make test-slow` looks for new ones.
settings.register_profile("seeded", derandomize=True)
settings.load_profile("seeded")

ROOT = Path(__file__).parents[1]


def _folder() -> Path:
    return Path(os.environ.get("SLOWTIME_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of the real measurements."""
    if not _folder().is_dir():
        pytest.skip(f"no measurements in {_folder()}; set SLOWTIME_DATA to where they are")
    return _folder()


@pytest.fixture(scope="session")
def tables() -> Path:
    """Folder of the reference tables of the book's mathematics."""
    folder = _folder().parent / "maths"
    if not folder.is_dir():
        pytest.skip(f"no reference tables in {folder}; set SLOWTIME_DATA to its neighbour")
    return folder
