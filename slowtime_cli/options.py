"""Flags that several verbs share."""

import click

ROUTER = "tcp/127.0.0.1:7447"

connect_option = click.option(
    "--connect",
    multiple=True,
    default=(ROUTER,),
    show_default=True,
    help="Endpoint of the router; may be given several times.",
)
