"""Exclusive culling: a coarse map leaves out what lies under finer windows, and no mask changes."""

import drawings
import numpy as np
import pytest

import csm
from csm import _core, shapes, spaces

CULLS = ("none", "inclusive", "exclusive")
FITS = {row["name"]: row["choices"] for row in _core.effect_table()}["fit"].split()
FITS = {fit: {"fit": fit} for fit in FITS}
FITS["visible, turned"] = {"fit": "visible", "turned": True}
# Kernels 0 to 15: hard, the hardware's 2 x 2, odd ones of every reach.
KERNELS = {
    0: {"filter": "hard"},
    1: {"filter": "pcf", "filter_size": 3},
    2: {"filter": "pcf", "filter_size": 2},
    7: {"filter": "pcf", "filter_size": 15},
    15: {"filter": "pcf", "filter_size": 31},
}


def ball(centre, radius):
    """(positions, triangles) of a sphere."""
    rows, columns = 6, 10
    polar = np.pi * (np.arange(1, rows) / rows)[:, None]
    turn = 2 * np.pi * np.arange(columns) / columns
    ring = np.stack(
        [np.sin(polar) * np.cos(turn), np.cos(polar) + 0 * turn, np.sin(polar) * np.sin(turn)],
        axis=-1,
    )
    points = np.concatenate([[[0, 1, 0]], ring.reshape(-1, 3), [[0, -1, 0]]])
    grid = 1 + np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    right = np.roll(grid, -1, axis=1)
    quads = [
        np.stack([grid[:-1], grid[1:], right[:-1]], axis=-1).reshape(-1, 3),
        np.stack([right[:-1], grid[1:], right[1:]], axis=-1).reshape(-1, 3),
        np.stack([np.zeros(columns, int), grid[0], right[0]], axis=-1),
        np.stack([np.full(columns, len(points) - 1), right[-1], grid[-1]], axis=-1),
    ]
    return centre + radius * points, np.concatenate(quads)


def box(centre, half):
    """(positions, triangles)."""
    corners = np.stack(np.meshgrid(*[(-1, 1)] * 3, indexing="ij"), axis=-1).reshape(8, 3)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [(a, b, c) for a, b, c, _ in faces] + [(a, c, d) for a, _, c, d in faces]
    return centre + half * corners, np.array(triangles)


def random_case(number):
    """A scene of boxes and spheres, each a mesh of its own so that it is culled by itself, with one
    behind the eye, one far up the light, and one round everything; a camera and a sun."""
    rng = np.random.default_rng(1000 + number)
    eye = rng.uniform((-8, 0.5, -8), (8, 5, 8))
    target = eye + rng.normal(size=3) * (1, 0.35, 1)
    camera = csm.Camera.look_at(eye, target, fov_y_deg=55, near=0.1, far=60, size=(64, 36))
    to_light = rng.normal(size=3)
    to_light[1] = abs(to_light[1]) * rng.choice([0.1, 1.0, 4.0]) + 0.05
    sun = csm.Sun(to_light)
    parts = [box(np.zeros(3), np.array([40.0, 0.01, 40.0]))]
    for i in range(40):
        centre = rng.uniform((-25, 0.2, -25), (25, 6, 25))
        size = 10.0 ** rng.uniform(-1.2, 0.4)
        parts.append(ball(centre, size) if i % 2 else box(centre, size * rng.uniform(0.2, 1, 3)))
    parts.append(box(eye + 1.5 * camera.backward, 0.4 * np.ones(3)))
    parts.append(ball(eye - 6 * camera.backward + 35 * sun.to_light, 1.0))
    if number % 4 == 0:
        parts.append(ball(eye, 55.0))  # encloses the frustum: all is in its shadow
    meshes = [shapes.mesh(f"part {i}", part) for i, part in enumerate(parts)]
    scene = csm.Scene(meshes, list(range(len(meshes))), np.repeat(np.eye(4)[None], len(meshes), 0))
    return scene, camera, sun, rng


def assert_masks_equal(figure, renderer, scene, camera, sun, settings, what):
    """Frames of none, inclusive, exclusive; masks, indices and points equal to the bit."""
    rng = np.random.default_rng(5)
    points = rng.uniform(*scene.bounds, size=(300, 3))  # also outside the picture
    frames = [
        renderer.render(
            scene, camera, sun, settings.replace(cull=cull), points=given,
            outputs=("mask", "cascade_index"),
        )
        for given in (None, points)
        for cull in CULLS
    ]  # fmt: skip
    for full, *culled in (frames[:3], frames[3:]):
        for frame in culled:
            differing = np.count_nonzero(frame.mask != full.mask)
            if frame.outputs[-1] == "point_cascade":
                differing += np.count_nonzero(frame.point_visibility != full.point_visibility)
                assert np.array_equal(frame.point_cascade, full.point_cascade)
            assert np.array_equal(frame.cascade_index, full.cascade_index)
            figure(
                "G1", what, differing, 0, "pixels and points",
                picture=lambda a=full.mask, b=frame.mask: drawings.compared(a, b),
            )  # fmt: skip
    return frames


