"""Sweeps: numbers that are those of a render, places that are those asked for, nothing twice."""

import csv
import gc
import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="sweeps need the extra truth")
pytest.importorskip("xarray", reason="sweeps need the extra sweep")
pytest.importorskip("netCDF4", reason="sweeps need the extra sweep")

import xarray

import csm
from csm import renderer as renderer_module
from csm import sweep_journal, sweep_runs, sweep_worker, sweeps, truth_cache
from csm.sweep_command import read_sweep
from csm.sweep_journal import Journal, blank_record
from csm.sweep_tables import COLUMNS, VALUES

SIZE = (48, 32)
QUICK = {"size": SIZE, "repeats": 1}
BOX = ("plane_and_box", "corner", "diagonal")
CONTACT = ("plane_and_box", "contact", "morning")
AXES = {"map_size": [128, 64], "filter": ["pcf", "hard"]}
TIMES = ("ms_", "frames")


def without_times(dataset):
    """Everything that must be the same wherever and whenever it was measured."""
    timed = [name for name in dataset if name.startswith(TIMES)]
    return dataset.drop_vars(timed).drop_attrs(deep=False)


def lines(folder):
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def swept(gl, tmp_path_factory):
    """A small sweep and its folder."""
    folder = tmp_path_factory.mktemp("swept")
    return csm.sweep({"box": BOX, "foot": CONTACT}, AXES, out=folder, **QUICK), folder


# ------------------------------------------------------------------------------------- the numbers


def test_every_number_is_that_of_a_render(swept):
    found, _ = swept
    scene = csm.scenes.plane_and_box()
    with csm.Renderer() as renderer:
        for case, (_, camera, sun) in {"box": BOX, "foot": CONTACT}.items():
            camera, sun = scene.cameras[camera].replace(size=SIZE), scene.suns[sun]
            truth = csm.truth(scene, camera, sun)
            for map_size in AXES["map_size"]:
                for filter_ in AXES["filter"]:
                    settings = csm.ShadowSettings(map_size=map_size, filter=filter_)
                    frame = renderer.render(
                        scene, camera, sun, settings, outputs=("mask", "valid", "cascade_index")
                    )
                    report = csm.compare(frame, truth)
                    point = found.sel(case=case, map_size=map_size, filter=filter_)
                    for cause in ("total", "too_bright", "too_dark"):
                        assert point[f"error_{cause}"].item() == report.mean[cause]
                    assert point.disagreement.item() == report.disagreement
                    assert point.judged_count.item() == report.judged_count > 100
                    assert point.beyond_range.item() == report.beyond_range
                    frame = renderer.render(scene, camera, sun, settings, outputs=("mask",))
                    assert point.bytes.item() == frame.info["bytes"]
                    assert point.bytes_maps.item() == 4 * 4 * map_size**2, "four maps of d32f"


def test_times_are_there_and_add_up(swept):
    found, _ = swept
    passes = ["view", "shadow_map", "shadow_mask"]
    for name in passes:
        assert (found[f"ms_{name}"] > 0).all()
    # With one repeat the median is that frame, so the passes add up, without readback.
    total = sum(found[f"ms_{name}"] for name in passes)
    assert np.allclose(total, found.ms_total, rtol=1e-12)
    assert (found.ms_readback > 0).all()
    assert (found.ms_host > 0).all()
    assert (found.frames == 1).all()
    assert (found.ms_total_q1 == found.ms_total).all()


def test_a_pass_that_settings_do_not_have_takes_no_time(gl):
    found = csm.sweep({"box": BOX}, {"filter": ["hard", "vsm"]}, base=small(), **QUICK)
    assert found.ms_shadow_blur.sel(filter="hard").item() == 0.0
    assert found.ms_shadow_blur.sel(filter="vsm").item() > 0.0


def small(**more):
    return csm.ShadowSettings(**{"map_size": 64, "cascade_count": 2, **more})


