"""Hooks of MkDocs: formulas as MathML, and the live page of the knee.

LaTeX stands between two lines ``$$`` or, within a line of a page that has such lines, between two ``$``. GitHub shows
it too. Browsers draw MathML without a script, so that the site works offline.
"""

import re
from functools import cache
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from casadi_contact.pictures.joint_page import joint_page

PAGE = "how-to/knee.html"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its formulas as MathML."""
    if "\n$$\n" not in markdown:
        return markdown
    markdown = re.sub(r"^\$\$\n(.*?)\n\$\$$", lambda m: convert(m[1], display="block"), markdown, flags=re.S | re.M)
    return re.sub(r"\$([^$\n]+)\$", lambda m: f"<span>{convert(m[1])}</span>", markdown)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the knee's page to the site; ``how-to/joint-page.md`` links to it."""
    files.append(File.generated(config, PAGE, content=_knee()))
    return files


@cache
def _knee() -> str:
    return joint_page("knee")[0]