@pytest.mark.parametrize(
    "scenes", [12, pytest.param(100, marks=pytest.mark.slow)], ids=["12", "100"]
)
def test_g1_masks_of_random_scenes_are_equal_to_the_bit(figure, renderer, scenes):
    dropped = 0
    for number in range(scenes):
        scene, camera, sun, rng = random_case(number)
        settings = csm.ShadowSettings(
            map_size=(256, 128, 200, 64) if number % 3 == 2 else 128,
            select=str(rng.choice(["map", "frustum", "interval"])),
            snap=str(rng.choice(["exact", "none"])),
            lam=float(rng.choice([0.3, 0.8])),
            **list(KERNELS.values())[number % len(KERNELS)],
        )
        if number % 5 == 4:
            settings = settings.replace(bias="manual", normal_offset_texels=3.0)
        frames = assert_masks_equal(
            figure, renderer, scene, camera, sun, settings, "masks of random scenes"
        )
        dropped += sum(frames[2].info["chunks_culled_exclusive"])
    assert dropped > 10 * scenes  # so that the equality says something


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("select", ["map", "frustum", "interval"])
def test_g1_masks_are_equal_under_every_fit_and_selection(figure, renderer, fit, select):
    scene, camera, sun, _ = random_case(1)
    settings = csm.ShadowSettings(map_size=128, select=select, **FITS[fit], **KERNELS[1])
    frames = assert_masks_equal(
        figure, renderer, scene, camera, sun, settings, "masks under every fit"
    )
    dropped = sum(frames[2].info["chunks_culled_exclusive"])
    if select == "interval":
        assert dropped == 0
    elif not fit.startswith("visible"):  # windows round what each slice shows overlap too little
        assert dropped > 0


@pytest.mark.parametrize(
    "changes",
    [
        {"pancake": True},
        {"depth_range": "window"},
        {"depth_range": "manual", "manual_depth_range": (-30.0, 12.0)},
        {"light_basis": "world"},
        {"light_basis": "transported"},
        {"warp": "lispsm"},
        {"warp": "psm"},
        {"warp": "tsm"},
        {"max_distance": 12.0},
        {"snap": "approximate"},
        {"depth_format": "d16"},
        {"bias": "manual", "normal_offset_texels": 8.0},
        {"bias": "manual", "normal_offset_texels": -8.0},
        {"texcoord": "interpolated"},
    ],
    ids=lambda changes: " ".join(f"{k}={v}" for k, v in changes.items()),
)
def test_g1_masks_are_equal_under_what_narrows_a_map(figure, renderer, changes):
    # each of these may leave a finer window without an answer for part of its rectangle
    for number in (2, 4):
        scene, camera, sun, _ = random_case(number)
        settings = csm.ShadowSettings(map_size=128, **KERNELS[7], **changes)
        assert_masks_equal(
            figure, renderer, scene, camera, sun, settings, "masks under narrow maps"
        )


@pytest.mark.parametrize(
    "changes",
    [
        {"select": "interval"},
        {"pancake": True},
        {"depth_range": "window"},
        {"warp": "lispsm"},
        {"cascade_count": 1},
    ],
    ids=lambda changes: " ".join(f"{k}={v}" for k, v in changes.items()),
)
def test_where_a_window_does_not_answer_alone_exclusive_is_inclusive(changes):
    settings = csm.ShadowSettings(cull="exclusive", **changes)
    assert settings.canonical().cull == "inclusive"
    assert csm.ShadowSettings(cull="exclusive").canonical().cull == "exclusive"


# -- against the rule itself -----------------------------------------------------------------------


class _Scene:
    bounds = np.array([[-60.0, 0.0, -60.0], [60.0, 25.0, 60.0]])


def place(camera_seed, padding):
    rng = np.random.default_rng(camera_seed)
    eye = rng.uniform(*_Scene.bounds) * (0.7, 0.5, 0.7) + (0, 0.5, 0)
    camera = csm.Camera.look_at(
        eye, eye + rng.normal(size=3) * (1, 0.3, 1), fov_y_deg=60, near=0.2, far=200, size=(16, 9)
    )
    sun = csm.Sun(rng.normal(size=3) * (1, 0.2, 1) + (0, 0.8, 0))
    settings = csm.ShadowSettings(
        map_size=(512, 256, 256, 128), cull="exclusive",
        filter="pcf" if padding else "hard", filter_size=max(2 * padding + 1, 3),
    )  # fmt: skip
    return camera, sun, settings, csm.fit_cascades(camera, sun, settings, scene=_Scene), rng