def test_axes_keep_their_order_and_kind(swept):
    found, folder = swept
    for dataset in (found, xarray.load_dataset(folder / "sweep.nc")):
        assert dataset.error_total.dims == ("case", "map_size", "filter")
        assert dataset.map_size.values.tolist() == [128, 64]
        assert dataset["filter"].values.tolist() == ["pcf", "hard"]
        assert dataset.case.values.tolist() == ["box", "foot"]
        assert dataset.map_size.dtype == np.int64


def test_units_and_provenance(swept):
    found, folder = swept
    assert found.identical(xarray.load_dataset(folder / "sweep.nc"))
    for name, variable in found.items():
        assert variable.attrs["long_name"]
        if variable.dtype != object:
            assert variable.attrs["units"] == (
                "ms" if name.startswith("ms_") else "bytes" if "bytes" in name else "1"
            )
    attrs = found.attrs
    assert attrs["csm"] == csm.__version__
    with csm.Renderer() as renderer:
        assert renderer.info["renderer"] in attrs["driver"]
        assert attrs["driver"].startswith(renderer.info["backend"])
    assert attrs["clock"]
    assert attrs["stage_used"] in ("compute", "fragment")
    assert attrs["stage"] == "auto"
    assert attrs["repeats"] == "1"
    assert json.loads(attrs["base"]) == csm.ShadowSettings().to_dict()
    cases = json.loads(attrs["cases"])
    assert cases["box"]["camera"]["size"] == list(SIZE)
    assert cases["box"]["scene"] == "plane_and_box"
    assert attrs["causes"].split() == ["total", "too_bright", "too_dark"]


def test_both_stages_give_the_same_errors(gl):
    compute, fragment = (
        csm.sweep({"box": BOX}, AXES, stage=stage, **QUICK) for stage in ("compute", "fragment")
    )
    assert fragment.attrs["stage_used"] == "fragment"
    same = [name for name in compute if name.startswith("error_")]
    assert compute[same].drop_attrs().identical(fragment[same].drop_attrs())


def test_causes_are_those_asked_for(gl):
    found = csm.sweep({"box": BOX}, {"map_size": [64]}, causes=["total"], **QUICK)
    assert [name for name in found if name.startswith("error_")] == ["error_total"]
    assert "expected_aliasing" not in found
    with pytest.raises(ValueError, match=r"causes may name total,.*got 'bad luck'"):
        csm.sweep({"box": BOX}, {"map_size": [64]}, causes=["bad luck"])


def test_theory_comes_beside_the_aliasing(gl):
    found = csm.sweep({"box": BOX}, {"map_size": [64]}, causes=["aliasing"], **QUICK)
    scene = csm.scenes.plane_and_box()
    camera, sun = scene.cameras[BOX[1]].replace(size=QUICK["size"]), scene.suns[BOX[2]]
    settings = csm.ShadowSettings(map_size=64)
    outputs = ("mask", "mask_single", "valid", "cascade_index")
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    report = csm.compare(frame, csm.truth(scene, camera, sun))
    assert found.expected_aliasing.item() == report.expected_aliasing > 0.0
    assert found.error_aliasing.item() == report.mean["aliasing"]


def test_a_labelled_axis_changes_several_settings(gl):
    technique = {
        "soft": {"filter": "pcf", "filter_size": 5, "map_size": 64},
        "sharp": {"map_size": [64, 32]},
    }
    found = csm.sweep({"box": BOX}, {"technique": technique}, base=small(), **QUICK)
    assert found.technique.values.tolist() == ["soft", "sharp"]
    one = csm.sweep({"box": BOX}, {"filter_size": [5]}, base=small(filter="pcf"), **QUICK)
    assert found.error_total[0, 0].item() == one.error_total.item()
    assert found.key[0, 0].item() == one.key.item()


def test_sizes_per_cascade_are_texts_on_their_axis(gl):
    found = csm.sweep({"box": BOX}, {"map_size": [64, (64, 32)]}, base=small(), **QUICK)
    assert found.map_size.values.tolist() == ["64", "64,32"]
    assert (found.status == "ok").all()


