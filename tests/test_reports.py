"""The page of a sweep over techniques: whole in one file, and true to its dataset."""

import io
import json
import re

import numpy as np
import pytest

import csm
from csm import cli, report_command, report_runs, tracing
from csm.arguments import INTERRUPTED
from csm.hard_cases import CASES, RECORDS
from csm.report_pictures import crop_picture, error_crop_picture, front_picture
from csm.report_runs import CROP, crop_place, path_of, with_crops_and_flicker
from csm.report_tables import against_baseline
from csm.reports import at_one_pace
from csm.techniques import BASELINE, FAMILIES, settings_by_name

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
        {"driver": "a driver", "csm": "0.1.0"},
    )


def test_page_needs_no_other_file_and_says_what_the_dataset_says(dataset, tmp_path):
    page = csm.report(dataset, out=tmp_path)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=['\"](?!data:|#)", text), "something outside is referred to"
    assert "it &lt;broke&gt;" in text
    assert "a &lt;name&gt; of one&#x27;s own" in text
    assert "<name>" not in text
    assert "<p class='note'>a driver</p>" in text
    for case in ("town &amp; street", "hill"):
        assert f">{case}</h2>" in text
    # half of hard's 1 % is pcf's 0.4 %, at 1.4 times the time
    row = re.search(r"<tr[^>]*><td>hard</td>.*?</tr>", text)[0]
    assert "1.000%" in row
    assert "pcf 3x3, 1.4 x the time" in row
    assert text.count("data:image/png") == len(list(tmp_path.glob("*.png"))) + 8  # errors too
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.glob("*.png"))
    assert f"width: {CROP[1]}px; }}" in text, "a pixel of a crop is a pixel of the page, or two"


def test_times_are_given_at_one_pace(dataset, tmp_path):
    """While the third was timed the machine took twice as long for everything."""
    assert at_one_pace(dataset)[1] is None
    beside = np.array([[10.0, 10.0, 20.0, 10.0], [12.0, 12.0, 24.0, np.nan]])
    timed = dataset.assign(ms_reference=(("case", "technique"), beside))
    even, paces = at_one_pace(timed)
    assert paces == (1.0, 2.0)
    np.testing.assert_allclose(even.ms_total.values[0], [10.0, 14.0, 15.0, 5.0])
    np.testing.assert_allclose(even.ms_total.values[1], [12.0, 15.0, 16.5, np.nan])
    text = csm.report(timed, out=tmp_path).read_text(encoding="utf-8")
    assert "from 1.00 to 2.00 of its median" in text


def test_a_technique_that_cannot_be_shown_does_not_end_the_report(gl, monkeypatch):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    taken = report_runs._Look._taken

    def failing(look, settings):
        if settings.warp == "psm":
            raise MemoryError("all gone")
        return taken(look, settings)

    monkeypatch.setattr(report_runs._Look, "_taken", failing)
    case = {"box": ("plane_and_box", "corner", "diagonal")}
    with pytest.warns(UserWarning, match="all gone"):
        found = csm.sweep_techniques(
            case, families=["warps"], size=(64, 48), repeats=1, causes=False
        ).isel(case=0)
    missing = np.isnan(found.flicker.values)
    assert found.technique.values[missing].tolist() == ["PSM"]
    assert np.isnan(found.crop.sel(technique="PSM").values).all()


def test_a_report_says_how_exact_its_soft_truth_is(tmp_path):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    out = tmp_path / "page"
    words = ["report", "plane_and_box:corner:morning", "--sun-diameter", "6", "--size", "48x32"]
    words += ["--families", "warps", "--repeats", "1", "--out", str(out), "--rays", "4"]
    assert cli.main([*words, "--standard-error", "0.05", "--no-causes", "--quiet"]) == 0
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "standard error is at most 0.05" in text


@pytest.mark.parametrize("taken", [{"case": "hill"}, {"case": []}])
def test_a_page_needs_cases(dataset, tmp_path, taken):
    with pytest.raises(ValueError, match="dataset must have a dimension case, of one"):
        csm.report(dataset.sel(taken), out=tmp_path)


def test_axes_of_any_name_are_joined(dataset, tmp_path):
    swept = dataset.drop_vars(["crop", "crop_truth"]).rename(technique="joined")
    assert "joined pcf 3x3" not in csm.report(swept, out=tmp_path).read_text(encoding="utf-8")


