"""Geometry, cameras and places at the edge of what can be drawn and looked up, through every fit
(R1, W1 and C2 of docs/numerics.md 16): numbers come out, and they are visibilities."""

import drawings
import numpy as np
import oracles
import pytest
import small_scenes
from views import scene_of, turned

import csm
from csm import _core, shapes

TABLE = {row["name"]: row["choices"].split() for row in _core.effect_table()}
FITS = {fit: {"fit": fit} for fit in TABLE["fit"]}
FITS["visible, turned"] = {"fit": "visible", "turned": True}
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
SUN = csm.Sun((0.6, 0.8, 0.0))


def grey(mask):
    return np.round(255 * np.clip(np.nan_to_num(mask), 0, 1)).astype(np.uint8)


def no_visibilities(frame):
    """Number of values of a frame that are no visibility, depth, index or normal."""
    maps = frame.shadow_maps
    maps = np.concatenate([np.ravel(each) for each in maps]) if len(maps) else np.zeros(1)
    wrong = [
        ~((frame.mask >= 0) & (frame.mask <= 1)),
        frame.mask[~frame.valid] != 1,
        ~np.isfinite(frame.view_depth[frame.valid]),
        ~np.isfinite(frame.normal),
        ~((maps >= 0) & (maps <= 1)),
        ~((frame.cascade_index < frame.settings.cascade_count) | (frame.cascade_index == 255)),
    ]
    return sum(np.count_nonzero(each) for each in wrong)


# -- R1 --------------------------------------------------------------------------------------------


def oddities():
    """A ground and, over it, triangles without area, one edge-on to the sun, a wire of 0.1 mm, five
    equal ones in one plane, and a slab so high that no slice reaches it."""
    along = SUN.to_light
    corners = [
        [[-3, 1, 0]] * 3,
        [[-2, 1, -1], [-2, 1, 0], [-2, 1, 1]],
        [[0, 0.5, -1], [0, 0.5, 1], np.array([0, 0.5, 0]) + 2 * along],
        [[1, 0, 2], [1.0001, 0, 2], [1, 3, 2]],
        *[[[2, 1, -1], [3, 1, -1], [2.5, 1, 1]]] * 5,
    ]
    positions = np.reshape(corners, (-1, 3)).astype(float)
    triangles = np.arange(len(positions)).reshape(-1, 3)
    slab = shapes.mesh("slab", shapes.box((-1, 60, -1), (1, 61, 1)))
    ground = shapes.mesh("ground", shapes.ground(12.0))
    return csm.Scene([ground, slab, csm.Mesh(positions, triangles, name="oddities")])


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("pancake", [False, True], ids=["range", "pancake"])
def test_r1_odd_triangles_under_every_sun(figure, renderer, fit, pancake):
    scene, worst, shown = oddities(), -1, None
    settings = csm.ShadowSettings(map_size=128, pancake=pancake, **FITS[fit])
    for number, to_light in enumerate(
        [SUN.to_light, (0, 1, 0), (1, 1e-9, 0), (0.3, -0.5, 0.2), (0, -1, 0)]
    ):
        camera = small_scenes.camera(number % 4, size=(96, 54))
        frame = renderer.render(scene, camera, csm.Sun(to_light), settings, outputs=OUTPUTS)
        wrong = no_visibilities(frame)
        if wrong > worst:
            worst, shown = wrong, frame.mask
        up = frame.valid & (frame.normal[..., 1] > 0.99)
        assert up.any()
        if to_light[1] <= 0:
            assert (frame.mask[up] == 0.0).all()
    figure("R1", "values that are none", worst, 0, "pixels", picture=lambda: grey(shown))


def test_r1_what_has_no_area_shadows_nothing(figure, renderer):
    # Points and lines have no width; seen edge-on by the sun, a triangle has none either.
    positions = [[-3, 1, 0]] * 3 + [[-2, 1, -1], [-2, 1, 0], [-2, 1, 1]]
    positions += [[0, 0.5, -1], [0, 0.5, 1], np.array([0, 0.5, 0]) + 2 * SUN.to_light]
    nothing = csm.Mesh(np.array(positions, float), np.arange(9).reshape(3, 3))
    ground = shapes.mesh("ground", shapes.ground(12.0))
    camera = csm.Camera.look_at((0, 9, 3), (0, 0, 0), near=0.5, far=60, size=(160, 90))
    settings = csm.ShadowSettings(map_size=512)
    bare, odd = (
        renderer.render(csm.Scene(meshes), camera, SUN, settings, outputs=OUTPUTS)
        for meshes in ([ground], [ground, nothing])
    )
    on_ground = odd.normal[..., 1] > 0.99
    # The edge-on triangle may keep the texels on its line: its corners round to float32.
    shadowed = (bare.mask != odd.mask)[on_ground].mean()
    figure(
        "R1", "ground shadowed by what has no area", shadowed, 2e-3, "share",
        picture=lambda: drawings.compared(*(np.where(on_ground, f.mask, 0.5) for f in (bare, odd))),
    )  # fmt: skip


