"""What moves with the camera and what must not, on rendered frames (X1 to X3 of
docs/numerics.md 16)."""

import threading

import drawings
import mask_oracle
import numpy as np
import pytest
import small_scenes

import csm
from csm import shapes

MAP_SIZE = 512
QUANTUM = {"d32f": 2.0**-24, "d24": 1 / (2**24 - 1), "d16": 1 / 65535}
# After a move by whole texels a rasteriser's own sub-texel snapping still moves depths by
# up to 35 quanta of 24 bits.
MARGIN = {"d32f": 64 * 2.0**-24, "d24": 64 * 2.0**-24, "d16": 2 / 65535}
SUN = csm.Sun((0.35, 0.8, 0.5))
FRAMES = 300


def yard(seed=5):
    """A ground with blocks on it, 60 m wide."""
    rng = np.random.default_rng(seed)
    lower = rng.uniform((-26, 0, -26), (24, 0, 24), size=(60, 3))
    upper = lower + rng.uniform((0.3, 0.4, 0.3), (4, 5, 4), size=(60, 3))
    blocks = shapes.mesh("blocks", shapes.boxes(lower, upper))
    return csm.Scene([shapes.mesh("ground", shapes.ground(30.0)), blocks])


def walk(frame, size=(32, 18), near=0.3, far=200.0):
    """A camera that walks and turns, with steps of all sizes and a creep in between."""
    t = frame / FRAMES
    pace = t + 0.02 * np.sin(40 * t) if frame % 60 < 40 else t + 1e-7 * frame
    eye = np.array([18 * np.cos(2.0 * pace), 2.0 + 1.5 * np.sin(9 * pace), 20 * np.sin(3.1 * pace)])
    heading = 5.0 * pace + 0.6 * np.sin(23 * pace)
    ahead = np.array([np.cos(heading), -0.25 + 0.2 * np.sin(17 * pace), np.sin(heading)])
    return csm.Camera.look_at(eye, eye + ahead, fov_y_deg=55, near=near, far=far, size=size)


def surface_points(scene, count):
    """(count, 3) points on what the walk sees, spread over it."""
    seen = []
    for frame in range(0, FRAMES, 15):
        truth = csm.truth(scene, walk(frame), SUN)
        seen.append(truth.position[truth.facing])
    seen = np.concatenate(seen)
    return seen[np.random.default_rng(6).permutation(len(seen))[:count]]


def looked_up(frame, points):
    """Of each point in its cascade: (m, 2) texel of the world's lattice, stored depth, and how far
    the compare is from the other answer, in clip depth; NaN outside every map."""
    texel = np.zeros((len(points), 2), np.int64)
    stored, margin = np.full((2, len(points)), np.nan)
    for i in range(frame.cascades.count):
        own = frame.point_cascade == i
        at = small_scenes.texels_of(frame.cascades, i, points[own])
        span = np.diff(frame.cascades.depth_range[i])[0]
        whole = np.floor(at[:, :2]).astype(np.int64)
        texel[own] = whole + frame.cascades.lattice[i]
        u, v = np.clip(whole, 0, MAP_SIZE - 1).T
        stored[own] = frame.shadow_maps[i][v, u]
        # A point without a surface is biased as if at 45 degrees: 3/4 texel of slope sqrt(2).
        bias = 0.75 * np.sqrt(2.0) * frame.cascades.texel_size[i].max() / span
        margin[own] = np.abs(at[:, 2] - bias - stored[own])
    return texel, stored, margin


# -- snapping (X1, X2) -----------------------------------------------------------------------------


def along_the_walk(renderer, settings, points, frames=FRAMES):
    """The frames of the walk, each with what its points looked up."""
    scene = yard()
    for number in range(frames):
        frame = renderer.render(
            scene, walk(number), SUN, settings, outputs=("shadow_maps",), points=points
        )
        yield frame, *looked_up(frame, points)


class Memory:
    """What a point said at first in one cascade of one range, and whether it still says so."""

    def __init__(self, count, tolerance=0.0):
        self._count = count
        self._tolerance = tolerance
        self._first = {}

    def differs(self, key, own, values):
        """Which of the points `own` said something else before under `key`."""
        first, known = self._first.setdefault(
            key, (np.zeros((self._count, *values.shape[1:])), np.zeros(self._count, bool))
        )
        new = own & ~known
        first[new], known[new] = values[new], True
        different = np.abs(first - values) > self._tolerance
        if different.ndim > 1:
            different = different.any(axis=1)
        return different & own


