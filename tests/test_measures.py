"""Edges in their place, penumbrae of the sun's width, texels that somebody looks at."""

import dataclasses
import warnings

import numpy as np
import pytest

import csm
from csm import measures

pytest.importorskip("embreex", reason="measures compare with the truth (extra: truth)")

SCENE = csm.scenes.plane_and_box()
# straight down at the shadow of the box: 1 m is 16 pixels
ABOVE = csm.Camera.orthographic(
    (-3, 20, 0), (-3, 0, 0), up=(0, 0, -1), height=6, near=1, far=40, size=(128, 96)
)
DIAGONAL = csm.Sun((1, 1, 0))


@dataclasses.dataclass
class Shown:
    """A frame whose mask is given."""

    mask: np.ndarray
    frame: object

    def __getattr__(self, name):
        return getattr(self.frame, name)


@pytest.fixture(scope="module")
def truth():
    return csm.truth(SCENE, ABOVE, DIAGONAL)


@pytest.fixture
def frame(renderer):
    settings = csm.ShadowSettings(map_size=512, cascade_count=2)
    outputs = ("mask", "valid", "cascade_index")
    return renderer.render(SCENE, ABOVE, DIAGONAL, settings, outputs=outputs)


def test_an_edge_moved_by_five_pixels_is_five_pixels_away(frame, truth):
    still = measures.boundary_distance(Shown(truth.mask, frame), truth)
    assert still.mean == still.largest == 0.0
    assert len(still.from_mask) == len(still.from_truth) > 50
    # the shadow's outline is a rectangle: its sides parallel to z move by 5 pixels, the others stay
    moved = np.roll(truth.mask, -5, axis=1)
    shown = measures.boundary_distance(Shown(moved, frame), truth)
    assert np.percentile(shown.from_mask, 30) == 0.0
    assert shown.largest == pytest.approx(5.0, abs=1.0)
    assert 0.5 < shown.mean < 5.0


def test_a_lost_shadow_is_seen_from_the_truth_alone(frame, truth):
    lost = measures.boundary_distance(Shown(np.ones_like(truth.mask), frame), truth)
    assert len(lost.from_mask) == 0
    assert np.isinf(lost.from_truth).all()
    assert lost.largest == np.inf


def test_rendered_edges_lie_within_a_texel(frame, truth):
    """A nearest compare displaces an edge by half a texel at most, and a pixel's own half."""
    distances = measures.boundary_distance(frame, truth)
    pixel = 6.0 / 96
    # 45 degrees: a texel is sqrt(2) long on the ground
    texel = frame.cascades.texel_size.max() * np.sqrt(2.0) / pixel
    assert distances.percentile_95 <= 0.5 * np.sqrt(2.0) * texel + 1.0


@pytest.mark.parametrize("blur", [1.0, 2.0])
def test_penumbrae_of_the_suns_disc_are_told_from_wider_ones(frame, blur):
    sun = csm.Sun(DIAGONAL.to_light, 8.0)
    soft = csm.truth(SCENE, ABOVE, sun, rays_per_pixel=256)
    disc = dataclasses.replace(soft, sun=DIAGONAL)
    twin = csm.Sun(DIAGONAL.to_light, 8.0 * blur)
    other = csm.truth(SCENE, ABOVE, twin, rays_per_pixel=256)
    error = measures.penumbra_error(Shown(other.mask, frame), disc)
    if blur == 1.0:
        assert error.root_mean_square == 0.0
        assert error.bias == 0.0
        assert error.width_ratio == 1.0
    else:
        # the lit side's penumbra ends at the box: a bit less than twice
        assert 1.6 < error.width_ratio < 2.1
        assert error.root_mean_square > 0.05
    assert error.pixel_count > 300


def test_a_point_sun_has_no_penumbra_to_judge(frame, truth):
    with pytest.raises(ValueError, match="soft truth"):
        measures.penumbra_error(frame, truth)


def test_texels_are_counted_by_brute_force(frame, truth):
    use = measures.texel_use(frame, truth)
    judged = csm.compare(frame, truth).judged
    sizes = frame.cascades.map_size
    for i in range(2):
        found = set()
        for point in truth.position[judged & (frame.cascade_index == i)]:
            u, v, _, w = frame.cascades.uvz_from_world[i] @ (*point, 1.0)
            found.add((int(u / w * sizes[i]), int(v / w * sizes[i])))
        assert use.used[i] == len(found)
        assert use.utilisation[i] == len(found) / sizes[i] ** 2
    assert np.allclose(use.wasted, 1.0 - use.utilisation)
    assert use.receivers.sum() == pytest.approx(1.0)


def test_texels_per_pixel_on_the_ground_are_a_ratio_of_areas(frame, truth):
    """Seen straight down under 45 degrees: a texel's shade is t * t * sqrt(2), a pixel a square."""
    use = measures.texel_use(frame, truth)
    ground = csm.compare(frame, truth).judged & (truth.normal[..., 1] > 0.99)
    ground &= truth.position[..., 1] < 0.01
    pixel = 6.0 / 96
    for i in range(2):
        own = ground & (frame.cascade_index == i)
        if own.any():
            t = frame.cascades.texel_size[i]
            assert np.allclose(use.texels_per_pixel[own], pixel**2 / (t.prod() * np.sqrt(2.0)))
            assert np.allclose(use.coarsest[own], t.max() * np.sqrt(2.0) / pixel)
    shares = use.histogram([0.5, 1.0, 2.0])
    assert shares.sum() == pytest.approx(1.0)
    assert len(shares) == 4


