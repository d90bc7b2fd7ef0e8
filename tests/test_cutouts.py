"""Meshes with cut-outs (docs/numerics.md 26): maps, what the camera sees, and the truth."""

import gc
import pickle
import re
import sys

import cutout_scenes
import numpy as np
import pytest
from cutout_scenes import CHECKER, QUAD_UV, level, on_ground, solid

import csm
from csm import _core, embree, shapes
from csm.metrics import edge_yardstick

SIZE = (160, 90)
SUN = csm.Sun((0.4, 1.0, 0.3))
SMALL = csm.ShadowSettings(map_size=256)
IMAGES = ("mask", "valid", "view_depth", "cascade_index", "normal")
WAYS = {
    "default": {},
    "pcf": {"filter": "pcf", "filter_size": 5},
    "16 bits, two maps": {"depth_format": "d16", "cascade_count": 2},
    "lispsm": {"warp": "lispsm"},
    "psm": {"warp": "psm"},
    "forward": {"texcoord": "interpolated"},
    "visible, sdsm, turned": {"fit": "visible", "split": "sdsm", "turned": True},
    "pancaked, exclusive": {"pancake": True, "cull": "exclusive"},
    "eight maps of their own, forward": {
        "storage": "separate",
        "cascade_count": 8,
        "texcoord": "interpolated",
    },
    "atlas, copied": {"storage": "atlas", "copied_tiles": True},
    "reversed depth, warp": {"reversed_depth": True, "warp": "tsm"},
    "moments of samples": {"filter": "vsm", "samples": 4},
    "no shadows": {"filter": "none"},
}


def view(size=SIZE):
    return csm.Camera.look_at((5, 6, 8), (0, 1, 0), near=0.2, far=60, size=size)


def from_below(height, size=(400, 400), eye=2.0):
    """Parallel rays down onto the ground from under what hangs over it."""
    return csm.Camera.orthographic(
        (0, eye, 0), (0, 0, 0), up=(0, 0, -1), height=height, near=0.1, far=9, size=size
    )


# ------------------------------------------------------------------------------------ the mesh


def test_a_mesh_keeps_what_it_is_given_read_only():
    uv, alpha = QUAD_UV.copy(), CHECKER.copy()
    mesh = level(uv=uv, alpha=alpha, cutoff=0.25)
    uv[:], alpha[:] = 9, 9
    assert mesh.uv.tolist() == QUAD_UV.tolist()
    assert (mesh.alpha == CHECKER).all()
    assert (mesh.uv.dtype, mesh.alpha.dtype, mesh.alpha_cutoff) == (np.float64, np.uint8, 0.25)
    assert level(alpha=np.ones((2, 3))).alpha.dtype == np.float32
    for again in (mesh, mesh.posed(mesh.positions + 1), pickle.loads(pickle.dumps(mesh))):
        assert not again.uv.flags.writeable
        assert not again.alpha.flags.writeable
        assert again.uv.tolist() == QUAD_UV.tolist()
        assert again.alpha_cutoff == 0.25
    plain = solid(mesh)
    assert (plain.uv, plain.alpha, plain.alpha_cutoff) == (None, None, 0.5)
    assert level(uv=None, alpha=None, cutoff=0.3).alpha_cutoff == 0.5
    assert "cut-out" in repr(mesh)
    assert "cut-out" not in repr(plain)


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"uv": None}, ValueError, "uv and alpha of mesh 'level' must come together .got no uv"),
        ({"alpha": None}, ValueError, "must come together .got no alpha"),
        ({"uv": QUAD_UV[:3]}, ValueError, r"must be \(4, 2\), a row per position .*\(3, 2\)"),
        ({"uv": QUAD_UV * [np.nan, 1]}, ValueError, r"uv .* must be finite .vertex 0 is \[nan"),
        ({"uv": QUAD_UV * 1e6}, ValueError, "at most 1048576 texels of alpha, 8 x 8 .got 8000000"),
        ({"uv": "no"}, TypeError, "uv of mesh 'level' must be an array of real numbers"),
        ({"alpha": CHECKER[0]}, ValueError, r"alpha .* must be \(h, w\), 1 to 16384 .*\(8,\)"),
        ({"alpha": np.zeros((2, 0))}, ValueError, "1 to 16384 texels each way"),
        ({"alpha": np.zeros((1, 16385), np.uint8)}, ValueError, "1 to 16384 texels each way"),
        ({"alpha": CHECKER.astype(int)}, TypeError, "must be floats or uint8 .got dtype int64"),
        ({"alpha": CHECKER * 1.0}, ValueError, "must be 0 to 1 everywhere .got 0 to 255"),
        ({"alpha": np.full((2, 2), np.nan)}, ValueError, "must be 0 to 1 everywhere"),
        ({"cutoff": -0.1}, ValueError, "alpha_cutoff of mesh 'level' must be"),
        ({"cutoff": "half"}, TypeError, "alpha_cutoff of mesh 'level' must be"),
    ],
)
def test_a_mesh_refuses(changes, error, text):
    with pytest.raises(error, match=text):
        level(**changes)


