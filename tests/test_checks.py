"""Checks of cascades: every planted defect in its kind and no other, silence on what is sound,
figures against brute force."""

import dataclasses

import numpy as np
import oracles
import pytest
from views import kinds, rescaled_depth, scene_of, shifted, turned, volume_samples

import csm
from csm import spaces

FITS = ["sphere", "box", "diameter", "scene"]
SUN = csm.Sun((0.35, 0.8, 0.25))
CAMERA = csm.Camera.look_at((3, 6, 9), (0, 4, -20), near=0.5, far=120, size=(160, 90))
BOX = csm.ShadowSettings(fit="box", snap="none", map_size=256)
SPHERE = csm.ShadowSettings(fit="sphere", map_size=256)


def path(settings, frames=40, offset=0.0, rng=None, scene=None, camera=CAMERA):
    """A camera that walks and turns, and its cascades."""
    rng = rng or np.random.default_rng(5)
    heading = np.arctan2(*(-camera.backward[[0, 2]]))
    eye, cameras, sets = camera.eye + offset, [], []
    for _ in range(frames):
        heading += rng.normal() * 0.1
        eye = eye + rng.normal(size=3) * [0.3, 0.05, 0.3]
        towards = np.array([np.sin(heading), -0.1, np.cos(heading)])
        cameras.append(
            csm.Camera.look_at(
                (0, 0, 0), towards, near=camera.near, far=camera.far, size=camera.size
            ).translated(eye)
        )
        sets.append(csm.fit_cascades(cameras[-1], SUN, settings, scene=scene))
    return sets, cameras


# -------------------------------------------------------------------------------------------------
# Planted defects


@pytest.mark.parametrize("texels", [0.5, 0.74, -0.5, 187.0])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("offset", [0.0, 1e6], ids=["origin", "map"])
def test_a_map_moved_by_part_of_a_texel_overflows(texels, axis, offset):
    camera = CAMERA.translated((offset, 0, -offset))
    good = csm.fit_cascades(camera, SUN, BOX)
    assert csm.check_cascades(good, camera).ok  # tight to the last digit
    check = csm.check_cascades(shifted(good, 2, texels, axis), camera)
    assert kinds(check) == {"overflow"}
    (problem,) = check.problems
    assert (problem.cascade, problem.frame, problem.unit) == (2, 0, "texels")
    assert problem.amount == pytest.approx(abs(texels), rel=1e-6, abs=1e-4 if offset else 1e-9)
    clip = spaces.transform_points(
        shifted(good, 2, texels, axis).clip_from_world[2], problem.points
    )
    assert np.abs(clip[0, axis]) == pytest.approx(1 + 2 * abs(texels) / 256, rel=1e-6)


def test_a_kernel_needs_its_border():
    good = csm.fit_cascades(CAMERA, SUN, BOX.replace(filter="pcf", filter_size=7))
    assert csm.check_cascades(good, CAMERA, border_texels=3).ok
    check = csm.check_cascades(good, CAMERA, border_texels=4.5)
    assert kinds(check) == {"overflow"}
    assert [p.amount for p in check.problems] == pytest.approx([1.5] * 4, abs=1e-6)


@pytest.mark.parametrize("select", ["map", "frustum"])
def test_what_no_map_holds_is_a_gap(select):
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    bad = shifted(good, 3, 60.0)
    check = csm.check_cascades(bad, CAMERA, select=select)
    assert kinds(check) == {"gap"}
    (problem,) = check.problems
    assert problem.cascade == 3
    assert problem.unit == "texels"
    # Its points lie in the slice and in no map, by the matrices alone.
    points = check.gap_points
    assert len(points) >= 1
    depth = (points - CAMERA.eye) @ -CAMERA.backward
    assert (depth >= bad.splits[3]).all()
    assert (depth <= bad.splits[4]).all()
    for i in range(4):
        clip = spaces.transform_points(bad.clip_from_world[i], points)
        assert (np.abs(clip[:, :2]).max(axis=1) > 1).all()
    # The slice's own corners say how far: what is lost lies outside its own.
    corners = oracles.camera_corners(CAMERA, *bad.splits[3:5])
    outside = np.abs(spaces.transform_points(bad.clip_from_world[3], corners)[:, :2]).max() - 1
    assert problem.amount == pytest.approx(outside * 128, rel=1e-6)


