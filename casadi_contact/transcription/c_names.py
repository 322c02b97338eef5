"""Text of files as it may stand in generated C: identifiers refused unless plain, comments made harmless."""

from __future__ import annotations

import re

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}")
_NOT_FOR_NAMES = re.compile(r"[^A-Za-z0-9]+")
_NOT_FOR_COMMENTS = re.compile(r"[^A-Za-z0-9 _.,;:()/+=<>-]")  # no * that could end one, no ?, \ or line break


def identifier(name: str) -> str:
    """The name, if C takes it for one; raises ValueError otherwise: it could be code."""
    if not _IDENTIFIER.fullmatch(name):
        raise ValueError(f"{name!r} cannot be a name in C, expected up to 100 ASCII letters, digits and underscores")
    return name


def c_name(text: str) -> str:
    """Words, or the name of a file, as a name in C and CasADi: letters, digits and single underscores.

    >>> c_name("my-knee.2 contact")
    'my_knee_2_contact'
    """
    return identifier(_NOT_FOR_NAMES.sub("_", text))


def comment_text(text: str) -> str:
    """The text in ASCII: x for ×, and _ for every character that could end a comment or hide its end.

    >>> comment_text("knee **" + "// exit(1);")
    'knee __// exit(1);'
    >>> comment_text("16 rays × 3 points")
    '16 rays x 3 points'
    """
    return _NOT_FOR_COMMENTS.sub("_", text.replace("×", "x"))
