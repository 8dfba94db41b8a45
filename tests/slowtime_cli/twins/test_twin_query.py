import click
import pytest

from slowtime_cli.twins.twin_query import server_errors_told
from slowtime_services.client import UnreachableError


def test_a_server_that_does_not_answer_is_reported_in_a_sentence():
    with pytest.raises(click.ClickException, match="Nobody answers"), server_errors_told():
        raise UnreachableError("Nobody answers.")
