"""Receiver planes from differences in the quad of pixels, with their two guards (docs/numerics.md
29; D2 of 16)."""

import mask_oracle
import numpy as np
import probes
import pytest
import small_scenes

import csm

TO_LIGHT = (0.36, 0.8, 0.48)
LARGEST = 1e3  # tangent: the limit of slopes
SIZE = (61, 47)
BASE = csm.ShadowSettings(cascade_count=3, map_size=256, plane="derivatives")
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal")


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    with csm.Renderer(shader_dir=probes.folder(tmp_path_factory.mktemp("probe"))) as renderer:
        yield renderer


def gradients(probe, scene, view, settings=BASE, to_light=TO_LIGHT):
    """(h, w, 2) change of light-view depth over light x, y [m/m] that the bias takes, the frame,
    and the pixels that face the sun in some cascade."""
    frames = [
        probes.ask(probe, what, scene, view, to_light, settings, outputs=OUTPUTS)
        for what in ("slope_u", "slope_v")
    ]
    slope = np.stack([frame.mask.astype(np.float64) for frame in frames], axis=-1)
    frame = frames[0]
    index = np.minimum(frame.cascade_index, frame.cascades.count - 1)
    span = np.diff(frame.cascades.depth_range, axis=1)[index]
    facing = frame.normal.astype(np.float64) @ frame.sun.to_light > mask_oracle.FACING * 1.1
    judged = frame.valid & facing & (frame.cascade_index != mask_oracle.NO_CASCADE)
    return slope * span / frame.cascades.texel_size[index], frame, judged


def by_normal(frame):
    """(h, w, 2) the same from the normals of the triangles, without a limit."""
    light = frame.cascades.light_from_world[0][:3, :3]
    normals = frame.normal.astype(np.float64) @ np.linalg.inv(light)
    with np.errstate(divide="ignore", invalid="ignore"):
        return normals[..., :2] / normals[..., 2:]


def quads_of_one_plane(frame):
    """Pixels whose quad sees one plane alone."""
    offset = (np.nan_to_num(small_scenes.positions_of(frame)) * frame.normal).sum(axis=-1)
    plane = np.concatenate([frame.normal, offset[..., None]], axis=-1)
    alone = frame.valid.copy()
    for along_y in (False, True):
        row, column = probes.quad_partner(frame.camera.size, along_y)
        there = (row >= 0) & (column < frame.camera.size[0])
        other = plane[np.where(there, row, 0), np.where(there, column, 0)]
        alone &= there & (np.abs(other - plane).max(axis=-1) < 1e-3)
    return alone


def tilted(facing, azimuth):
    """A square of 10 m whose normal has this cosine to the light, an orthographic camera straight
    above it, and its exact gradient."""
    sun = csm.Sun(TO_LIGHT)
    fitted = csm.fit_cascades(csm.Camera.look_at((0, 0, 1), (0, 0, 0)), sun, csm.ShadowSettings())
    x_axis, y_axis = fitted.light_from_world[0][:2, :3]
    level = np.cos(azimuth) * y_axis - np.sin(azimuth) * x_axis
    normal = facing * sun.to_light + np.sqrt(1.0 - facing**2) * np.cross(level, sun.to_light)
    uphill = np.cross(normal, level)
    corners = [5.0 * (a * level + b * uphill) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    scene = csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])
    view = csm.Camera(5.0 * normal, level, uphill, normal, 4.5, 4.5, 1.0, 9.0, (61, 61), True)
    exact = np.array([normal @ x_axis, normal @ y_axis]) / max(facing, 1e-9)
    return scene, view, exact


