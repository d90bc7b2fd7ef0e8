"""Flicker: what changes at fixed points, whatever the camera does; planted jitter is found."""

import dataclasses
import pickle

import numpy as np
import pytest

import csm
from csm.disc import SOFT_RAYS, disc_directions
from csm.embree import tree_of
from csm.motion import FlickerReport
from csm.tracing import FACING

pytest.importorskip("embreex", reason="points of surfaces are traced (extra: truth)")

SCENE = csm.scenes.plane_and_box()
SUN = csm.Sun.from_compass(125, 35)
BASE = csm.ShadowSettings(map_size=256, cascade_count=1, view_range="camera")


def camera_at(step, size=(64, 48)):
    return csm.Camera.look_at(
        (-7 + 0.037 * step, 5, 1 - 0.021 * step), (-1, 0.5, -0.7), fov_y_deg=40, near=1, far=30,
        size=size,
    )  # fmt: skip


@pytest.fixture(scope="module")
def surface():
    """Points and normals that the first camera sees facing the sun."""
    truth = csm.truth(SCENE, camera_at(0), SUN)
    seen = truth.valid & truth.facing
    return truth.position[seen], truth.normal[seen]


@dataclasses.dataclass
class FakeFrame:
    """What `flicker` reads of a frame."""

    points: np.ndarray
    point_visibility: np.ndarray
    point_cascade: np.ndarray
    camera: csm.Camera = dataclasses.field(default_factory=lambda: camera_at(0))
    sun: csm.Sun = SUN
    point_normals: np.ndarray = None
    outputs: tuple = ()


def fakes(visibility, cascade, surface, **more):
    points = surface[0][: len(visibility[0])]
    return [
        FakeFrame(points, np.array(v, np.float32), np.array(c, np.uint8), **more)
        for v, c in zip(visibility, cascade, strict=True)
    ]


def test_numbers_of_a_path_counted_by_hand(surface):
    visibility = [[1, 0, 1, 0.5], [1, 1, 0.75, 0.5], [0, 1, 0.75, 0.5]]
    cascade = [[0, 0, 0, 255], [0, 1, 0, 0], [0, 1, 0, 0]]
    report = csm.flicker(fakes(visibility, cascade, surface))
    nan = np.nan
    assert np.array_equal(report.changes, [[0, 1, 0.25, nan], [1, 0, 0, 0]], equal_nan=True)
    assert report.crossed.tolist() == [[False, True, False, False], [False] * 4]
    assert report.mean == pytest.approx(1.25 / 6)
    assert report.transition == 1.0
    assert report.transition_share == pytest.approx(1 / 7)
    assert report.largest == 1.0
    assert report.per_point.tolist() == [0.5, 0.5, 0.125, 0.0]
    assert report.per_step.tolist() == pytest.approx([0.125, 0.25])
    assert report.count == 7
    assert pickle.loads(pickle.dumps(report)).mean == report.mean
    assert "over 7 changes, 14.29% of them between cascades (100.0000%)" in str(report)
    stays = csm.flicker(fakes([[1.0], [0.0]], [[0], [0]], surface))
    assert str(stays) == "flicker 100.0000% over 1 changes, none of them between cascades"


def test_nothing_counted_is_nan_not_zero(surface):
    report = csm.flicker(fakes([[1.0], [0.0]], [[255], [255]], surface))
    for name in ("mean", "transition", "transition_share", "largest"):
        assert np.isnan(getattr(report, name)), name
    assert report.count == 0
    assert str(report).startswith("no point is seen")
    assert np.isnan(report.per_point).all()


def rendered(renderer, surface, cameras, settings, suns=None):
    points, normals = surface
    suns = [SUN] * len(cameras) if suns is None else suns
    return [
        renderer.render(
            SCENE, camera, sun, settings, outputs=("mask", "view_depth"), points=points,
            point_normals=normals,
        )
        for camera, sun in zip(cameras, suns, strict=True)
    ]  # fmt: skip


def test_a_still_camera_has_no_flicker(renderer, surface):
    report = csm.flicker(rendered(renderer, surface, [camera_at(0)] * 3, BASE))
    assert report.mean == 0.0
    assert report.count == 2 * len(surface[0])


