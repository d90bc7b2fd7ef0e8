"""Summed areas: whole numbers, and rectangles of any place and width (docs/numerics.md 28)."""

import numpy as np
import plates
import pytest

import csm

DEPTHS = (0.1, 0.35, 0.8)


def steps_of(filter_size):
    """Steps of the depths' range in a texel: float32 of what keeps a kernel's sum in 32 bits."""
    return np.float32(min(2 * ((2**31 - 1) // max(filter_size - 1, 1) ** 2), 2**24))


def texels_of(depth, filter_size):
    """(s, s, 2) int64 whole steps of centred depth and of four times its square, in the roundings
    of float32."""
    centred = depth.astype(np.float32) - np.float32(0.5)
    steps = steps_of(filter_size)
    square = np.float32(4) * centred * centred
    scaled = np.stack([centred * steps, square * steps], -1)
    return np.floor((scaled + np.float32(0.5)).astype(np.float32)).astype(np.int64)


def rectangle_weights(size, middle, half_width):
    """(m, s) share of each texel along one axis that lies within a half width of the middle."""
    first = np.clip(middle - half_width, 0, size)[:, None]
    last = np.clip(middle + half_width, 0, size)[:, None]
    edges = np.arange(size)
    return np.clip(np.minimum(last, edges + 1) - np.maximum(first, edges), 0, 1)


def chebyshev(mean, square, depth, least):
    variance = np.maximum(square - mean**2, least)
    behind = depth - 0.5 - mean
    return np.where(behind <= 0, 1.0, variance / (variance + behind**2))


def test_steps_fit_the_sums():
    """A kernel that covers k + 1 texels has k - 1 whole ones: all of them at one end of the range
    add up to less than 2^31 with their sign, and squares to less than 2^32."""
    for size in range(1, 66, 2):
        steps = float(steps_of(size))
        whole = max(size - 1, 1)
        assert np.floor(0.5 * steps + 0.5) * whole**2 < 2**31
        assert np.floor(steps + 0.5) * whole**2 < 2**32


@pytest.mark.parametrize("size", [5, 8, 9, 64, 65, 100, 300])
@pytest.mark.parametrize("stage", ["compute", "fragment"])
def test_sums_are_exact(fresh_renderer, size, stage):
    """What a texel added is read back from the differences of four sums that have wrapped around:
    one wrong sum would show in it."""
    filter_size = 65 if size > 130 else 3 if size > 8 else 1  # a window keeps room for its kernel
    wanted = plates.settings(filter="savsm", filter_size=filter_size, map_size=size)
    frame = fresh_renderer(stage=stage).render(
        plates.scene(DEPTHS, count=60), plates.CAMERA, plates.SUN, wanted,
        outputs=("moments", "shadow_maps"),
    )  # fmt: skip
    own = texels_of(frame.shadow_maps[0], wanted.filter_size)
    sums = np.cumsum(np.cumsum(own, 0), 1) % 2**32  # what the texture holds
    assert size < 64 or (np.abs(np.cumsum(np.cumsum(own, 0), 1)) > 2**32).any()
    padded = np.pad(sums, ((1, 0), (1, 0), (0, 0)))
    back = np.diff(np.diff(padded, axis=0), axis=1) % 2**32
    signed = np.stack([(back[..., 0] + 2**31) % 2**32 - 2**31, back[..., 1]], -1)
    assert (signed == own).all()
    expected = (own * [1.0, 0.25] / float(steps_of(wanted.filter_size))).astype(np.float32)
    np.testing.assert_array_equal(frame.moments[0], expected)


@pytest.mark.parametrize("filter_size", [1, 3, 9, 33, 65])
def test_rectangles_are_means_of_their_texels(renderer, filter_size):
    random = np.random.default_rng(filter_size)
    size = 96
    wanted = plates.settings(filter="savsm", filter_size=filter_size, map_size=size,
                             select="frustum")  # fmt: skip
    texels = random.uniform(0.01, size - 0.01, (1500, 2))  # kernels are cut at the rim, too
    depths = random.uniform(0.05, 0.99, 1500)
    world = plates.scene(DEPTHS)
    frame, lit = plates.seen(renderer, world, wanted, texels, depths)
    own = frame.shadow_maps[0].astype(np.float64) - 0.5
    u, v = (rectangle_weights(size, texels[:, i], filter_size / 2) for i in (0, 1))
    total = u.sum(1) * v.sum(1)
    mean, square = (np.einsum("mv,vu,mu->m", v, p, u) / total for p in (own, own**2))
    expected = chebyshev(mean, square, depths, 0.0)
    # rounding of the mean and of the variance as derived, a receiver's float32 depth; beside a
    # mean, light falls by up to 1 / sigma in depth
    sigma = np.sqrt(np.maximum(square - mean**2, 1e-9))
    least = 0.625 / steps_of(filter_size) + 1.5 * 2.0**-24
    tolerance = 1e-5 + 4e-6 / sigma + 4 * least / sigma**2
    clear = sigma > 1e-3
    assert (filter_size == 1) or np.mean(clear) > 0.4
    assert (np.abs(lit - expected) < tolerance)[clear].all()
    flat = ~clear & (np.abs(depths - 0.5 - mean) > 0.02)
    assert flat.sum() > 10 or filter_size > 9
    np.testing.assert_allclose(lit[flat], depths[flat] - 0.5 < mean[flat], atol=0.003)


@pytest.mark.parametrize("filter_size", [1, 3, 17, 65])
@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_sums_of_either_end_of_the_range_fit(renderer, filter_size, depth):
    """All of a kernel at one end: its sum is as far from 0 as it can be. Where it does not fit 32
    bits it changes its sign, and with it light and shadow."""
    wanted = plates.settings(filter="savsm", filter_size=filter_size, map_size=80)
    texels = np.random.default_rng(1).uniform(34, 46, (200, 2))
    frame, lit = plates.seen(renderer, plates.scene((depth,), count=0), wanted, texels,
                             np.full(200, 0.5))  # fmt: skip
    assert np.abs(frame.shadow_maps[0][2:-2, 2:-2] - depth).max() < 1e-6  # the rim may be empty
    np.testing.assert_allclose(lit, depth, atol=1e-5)


@pytest.mark.parametrize("filter_size", [3, 65])
def test_light_is_never_less_than_the_true_share(renderer, filter_size):
    random = np.random.default_rng(8)
    size = 128
    texels = random.uniform(33, size - 33, (1000, 2))
    depths = random.uniform(0.05, 0.99, 1000)
    wanted = plates.settings(filter="savsm", filter_size=filter_size, map_size=size)
    frame, lit = plates.seen(renderer, plates.scene(DEPTHS), wanted, texels, depths)
    u, v = (rectangle_weights(size, texels[:, i], filter_size / 2) for i in (0, 1))
    stored = frame.shadow_maps[0].astype(np.float64)
    true = np.array([
        b @ (stored >= z) @ a / (a.sum() * b.sum()) for a, b, z in zip(u, v, depths, strict=True)
    ])  # fmt: skip
    assert (lit - true).min() > -1e-4
    assert lit[true < 0.1].min() < 0.2


def rim_width(lit):
    """Pixels of a row between a tenth and nine tenths of the light."""
    return np.count_nonzero((lit > 0.1) & (lit < 0.9))


def test_kernels_of_metres_and_pixels(renderer):
    """With two cascades, the kernel is as wide in both in metres, or it narrows towards the eye."""
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((9, 5, 9), (0, 0, 0), fov_y_deg=45, near=1, far=60, size=(96, 54))
    sun = csm.Sun(to_light=(0.4, 1.0, 0.3))
    base = csm.ShadowSettings(filter="savsm", filter_size=9, map_size=96, cascade_count=2)
    masks = {
        kernel: renderer.render(scene, camera, sun, base.replace(kernel=kernel)).mask
        for kernel in ("texels", "world", "screen")
    }
    blurred = {kernel: rim_width(mask) for kernel, mask in masks.items()}
    assert blurred["world"] <= blurred["texels"]
    assert blurred["screen"] < blurred["texels"]
    assert min(blurred.values()) > 0