@pytest.mark.parametrize(
    ("mesh", "text"),
    [
        ((QUAD_UV[:3], CHECKER > 0), "uv and positions must have the same length"),
        ((np.full((4, 2), np.inf), CHECKER > 0), "texture coordinates of mesh 0 must be finite"),
        ((QUAD_UV * 1e6, CHECKER > 0), "of mesh 0 must span at most 1048576 texels .got 8000000"),
        ((QUAD_UV, np.ones((1, 20000), bool)), "a cut-out may have 16384 x 16384 texels"),
        ((QUAD_UV, np.ones((0, 4), bool)), "the cut-out of mesh 0 must be 1 to 16384 texels"),
    ],
)
def test_the_core_refuses_what_a_mesh_refuses(mesh, text):
    given = level()
    assert re.search(text, boxes_or_refusal(given.positions, given.triangles, *mesh))


def boxes_or_refusal(*mesh):
    try:
        _core.scene_boxes((mesh,), np.zeros(1, np.int32), np.eye(4)[None], np.zeros(3))
    except ValueError as error:
        return str(error)
    return ""


def test_the_core_lets_go_of_what_it_read_and_of_what_it_refused():
    given, there = level(), np.ones((4, 4), bool)
    arrays = [given.positions, given.triangles, given.uv, there]
    before = [sys.getrefcount(array) for array in arrays]
    for _ in range(5):
        assert not boxes_or_refusal(*arrays)
        assert boxes_or_refusal(*arrays[:2], given.uv[:3], there)
        assert boxes_or_refusal(*arrays[:3], there[:0])
        assert boxes_or_refusal(*arrays[:3], there[0])
    gc.collect()
    assert [sys.getrefcount(array) for array in arrays] == before


def test_scenes_keep_cutouts():
    mesh = level()
    scene = csm.Scene.from_arrays(
        mesh.positions, mesh.triangles, uv=mesh.uv, alpha=mesh.alpha, alpha_cutoff=0.25
    )
    assert scene.meshes[0].alpha_cutoff == 0.25
    for kept in (
        scene.with_ground(0.0),
        scene.merge(cutout_scenes.on_ground()),
        scene.placed((1, 2, 3), scale=2.0, turn_deg=30.0),
        scene.replace(name="other"),
        pickle.loads(pickle.dumps(scene)),
    ):
        assert (kept.meshes[0].alpha == CHECKER).all()
        assert kept.meshes[0].uv.tolist() == QUAD_UV.tolist()


# ------------------------------------------------------------------------------- off is absent


def test_a_scene_without_cutouts_is_planned_as_ever():
    for changes in WAYS.values():
        settings = SMALL.replace(**changes)
        off, on = (csm.plan(settings, size=SIZE, alpha_tested=tested) for tested in (False, True))
        assert off == csm.plan(settings, size=SIZE)
        assert on.textures == off.textures
        assert on.bytes == off.bytes
        assert [step[:2] for step in on.passes] == [step[:2] for step in off.passes]
        # beside every program that draws, one more; all others are the same
        assert set(off.programs) < set(on.programs)
        drawing = {name for name, _ in off.programs} & {"view", "shadow_map"}
        added = set(on.programs) - set(off.programs)
        assert sorted(name for name, _ in added) == sorted(drawing)