@pytest.fixture(scope="module")
def points():
    return surface_points(yard(), 2000)


@pytest.mark.parametrize("depth_format", QUANTUM)
def test_x2_shadows_stand_still_while_the_camera_moves(figure, renderer, points, depth_format):
    settings = csm.ShadowSettings(map_size=MAP_SIZE, depth_format=depth_format)
    texel_sizes, ranges = {}, []
    lattice, visibility, depth = (Memory(2000) for _ in range(3))
    outlined = np.zeros(2000, bool)
    other_triangle = Memory(2000, tolerance=MARGIN[depth_format])
    judged = close = depth_seen = depth_moved = 0
    resized = jumped = flickered = 0
    off_lattice = 0.0
    for frame, texel, stored, margin in along_the_walk(renderer, settings, points):
        cascades = frame.cascades
        ranges.append(cascades.range_step)
        sure = margin >= MARGIN[depth_format]
        for i in range(4):
            key = (cascades.range_step, i)
            # One texel size per cascade and range, to the bit; the corner on the lattice.
            size = texel_sizes.setdefault(key, cascades.texel_size[i].tolist())
            resized += cascades.texel_size[i].tolist() != size
            clip = cascades.clip_from_light[i]
            corner = (-1.0 - clip[:2, 3]) / np.diag(clip)[:2] / size
            off_lattice = max(off_lattice, np.abs(corner - cascades.lattice[i]).max())
            own = frame.point_cascade == i
            # The texel that a point falls into is a place in the world, not in the picture.
            jumped = max(jumped, lattice.differs(key, own, texel).sum())
            # Where it holds another triangle than before, its centre lies on an outline, to the
            # rasteriser's grid of 1/256 texel; a triangle that the window cuts is snapped anew.
            other = other_triangle.differs(key, own, stored)
            flipped = visibility.differs(key, own & sure, frame.point_visibility)
            flickered += np.count_nonzero(flipped & ~other)
            outlined |= flipped
            moved = depth.differs(key, own, np.round(stored / QUANTUM[depth_format]))
            depth_moved += np.count_nonzero(moved)
            depth_seen += np.count_nonzero(own)
        judged += np.count_nonzero(frame.point_cascade < 4)
        close += np.count_nonzero((frame.point_cascade < 4) & ~sure)
    figure("X2", "texel sizes that changed", resized, 0, "frames")
    figure("X2", "window's corner from whole texels", off_lattice, 1e-9, "texels")
    # Points on a texel's very edge.
    figure("X2", "points in another texel, of 2000", jumped, 2, "points a frame")
    figure("X2", f"flicker at fixed points, {depth_format}", flickered, 0, "points")
    # Fewer than one texel in five is crossed by an outline, and of those 2 sqrt(2) / 256 have their
    # centre that near to it: 0.2 %.
    share = outlined.mean()
    figure("X2", f"points on outlines that flip, {depth_format}", share, 0.002, "share")
    assert judged > 100_000
    assert close < 0.02 * judged, "the margin excludes few"
    if depth_format == "d16":
        figure("X2", "d16 stored depths that changed", depth_moved / depth_seen, 0.02, "share")
    changes = np.count_nonzero(np.diff(ranges))
    assert 1 <= changes <= FRAMES // 5, "the range changes, but seldom"


def test_x2_without_snapping_the_same_points_flicker(renderer, points):
    settings = csm.ShadowSettings(map_size=MAP_SIZE, snap="none")
    visibility, flips = Memory(2000), 0
    for frame, _, _, margin in along_the_walk(renderer, settings, points, frames=40):
        for i in range(4):
            own = (frame.point_cascade == i) & (margin >= MARGIN["d32f"])
            key = (frame.cascades.range_step, i)
            flips += np.count_nonzero(visibility.differs(key, own, frame.point_visibility))
    assert flips > 100