def test_cases_that_are_described_are_called_by_their_words():
    names = [
        report_command.find_case(f"plane_and_box:{camera}:{sun}", (64, 48))[0]
        for camera, sun in (("eye=0,5,20,target=0,0,0", "238,33"), ("corner", "100,20"))
    ]
    assert names == [
        "plane_and_box, eye=0,5,20,target=0,0,0, 238,33",
        "plane_and_box, corner, 100,20",
    ]


def test_an_interrupted_report_says_where_it_goes_on(tmp_path, monkeypatch, capsys):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(report_command, "sweep_techniques", stopped)
    words = ["report", "plane_and_box", "--out", str(tmp_path / "page"), "--quiet"]
    assert cli.main(words) == INTERRUPTED
    assert "the same command goes on from there" in capsys.readouterr().err


def test_a_report_of_nothing_is_no_success(gl, tmp_path, monkeypatch, capsys):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    monkeypatch.setattr(tracing, "MAX_RAYS_PER_PIXEL", 8)
    words = ["report", "plane_and_box:contact", "--sun-diameter", "5", "--size", "48x32"]
    words += ["--families", "soft", "--repeats", "1", "--rays", "4", "--standard-error", "1e-6"]
    assert cli.main([*words, "--out", str(tmp_path / "page"), "--quiet"]) != 0
    assert "nothing could be measured: no truth" in capsys.readouterr().err


def test_times_have_their_quartiles_and_transitions_a_column_of_their_own(dataset, tmp_path):
    plain = csm.report(dataset, out=tmp_path / "plain").read_text(encoding="utf-8")
    assert "<th>between cascades</th>" not in plain
    time, place = dataset.ms_total, ("case", "technique")
    jumps = np.full((2, 4), 0.0625)
    jumps[:, 1] = np.nan  # of a single map
    more = dataset.assign(
        ms_total_q1=time - 0.5, ms_total_q3=time + 1.5, flicker_transition=(place, jumps)
    )
    text = csm.report(more, out=tmp_path / "more").read_text(encoding="utf-8")
    assert text.count("<th>flicker</th><th>between cascades</th><th>ms</th>") == 2
    rows = {name: re.search(rf"<tr[^>]*><td>{name}</td>.*?</tr>", text)[0] for name in NAMES[:2]}
    assert "<td class='n'>10.0 <span class='note'>9.5 to 11.5</span></td>" in rows[BASELINE]
    assert "<td class='n'>6.250%</td>" in rows[BASELINE]
    assert "<td class='n'>–</td>" in rows["pcf 3x3"]
    # what failed spans all columns but its name
    columns = re.search(r"<table><tr>(<th>technique.*?)</tr>", text)[1].count("<th>")
    (span,) = {int(one) for one in re.findall(r"colspan='(\d+)'>it &lt;broke", text)}
    assert span == columns - 1


def test_order_of_dimensions_does_not_matter(dataset, tmp_path):
    one = csm.report(dataset, out=tmp_path / "one").read_text(encoding="utf-8")
    turned = dataset.transpose("technique", "case", ...)
    assert csm.report(turned, out=tmp_path / "two").read_text(encoding="utf-8") == one


def test_axes_of_a_sweep_of_ones_own_are_joined(dataset, tmp_path, monkeypatch):
    """Every combination is a row; the same numbers under names give the same page but for them."""
    numbers = dataset.isel(case=[1]).drop_vars(["technique", "crop", "crop_truth"])
    axes = numbers.assign_coords(technique=np.arange(4)).coarsen(technique=2)
    axes = axes.construct(technique=("map_size", "look")).drop_vars("technique")
    axes = axes.assign_coords(map_size=[512, 1024], look=["crisp", "blurred"])
    names = [f"map_size {m}, {look}" for m in (512, 1024) for look in ("crisp", "blurred")]
    colours, draw = [], csm.reports.front_picture

    def drawn(costs, errors, names, families, **texts):
        colours.append(dict(zip(names, families, strict=True)))
        return draw(costs, errors, names, families, **texts)

    monkeypatch.setattr(csm.reports, "front_picture", drawn)
    text = csm.report(axes, out=tmp_path / "axes").read_text(encoding="utf-8")
    assert colours == 3 * [{name: name.split(", ")[1] for name in names}]
    named = csm.report(numbers.assign_coords(technique=names), out=tmp_path / "named")
    tables = [re.findall(r"<t[rd].*?</t[rd]>", one) for one in (text, named.read_text("utf-8"))]
    assert tables[0] == tables[1]
    assert sum(f"<td>{name}</td>" in text for name in names) == 4
    only = csm.report(axes.isel(look=0, drop=True), out=tmp_path / "only")
    assert "<td>map_size 1024</td>" in only.read_text("utf-8")
    with pytest.raises(ValueError, match="an axis to compare"):
        csm.report(axes.isel(look=0, map_size=0, drop=True), out=tmp_path)


