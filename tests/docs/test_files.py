"""The table of formats says what the registry says."""

from pathlib import Path

from slowtime_services.files.readers import READERS

TEXT = (Path(__file__).parents[2] / "docs/files.md").read_text()


def test_every_format_stands_in_the_table_with_its_library():
    rows = [line.strip("| ").split(" | ") for line in TEXT.splitlines() if line.startswith("|")]
    said = {row[0].casefold(): row[1:] for row in rows if len(row) == 4}
    for one in READERS:
        endings, library, gives = said[one.name.partition(" ")[2].casefold()]
        assert endings == ", ".join(f"`{ending}`" for ending in one.suffixes)
        assert library == (one.library or "—")
        assert gives == one.gives
