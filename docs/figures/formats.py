"""Write the table of formats in docs/files.md, as the registry has them."""

from collections.abc import Iterator
from pathlib import Path

from slowtime_services.files.binary import workbook
from slowtime_services.files.formats import FORMATS
from slowtime_services.files.readers import READERS

PAGE = Path(__file__).parents[1] / "files.md"
BEGIN, END = "<!-- formats: begin -->", "<!-- formats: end -->"


def table() -> str:
    """Make the table, a row a format: endings, the library that reads it, what is read."""
    rows = [("format", "endings", "library", "what is read"), ("---",) * 4, *_rows()]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _rows() -> Iterator[tuple[str, ...]]:
    for text in FORMATS:
        yield _titled(text.name), _listed(text.suffixes), "—", text.gives
    for one in READERS:
        yield _titled(one.name), _listed(one.suffixes), one.library or "—", one.gives
    gives = "the fullest sheet, as a table of text"
    yield "Excel workbook", _listed(workbook.SUFFIXES), "openpyxl", gives


def _titled(name: str) -> str:
    """Take the article from a name, and give it a capital."""
    bare = name.partition(" ")[2]
    return bare[:1].upper() + bare[1:]


def _listed(endings: tuple[str, ...]) -> str:
    return ", ".join(f"`{ending}`" for ending in endings)


def renewed(page: str) -> str:
    """Put the table of today into a page."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{table()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text()))
