"""Truths on disk: read as they were traced, traced again when anything is another."""

import threading

import numpy as np
import pytest

pytest.importorskip("embreex", reason="csm.truth needs embreex")

import csm
from csm import digests, truth_cache
from csm.truth_cache import cached_truth, truth_arrays, truth_from_arrays

SUN = csm.Sun((1.0, 1.0, 0.3), 2.0)


@pytest.fixture(scope="module")
def scene():
    return csm.scenes.plane_and_box()


@pytest.fixture(scope="module")
def camera(scene):
    return scene.cameras["corner"].replace(size=(32, 24))


@pytest.fixture
def traced(monkeypatch):
    """The calls of `csm.truth` by the cache."""
    calls = []

    def counted(*arguments, **options):
        calls.append(arguments)
        return csm.truth(*arguments, **options)

    monkeypatch.setattr(truth_cache, "truth", counted)
    return calls


def equal(one, other):
    first, second = truth_arrays(one), truth_arrays(other)
    return first.keys() == second.keys() and all(
        first[name].dtype == second[name].dtype and first[name].tobytes() == second[name].tobytes()
        for name in first
    )


@pytest.mark.parametrize("rays", [1, 4])
def test_read_as_traced(scene, camera, tmp_path, traced, rays):
    one = cached_truth(scene, camera, SUN, tmp_path / "truth", rays_per_pixel=rays)
    other = cached_truth(scene, camera, SUN, tmp_path / "truth", rays_per_pixel=rays)
    assert len(traced) == 1
    assert equal(one, other)
    assert equal(other, csm.truth(scene, camera, SUN, rays_per_pixel=rays))
    assert np.shares_memory(other.mask, other.mask_point) == (rays == 1)
    assert type(other.rays_per_pixel) is int
    assert other.scene is scene
    seen = other.valid
    again = other.trace(other.position[seen], other.normal[seen])
    assert np.array_equal(again, other.mask_point[seen])
    (file,) = (tmp_path / "truth").iterdir()
    assert file.suffix == ".npz"


def test_anything_else_is_traced_anew(scene, camera, tmp_path, traced):
    moved = csm.Scene(scene.meshes, scene.instance_mesh,
                      np.array(scene.world_from_instance) + 1e-12 * np.eye(4, k=3))  # fmt: skip
    calls = [
        (scene, camera, SUN, {}),
        (moved, camera, SUN, {}),
        (scene, camera.replace(near=0.11), SUN, {}),
        (scene, camera, csm.Sun((1.0, 1.0, np.nextafter(0.3, 1)), 2.0), {}),
        (scene, camera, SUN, {"rays_per_pixel": 2}),
        (scene, camera, csm.Sun(SUN.to_light, 2.1), {"rays_per_pixel": 2}),
        (scene, camera, SUN, {"rays_per_pixel": 2, "standard_error": 0.3}),
    ]
    for number, (*what, options) in enumerate(calls, 1):
        cached_truth(*what, tmp_path, **options)
        assert len(traced) == number
    for *what, options in calls:
        cached_truth(*what, tmp_path, **options)
    assert len(traced) == len(calls)


def test_names_do_not_count(scene, camera, tmp_path, traced):
    cached_truth(scene, camera, SUN, tmp_path)
    cached_truth(scene.replace(name="other", cameras={}), camera, SUN, tmp_path)
    assert len(traced) == 1


def test_a_file_that_is_not_whole_is_made_again(scene, camera, tmp_path, traced):
    one = cached_truth(scene, camera, SUN, tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    for broken in (b"", whole[: len(whole) // 2], b"no zip at all"):
        file.write_bytes(broken)
        assert equal(cached_truth(scene, camera, SUN, tmp_path), one)
        assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert len(traced) == 4


def test_writers_at_once_leave_one_whole_file(scene, camera, tmp_path, traced):
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(cached_truth(scene, camera, SUN, tmp_path)))
        for _ in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
    assert all(equal(found[0], one) for one in found)
    assert len(list(tmp_path.iterdir())) == 1
    before = len(traced)
    cached_truth(scene, camera, SUN, tmp_path)
    assert len(traced) == before


def test_without_a_folder_nothing_is_kept(scene, camera, traced):
    assert equal(cached_truth(scene, camera, SUN), cached_truth(scene, camera, SUN))
    assert len(traced) == 2


def test_arrays_go_to_another_process(scene, camera):
    one = csm.truth(scene, camera, SUN, rays_per_pixel=3)
    assert equal(truth_from_arrays(truth_arrays(one), scene, camera, SUN), one)


def test_a_cut_out_is_part_of_the_scene():
    corners, triangles = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    uv = [[0, 0], [1, 0], [0, 1]]
    alphas = [None, np.zeros((2, 2), np.uint8), np.full((2, 2), 255, np.uint8)]
    scenes = [
        csm.Scene([csm.Mesh(corners, triangles, uv=None if a is None else uv, alpha=a)])
        for a in alphas
    ]
    assert len({digests.scene_digest(one) for one in scenes}) == 3


# -------------------------------------------------------------------------------------- digests


def test_digests_tell_values_apart():
    values = [
        None, True, 1, 1.0, "1", b"1", (), ("",), {}, {"1": 1}, (1, (2, 3)), ((1, 2), 3),
        ("ab", "c"), ("a", "bc"), 0.1 + 0.2, 0.3, 0.0, -0.0, np.zeros(2), np.zeros((2, 1)),
        np.zeros(2, np.float32), np.zeros(2, np.int64), np.zeros(3),
    ]  # fmt: skip
    assert len({digests.digest(value) for value in values}) == len(values)


def test_a_digest_is_of_values_not_of_how_they_lie():
    table = np.arange(12.0).reshape(3, 4)
    assert digests.digest(table.T) == digests.digest(np.ascontiguousarray(table.T))
    assert digests.digest({"a": 1, "b": 2}) == digests.digest({"b": 2, "a": 1})
    assert digests.digest([1, 2]) == digests.digest((1, 2))
    with pytest.raises(TypeError, match="no digest"):
        digests.digest(np.array(["a"]))


def test_a_digest_is_the_same_in_every_process():
    # 20 digits of SHA-256 over what `_feed` says: a change of these forgets every journal.
    assert digests.digest({"a": (1, 2.5, None)}, "b") == digests.digest({"a": [1, 2.5, None]}, "b")
    assert len(digests.digest("")) == 20
    assert digests.code_digest() != digests.code_digest(compiled=False)


def test_a_folder_in_a_truths_place_is_said(scene, camera, tmp_path, traced):
    cached_truth(scene, camera, SUN, tmp_path)
    (file,) = tmp_path.iterdir()
    file.unlink()
    file.mkdir()
    with pytest.raises(IsADirectoryError, match=rf"{file}: a folder is where a result"):
        cached_truth(scene, camera, SUN, tmp_path)
    assert len(traced) == 1, "refused before it is traced"
