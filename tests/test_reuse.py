"""Maps that serve again are those that a fresh render draws (docs/numerics.md 33).

A second renderer that walks the same path and reuses nothing is the truth of every frame.
"""

import shutil
from importlib import resources

import cutout_scenes
import numpy as np
import pytest
import small_scenes
from paths import SIZE, path, step

import csm
from csm import shapes

SUN = csm.Sun((0.35, 0.8, 0.5))
MASK = ("mask",)


def actions_of(frame):
    return [one["action"] for one in frame.info.get("reuse", [])]


class Pair:
    """Frames of a renderer that reuses its maps and of one that does not."""

    def __init__(self, renderers, scene, settings, reuse="same"):
        self.reusing, self.plain = renderers
        self.scene, self.settings, self.reuse = scene, settings, reuse
        self.actions = []

    def frames(self, camera, sun=SUN, outputs=MASK, scene=None, settings=None, **more):
        scene, settings = scene or self.scene, settings or self.settings
        frames = [
            renderer.render(scene, camera, sun, settings, outputs=outputs, **more, **reuse)
            for renderer, reuse in ((self.reusing, {"reuse": self.reuse}), (self.plain, {}))
        ]
        self.actions += actions_of(frames[0])
        return frames

    def assert_equal(self, camera, **more):
        ours, fresh = self.frames(camera, **more)
        for name in fresh.outputs:
            if name not in ("shadow_maps", "moments"):
                assert np.array_equal(getattr(ours, name), getattr(fresh, name)), name
        return ours


# -- what is kept is what a fresh render draws -----------------------------------------------------

SETTINGS = {
    "default": {},
    "exclusive": {"cull": "exclusive", "lam": 0.8},
    "no culling": {"cull": "none"},
    "interval, blended": {"select": "interval", "blend": "smooth", "blend_width": 0.3},
    "pcf": {"filter": "pcf", "filter_size": 5, "cull": "exclusive"},
    "pcss": {"filter": "pcss", "filter_size": 9},
    "variance, trilinear": {"filter": "vsm", "filter_size": 3, "lookup": "trilinear"},
    "moments, samples": {"filter": "msm", "samples": 4, "moment_format": "float32"},
    "summed areas": {"filter": "savsm", "filter_size": 5},
    "layers": {"filter": "lvsm", "layer_count": 2},
    "atlas": {"storage": "atlas", "tile_border": 3},
    "copied tiles": {"storage": "atlas", "tile_border": 1, "copied_tiles": True},
    "separate": {"storage": "separate", "map_size": (96, 64, 48, 40)},
    "cube": {"storage": "cube"},
    "16 bits reversed": {"depth_format": "d16", "reversed_depth": True},
    "caster bias, back": {
        "bias": "manual", "bias_side": "caster", "slope_bias": 2.0, "caster_faces": "back",
    },
    "warped": {"warp": "lispsm"},
    "turned": {"fit": "visible", "snap": "none", "turned": True},
    "visible, window depths": {"fit": "visible", "depth_range": "window", "split": "sdsm"},
    "levels": {"snap": "approximate", "fit": "box", "level_count": 32, "light_basis": "world"},
}  # fmt: skip
SCENES = {
    "copies": small_scenes.copies,
    "soup": small_scenes.soup,
    "scraps": cutout_scenes.scraps,
}


@pytest.mark.parametrize("name", SETTINGS)
def test_mask_is_that_of_a_fresh_render_to_the_bit(renderers, name):
    scene = SCENES[list(SCENES)[list(SETTINGS).index(name) % len(SCENES)]]()
    settings = csm.ShadowSettings(**{"map_size": 80, "cascade_count": 4, **SETTINGS[name]})
    pair = Pair(renderers, scene, settings)
    shadowed = 0
    for camera in path():
        shadowed += np.count_nonzero(pair.assert_equal(camera).mask < 1.0)
    assert shadowed > 300
    # frames 2, 8 and 11 repeat the one before them
    assert pair.actions.count("keep") >= 12
    assert pair.actions.count("draw") >= 4
    assert "scroll" not in pair.actions


