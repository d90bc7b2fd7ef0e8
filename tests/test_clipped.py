"""Windows round what a slice holds of the scene (G2, fits clipped and focus)."""

import numpy as np
import oracles
import pytest
from views import assert_finite, clip_points, turned

import csm
from csm import _core, shapes

FITS = pytest.mark.parametrize("fit", ["clipped", "focus"])


def box_scene(*boxes):
    """A scene of solid boxes (low, high); each becomes a part of its own."""
    meshes, places = [], []
    for low, high in boxes:
        low, high = np.asarray(low, float), np.asarray(high, float)
        corners = np.array([[(low, high)[(c >> a) & 1][a] for a in range(3)] for c in range(8)])
        triangles = [[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 4, 6], [0, 6, 2], [1, 5, 7]]
        meshes.append(csm.Mesh(corners, triangles))
        places.append(np.eye(4))
    return csm.Scene(meshes, range(len(meshes)), np.array(places))


def box_of(camera, rng, kind):
    """Bounds that hold, miss, touch or flatly cross the view."""
    inside = oracles.sample_slice(camera, camera.near, camera.far, 30, rng)[-1]
    if kind == "containing":
        return camera.eye + np.array([[-1.0], [1.0]]) * 300
    if kind == "disjoint":
        return np.sort(camera.eye + camera.backward * [[5.0], [50.0]], axis=0)
    if kind == "flat":
        half = rng.uniform(2, 60, 3)
        half[rng.integers(3)] = 0.0
        return inside + np.array([[-1.0], [1.0]]) * half
    if kind == "touching":
        corner = oracles.camera_corners(camera, camera.near, camera.far)[rng.integers(4, 8)]
        away = np.sign(corner - camera.eye)
        return np.sort([corner, corner + 20 * away], axis=0)
    half = 10.0 ** rng.uniform(-1, 1.7, 3)
    return inside + np.array([[-1.0], [1.0]]) * half


def held_points(camera, cascades, i, parts, rng):
    """Sampled points of slice i inside any of the parts."""
    points = oracles.sample_slice(camera, *cascades.splits[i : i + 2], 400, rng)
    low, high = np.swapaxes(np.asarray(parts), 0, 1)
    clamped = np.clip(points[:, None], low, high).reshape(-1, 3)
    planes = oracles.camera_planes(camera, *cascades.splits[i : i + 2])
    return clamped[(clamped @ planes[:, :3].T + planes[:, 3] >= 0).all(axis=1)]


@FITS
@pytest.mark.parametrize("kind", ["containing", "disjoint", "touching", "flat", "crossing"])
@pytest.mark.parametrize("snap", ["exact", "none"])
def test_g2_the_window_holds_what_is_seen_of_the_scene(figure, fit, kind, snap):
    rng = np.random.default_rng(60)
    worst, seen = 0.0, 0
    settings = csm.ShadowSettings(fit=fit, snap=snap, cascade_count=3)
    for number in range(12):
        camera = turned(rng, (20, 60, 110)[number % 3], eye=rng.normal(size=3) * 20)
        parts = [box_of(camera, rng, kind)]
        if kind == "crossing":
            parts += [box_of(camera, rng, kind), box_of(camera, rng, "disjoint")]
        sun, scene = csm.Sun(rng.normal(size=3)), box_scene(*parts)
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene)
        assert_finite(cascades)
        for i in range(3):
            points = held_points(camera, cascades, i, parts, rng)
            seen += len(points)
            if len(points):
                beyond = np.abs(clip_points(cascades, i, points)[:, :2]).max() - 1
                worst = max(worst, beyond)
    assert seen == 0 if kind == "disjoint" else seen > 20 if kind == "touching" else seen > 100
    figure("G2", f"{fit}: visible points outside the window", worst, 1e-6, "half windows")


