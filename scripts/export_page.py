"""Write the table of docs/export.md from that of the engines: ``python -m scripts.export_page``.

tests/test_export.py fails while the page is not what this script would write.
"""

from pathlib import Path

from csm.export import ENGINES

PAGE = Path(__file__).resolve().parents[1] / "docs" / "export.md"
BEGINS = "do not edit below this line.\n"


def page():
    """Text of the page: what stands there before the table, and the table."""
    before, mark, _ = PAGE.read_text().partition(BEGINS)
    parts = [before, mark]
    for name, engine in ENGINES.items():
        counts = ", ".join(map(str, engine.counts))
        parts.append(f'\n### "{name}": {engine.title}\n\nCascades: {counts}.\n\n')
        parts.append("| setting | unit | of ours |\n|---|---|---|\n")
        for row in engine.settings:
            ours = " ".join(f"`{one}`" for one in row.of) or "the sun"
            unit = row.unit
            if row.limits is not None:
                unit = f"{unit}{'; ' if unit else ''}held to {row.limits[0]:g} to {row.limits[1]:g}"
            parts.append(f"| [`{row.name}`]({row.page}) | {unit} | {ours} |\n")
        parts.append(f"\nWithout shadows: [`{engine.off.name}`]({engine.off.page}) alone.\n")
        parts.append("\n| of ours | what it does without a setting |\n|---|---|\n")
        for row in engine.fixed:
            parts.append(f"| `{row.of}` | {row.text} |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
