"""Pictures: what is drawn lies where the geometry says, and the numbers in titles are right."""

import dataclasses
import re
import sys

import numpy as np
import pytest
from oracles import camera_corners

import csm
from csm import metrics, outlines, plot, plot_style
from csm.spaces import transform_points

matplotlib = pytest.importorskip("matplotlib", reason="csm.plot needs matplotlib (extra: plot)")
matplotlib.use("Agg")
plt = pytest.importorskip("matplotlib.pyplot")

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
CAMERA = csm.Camera.look_at(
    (6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, near=1, far=40, size=(160, 90)
)
SUN = csm.Sun((1.0, 1.2, 0.4))
SETTINGS = csm.ShadowSettings(cascade_count=3, map_size=48, cull="none", view_range="camera")


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def scene():
    return csm.scenes.plane_and_box()


@pytest.fixture(scope="module")
def frame(scene):
    with csm.Renderer() as renderer:
        return renderer.render(scene, CAMERA, SUN, SETTINGS, outputs=OUTPUTS)


@pytest.fixture(scope="module")
def truth(scene):
    pytest.importorskip("embreex", reason="surfaces come from csm.truth (extra: truth)")
    return csm.truth(scene, CAMERA, SUN)


@pytest.fixture(scope="module")
def cascades(frame):
    return frame.cascades


def fitted(camera=CAMERA, sun=SUN, **changes):
    return csm.fit_cascades(camera, sun, SETTINGS.replace(**changes))


def is_corner(points, corners):
    """Whether each of points (k, 2) is one of corners (m, 2), to a billionth of their extent."""
    apart = np.linalg.norm(points[:, None] - corners[None], axis=-1).min(axis=1)
    return apart <= 1e-9 * np.ptp(corners, axis=0).max()


def holds(polygon, points, slack):
    """Whether a convex counter-clockwise polygon (k, 2) holds points (..., 2), up to a slack."""
    inside = np.ones(points.shape[:-1], bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        edge, offset = b - a, points - a
        inside &= (edge[0] * offset[..., 1] - edge[1] * offset[..., 0]) / np.hypot(*edge) >= -slack
    return inside


# -- all of them -----------------------------------------------------------------------------------

LABELLED = {
    "splits": (lambda c, f: plot.splits({"a": c, "b": c.splits + 1.0}), "[m]", None),
    "texels_per_pixel": (lambda c, f: plot.texels_per_pixel({"a": c}, CAMERA), "[m]", "[pixels]"),
    "plan": (lambda c, f: plot.plan(c, CAMERA), "[m]", "[m]"),
    "light_plan": (lambda c, f: plot.light_plan(c, CAMERA), "[m]", "[m]"),
    "view_3d": (lambda c, f: plot.view_3d(c, CAMERA), "[m]", "[m]"),
    "light_view": (lambda c, f: plot.light_view(c, CAMERA), "[texels]", "[texels]"),
    "ground_texels": (lambda c, f: plot.ground_texels(c, camera=CAMERA), "[m]", "[m]"),
    "lattice_phases": (lambda c, f: plot.lattice_phases({"a": [c, c]}), "frame", "[texels]"),
    "texel_sizes": (lambda c, f: plot.texel_sizes({"a": [c, c]}), "frame", "[m]"),
    "texel_outlines": (lambda c, f: plot.texel_outlines(f), None, None),
    "texel_cubes": (lambda c, f: plot.texel_cubes(f), None, None),
}


@pytest.mark.parametrize("name", LABELLED)
def test_axes_have_a_title_labels_and_units(name, cascades, frame):
    draw, x_unit, y_unit = LABELLED[name]
    ax = draw(cascades, frame)
    ax.figure.canvas.draw()
    assert len(ax.get_title(loc="left")) > 10
    for text, unit in ((ax.get_xlabel(), x_unit), (ax.get_ylabel(), y_unit)):
        assert text.endswith(unit) if unit else not text
    if name == "view_3d":
        assert ax.get_zlabel() == "up [m]"


def test_every_helper_is_tested_for_its_labels():
    helpers = {name for name in plot.__all__ if callable(getattr(plot, name))}
    assert helpers == {*LABELLED, "resolution"}
    for name in helpers:
        assert f"`{name}`" in plot.__doc__


def test_given_axes_are_drawn_on(cascades):
    _, (left, right) = plt.subplots(1, 2)
    assert plot.plan(cascades, CAMERA, ax=right) is right
    assert right.lines
    assert not left.lines
    assert len(plt.get_fignums()) == 1


def test_a_missing_matplotlib_names_the_command(cascades, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install cascaded-shadow-maps\[plot\]"):
        plot.plan(cascades, CAMERA)


# Simulated sight without red, green or blue cones: Machado, Oliveira and Fernandes 2009, table 1,
# severity 1, for linear RGB.
MISSING_CONES = {
    "red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998]],
    "green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
              [-0.011820, 0.042940, 0.968881]],
    "blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
             [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


def lab(linear):
    """CIE L*a*b* (D65) of linear sRGB (k, 3)."""
    xyz = (
        linear
        @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    )
    f = np.cbrt(np.maximum(xyz / (0.9505, 1.0, 1.089), 0.0))
    return np.column_stack(
        [116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])]
    )


@pytest.mark.parametrize("cones", ["none", *MISSING_CONES])
def test_cascades_are_told_apart_without(cones):
    srgb = np.array([plot_style.rgb(colour) for colour in plot.CASCADE_COLOURS])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    if cones != "none":
        linear = linear @ np.array(MISSING_CONES[cones]).T
    colours = lab(np.clip(linear, 0.0, 1.0))
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=-1)
    # About 2 is the least that is seen at all; neighbouring cascades touch in every picture.
    assert apart[~np.eye(8, dtype=bool)].min() > 6.0
    assert np.diagonal(apart, 1).min() > 20.0


# -- splits ----------------------------------------------------------------------------------------


def test_bars_lie_between_the_splits():
    splits = csm.split_distances(0.5, 80.0, 4, lam=0.7)
    ax = plot.splits({"practical": splits})
    bars = sorted((bar.get_x(), bar.get_x() + bar.get_width()) for bar in ax.patches)
    assert np.allclose(bars, np.column_stack([splits[:-1], splits[1:]]), rtol=1e-12)
    assert ax.get_xscale() == "log"


def test_texels_per_pixel_is_the_undersampling_of_a_facing_plane(scene):
    # Straight down under the sun at its zenith, undersampling has no slope in it.
    pytest.importorskip("embreex", reason="surfaces come from csm.truth (extra: truth)")
    camera = csm.Camera.look_at(
        (6, 12, 6), (6, 0, 6), up=(0, 0, -1), fov_y_deg=20, near=1, far=13, size=(64, 36)
    )
    sun, settings = csm.Sun((0, 1, 0)), SETTINGS.replace(select="interval")
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, camera, sun, settings)
    m = metrics.undersampling(frame, csm.truth(scene, camera, sun))
    line = plot.texels_per_pixel({"a": frame.cascades}, camera).lines[0]
    depth, ratio = line.get_data()
    assert (np.diff(depth) >= 0).all()
    # The ground lies at view depth 12; 60 samples of 1/z per slice leave 1e-3.
    assert np.allclose(m, np.interp(12.0, depth, ratio), rtol=2e-3)


