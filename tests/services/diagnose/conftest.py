"""The slide that records are of."""

import pytest

from slowtime_services.diagnose import run
from tests.services.diagnose.slide import SLIDE


@pytest.fixture(autouse=True)
def _unhurried(request, monkeypatch):
    """Give all the time that a slow machine may need, but where that is what is tested."""
    if not request.path.stem.endswith("patience"):
        monkeypatch.setattr(run, "PATIENCE_S", 3600.0)


@pytest.fixture(scope="session")
def slide():
    """What is believed of it."""
    return SLIDE
