"""What `Renderer.visibility` says of points where a pixel would use its neighbours."""

import numpy as np
import pytest

import csm


@pytest.mark.parametrize(
    ("first", "second"),
    [
        # Windows are as wide for both lookups, so only the footprint could tell them apart.
        (
            {"filter": "vsm", "lookup": "trilinear"},
            {"filter": "vsm", "lookup": "anisotropic", "gradients": "quad"},
        ),
        ({"plane": "derivatives"}, {}),
    ],
    ids=["lookup", "plane"],
)
def test_points_are_looked_up_without_neighbours(first, second):
    scene = csm.scenes.plane_and_box()
    x, z = np.meshgrid(np.linspace(-6, 4, 40), np.linspace(-4, 4, 40))
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    normals = np.tile((0.0, 1.0, 0.0), (len(points), 1))
    masks = []
    with csm.Renderer() as renderer:
        for changes in (first, second):
            settings = csm.ShadowSettings(map_size=128, **changes)
            camera = csm.Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), far=100, size=(64, 36))
            renderer.render(scene, camera, csm.Sun((1, 1, 0.2)), settings)
            masks.append(renderer.visibility(points, normals).mask)
    assert masks[0].min() < 0.5 < masks[0].max()
    np.testing.assert_allclose(masks[0], masks[1], atol=1e-5)
