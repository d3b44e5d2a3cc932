"""Equations of the documentation as MathML: `$…$` and `$$…$$` are rendered when the pages are built, not by a script.

A hook of MkDocs, after `pymdownx.arithmatex` has found them.
"""

import html
import re
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>([,.;:)]*)', re.DOTALL)
LEFT_OVER = re.compile(r"\\|&amp;|<mi>&</mi>|<mo />")
"""What a command that is not known leaves in its place."""


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The page with its equations rendered."""

    def rendered(found: re.Match[str]) -> str:
        tag, latex = found[1], html.unescape(found[2]).strip()
        mathml = convert(latex, display="block" if tag == "div" else "inline")
        if LEFT_OVER.search(mathml):
            raise PluginError(f"{page.file.src_uri}: an equation is not rendered: {latex}")
        return f'<{tag} class="equation">{mathml}{found[3]}</{tag}>'

    return EQUATION.sub(rendered, content)
