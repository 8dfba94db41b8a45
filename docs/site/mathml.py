"""Equations of the site as MathML, which browsers draw without scripts or a network."""

import html
import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
NAME = "slowtime-mathml"
SIZE = re.compile(r"\\[bB]ig{1,2}[lrm]?(?![A-Za-z])")
"""Sizes of brackets, which MathML chooses by their content."""


def mathml(node: nodes.Element, *, as_block: bool) -> str:
    """Return an equation as MathML; warn where it cannot be read, and show its source."""
    text = SIZE.sub("", node.astext())
    try:
        return str(tex2mathml(text, as_block=as_block))
    except MathError as error:
        logger.warning("equation %r: %s", text, error, location=node)
        return f"<code>{html.escape(text)}</code>"


def inline(writer: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    writer.body.append(mathml(node, as_block=False))
    raise nodes.SkipNode


def block(writer: Any, node: nodes.math_block) -> None:
    """Write an equation on a line of its own."""
    writer.body.append(writer.starttag(node, "div", CLASS="math"))
    writer.body.append(mathml(node, as_block=True))
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer; `html_math_renderer` of the configuration names it."""
    app.add_html_math_renderer(NAME, (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