@pytest.mark.parametrize("name", ["case", "error_total", "ms_total", "bytes_maps"])
def test_a_dataset_that_lacks_something_is_refused_by_name(dataset, tmp_path, name):
    with pytest.raises(ValueError, match=name):
        csm.report(dataset.drop_vars(name), out=tmp_path)


def test_what_failed_in_a_case_is_not_the_best_of_the_mean(dataset, tmp_path):
    """Its mean over the other cases may be that of easier ones."""
    dataset.error_total[0, 3] = 1e-6
    text = csm.report(dataset, out=tmp_path).read_text(encoding="utf-8")
    summary = re.search(r"At equal memory.*?</table>", text, re.DOTALL)[0]
    assert "pcf 3x3" in summary
    assert "a &lt;name&gt;" not in summary


def test_a_case_without_judged_pixels_says_so_and_spoils_no_mean(dataset, tmp_path):
    dataset.error_total[1] = np.nan
    dataset["message"][1] = ""
    text = csm.report(dataset, out=tmp_path).read_text(encoding="utf-8")
    summary = re.search(r"At equal memory.*?</table>", text, re.DOTALL)[0]
    assert "mean of 1 case(s)" in summary
    assert "<td class='n'>0.400%</td>" in summary
    assert text.count(">no pixel was judged<") == 4


def test_two_scenes_of_one_name_are_not_one(tmp_path, capsys):
    assert cli.main(["report", "town", "town:street", "--out", str(tmp_path / "page")]) == 2
    assert "two are called 'town, street, noon' (the second is 'town:street')" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "page").exists()


@pytest.fixture
def refused(tmp_path, capsys, monkeypatch):
    """The sentence that `csm report` refuses some words with, nothing swept."""
    monkeypatch.setattr(report_command, "sweep_techniques", None)

    def refused(*words):
        assert cli.main(["report", *words, "--out", str(tmp_path / "page")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert not (tmp_path / "page").exists()
        return line

    return refused


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["town:nocam", "--quiet"], "the camera in SCENE 'town:nocam' must be one of street"),
        (["town::nosun", "--quiet"], "the sun in SCENE 'town::nosun' must be one of noon"),
        (["town:a:b:c", "--quiet"], "as SCENE:CAMERA:SUN (got 'town:a:b:c')"),
        (["nowhere:a", "--quiet"], "SCENE must be a file or one of"),
    ],
)
def test_what_is_wrong_with_a_scene_is_said_of_it(refused, words, text):
    assert text in refused(*words)


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("--repeats", "0", "--repeats must be a number from 1 to 10000 (got 0)"),
        ("--sun-diameter", "-1", "--sun-diameter: angular_diameter_deg must be"),
        ("--rays", "0", "--rays must be"),
    ],
)
def test_bad_options_are_refused_before_scenes_load(refused, monkeypatch, option, value, text):
    monkeypatch.setattr(report_command, "find_scene", None)
    assert text in refused("town", option, value)


def test_colons_in_a_path_are_the_paths(tmp_path, monkeypatch):
    loaded = []

    def load(source):
        loaded.append(source)
        return csm.scenes.plane_and_box()

    monkeypatch.setattr(report_command, "find_scene", load)
    monkeypatch.chdir(tmp_path)
    for name in ("a", "a:corner", "b:c.obj"):
        (tmp_path / name).write_text("")
    for text, source, camera in (
        ("b:c.obj", "b:c.obj", None),
        ("b:c.obj:contact", "b:c.obj", "contact"),
        ("b:c.obj:contact:grazing", "b:c.obj", "contact"),
        ("a:contact", "a", "contact"),
        ("a:corner:contact", "a:corner", "contact"),
        ("town:corner", "town", "corner"),
    ):
        name, (scene, found, _) = report_command.find_case(text, (64, 48))
        assert loaded.pop() == source
        camera = next(iter(scene.cameras)) if camera is None else camera
        assert np.array_equal(found.eye, scene.cameras[camera].eye)
        assert f", {camera}, " in name