# -- slices and windows ----------------------------------------------------------------------------


def test_plan_draws_slices_by_their_corners_and_windows_by_their_light(cascades):
    ax = plot.plan(cascades, CAMERA, height=0.25)
    outlines_drawn = [line.get_xydata() for line in ax.lines if len(line.get_xydata()) == 5]
    for patch, window, i in zip(ax.patches, outlines_drawn, (2, 1, 0), strict=True):
        corners = camera_corners(CAMERA, *cascades.splits[i : i + 2])[:, [0, 2]] * (1, -1)
        polygon = patch.get_xy()[:-1]
        assert is_corner(polygon, corners).all()
        assert holds(polygon, corners, 1e-9).all()
        world = np.column_stack([window[:4, 0], np.full(4, 0.25), -window[:4, 1]])
        uv = transform_points(cascades.uvz_from_world[i], world)[:, :2]
        assert is_corner(uv, np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)])).all()
        assert len(np.unique(uv.round(6), axis=0)) == 4


def test_light_plan_draws_windows_by_their_lattice(cascades):
    ax = plot.light_plan(cascades, CAMERA, points=[[0.0, 0.0, 0.0], [np.nan] * 3])
    windows = [line.get_xydata() for line in ax.lines if len(line.get_xydata()) == 5]
    for window, i in zip(windows, (2, 1, 0), strict=True):
        lower = cascades.lattice[i] * cascades.texel_size[i]
        upper = (cascades.lattice[i] + cascades.map_size[i]) * cascades.texel_size[i]
        assert np.allclose(window.min(axis=0), lower, rtol=0, atol=1e-9)
        assert np.allclose(window.max(axis=0), upper, rtol=0, atol=1e-9)
    (dots,) = (line.get_xydata() for line in ax.lines if line.get_marker() == ",")
    assert np.allclose(dots, [(0.0, 0.0)])