def halved(mask, frame):
    """A frame whose left half is the first cascade's, its right half the second's."""
    shown = Shown(mask, frame)
    shown.cascade_index = np.zeros(mask.shape, np.uint8)
    shown.cascade_index[:, mask.shape[1] // 2 :] = 1
    return shown


def test_a_planted_step_between_cascades_is_counted_by_hand(frame, truth):
    middle = truth.mask.shape[1] // 2
    judged = csm.compare(frame, truth).judged
    left, right = truth.mask[:, middle - 1], truth.mask[:, middle]
    pairs = judged[:, middle - 1] & judged[:, middle]
    assert 0 < np.count_nonzero(pairs & (left != right)) < np.count_nonzero(pairs)
    planted = truth.mask.copy()
    planted[20:50, middle:] = 1.0 - planted[20:50, middle:]  # the second cascade is wrong there
    steps = measures.seam_steps(halved(planted, frame), truth)
    assert steps.pair_count == np.count_nonzero(pairs)
    # where the truth has the edge itself, the planted mask has none: less is no step
    seen = np.count_nonzero((pairs & (left == right))[20:50])
    assert 0 < seen
    assert steps.excess == pytest.approx(seen / steps.pair_count)
    assert steps.per_thousand == pytest.approx(1000.0 * seen / steps.pair_count)
    half = truth.mask + np.where(planted != truth.mask, 0.5 - truth.mask, 0.0)
    halfway = measures.seam_steps(halved(half, frame), truth)
    assert halfway.excess == pytest.approx(0.5 * steps.excess)


def test_what_is_wrong_within_a_cascade_is_no_step_between_two(frame, truth):
    wrong = truth.mask.copy()
    wrong[::3, : truth.mask.shape[1] // 2 - 1] = 0.25  # acne that ends before the boundary
    assert measures.seam_steps(halved(truth.mask, frame), truth).excess == 0.0
    assert measures.seam_steps(halved(wrong, frame), truth).excess == 0.0
    alone = Shown(truth.mask, frame)
    alone.cascade_index = np.zeros(truth.mask.shape, np.uint8)
    steps = measures.seam_steps(alone, truth)
    assert steps.pair_count == 0
    assert np.isnan(steps.excess)


def test_settings_that_go_back_and_forth_are_counted():
    a, b = csm.ShadowSettings(cascade_count=2), csm.ShadowSettings(cascade_count=3)
    still = measures.settings_stability([a, a, a.replace(filter_size=7), a])
    assert (still.steps, still.changed, still.returns) == (3, (), 0), "hard filters have no size"
    assert str(still) == "the same settings over 3 steps"
    once = measures.settings_stability([a, a, b, b])
    assert (once.changed, once.by_effect, once.returns) == ((2,), {"cascade_count": 1}, 0)
    flickers = measures.settings_stability([a, b, a, b, b.replace(map_size=512)])
    assert flickers.changed == (1, 2, 3, 4)
    assert flickers.by_effect == {"cascade_count": 3, "map_size": 1}
    assert flickers.returns == 2, "b again, a again"
    assert flickers.changed_share == 1.0
    assert np.isnan(measures.settings_stability([a]).changed_share)
    with pytest.raises(TypeError, match=r"path .*str at 1"):
        measures.settings_stability([a, "b"])


def test_settings_are_found_in_frames(frame):
    assert measures.settings_stability([frame, frame.settings]).changed == ()


def test_nothing_to_judge_is_no_warning():
    """Pixels that are not judged have no texels: NaN, and no RuntimeWarning of numpy's."""
    scene, sun = csm.scenes.plane_and_box(), csm.Sun((1, 1, 1))
    camera = scene.cameras["corner"].replace(size=(32, 24))
    truth = csm.truth(scene, camera, sun)
    with csm.Renderer() as renderer:
        frame = renderer.render(scene, camera, sun, csm.ShadowSettings(map_size=64))
    assert not csm.compare(frame, truth).judged.all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        use = measures.texel_use(frame, truth)
    assert np.isnan(use.texels_per_pixel).any()


def test_one_choice_is_no_path():
    with pytest.raises(TypeError, match=r"path must be a sequence .*got one ShadowSettings"):
        measures.settings_stability(csm.ShadowSettings())


@pytest.mark.parametrize("name", ["boundary_distance", "penumbra_error", "seam_steps", "texel_use"])
def test_measures_say_what_they_take(frame, truth, name):
    measure, flat = getattr(measures, name), np.ones((3, 4))
    for words in ((flat, flat), (frame, flat), (flat, truth), (truth, frame)):
        kinds = " and ".join(type(word).__name__ for word in words)
        with pytest.raises(TypeError, match=rf"{name} takes a Frame and a Truth \(got {kinds}\)"):
            measure(*words)
