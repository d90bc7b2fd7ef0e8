"""The matrix of hard cases as a table of text and as a page."""

import base64
import html
import os
import tempfile

from .hard_cases import CASES, missing

__all__ = ["page", "table", "write_page"]


def table(rows):
    """The matrix as text.

    Parameters
    ----------
    rows : list of Row

    Returns
    -------
    text : str
    """
    lines = [("", "case", "what", "worst", "tolerance", "unit", "cases", "back end")]
    for row in rows:
        mark = "ok" if row.passed else "FAIL"
        worst, tolerance = f"{row.worst:.3g}", f"{row.tolerance:.3g}"
        lines.append(
            (mark, row.case, row.what, worst, tolerance, row.unit, str(row.cases), row.backend)
        )
    lines += [("FAIL", case, "no test ran", "", "", "", "0", "") for case in missing(rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    to_right = {3, 4, 6}
    text = "\n".join(
        "  ".join(
            word.rjust(width) if i in to_right else word.ljust(width)
            for i, (word, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )
    failed = sum(not row.passed for row in rows) + len(missing(rows))
    return f"{text}\n\n{len(rows)} rows, {failed} failed"


STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; color: #222; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; padding: 2px 8px; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.ok { color: #1a7f37; } td.fail { color: #fff; background: #c62828; }
.bar { background: #eee; width: 90px; height: 9px; } .bar i { display: block; height: 9px; }
section { margin-top: 2rem; } figure { display: inline-block; margin: 0 1rem 1rem 0; }
figure img { image-rendering: pixelated; border: 1px solid #ccc; min-width: 240px;
  max-width: 34rem; }
figcaption { font-size: 12px; max-width: 34rem; color: #555; overflow-wrap: anywhere; }
"""


def page(rows, drivers, *, version, slow):
    """The matrix and its pictures as one HTML page that needs no other file.

    Parameters
    ----------
    rows : list of Row
    drivers : dict of str to str
        Who drew, by back end.
    version : str
        Of csm.
    slow : bool
        Whether the full ranges ran.

    Returns
    -------
    text : str
    """
    escape = html.escape
    failed = sum(not row.passed for row in rows) + len(missing(rows))
    scope = "full ranges of the parameters" if slow else "a sample of the parameters"
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>csm: hard cases</title>",
        f"<style>{STYLE}</style><h1>Hard cases</h1>",
        f"<p>csm {escape(version)}, {scope}: {len(rows)} rows, ",
        f"<b>{'all passed' if not failed else f'{failed} failed'}</b>.</p><ul>",
        *(f"<li>{escape(name)}: {escape(driver)}</li>" for name, driver in drivers.items()),
        "</ul><p>Each row shows the figure that comes nearest to its tolerance, or exceeds it; "
        "the bar is the share of the tolerance it uses up.</p>",
        "<table><tr><th></th><th>case</th><th>what</th><th>worst</th><th>tolerance</th>"
        "<th></th><th>unit</th><th>cases</th><th>back end</th></tr>",
        *map(_html_row, rows),
        *(
            f"<tr><td class='fail'>FAIL</td><td>{case}</td><td colspan='7'>no test ran</td></tr>"
            for case in missing(rows)
        ),
        "</table>",
    ]
    for case, title in CASES.items():
        shown = [row for row in rows if row.case == case and row.picture is not None]
        if shown:
            parts.append(f"<section id='{case}'><h2>{case}: {escape(title)}</h2>")
            parts += map(_html_picture, shown)
            parts.append("</section>")
    return "".join(parts) + "</html>\n"


def _html_row(row):
    share = min(row.used, 1.0)
    colour = "#1a7f37" if row.passed else "#c62828"
    bar = f"<div class='bar'><i style='width:{90 * share:.0f}px;background:{colour}'></i></div>"
    link = f"<a href='#{row.case}'>{row.case}</a>" if row.picture else row.case
    mark = ("ok", "ok") if row.passed else ("fail", "FAIL")
    return (
        f"<tr><td class='{mark[0]}'>{mark[1]}</td><td title='{CASES[row.case]}'>{link}</td>"
        f"<td title='{html.escape(row.test, quote=True)}'>{html.escape(row.what)}</td>"
        f"<td class='number'>{row.worst:.3g}</td><td class='number'>{row.tolerance:.3g}</td>"
        f"<td>{bar}</td><td>{html.escape(row.unit)}</td><td class='number'>{row.cases}</td>"
        f"<td>{row.backend}</td></tr>"
    )


def _html_picture(row):
    data = base64.b64encode(row.picture.read_bytes()).decode("ascii")
    caption = f"{row.what}: {row.worst:.3g} of {row.tolerance:.3g} {row.unit}, back end "
    return (
        f"<figure><img src='data:image/png;base64,{data}' alt=''><figcaption>"
        f"{html.escape(caption + row.backend)}<br><small>{html.escape(row.test)}</small>"
        "</figcaption></figure>"
    )


def write_page(folder, text):
    """Write the page; a reader never sees half of one.

    Parameters
    ----------
    folder : Path
    text : str

    Returns
    -------
    path : Path
        ``folder/hard_cases.html``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(
        "w", dir=folder, suffix=".html", delete=False, encoding="utf-8"
    ) as file:
        file.write(text)
    path = folder / "hard_cases.html"
    os.chmod(file.name, 0o644)
    os.replace(file.name, path)
    return path