def masks_of_fixed_points(renderer, snap):
    """Masks (m,) and (m,) of world points at the pixels' centres of a first frame, there and in
    each of 30 others, where both see them and take them from one cascade; and the last two
    pictures of the points, (h, w) each.

    A camera of parallel rays that moves along its rows and columns by whole pixels, and along its
    rays by anything, has the same lines through its pixels' centres.
    """
    scene, (width, height), margin = yard(), (96, 60), 12
    settings = csm.ShadowSettings(map_size=MAP_SIZE, snap=snap, view_range="camera")
    outputs = ("mask", "valid", "view_depth", "cascade_index")
    camera = csm.Camera.orthographic(
        (-14, 12, 6), (0, 0, 0), height=30.0, near=1.0, far=90.0, size=(width, height)
    )
    pixel = 2.0 * camera.half_height / height
    middle = np.s_[margin : height - margin, margin : width - margin]
    first = renderer.render(scene, camera, SUN, settings, outputs=outputs)
    points, index = small_scenes.positions_of(first)[middle], first.cascade_index[middle]
    rng = np.random.default_rng(8)
    pairs = []
    for _ in range(30):
        shift = rng.integers(-margin, margin + 1, 2)  # rows down, columns right
        move = pixel * (shift[1] * camera.right - shift[0] * camera.up)
        move += rng.uniform(-3.0, 3.0) * camera.backward
        frame = renderer.render(scene, camera.translated(move), SUN, settings, outputs=outputs)
        seen = (frame.mask, frame.cascade_index, small_scenes.positions_of(frame))
        mask, own, there = (np.roll(values, shift, axis=(0, 1))[middle] for values in seen)
        # A pixel on an outline may show what is behind it; float32 alone moves points by 6e-6 m.
        with np.errstate(invalid="ignore"):
            same = (np.abs(there - points) < 1e-4).all(axis=-1)
        same &= (own == index) & (own != mask_oracle.NO_CASCADE)
        pairs.append((first.mask[middle][same], mask[same]))
    pictures = first.mask[middle], np.where(same, mask, first.mask[middle])
    return *(np.concatenate(masks) for masks in zip(*pairs, strict=True)), pictures


def test_x2_the_mask_at_fixed_points_stands_still_while_the_camera_moves(figure, renderer):
    before, after, pictures = masks_of_fixed_points(renderer, "exact")
    assert len(before) > 0.95 * 30 * 36 * 72
    assert 0.05 < before.mean() < 0.95
    # Points 6e-6 m aside fall into another texel of 0.11 m once in 5000 times (two directions, two
    # sides), and of those texels fewer than half lie at an outline.
    changed = (before != after).mean()
    figure(
        "X2", "mask at fixed points of a camera that moves", changed, 1e-4, "share",
        picture=lambda: drawings.compared(*pictures),
    )  # fmt: skip
    before, after, _ = masks_of_fixed_points(renderer, "none")
    assert (before != after).mean() > 20e-4, "without snapping they flicker"


def test_x2_the_masks_of_a_turning_camera_agree_on_the_world(figure, renderer):
    # The pixel of one frame, looked at again as a point of the next, has the same visibility
    # wherever both frames took it from one cascade. Surfaces are biased by their own planes, so
    # the pixels of one frame are compared through their texels and depths: the mask's oracle.
    scene = yard()
    outputs = ("mask", "valid", "view_depth", "cascade_index", "normal", "shadow_maps")
    settings = csm.ShadowSettings(map_size=MAP_SIZE)
    before, worst = None, 0.0
    for number in range(0, 40, 4):
        frame = renderer.render(scene, walk(number), SUN, settings, outputs=outputs)
        if before is not None and frame.cascades.range_step == before.cascades.range_step:
            positions, normals, _ = mask_oracle.receivers_of(before)
            mask, index = before.mask[before.valid], before.cascade_index[before.valid]
            facing = normals @ SUN.to_light > 1e-4
            for i in range(4):
                at = small_scenes.texels_of(frame.cascades, i, positions)[:, :2]
                own = (index == i) & facing & ((at > 0) & (at < MAP_SIZE)).all(axis=1)
                lowest, highest = mask_oracle.visibility(
                    frame, i, positions[own], normals[own], 60.0
                )
                # Depths move by the rasteriser's snapping: the margin decides few pixels.
                wrong = (mask[own] < lowest) | (mask[own] > highest)
                worst = max(worst, np.count_nonzero(wrong) / max(own.sum(), 1))
        before = frame
    figure("X2", "pixels that the next frame's maps contradict", worst, 0.005, "share")