@pytest.mark.parametrize(
    ("axes", "kinds"),
    [
        ({"rotated": [True, False], "lam": [1, 0.5, 0]}, "bf"),
        ({"map_size": np.array([64, 32]), "manual_depth_range": [()]}, "iO"),
    ],
)
def test_axes_of_every_kind_come_back_from_disk(gl, tmp_path, axes, kinds):
    found = csm.sweep({"box": BOX}, axes, base=small(), out=tmp_path, **QUICK)
    assert found.identical(xarray.load_dataset(tmp_path / "sweep.nc"))
    assert "".join(found[name].dtype.kind for name in axes) == kinds
    assert (found.status == "ok").all()
    for number in range(found.status.size):
        now, stored = csm.repeat_point(tmp_path / "points.csv", number)
        assert now["error_total"] == stored["error_total"]


def test_a_file_is_found_from_another_folder(gl, tmp_path, monkeypatch):
    np.savez(tmp_path / "dem.npz", elevation=np.random.default_rng(1).random((9, 9)), cell=1.0,
             easting0=0.0, northing0=0.0)  # fmt: skip
    monkeypatch.chdir(tmp_path)
    case = ("dem.npz", "eye=4,3,9,target=4,0,-4", "150,20")
    csm.sweep({"dem": case}, {"map_size": [64]}, base=small(), out="out", **QUICK)
    monkeypatch.chdir("/")
    now, stored = csm.repeat_point(tmp_path / "out" / "points.csv", 0)
    assert now["error_total"] == stored["error_total"] > 0


# ------------------------------------------------------------------------------------ what fails


def test_what_fails_is_a_record(gl, tmp_path):
    axes = {"map_size": [64, 65536, 70000], "filter_size": [3, 4]}
    found = csm.sweep({"box": BOX}, axes, base=small(filter="pcf"), out=tmp_path, **QUICK)
    status = found.status.sel(case="box").values
    assert status.tolist() == [["ok", "invalid"], ["failed", "invalid"], ["invalid", "invalid"]]
    message = found.message.sel(case="box").values
    assert "filter_size must be odd" in message[0, 1]
    assert "LimitError" in message[1, 0]
    assert "65536" in message[1, 0]
    assert "map_size must be 1 to 65536" in message[2, 0]
    bad = found.status != "ok"
    for name in ("error_total", "disagreement", "ms_total", "ms_view", "bytes"):
        assert np.isnan(found[name].values[bad.values]).all(), name
        assert np.isfinite(found[name].values[~bad.values]).all(), name
    assert found.identical(xarray.load_dataset(tmp_path / "sweep.nc"))
    assert [line["status"] for line in lines(tmp_path)].count("failed") == 1
    again = csm.sweep({"box": BOX}, axes, base=small(filter="pcf"), out=tmp_path, **QUICK)
    assert len(lines(tmp_path)) == 2, "what failed is not tried again"
    assert without_times(again).identical(without_times(found))


def test_a_frame_without_shadows_is_a_point_like_others(gl):
    causes = ("total", "too_bright", "seam")
    found = csm.sweep({"box": BOX}, {"filter": ["none", "hard"]}, causes=causes, **QUICK)
    assert found.status.values.tolist() == [["ok", "ok"]]
    assert found.error_too_bright.values[0, 0] == found.error_total.values[0, 0] > 0.0
    assert np.isnan(found.error_seam.values[0, 0])


def test_no_column_may_be_an_axis(swept):
    """What a table holds beside errors, times and settings is what axes may not be called."""
    with open(swept[1] / "points.csv", newline="") as file:
        columns = next(csv.reader(file))
    settings = csm.ShadowSettings().to_dict()
    own = {name for name in columns if not name.startswith(TIMES) and name not in settings}
    own -= {"map_size", "filter"} | set(VALUES)
    assert {name for name in own if not name.startswith("error_")} <= set(COLUMNS)


@pytest.mark.parametrize("processes", [1, 2])
def test_groups_are_timed_beside_the_first_settings(gl, monkeypatch, processes):
    monkeypatch.setattr(sweep_runs, "GROUP", 2)
    sizes = [64, 32, 16, 8]
    found = csm.sweep({"box": BOX}, {"map_size": sizes}, processes=processes, **QUICK).isel(case=0)
    beside = found.ms_reference.values
    assert beside[0] == beside[1] == found.ms_total.values[0]
    assert beside[2] == beside[3] > 0.0
    assert beside[2] != beside[0]  # taken anew