@pytest.mark.parametrize("facing", [1.0, 0.1, 1e-3, 1e-5, 0.0])
@pytest.mark.parametrize("azimuth", [0.0, 22.5, 45.0])
def test_d2_planes_towards_edge_on(probe, figure, facing, azimuth):
    """n . L from 1 to 0: exact up to the limit, finite and within it beyond."""
    scene, view, exact = tilted(facing, np.radians(azimuth))
    found, frame, judged = gradients(probe, scene, view, BASE.replace(cascade_count=1))
    assert frame.valid.all()
    assert np.isfinite(frame.mask).all()
    length = np.linalg.norm(found, axis=-1)
    figure("D2", "gradient against its limit", length.max() / LARGEST, 1.0 + 1e-4, "of the limit",
           lambda: np.round(255 * np.minimum(length / LARGEST, 1)).astype(np.uint8))  # fmt: skip
    if facing >= 0.1:
        assert judged.all()
        # some eight roundings of coordinates of 10 m over a step of 0.15 m, magnified by the
        # condition of the matrix of steps, 1 / facing, and by the slope itself
        allowed = 8 * 2.0**-24 * 10.0 / (9.0 / 61) / facing * (1.0 + np.linalg.norm(exact))
        error = np.linalg.norm(found - exact, axis=-1).max()
        figure("D2", "gradient of a plane", error / allowed, 1.0, "of float32's")
        assert allowed < 1e-5 * 61 * (1.0 + np.linalg.norm(exact)) ** 2, "1e-5 of the condition"
    elif facing == 1e-3:
        assert judged.all()
        assert length.min() > 0.5 * LARGEST, "the guard for parallel steps does not cut it off"


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ("vec3(1.0, 2.0, 3.0), vec3(2.0, 4.0, 5.0)", (0.0, 0.0)),
        ("vec3(1.0, 0.0, 3.0), vec3(1.0, 1e-7, 5.0)", (0.0, 0.0)),
        ("vec3(0.0), vec3(1.0, 0.0, 5.0)", (0.0, 0.0)),
        # z = -2 x - 3 y, and y steps half as far as x: depth grows by 2 and 3
        ("vec3(2.0, 0.0, -4.0), vec3(0.0, 1.0, -3.0)", (2.0, 3.0)),
        ("vec3(1.0, 1.0, -5.0), vec3(1.0, -1.0, 1.0)", (2.0, 3.0)),
        # apart, but far too steep: the limit, in the same direction
        ("vec3(1.0, 0.0, -3e6), vec3(0.0, 1.0, -4e6)", (600.0, 800.0)),
    ],
)
def test_d2_steps_that_span_no_plane(tmp_path, steps, expected):
    """The determinant's guard, and the limit, at steps that are given."""
    shaders = probes.folder(tmp_path)
    path = shaders / "include" / "shadow_bias.glsl"
    own = "gradient_of_steps(point.step_x, point.step_y)"
    assert own in path.read_text()
    path.write_text(path.read_text().replace(own, f"gradient_of_steps({steps})"))
    with csm.Renderer(shader_dir=shaders) as given:
        view = small_scenes.camera(0, size=(16, 9))
        settings = BASE.replace(cascade_count=1, map_size=64)
        found, _, judged = gradients(given, csm.scenes.plane_and_box(), view, settings)
    assert judged.any()
    assert np.abs(found[judged] - expected).max() < 1e-5 * (1.0 + max(expected))


@pytest.mark.parametrize("height", [0.0, 1e-4, 1e-2])
def test_d2_a_camera_edge_on_to_the_ground(probe, renderer, figure, height):
    """Steps as long as the view, and parallel to each other: finite, and within the limit."""
    view = csm.Camera.look_at(
        (6, height, 8), (0, height, 0), fov_y_deg=60, near=0.01, far=60, size=SIZE
    )
    scene = csm.scenes.plane_and_box()
    found, _, judged = gradients(probe, scene, view)
    assert np.isfinite(found).all()
    length = np.linalg.norm(found, axis=-1)[judged]
    figure("D2", "gradient against its limit", length.max(initial=0.0) / LARGEST, 1.0 + 1e-4,
           "of the limit")  # fmt: skip
    mask = renderer.render(scene, view, csm.Sun(TO_LIGHT), BASE).mask
    assert np.isfinite(mask).all()