def test_a_near_map_that_is_off_leaves_no_gap_where_a_far_one_holds():
    bad = shifted(csm.fit_cascades(CAMERA, SUN, SPHERE), 0, 40.0)
    assert kinds(csm.check_cascades(bad, CAMERA)) == {"overflow"}
    assert csm.check_cascades(bad, CAMERA, select="map").ok


@pytest.mark.parametrize("select", ["interval", "map"])
def test_a_range_of_two_kilometres_on_a_terrain_of_thirty_six_is_too_short(select):
    scene = scene_of([[-18e3, 0, -18e3], [18e3, 2e3, 18e3]])
    camera = csm.Camera.look_at((0, 3e3, 17e3), (0, 0, -5e3), near=1, far=36e3, size=(16, 9))
    good = csm.fit_cascades(camera, SUN, SPHERE, scene=scene)
    assert csm.check_cascades(good, camera, scene=scene, select=select).ok
    middle = good.depth_range.mean()
    bad = rescaled_depth(good, middle - 1e3, middle + 1e3)
    check = csm.check_cascades(bad, camera, scene=scene, select=select)
    assert kinds(check) == {"depth"}
    assert max(problem.amount for problem in check.problems) > 1e3


def test_a_depth_range_that_cuts_a_slice_says_by_how_much():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    corners = np.concatenate(
        [oracles.camera_corners(CAMERA, *good.splits[i : i + 2]) for i in (3,)]
    )
    depths = -(corners @ good.light_from_world[3, 2, :3])
    bad = rescaled_depth(good, good.depth_range.min(), depths.max() - 1.5)
    check = csm.check_cascades(bad, CAMERA)
    assert kinds(check) == {"depth"}
    worst = max(check.problems, key=lambda problem: problem.amount)
    assert (worst.cascade, worst.unit) == (3, "m")
    assert worst.amount == pytest.approx(1.5, rel=1e-6)


def test_a_caster_above_the_near_end_is_lost():
    scene = scene_of([[-30, 0, -60], [30, 50, 20]])
    good = csm.fit_cascades(CAMERA, SUN, SPHERE, scene=scene)
    # Where columns of the view leave the bounds, by rays from many points of it.
    points = oracles.sample_slice(
        CAMERA, good.splits[0], good.splits[4], 40000, np.random.default_rng(1)
    )
    points = points[((points >= scene.bounds[0]) & (points <= scene.bounds[1])).all(axis=1)]
    speed = np.asarray(SUN.to_light)
    up = ((scene.bounds[1] - points) / speed).min(axis=1)
    highest = (-(points + up[:, None] * speed) @ speed).min()
    sound = rescaled_depth(good, highest - 0.6, good.depth_range.max())
    assert csm.check_cascades(sound, CAMERA, scene=scene).ok
    bad = rescaled_depth(good, highest + 5.0, good.depth_range.max())
    check = csm.check_cascades(bad, CAMERA, scene=scene)
    assert kinds(check) == {"depth"}
    assert "casters" in check.problems[0].text
    # Samples miss the very highest caster by a little.
    worst = max(problem.amount for problem in check.problems)
    assert 5.0 - 1e-9 <= worst <= 5.6
    assert csm.check_cascades(dataclasses.replace(bad, pancake=True), CAMERA, scene=scene).ok


