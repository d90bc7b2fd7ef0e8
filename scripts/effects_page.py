"""Write docs/effects.md from the effect table: ``python -m scripts.effects_page``.

tests/test_effects.py fails while the page is not what this script would write.
"""

from dataclasses import fields
from pathlib import Path

import csm
from csm import _core

PAGE = Path(__file__).resolve().parents[1] / "docs" / "effects.md"

HEAD = """\
# Effects and numbers

Written by `python -m scripts.effects_page` from `csrc/csm_effects.def`; do not edit.

`csm.ShadowSettings` holds two kinds of settings. An **effect** changes which code, passes or
textures exist: it is a `#define` of the passes named here, and of no other, so changing it compiles
those passes once (`shadow_points` and `shadow_forward`
compile as `shadow_mask` does). A **number** feeds a uniform or
the CPU: changing it compiles nothing.

## Effects

| setting | values (default first) | compiles | what it is |
|---|---|---|---|
"""

NUMBERS = """
## Numbers

| setting | default | range | what it is |
|---|---|---|---|
"""

# Bits of the table's `passes`.
PASSES = {
    "shadow_map": 1, "view": 2, "shadow_mask": 4, "shadow_forward": 16, "receivers": 32,
    "shadow_moments": 64, "shadow_blur": 128, "shadow_sum": 256,
}  # fmt: skip


def title_of(row):
    """A setting's name as code; a derived effect, which nobody sets, in words."""
    return f"`{row['name']}`" if row["name"] else row["id"].lower().replace("_", " ")


def values_of(row):
    """The values of a row of the table as text, the default first."""
    if row["type"] == "enum":
        names = row["choices"].split()
        names.remove(row["default"])
        return " ".join(f"`{name}`" for name in (row["default"], *names))
    if row["type"] == "bool":
        return " ".join(f"`{value}`" for value in (row["default"], not row["default"]))
    return f"`{row['default']}`, {row['min']} to {row['max']}"


def passes_of(row):
    """Names of the passes that a row's effect is compiled into."""
    seen = [name for name, bit in PASSES.items() if row["passes"] & bit]
    return ", ".join(seen) or "nothing"


def page():
    """The text of docs/effects.md."""
    table = _core.effect_table()
    lines = [
        f"| {title_of(row)} | {values_of(row)} | {passes_of(row)} | {row['help']} |\n"
        for row in table
    ]
    numbers = [
        f"| `{row['name']}` | `{row['default']:g}` | {row['min']:g} to {row['max']:g} | "
        f"{row['help'].replace('|', chr(92) + '|')} |\n"
        for row in _core.number_table()
    ]
    known = {row["name"] for row in (*table, *_core.number_table())}
    settings = csm.ShadowSettings()
    numbers += [
        f"| `{field.name}` | `{getattr(settings, field.name)}` | | |\n"
        for field in fields(settings)
        if field.name not in known
    ]
    return HEAD + "".join(lines) + NUMBERS + "".join(numbers)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