def test_no_code_in_any_shader_and_no_byte_on_the_gpu(renderer):
    outputs = _core.OUTPUTS["mask"]
    for name in ("view", "shadow_map", "shadow_mask", "shadow_forward", "receiver_bounds"):
        for tested in (False, True):
            defines = _core.program_defines(name, SMALL, outputs, False, tested)
            wanted = tested and name in ("view", "shadow_map")
            assert f"#define CSM_ALPHA_TEST {wanted:d}\n" in defines
    mesh = level()
    cut, plain = (renderer.render(on_ground(m), view(), SUN, SMALL) for m in (mesh, solid(mesh)))
    # 16 bytes a vertex, and a word for each row of eight texels
    vertices = (plain.info["scene_bytes"] - 4 * 12 - 4 * 28) / 12
    assert vertices == pytest.approx(8, abs=2)
    assert cut.info["scene_bytes"] - plain.info["scene_bytes"] == 16 * vertices + 4 * 8


def test_objects_go_with_the_scene(renderer):
    plain = on_ground(solid(level()))
    renderer.render(plain, view(), SUN, SMALL)
    before = renderer.info
    scene = on_ground(level(), level(1.0))
    renderer.render(scene, view(), SUN, SMALL)
    during = renderer.info
    del scene
    renderer.render(plain, view(), SUN, SMALL)
    after = renderer.info
    assert during["live_objects"] > before["live_objects"] + 3
    compiled = after["programs_compiled"] - before["programs_compiled"]
    assert after["live_objects"] - before["live_objects"] == compiled


def test_images_that_meshes_share_are_stored_once(renderer):
    image = level().alpha
    shared = on_ground(level(alpha=image), level(1.0, alpha=image))
    apart = on_ground(level(), level(1.0))
    assert shared.meshes[1].alpha is shared.meshes[2].alpha
    bytes_of = [renderer.render(s, view(), SUN, SMALL).info["scene_bytes"] for s in (shared, apart)]
    assert bytes_of[1] - bytes_of[0] == 4 * 8
    frames = [renderer.render(s, view(), SUN, SMALL) for s in (shared, apart)]
    assert (frames[0].mask == frames[1].mask).all()


# ------------------------------------------------------------------- whole and empty cut-outs


def same(first, second, *, maps=True):
    for name in IMAGES:
        assert np.array_equal(getattr(first, name), getattr(second, name)), name
    if maps:
        assert np.array_equal(first.shadow_maps, second.shadow_maps)


def render(renderer, scene, changes, camera=None):
    maps = () if changes.get("filter") == "none" else ("shadow_maps",)
    return renderer.render(
        scene, camera or view(), SUN, SMALL.replace(**changes), outputs=(*IMAGES, *maps)
    )


def with_alpha(scene, value):
    """The scene with every cut-out filled with one value; None takes them off."""
    meshes = [
        mesh
        if mesh.alpha is None
        else solid(mesh)
        if value is None
        else csm.Mesh(
            mesh.positions, mesh.triangles, "", mesh.uv, np.full(mesh.alpha.shape, float(value))
        )
        for mesh in scene.meshes
    ]
    return csm.Scene(meshes, scene.instance_mesh, scene.world_from_instance)


@pytest.mark.parametrize("changes", WAYS.values(), ids=WAYS)
def test_all_there_is_the_solid_mesh_to_the_bit(renderer, changes):
    for scene in (on_ground(level(), level(1.0)), cutout_scenes.scraps()):
        whole, plain = (render(renderer, with_alpha(scene, v), changes) for v in (1, None))
        same(whole, plain, maps=changes.get("filter") != "none")


@pytest.mark.parametrize("changes", WAYS.values(), ids=WAYS)
def test_nothing_there_is_no_mesh_to_the_bit(renderer, changes):
    # the posts keep the bounds, and with them the cascades, whether the square is there or not
    posts = [shapes.mesh("post", shapes.box((x, 0, x), (x + 0.2, 4, x + 0.2))) for x in (-3, 3)]
    empty = on_ground(*posts, level(alpha=np.zeros((4, 4))))
    without = on_ground(*posts)
    same(
        render(renderer, empty, changes),
        render(renderer, without, changes),
        maps=changes.get("filter") != "none",
    )


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_alpha_at_the_cutoff_is_there(renderer, kind):
    scale = 255 if kind == np.uint8 else 1
    values = np.array([[0, 51, 102, 204]], float) / 255 * scale
    alpha = values.astype(kind)
    for cutoff, there in ((0.0, 4), (0.2, 3), (0.2001, 2), (0.8, 1), (0.9, 0), (7.0, 0)):
        scene = on_ground(level(alpha=alpha, cutoff=cutoff))
        truth = csm.truth(scene, view(), SUN)
        seen = np.isclose(truth.position[..., 1], 3.0)
        quarters = np.floor((truth.position[seen][:, 0] + 2.0).clip(0, 3.9999))
        assert len(set(quarters.tolist())) == there
        frame = renderer.render(scene, view(), SUN, SMALL)
        assert np.mean(np.abs(frame.mask - truth.mask)) < 0.01
        assert np.mean(frame.valid != truth.valid) < 1e-3