def test_points_beyond_the_last_split_are_gaps():
    # What bounds read back from rounded depths do: the farthest pixels are left out.
    rng = np.random.default_rng(2)
    points = volume_samples(CAMERA, 0.5, 100.0, 4000, rng)
    depth = (points - CAMERA.eye) @ -CAMERA.backward
    settings = SPHERE.replace(view_range="camera")
    camera = CAMERA.replace(far=float(np.quantile(depth, 0.993)))
    cascades = csm.fit_cascades(camera, SUN, settings)
    beyond = depth > camera.far
    for select in ("interval", "map", "frustum"):
        check = csm.check_cascades(cascades, CAMERA, receivers=points, select=select)
        assert kinds(check) == {"gap"}
        (problem,) = check.problems
        assert problem.unit == "share of receivers"
        in_last = depth > cascades.splits[3]
        assert problem.amount == pytest.approx(beyond.sum() / in_last.sum())
        assert csm.check_cascades(cascades, CAMERA, receivers=points[~beyond], select=select).ok


def test_a_radius_that_alternates_changes_the_extent():
    # A radius read back from a float32 matrix: 240.5625 and 240.6875 m in turns, both large enough.
    camera = CAMERA.replace(near=1.0, far=150.0)
    light_from_world = csm.fit_cascades(camera, SUN, SPHERE).light_from_world[0]
    sets, cameras = [], []
    for frame in range(8):
        camera = camera.translated((0.7, 0, -0.2))
        radius = 240.6875 if frame % 2 else 240.5625
        texel = 2 * radius / 1024
        middle = light_from_world[:3, :3] @ (camera.eye - 100.0 * camera.backward)
        corner = np.round(middle[:2] / texel - 512) * texel
        clip_from_light = spaces.ortho_rh_zo(
            corner[0], corner[0] + 2 * radius, corner[1], corner[1] + 2 * radius,
            -1000.0, 1000.0,
        )  # fmt: skip
        clip = (clip_from_light @ light_from_world)[None]
        sets.append(csm.Cascades.from_matrices(clip, (camera.near, camera.far), 1024))
        cameras.append(camera)
    check = csm.check_cascades(sets, cameras)
    assert kinds(check) == {"extent"}
    assert [problem.frame for problem in check.problems] == list(range(1, 8))
    assert [problem.amount for problem in check.problems] == pytest.approx([0.25] * 7)
    assert csm.check_cascades(sets[::2], cameras[::2]).ok


def test_a_map_that_changes_its_size_changes_the_extent():
    sets, cameras = path(SPHERE, frames=4)
    larger = csm.fit_cascades(cameras[2], SUN, SPHERE.replace(map_size=(256, 300, 256, 256)))
    check = csm.check_cascades([sets[0], sets[1], larger, sets[3]], cameras)
    assert kinds(check) == {"extent"}
    assert [(p.frame, p.cascade, p.amount) for p in check.problems] == [(2, 1, 44), (3, 1, 44)]


def test_a_free_window_moves_the_texel_grid():
    sets, cameras = path(SPHERE.replace(snap="none"), frames=10)
    check = csm.check_cascades(sets, cameras)
    assert kinds(check) == {"lattice"}
    for problem in check.problems:
        # Where the world's origin falls within its texel, in the two frames.
        before, after = (
            (spaces.transform_points(one.uvz_from_world[problem.cascade], [[0, 0, 0]]) * 256)[0, :2]
            for one in (sets[problem.frame - 1], sets[problem.frame])
        )
        moved = np.abs(after - before - np.round(after - before)).max()
        assert problem.amount == pytest.approx(moved, abs=1e-6)


def test_one_jump_of_the_grid_is_found_once():
    sets, cameras = path(SPHERE, frames=10)
    sets = [shifted(one, 1, 0.25) if frame >= 6 else one for frame, one in enumerate(sets)]
    check = csm.check_cascades(sets, cameras)
    assert [(p.kind, p.frame, p.cascade) for p in check.problems] == [("lattice", 6, 1)]
    assert check.problems[0].amount == pytest.approx(0.25)


def test_a_grid_that_creeps_is_found():
    sets, cameras = path(SPHERE, frames=100)
    sets = [shifted(one, 0, 1e-4 * frame) for frame, one in enumerate(sets)]
    check = csm.check_cascades(sets, cameras)
    assert kinds(check) == {"lattice"}
    assert check.problems[0].frame == 40  # the first that is 1/256 texel from where it began


