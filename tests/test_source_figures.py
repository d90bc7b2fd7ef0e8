"""The table of docs/numerics.md 25 is what scripts/source_figures.py finds."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "source_figures.py"
source_figures = SimpleNamespace(**runpy.run_path(str(SCRIPT)))
TEXT = source_figures.PAGE.read_text(encoding="utf-8")


def test_the_page_has_the_table_once():
    assert TEXT.count(source_figures.BEGIN) == TEXT.count(source_figures.END) == 1
    lines = TEXT.split(source_figures.BEGIN)[1].split(source_figures.END)[0].splitlines()
    assert len(lines) == 2 + len(source_figures.ROWS)


@pytest.mark.parametrize("row", source_figures.ROWS, ids=lambda row: row.__name__)
def test_a_figure_of_the_page_is_what_the_script_finds(row):
    assert source_figures.line(row) in TEXT, "python -m scripts.source_figures"


def test_utilisation_is_that_of_the_article():
    # [Sylvan]: 1/6 and 5/6, for a first slice about three times as far as near.
    before, selected, shifted = source_figures.sylvan_utilisation(3)
    assert before == pytest.approx(1 / 6, abs=0.02)
    assert shifted == pytest.approx(5 / 6, abs=0.03)
    assert selected - before > shifted - selected, "most of the gain is the selection"