def test_view_in_space_holds_slices_and_windows(cascades, scene):
    ax = plot.view_3d(cascades, CAMERA, scene=scene)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    for i in range(cascades.count):
        corners = camera_corners(CAMERA, *cascades.splits[i : i + 2])[:, [0, 2, 1]] * (1, -1, 1)
        assert (corners >= limits[:, 0] - 1e-9).all()
        assert (corners <= limits[:, 1] + 1e-9).all()
    alone = plot.view_3d(cascades, CAMERA, cascade=1)
    assert len(ax.collections) == 3 * cascades.count + 1
    assert len(alone.collections) == cascades.count + 2


@pytest.mark.parametrize("select", ["interval", "map", "frustum"])
@pytest.mark.parametrize("cascade", [0, 2])
def test_utilisation_is_the_count_of_texels_over_the_visible_part(cascades, cascade, select):
    ax = plot.light_view(cascades, CAMERA, cascade, select=select)
    near, far = cascades.splits[[cascade, cascade + 1 if select == "interval" else -1]]
    # Without a scene the depth range holds the slice and more, but not what finer maps may be
    # asked for beyond it: those columns end inside the view.
    column = np.linspace(0.0, 1.0, 400)
    size = cascades.map_size[cascade]
    count = 0
    world_from_uvz = np.linalg.inv(cascades.uvz_from_world[cascade])
    for v in range(size):
        uvz = np.empty((size, len(column), 3))
        uvz[..., 0] = (np.arange(size)[:, None] + 0.5) / size
        uvz[..., 1], uvz[..., 2] = (v + 0.5) / size, column
        offset = transform_points(world_from_uvz, uvz) - CAMERA.eye
        depth = -(offset @ CAMERA.backward)
        inside = (depth >= near) & (depth <= far)
        inside &= np.abs(offset @ CAMERA.right) <= CAMERA.half_width * depth
        inside &= np.abs(offset @ CAMERA.up) <= CAMERA.half_height * depth
        count += np.count_nonzero(inside.any(axis=1))
    used = outlines.column_hits(cascades, cascade, CAMERA, near, far)
    # 400 samples of a column miss the corners that a column only grazes: less than a texel along
    # the outline.
    assert 0 <= np.count_nonzero(used) - count <= 0.02 * size**2
    shown = float(re.search(r"(\d+)%", ax.get_title(loc="left"))[1])
    assert abs(shown / 100.0 - used.mean()) <= 0.005 + 1e-12
    # The core counts otherwise: texels along the outline may differ.
    check = csm.check_cascades(cascades, CAMERA, select=select)
    assert abs(check.utilisation[cascade] - used.mean()) < 4.0 / size