def test_a_sun_that_turns_moves_the_grid():
    camera = CAMERA
    suns = [csm.Sun.from_angles(30 + 0.1 * frame, 50) for frame in range(4)]
    sets = [csm.fit_cascades(camera, sun, SPHERE) for sun in suns]
    check = csm.check_cascades(sets, [camera] * 4)
    assert kinds(check) == {"lattice"}
    assert {problem.frame for problem in check.problems} == {1, 2, 3}


def test_a_depth_range_that_moves_freely_under_a_fixed_grid_is_found():
    sets, cameras = path(SPHERE, frames=30)
    assert csm.check_cascades(sets, cameras).ok
    loose = []
    for frame, one in enumerate(sets):
        clip = one.clip_from_world.copy()
        clip[:, 2, 3] -= 3.3e-4 * np.sin(frame)  # of the range: snapped across, not in depth
        loose.append(csm.Cascades.from_matrices(clip, one.splits, one.map_size))
    check = csm.check_cascades(loose, cameras)
    assert kinds(check) == {"depth"}
    assert {problem.unit for problem in check.problems} == {"quanta"}
    # In nearly every step: a shift is whole quanta by chance alone.
    assert len(check.problems) > 0.8 * 29 * 4


@pytest.mark.parametrize("quanta", [65535, 16777215, 16777216])
def test_a_depth_range_that_moves_by_whole_quanta_is_sound(quanta):
    one = csm.fit_cascades(CAMERA, SUN, SPHERE)
    sets = []
    for frame in range(6):
        clip = one.clip_from_world.copy()
        clip[:, 2, 3] -= 7 * frame / quanta
        sets.append(csm.Cascades.from_matrices(clip, one.splits, one.map_size))
    assert csm.check_cascades(sets, [CAMERA] * 6).ok