def test_g2_clipped_is_never_wider_than_the_box_and_focus_never_than_clipped():
    rng = np.random.default_rng(61)
    for _ in range(20):
        camera = turned(rng, 60)
        parts = [box_of(camera, rng, "crossing") for _ in range(3)]
        sun, scene = csm.Sun(rng.normal(size=3)), box_scene(*parts)
        texels = [
            csm.fit_cascades(
                camera, sun, csm.ShadowSettings(fit=fit, snap="none"), scene=scene
            ).texel_size
            for fit in ("focus", "clipped", "box")
        ]
        # Positions are rounded to float32: both are widened by 2^-20 of the scene's extent.
        slack = 1 + 4 * 2.0**-20 * np.ptp(scene.bounds, axis=0).max() / texels[0].min() / 2048
        assert (texels[0] <= texels[1] * slack).all()
        assert (texels[1] <= texels[2] * slack + 2.0**-18).all()


def test_without_a_scene_both_are_the_box():
    camera, sun = turned(np.random.default_rng(62)), csm.Sun((1, 2, 3))
    box, clipped, focus = (
        csm.fit_cascades(camera, sun, csm.ShadowSettings(fit=fit, snap="none"))
        for fit in ("box", "clipped", "focus")
    )
    assert np.array_equal(box.clip_from_world, clipped.clip_from_world)
    assert np.array_equal(box.clip_from_world, focus.clip_from_world)


@FITS
def test_sizes_of_snapped_windows_are_quantised_and_held(fit):
    scene = box_scene(([-40, 0, -40], [40, 1, 40]), ([5, 0, 5], [9, 12, 9]))
    sun, settings = csm.Sun((0.3, 1, 0.2)), csm.ShadowSettings(fit=fit, view_range="camera")
    held, fresh = None, []
    steps = 0
    for number in range(60):
        eye = np.array([0.05 * number, 3.0, 30.0 - 0.1 * number])
        ahead = np.array([np.sin(0.02 * number), -0.2, -1.0])
        camera = csm.Camera.look_at(eye, eye + ahead, near=0.3, far=60)
        cascades = csm.fit_cascades(camera, sun, settings, scene=scene, held=held)
        half = cascades.texel_size * (2048 - 1) / 2
        exponent = 8 * np.log2(half)
        np.testing.assert_allclose(exponent, np.round(exponent), atol=1e-9)
        steps += 0 if held is None else np.count_nonzero(cascades.texel_size != held.texel_size)
        alone = csm.fit_cascades(camera, sun, settings, scene=scene)
        fresh.append(alone.texel_size)
        assert (cascades.texel_size <= alone.texel_size * 2 ** (2 / 8) * (1 + 1e-12)).all()
        held = cascades
    unheld = np.count_nonzero(np.diff(fresh, axis=0))
    assert 0 < steps < unheld


def test_boxes_of_the_parts_hold_every_corner_and_make_the_scene():
    points = np.array([[0, 0, 0], [3, 0, 1], [-2, 1, 4.0]])
    scene = csm.Scene(
        [shapes.mesh("ground", shapes.ground(12.0)), shapes.mesh("cone", shapes.cone(1, 0, 2))],
        [0, 1, 1],
        shapes.placements(points, np.zeros(3), np.ones((3, 3))),
    )
    meshes = tuple((mesh.positions, mesh.triangles) for mesh in scene.meshes)
    boxes = _core.scene_boxes(meshes, scene.instance_mesh, scene.world_from_instance, scene.origin)
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    np.testing.assert_allclose([low, high], scene.bounds, atol=1e-4)
    for place in scene.world_from_instance[1:]:
        corners = scene.meshes[1].positions @ place[:3, :3].T + place[:3, 3]
        inside = ((corners[:, None] >= boxes[:, :3]) & (corners[:, None] <= boxes[:, 3:])).all(2)
        assert inside.any(axis=1).all()


@FITS
def test_rendered_windows_are_those_of_fit_cascades(renderer, fit):
    scene = csm.scenes.stairs(6)
    camera = csm.Camera.look_at((7, 5, 9), (-0.5, 0.6, 0), near=0.2, far=80, size=(64, 36))
    sun, settings = csm.Sun((0.4, 1, 0.3)), csm.ShadowSettings(fit=fit, map_size=256)
    frame = renderer.render(scene, camera, sun, settings)
    expected = csm.fit_cascades(camera, sun, settings, scene=scene)
    assert np.array_equal(frame.cascades.clip_from_world, expected.clip_from_world)
