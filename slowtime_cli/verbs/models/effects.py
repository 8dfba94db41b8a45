"""Arguments and help of the verb `effects`."""

import click

from slowtime_cli.shared.deferred import Deferred


@click.command(
    cls=Deferred,
    work="models.effects:effects",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime model effects
  slowtime model effects bouc_wen_general
  slowtime model effects --markdown > effects.md

In a model file, an effect stands under effects: with its place and parameters, such as
{effect: coulomb, element: k1, friction_n: 2.5}.
""",
)
@click.argument("names", nargs=-1, metavar="[EFFECT]...")
@click.option("--markdown", is_flag=True, help="Write the whole catalogue as Markdown.")
def effects(**_given: object) -> None:
    """List the physical effects that slowtime knows.

    They are the effects that a model may include, and that a diagnosis can find missing. With
    EFFECT names: equation, parameters with units and allowed ranges, literature reference, and
    the simpler laws that the effect includes as special cases.
    """