def test_a_file_in_the_pages_place_is_refused(dataset, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match=r"out .*: is a file, not a folder"):
        csm.report(dataset, out=tmp_path / "file")


def test_crop_holds_most_of_the_error():
    rng = np.random.default_rng(2)
    error, judged = rng.random((30, 40)), rng.random((30, 40)) < 0.8
    row, column = crop_place(error, judged, size=(7, 9))
    counted = np.where(judged, error + 1e-6, 0.0)
    sums = {
        (r, c): counted[r : r + 7, c : c + 9].sum() for r in range(30 - 7) for c in range(40 - 9)
    }
    assert sums[row, column] >= 0.9 * max(sums.values())
    assert crop_place(error, judged, size=(100, 100))[0] == 0
    assert crop_place(error, np.zeros_like(judged), size=(7, 9)) == (0, 0)


@pytest.mark.parametrize(
    ("spots", "place"),
    [
        # of all windows that hold the spot, the one that has it in its middle
        ({(20, 30): 1.0, (21, 31): 1.0}, (16, 26)),
        # the picture ends
        ({(1, 38): 1.0, (2, 39): 1.0}, (0, 30)),
        # one spot at each end of the window: its middle is where it was
        ({(10, 10): 1.0, (19, 19): 1.0}, (10, 10)),
        # moved to the middle of all, at (12.25, 12.25), it would lose a quarter of the error
        ({(10, 10): 3.0, (19, 19): 1.0}, (10, 10)),
    ],
)
def test_crop_has_the_error_in_its_middle(spots, place):
    error = np.zeros((30, 40))
    for spot, value in spots.items():
        error[spot] = value
    assert crop_place(error, np.ones((30, 40), bool), size=(10, 10)) == place