@pytest.mark.parametrize("f", [3.0, 30.0])
def test_utilisation_of_a_side_view_has_a_closed_form(f):
    # Seen from above, a slice from 1 to f is a trapezoid of area tx (f^2 - 1) in a square of side
    # 2 R, R = k f; under selection by map the square holds the view from 1 to f + R, cut at R to
    # both sides.
    camera = csm.Camera.look_at((0, 0, 0), (0, 0, -1), near=1, far=300, size=(1920, 1080))
    settings = csm.ShadowSettings(
        cascade_count=2, split="manual", manual_splits=(f,), map_size=512, view_range="camera"
    )
    cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 0)), settings)
    tx = camera.half_width
    radius = f * np.hypot(tx, camera.half_height)
    side = 2.0 * radius * 512 / 511  # the window is half a texel larger on each side
    widest = radius / tx
    own = tx * (f**2 - 1.0) / side**2
    reach = (tx * (widest**2 - 1.0) + 2.0 * radius * (f + radius - widest)) / side**2
    for select, expected in (("interval", own), ("map", reach)):
        near, far = outlines.visible_slice(cascades, 0, select)
        used = outlines.column_hits(cascades, 0, camera, near, far).mean()
        # A texel more or less along the outline.
        assert abs(used - expected) < 4.0 / 512, select


def test_outline_of_a_slice_lies_on_its_corners(cascades):
    ax = plot.light_view(cascades, CAMERA, 1, shadow_map=np.full((48, 48), 0.5))
    corners = transform_points(
        cascades.uvz_from_world[1], camera_corners(CAMERA, *cascades.splits[1:3])
    )[:, :2]
    own = next(line for line in ax.lines if line.get_linestyle() == "--").get_xydata()[:-1]
    assert is_corner(own, 48 * corners).all()
    assert holds(own, 48 * corners, 1e-9).all()
    with pytest.raises(ValueError, match="select must be"):
        plot.light_view(cascades, CAMERA, 1, select="nearest")
    with pytest.raises(ValueError, match="cascade must be"):
        plot.light_view(cascades, CAMERA, 3)


def test_outline_under_a_projective_map_is_that_of_many_points(cascades):
    warp = np.eye(4)
    warp[3, :3] = (0.0, 0.45, 0.0)  # w from 1 to 1.45 over the map
    warped = dataclasses.replace(cascades, uvz_from_world=warp @ cascades.uvz_from_world)
    near, far = cascades.splits[1:3]
    outline = outlines.slice_outline(warped, 1, CAMERA, near, far)
    rng = np.random.default_rng(7)
    z = rng.uniform(near, far, 4000)
    x, y = rng.uniform(-1, 1, (2, 4000)) * z
    points = CAMERA.eye + np.column_stack(
        [x * CAMERA.half_width, y * CAMERA.half_height, -z]
    ) @ np.stack([CAMERA.right, CAMERA.up, CAMERA.backward])
    texels = 48 * transform_points(warped.uvz_from_world[1], points)[:, :2]
    assert holds(outline, texels, 1e-9).all()
    hits = outlines.column_hits(warped, 1, CAMERA, near, far)
    inside = ((texels >= 0) & (texels < 48)).all(axis=1)
    u, v = texels[inside].astype(int).T
    # Points near a texel's rim may be seen where its centre is not.
    centred = (np.abs(texels[inside] % 1.0 - 0.5) < 0.1).all(axis=1)
    assert centred.sum() > 30
    assert hits[v, u][centred].mean() > 0.95
    assert not hits.all()


def test_lines_on_the_ground_are_borders_of_texels(cascades):
    ax = plot.ground_texels(cascades, 1, height=0.5, lines=12)
    lines = np.array(ax.collections[0].get_segments())
    world = np.stack([lines[..., 0], np.full(lines.shape[:2], 0.5), -lines[..., 1]], axis=-1)
    uv = transform_points(cascades.uvz_from_world[1], world)[..., :2]
    across = np.abs(uv[:, 0] - uv[:, 1]).argmin(axis=1)
    texels = np.take_along_axis(uv, across[:, None, None], axis=2)[..., 0] * 48
    counted = texels + cascades.lattice[1][across][:, None]
    assert np.allclose(counted, 4 * np.round(counted / 4), atol=1e-7)
    assert np.bincount(across).tolist() in ([12, 12], [12, 13], [13, 12], [13, 13])


