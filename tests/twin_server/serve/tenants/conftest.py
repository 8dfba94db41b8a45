"""One house for what is quick: two sites, each with a twin."""

import pytest

from .house import House


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A server with the tokens of two sites, and a twin of each."""
    with House(tmp_path_factory.mktemp("house")) as made:
        for site in ("lab", "plant"):
            assert made.ask(site, "operator", "PUT", f"/twins/{site}.beam", json={})
        yield made