def as_pixels(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_where_nothing_is_seen_is_not_light():
    mask = np.array([[1.0, 0.0, np.nan]])
    pale = np.array([204, 222, 242])
    shown = as_pixels(crop_picture(mask, scale=1))[0]
    np.testing.assert_allclose(shown, [[255] * 3, [0] * 3, pale], atol=1)
    error = as_pixels(error_crop_picture(mask, np.array([[1.0, 1.0, np.nan]]), scale=1))[0]
    np.testing.assert_allclose(error, [[255] * 3, [214, 94, 0], pale], atol=1)


def test_families_choose_techniques():
    assert set(settings_by_name(["soft"])) == {
        BASELINE, "pcss", "pcss, vogel rotated", "pcss by variance", "pcss by summed areas",
    }  # fmt: skip
    assert len(settings_by_name(None)) >= 60
    with pytest.raises(ValueError, match=rf"{FAMILIES[0]}.*'sofd'"):
        settings_by_name(["sofd"])


def test_what_never_errs_is_drawn_too():
    # A logarithmic axis has no 0, and what does not flicker at all is the best there is.
    costs, names, families = [1.0, 2.0, 4.0], ["a", "b", "c"], ["one", "one", "two"]

    def picture(errors):
        from PIL import Image

        drawn = front_picture(
            costs, errors, names, families, title="", cost="time [ms]", error="flicker"
        )
        return np.asarray(Image.open(io.BytesIO(drawn)).convert("RGB"))

    with_zero, without = picture([0.1, 0.0, 0.01]), picture([0.1, np.nan, 0.01])
    colour = np.array(with_zero[:, :, :3], int)
    assert with_zero.shape != without.shape or (colour != without).any()
    blue = lambda shown: int(((shown - (0, 114, 178)) ** 2).sum(axis=-1).__lt__(300).sum())  # noqa: E731
    assert blue(with_zero.astype(int)) > 1.2 * blue(without.astype(int)), "b has no point"
    assert picture([0.0, 0.0, 0.0]).any(), "a technique each at 0"


def test_what_rounding_makes_is_no_flicker(monkeypatch):
    """Masks are float32: 1e-8 is 0, lies on the line of 0, and beats nothing that is cheaper."""
    drawn = []
    monkeypatch.setattr(
        csm.report_pictures, "png_of_figure", lambda figure: drawn.append(figure) or b""
    )
    names, families = ["free", "rounded", "worse"], ["one"] * 3
    texts = {"title": "", "cost": "time [ms]", "error": "flicker"}
    front_picture([1.0, 2.0, 4.0], [3e-9, 0.0, 0.1], names, families, **texts)
    (ax,) = drawn[0].axes
    points, front = ax.lines[0], ax.lines[1]
    assert points.get_ydata().tolist() == pytest.approx([0.04, 0.04, 0.1])
    assert front.get_xdata().tolist() == [1.0]
    assert ax.get_ylim()[0] > 1e-3, "nothing far below"
    import matplotlib.pyplot

    matplotlib.pyplot.close(drawn[0])


def test_few_cases_give_no_verdict(dataset, tmp_path):
    plain = dataset.isel(technique=[0, 1, 2])
    text = csm.report(plain, out=tmp_path).read_text(encoding="utf-8")
    of_two = re.search(r"Against hard, over all cases</h2>(.*?)<h2", text, re.DOTALL)[1]
    assert "2 cases can tell no technique from chance: that takes 6 or more" in of_two
    assert "<table>" not in of_two
    assert "interval" not in of_two
    several = plain.isel(case=[0, 1] * 3).assign_coords(case=list("abcdef"))
    of_six = "".join(against_baseline(several))
    assert "here over 6 cases" in of_six
    assert "<td>better</td><td>pcf 3x3</td>" in of_six
    assert "<td>worse</td><td>vsm 5x5</td>" in of_six
    assert "<table>" not in "".join(against_baseline(several.isel(case=slice(5))))


def test_no_two_pictures_have_one_name(dataset, tmp_path):
    same = dataset.assign_coords(technique=["hard", "a b", "a_b", "A b"], case=["x y", "x_y"])
    same = same.fillna({"error_total": 0.01, "ms_total": 5.0})
    text = csm.report(same, out=tmp_path).read_text(encoding="utf-8")
    files = [path.name for path in tmp_path.glob("*.png")]
    # of each case three fronts, a truth and four masks
    assert len({name.lower() for name in files}) == len(files) == 2 * (3 + 1 + 4)
    assert text.count("data:image/png") == len(files) + 2 * 4
    assert {"x_y_a_b.png", "x_y_a_b_2.png", "x_y_A_b_3.png", "x_y_time_2.png"} <= set(files)


def records(case, worst, failed):
    """Records of one case with a figure that used up `worst` of its tolerance."""
    figure = {
        "case": case, "what": f"<figure> of {case}", "worst": worst, "tolerance": 1.0,
        "unit": "texel", "cases": 2, "test": "t.py::test_x", "picture": None, "failed": failed,
    }  # fmt: skip
    outcome = "failed" if failed else "passed"
    return figure, {case: [["t.py::test_x", outcome], ["t.py::test_y", "passed"]]}


def test_hard_cases_are_summed_up(dataset, tmp_path):
    for backend, worst in (("egl", 0.25), ("osmesa", 0.5)):
        figures, tests = zip(records("S1", worst, 0), records("X1", 1.5, 1), strict=True)
        (tmp_path / "hard" / backend).mkdir(parents=True)
        (tmp_path / "hard" / backend / RECORDS).write_text(
            json.dumps({"figures": figures, "tests": tests[0] | tests[1], "driver": "somebody"})
        )
    page = csm.report(dataset, out=tmp_path / "page", hard_cases=tmp_path / "hard")
    text = page.read_text(encoding="utf-8")
    lines = dict(re.findall(r"<tr><td>([A-Z]\d)</td>(.*?)</tr>", text))
    assert set(lines) == set(CASES)
    assert ">passed<" in lines["S1"]
    assert "0.5 of 1 texel" in lines["S1"], "the nearest to its tolerance of both back ends"
    assert "<td class='n'>4</td>" in lines["S1"], "two tests on two back ends"
    assert "egl, osmesa" in lines["S1"]
    assert "<b>failed</b>" in lines["X1"]
    assert "1.5 of 1 texel" in lines["X1"]
    assert "no test ran" in lines["F1"]
    assert "&lt;figure&gt; of S1" in text
    with pytest.raises(FileNotFoundError, match="csm hard-cases --out"):
        csm.report(dataset, out=tmp_path / "new", hard_cases=tmp_path / "page")
    assert not (tmp_path / "new").exists(), "refused before anything is written"
    (tmp_path / "hard" / "egl" / RECORDS).write_text("{}")
    with pytest.raises(ValueError, match="no records of hard cases"):
        csm.report(dataset, out=tmp_path / "new", hard_cases=tmp_path / "hard")


def test_a_sun_with_a_disc_is_judged_by_its_disc(tmp_path, capsys):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    out = tmp_path / "page"
    words = ["report", "plane_and_box:corner:morning", "--sun-diameter", "6", "--size", "96x54"]
    words += ["--families", "soft", "--repeats", "1", "--out", str(out), "--rays", "16"]
    assert cli.main(words) == 0
    assert capsys.readouterr().out.strip() == str(out / "report.html")
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "a disc of 6°, which the truth averages over 16 rays a pixel" in text
    assert "<th>peter panning</th>" in text
    swept = xarray.open_dataset(out / "sweep" / "sweep.nc").load().isel(case=0)
    error = dict(zip(swept.technique.values.tolist(), swept.error_total.values, strict=True))
    # penumbrae of 6 degrees are pixels wide here: a hard edge misses them, soft shadows do not
    assert error["pcss"] < 0.7 * error[BASELINE]


def test_crops_show_the_truth_that_judged(tmp_path):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    scene = csm.scenes.plane_and_box()
    camera = scene.cameras["corner"].replace(size=(64, 48))
    sun = csm.Sun(scene.suns["diagonal"].to_light, 8.0)
    swept = xarray.Dataset(
        {"status": (("case", "technique"), [["ok", "failed"]])},
        {"case": ["box"], "technique": [BASELINE, "not snapped"]},
    )
    found = with_crops_and_flicker(swept, {"box": (scene, camera, sun)}, rays_per_pixel=16)
    exact = csm.truth(scene, camera, sun, rays_per_pixel=16)
    sky = ~exact.valid
    assert sky.any(), "the camera sees no sky"
    shown = found.crop_truth.values[0, :48, :64]
    assert ((shown > 0.1) & (shown < 0.9)).any(), "penumbrae"
    np.testing.assert_array_equal(
        shown, np.where(sky, np.nan, exact.mask), err_msg="the whole picture"
    )
    with csm.Renderer() as renderer:
        mask = renderer.render(scene, camera, sun).mask
    np.testing.assert_array_equal(
        found.crop.values[0, 0, :48, :64], np.where(sky, np.float32(np.nan), mask)
    )
    assert np.isnan(found.crop_truth.values[0, 48:]).all(), "beyond the picture nothing is seen"
    assert np.isnan(found.crop.values[0, 1]).all(), "of a point that failed nothing is shown"
    assert found.flicker.values[0, 0] == 0.0, "snapped windows hold still"
    assert np.isnan(found.flicker.values[0, 1])


def test_a_report_that_was_stopped_goes_on(tmp_path, monkeypatch):
    pytest.importorskip("embreex", reason="truths are traced (extra: truth)")
    case = {"box": ("plane_and_box", "corner", "diagonal")}
    options = {"families": ["warps"], "size": (64, 48), "repeats": 1, "causes": False}
    taken, calls = report_runs._Look._taken, []

    def stopped(look, settings):
        calls.append(settings)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return taken(look, settings)

    monkeypatch.setattr(report_runs._Look, "_taken", stopped)
    with pytest.raises(KeyboardInterrupt):
        csm.sweep_techniques(case, out=tmp_path, **options)
    first = csm.sweep_techniques(case, out=tmp_path, **options)
    assert len(calls) == 3 + first.sizes["technique"] - 2  # two were done, the third is made again
    again = csm.sweep_techniques(case, out=tmp_path, **options)
    assert len(calls) == 1 + first.sizes["technique"], "nothing is left to make"
    xarray.testing.assert_equal(first, again)
    fresh = csm.sweep_techniques(case, **options)
    for name in ("crop", "flicker", "flicker_transition"):
        xarray.testing.assert_equal(first[name], fresh[name])


def test_the_path_walks_and_turns():
    scene = csm.scenes.plane_and_box()
    for camera in (scene.cameras["corner"], scene.cameras["map"]):
        path = path_of(camera, 10.0)
        np.testing.assert_allclose(path[0].eye, camera.eye)
        steps = np.diff([one.eye for one in path], axis=0)
        np.testing.assert_allclose(steps @ camera.right, 0.04, err_msg="sideways")
        assert all(one.size == camera.size and one.far == camera.far for one in path)
