"""Write each JSON Schema once: `python -m slowtime_schemas.freeze [--replace]`.

A frozen version is never rewritten, since others read recordings by it; `--replace` is for
versions that no release has carried yet.
"""

import difflib
import json
import sys

from .files.registry import DOCUMENTS, EARLIER, Versioned
from .frozen import folder
from .streams import MESSAGES

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def generate(message: type[Versioned]) -> str:
    """Make the JSON Schema of a message as it is now."""
    schema = {"$schema": DIALECT, **message.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def drift(message: type[Versioned]) -> list[str]:
    """Compare a message with its frozen version; lines of a diff, none if they agree."""
    path = folder() / message.MESSAGE / f"v{message.VERSION}.json"
    frozen = path.read_text() if path.is_file() else ""
    return list(
        difflib.unified_diff(
            frozen.splitlines(), generate(message).splitlines(), "frozen", "now", lineterm=""
        )
    )


def main(arguments: list[str]) -> int:
    """Freeze what is new; refuse, with status 2, where a frozen version has drifted."""
    drifted = []
    everything: list[type[Versioned]] = [*MESSAGES.values(), *DOCUMENTS.values(), *EARLIER]
    for message in everything:
        path = folder() / message.MESSAGE / f"v{message.VERSION}.json"
        difference = drift(message)
        if difference and path.is_file() and "--replace" not in arguments:
            drifted.append("\n".join(difference))
        elif difference:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(generate(message))
            sys.stdout.write(f"{path} written\n")
    if drifted:
        sys.stderr.write(
            "\n".join(drifted) + "\nA frozen version has drifted. Raise VERSION and declare a "
            "migration; or --replace, if no release has carried it.\n"
        )
    return 2 if drifted else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
