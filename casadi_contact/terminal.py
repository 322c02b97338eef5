"""Text of files on the terminal: shown as it is, never obeyed."""

from __future__ import annotations

import unicodedata
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

_OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")  # controls, directions of writing, line breaks other than a new line


def printable(text: str) -> str:
    r"""The text with every character that a terminal would obey written out, as in \x1b; new lines stay."""
    return "".join(c if c == "\n" or unicodedata.category(c) not in _OBEYED else repr(c)[1:-1] for c in text)


class PlainConsole(Console):
    """A rich console that takes names and paths literally: no markup, no emoji codes, no escape sequences. Columns
    of tables are as wide as their longest words, on a narrow terminal and in a file too: rich would cut numbers off."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As rich's own."""
        for column in (column for table in objects if isinstance(table, Table) for column in table.columns):
            words = (column.header, *column.cells)
            column.min_width = max(Measurement.get(self, self.options, word).minimum for word in words)
            options["crop"] = False
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """The text with the style asked for, and none of its own."""
        return super().render_str(printable(text), **{**options, "markup": False, "emoji": False})