# --------------------------------------------------------------------------- the closed form


def on_checker(points, to_light, height=3.0, half=2.0):
    """Where rays from points to the light cross the square, in cells from its corner."""
    along = (height - points[..., 1]) / to_light[1]
    crossing = points + along[..., None] * to_light
    return (crossing[..., [0, 2]] + half) / (2.0 * half) * 8.0


def in_shadow(cells):
    column, row = np.floor(cells).astype(int)[..., 0], np.floor(cells).astype(int)[..., 1]
    inside = ((cells >= 0) & (cells < 8)).all(axis=-1)
    return inside & ((column + row) % 2 == 1)


def test_truth_of_a_checkerboard_is_its_closed_form():
    scene, camera = on_ground(level()), from_below(8.0)
    truth = csm.truth(scene, camera, SUN)
    cells = on_checker(truth.position, SUN.to_light)
    sure = np.abs(cells - np.round(cells)).min(axis=-1) > 1e-5
    assert truth.valid.all()
    assert sure.mean() > 0.99
    shadowed = in_shadow(cells)
    assert shadowed.mean() > 0.1
    assert ((truth.mask == 0) == shadowed)[sure].all()
    distance = truth.occluder_distance
    assert np.allclose(distance[sure & shadowed], 3.0 / SUN.to_light[1], rtol=1e-6)
    assert np.isinf(distance[sure & ~shadowed]).all()


def test_what_a_hole_lets_through_meets_what_is_behind_it():
    # two squares, one cut out where the other is there: no light between them, two distances
    scene = on_ground(level(3.0), level(2.5, alpha=255 - CHECKER))
    sun, camera = csm.Sun((0, 1, 0)), from_below(3.9)
    truth = csm.truth(scene, camera, sun)
    cells = on_checker(truth.position, sun.to_light)
    sure = np.abs(cells - np.round(cells)).min(axis=-1) > 1e-5
    assert (truth.mask[sure] == 0).all()
    nearer = ~in_shadow(cells)
    assert np.allclose(truth.occluder_distance[sure & nearer], 2.5, rtol=1e-6)
    assert np.allclose(truth.occluder_distance[sure & ~nearer], 3.0, rtol=1e-6)
    above = csm.truth(scene, camera.replace(eye=(0, 5, 0)), sun)
    heights = above.position[..., 1][sure]
    assert np.allclose(heights, np.where(in_shadow(cells)[sure], 3.0, 2.5), atol=1e-6)


def test_a_disc_of_sun_goes_through_holes():
    # far under fine holes half the disc is seen: the share of the image that is cut out
    alpha = np.tile(CHECKER, (8, 8))
    scene = on_ground(level(3.0, 5.0, alpha=alpha), half=20.0)
    sun = csm.Sun((0, 1, 0), angular_diameter_deg=12.0)
    truth = csm.truth(scene, from_below(1.0, (24, 24)), sun, rays_per_pixel=400)
    # 0.63 m of disc over holes of 0.16 m: every edge cell misses half a cell at most
    assert truth.mask.mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(truth.mask - 0.5).max() < 0.15


def edge_law(normal):
    """Share of a texel's side that a nearest-texel map gets wrong along an edge: |displacement|
    averaged over where in its texel a point lies (SPEC's 0.25 along an axis, 0.236 at 45
    degrees)."""
    large, less = np.sort(np.abs(normal))[::-1]
    return large / 4.0 + less**2 / (12.0 * large)