# -- the rounded range -----------------------------------------------------------------------------


def edge_of_a_step():
    """A scene, and a camera's place along -z where its range just needs the next step."""
    scene = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    settings = csm.ShadowSettings(map_size=64)

    def camera(z):
        return csm.Camera.look_at((0, 2, z), (0, 1.9, z - 1), near=0.3, far=500, size=(16, 9))

    low, high = 0.0, 12.0
    step = csm.fit_cascades(camera(low), SUN, settings, scene=scene).range_step
    assert csm.fit_cascades(camera(high), SUN, settings, scene=scene).range_step > step
    for _ in range(60):
        middle = 0.5 * (low + high)
        if csm.fit_cascades(camera(middle), SUN, settings, scene=scene).range_step > step:
            high = middle
        else:
            low = middle
    return scene, camera, 0.5 * (low + high), settings


def test_a_walk_remembers_its_own_thread_alone(renderer):
    # One step before the edge and one after, close enough to be one walk; in two threads they are
    # two.
    scene, camera, edge, settings = edge_of_a_step()
    before, after = camera(edge - 0.3), camera(edge + 0.3)
    alone = csm.fit_cascades(before, SUN, settings, scene=scene).range_step

    def render_after():
        frame = renderer.render(scene, after, SUN, settings, outputs=("mask",))
        assert frame.cascades.range_step == alone + 1

    other = threading.Thread(target=render_after)
    other.start()
    other.join()
    frame = renderer.render(scene, before, SUN, settings, outputs=("mask",))
    assert frame.cascades.range_step == alone
    render_after()
    held = renderer.render(scene, before, SUN, settings, outputs=("mask",))
    assert held.cascades.range_step == alone + 1, "in one thread they are a walk"


def test_a_camera_that_trembles_at_a_step_flips_at_most_once(renderer):
    scene, camera, edge, settings = edge_of_a_step()
    rng = np.random.default_rng(7)
    steps, alone = [], []
    for _ in range(100):
        here = camera(edge + 0.05 * rng.normal())
        frame = renderer.render(scene, here, SUN, settings, outputs=("shadow_maps",))
        steps.append(frame.cascades.range_step)
        alone.append(csm.fit_cascades(here, SUN, settings, scene=scene).range_step)
    assert np.count_nonzero(np.diff(alone)) > 20, "it would tremble"
    assert np.count_nonzero(np.diff(steps)) <= 1


def test_a_walk_away_and_back_returns_to_its_range(renderer):
    # Held for one step, not for ever: two steps nearer the range is what it would be alone.
    scene, camera, edge, settings = edge_of_a_step()
    places = np.concatenate([np.arange(edge - 20, edge + 6, 0.5), np.arange(edge + 6, -20, -0.5)])
    for z in places:
        frame = renderer.render(scene, camera(z), SUN, settings, outputs=("shadow_maps",))
        alone = csm.fit_cascades(camera(z), SUN, settings, scene=scene).range_step
        assert alone <= frame.cascades.range_step <= alone + 1


def test_frames_of_cameras_far_apart_share_nothing(renderer):
    scene = yard()
    settings = csm.ShadowSettings(map_size=128)
    outputs = ("mask", "cascade_index", "shadow_maps")
    cameras = [walk(0, size=(64, 36)), walk(120, size=(64, 36)), walk(240, size=(64, 36))]
    alone = []
    for camera in cameras:
        with csm.Renderer(debug=True) as other:
            alone.append(other.render(scene, camera, SUN, settings, outputs=outputs))
    for i in (0, 1, 0, 2, 1, 2, 0):
        frame = renderer.render(scene, cameras[i], SUN, settings, outputs=outputs)
        for name in outputs:
            assert np.array_equal(getattr(frame, name), getattr(alone[i], name))


