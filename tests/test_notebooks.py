"""Notebooks: they run from top to bottom, leave nothing, and say what the numbers say."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="notebooks draw (extra: notebooks)").use("Agg")
pytest.importorskip("embreex", reason="notebooks compare with csm.truth (extra: notebooks)")
plt = pytest.importorskip("matplotlib.pyplot")

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Function from a notebook's name to its variables and figures; each runs once."""
    kept = {}

    def run(name):
        if name not in kept:
            plt.close("all")
            folder = tmp_path_factory.mktemp("notebook")
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                # Shown is what a reader sees; closing is left to the fixture.
                patch.setattr(plt, "show", lambda: None)
                variables = runpy.run_path(str(FOLDER / name))
            kept[name] = variables, [plt.figure(n) for n in plt.get_fignums()]
            assert not list(folder.iterdir()), "a notebook saves nothing unless asked"
        return kept[name]

    yield run
    plt.close("all")


def test_there_are_notebooks():
    assert {path.name for path in NOTEBOOKS} >= {
        "02_splits.py",
        "03_fit_and_snap.py",
        "04_bias.py",
        "05_filters.py",
    }
    assert not list(FOLDER.glob("*.ipynb")), "scripts in the percent format alone: no outputs"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_cells_are_prose_and_short_code(path):
    text = path.read_text()
    cells = re.split(r"^# %%", text, flags=re.MULTILINE)[1:]
    prose = [cell for cell in cells if cell.startswith(" [markdown]")]
    code = [cell for cell in cells if not cell.startswith(" [markdown]")]
    assert "format_name: percent" in text.split("# %%")[0]
    assert prose[0].splitlines()[1].startswith("# # ")
    assert all(re.fullmatch(r"#( .*)?", line) for c in prose for line in c.strip().splitlines()[1:])
    assert len(prose) >= 0.6 * len(code)
    assert max(len(cell.strip().splitlines()) for cell in code) <= 36


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_notebook_runs_and_its_pictures_are_labelled(path, outcome):
    _, figures = outcome(path.name)
    assert 5 <= len(figures) <= 20
    for figure in figures:
        assert figure.axes
        for ax in figure.axes:
            if ax.get_label() == "<colorbar>":
                assert ax.get_ylabel()
                continue
            assert ax.get_title(loc="left")
            assert not ax.get_title(), "two titles over one picture"
            if not len(ax.get_xticks()):  # a picture of pixels
                assert not ax.get_xlabel() + ax.get_ylabel()
                continue
            rows = "".join(label.get_text() for label in ax.get_yticklabels())
            assert ax.get_xlabel()
            assert ax.get_ylabel() or re.search(r"[a-z]{3}", rows), "numbers without a name"


def test_splits_notebook_shows_what_it_says(outcome):
    variables, _ = outcome("02_splits.py")
    fitted = variables["cascades"]
    ratios = fitted["logarithmic"].splits[1:] / fitted["logarithmic"].splits[:-1]
    assert np.allclose(ratios, ratios[0])
    first = {name: one.splits[1] for name, one in fitted.items()}
    assert first["uniform"] > first["practical, λ = 0.5"] > first["practical, λ = 0.9"]
    # "Here only the last few percent of λ help".
    wrong = dict(zip(variables["lams"], variables["wrong"], strict=True))
    assert wrong[0.5] > 10 * wrong[1.0]
    assert wrong[0.9] > 3 * wrong[1.0]


def test_fit_notebook_shows_what_it_says(outcome):
    variables, _ = outcome("03_fit_and_snap.py")
    shown = [text.get_text() for text in variables["phases"].texts]
    matches = [re.fullmatch(r"(.*)\n(\d+)% of steps jump", text) for text in shown]
    shares = {match[1]: int(match[2]) for match in matches}
    assert shares["no snapping"] == 100
    # Two coordinates that round to odd or even halves: 3/4 if frames were independent.
    assert 55 <= shares["4.1.1 as printed"] <= 90
    assert shares["unit corrected"] == shares['snap="exact"'] == 0
    # Sylvan: from a sixth to five sixths, with a sphere of the same size.
    titles = [ax.get_title(loc="left") for ax in variables["used"]]
    used = [int(re.search(r"(\d+)% of", title)[1]) for title in titles]
    assert used[0] <= 18
    assert 63 <= used[1] <= 69
    assert 82 <= used[2] <= 88
    assert np.allclose(variables["shifted"].texel_size[0], variables["sphere"].texel_size[0])
    counts = [
        int(re.search(r"(\d+) size", line.get_label())[1]) for line in variables["sizes"].lines
    ]
    assert counts[0] == 200
    assert 1 < counts[2] <= counts[1] < 70
    assert counts[3] == 1
    # One grid on the ground under two suns, with the world's axes alone.
    lines = [{tuple(np.round(line[:, axis], 6)) for line in ax.collections[0].get_segments()
              for axis in (0, 1) if np.ptp(line[:, axis]) < 1e-9}
             for ax in variables["axes_of_suns"][1]]  # fmt: skip
    assert len(lines[0] & lines[1]) > 20


def test_bias_notebook_shows_what_it_says(outcome):
    variables, _ = outcome("04_bias.py")
    before, after = variables["shares"] < 0.95, variables["shares"] > 1.02
    for tangent, curve in variables["curves"].items():
        assert min(np.array(curve)[before]) > 0.0, f"slope {tangent}: acne below the bound"
        assert max(np.array(curve)[after]) == 0.0, f"slope {tangent}: none above it"
    # a texel of the map, and a pixel
    t = variables["frame"].cascades.texel_size.max()
    law = variables["biases"] * np.cos(np.radians(variables["elevation"]))
    assert np.abs(variables["strips"] - law).max() <= t + variables["pixel"]
    assert max(report.disagreement for report in variables["best"].values()) < 0.01
    fixed, automatic = variables["kernels"].values()
    assert fixed[-1] > 20.0
    assert automatic[-1] < 4.0
    assert (
        abs(variables["depths"]["d16"].disagreement - variables["depths"]["d32f"].disagreement)
        < 1e-3
    )