@pytest.mark.parametrize("to_light", [(0.4, 1.0, 0.3), (-0.5, 0.8, 0.1), (0.05, 1.0, 0.9)])
def test_a_checkerboards_shadow_errs_as_much_as_theory_says(renderer, to_light):
    sun, camera = csm.Sun(to_light), from_below(9.0, (1200, 1200))
    settings = csm.ShadowSettings(cascade_count=1, map_size=512)
    scene = on_ground(level(), half=6.0)
    frame = renderer.render(scene, camera, sun, settings, outputs=("mask", "valid"))
    x, y = camera.pixel_plane()
    points = x[None, :, None] * camera.right + y[:, None, None] * camera.up
    points = points * (1, 0, 1)
    cells = on_checker(points, sun.to_light)
    wrong = (frame.mask < 0.5) != in_shadow(cells)

    texel = frame.cascades.texel_size[0]
    light = frame.cascades.light_from_world[0][:2, :3]
    # No error beyond half a texel each way (1/16 for what a rasteriser snaps and float32 rounds).
    cell = np.stack([light[:, 0], light[:, 2]], axis=1) * 0.5  # of the image, in light space
    metres = (cells[wrong] - np.round(cells[wrong])) * np.linalg.det(cell)
    lengths = np.linalg.norm(cell[:, ::-1], axis=0)  # an edge of u = constant runs along v
    off_edge = np.abs(metres) / lengths
    normals = np.stack([cell[::-1, 1] * (-1, 1), cell[::-1, 0] * (-1, 1)]) / lengths[:, None]
    reach = (0.5 + 1 / 16) * (np.abs(normals) @ texel)
    assert (off_edge <= reach).any(axis=1).all()

    # 32 cells that are there, four edges each, none shared: those between two cells count once
    pixel_area = (9.0 / 1200) ** 2 * sun.to_light[1]  # seen from the light
    edges = 8 * 7 + 8  # of each direction: 7 inner lines all along, and half of the outline twice
    share = [edge_law(normal) * texel[0] * length * edges
             for normal, length in zip(normals, lengths, strict=True)]  # fmt: skip
    expected = sum(share) / pixel_area
    assert wrong.sum() == pytest.approx(expected, rel=0.08)


@pytest.mark.parametrize("changes", [{}, {"texcoord": "interpolated"}, {"fit": "visible"}], ids=str)
def test_a_checkerboard_is_as_good_as_theory_allows(renderer, changes):
    scene, camera = on_ground(level(), level(1.2)), view((640, 360))
    truth = csm.truth(scene, camera, SUN)
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, **changes)
    frame = renderer.render(scene, camera, SUN, settings)
    assert np.mean(frame.valid != truth.valid) < 1e-4
    # the yardstick counts edges in the truth and is 8 % off on this many of them
    error = csm.compare(frame, truth).disagreement
    assert error <= 1.15 * float(edge_yardstick(frame, truth))


def cells_of(mesh):
    """The square of `level` as one quadrilateral for each texel that is there."""
    height, width = mesh.alpha.shape
    rows, columns = np.nonzero(mesh.alpha >= 128)
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    edges = np.stack([[columns, columns + 1], [rows, rows + 1]], axis=-1) / (width, height)
    x, z = np.moveaxis(low[[0, 2]] + edges * (high - low)[[0, 2]], -1, 0)
    y = np.full(len(rows), low[1])
    corners = [(x[0], y, z[0]), (x[0], y, z[1]), (x[1], y, z[1]), (x[1], y, z[0])]
    positions = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)
    quads = cutout_scenes.QUAD_TRIANGLES + 4 * np.arange(len(rows))[:, None, None]
    return csm.Mesh(positions.reshape(-1, 3), quads.reshape(-1, 3), "cells")


@pytest.mark.parametrize("changes", WAYS.values(), ids=WAYS)
def test_a_cutout_is_the_triangles_it_stands_for(renderer, changes):
    meshes = level(), level(1.2)
    scenes = on_ground(*meshes), on_ground(*map(cells_of, meshes))
    first, second = (render(renderer, scene, changes, view((480, 270))) for scene in scenes)
    # A rasteriser snaps corners of cells to 1/256 pixel and texel, not places in an image: along
    # an edge half of that share of the pixels, or of the texels and what looks them up, may differ.
    # Some 5000 of the 130,000 pixels, and as many texels, lie on edges: 20 pixels, 1.5e-4; a pixel
    # that looks at more texels, by so many more.
    assert np.array_equal(first.valid, second.valid)
    far = ~np.isclose(first.view_depth, second.view_depth, atol=1e-3)
    assert np.mean(far) < 1.5e-4
    texels = {"pcf": 25, "vsm": 9}.get(changes.get("filter"), 1)
    assert np.mean(np.abs(first.mask - second.mask) > 1e-3) < texels * 1.5e-4


# ----------------------------------------------------------------------------- brute force