def test_what_was_timed_beside_other_settings_has_no_pace(gl, tmp_path):
    """A sweep that goes on with another beginning computes nothing twice, and compares no pace."""
    one = csm.sweep({"box": BOX}, {"map_size": [64, 32]}, out=tmp_path, **QUICK).isel(case=0)
    assert (one.ms_reference.values > 0.0).all()
    two = csm.sweep({"box": BOX}, {"map_size": [16, 64, 32]}, out=tmp_path, **QUICK).isel(case=0)
    assert np.isnan(two.ms_reference.sel(map_size=[64, 32]).values).all()
    assert two.ms_reference.sel(map_size=16).item() == two.ms_total.sel(map_size=16).item()
    assert two.ms_total.sel(map_size=64).item() == one.ms_total.sel(map_size=64).item()


def test_without_the_first_settings_there_is_no_pace(gl, monkeypatch):
    """What cannot be drawn cannot be a measure; the others have their numbers."""
    real = sweep_worker.in_turns

    def broken(jobs, frame_times, **more):
        for job, samples in real(jobs, frame_times, **more):
            yield job, MemoryError("all gone") if job.settings.map_size == 64 else samples

    monkeypatch.setattr(sweep_worker, "in_turns", broken)
    monkeypatch.setattr(sweep_runs, "GROUP", 1)
    found = csm.sweep({"box": BOX}, {"map_size": [64, 32]}, **QUICK).isel(case=0)
    assert found.status.values.tolist() == ["failed", "ok"]
    assert np.isnan(found.ms_reference.values).all()
    assert found.ms_total.values[1] > 0.0


def test_a_render_that_fails_while_it_is_timed_is_a_record(gl, monkeypatch):
    def broken(jobs, frame_times, **_):
        for job in jobs:
            yield job, MemoryError("all gone")

    monkeypatch.setattr(sweep_worker, "in_turns", broken)
    found = csm.sweep({"box": BOX}, {"map_size": [64]}, **QUICK)
    assert found.status.item() == "failed"
    assert found.message.item() == "MemoryError: all gone"


def test_a_truth_that_fails_is_a_record_of_its_case(gl, monkeypatch):
    def failing(scene, camera, *more, **options):
        if camera.near < 0.06:
            raise MemoryError("no room for the tree")
        return csm.truth(scene, camera, *more, **options)

    monkeypatch.setattr(truth_cache, "truth", failing)
    found = csm.sweep({"box": BOX, "foot": CONTACT}, {"map_size": [64]}, **QUICK)
    assert found.status.values.ravel().tolist() == ["ok", "failed"]
    assert "no room for the tree" in found.message.values[1, 0]