# -- along a path ----------------------------------------------------------------------------------


def shifted(cascades, u, v):
    """The same cascades with maps moved by (u, v) texels."""
    move = np.eye(4)
    move[:2, 3] = np.array([u, v]) / cascades.map_size[0]
    return dataclasses.replace(cascades, uvz_from_world=move @ cascades.uvz_from_world)


def test_phases_are_the_parts_of_a_texel_that_the_map_moved(cascades):
    moves = np.array([(0, 0), (0.25, 0), (3.25, -0.5), (1, 7), (-0.3, 0.2)])
    path = [shifted(cascades, *move) for move in moves]
    phases = outlines.lattice_phases(path, 0, (1.0, 2.0, -3.0))
    expected = [(0, 0), (0.25, 0), (0.25, -0.5), (0, 0), (-0.3, 0.2)]
    apart = phases - expected
    assert np.allclose(apart - np.round(apart), 0.0, atol=1e-9)
    assert (np.abs(phases) <= 0.5).all()
    # Half a texel and its negative are one place; 3.25 to 1 and on are jumps, (0, 0) to 0.25 too.
    ax = plot.lattice_phases({"moved": path, "still": [path[0]] * 5})
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["moved\n100% of steps jump", "still\n0% of steps jump"]
    assert np.allclose(ax.lines[1].get_ydata(), phases[:, 0])
    assert np.allclose(ax.lines[2].get_ydata(), phases[:, 1])


def test_a_snapped_walk_stands_still_and_a_free_one_does_not():
    walk = [CAMERA.translated((0.013 * k, 0.001 * k, -0.021 * k)) for k in range(12)]
    exact = [fitted(camera) for camera in walk]
    free = [fitted(camera, snap="none") for camera in walk]
    ax = plot.lattice_phases({"exact": exact, "none": free}, point=(3, 0, -2))
    assert [text.get_text() for text in ax.texts] == [
        "exact\n0% of steps jump",
        "none\n100% of steps jump",
    ]


def test_sizes_along_a_path_are_counted(cascades):
    twice = dataclasses.replace(cascades, texel_size=2.0 * cascades.texel_size)
    ax = plot.texel_sizes({"steady": [cascades] * 4, "changing": [cascades, twice, cascades]})
    steady, changing = ax.lines
    t = cascades.texel_size[0].max()
    assert steady.get_ydata().tolist() == [t] * 4
    assert changing.get_ydata().tolist() == [t, 2 * t, t]
    assert steady.get_label() == "steady: 1 size"
    assert changing.get_label() == "changing: 2 sizes"


# -- frames ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.15, -0.1)], ids=["centred", "off centre"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_points_of_pixels_are_those_of_rays(scene, orthographic, centre):
    pytest.importorskip("embreex", reason="surfaces come from csm.truth (extra: truth)")
    camera = scene.cameras["map"].replace(size=(60, 40)) if orthographic else CAMERA
    camera = camera.replace(centre_x=centre[0], centre_y=centre[1])
    with csm.Renderer() as renderer:
        frame = renderer.render(
            scene, camera, SUN, SETTINGS.replace(filter="none"), outputs=("valid", "view_depth")
        )
    points, truth = outlines.pixel_points(frame), csm.truth(scene, camera, SUN)
    both = frame.valid & truth.valid
    assert both.sum() > 1000
    # Float32 depth of up to 40 m.
    assert np.abs(points - truth.position)[both].max() < 40.0 * 2.0**-22
    assert np.isnan(points[~frame.valid]).all()