def test_r1_five_equal_triangles_are_one(figure, renderer):
    triangle = [[-2, 1, -1], [2, 1, -1], [0, 1.5, 2]]
    ground = shapes.mesh("ground", shapes.ground(12.0))
    frames = [
        renderer.render(
            csm.Scene([ground, csm.Mesh(triangle, np.tile([[0, 1, 2]], (count, 1)))]),
            small_scenes.camera(), SUN, csm.ShadowSettings(map_size=256), outputs=OUTPUTS,
        )
        for count in (1, 5)
    ]  # fmt: skip
    one, five = (frame.mask for frame in frames)
    assert 0.0 in one
    figure(
        "R1", "mask of a stack of equal triangles", np.count_nonzero(one != five), 0, "pixels",
        picture=lambda: drawings.compared(one, five),
    )  # fmt: skip


# -- W1 --------------------------------------------------------------------------------------------


def extreme_cameras():
    """Near 1e-4 m, far 1e6 m, the narrowest and the widest view, rolled, straight down and up."""
    for fov in (0.1, 60.0, 179.0):
        for roll in ((0, 0, 1), (1, 0, 1)):
            for down in (True, False):
                eye = np.array([-2.0, 4.0, 0.2])  # over the box's shadow
                target = eye + np.array([0.0, -1.0 if down else 1.0, 0.0])
                yield csm.Camera.look_at(
                    eye, target, up=roll, fov_y_deg=fov, near=1e-4, far=1e6, size=(48, 27)
                )


@pytest.mark.parametrize("fit", FITS)
def test_w1_extreme_cameras_are_drawn(figure, renderer, fit):
    settings = csm.ShadowSettings(map_size=128, **FITS[fit])
    wrong = uncovered = moved = seen = 0
    shown = None
    for camera in extreme_cameras():
        masks = []
        for away in (0.0, 1e6):
            scene = csm.scenes.plane_and_box().placed((away, away, away))
            frame = renderer.render(
                scene, camera.translated((away, away, away)), csm.Sun((0.4, 1, 0.3)), settings,
                outputs=OUTPUTS,
            )  # fmt: skip
            wrong += no_visibilities(frame)
            uncovered += np.count_nonzero(frame.cascade_index[frame.valid] == 255)
            seen += np.count_nonzero(frame.valid)
            masks.append(frame)
        here, there = masks
        moved += np.count_nonzero(here.valid != there.valid)
        shown = here if shown is None or (0.0 in here.mask and 0.0 not in shown.mask) else shown
    assert seen > 5000
    figure("W1", f"{fit}: values that are none", wrong, 0, "pixels")
    picture = np.where(shown.valid, shown.mask, 0.5)
    figure(
        "W1", f"{fit}: pixels seen and in no map", uncovered, 0, "pixels",
        picture=lambda: grey(picture),
    )  # fmt: skip
    figure("W1", f"{fit}: pixels that see another surface 10^6 m away", moved / seen, 1e-4, "share")


# -- C2 --------------------------------------------------------------------------------------------

LIGHT_ANGLES = (0, 1e-9, 1e-6, 1e-3, 5, 30, 60, 90, 120, 175, 180)  # deg, from the view