def test_a_truth_that_does_not_converge_is_a_record_of_its_case(gl, monkeypatch):
    """One sun of many whose penumbra takes too many rays must not cost the others."""
    monkeypatch.setattr("csm.tracing.MAX_RAYS_PER_PIXEL", 8)
    soft = (BOX[0], BOX[1], ("diagonal", 20.0))
    found = csm.sweep(
        {"soft": soft, "point": (BOX[0], BOX[1], ("diagonal", 0.0))},
        {"map_size": [64, 96]},
        rays_per_pixel=2,
        standard_error=1e-4,
        **QUICK,
    )
    assert found.status.values.tolist() == [["failed", "failed"], ["ok", "ok"]]
    assert "standard_error 0.0001 takes more than 8 rays" in found.message.values[0, 0]
    with pytest.raises(ValueError, match="standard_error needs rays_per_pixel of 2 or more"):
        csm.sweep({"box": BOX}, {"map_size": [64]}, standard_error=0.1, **QUICK)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (({}, AXES), ValueError, "at least one case"),
        (([BOX], AXES), TypeError, "cases must map names"),
        (({"box": BOX[:2]}, AXES), TypeError, r"'box' must be \(scene, camera, sun\)"),
        (({"box": ("nowhere", None, None)}, AXES), ValueError, "'box': scene must be a file"),
        (({"box": (BOX[0], "nowhere", None)}, AXES), ValueError, "'box': camera must be one of"),
        (({"box": (BOX[0], None, 3)}, AXES), TypeError, "'box': sun must be a csm.Sun or a name"),
        (({"box": BOX}, {"map_sise": [1]}), ValueError, "'map_sise' is no setting; there are"),
        (({"box": BOX}, {"map_size": 64}), TypeError, "map_size must be a list of values"),
        (({"box": BOX}, {"filter": "pcf"}), TypeError, "filter must be a list of values"),
        (({"box": BOX}, {"map_size": []}), ValueError, "at least one value"),
        (({"box": BOX}, {"map_size": [64, 64]}), ValueError, "has a value twice"),
        (({"box": BOX}, {"case": [1]}), ValueError, "may not be called 'case'"),
        (({"box": BOX}, {"bytes": {"a": {}}}), ValueError, "may not be called 'bytes'"),
        (({"box": BOX}, {"error_total": {"a": {}}}), ValueError, "may not be called 'error_total'"),
        (({"box": BOX}, {"ms_own": {"a": {}}}), ValueError, "may not be called 'ms_own'"),
        (({"box": BOX}, {"sun": {"a": {}}}), ValueError, "may not be called 'sun'"),
        (({"box": BOX}, {"filter": {"a": {}}}), ValueError, "is a setting, so its values"),
        (
            ({"box": BOX}, {"filter": ["pcf"], "kind": {"a": {"filter": "hard"}}}),
            ValueError,
            "both filter and kind change filter",
        ),
    ],
)
def test_bad_input_is_refused_before_any_work(arguments, error, text, tmp_path, monkeypatch):
    monkeypatch.setattr(sweeps, "run_here", None)
    with pytest.raises(error, match=text):
        csm.sweep(*arguments, out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"repeats": 0}, ValueError, "repeats must be"),
        ({"processes": 0}, ValueError, "processes must be"),
        ({"base": {}}, TypeError, "base must be a csm.ShadowSettings"),
        ({"size": (0, 1)}, ValueError, "size must be"),
        ({"causes": "total"}, TypeError, "causes must be a sequence"),
        ({"backend": "none"}, ValueError, "backend must be one of"),
        ({"rays_per_pixel": 0}, ValueError, "rays_per_pixel must be"),
    ],
)
def test_bad_options_are_refused(options, error, text):
    with pytest.raises(error, match=text):
        csm.sweep({"box": BOX}, {"map_size": [64]}, **options)


def test_a_file_in_the_folders_place_is_refused_before_scenes_load(tmp_path, monkeypatch):
    monkeypatch.setattr(sweeps, "cases_of", None)
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match=r"out .*file: is a file, not a folder"):
        csm.sweep({"box": BOX}, AXES, out=tmp_path / "file")
    with pytest.raises(PermissionError, match="is not a folder"):
        csm.sweep({"box": BOX}, AXES, out=tmp_path / "file" / "deeper")


# ----------------------------------------------------------------------------------- nothing twice


@pytest.fixture
def measured(monkeypatch):
    """The keys that are measured, one entry each time."""
    keys, real = [], sweep_worker._judge

    def counted(renderer, truth, settings, options):
        keys.append(settings)
        return real(renderer, truth, settings, options)

    monkeypatch.setattr(sweep_worker, "_judge", counted)
    return keys


def test_equal_pictures_are_one_piece_of_work(gl, measured):
    # filter_size means nothing to a hard filter: the canonical settings are the same.
    found = csm.sweep({"box": BOX}, {"filter": ["hard"], "filter_size": [3, 5, 7]}, base=small(),
                      **QUICK)  # fmt: skip
    assert len(measured) == 1
    assert np.unique(found.error_total).size == 1
    assert np.unique(found.key).size == 1


