"""Rows of text as a table: for a terminal, and for Jupyter."""

import textwrap
from html import escape
from itertools import zip_longest

__all__ = ["table_html", "table_text"]


def table_text(heads, rows, most=()):
    """Lay rows of text out under heads, columns apart by two spaces.

    Parameters
    ----------
    heads : sequence of str
    rows : sequence of sequence of str
    most : sequence of (int or None), optional
        Characters of each column, beyond which its cells go on in the next line.

    Returns
    -------
    text : str
    """
    limits = [*most, *[None] * (len(heads) - len(most))]
    lines = [tuple(heads)]
    for row in rows:
        cells = [_wrapped(cell, limit) for cell, limit in zip(row, limits, strict=True)]
        lines += zip_longest(*cells, fillvalue="")
    widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _wrapped(cell, limit):
    """Lines of a cell; an empty one has a line, too."""
    if limit is None or len(cell) <= limit:
        return [cell]
    return textwrap.wrap(cell, limit, break_on_hyphens=False) or [""]


def table_html(heads, rows):
    """Lay rows of text out as an HTML table."""

    def line(cells, tag):
        return (
            "<tr>"
            + "".join(f'<{tag} style="text-align:left">{escape(c)}</{tag}>' for c in cells)
            + "</tr>"
        )

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(heads, 'th')}</thead><tbody>{body}</tbody></table>"
