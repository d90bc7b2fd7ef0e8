"""Pictures say what the arrays say: colours at known pixels, orientation, files."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from csm.camera import Camera
from csm.metrics import compare
from csm.pictures import (
    CASCADE_COLOURS,
    cascades_picture,
    error_picture,
    lit_picture,
    maps_picture,
    mask_picture,
    save_png,
)
from csm.sun import Sun

SIZE = (12, 8)


@pytest.fixture
def frame():
    """A ground lit on the left half, in shadow on the right, under two rows of sky."""
    width, height = SIZE
    valid = np.ones((height, width), bool)
    valid[:2] = False
    mask = np.ones((height, width), np.float32)
    mask[2:, 6:] = 0.0
    normal = np.zeros((height, width, 3), np.float32)
    normal[valid] = (0, 1, 0)
    index = np.where(valid, np.arange(width) // 3, 255).astype(np.uint8)
    return SimpleNamespace(
        mask=mask,
        valid=valid,
        view_depth=np.where(valid, 10.0, np.inf).astype(np.float32),
        cascade_index=index,
        normal=normal,
        camera=Camera.look_at((0, 5, 8), (0, 5, 0), size=SIZE),
        sun=Sun((1, 1, 0)),
        shadow_maps=np.ones((3, 16, 16), np.float32),
    )


def luma(picture):
    return picture.astype(float).mean(axis=-1)


def test_mask_is_white_grey_black_and_sky(frame):
    frame.mask[5, 5] = 0.5
    picture = mask_picture(frame)
    assert picture.dtype == np.uint8
    assert picture.shape == (*frame.mask.shape, 3)
    assert (picture[2:, :5] == 255).all()
    assert (picture[2:, 6:] == 0).all()
    assert picture[5, 5].tolist() == [128, 128, 128]
    sky = picture[:2]
    assert (sky[..., 2] > sky[..., 0]).all()


@pytest.mark.parametrize("terrain", [False, True], ids=["plaster", "terrain"])
def test_lit_ground_is_warmer_and_brighter_than_its_shadow(frame, terrain):
    picture = lit_picture(frame, terrain=terrain)
    assert picture.shape == (*frame.mask.shape, 3)
    assert picture.dtype == np.uint8
    lit, shadow = picture[4, 2].astype(float), picture[4, 9].astype(float)
    assert luma(lit) > 1.4 * luma(shadow)
    assert lit[0] / lit[2] > shadow[0] / shadow[2]
    assert (lit < 255).any(), "exposure must not burn the ground out"


def test_terrain_is_green_where_flat_and_brown_where_steep(frame):
    frame.normal[4] = (0.9, np.sqrt(1 - 0.81), 0)
    flat, steep = (lit_picture(frame, terrain=True)[row, 2].astype(float) for row in (5, 4))
    assert flat[1] > flat[0] > flat[2]
    assert steep[0] > steep[1] > steep[2]


def test_distance_takes_contrast_away(frame):
    near = lit_picture(frame)
    frame.view_depth[frame.valid] = 3e4
    far = lit_picture(frame)
    contrast = [float(np.ptp(luma(picture[4]))) for picture in (near, far)]
    assert contrast[1] < 0.8 * contrast[0]


def test_a_picture_of_nothing_is_sky(frame):
    frame.valid[:] = False
    frame.view_depth[:] = np.inf
    frame.normal[:] = 0
    picture = lit_picture(frame)
    assert (picture[..., 2] >= picture[..., 0]).all()


def test_cascades_have_their_colours_and_grey_beyond(frame):
    frame.cascade_index[7] = 255
    picture = cascades_picture(frame, lit_picture(frame))
    for column, colour in (
        (0, CASCADE_COLOURS[0]),
        (4, CASCADE_COLOURS[1]),
        (7, CASCADE_COLOURS[2]),
    ):
        assert picture[4, column].argmax() == colour.argmax()
    assert (picture[7] == picture[7, :, :1]).all()
    assert np.array_equal(picture[:2], lit_picture(frame)[:2])


def test_errors_are_blue_for_false_light_and_orange_for_false_shadow(frame):
    reference = np.ones(frame.mask.shape, np.float32)
    mask = reference.copy()
    reference[3, 3] = 0.0  # mask lit, truth not: false light
    mask[5, 5] = 0.0
    judged = frame.valid.copy()
    judged[:, 0] = False
    picture = error_picture(compare(mask, reference, valid=judged), lit_picture(frame))
    blue, orange = picture[3, 3], picture[5, 5]
    assert blue[2] == 255
    assert blue[0] < 40
    assert orange.tolist() == [255, 128, 0]
    rest = np.ones(frame.mask.shape, bool)
    rest[3, 3] = rest[5, 5] = False
    assert (picture[rest] == picture[rest][:, :1]).all(), "grey elsewhere"
    assert (picture[2:, 0, 0] < picture[2:, 1, 0]).all(), "what is not judged is darker"


def test_maps_stand_upright_side_by_side_and_keep_thin_casters(frame):
    frame.shadow_maps[0, :8] = 0.5  # lower half of the first map: v = 0 is its bottom
    frame.shadow_maps[0, 15, 3] = 0.2  # one texel in the top row
    picture = maps_picture(frame, side=8)
    tile = 10  # 16 texels shrunk to 8 pixels, framed by 1
    assert picture.shape == (2 * tile, 2 * tile, 3)
    first = picture[1:9, 1:9]
    empty = first[0, 7]
    assert (first[4:] != empty).any(axis=-1).all()
    caster = (first[:4] != empty).any(axis=-1)
    assert np.argwhere(caster).tolist() == [[0, 1]]
    assert luma(first)[0, 1] > luma(first)[7, 0], "nearer to the sun is brighter"
    for i, corner in enumerate([picture[0, 0], picture[0, tile], picture[tile, 0]]):
        assert corner.tolist() == np.round(CASCADE_COLOURS[i] * 255).tolist()
    assert (picture[tile:, tile:] == 255).all(), "no fourth map"


def test_maps_of_unequal_and_odd_sizes(frame):
    frame.shadow_maps = (np.full((16, 16), 0.3, np.float32), np.full((5, 5), 0.3, np.float32))
    picture = maps_picture(frame, side=6)
    assert picture.shape == (8, 16, 3)  # 16 texels in blocks of 3 are 6 pixels, 5 stay 5


def test_png_holds_the_same_bytes(frame, tmp_path):
    image = pytest.importorskip("PIL.Image", reason="reading the PNG back needs Pillow")
    picture = lit_picture(frame)
    save_png(tmp_path / "picture.png", picture)
    with image.open(tmp_path / "picture.png") as saved:
        assert np.array_equal(np.asarray(saved), picture)


def test_a_missing_pillow_names_the_command(frame, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(ImportError, match=r"pip install cascaded-shadow-maps\[plot\]"):
        save_png(tmp_path / "picture.png", mask_picture(frame))
    assert not list(tmp_path.iterdir())
