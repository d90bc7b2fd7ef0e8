"""Every camera under every sun of the real scenes against the truth: no more pixels wrong than the
sampling of shadow edges explains, or a listed reason."""

import numpy as np
import pytest
import scene_files

import csm
from csm.metrics import edge_yardstick

OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "normal")
FEWEST_JUDGED = 100  # below that a share of pixels means nothing

SAMPLE = [
    ("ms_shadow_columns", "aisle", "dueling"),
    ("sponza_dabrovic", "nave", "shaft"),
    ("littlest_tokyo", "above", "grazing"),
    ("dutch_ship", "deck", "side"),
    ("denhaag_lod2", "oblique", "sunset"),
    ("bigtujunga_dem", "ridge", "dawn"),
    ("fox_animated", "side", "key"),
    ("forest_assembled", "far", "day"),
]

# Share of judged pixels that disagree [%] at 1280 x 720 on llvmpipe, 2026-11-25, where it is above
# 2 Y + 0.1 %. In all of them the truth has few or no shadow edges in the picture, so that Y leaves
# no room for errors of the bias, a quarter texel of slope.
EXCEPTIONS = {
    # The sun 0.6 degrees high, next to nothing lit. False light: 72 % of it has its occluder nearer
    # than the bias, which is 63 m on ridges that the light grazes (n.L 0.02 in the median).
    ("bigtujunga_dem", "ridge", "horizon"): 1.58,
    # The same from straight overhead, where texels are 21 m: 167 m of bias, again 72 %.
    ("bigtujunga_dem", "map", "horizon"): 4.46,
    # The sun at 45 degrees, 99.99 % lit. Acne: under a texel of 21 m lies a neighbouring cell of
    # 30 m that is steeper than the receiver's plane (0.04 % with half a texel of slope).
    ("bigtujunga_dem", "map", "day"): 0.25,
    # 51 of 6919 pixels. Acne on a body lit from behind, n.L 0.04, facets as small as texels.
    ("fox_animated", "side", "back"): 0.74,
    # 0.01 % lit. False light: 98 % within the bias, 77 m on bark that the light grazes (n.L 0.001).
    ("forest_assembled", "path", "dueling"): 0.38,
}


def judge(renderer, evidence, pair, size):
    """(report, yardstick) of one pair, after what every frame must be."""
    name, camera, sun = pair
    scene = scene_files.load_scene(name)
    camera, sun = scene.cameras[camera].replace(size=size), scene.suns[sun]
    frame = renderer.render(scene, camera, sun, outputs=OUTPUTS)
    truth = csm.truth(scene, camera, sun)
    evidence(rendered=frame.mask, reference=truth.mask, settings=frame.settings)
    assert np.isfinite(frame.mask).all()
    assert ((frame.mask == 0.0) | (frame.mask == 1.0)).all()
    assert np.isfinite(frame.view_depth[frame.valid]).all()
    assert np.isfinite(frame.normal).all()
    assert (frame.cascade_index[frame.valid] < 4).all()
    # The two rasterisers may take either side of an outline, within 1/256 of a pixel.
    assert (frame.valid != truth.valid).mean() < 2e-3
    return csm.compare(frame, truth), edge_yardstick(frame, truth)


@pytest.mark.parametrize(
    "pair",
    [pytest.param(p, marks=pytest.mark.slow if "forest" in p[0] else ()) for p in SAMPLE],
    ids="/".join,
)
def test_sampling_explains_the_error_of_one_pair_per_scene(renderer, evidence, pair):
    report, yardstick = judge(renderer, evidence, pair, (640, 360))
    assert report.judged_count >= FEWEST_JUDGED
    assert report.disagreement < 2.0 * yardstick.value + 0.001
    assert report.mean["total"] < 2.0 * yardstick.value + 0.001


@pytest.mark.slow
@pytest.mark.parametrize("pair", scene_files.pairs() or [("no scene", "", "")], ids="/".join)
def test_sampling_explains_the_error_of_every_pair(renderer, evidence, pair):
    report, yardstick = judge(renderer, evidence, pair, (1280, 720))
    if report.judged_count < FEWEST_JUDGED:
        return
    limit = 2.0 * yardstick.value + 0.001
    if pair in EXCEPTIONS:
        limit = 1.1 * EXCEPTIONS[pair] / 100.0  # from driver to driver it may vary
    assert report.disagreement < limit
    assert report.mean["total"] < limit


def test_exceptions_are_few_and_exist():
    assert len(EXCEPTIONS) <= 15
    pairs = scene_files.pairs()
    if not pairs:
        pytest.skip("the real scenes are absent (set CSM_SCENES to the folder that holds them)")
    assert {*EXCEPTIONS, *SAMPLE} <= set(pairs)
    assert not EXCEPTIONS.keys() & set(SAMPLE)
