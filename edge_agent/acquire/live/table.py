"""Writes the tables of docs/live.md from the registry of schemes and the counters."""

import re
import sys
from pathlib import Path

from .counts import COUNTERS
from .registry import SCHEMES


def schemes() -> str:
    """Make the table of schemes."""
    rows = [
        "| scheme | reads | packets | parameters | needs | example |",
        "|---|---|---|---|---|---|",
    ]
    for one in SCHEMES.values():
        parameters = "; ".join(f"`{name}`: {says}" for name, says in one.parameters.items())
        needs = f"{one.library}: `slowtime[{one.extra}]`" if one.library else "—"
        rows.append(
            f"| `{one.name}` | {one.says} | {one.packets} | {parameters or '—'} | {needs} | "
            f"`{one.example}` |"
        )
    return "\n".join(rows)


def counters() -> str:
    """Make the table of counters."""
    rows = ["| counter | what it says |", "|---|---|"]
    return "\n".join([*rows, *(f"| `{name}` | {says} |" for name, says in COUNTERS.items())])


def filled(text: str) -> str:
    """Replace both tables in the text of a page."""
    for place, table in (("table", schemes()), ("counters", counters())):
        pattern = rf"(<!-- {place} -->\n).*?(<!-- end -->)"
        text = re.sub(pattern, lambda m, t=table: f"{m[1]}\n{t}\n\n{m[2]}", text, flags=re.S)  # type: ignore[misc]
    return text


def main(arguments: list[str]) -> int:
    """Print the tables, or write them into a page: `--write docs/live.md`."""
    if len(arguments) == 2 and arguments[0] == "--write":
        path = Path(arguments[1])
        path.write_text(filled(path.read_text()))
        return 0
    sys.stdout.write(f"{schemes()}\n\n{counters()}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
