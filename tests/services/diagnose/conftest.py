"""The slide that records are of."""

import pytest

from tests.services.diagnose.slide import SLIDE


@pytest.fixture(scope="session")
def slide():
    """What is believed of it."""
    return SLIDE