def test_resumed_it_computes_what_is_new_alone(gl, tmp_path, measured, monkeypatch):
    traced = []

    def counted(*arguments, **options):
        traced.append(arguments)
        return csm.truth(*arguments, **options)

    monkeypatch.setattr(truth_cache, "truth", counted)
    cases = {"box": BOX, "foot": CONTACT}
    one = csm.sweep(cases, {"map_size": [64]}, out=tmp_path, **QUICK)
    assert (len(measured), len(traced)) == (2, 2)
    two = csm.sweep(cases, {"map_size": [32, 64]}, out=tmp_path, **QUICK)
    assert (len(measured), len(traced)) == (4, 2), "the truths came from disk"
    assert one.ms_total.sel(map_size=64).equals(two.ms_total.sel(map_size=64))
    csm.sweep(cases, {"map_size": [64, 32]}, out=tmp_path, **QUICK)
    assert (len(measured), len(traced)) == (4, 2)
    for changed in ({"repeats": 2}, {"causes": ["total"]}, {"stage": "fragment"},
                    {"rays_per_pixel": 2}, {"size": (48, 31)}):  # fmt: skip
        before = len(measured)
        csm.sweep(cases, {"map_size": [64]}, out=tmp_path, **{**QUICK, **changed})
        assert len(measured) == before + 2, changed
    assert len(lines(tmp_path)) == len(measured)


def test_a_frame_before_does_not_change_a_point(gl, tmp_path, measured):
    """Two views a step apart, of settings that hold what the last frame had."""
    scene = csm.scenes.town(5000)
    view, sun = scene.cameras["street"].replace(size=SIZE), next(iter(scene.suns.values()))
    base = csm.ShadowSettings(map_size=64, split="histogram", fit="visible")
    moved = view.translated((0.0, 0.0, 3.0))
    for first, second in ((view, moved), (moved, view)):
        found = [
            csm.sweep({**before, "b": (scene, second, sun)}, {"lam": [0.5]}, base=base, **QUICK)
            for before in ({}, {"a": (scene, first, sun)})
        ]
        alone, after = (one.error_total.sel(case="b").item() for one in found)
        assert after == alone


def test_the_renderer_is_closed(gl, swept, monkeypatch):
    gc.collect()
    before = set(renderer_module._alive)
    csm.sweep({"box": BOX}, {"map_size": [64]}, **QUICK)
    monkeypatch.setattr(sweep_worker, "_judge", _interrupt)
    with pytest.raises(KeyboardInterrupt):
        csm.sweep({"box": BOX}, {"map_size": [64]}, **QUICK)
    assert all(one._core is None for one in set(renderer_module._alive) - before)


def _interrupt(*_):
    raise KeyboardInterrupt


# ------------------------------------------------------------------------------------- the journal


def test_a_torn_last_line_is_cut_and_its_point_computed_again(gl, tmp_path, measured):
    axes = {"map_size": [32, 64, 128]}
    one = csm.sweep({"box": BOX}, axes, out=tmp_path, **QUICK)
    journal = tmp_path / "journal.jsonl"
    whole = journal.read_bytes()
    for torn in (whole[:-1], whole[: whole.rstrip().rfind(b"\n") + 20]):
        journal.write_bytes(torn)
        before = len(measured)
        again = csm.sweep({"box": BOX}, axes, out=tmp_path, **QUICK)
        assert len(measured) == before + 1
        assert len(lines(tmp_path)) == 3
        assert without_times(again).identical(without_times(one))