def test_resolution_shows_the_undersampling(frame, truth):
    ax = plot.resolution(frame, truth)
    m = metrics.undersampling(frame, truth)
    shown = ax.images[0].get_array()
    assert np.array_equal(np.ma.getmaskarray(shown), np.isnan(m))
    assert np.array_equal(shown.compressed(), m[np.isfinite(m)])
    share = np.mean(m[np.isfinite(m)] > 1.0)
    assert f"at {share:.0%} of" in ax.get_title(loc="left")
    assert ax.figure.axes[1].get_ylabel() == "texel [pixels]"


def test_lines_lie_where_neighbouring_pixels_have_other_texels(scene):
    # Straight down on the ground, texels of some ten pixels: no occlusion, no perspective.
    camera = scene.cameras["map"].replace(size=(240, 160))
    settings = SETTINGS.replace(cascade_count=1, split="uniform", map_size=64)
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, camera, csm.Sun((0.3, 1, 0.2)), settings, outputs=OUTPUTS)
    points = outlines.pixel_points(frame)
    texel = frame.cascades.map_size[0] * transform_points(frame.cascades.uvz_from_world[0], points)
    texel = np.floor(texel[..., :2])
    ground = np.abs(points[..., 1]) < 1e-3
    strength = outlines.texel_lines(frame.cascades, frame.cascade_index, points, [1])
    other = np.zeros(ground.shape, bool)
    other[:, 1:] |= (texel[:, 1:] != texel[:, :-1]).any(axis=-1)
    other[1:] |= (texel[1:] != texel[:-1]).any(axis=-1)
    flat = ground.copy()  # away from the box, whose sides bend the grid, and from the border
    flat[[0, -1]] = flat[:, [0, -1]] = False
    for shift in range(-3, 4):
        for axis in (0, 1):
            flat &= np.roll(ground, shift, axis)
    grown = np.zeros_like(other)
    for y in (-2, -1, 0, 1, 2):
        for x in (-2, -1, 0, 1, 2):
            grown |= np.roll(other, (y, x), (0, 1))
    assert 0.1 < other[flat].mean() < 0.5
    # A pixel and its neighbour across a border: one is within half a pixel of it.
    beside = np.maximum(strength, np.maximum(np.roll(strength, 1, 0), np.roll(strength, 1, 1)))
    assert beside[other & flat].min() >= 0.5
    assert strength[flat & ~grown].max() == 0.0


def test_outlines_say_what_is_between_two_lines(frame):
    ax = plot.texel_outlines(frame, every=[1, 2, 4])
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    seen = [i for i in range(3) if (frame.cascade_index == i).any()]
    assert [text[0] for text in texts] == [str(i) for i in seen]
    for i, text in zip(seen, texts, strict=True):
        assert text.endswith(f"a line every {[1, 2, 4][i]}")
        length, unit = re.search(r": ([\d.]+) (m|cm|mm) texels", text).groups()
        metres = float(length) / {"m": 1, "cm": 100, "mm": 1000}[unit]
        assert metres == pytest.approx(frame.cascades.texel_size[i].max(), rel=0.05)
    with pytest.raises(ValueError, match="every must be at least 1"):
        plot.texel_outlines(frame, every=0)


def test_boxes_lie_at_the_stored_depths(frame):
    cascades = frame.cascades
    boxes = outlines.texel_boxes(frame)
    assert [mesh.name for mesh in boxes.meshes] == ["cascade 0", "cascade 1", "cascade 2"]
    for i, mesh in enumerate(boxes.meshes):
        v, u = np.nonzero(frame.shadow_maps[i] < 1.0)
        near, far = cascades.depth_range[i]
        t = cascades.texel_size[i]
        depth = near + frame.shadow_maps[i][v, u].astype(np.float64) * (far - near)
        centre = np.column_stack(
            [(cascades.lattice[i] + np.column_stack([u, v]) + 0.5) * t, -depth]
        )
        world = transform_points(np.linalg.inv(cascades.light_from_world[i]), centre)
        finer = np.zeros(len(world), bool)
        for j in range(i):
            uvz = transform_points(cascades.uvz_from_world[j], world)
            finer |= ((uvz >= 0) & (uvz <= 1)).all(axis=1)
        light = transform_points(cascades.light_from_world[i], mesh.positions).reshape(-1, 8, 3)
        assert len(light) == np.count_nonzero(~finer) > 20
        # Meshes may hold float32: a few roundings of coordinates of tens of metres.
        low, high = light.min(axis=1), light.max(axis=1)
        slack = 1e-4 * t.max()
        assert np.allclose(0.5 * (low + high)[:, :2], centre[~finer][:, :2], rtol=0, atol=slack)
        assert np.allclose(high[:, 2], centre[~finer][:, 2], rtol=0, atol=slack)
        assert np.allclose(high - low, [*t, t.max()], rtol=0, atol=slack)


