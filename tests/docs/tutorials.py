"""What a tutorial tells to type, and how it is typed: to the letter, in an empty folder.

Lines of four blanks are commands for one shell; bodies of here-documents are no commands.
Networks of their own let every page have the ports that it names.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

TUTORIALS = Path(__file__).parents[2] / "docs/tutorials"
PAGES = sorted(page for page in TUTORIALS.glob("*.md") if page.stem != "README")
HERE_DOCUMENT = re.compile(r"<<'(\w+)'$")
APART = re.compile(r"&&|\|\||[|&;]")

_SHELL = """
ip link set lo up
set -euo pipefail
set -m
trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT
. ./.typed
"""


def script(page: Path) -> str:
    """Everything that is to be typed, as one file."""
    lines = re.findall(r"^ {4}(.*)$", page.read_text(), re.MULTILINE)
    return "\n".join(lines) + "\n"


def typed(page: Path) -> list[list[str]]:
    """Words of every command, without what a here-document holds."""
    found, ends = [], ""
    for line in script(page).splitlines():
        if ends:
            ends = "" if line == ends else ends
            continue
        begins = HERE_DOCUMENT.search(line)
        ends = begins[1] if begins else ""
        for part in _parts(HERE_DOCUMENT.sub("", line)):
            words = shlex.split(part, comments=True)
            if words:
                found.append(words)
    return found


def _parts(line: str) -> list[str]:
    """Commands of a line; what is quoted is left whole."""
    lexer = shlex.shlex(line, posix=False, punctuation_chars="();<>|&")
    lexer.whitespace_split, lexer.commenters = True, ""
    parts: list[list[str]] = [[]]
    skip = False
    for token in lexer:
        if APART.fullmatch(token):
            parts.append([])
        elif token in (">", ">>", "<"):
            skip = True
        elif token in ("(", ")"):
            continue
        elif not skip:
            parts[-1].append(token)
        else:
            skip = False
    return [" ".join(part) for part in parts]


def can_run() -> str:
    """Why nothing can be typed here; empty where it can."""
    missing = [tool for tool in ("unshare", "ip", "curl", "openssl") if not shutil.which(tool)]
    if missing:
        return f"{', '.join(missing)}: not here"
    tried = subprocess.run(
        ["unshare", "-rn", "ip", "link", "set", "lo", "up"], capture_output=True, check=False
    )
    return "" if tried.returncode == 0 else "no network of one's own may be made here"


def follow(page: Path, folder: Path) -> str:
    """Type a page in `folder`, with the files that it links to; all that was said.

    Raises
    ------
    AssertionError
        Where a line fails, with the end of what was said.
    """
    for link in re.findall(r"\]\((\w+\.(?:py|yaml))\)", page.read_text()):
        shutil.copy(TUTORIALS / link, folder)
    for link in re.findall(r"\]\((parts/\w+)\)", page.read_text()):
        shutil.copytree(TUTORIALS / link, folder / link)
    (folder / ".typed").write_text(script(page))
    place = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["unshare", "-rn", "bash", "-c", _SHELL],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        env=os.environ | {"PATH": place, "OPENBLAS_NUM_THREADS": "1"}, timeout=900,
    )  # fmt: skip
    assert done.returncode == 0, f"{page.stem} ended with {done.stdout[-3000:]}"
    return done.stdout
