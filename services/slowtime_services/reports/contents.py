"""What the details of a report are made of: tables, charts, scenes, and sections of them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any


@dataclasses.dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells below their headings.

    Parameters
    ----------
    names
        Headings of columns that hold names, which no language changes.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    names: Sequence[str] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Chart:
    """Traces and layout for plotly.js, and a description of the chart.

    Parameters
    ----------
    words
        Description, for those who do not see the chart as well.
    hint
        What can be done with the chart on a screen; paper leaves it out.
    caption
        Sentences of the description that stand below it; None for all of them.
    """

    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]
    words: str
    hint: str = ""
    caption: str | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Scene:
    """Mode shapes on a wireframe, as `slowtime_services.wireframes.scene_of` gives them."""

    scene: Mapping[str, Any]
    words: str


@dataclasses.dataclass(frozen=True, slots=True)
class PoleChoice:
    """A stabilisation diagram whose poles are clicked to choose modes.

    Its traces "mode" and "other pole" hold the poles.

    Parameters
    ----------
    ending, text
        Of the file of the choice, to which each click adds an edit; it is named after the page.
    """

    chart: Chart
    ending: str
    text: str


Item = Table | Chart | Scene | PoleChoice


@dataclasses.dataclass(frozen=True, slots=True)
class Section:
    """A heading, sentences, and the items below them.

    Parameters
    ----------
    translated
        Whether the texts are in the language of the page; else they are English, and the page
        translates what its catalogue has.
    """

    heading: str
    words: Sequence[str] = ()
    shown: Sequence[Item] = ()
    translated: bool = False