@pytest.mark.parametrize("seed", [4, 5])
def test_truth_and_view_equal_brute_force(renderer, seed):
    scene, camera = cutout_scenes.scraps(seed), view((96, 54))
    truth = csm.truth(scene, camera, SUN)
    x, y = (axis.ravel() for axis in np.meshgrid(*camera.pixel_plane()))
    directions = x[:, None] * camera.right + y[:, None] * camera.up - camera.backward
    depth = cutout_scenes.first_hits(
        scene, np.broadcast_to(camera.eye, directions.shape), directions
    ).reshape(54, 96)
    frame = renderer.render(scene, camera, SUN, SMALL)
    seen_by = {
        "truth": np.where(truth.valid, (truth.position - camera.eye) @ -camera.backward, np.inf),
        "frame": frame.view_depth,
    }
    for name, found in seen_by.items():
        with np.errstate(invalid="ignore"):
            wrong = ~((found == depth) | (np.abs(found - depth) < 1e-4 * depth))
        # a ray within rounding of an outline or of a texel's edge may go either way
        assert wrong.sum() <= 3, name
    judged = truth.valid & truth.facing
    # from where the truth's own shadow rays start, a rounding off the surface
    points = truth.position[judged] + 2e-6 * truth.normal[judged]
    blocked = cutout_scenes.first_hits(scene, points, np.broadcast_to(SUN.to_light, points.shape))
    wrong = (truth.mask[judged] == 0) != np.isfinite(blocked)
    assert wrong.sum() <= 3
    both = np.isfinite(blocked) & (truth.mask[judged] == 0)
    close = np.abs(truth.occluder_distance[judged][both] - blocked[both]) < 1e-4
    assert (~close).sum() <= 3
    assert (truth.trace(truth.position[judged], truth.normal[judged]) == truth.mask[judged]).all()


def test_rays_along_a_card_and_through_a_hundred_end():
    # a stack of empty cards, seen along them, down through them and at their common edge
    cards = [level(0.02 * i + 0.5, alpha=np.zeros((2, 2))) for i in range(100)]
    scene = on_ground(*cards)
    down = csm.truth(scene, from_below(1.0, (8, 8), eye=5.0).replace(far=20.0), csm.Sun((0, 1, 0)))
    assert np.allclose(down.position[..., 1], 0.0)
    assert (down.mask == 1).all()
    along = csm.Camera.look_at((9, 1.5, 0), (0, 1.5, 0), near=0.1, far=50, size=(9, 9))
    level_view = csm.truth(scene, along, csm.Sun((1, 1e-4, 0)))
    assert not np.isclose(level_view.position[..., 1], 1.5)[:4].any()
    assert (level_view.mask[level_view.facing] == 1).all()


def test_a_ray_along_a_card_ends_in_few_steps(monkeypatch):
    # Its hit is known to rounding over slope: 10 cm and more here, a million steps of a rounding.
    tree = embree.tree_of(on_ground(level(1.5, alpha=np.zeros((2, 2)))))
    calls, first = [], tree._first
    monkeypatch.setattr(tree, "_first", lambda *rays: calls.append(1) or first(*rays))
    for slope in (1e-2, 1e-4, 1e-6, 1e-8):
        directions = np.tile([-1.0, -slope, 0.0], (500, 1))
        directions[:, 2] = np.linspace(-0.1, 0.1, 500)
        targets = np.zeros((500, 3))
        targets[:, 0], targets[:, 1] = np.linspace(-1.9, 1.9, 500), 1.5 - tree.origin[1]
        calls.clear()
        assert (tree.query(targets - 9.0 * directions, directions) < 0).all()
        assert 2 <= len(calls) <= 60


def test_a_scene_without_cutouts_is_traced_as_ever():
    assert embree.tree_of(on_ground(solid(level())))._cutouts is None
    tree = embree.tree_of(on_ground(level()))
    assert (tree._cutouts.row[:2] == -1).all()
    assert tree._cutouts.row[2:].tolist() == [0, 1]


# ------------------------------------------------------------------ coordinates and instances


@pytest.mark.parametrize("shape", [(3, 5), (8, 8), (40, 7), (1, 33)])
@pytest.mark.parametrize("offset", [(0, 0), (-3, 2), (1000, -1000)])
def test_beyond_the_image_it_repeats(renderer, shape, offset):
    alpha = np.random.default_rng(2).uniform(size=shape)
    tiled = level(alpha=np.tile(alpha, (3, 4)))
    repeated = level(alpha=alpha, uv=QUAD_UV * (4, 3) + offset)
    frames = [render(renderer, on_ground(m), {}) for m in (tiled, repeated)]
    truths = [csm.truth(on_ground(m), view(), SUN) for m in (tiled, repeated)]
    if offset == (0, 0) and shape == (8, 8):
        same(*frames)
    for first, second in (frames, truths):
        # only what falls on a texel's edge, by rounding, may differ
        assert np.mean(first.mask != second.mask) < 5e-4
        assert np.mean(first.valid != second.valid) < 5e-4
    assert 0.9 < frames[0].mask.mean() < 0.995


