"""Write docs/effects.md from the effect table and from what `scripts.effect_costs` measured:
``python -m scripts.effects_page``.

tests/test_effects.py fails while the page is not what this script would write.
"""

import json
from dataclasses import fields
from itertools import groupby
from pathlib import Path
from statistics import median

import csm
from csm import _core

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, MEASURED = DOCS / "effects.md", DOCS / "effects_measured.json"

HEAD = """\
# Effects and numbers

Written by `python -m scripts.effects_page` from `csrc/csm_effects.def` and
`docs/effects_measured.json`; do not edit.

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

COSTS = """
## Cost and error of each value

Every value on one standard scene: {scene},
{width} x {height}, maps of {map_size}, all else at the defaults but for what stands under "with",
without which the value has no meaning. Compare values of one setting with each other.

- **time**: {clock}, over that of the first line rendered next to it
  (rounds: {rounds}; what takes ten times as long is measured once). Differences of a tenth are
  noise.
- **bytes**: maps, moments and what they are made from [MiB].
- **wrong**: sun-facing pixels on the wrong side of one half, against a point sun. **error**: mean
  absolute error of the mask, against the point and against the sun's disc of {sun_deg}° ({rays}
  rays).

By `python -m scripts.effect_costs`: csm {csm}, {driver}, OpenGL {version},
stage {stage}, {cores} cores. Errors are the same everywhere to a few pixels; times are this
driver's.

| setting | value | with | time | bytes | wrong [%] | error [%] | error, disc [%] |
|---|---|---|---|---|---|---|---|
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


def cost_line(setting, value, besides, measured):
    """One line of the table of costs; all arguments but the last are text."""
    mebi, wrong = measured["bytes"] / 2**20, 100 * measured["disagreement"]
    errors = (100 * measured["error"], 100 * measured["error_disc"])
    numbers = (
        f"{measured['time']:.2f} | {mebi:.1f} | {wrong:.2f} | {errors[0]:.2f} | {errors[1]:.2f}"
    )
    return f"| {setting} | {value} | {besides} | {numbers} |\n"


def costs(measured):
    """The table of costs. Whole numbers in a row that change no picture share a line."""

    def kind(row):
        same = (row["bytes"], row["error"], row["disagreement"], str(row["besides"]))
        number = type(row["value"]) is int
        return (row["setting"], *(same if number else (row["value"],)))

    width, height = measured["size"]
    lines = [COSTS.format(width=width, height=height, **measured)]
    base = {
        "time": 1.0,
        **{key: measured["base"][key] for key in measured["base"] if key != "time"},
    }
    lines.append(cost_line("defaults", f"{base['ms']:.0f} ms", "", base))
    for _, rows in groupby(measured["rows"], kind):
        alike = list(rows)
        first, last = alike[0], alike[-1]
        value = f"`{first['value']}`" + (f" to `{last['value']}`" if len(alike) > 1 else "")
        besides = " ".join(f"`{name}={given}`" for name, given in first["besides"].items())
        shown = {**first, "time": median(row["time"] for row in alike)}
        lines.append(cost_line(f"`{first['setting']}`", value, besides, shown))
    return "".join(lines)


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
    measured = json.loads(MEASURED.read_text(encoding="utf-8"))
    return HEAD + "".join(lines) + NUMBERS + "".join(numbers) + costs(measured)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
