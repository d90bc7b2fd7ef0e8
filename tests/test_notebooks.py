"""Notebooks: they run from top to bottom, leave nothing, and say what the numbers say."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import scene_files

pytest.importorskip("matplotlib", reason="notebooks draw (extra: notebooks)").use("Agg")
pytest.importorskip("embreex", reason="notebooks compare with csm.truth (extra: notebooks)")
pytest.importorskip("xarray", reason="notebooks sweep (extra: notebooks)")
plt = pytest.importorskip("matplotlib.pyplot")

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Function from a notebook's name to its variables and figures; each runs once.

    On real scenes where they are and the notebook has a use for them; without them if asked.
    """
    kept = {}

    def run(name, scenes=scene_files.FOLDER):
        if (name, scenes) not in kept:
            plt.close("all")
            folder = tmp_path_factory.mktemp("notebook")
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                patch.setenv("CSM_SCENES", str(scenes))
                # Shown is what a reader sees; closing is left to the fixture.
                patch.setattr(plt, "show", lambda: None)
                variables = runpy.run_path(str(FOLDER / name))
            kept[name, scenes] = variables, [plt.figure(n) for n in plt.get_fignums()]
            assert not list(folder.iterdir()), "a notebook saves nothing unless asked"
        return kept[name, scenes]

    yield run
    plt.close("all")


def test_there_are_notebooks():
    assert {path.name for path in NOTEBOOKS} >= {
        "02_splits.py",
        "03_fit_and_snap.py",
        "04_bias.py",
        "05_filters.py",
        "06_cost_and_quality.py",
        "07_flicker.py",
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


def test_cost_notebook_shows_what_it_says(outcome):
    """Beside what it checks itself: who is better than whom, at every point of the sweep."""
    variables, _ = outcome("06_cost_and_quality.py")
    error = variables["found"].error_total
    assert (error.sel(look="pcf 5 x 5") > error.sel(look="hard")).all(), "blur under a point sun"
    assert (error.sel(fit="visible") < error.sel(fit="sphere")).all()
    assert (error.diff("cascade_count") < 0).all()
    assert variables["real"] == scene_files.FOLDER.joinpath("denhaag_lod2.glb").is_file()
    # the same settings in the sweep's renderer and in the notebook's
    swept = error.sel(map_size=512, cascade_count=1, look="hard", fit="sphere")
    assert variables["reports"]["one map of 512"].mean["total"] == pytest.approx(float(swept))
    # the laws hold better for The Hague's long edges than for a town of railings
    assert variables["low"] > (0.7 if variables["real"] else 0.4)
    assert variables["high"] < 1.25
    softly = variables["softly"]
    assert all(p < h for p, h in zip(softly["pcss"], softly["hard"], strict=True))
    assert set(variables["drawn"]) == {
        f"{variables['place'].replace(' ', '_')}_{kind}.png" for kind in ("time", "memory")
    }


def test_flicker_notebook_shows_what_it_says(outcome):
    variables, _ = outcome("07_flicker.py")
    assert variables["free"].largest == 1.0
    assert variables["exact"].count == variables["free"].count > 150_000
    # what a map shows is the mean over the steps in which its point counts
    shown = variables["shown"]
    image = variables["free"].as_picture(shown)
    assert np.isnan(image[~shown]).all()
    always = np.isfinite(variables["free"].changes).all(axis=0)
    changes = variables["free"].changes[:, always]
    assert np.abs(image[shown][always] - changes.mean(axis=0)).max() < 1e-12
    ratios = variables["ratios"]
    assert ratios[0] < ratios[1:].mean(), "what is always wrong does not flicker"
    # "Snapping buys no accuracy and costs next to none"
    wrong = variables["wrong"]
    for fit in ("sphere", "visible"):
        assert wrong[f"{fit}, exact"] == pytest.approx(wrong[f"{fit}, not snapped"], rel=0.15)
    assert wrong["sphere, exact"] < 0.7 * wrong["sphere, exact, by interval"]
    largest = {name: report.largest for name, report in variables["softly"].items()}
    mean = {name: report.mean for name, report in variables["softly"].items()}
    box, hard = "pcf 5 x 5, box", "hard"
    assert largest[box] / largest[hard] < mean[box] / mean[hard], "further than the sum"
    assert mean["pcss"] == pytest.approx(mean["hard"], rel=0.15)
    # a turn of less than a degree holds two steps of half a degree at most
    jumps = {n: np.count_nonzero(report.per_step) for n, report in variables["passing"].items()}
    assert jumps["smooth"] == len(variables["hours"]) - 1
    assert 1 <= jumps["in steps"] <= 2
    levels = variables["zoomed"]["box, geometric levels"].mean
    assert levels < 0.3 * variables["zoomed"]["sphere, exact"].mean


@pytest.mark.slow
@pytest.mark.parametrize("name", ["06_cost_and_quality.py", "07_flicker.py"])
def test_notebooks_of_real_scenes_run_on_made_ones(name, outcome):
    variables, _ = outcome(name, "")
    assert not variables["real"]


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
    assert [one.filter for one in little.values()] == [
        "hard", "hard", "pcss", "none", "hard",
    ]  # fmt: skip
    plain = little["plain at noon"]
    assert (plain.cascade_count, plain.map_size, plain.snap) == (1, 256, "none")
    assert [little[name].snap for name in ("still", "path")] == ["none", "exact"]
    assert variables["error"] < 0.01
    costs, goals = variables["costs"], variables["goals"]
    assert costs == sorted(costs)
    assert all(one.expected_error <= g for one, g in zip(variables["answers"], goals, strict=True))
    assert all(np.array(variables["measured"]) < 2.5 * np.array(goals))
    assert variables["proof"].confirmed_share >= 0.75
    assert variables["exported"].engine == "godot"
