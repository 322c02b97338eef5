"""A page of HTML that needs nothing but itself: no script, no style or picture from elsewhere."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

_STYLE = """\
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; margin: 0.5rem 0; } td, th { padding: 0.15rem 0.6rem; text-align: right; }
th { border-bottom: 1px solid #888; } td:first-child, th:first-child { text-align: left; }
tr:nth-child(even) td { background: #f4f4f4; } .high { color: #b03000; font-weight: bold; }
.verdict { font-size: 1.1rem; border-left: 4px solid #0072b2; padding: 0.3rem 0.8rem; background: #f0f6fa; }
.unfit { border-color: #d55e00; background: #fdf3ec; } img { max-width: 100%; }
"""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # a reader of the file loads nothing either


def page(title: str, parts: Sequence[str]) -> str:
    """The whole page of parts, each a piece of HTML."""
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph; kind: of the style sheet."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], high: Callable[[int, int], bool] | None = None) -> str:
    """A table; high: is the cell (row, column) one that stands out?"""

    def cell(i: int, j: int, text: str) -> str:
        return f'<td class="high">{escape(text)}</td>' if high and high(i, j) else f"<td>{escape(text)}</td>"

    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "\n".join(
        f"<tr>{''.join(cell(i, j, text) for j, text in enumerate(row))}</tr>" for i, row in enumerate(rows)
    )
    return f"<table>\n<tr>{head}</tr>\n{body}\n</table>"


def picture(draw: Callable[[Path], object], said: str) -> str:
    """A PNG inside the page; draw writes it to a path."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{escape(said)}" src="data:image/png;base64,{data}">'