def test_casters_that_come_into_sight_are_drawn_into_what_is_there(renderers):
    pair = Pair(renderers, small_scenes.copies(200), csm.ShadowSettings(map_size=32))
    camera = small_scenes.camera(1, size=SIZE)
    added = []
    for turn in np.tile([0.04, 0.04, 0.04, -0.04, -0.04, 0.1], 6):
        camera = step(camera, turn_deg=turn)
        added.append(pair.assert_equal(camera))
    adding = [f for f in added if "add" in actions_of(f)]
    assert adding
    for frame in adding:
        i = actions_of(frame).index("add")
        assert frame.info["triangles_drawn"][i] > 0
        assert frame.info["reuse"][i]["texels_saved"] == 32 * 32


# -- what is forgotten -----------------------------------------------------------------------------


def among_poles(seed):
    """Blocks that differ between poles that do not: all such scenes have the same bounds."""
    rng = np.random.default_rng(seed)
    poles = shapes.boxes([[-9, 0, -9], [8, 0, 8]], [[-8, 6, -8], [9, 6, 9]])
    lower = rng.uniform((-5, 0, -5), (4, 1, 4), size=(9, 3))
    blocks = shapes.boxes(lower, lower + rng.uniform(0.5, 2.0, size=(9, 3)))
    return csm.Scene([shapes.mesh("poles", poles), shapes.mesh("blocks", blocks),
                      shapes.mesh("ground", shapes.ground(12.0))])  # fmt: skip


class TestForgotten:
    """Whatever else touches the maps makes them unknown."""

    camera = small_scenes.camera(0, size=SIZE)

    def warmed(self, renderers, **changes):
        settings = csm.ShadowSettings(map_size=64, **changes)
        pair = Pair(renderers, small_scenes.soup(), settings)
        pair.assert_equal(self.camera)
        assert actions_of(pair.assert_equal(self.camera)) == ["keep"] * 4
        return pair

    def check(self, pair, action, **more):
        assert actions_of(pair.assert_equal(self.camera, **more)) == [action] * 4

    def test_by_a_render_that_reuses_nothing(self, renderers):
        pair = self.warmed(renderers)
        renderers[0].render(pair.scene, self.camera, SUN, pair.settings, outputs=MASK)
        self.check(pair, "draw")

    def test_by_another_scene_and_back(self, renderers):
        pair = Pair(renderers, among_poles(1), csm.ShadowSettings(map_size=64))
        other = among_poles(2)
        assert np.array_equal(other.bounds, pair.scene.bounds)
        for scene in (pair.scene, other, pair.scene):
            self.check(pair, "draw", scene=scene)
            self.check(pair, "keep", scene=scene)

    def test_by_other_settings_and_back(self, renderers):
        pair = self.warmed(renderers)
        for changes in ({"filter": "pcf"}, {"depth_format": "d16"}, {"lam": 0.9}, {}):
            self.check(pair, "draw", settings=pair.settings.replace(**changes))

    def test_by_another_sun(self, renderers):
        pair = self.warmed(renderers)
        self.check(pair, "draw", sun=csm.Sun((0.35, 0.8, 0.5000001)))

    def test_not_by_a_wider_sun_nor_by_another_picture(self, renderers):
        pair = self.warmed(renderers)
        self.check(pair, "keep", sun=csm.Sun(SUN.to_light, 0.5))
        self.camera = self.camera.replace(
            size=(32, 18), half_width=self.camera.half_width, half_height=self.camera.half_height
        )
        self.check(pair, "keep")

    def test_by_reloaded_shaders(self, renderers):
        pair = self.warmed(renderers)
        renderers[0].reload()
        self.check(pair, "draw")

    def test_by_a_scene_that_died(self, renderers):
        pair = Pair(renderers, None, csm.ShadowSettings(map_size=64))
        for seed in range(6):  # an upload may get the dead one's address
            pair.scene = None
            pair.scene = among_poles(seed)
            self.check(pair, "draw")

    def test_by_points_which_need_casters_out_of_sight(self, renderers):
        pair = self.warmed(renderers)
        rng = np.random.default_rng(3)
        points = rng.uniform((-8, 0, -8), (8, 4, 8), (500, 3))
        ours = pair.assert_equal(self.camera, points=points)
        assert set(actions_of(ours)) <= {"keep", "add"}
        assert (ours.point_visibility < 1).any()
        self.check(pair, "keep")

    def test_by_visibility_which_draws_maps_whole(self, renderers):
        pair = self.warmed(renderers)
        points = np.random.default_rng(3).uniform((-8, 0, -8), (8, 4, 8), (500, 3))
        ours, fresh = (one.visibility(points) for one in renderers)
        assert np.array_equal(ours.mask, fresh.mask)
        self.check(pair, "draw")

    def test_by_moments_that_were_not_wanted_before(self, renderers):
        settings = csm.ShadowSettings(map_size=64, filter="vsm")
        pair = Pair(renderers, small_scenes.soup(), settings)
        pair.frames(self.camera, outputs=("shadow_maps",))
        self.check(pair, "draw", outputs=("mask", "shadow_maps"))
        self.check(pair, "keep", outputs=("mask", "shadow_maps"))

    def test_by_a_frame_that_failed(self, fresh_renderer, plain_renderer, tmp_path):
        folder = tmp_path / "shaders"
        shutil.copytree(resources.files("csm.shaders"), folder)
        broken = fresh_renderer(shader_dir=folder, stage="compute")
        pair = self.warmed((broken, plain_renderer))
        (folder / "shadow_mask.comp").write_text("void main() { wrong }")
        outputs = ("mask", "valid")  # another program of the mask, after the maps
        with pytest.raises(csm.ShaderError):
            broken.render(
                pair.scene, self.camera, SUN, pair.settings, outputs=outputs, reuse="same"
            )
        self.check(pair, "draw")