def test_filters_notebook_shows_what_it_says(outcome):
    """Each check is a sentence of the notebook's."""
    variables, _ = outcome("05_filters.py")
    errors = {name: soft.mean["total"] for name, (_, soft, _, _) in variables["found"].items()}
    softs = [name for name in errors if name.startswith("pcss")]
    sharp = ("hard", "hardware 2 x 2")
    blurred = errors.keys() - {*softs, *sharp}
    assert max(errors[name] for name in softs) < errors["hard"]
    assert errors["hard"] < min(errors[name] for name in blurred), "kernels wider than the penumbra"
    bright = {name: soft.mean["too_bright"] for name, (_, soft, _, _) in variables["found"].items()}
    assert bright["fourier"] > 1.2 * bright["vsm"], "fourier loses what is near its caster"
    # Across an edge. A texel of steps in the box, whose window is round the point's own texel.
    taps, bounds = variables["taps"], variables["bounds"]
    for name in ("vsm", "evsm4", "msm"):
        assert np.abs(bounds[name] - taps["box"]).max() < 0.05
    assert np.abs(variables["softs"]["pcss"] - variables["softs"]["the sun's disc"]).max() < 0.05
    widths = {name: np.array(values) for name, values in variables["widths"].items()}
    assert np.ptp(widths["pcf gaussian, 9 x 9"]) < 1e-3
    # from two texels of 8 m / 512 on
    apart = np.abs(widths["pcss"] / widths["the sun's disc"] - 1.0)
    assert apart[widths["the sun's disc"] > 0.03].max() < 0.1
    # Bleeding.
    leak = {name: light.max() for name, light in variables["leaks"].items()}
    assert leak["vsm"] > 0.4
    assert 0.05 < leak["lvsm"] < 0.5 * leak["vsm"]
    assert max(leak["evsm2"], leak["evsm4"], leak["msm"]) < 0.01
    for lines, best in ((variables["helped"], np.max), (variables["honest"], np.sum)):
        first, *others = lines.values()
        assert max(best(light) for light in others) < 0.95 * best(first)
    # Seams: the numbers of docs/numerics.md 29, within what another crop changes.
    seams = variables["seams"]
    assert seams["trilinear", "quad"] < 0.9 * seams["trilinear", "hardware"]
    assert seams["trilinear", "analytic"] < 0.9 * seams["trilinear", "hardware"]
    assert seams["anisotropic", "quad"] < 0.2 * seams["anisotropic", "hardware"]
    assert seams["anisotropic", "analytic"] < 0.2 * seams["anisotropic", "hardware"]


def test_filters_notebook_shows_kernels_transitions_and_formats(outcome):
    variables, _ = outcome("05_filters.py")
    kernels = variables["kernels"]
    assert kernels["texels"][-1] > 3 * kernels["texels"][0]
    assert np.ptp(kernels["world"]) < 0.1 * kernels["world"][0]
    assert (kernels["screen"] <= kernels["texels"] + 1e-3).all()
    assert kernels["screen"][40] > 3 * kernels["screen"][0]
    steps = variables["steps"]
    assert max(steps["linear"], steps["smooth"]) < 0.3 * steps["none"]
    # By lot: pixels of either mask, so neighbours differ where the blended mask is smooth.
    rough = {name: np.abs(np.diff(mask, axis=1)).sum() for name, mask in variables["rims"].items()}
    assert rough["dither"] > 1.05 * rough["linear"]
    megabytes, errors, leaks = (
        {name: values[i] for name, values in variables["stored"].items()} for i in range(3)
    )
    assert megabytes["vsm float16"] < 0.6 * megabytes["vsm float32"]
    assert errors["vsm float16"] > 2 * errors["vsm float32"]
    assert errors["vsm unorm16"] < 1.15 * errors["vsm float32"]
    assert errors["evsm4 float16"] > 1.1 * errors["evsm4 float32"]
    assert leaks["evsm4 float16"] > 0.01 > leaks["evsm4 float32"]
    assert errors["msm unorm16"] < 1.15 * errors["msm float32"]


def test_page_of_pictures_shows_what_its_script_draws():
    docs = FOLDER.parent / "docs"
    shown = re.findall(r"!\[([^\]]+)\]\((images/\w+\.png)\)", (docs / "pictures.md").read_text())
    script = (FOLDER.parent / "scripts" / "pictures_page.py").read_text()
    drawn = re.findall(r'"(\w+)": \1\b', script)
    assert sorted(name for _, name in shown) == sorted(f"images/{name}.png" for name in drawn)
    for words, name in shown:
        assert len(words) > 30, "said in words for those who cannot see it"
        assert 5_000 < (docs / name).stat().st_size < 150_000


def test_recommendation_notebook_shows_what_it_says(outcome):
    variables, _ = outcome("08_only_what_is_called_for.py")
    little = {name: one.settings for name, one in variables["little"].items()}
    assert [one.filter for one in little.values()] == ["hard", "pcss", "none", "hard"]
    assert [one.snap for one in little.values()][::3] == ["none", "exact"]
    assert variables["error"] < 0.01
    costs, goals = variables["costs"], variables["goals"]
    assert costs == sorted(costs)
    assert all(one.expected_error <= g for one, g in zip(variables["answers"], goals, strict=True))
    assert all(np.array(variables["measured"]) < 2.5 * np.array(goals))
    assert variables["proof"].confirmed_share >= 0.75
