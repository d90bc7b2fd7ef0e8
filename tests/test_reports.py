"""The page of a sweep over techniques: whole in one file, and true to its dataset."""

import re

import numpy as np
import pytest

import csm
from csm.report_command import chosen_techniques
from csm.report_runs import crop_place
from csm.techniques import BASELINE, FAMILIES

xarray = pytest.importorskip("xarray", reason="reports are made of datasets (extra: sweep)")
pytest.importorskip("matplotlib", reason="reports draw (extra: plot)").use("Agg")

NAMES = [BASELINE, "pcf 3x3", "vsm 5x5", "a <name> of one's own"]


@pytest.fixture
def dataset():
    """Two cases, four techniques, of which the last failed in the second case."""
    error = np.array([[0.010, 0.004, 0.020, 0.030], [0.012, 0.005, 0.018, np.nan]])
    time = np.array([[10.0, 14.0, 30.0, 5.0], [12.0, 15.0, 33.0, np.nan]])
    place = ("case", "technique")
    return xarray.Dataset(
        {
            "error_total": (place, error),
            "error_too_dark": (place, error / 2),
            "disagreement": (place, error * 0.9),
            "ms_total": (place, time),
            "bytes_maps": (place, np.full((2, 4), 64.0 * 2**20)),
            "flicker": (place, error / 10),
            "message": (place, np.array([[""] * 4, ["", "", "", "it <broke>"]], object)),
            "crop": ((*place, "y", "x"), np.random.default_rng(1).random((2, 4, 6, 8))),
            "crop_truth": (("case", "y", "x"), np.ones((2, 6, 8))),
        },
        {"case": ["town & street", "hill"], "technique": NAMES},
        {"renderer": "a driver", "csm": "0.1.0"},
    )


def test_page_needs_no_other_file_and_says_what_the_dataset_says(dataset, tmp_path):
    page = csm.report(dataset, out=tmp_path)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=['\"](?!data:|#)", text), "something outside is referred to"
    assert "it &lt;broke&gt;" in text
    assert "a &lt;name&gt; of one&#x27;s own" in text
    assert "<name>" not in text
    for case in ("town &amp; street", "hill"):
        assert f">{case}</h2>" in text
    # half of hard's 1 % is pcf's 0.4 %, at 1.4 times the time
    row = re.search(r"<tr[^>]*><td>hard</td>.*?</tr>", text)[0]
    assert "1.000%" in row
    assert "pcf 3x3, 1.4 x the time" in row
    assert text.count("data:image/png") == len(list(tmp_path.glob("*.png"))) + 8  # errors too
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.glob("*.png"))


def test_order_of_dimensions_does_not_matter(dataset, tmp_path):
    one = csm.report(dataset, out=tmp_path / "one").read_text(encoding="utf-8")
    turned = dataset.transpose("technique", "case", ...)
    assert csm.report(turned, out=tmp_path / "two").read_text(encoding="utf-8") == one


@pytest.mark.parametrize("name", ["error_total", "ms_total", "bytes_maps"])
def test_a_dataset_that_lacks_something_is_refused_by_name(dataset, tmp_path, name):
    with pytest.raises(ValueError, match=name):
        csm.report(dataset.drop_vars(name), out=tmp_path)


def test_crop_holds_most_of_the_error():
    rng = np.random.default_rng(2)
    error, judged = rng.random((30, 40)), rng.random((30, 40)) < 0.8
    row, column = crop_place(error, judged, size=(7, 9))
    counted = np.where(judged, error + 1e-6, 0.0)
    sums = {
        (r, c): counted[r : r + 7, c : c + 9].sum() for r in range(30 - 7) for c in range(40 - 9)
    }
    assert sums[row, column] == pytest.approx(max(sums.values()))
    assert crop_place(error, judged, size=(100, 100))[0] == 0


def test_families_choose_techniques():
    assert set(chosen_techniques("soft")) == {
        BASELINE, "pcss", "pcss, vogel rotated", "pcss by variance", "pcss by summed areas",
    }  # fmt: skip
    assert len(chosen_techniques(None)) >= 60
    with pytest.raises(ValueError, match=rf"{FAMILIES[0]}.*'sofd'"):
        chosen_techniques("sofd")