@pytest.mark.parametrize("warp", ["lispsm", "psm", "tsm"])
def test_boxes_of_a_warped_map_stand_on_their_texels(scene, warp):
    settings = SETTINGS.replace(cascade_count=1, map_size=32, warp=warp, snap="none")
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, CAMERA, SUN, settings, outputs=OUTPUTS)
    (mesh,) = outlines.texel_boxes(frame).meshes
    corners = np.asarray(mesh.positions, np.float64).reshape(-1, 8, 3)
    uvz = transform_points(frame.cascades.uvz_from_world[0], corners)
    v, u = np.nonzero(frame.shadow_maps[0] < 1.0)
    texel = 32 * uvz[..., :2]
    # Float32 corners: up to 100 m away, in texels of centimetres at the near end.
    for axis, at in ((0, u), (1, v)):
        assert np.allclose(texel[..., axis].min(axis=1), at, rtol=0, atol=2e-3)
        assert np.allclose(texel[..., axis].max(axis=1), at + 1, rtol=0, atol=2e-3)
    height = corners @ SUN.to_light
    front = height.max(axis=1)
    assert np.allclose(np.sort(height, axis=1)[:, 4:], front[:, None], rtol=0, atol=1e-4)
    stored = np.column_stack([(u + 0.5) / 32, (v + 0.5) / 32, frame.shadow_maps[0][v, u]])
    points = transform_points(np.linalg.inv(frame.cascades.uvz_from_world[0]), stored)
    assert np.allclose(points @ SUN.to_light, front, rtol=0, atol=1e-4)
    assert np.ptp(front - height.min(axis=1)) > 0.01, "boxes of one size would be no warp"


def test_boxes_of_empty_maps_are_refused(frame):
    empty = csm.Frame(
        frame._arrays | {"shadow_maps": np.ones((3, 48, 48), np.float32)},
        cascades=frame.cascades,
        camera=frame.camera,
        sun=frame.sun,
        settings=frame.settings,
        timings_ms={},
        info={},
    )
    with pytest.raises(ValueError, match="no caster"):
        outlines.texel_boxes(empty)


def test_cubes_wear_the_colours_of_their_cascades(frame, renderer):
    ax = plot.texel_cubes(frame, renderer=renderer)
    picture = np.asarray(ax.images[0].get_array())
    assert picture.shape == (90, 160, 3)
    colours = np.array([plot_style.rgb(colour) for colour in plot.CASCADE_COLOURS[:3]])
    hue = picture / np.linalg.norm(picture, axis=-1, keepdims=True)
    nearest = (hue @ (colours / np.linalg.norm(colours, axis=1, keepdims=True)).T).argmax(axis=-1)
    lit = frame.valid & (frame.mask > 0.5) & (frame.cascade_index < 3)
    # Lit ground is what maps store. A box reaches half a texel beyond what it stands for: pixels
    # at the borders between cascades and beside the box differ.
    assert lit.sum() > 3000
    assert (nearest == frame.cascade_index)[lit].mean() > 0.9


def test_cubes_may_be_seen_from_elsewhere(frame, renderer):
    above = csm.Camera.orthographic(
        (0, 20, 0), (0, 0, 0), up=(0, 0, -1), height=8, near=1, far=60, size=(48, 32)
    )
    ax = plot.texel_cubes(frame, camera=above, renderer=renderer)
    assert ax.images[0].get_array().shape == (32, 48, 3)