@pytest.mark.parametrize("clip_z", [(0, 1), (-1, 1), (1, 0)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_lost_casters_are_found_in_maps_of_either_handedness(mirrored, clip_z):
    """A depth range of the slice alone under a world 3 km high."""
    scene = scene_of([[-18000, 0, -18000], [18000, 3000, 18000]])
    settings = SPHERE.replace(depth_range="manual", manual_depth_range=(-90.0, 90.0))
    low = csm.fit_cascades(CAMERA, csm.Sun((0, 1, 0.01)), settings)
    clip = low.clip_from_world.copy()
    near, far = clip_z
    clip[:, 2] = near * clip[:, 3] + (far - near) * clip[:, 2]
    clip[:, 0] *= -1 if mirrored else 1
    foreign = csm.Cascades.from_matrices(clip, low.splits, low.map_size, clip_z=clip_z)
    check = csm.check_cascades(foreign, CAMERA, scene=scene)
    lost = [problem for problem in check.problems if problem.kind == "depth"]
    assert len(lost) == 4
    assert all(2500 < problem.amount < 3100 for problem in lost)


@pytest.mark.parametrize("culprit", range(4))
def test_a_mirrored_map_among_others_is_found(culprit):
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    clip = good.clip_from_world.copy()
    clip[culprit, 0] *= -1
    bad = csm.Cascades.from_matrices(clip, good.splits, good.map_size)
    for select in ("interval", "map"):
        check = csm.check_cascades(bad, CAMERA, select=select)
        assert [(p.kind, p.cascade) for p in check.problems] == [("handedness", culprit)]
        assert "mirrored" in check.problems[0].text


def test_a_reversed_depth_among_others_is_found():
    scene = scene_of([[-30, 0, -60], [30, 50, 20]])
    good = csm.fit_cascades(CAMERA, SUN, SPHERE, scene=scene)
    clip = good.clip_from_world.copy()
    clip[1, 2] = clip[1, 3] - clip[1, 2]
    bad = csm.Cascades.from_matrices(clip, good.splits, good.map_size)
    check = csm.check_cascades(bad, CAMERA, scene=scene)
    assert [(p.kind, p.cascade) for p in check.problems] == [("handedness", 1)]


def test_a_mirrored_light_space_of_ours_is_found():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    light = good.light_from_world.copy()
    light[2, 0] *= -1
    check = csm.check_cascades(dataclasses.replace(good, light_from_world=light), CAMERA)
    assert [(p.kind, p.cascade) for p in check.problems] == [("handedness", 2)]


def test_a_frame_that_turns_mirrored_is_found():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    clip = good.clip_from_world.copy()
    clip[:, 1] *= -1
    flipped = csm.Cascades.from_matrices(clip, good.splits, good.map_size)
    assert csm.check_cascades(flipped, CAMERA).ok  # as good as any other, alone
    check = csm.check_cascades([good, flipped, good], [CAMERA] * 3)
    assert {(p.kind, p.frame) for p in check.problems if p.kind == "handedness"} == {
        ("handedness", 1)
    }


# -------------------------------------------------------------------------------------------------
# Silence on what is sound


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("snap", ["exact", "none"])
def test_our_own_cascades_are_sound(fit, snap):
    rng = np.random.default_rng([FITS.index(fit), len(snap)])
    for trial in range(30):
        offset = rng.normal(size=3) * 10.0 ** rng.integers(0, 8)
        near = 10.0 ** rng.uniform(-4, 0)
        camera = turned(
            rng, fov=rng.choice([0.1, 15, 60, 100, 150]), near=near,
            far=near * 10.0 ** rng.uniform(0.5, 6), eye=offset,
        )  # fmt: skip
        scene = None
        if trial % 3:
            scene = scene_of(offset + np.sort(rng.normal(size=(2, 3)) * 100, axis=0))
        kernel = int(rng.integers(0, 4))
        settings = csm.ShadowSettings(
            fit=fit, snap=snap, cascade_count=int(rng.integers(1, 9)), pancake=bool(trial % 2),
            map_size=int(rng.choice([64, 255, 2048])), filter="pcf" if kernel else "hard",
            filter_size=2 * kernel + 1 if kernel else 3,
        )  # fmt: skip
        sun = csm.Sun(rng.normal(size=3))
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        read = csm.Cascades.from_matrices(
            cascades.clip_from_world, cascades.splits, cascades.map_size, pancake=settings.pancake
        )
        for select in ("interval", "map"):
            for one in (cascades, read):
                check = csm.check_cascades(
                    one, camera, select=select, scene=scene, border_texels=kernel
                )
                assert check.ok, f"{trial}: {check}"


@pytest.mark.parametrize("fit", ["sphere", "diameter"])
@pytest.mark.parametrize("offset", [0.0, 1e4, 1e7])
@pytest.mark.parametrize("bounded", [False, True])
def test_our_own_paths_are_sound(fit, offset, bounded):
    offset = np.array([offset, 0.0, -offset])
    scene = scene_of(np.array([[-200, 0, -200], [200, 30, 200]]) + offset) if bounded else None
    for pancake in (False, True):
        settings = SPHERE.replace(fit=fit, pancake=pancake, view_range="camera")
        sets, cameras = path(settings, frames=60, offset=offset, scene=scene)
        for select in ("interval", "map"):
            check = csm.check_cascades(sets, cameras, select=select, scene=scene)
            assert check.ok, check
        assert check.frame_count == 60


def test_float32_matrices_of_sound_cascades_are_sound():
    sets, cameras = path(SPHERE.replace(map_size=1024), frames=40)
    rounded = [
        csm.Cascades.from_matrices(one.clip_from_world.astype(np.float32), one.splits, 1024)
        for one in sets
    ]
    for one, camera in zip(rounded, cameras, strict=True):
        assert csm.check_cascades(one, camera).ok


def test_an_orthographic_camera_is_checked_too():
    camera = csm.Camera.orthographic((0, 5, 0), (10, 0, -30), height=20, near=-5, far=80)
    settings = csm.ShadowSettings(split="uniform", map_size=128)
    cascades = csm.fit_cascades(camera, SUN, settings)
    assert csm.check_cascades(cascades, camera).ok
    check = csm.check_cascades(shifted(cascades, 1, 50.0), camera)
    assert kinds(check) == {"overflow"}
    # A pixel is 20 / 1080 m everywhere.
    expected = 20 / 1080 / cascades.texel_size[:, 0]
    assert np.allclose(check.texels_per_pixel, expected[:, None], rtol=1e-9)


def test_a_flat_scene_is_a_scene():
    scene = scene_of([[-50, 0, -80], [50, 0, 20]])
    cascades = csm.fit_cascades(CAMERA, SUN, SPHERE, scene=scene)
    for select in ("interval", "map"):
        check = csm.check_cascades(cascades, CAMERA, scene=scene, select=select)
        assert check.ok
        assert (np.diag(check.overlap)[1:] > 0.999).all()
    bad = shifted(cascades, 3, 100.0)
    assert kinds(csm.check_cascades(bad, CAMERA, scene=scene)) == {"overflow"}


def test_a_slice_that_sees_nothing_is_sound():
    scene = scene_of([[-50, 0, -8], [50, 5, 20]])
    settings = SPHERE.replace(view_range="camera")
    cascades = csm.fit_cascades(CAMERA, SUN, settings, scene=scene)
    check = csm.check_cascades(shifted(cascades, 3, 500.0), CAMERA, scene=scene)
    assert check.ok
    assert check.utilisation[3] == 0
    assert np.isnan(check.texels_per_pixel[3]).all()
    assert "nothing visible" in str(check)


def test_a_path_takes_receivers_for_all_frames_or_for_each():
    sets, cameras = path(SPHERE, frames=3)
    points = [oracles.sample_slice(c, 0.5, 100, 50, np.random.default_rng(3)) for c in cameras]
    each = csm.check_cascades(sets, cameras, receivers=points)
    fixed = csm.check_cascades(sets, cameras, receivers=points[1])
    assert each.ok
    assert fixed.ok
    alone = csm.check_cascades(sets[1], cameras[1], receivers=points[1])
    assert (fixed.utilisation <= alone.utilisation + 1e-12).all()


# -------------------------------------------------------------------------------------------------
# What people see


def test_a_check_prints_as_a_table():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    check = csm.check_cascades(good, CAMERA)
    assert repr(check) == "CascadeCheck(ok; cascades=4, frames=1)"
    lines = str(check).splitlines()
    assert lines[0] == "4 cascades, 1 frame, select interval: sound"
    assert len(lines) == 7
    bad = csm.check_cascades(shifted(good, 2, 90.0), CAMERA)
    assert repr(bad) == "CascadeCheck(1 problem: overflow; cascades=4, frames=1)"
    assert "overflow: cascade 2\n  part of slice 2 (" in str(bad)
    assert bad.kinds == ("overflow",)
    sets, cameras = path(SPHERE.replace(snap="none"), frames=5)
    text = str(csm.check_cascades(sets, cameras))
    assert "lattice: cascade 0, 4 of 5 frames, worst in " in text


def test_bad_arguments_are_refused_by_name():
    good = csm.fit_cascades(CAMERA, SUN, SPHERE)
    fewer = csm.fit_cascades(CAMERA, SUN, SPHERE.replace(cascade_count=2))
    cases = [
        (TypeError, "cascades must be", (None, CAMERA), {}),
        (TypeError, "camera must be", (good, SUN), {}),
        (ValueError, "one camera for each", ([good, good], CAMERA), {}),
        (ValueError, "one at least", ([], []), {}),
        (ValueError, "as many cascades", ([good, fewer], [CAMERA] * 2), {}),
        (ValueError, "select must be one of", (good, CAMERA), {"select": "depth"}),
        (ValueError, "border_texels must be", (good, CAMERA), {"border_texels": -1}),
        (ValueError, "border_texels must be less", (good, CAMERA), {"border_texels": 128}),
        (TypeError, "scene must be", (good, CAMERA), {"scene": 3}),
        (ValueError, "receivers must be", (good, CAMERA), {"receivers": np.zeros((4, 2))}),
        (ValueError, "receivers must be finite", (good, CAMERA), {"receivers": [[np.nan] * 3]}),
    ]
    for error, match, arguments, options in cases:
        with pytest.raises(error, match=match):
            csm.check_cascades(*arguments, **options)