def first_map(cascades, points, border):
    """Index of the first map that holds each point, `border` texels kept free; count: none."""
    index = np.full(len(points), cascades.count)
    for i in reversed(range(cascades.count)):
        uvz = spaces.transform_points(cascades.uvz_from_world[i], points)
        texels = uvz[:, :2] * cascades.map_size[i]
        held = (texels > border).all(axis=1) & (texels < cascades.map_size[i] - border).all(axis=1)
        index[held] = i
    return index


@pytest.mark.parametrize("scenes", [8, pytest.param(100, marks=pytest.mark.slow)], ids=["8", "100"])
@pytest.mark.parametrize("padding", [0, 1, 7, 15])
def test_g1_no_caster_over_a_lookup_is_dropped(figure, scenes, padding):
    """A speck anywhere up the light from any texel that a lookup in map i may fetch is kept, where
    the receiver, in or out of the picture, is one whose first map is i."""
    dropped = checked = 0
    for seed in range(scenes):
        camera, sun, settings, cascades, rng = place(seed, padding)
        points = rng.uniform(*_Scene.bounds, size=(30_000, 3))
        index = first_map(cascades, points, padding)
        for i in range(1, cascades.count):
            light = cascades.light_from_world[i][:2, :3]
            own = points[index == i]
            reach = (padding + 1.0) * cascades.texel_size[i]  # to the far side of the last texel
            lookups = own + (rng.choice([-1.0, 1.0], size=(len(own), 2)) * reach) @ light
            above = lookups + rng.uniform(0, 80, size=(len(own), 1)) * sun.to_light
            specks = np.concatenate([above - 1e-9, above + 1e-9], axis=1)
            kept = _core.cull_boxes(
                camera, sun.to_light, settings, _Scene.bounds, specks, i,
                margin_texels=padding + 1.0, whole_window=True, border_texels=padding + 1.0,
            )  # fmt: skip
            held = _core.cull_boxes(
                camera, sun.to_light, settings, _Scene.bounds, specks, i,
                margin_texels=padding + 1.0, whole_window=True,
            )  # fmt: skip
            dropped += len(held) - len(kept)
            checked += len(held)
    assert checked > 300 * scenes
    figure("G1", f"specks over lookups dropped, kernel {padding}", dropped, 0, "specks")


def test_what_lies_under_a_finer_window_is_dropped_and_nothing_else():
    # Under an overhead sun a box is dropped from map i if it keeps its distance from the rim of a
    # finer window: two texels of map i (the margin given and one more), one of the finer map.
    camera, settings = (
        csm.Camera.look_at((0, 5, 0), (1, 5, 0), fov_y_deg=50, near=1, far=41, size=(9, 9)),
        csm.ShadowSettings(cascade_count=3, map_size=64, view_range="camera", cull="exclusive"),
    )
    sun = csm.Sun((0, 1, 0))
    cascades = csm.fit_cascades(camera, sun, settings, scene=_Scene)
    light = cascades.light_from_world[0][:3, :3]
    for i in (1, 2):
        for finer in range(i):
            low = cascades.lattice[finer] * cascades.texel_size[finer]
            high = low + 64 * cascades.texel_size[finer]
            margin = 2 * cascades.texel_size[i].max() + cascades.texel_size[finer]
            assert (high - low > 2 * margin).all()
            for slack, expected in ((0.01, False), (-0.01, True)):
                ends = np.stack([low + margin + slack, high - margin - slack])
                corners = np.array([[*ends[0], 0.0], [*ends[1], 9.0]]) @ light
                bounds = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
                bounds[[1, 4]] = 6.0, 9.0
                kept = _core.cull_boxes(
                    camera, sun.to_light, settings, _Scene.bounds, bounds[None], i,
                    margin_texels=1.0, whole_window=True, border_texels=1.0,
                )  # fmt: skip
                # a coarser of two finer windows may hold what the finest does not
                others = [j for j in range(i) if j > finer]
                assert bool(len(kept)) == expected or (expected and others)


def test_counts_of_a_frame_add_up(renderer):
    scene, camera, sun, _ = random_case(3)
    frames = {
        cull: renderer.render(scene, camera, sun, csm.ShadowSettings(map_size=128, cull=cull)).info
        for cull in CULLS
    }
    for info in frames.values():
        assert [info["chunks"] - drawn for drawn in info["chunks_drawn"]] == info["chunks_culled"]
    inclusive, exclusive = frames["inclusive"], frames["exclusive"]
    assert not any(frames["none"]["chunks_culled"])
    assert not any(inclusive["chunks_culled_exclusive"])
    more = np.subtract(exclusive["chunks_culled"], inclusive["chunks_culled"])
    assert exclusive["chunks_culled_exclusive"] == more.tolist()
    assert more[0] == 0  # nothing is finer than the first
    assert (more[1:] > 0).any()
    drawn = [sum(info["triangles_drawn"]) for info in (exclusive, inclusive, frames["none"])]
    assert drawn == sorted(drawn)
    assert len(set(drawn)) == 3