@pytest.mark.parametrize("fit", [fit for fit in FITS if not fit.startswith("visible")])
@pytest.mark.parametrize(
    "padding",
    [0, *(pytest.param(p, marks=pytest.mark.slow) for p in (1, 2)), 3,
     *(pytest.param(p, marks=pytest.mark.slow) for p in (4, 5, 6, 7))],
)  # fmt: skip
def test_c2_points_of_the_view_through_every_fit(figure, renderer, fit, padding):
    rng = np.random.default_rng(50 + padding)
    scene = scene_of([[-400, -400, -400], [400, 400, 400]])
    kernel = {"filter": "pcf", "filter_size": 2 * padding + 1} if padding else {}
    settings = csm.ShadowSettings(map_size=256, view_range="camera", **FITS[fit], **kernel)
    coarser = lost = beyond = unlit = 0
    for angle, fov in zip(LIGHT_ANGLES, np.resize([15, 60, 95, 150], 11), strict=True):
        camera = turned(rng, fov, near=0.5, far=60.0, size=(32, 18))
        around = rng.uniform(0, 2 * np.pi)
        side = np.cos(around) * camera.right + np.sin(around) * camera.up
        turn = np.radians(angle)
        sun = csm.Sun(-np.cos(turn) * camera.backward + np.sin(turn) * side)
        seen = oracles.sample_slice(camera, 0.5001, 59.999, 1500, rng)
        behind = oracles.sample_slice(camera, 60.01, 300.0, 300, rng)
        indices = {}
        for select in ("map", "interval"):
            frame = renderer.render(
                scene, camera, sun, settings.replace(select=select), outputs=(),
                points=np.concatenate([seen, behind]),
            )  # fmt: skip
            indices[select] = frame.point_cascade
            away = frame.point_cascade == 255
            unlit += np.count_nonzero(frame.point_visibility[away] != 1.0)
            beyond += np.count_nonzero((frame.point_cascade >= 4) & ~away)
        by_map, by_interval = (indices[select][: len(seen)] for select in ("map", "interval"))
        # On the frustum's own faces float32 decides.
        inner = np.abs((seen - camera.eye) @ np.stack([camera.right, camera.up]).T)
        inner /= -((seen - camera.eye) @ camera.backward)[:, None]
        held = (inner < 0.9999 * np.array([camera.half_width, camera.half_height])).all(axis=1)
        lost += np.count_nonzero(by_map[held] == 255)
        # What lies before a shifted sphere is the map's before: by interval it has none.
        both = held & (by_interval != 255)
        coarser += np.count_nonzero(by_map[both] > by_interval[both])
    figure("C2", f"{fit}: index by map above that by interval", coarser, 0, "points")
    figure("C2", f"{fit}: points of the view in no map", lost, 0, "points")
    figure("C2", "indices of no cascade", beyond, 0, "points")
    figure("C2", "points in no map that are not lit", unlit, 0, "points")


@pytest.mark.parametrize("fit", ["visible", "visible, turned"])
@pytest.mark.parametrize("padding", [0, 3, pytest.param(7, marks=pytest.mark.slow)])
def test_c2_pixels_of_the_view_through_windows_round_them(figure, renderer, fit, padding):
    # These windows owe their slice's points nothing, only what is seen of it and faces the sun.
    scene = small_scenes.soup()
    kernel = {"filter": "pcf", "filter_size": 2 * padding + 1} if padding else {}
    settings = csm.ShadowSettings(map_size=256, **FITS[fit], **kernel)
    coarser = lost = seen = 0
    worst, shown = -1, None
    for number, angle in enumerate(LIGHT_ANGLES):
        camera = small_scenes.camera(number % 4)
        turn = np.radians(angle)
        sun = csm.Sun(-np.cos(turn) * camera.backward + np.sin(turn) * camera.up)
        by_map, by_interval = (
            renderer.render(
                scene, camera, sun, settings.replace(select=select), outputs=OUTPUTS
            )
            for select in ("map", "interval")
        )  # fmt: skip
        # The normal and the sun are float32 to the shaders: edge-on, either may decide.
        facing = by_map.valid & (by_map.normal @ sun.to_light > 1e-6)
        both = facing & (by_interval.cascade_index != 255)
        above = both & (by_map.cascade_index > by_interval.cascade_index)
        away = facing & (by_map.cascade_index == 255)
        seen += np.count_nonzero(facing)
        coarser += np.count_nonzero(above)
        lost += np.count_nonzero(away | (facing & ~both))
        if np.count_nonzero(above | away) > worst:
            worst, shown = np.count_nonzero(above | away), by_map.cascade_index
    assert seen > 10_000
    picture = np.where(shown == 255, 255, 60 * shown.astype(int)).astype(np.uint8)
    figure(
        "C2", f"{fit}: pixels' index by map above that by interval", coarser, 0, "pixels",
        picture=picture,
    )  # fmt: skip
    figure("C2", f"{fit}: pixels that face the sun and are in no map", lost, 0, "pixels")
