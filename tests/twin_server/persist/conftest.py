"""Tests of the store are tests of both stores."""

import pytest

from twin_server.persist import open_store


@pytest.fixture
def store(database):
    """A store of its own, of each kind."""
    made = open_store(database())
    yield made
    made.close()