def test_whole_texels_do_not_flicker_and_parts_of_them_do(renderer, surface):
    """The window follows the camera: snapped by whole texels, free by parts of them. A free edge of
    w pixels moves at the average by a third of a texel, so it must show."""
    walk = [camera_at(step) for step in range(6)]
    snapped, free = (
        csm.flicker(rendered(renderer, surface, walk, BASE.replace(snap=snap)), scene=SCENE)
        for snap in ("exact", "none")
    )
    assert free.mean > 1e-3
    # a rasteriser rounds corners anew in each window: points whose depth margin is below that
    assert snapped.mean < 0.05 * free.mean
    assert np.isnan(snapped.transition), "one cascade: nothing crosses"


def test_a_true_change_under_a_moving_sun_is_no_flicker(surface):
    """A perfect algorithm: what it says is the truth, for each sun."""
    points, normals = surface
    suns = [csm.Sun.from_compass(125 + 3 * k, 35) for k in range(4)]
    frames = []
    for sun in suns:
        lit = csm.truth(SCENE, camera_at(0), sun).trace(points, normals)
        cascade = np.zeros(len(points), np.uint8)
        frames.append(FakeFrame(points, lit, cascade, sun=sun, point_normals=normals))
    changed = np.mean(np.abs(frames[1].point_visibility - frames[0].point_visibility))
    assert changed > 1e-3, "the sun's path changes nothing here"
    report = csm.flicker(frames, scene=SCENE)
    assert report.mean == 0.0
    # and what comes on top of the true change counts
    jitter = np.random.default_rng(2).random(len(points)) < 0.1
    jitter &= frames[2].point_visibility == frames[1].point_visibility
    frames[2].point_visibility = np.where(
        jitter, 1.0 - frames[2].point_visibility, frames[2].point_visibility
    ).astype(np.float32)
    assert csm.flicker(frames, scene=SCENE).per_step[0] == 0.0
    assert csm.flicker(frames, scene=SCENE).per_step[1] == pytest.approx(jitter.mean(), rel=1e-6)


def soft_path(surface, visibility):
    """Frames of a sun with a disc that moves, over points that say what a function has them say."""
    points, normals = surface
    suns = [csm.Sun.from_compass(125 + 2 * k, 35) for k in range(3)]
    suns = [csm.Sun(sun.to_light, 6.0) for sun in suns]
    cascade = np.zeros(len(points), np.uint8)
    return [
        FakeFrame(points, visibility(sun), cascade, sun=sun, point_normals=normals) for sun in suns
    ]


def test_a_penumbra_that_moves_is_no_flicker(surface):
    """Of a soft truth nothing is left; a hard edge under the same sun jumps and so flickers."""
    points, normals = surface
    seen = np.zeros((48, 64), bool)
    first = csm.truth(SCENE, camera_at(0), SUN)
    seen[first.valid & first.facing] = True

    def soft(sun):
        truth = csm.truth(SCENE, camera_at(0), sun, rays_per_pixel=1024)
        return np.asarray(truth.mask[seen], np.float64)

    frames = soft_path(surface, soft)
    partly = (frames[0].point_visibility > 0.0) & (frames[0].point_visibility < 1.0)
    moved = np.abs(np.diff([frame.point_visibility for frame in frames], axis=0))
    assert np.count_nonzero(partly) > 50
    assert moved.mean() > 5e-3, "the sun's path changes nothing here"
    report = csm.flicker(frames, scene=SCENE)
    # Independent points have an error of half over the root of 64 rays at most, strata less; a
    # change is of two of them, and its positive part has 1 / sqrt(2 pi) of the deviation for mean.
    deviation = np.sqrt(2.0) * 0.5 / np.sqrt(64.0)
    changing = np.count_nonzero(moved > 0.0) / moved.size
    assert report.mean <= changing * deviation / np.sqrt(2.0 * np.pi)
    assert report.largest < 5.0 * deviation
    assert report.mean < 0.1 * moved.mean()

    def hard(sun):
        return csm.truth(SCENE, camera_at(0), sun).trace(points, normals)

    assert csm.flicker(soft_path(surface, hard), scene=SCENE).mean > 10.0 * report.mean


def test_the_same_rays_of_the_disc_leave_nothing_at_all(surface):
    """Traced by hand, a ray at a time, as docs/numerics.md 15 has it."""
    points, normals = surface

    def shares(sun):
        seen = np.zeros(len(points))
        for ray in range(SOFT_RAYS):
            towards = disc_directions(sun, SOFT_RAYS, ray, np.arange(len(points)))
            tree = tree_of(SCENE)
            origins = tree.lifted(points - tree.origin, normals)
            above = np.einsum("mk,mk->m", towards, normals) > FACING
            seen += above & (tree.query(origins, towards) < 0)
        return np.where(normals @ sun.to_light > FACING, seen / SOFT_RAYS, 0.0)

    frames = soft_path(surface, shares)
    assert np.ptp([frame.point_visibility for frame in frames], axis=0).max() > 0.2
    assert csm.flicker(frames, scene=SCENE).largest == 0.0


