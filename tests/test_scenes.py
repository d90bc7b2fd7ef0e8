"""Scenes made by code: deterministic, closed-form where promised, and worth looking at."""

import hashlib

import numpy as np
import pytest

from csm import scenes
from csm.shapes import box, cone, globe, placements, repeat, roof, tube

SMALL = {
    "plane_and_box": {},
    "fence": {},
    "wires": {},
    "stairs": {},
    "long_road": {},
    "foliage": {},
    "forest": {"trees": 300},
    "town": {},
    "demo": {"trees": 500},
}


@pytest.fixture(scope="module")
def made():
    """Every scene once, small."""
    return {name: scenes.SCENES[name](**arguments) for name, arguments in SMALL.items()}


def fingerprint(scene):
    hashed = hashlib.sha256()
    for mesh in scene.meshes:
        hashed.update(mesh.positions.tobytes())
        hashed.update(mesh.triangles.tobytes())
        if mesh.alpha is not None:
            hashed.update(mesh.uv.tobytes() + mesh.alpha.tobytes())
    hashed.update(scene.instance_mesh.tobytes() + scene.world_from_instance.tobytes())
    return hashed.hexdigest()


def normals(positions, triangles):
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    return np.cross(b - a, c - a)


def view_depths(camera, points):
    return (points - camera.eye) @ -camera.backward


