"""Widths of Helvetica's characters: how much room a text takes, in PDF exactly, elsewhere by fitting it.

Source: Adobe, "Core 14 AFM", Helvetica.afm. Arial and Liberation Sans have the same widths.
"""

from __future__ import annotations

from functools import lru_cache

CAPITALS = 0.718
"""Height of capitals as a share of the font size."""
_BY_WIDTH = {
    191: "'",
    222: "ijl",
    260: "|",
    278: " !,./:;I[\\]ft",
    333: "()-`r²",
    334: "{}",
    355: '"',
    389: "*",
    400: "°",
    469: "^",
    500: "Jcksvxyz",
    556: "#$0123456789?L_abdeghnopqu–",
    584: "+<=>~±×",
    611: "FTZ",
    667: "&ABEKPSVXY",
    722: "CDHNRUw",
    778: "GOQ",
    833: "Mm",
    889: "%",
    944: "W",
    1015: "@",
}
_WIDTHS = {character: width / 1000 for width, characters in _BY_WIDTH.items() for character in characters}
_OTHER = 0.7
"""For what is not listed: a little more than most take."""


@lru_cache(maxsize=1024)
def _width(text: str) -> float:
    return sum(_WIDTHS.get(character, _OTHER) for character in text)


def text_width(text: str, capitals: float) -> float:
    """Width of a text whose capitals are ``capitals`` high, in the same unit."""
    return capitals / CAPITALS * _width(text)
