"""Colours and markers of model families, told apart by the colour-blind and in grey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casadi_contact.pictures.page import COLOURS

MARKERS = ("s", "o", "^", "D", "v", "P", "X", "*")
_FIRST = ("patch", "EF", "two_stage", "foundation")


@dataclass(frozen=True)
class Style:
    """How a family is drawn; hollow tells apart families beyond the eight colours."""

    colour: str
    marker: str
    hollow: bool = False

    @property
    def text_colour(self) -> str:
        """The colour darkened, so that light ones can be read as text."""
        return "#" + "".join(f"{int(0.6 * int(self.colour[i : i + 2], 16)):02x}" for i in (1, 3, 5))

    @property
    def keywords(self) -> dict[str, str | float]:
        """Keyword arguments of matplotlib's ``plot`` for the markers."""
        face = "white" if self.hollow else self.colour
        return {"color": self.colour, "marker": self.marker, "markerfacecolor": face, "markeredgewidth": 1.0}


def family_styles(families: Sequence[str]) -> dict[str, Style]:
    """A colour and a marker for each family: our own structures and the EF always the same ones."""
    colours = list(COLOURS.values())
    others = [family for family in dict.fromkeys(families) if family not in _FIRST]
    styles = {}
    for place, family in enumerate((*_FIRST, *others)):
        turn, index = divmod(place, len(colours))
        # A second turn through the colours is hollow and takes other markers, so no pair is used twice.
        colour, marker = colours[(index + 2 * turn) % len(colours)], MARKERS[(index + 3 * turn) % len(MARKERS)]
        styles[family] = Style(colour, marker, hollow=turn % 2 == 1)
    return {family: styles[family] for family in dict.fromkeys(families)}