# ---------------------------------------------------------------------------------------- shapes


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (box((0, 0, 0), (1, 2, 3)), 6.0),
        # A pyramid over a regular octagon of radius 2: area 4 sqrt(2) / 2 * 4, times h / 3.
        (cone(2.0, 1.0, 4.0, sides=8), 8 * np.sqrt(2)),
        # Two slabs of 0.15 m over half the house and an overhang of 0.5 m; gables have no volume.
        (roof((-3, 5, -4), (3, 8, 4), 0.5, 0.15), 2 * 0.15 * 3.5 * 9.0),
        (repeat(box((0, 0, 0), (1, 1, 1)), placements(np.eye(3) * 5, 30, (1, 2, 3))), 36.0),
    ],
)
def test_shapes_are_closed_and_face_outwards(shape, volume):
    positions, triangles = shape
    edges = np.sort(np.vstack([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=1e-12)


def test_globe_and_tube_face_outwards():
    for (positions, triangles), middle in (
        (globe((1, 2, 3), 0.5, 5, 8), lambda p: np.array([1.0, 2, 3])),
        (tube([(0, 0, 0), (0, 3, 0), (2, 5, 1)], 0.1, 7), None),
    ):
        n = normals(positions, triangles)
        centres = positions[triangles].mean(axis=1)
        if middle is not None:
            away = centres - middle(centres)
            assert np.allclose(np.linalg.norm(positions - middle(0), axis=1), 0.5, rtol=1e-12)
        else:
            away = centres - np.array([0, 1, 0]) * centres
            n, away = n[:14], away[:14]  # the vertical piece: outwards is away from the y axis
        assert (np.einsum("ij,ij->i", n, away) > 0).all()


def test_roof_covers_its_house_and_overhangs():
    positions, _ = roof((-3, 5, -4), (3, 8, 4), overhang=0.5)
    lower, upper = positions.min(axis=0), positions.max(axis=0)
    assert lower[[0, 2]].tolist() == [-3.5, -4.5]
    assert upper[[0, 2]].tolist() == [3.5, 4.5]
    assert upper[1] == pytest.approx(8.15)


# ---------------------------------------------------------------------------------------- scenes


@pytest.mark.parametrize("name", SMALL)
def test_scene_is_the_same_every_time(name, made):
    assert fingerprint(scenes.SCENES[name](**SMALL[name])) == fingerprint(made[name])
    assert made[name].name == name


@pytest.mark.parametrize("name", SMALL)
def test_every_camera_sees_the_scene_and_is_not_inside_it(name, made):
    scene = made[name]
    positions, triangles = scene.flatten()
    assert len(scene.cameras) >= 2
    assert len(scene.suns) >= 3
    centres = positions[triangles].mean(axis=1)
    for camera in scene.cameras.values():
        depth = view_depths(camera, centres)
        scale = 1.0 if camera.orthographic else depth
        x = np.abs((centres - camera.eye) @ camera.right) / scale / camera.half_width
        y = np.abs((centres - camera.eye) @ camera.up) / scale / camera.half_height
        seen = (depth > camera.near) & (depth < camera.far) & (x < 1) & (y < 1)
        assert seen.sum() >= min(50, len(centres) // 2)
        # The far plane cuts nothing off in the middle of a picture.
        assert depth.max() < camera.far
        assert camera.eye[1] > scene.bounds[0, 1]


@pytest.mark.parametrize("name", SMALL)
def test_ground_faces_up_and_nothing_floats_away(name, made):
    scene = made[name]
    ground = scene.meshes[0]
    assert (normals(ground.positions, ground.triangles)[:, 1] > 0).all()
    for array in scene.flatten():
        assert np.isfinite(array).all()
    # No triangle is degenerate beyond what float32 still resolves: a needle of zero area is a
    # caster without a shadow.
    positions, triangles = scene.flatten(scene.origin)
    area = np.linalg.norm(normals(positions, triangles), axis=1)
    assert area.min() > 0


def test_plane_and_box_is_what_its_words_say():
    scene = scenes.plane_and_box()
    plane, cube = (scene.meshes[i].positions for i in (0, 1))
    assert (plane[:, 1] == 0).all()
    assert cube.min(axis=0).tolist() == [-1, 0, -1]
    assert cube.max(axis=0).tolist() == [1, 2, 1]
    # The shadow of the sun "diagonal": corners of the top go to y = 0 along -to_light.
    to_light = scene.suns["diagonal"].to_light
    top = cube[cube[:, 1] == 2]
    thrown = top - to_light * (2 / to_light[1])
    assert np.allclose(thrown.min(axis=0), [-3, 0, -1], atol=1e-15)
    assert np.allclose(thrown.max(axis=0), [-1, 0, 1], atol=1e-15)


def test_stairs_sun_grazes_the_treads():
    # "along" stands 0.03 / 0.3 over the slope of the flight: no tread is shaded by the next riser.
    scene = scenes.stairs()
    to_light = scene.suns["along"].to_light
    assert to_light[1] / to_light[2] == pytest.approx((0.17 + 0.03) / 0.30, rel=1e-12)


def test_stairs_climb_with_the_number_of_steps():
    assert scenes.stairs(10).meshes[1].positions[:, 1].max() == pytest.approx(1.7)
    assert scenes.stairs(40).meshes[1].positions[:, 1].max() == pytest.approx(6.8)


def test_wires_sag_and_never_touch_the_ground():
    wire = scenes.wires(2).meshes[2].positions
    assert 5.5 < wire[:, 1].min() < wire[:, 1].max() < 9.0
    # Thinner than any texel of a 2048 map over the scene: 2 * 140 m / 2048 = 0.14 m.
    assert np.ptp(wire[:4], axis=0).max() <= 0.0101


@pytest.mark.parametrize("triangles", [5_000, 50_000, 200_000])
def test_town_has_the_triangles_asked_for(triangles):
    count = scenes.town(triangles).triangle_count
    assert triangles <= count < triangles + 1800


@pytest.mark.slow
def test_town_of_a_million():
    scene = scenes.town(1_000_000)
    assert 1_000_000 <= scene.triangle_count < 1_001_800
    assert scene.triangle_count == scene.stored_triangle_count


def test_long_road_reaches_the_horizon():
    scene = scenes.long_road(1000.0)
    camera = scene.cameras["driver"]
    assert camera.far / camera.near >= 1e4
    assert scene.bounds[0, 2] < -1000


def test_forest_is_instances_on_the_ground(made):
    scene = made["forest"]
    assert len(scene.meshes) == 5
    assert len(scene.instance_mesh) == 301
    assert scene.stored_triangle_count < scene.triangle_count
    assert len(scenes.forest(40).instance_mesh) == 41
    # Feet are within the cell's sag of the ground; the path, a strip along z, is free.
    feet = scene.world_from_instance[1:, :3, 3]
    ground = scene.meshes[0].positions
    nearest = np.argmin(
        np.hypot(feet[:, None, 0] - ground[None, :, 0], feet[:, None, 2] - ground[None, :, 2]),
        axis=1,
    )
    assert np.abs(feet[:, 1] - ground[nearest, 1]).max() < 1.0
    assert np.abs(feet[:, 0] - 4.0 * np.sin(feet[:, 2] / 23.0)).min() >= 2.2


def test_demo_stands_on_the_real_terrain(made):
    pytest.importorskip("matplotlib")
    from matplotlib import cbook

    import csm
    from csm.elevation import read_elevation, surface_height

    path = cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)
    scene, terrain = made["demo"], csm.load_elevation(path)
    assert np.array_equal(scene.meshes[0].positions, terrain.meshes[0].positions)
    assert len(scene.instance_mesh) == 501
    feet = scene.world_from_instance[1:, :3, 3]
    heights, cell, _ = read_elevation(path)
    ground = surface_height(heights, cell, feet[:, 0], feet[:, 2])
    assert np.allclose(ground - feet[:, 1], 0.3, atol=1e-9)
    for camera in scene.cameras.values():
        under = surface_height(heights, cell, camera.eye[[0]], camera.eye[[2]])[0]
        assert camera.eye[1] > under + 5.0
    assert scenes.demo_terrain(0).triangle_count == terrain.triangle_count


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: scenes.town(100), ValueError, "triangles must be"),
        (lambda: scenes.town(50_000.0), TypeError, "triangles must be a whole number"),
        (lambda: scenes.forest(trees=1), ValueError, "trees must be"),
        (lambda: scenes.forest(trees=True), TypeError, "trees must be a whole number"),
        (lambda: scenes.fence(length=float("nan")), ValueError, "length must be"),
        (lambda: scenes.wires(spans=0), ValueError, "spans must be"),
        (lambda: scenes.stairs(steps="many"), TypeError, "steps must be"),
        (lambda: scenes.long_road(length=1e9), ValueError, "length must be"),
        (lambda: scenes.demo_terrain(trees=-1), ValueError, "trees must be"),
    ],
)
def test_bad_sizes_are_refused(make, error, text):
    with pytest.raises(error, match=text):
        make()
