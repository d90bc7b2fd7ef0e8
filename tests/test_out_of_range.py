"""Receivers outside of the depths that a map holds, which selection by slice still asks for."""

import numpy as np
import pytest

import csm

FILTERS = [
    {"filter": "pcf"}, {"filter": "poisson"}, {"filter": "pcss"},
    {"filter": "vsm"}, {"filter": "evsm2"}, {"filter": "evsm4"}, {"filter": "esm"},
    {"filter": "esm", "log_filter": True}, {"filter": "msm"}, {"filter": "lvsm"},
    {"filter": "savsm"}, {"filter": "fourier"}, {"filter": "fourier", "fourier_terms": 2},
    {"filter": "pcss", "pcss_map": "variance"}, {"filter": "pcss", "pcss_map": "summed"},
]  # fmt: skip
# Of light-view depths [m]: the scene lies behind all of it, and before all of it.
RANGES = {"behind": (-60.0, -59.5), "before": (30.0, 30.5)}


def name_of(changes):
    return " ".join(str(value) for value in changes.values())


@pytest.mark.parametrize("where", RANGES)
@pytest.mark.parametrize("changes", FILTERS, ids=name_of)
def test_v1_empty_maps_shadow_nothing(renderer, figure, changes, where):
    """Nothing is drawn into these maps, so that hard compares find all lit that faces the sun, and
    so must means: powers of depths far outside of the range once made NaN of it, others shadow."""
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=60, size=(48, 27))
    settings = csm.ShadowSettings(
        map_size=64,
        cascade_count=1,
        select="interval",
        depth_range="manual",
        manual_depth_range=RANGES[where],
    )
    sun = scene.suns["morning"]
    hard = renderer.render(scene, camera, sun, settings, outputs=("mask",)).mask
    assert 0.9 < hard.mean() < 1.0  # the dark side of the box remains
    mask = renderer.render(scene, camera, sun, settings.replace(**changes), outputs=("mask",)).mask
    # one rounding of the ratio of powers, logarithms or sums that is 1
    wrong = np.count_nonzero(~(np.abs(mask - hard) <= 1e-3))
    figure("V1", f"empty maps that shadow, {name_of(changes)}, {where}", wrong, 0, "pixels")
    assert wrong == 0