def test_coordinates_that_run_backwards_mirror_the_image(renderer):
    alpha = np.random.default_rng(3).uniform(size=(6, 9))
    for mirrored, image in (
        (QUAD_UV * (-1, 1), alpha[:, ::-1]),
        ((0, 1) + QUAD_UV * (1, -1), alpha[::-1]),
        (QUAD_UV[:, ::-1], alpha.T),
    ):
        frames = [
            render(renderer, on_ground(m), {})
            for m in (level(alpha=alpha, uv=mirrored), level(alpha=image))
        ]
        assert np.mean(frames[0].mask != frames[1].mask) < 5e-4
        assert np.mean(frames[0].view_depth != frames[1].view_depth) < 5e-4


def test_row_0_of_the_image_is_where_v_is_0(renderer):
    # u along x, v along z: what is there in the upper left texel stands at least x, least z
    alpha = np.zeros((2, 2), np.uint8)
    alpha[0, 0] = 255
    scene, sun = on_ground(level(alpha=alpha)), csm.Sun((0, 1, 0))
    camera = from_below(5.0, (50, 50))
    for mask in (
        csm.truth(scene, camera, sun).mask,
        renderer.render(scene, camera, sun, SMALL).mask,
    ):
        # the picture's columns go along +x, its rows along +z
        assert (mask[6:24, 6:24] == 0).all()
        assert (mask[27:] == 1).all()
        assert (mask[:, 27:] == 1).all()


def test_instances_are_what_they_are_baked(renderer):
    scene = cutout_scenes.scraps()
    baked = []
    for number, transform in zip(scene.instance_mesh, scene.world_from_instance, strict=True):
        mesh = scene.meshes[number]
        baked.append(mesh.posed(csm.spaces.transform_points(transform, mesh.positions)))
    frames = [render(renderer, s, {}) for s in (scene, csm.Scene(baked, origin=scene.origin))]
    truths = [csm.truth(s, view(), SUN) for s in (scene, csm.Scene(baked, origin=scene.origin))]
    assert np.mean(truths[0].mask != truths[1].mask) < 1e-3
    assert np.mean(frames[0].mask != frames[1].mask) < 2e-3
    assert np.mean(frames[0].valid != frames[1].valid) < 1e-3


def test_order_of_meshes_does_not_matter(renderer):
    meshes = [shapes.mesh("ground", shapes.ground(10.0)), level(), solid(level(1.0, 1.0))]
    frames = [
        render(renderer, csm.Scene([meshes[i] for i in order]), {})
        for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    ]
    for other in frames[1:]:
        same(frames[0], other)


def test_errors_of_shaders_tell_of_the_alpha_test(fresh_renderer, tmp_path):
    import shutil
    from importlib import resources

    folder = tmp_path / "shaders"
    shutil.copytree(str(resources.files("csm.shaders")), folder)
    path = folder / "include/cutout.glsl"
    path.write_text(path.read_text() + "broken\n")
    renderer = fresh_renderer(shader_dir=folder)
    renderer.render(on_ground(solid(level())), view(), SUN, SMALL)
    with pytest.raises(csm.ShaderError, match=r"cutout\.glsl") as caught:
        renderer.render(on_ground(level()), view(), SUN, SMALL)
    assert "#define CSM_ALPHA_TEST 1" in caught.value.defines


def test_a_ray_from_the_origin_through_a_hole_there_goes_on():
    """The first ray starts at the scene's origin: steps by a share of nothing never ended."""
    alpha = np.full((3, 3), 255, np.uint8)
    alpha[1, 1] = 0
    corners, uv = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    card = csm.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv, alpha=alpha)
    camera = csm.Camera.look_at((0, 0, 3), (0, 0, 0), size=(9, 9), fov_y_deg=30)
    valid = csm.truth(csm.Scene([card]), camera, csm.Sun((0.3, 1, 1))).valid
    assert valid[4, 0]
    assert not valid[4, 4], "the hole is in the middle"