def test_a_range_is_held_along_a_walk_and_not_across_a_cut(renderer):
    # Just past the edge of a step and just before it: held where the camera walked, not where it
    # came from elsewhere, was turned round, or looks at another scene.
    scene, camera, edge, settings = edge_of_a_step()
    past, before = camera(edge + 0.05), camera(edge - 0.05)
    low = csm.fit_cascades(before, SUN, settings, scene=scene).range_step

    def step_after_one_more(first, second, second_scene=scene):
        frame = renderer.render(scene, first, SUN, settings, outputs=("shadow_maps",))
        assert frame.cascades.range_step == low + 1
        frame = renderer.render(second_scene, second, SUN, settings, outputs=("shadow_maps",))
        return frame.cascades.range_step

    assert step_after_one_more(past, before) == low + 1
    aside = before.translated((8.0, 0.0, 0.0))
    assert csm.fit_cascades(aside, SUN, settings, scene=scene).range_step == low
    assert step_after_one_more(past, aside) == low
    turned = before.replace(right=-before.right, backward=-before.backward)
    turned = turned.replace(eye=before.eye * [1, 1, -1])
    assert csm.fit_cascades(turned, SUN, settings, scene=scene).range_step == low
    assert step_after_one_more(past, turned) == low
    twin = csm.Scene([shapes.mesh("ground", shapes.ground(30.0))])
    assert step_after_one_more(past, before, twin) == low


# -- world offsets (X3) ----------------------------------------------------------------------------

DIRECTIONS = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "diagonal": (1, 1, 1)}


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("exponent", range(0, 9))
def test_x3_a_scene_anywhere_in_the_world_looks_the_same(figure, renderer, direction, exponent):
    # Whole metres, as a georeference is: vertices lose nothing up to 2^53 of their own steps.
    offset = 10.0**exponent * np.array(DIRECTIONS[direction])
    scene, camera = yard(), walk(30, size=(160, 90))
    settings = csm.ShadowSettings(map_size=MAP_SIZE, snap="none")
    outputs = ("mask", "valid", "view_depth", "cascade_index")
    here = renderer.render(scene, camera, SUN, settings, outputs=outputs)
    there = renderer.render(
        scene.placed(offset), camera.translated(offset), SUN, settings, outputs=outputs
    )
    figure(
        "X3", "mask against the same at the origin", (here.mask != there.mask).mean(), 1e-4,
        "share", picture=lambda: drawings.compared(here.mask, there.mask),
    )  # fmt: skip
    assert (here.valid != there.valid).mean() <= 1e-4
    both = here.valid & there.valid
    change = np.abs(there.view_depth[both] / here.view_depth[both] - 1.0)
    assert (change > 1e-5).mean() <= 1e-4
    points = small_scenes.positions_of(here)[both]
    worst = 0.0
    for i in range(4):
        at = small_scenes.texels_of(here.cascades, i, points)
        moved = small_scenes.texels_of(there.cascades, i, points + offset)
        # Doubles at `offset` step by 2^-52 of it: the points' own rounding, and the matrix's.
        rounding = 8 * 2.0**-52 * np.abs(offset).max() / here.cascades.texel_size.min()
        assert np.abs(moved - at)[:, :2].max() <= max(1e-9, rounding)
        worst = max(worst, np.abs(moved - at)[:, :2].max())
    figure("X3", "places in the maps against those at the origin", worst, 1e-3, "texels")


@pytest.mark.parametrize("exponent", [0, 2, 4, 6, 8])
def test_x3_a_move_by_whole_texels_keeps_a_snapped_picture(figure, renderer, exponent):
    # The lattice hangs on the world, so a scene moved by anything else meets other texels.
    scene, camera = yard(), walk(30, size=(160, 90))
    settings = csm.ShadowSettings(map_size=MAP_SIZE, cascade_count=1)
    outputs = ("mask", "valid")
    here = renderer.render(scene, camera, SUN, settings, outputs=outputs)
    texel = here.cascades.texel_size[0]
    axes = here.cascades.light_from_world[0][:2, :3]
    whole = np.round(10.0**exponent / texel)
    offset = (whole * texel) @ axes
    there = renderer.render(
        scene.placed(offset), camera.translated(offset), SUN, settings, outputs=outputs
    )
    assert np.array_equal(there.cascades.lattice[0] - here.cascades.lattice[0], whole)
    figure(
        "X3", "snapped mask after a move by whole texels", (here.mask != there.mask).mean(), 1e-4,
        "share", picture=lambda: drawings.compared(here.mask, there.mask),
    )  # fmt: skip