# -- the view --------------------------------------------------------------------------------------


class TestViewIsKept:
    camera = small_scenes.camera(0, size=SIZE)
    every = ("mask", "valid", "view_depth", "normal", "cascade_index")

    def check(self, pair, kept, **more):
        ours = pair.assert_equal(more.pop("camera", self.camera), outputs=self.every, **more)
        assert ("view" not in ours.timings_ms) == kept

    def pair(self, renderers):
        pair = Pair(renderers, small_scenes.soup(), csm.ShadowSettings(map_size=64))
        self.check(pair, False)
        self.check(pair, True)
        return pair

    def test_where_light_and_settings_change(self, renderers):
        pair = self.pair(renderers)
        self.check(pair, True, sun=csm.Sun((-0.4, 0.7, 0.2)))
        for changes in (
            {"filter": "pcf"},
            {"map_size": 32, "caster_faces": "front"},
            {"fit": "visible", "split": "sdsm"},
            {"filter": "none"},
            {"storage": "separate", "cull": "exclusive"},
        ):
            self.check(pair, True, settings=pair.settings.replace(**changes))

    def test_after_a_render_that_reuses_nothing(self, renderers):
        pair = self.pair(renderers)
        turned = self.camera.replace(far=0.5 * self.camera.far)
        renderers[0].render(pair.scene, turned, SUN, pair.settings, outputs=MASK)
        self.check(pair, False)
        renderers[0].render(pair.scene, self.camera, SUN, pair.settings, outputs=MASK)
        self.check(pair, True)

    @pytest.mark.parametrize(
        "changes",
        [
            {"near": 0.11},
            {"far": 55.0},
            {"eye": (0.0, 2.0, 9.0)},
            {"half_width": 0.5},
            {"centre_x": 0.01},
            {"size": (48, 27)},
        ],
        ids=lambda changes: next(iter(changes)),
    )
    def test_not_by_another_camera(self, renderers, changes):
        pair = self.pair(renderers)
        self.check(pair, False, camera=self.camera.replace(**changes))
        self.check(pair, False)

    def test_not_by_another_scene_reloaded_shaders_or_a_dead_scene(self, renderers):
        pair = self.pair(renderers)
        self.check(pair, False, scene=among_poles(1))
        self.check(pair, False)
        renderers[0].reload()
        self.check(pair, False)
        for seed in range(4):  # an upload may get the dead one's address
            pair.scene = None
            pair.scene = among_poles(seed)
            self.check(pair, False)


# -- scrolling -------------------------------------------------------------------------------------


