"""Links of pages to files outside docs: to the repository, or copies beside the page.

The pages link to tests, schemas and configurations by relative paths, which work on GitHub. On
the site they lead to the repository where `SLOWTIME_URL` names it; without it, they become the
name of the path.
"""

import os
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(?<!\!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def resolve(app: Sphinx, name: str, content: list[str]) -> None:
    """Rewrite the links of one page that lead to files which are no pages."""
    folder = Path(app.env.doc2path(name)).parent
    pages = {Path(app.env.doc2path(one)) for one in app.env.found_docs}
    repository = os.environ.get("SLOWTIME_URL", "").rstrip("/")

    def rewritten(match: re.Match[str]) -> str:
        text, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target or target.startswith(("#", "mailto:")):
            return match[0]
        path = (folder / target).resolve()
        if path in pages:
            return match[0]
        if path.is_dir() and path / "README.md" in pages:
            return f"[{text}]({target.rstrip('/')}/README.md{anchor})"
        if not path.exists():
            logger.warning("link to %s, which does not exist", target, location=name)
            return match[0]
        inside = path.relative_to(ROOT).as_posix()
        if repository:
            kind = "tree" if path.is_dir() else "blob"
            return f"[{text}]({repository}/{kind}/main/{inside}{anchor})"
        return f"{text} (`{inside}`)" if inside not in text else text

    fenced = re.split(r"(^```.*?^```$|^~~~.*?^~~~$)", content[0], flags=re.M | re.S)
    content[0] = "".join(
        part if part.startswith(("```", "~~~")) else LINK.sub(rewritten, part)
        for part in fenced
    )


def setup(app: Sphinx) -> dict[str, Any]:
    """Rewrite each page as it is read."""
    app.connect("source-read", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