def test_a_moving_field_of_view_flickers_where_windows_change(renderer, surface):
    zoom = [camera_at(0).replace(size=(64, 48))]
    for fov in (39.0, 38.0, 37.0):
        zoom.append(
            csm.Camera.look_at(
                (-7, 5, 1), (-1, 0.5, -0.7), fov_y_deg=fov, near=1, far=30, size=(64, 48)
            )
        )
    report = csm.flicker(rendered(renderer, surface, zoom, BASE), scene=SCENE)
    assert 0.0 < report.mean < 0.1
    # points at the rim leave the picture
    assert np.isnan(report.changes[-1]).sum() > np.isnan(report.changes[0]).sum()


def test_hidden_points_do_not_count(renderer):
    """Points on the ground behind the box are out of sight; both ways to know agree on them."""
    camera = csm.Camera.look_at(
        (6, 1.2, 0), (0, 1, 0), fov_y_deg=40, near=0.5, far=40, size=(80, 60)
    )
    x = np.linspace(-6, 4, 41)
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    frames = [
        renderer.render(SCENE, camera, SUN, BASE, outputs=("view_depth",), points=points)
        for _ in range(2)
    ]
    by_rays = csm.flicker(frames, scene=SCENE)
    by_depth = csm.flicker(frames)
    shadowed_by_box = (x < 1.0) & (x > -9.0)  # the eye is lower than the box
    seen = np.isfinite(by_rays.changes[0])
    inside = np.isfinite(by_depth.changes[0]) | ~shadowed_by_box
    assert not (seen & shadowed_by_box).any()
    assert seen[~shadowed_by_box & (x < 3.0)].all()
    # beside the foot of the box a pixel may show either
    clear = np.abs(x - 1.0) > 0.3
    assert np.array_equal(seen[clear], np.isfinite(by_depth.changes[0])[clear])
    assert inside.any()


@pytest.mark.parametrize(
    ("frames", "scene", "words"),
    [
        (lambda s: fakes([[1.0]], [[0]], s), None, "two frames"),
        (lambda s: [*fakes([[1.0]], [[0]], s), FakeFrame(None, None, None)], None, "1.*points"),
        (
            lambda s: [*fakes([[1.0]], [[0]], s), *fakes([[1.0, 1.0]], [[0, 0]], s)],
            None,
            "frame 1.*other points",
        ),
        (
            lambda s: [
                *fakes([[1.0]], [[0]], s), *fakes([[1.0]], [[0]], s, sun=csm.Sun((0, 1, 0)))
            ],
            None,
            "sun moves",
        ),
    ],
    ids=["one", "no points", "other points", "moving sun"],
)  # fmt: skip
def test_bad_paths_are_refused(surface, frames, scene, words):
    with pytest.raises(ValueError, match=words):
        csm.flicker(frames(surface), scene=scene)


def test_one_frame_is_no_path(surface):
    (frame,) = fakes([[1.0]], [[0]], surface)
    with pytest.raises(TypeError, match=r"frames must be a sequence .*got one FakeFrame"):
        csm.flicker(frame)


def test_report_is_made_of_arrays():
    report = FlickerReport(np.array([[0.5, np.nan]]), np.array([[False, False]]))
    assert report.mean == 0.5


def test_the_flicker_map_has_points_where_they_were_taken():
    report = FlickerReport(np.array([[0.5, 0.0, 1.0], [0.0, 0.0, 1.0]]), np.zeros((2, 3), bool))
    seen = np.array([[False, True], [True, False], [False, True]])
    picture = report.as_picture(seen)
    np.testing.assert_array_equal(picture, [[np.nan, 0.25], [0.0, np.nan], [np.nan, 1.0]])
    with pytest.raises(ValueError, match=r"seen .* 3 pixels .*2 of them True"):
        report.as_picture(seen[:2])
    with pytest.raises(ValueError, match="seen must be"):
        report.as_picture(seen.astype(int))


def test_a_scene_is_a_scene(surface):
    frames = fakes([[1, 0], [1, 1]], [[0, 0], [0, 0]], surface)
    with pytest.raises(TypeError, match=r"scene must be a csm\.Scene \(got str\)"):
        csm.flicker(frames, scene="town")