def yard(seed=5):
    """Blocks on a ground that goes on beyond every window, all faces along the axes."""
    rng = np.random.default_rng(seed)
    lower = rng.uniform((-26, 0, -26), (24, 0, 24), size=(60, 3))
    upper = lower + rng.uniform((0.3, 0.4, 0.3), (4, 5, 4), size=(60, 3))
    blocks = shapes.mesh("blocks", shapes.boxes(lower, upper))
    return csm.Scene([shapes.mesh("ground", shapes.ground(200.0)), blocks])


def exposed(size, shift):
    """(size, size) bool: texels [v, u] that a window moved by so many did not hold before."""
    v, u = np.indices((size, size))
    held = (u + shift[0] >= 0) & (u + shift[0] < size) & (v + shift[1] >= 0) & (v + shift[1] < size)
    return ~held


def snapping(cascades, i, depth_format):
    """Largest difference of two depths of map i that a rasteriser's snapping explains.

    It moves corners to 1/256 texel. Two draws may round to either side: that moves a point of a
    face, a mean of its corners, by at most as much, and its depth by the face's |gx| + |gy| times
    that. A face that the window cuts gets corners there, snapped again: twice that, and 4 roundings
    of float32 and one of the format.
    """
    rows = cascades.light_from_world[i][:3, :3]  # columns: the faces' normals in light space
    steepest = (np.abs(rows[:2]).sum(axis=0) / np.abs(rows[2])).max()
    span = np.diff(cascades.depth_range[i])[0]
    step = steepest * cascades.texel_size[i].max() / 128.0 / span
    return step + 4 * 2.0**-24 + {"d32f": 0.0, "d24": 2.0**-24, "d16": 1 / 65535}[depth_format]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"depth_format": "d24", "storage": "atlas", "tile_border": 2, "reversed_depth": True},
        {"depth_format": "d16", "storage": "separate", "map_size": (200, 160)},
        {"depth_format": "d24", "storage": "cube", "fit": "diameter"},
    ],
    ids=str,
)
def test_scrolled_maps_are_fresh_ones_but_for_snapping_however_long(renderers, changes):
    settings = csm.ShadowSettings(**{"map_size": 200, "cascade_count": 2, "cull": "none"} | changes)
    pair = Pair(renderers, yard(), settings, reuse="scrolled")
    camera = csm.Camera.look_at((10, 3, 12), (0, 1, 0), fov_y_deg=55, near=0.3, far=80, size=SIZE)
    first = csm.fit_cascades(camera, SUN, settings.replace(fit="sphere"), scene=pair.scene)
    across = 2.0 * first.texel_size.max() * first.light_from_world[0][:2, :3]  # along u and v
    scrolls, ages, wrong, masks, sides = 0, [0, 0], [], 0, set()
    for number in range(60):
        way = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)][number % 4]) @ across
        camera = step(camera, 0.05, 0.0, 0.2 * np.sin(0.3 * number)).translated(way)
        ours, fresh = pair.frames(camera, outputs=("mask", "shadow_maps"))
        masks += np.count_nonzero(ours.mask != fresh.mask)
        for i, done in enumerate(ours.info["reuse"]):
            scrolls += done["action"] == "scroll"
            sides |= {tuple(np.sign(done["shift"]))}
            ages[i] = 0 if done["action"] == "draw" else ages[i] + (done["action"] == "scroll")
            difference = np.abs(ours.shadow_maps[i].astype(float) - fresh.shadow_maps[i])
            beyond = difference > snapping(ours.cascades, i, settings.depth_format)
            wrong.append((ages[i], beyond.mean()))
            # what is new in the window was drawn as in a fresh map: the same bits
            new = exposed(len(difference), done["shift"])
            assert not difference[new].any()
    assert scrolls > 40
    assert sides >= {(1, 1), (1, -1), (-1, 1), (-1, -1)}
    oldest = max(age for age, _ in wrong)
    assert oldest >= 10, "maps that went through many scrolls"
    # Fewer than one texel in five is crossed by an outline; of those 2 sqrt(2) / 256 have their
    # centre as near to it as it moves. After ten scrolls as after one: a texel is drawn once.
    assert max(share for _, share in wrong) < 0.002
    assert masks <= 0.0005 * 60 * SIZE[0] * SIZE[1]