@pytest.mark.parametrize("warp", ["none", "lispsm"])
def test_d2_seams_and_depth_edges(probe, figure, warp):
    """The same gradient on both sides of a seam, and one within the limit across an edge."""
    settings = BASE.replace(split="uniform", fit="box", select="interval", warp=warp)
    view = small_scenes.camera(0, size=SIZE)
    for name in ("stairs", "soup"):
        found, frame, judged = gradients(probe, small_scenes.SCENES[name](), view, settings)
        assert np.isfinite(found).all()
        if warp != "none":
            continue  # a warped map's slope has a tilt of its own, and no one span
        length = np.linalg.norm(found, axis=-1)
        figure("D2", "gradient against its limit", length[judged].max() / LARGEST, 1.0 + 1e-4,
               "of the limit")  # fmt: skip
        exact = by_normal(frame)
        own = judged & quads_of_one_plane(frame) & (np.linalg.norm(exact, axis=-1) < 10.0)
        assert own.mean() > 0.3
        seams = own & (np.diff(frame.cascade_index.astype(int), axis=1, append=255) != 0)
        assert seams.sum() > 5
        # positions some 15 m from the eye, pixels some 0.1 m apart: 1e-5 of a step and less, times
        # the condition of two steps seen at a slant
        error = np.linalg.norm(found - exact, axis=-1)
        cosine = np.abs((frame.normal * rays(view)).sum(axis=-1)).clip(1e-9)
        allowed = 1e-4 / cosine * (1.0 + np.linalg.norm(exact, axis=-1)) ** 2
        figure("D2", "gradient of a plane, across seams", (error / allowed)[own].max(), 1.0,
               "of float32's")  # fmt: skip


def rays(view):
    directions, _ = small_scenes.pixel_rays(view)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.mark.parametrize("filter", ["hard", "pcf"])
def test_masks_are_those_of_normals(renderer, filter):
    """Where a quad sees one plane, both planes are the same and so is the mask, but for compares
    that rounding decides."""
    view = small_scenes.camera(0)
    sun = csm.Sun(TO_LIGHT)
    scene = csm.scenes.plane_and_box()
    settings = BASE.replace(filter=filter)
    by_steps = renderer.render(scene, view, sun, settings, outputs=OUTPUTS)
    by_planes = renderer.render(scene, view, sun, settings.replace(plane="normal"))
    alone = quads_of_one_plane(by_steps)
    assert alone.mean() > 0.5
    assert (by_steps.mask != by_planes.mask)[alone].mean() < 1e-3
    assert (by_steps.mask != by_planes.mask)[~alone].mean() < 0.2


def test_stages_give_the_same_bits(renderer):
    arguments = (small_scenes.soup(), small_scenes.camera(1, size=SIZE), csm.Sun(TO_LIGHT))
    with csm.Renderer(stage="fragment") as fragments:
        other = fragments.render(*arguments, BASE)
    assert (renderer.render(*arguments, BASE).mask == other.mask).all()


def test_vertices_and_points_take_the_plane(renderer):
    """Coordinates from vertices take their quad's plane too; a point that of its normal."""
    scene, sun = csm.scenes.plane_and_box(), csm.Sun(TO_LIGHT)
    arguments = (scene, small_scenes.camera(0), sun)
    mask = renderer.render(*arguments, BASE).mask
    by_vertex = renderer.render(*arguments, BASE.replace(texcoord="interpolated")).mask
    assert (mask != by_vertex).mean() < 1e-3
    points = np.random.default_rng(1).uniform((-4, 0, -4), (4, 0, 4), (500, 3))
    seen = [
        renderer.render(
            *arguments, BASE.replace(plane=plane), outputs=(), points=points
        ).point_visibility
        for plane in ("normal", "derivatives")
    ]
    assert (seen[0] == seen[1]).all()
    assert 0.0 < seen[0].mean() < 1.0


def test_off_is_absent():
    """Without a receiver plane nobody looks at a neighbour."""
    for base in (
        csm.ShadowSettings(bias="manual"),
        csm.ShadowSettings(filter="pcf", filter_size=2),
        csm.ShadowSettings(filter="vsm"),
    ):
        assert csm.plan(base) == csm.plan(base.replace(plane="derivatives"))
    assert csm.plan(csm.ShadowSettings()) != csm.plan(csm.ShadowSettings(plane="derivatives"))