def test_a_spoilt_line_is_said(tmp_path):
    path = tmp_path / "journal.jsonl"
    with Journal(path) as journal:
        for key in "ab":
            journal.add(blank_record(key, "ok", ""))
    path.write_text("not json\n[]\n" + path.read_text())
    with pytest.warns(UserWarning, match=r"2 line\(s\) held no record and are removed"):
        journal = Journal(path)
    with journal:
        assert "a" in journal
        assert "b" in journal
        journal.add(blank_record("c", "ok", ""))
        with pytest.raises(BlockingIOError, match="another sweep is writing"):
            Journal(path)
    assert [line["key"] for line in lines(tmp_path)] == ["a", "b", "c"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Journal(path).close()
    assert [one.name for one in tmp_path.iterdir()] == ["journal.jsonl"]


def test_a_journal_that_was_put_in_anothers_place_is_the_one_that_is_held(tmp_path, monkeypatch):
    """Opened just before another sweep wrote it anew: what is held then is nobody's file."""
    path, hold = tmp_path / "journal.jsonl", sweep_journal.fcntl.flock
    path.write_text("no record\n")
    others = []

    def slow(file, how):
        if not others:
            others.append(None)
            with pytest.warns(UserWarning, match="are removed"):
                others[0] = Journal(path)
            others[0].add(blank_record("theirs", "ok", ""))
            others[0].close()
        hold(file, how)

    monkeypatch.setattr(sweep_journal.fcntl, "flock", slow)
    with Journal(path) as journal:
        assert "theirs" in journal
        journal.add(blank_record("ours", "ok", ""))
    assert [line["key"] for line in lines(tmp_path)] == ["theirs", "ours"]


def test_one_sweep_at_a_time_writes_to_a_folder(tmp_path):
    with Journal(tmp_path / "journal.jsonl"):
        with pytest.raises(BlockingIOError, match="another sweep is writing"):
            csm.sweep({"box": BOX}, {"map_size": [64]}, out=tmp_path)


def test_numbers_go_through_the_journal_to_the_bit(tmp_path):
    values = [0.1 + 0.2, 1e-300, 5e-324, float("nan"), float("inf"), 1 / 3]
    record = blank_record("k", "ok", "") | {
        "values": {"errors": {"total": values[0]}},
        "ms": values,
    }
    with Journal(tmp_path / "j") as journal:
        journal.add(record)
        here = journal["k"]
    with Journal(tmp_path / "j") as journal:
        assert journal["k"] == here
    assert here["ms"] == [*values[:3], None, None, values[5]]


def test_what_was_lost_is_tried_again(tmp_path):
    with Journal(tmp_path / "j") as journal:
        journal.add(blank_record("k", "lost", "died"))
        assert "k" not in journal
        journal.add(blank_record("k", "ok", ""))
        assert "k" in journal


# --------------------------------------------------------------------------------------- the table


def test_any_row_repeats_to_the_bit(swept):
    _, folder = swept
    with open(folder / "points.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert set(csm.ShadowSettings().to_dict()) <= set(rows[0])
    for number in (0, 3, 6):
        found, stored = csm.repeat_point(folder / "points.csv", number)
        same = [name for name in found if not name.startswith(TIMES)]
        assert {"error_total", "disagreement", "bytes"} <= set(same)
        assert {name: found[name] for name in same} == {name: stored[name] for name in same}
        assert found["ms_total"] > 0


def test_a_row_of_a_scene_given_as_an_object_needs_it(gl, tmp_path):
    scene = csm.scenes.stairs(5)
    case = (scene, next(iter(scene.cameras.values())), csm.Sun((0.3, 1.0, 0.7), 1.0))
    csm.sweep({"s": case}, {"manual_splits": [(1.5,), (2.5,)]}, out=tmp_path, rays_per_pixel=2,
              base=small(split="manual", manual_splits=(1,)), **QUICK)  # fmt: skip
    table = tmp_path / "points.csv"
    found, stored = csm.repeat_point(table, 1, cases={"s": case})
    assert found["error_total"] == stored["error_total"]
    with pytest.raises(ValueError, match="needs cases= with 's'"):
        csm.repeat_point(table, 1)
    other = (csm.scenes.stairs(6), *case[1:])
    with pytest.raises(ValueError, match="is not the one that was measured"):
        csm.repeat_point(table, 1, cases={"s": other})
    with pytest.raises(ValueError, match="has rows 0 to 1"):
        csm.repeat_point(table, 2)


def test_a_row_without_valid_settings_says_why(gl, tmp_path):
    csm.sweep({"box": BOX}, {"map_size": [0]}, out=tmp_path, **QUICK)
    with pytest.raises(ValueError, match="row 0 has no valid settings: map_size"):
        csm.repeat_point(tmp_path / "points.csv", 0)


# -------------------------------------------------------------------------------------- other hands


def test_a_worker_keeps_one_renderer_and_lets_it_go(gl, monkeypatch):
    monkeypatch.setattr(sweep_worker, "_kept", {})
    (case,) = sweeps.cases_of({"box": BOX}, SIZE)
    options = sweep_worker.Options(("total",), 1, "auto", "auto")
    load = sweep_worker.packed(case, csm.truth(case.scene, case.camera, case.sun))
    assert load.scene is None, "a worker loads what it knows by name"
    jobs = [sweep_worker.Job(name, small(map_size=64)) for name in "ab"]
    first = sweep_worker.run_task(load, jobs[:1], options)
    _, renderer = sweep_worker._kept["renderer"]
    second = sweep_worker.run_task(load, jobs[1:], options)
    assert sweep_worker._kept["renderer"][1] is renderer
    assert first[0]["values"] == second[0]["values"]
    sweep_worker.release()
    assert renderer._core is None
    assert not sweep_worker._kept


def test_a_worker_with_another_csm_or_scene_is_refused(gl, monkeypatch):
    monkeypatch.setattr(sweep_worker, "_kept", {})
    (case,) = sweeps.cases_of({"box": BOX}, SIZE)
    load = sweep_worker.packed(case, csm.truth(case.scene, case.camera, case.sun))
    options = sweep_worker.Options(("total",), 1, "auto", "auto")
    with monkeypatch.context() as patched:
        patched.setattr(sweep_worker, "find_scene", lambda *_: csm.scenes.stairs(3))
        with pytest.raises(RuntimeError, match="finds another scene at 'plane_and_box'"):
            sweep_worker.run_task(load, [], options)
    monkeypatch.setattr(sweep_worker, "code_digest", lambda **_: "other")
    with pytest.raises(RuntimeError, match="has another csm"):
        sweep_worker.run_task(load, [], options)


def test_progress_is_told(gl):
    told = []
    csm.sweep({"box": BOX}, AXES, progress=told.append, **QUICK)
    assert told == [0.25, 0.5, 0.75, 1.0]


def test_tasks_are_cut_in_order():
    jobs = list(range(2 * sweep_runs.GROUP + 1))
    assert [len(group) for group in sweep_runs.groups(jobs)] == [8, 8, 1]
    assert [job for group in sweep_runs.groups(jobs) for job in group] == jobs


# --------------------------------------------------------------------------------------- the manual

MANUAL = Path(__file__).resolve().parents[1] / "docs" / "sweeps.md"


def manual(language):
    return re.findall(rf"^```{language}\n(.*?)^```", MANUAL.read_text(), re.M | re.S)


def test_the_example_of_the_manual_runs(gl, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("csm.timing.MOST", 5)  # on a busy machine it may take all fifty
    example = {}
    exec(manual("python")[0], example)
    found = example["found"]
    assert (found.status == "ok").all()
    assert found.error_total.dims == ("case", "map_size", "filter")
    printed = capsys.readouterr().out
    assert printed.strip().endswith("ms")
    for value in found.error_total.sel(case="street").values.ravel():
        assert f"{value:.6f}" in printed
    assert {path.name for path in Path("results").iterdir()} == {
        "journal.jsonl", "truth", "sweep.nc", "points.csv"
    }  # fmt: skip


def test_the_manual_names_every_variable_and_the_file_is_one(swept, tmp_path):
    found, _ = swept
    named = set(re.findall(r"`([a-z_…<>\d]+)`", MANUAL.read_text()))
    for name in found:
        family = re.sub(r"^error_.*", "error_<cause>", name)
        if family.startswith("ms_") and family != "ms_total":
            family = "ms_…" + family[-3:] if family[-3:] in ("_q1", "_q3") else "ms_<pass>"
        assert family in named, name
    (tmp_path / "sweep.toml").write_text(manual("toml")[0])
    arguments = read_sweep(tmp_path / "sweep.toml")
    assert list(arguments["cases"]) == ["street street", "street roofs"]
    assert sweeps.cases_of(arguments["cases"], arguments["size"])
    assert [axis.labels for axis in sweeps.axes_of(arguments["axes"])] == [
        (256, 512), ("sharp", "soft")
    ]  # fmt: skip