@pytest.mark.parametrize("changes", [{}, {"cull": "exclusive", "caster_faces": "back"}], ids=str)
def test_casters_that_were_out_of_sight_are_drawn_into_scrolled_maps(renderers, changes):
    settings = csm.ShadowSettings(map_size=200, cascade_count=2, **changes)
    pair = Pair(renderers, small_scenes.copies(300), settings, reuse="scrolled")
    camera = small_scenes.camera(1, size=SIZE)
    pair.frames(camera)
    points = np.random.default_rng(3).uniform((-7, 0, -7), (7, 1, 7), (2000, 3))
    # points ask for casters of the whole window, most of which the picture did not want
    ours, fresh = pair.frames(step(camera, aside=0.2), points=points)
    assert "scroll" in actions_of(ours)
    shadowed = fresh.point_visibility < 1.0
    assert shadowed.mean() > 0.1
    wrong = np.count_nonzero(ours.point_visibility != fresh.point_visibility)
    assert wrong <= 0.002 * len(points)
    for _ in range(12):
        camera = step(camera, forward=0.02, turn_deg=3.0)
        ours, fresh = pair.frames(camera)
        assert np.count_nonzero(ours.mask != fresh.mask) <= 2
    assert pair.actions.count("scroll") > 8


def test_a_scroll_is_by_the_lattice_and_draws_what_is_new(renderers):
    settings = csm.ShadowSettings(map_size=256, cascade_count=1, cull="none")
    pair = Pair(renderers, small_scenes.copies(200), settings, reuse="scrolled")
    camera, last, seen = small_scenes.camera(2, size=SIZE), None, set()
    for move in ({}, {"aside": 0.3}, {"aside": -0.7}, {"forward": 0.5}, {"aside": 1.1}):
        camera = step(camera, **move) if move else camera
        frame, fresh = pair.frames(camera)
        lattice, (done,) = frame.cascades.lattice[0], frame.info["reuse"]
        if done["action"] == "scroll":
            moved = lattice - last
            assert tuple(moved) == done["shift"]
            assert done["texels_saved"] == np.prod(256 - np.abs(moved))
            drawn = frame.info["triangles_drawn"][0]
            assert drawn + done["triangles_saved"] == fresh.info["triangles_drawn"][0]
            seen |= {tuple(np.sign(moved))}
        last = lattice
    assert len(seen) >= 3, "to several sides"


def test_scrolling_is_left_where_copies_cost_more_than_drawing(renderers):
    ground = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    few = csm.ShadowSettings(map_size=512, cascade_count=1)
    found = {}
    for name, scene, settings in (
        ("two triangles", ground, few),
        ("two triangles, 16 bits", ground, few.replace(depth_format="d16")),
        ("a thousand", small_scenes.copies(200), few),
        ("moments", small_scenes.copies(200), few.replace(filter="vsm")),
        ("free", small_scenes.copies(200), few.replace(snap="none")),
    ):
        pair = Pair(renderers, scene, settings, reuse="scrolled")
        for aside in (0.0, 0.3):
            frame, _ = pair.frames(step(small_scenes.camera(2, size=SIZE), aside=aside))
        (found[name],) = actions_of(frame)
        scratch = (
            frame.info["bytes"]
            - pair.plain.render(scene, frame.camera, SUN, settings, outputs=MASK).info["bytes"]
        )
        bytes_ = 512 * 512 * (2 if settings.depth_format == "d16" else 4)
        assert scratch == (0 if name in ("moments", "free") else bytes_)
    assert found == {
        "two triangles": "draw",
        "two triangles, 16 bits": "scroll",
        "a thousand": "scroll",
        "moments": "draw",
        "free": "draw",
    }


def test_frames_aside_are_no_steps_of_the_walk(renderer):
    scene, settings = yard(), csm.ShadowSettings(map_size=32)
    camera = small_scenes.camera(0, size=(16, 9))
    renderer.render(scene, camera, SUN, settings, outputs=MASK)
    held = renderer._walk.held
    with renderer.aside():
        renderer.render(scene, step(camera, forward=3.0), SUN, settings, outputs=MASK)
        assert renderer._walk.held is not held
    assert renderer._walk.held is held
