"""Formulas as MathML: browsers draw it themselves, so a page needs neither script nor network."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

NORM = re.compile("<mo[^>]*>‖</mo>")
logger = logging.getLogger(__name__)


def _mathml(node: nodes.Element, *, block: bool) -> str:
    """A formula's MathML; one that cannot be converted is a warning that names it."""
    tex = node.astext()
    try:
        made = str(tex2mathml(tex, as_block=block))
    except MathError as error:
        logger.warning("formula %r: %s", tex, error, location=node)
        return ""
    # The left bar of a norm would grow with what follows it, and the right one would not.
    return NORM.sub('<mo stretchy="false">‖</mo>', made)


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    """Write a formula in a line."""
    self.body.append(_mathml(node, block=False))
    raise nodes.SkipNode


def visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula that stands alone."""
    self.body.append(f'<div class="math-block">{_mathml(node, block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(visit_inline, None), block_renderers=(visit_block, None)
    )
    return {"parallel_read_safe": True, "parallel_write_safe": True}
