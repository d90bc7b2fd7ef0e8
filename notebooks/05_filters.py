# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # What a filter makes of a shadow map
#
# A filter turns the depths of some texels into the share of light at a point. Some compare depths
# and average the answers, some average functions of depth beforehand and guess from the means how
# many of the depths lie in front. Here they stand side by side, with what they cost and where
# they fail. Formulas are in `docs/numerics.md`, sections 27 to 32.
#
# Lengths are in metres, times in milliseconds on the machine that runs this, all passes but the
# way back of the picture.

# %%
import math
import statistics

import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import plot, shapes
from csm.timing import by_pass, total_ms

renderer = csm.Renderer()
colours = plot.CASCADE_COLOURS
OUTPUTS = ("mask", "valid", "cascade_index")


def picture(ax, array, title):
    """An image without ticks, its title at the left."""
    ax.imshow(array, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, loc="left", fontsize="small")


def drawn(ax, x, lines, xlabel, ylabel, title, **options):
    """Lines of an axes by name, in the palette's colours."""
    for (name, y), colour in zip(lines.items(), colours, strict=False):
        ax.plot(x, y, color=colour, label=name, **options)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend(frameon=False, fontsize="small")
    ax.set_title(title, loc="left", fontsize="medium")


# %% [markdown]
# ## One crop, every filter
#
# A box and a picket fence throw shadows on a plane, under a sun three times as wide as ours so
# that its penumbra shows. The first two pictures are ray-traced: a sun that is a point, and the
# disc. All others have two maps of 512 x 512; kernels are 7 texels wide.

# %%
sun = csm.Sun.from_compass(125, 35, 1.6)
slats = shapes.boxes_at(
    np.array([[0.25 * i - 3.2, 0, 1.8] for i in range(10)]), (-0.06, 0, -0.02), (0.06, 1.2, 0.02)
)
scene = csm.Scene.merge(csm.scenes.plane_and_box(), csm.Scene.from_arrays(*slats))
camera = csm.Camera.look_at((-5.5, 5, 6), (-2.6, 0, 0.6), fov_y_deg=27, far=30, size=(240, 180))
base = csm.ShadowSettings(map_size=512, cascade_count=2)
point = csm.truth(scene, camera, sun)
soft = csm.truth(scene, camera, sun, rays_per_pixel=64)
ways = {
    "hard": {"filter": "hard"},
    "hardware 2 x 2": {"filter": "pcf", "filter_size": 2},
    **{f"pcf {w}": {"filter": "pcf", "filter_weights": w} for w in ("box", "tent", "gaussian")},
    "poisson": {"filter": "poisson"},
    "poisson, rotated": {"filter": "poisson", "rotated": True},
    "vogel, rotated": {"filter": "poisson", "disc": "vogel", "rotated": True},
    **{name: {"filter": name} for name in ("vsm", "lvsm", "evsm2", "evsm4", "msm", "savsm")},
    "esm": {"filter": "esm"},
    "esm, logarithms": {"filter": "esm", "log_filter": True},
    "fourier": {"filter": "fourier"},
    **{f"pcss, {m}": {"filter": "pcss", "pcss_map": m, "filter_size": 33}
       for m in ("depth", "variance", "summed")},
}  # fmt: skip


# %%
def measured(settings, repeats=3):
    """(frame, ms, MB of maps): the median of a few frames after one that does not count."""
    frames = [
        renderer.render(scene, camera, sun, settings, outputs=OUTPUTS) for _ in range(repeats + 1)
    ]
    ms = statistics.median(total_ms(by_pass(frame.timings_ms)) for frame in frames[1:])
    textures = csm.plan(settings, size=camera.size, outputs=OUTPUTS).textures
    return frames[-1], ms, sum(t.bytes for t in textures if not t.name.startswith("view_")) / 1e6


_, axes = plt.subplots(4, 6, figsize=(14, 8.4), layout="constrained")
axes = axes.ravel()
picture(axes[0], point.mask, "ray-traced, point sun")
picture(axes[1], soft.mask, "ray-traced, sun's disc")
found = {}
for ax, (name, changes) in zip(axes[2:], ways.items(), strict=False):
    frame, ms, mb = measured(base.replace(**{"filter_size": 7, **changes}))
    found[name] = (csm.compare(frame, point), csm.compare(frame, soft), ms, mb)
    picture(ax, frame.mask, f"{name}: {ms:.0f} ms, {mb:.1f} MB")
for ax in axes[2 + len(ways) :]:
    ax.remove()

# %% [markdown]
# A kernel of seven texels blurs the pickets' feet as much as their tips; the sun's disc does not,
# and only `pcss` knows that, since it looks how far the occluder is. `fourier` loses what is near
# its caster: it is for short ranges of depth. Here the kernels are wider than the penumbra, so
# that even a hard compare is nearer to the soft truth than any of them.

# %%
by_error = sorted(found, key=lambda name: found[name][1].mean["total"])
_, (ax, cost) = plt.subplots(1, 2, figsize=(11, 4.8), layout="constrained", sharey=True)
ax.barh(by_error, [100 * found[name][1].mean["total"] for name in by_error], color=colours[0])
ax.set(xlabel="mean error against the sun's disc [%]")
ax.set_title("how far from the soft truth", loc="left", fontsize="medium")
cost.barh(by_error, [found[name][2] for name in by_error], color=colours[1])
cost.set(xlabel="time of all passes [ms]", ylabel="filter", xscale="log")
cost.set_title("and what it costs", loc="left", fontsize="medium")
ax.invert_yaxis()

# %% [markdown]
# ## Across an edge
#
# A plate hangs over the ground under a sun at the zenith; its edge is askew to the texels. Points
# on the ground ask the maps by `renderer.visibility`, at 96 places along the edge, so that what
# is left is the profile that a filter gives an edge. With a box it is a ramp, with a tent or a
# Gaussian an S; the kernel alone decides how wide it is. Of one flat occluder over a flat
# receiver moments know everything: their bounds are the share of light in the kernel, a box's.
# `pcss` follows the sun's disc, which hides the share $\frac12 + (u\sqrt{1-u^2} + \arcsin u)/\pi$
# at $u$ radii from the edge.

# %%
zenith = csm.Sun((0, 1, 0), 5.0)
above = csm.Camera.orthographic(
    (0, 40, 0), (0, 0, 0), up=(0, 0, -1), height=8, near=1, far=60, size=(64, 64)
)
TURN = math.radians(20)
ACROSS, ALONG = (
    np.array([math.cos(TURN), math.sin(TURN)]),
    np.array([-math.sin(TURN), math.cos(TURN)]),
)
one = csm.ShadowSettings(cascade_count=1, map_size=256, fit="box", view_range="camera")


def plate(height, start=0.0, end=8.0):
    """A plate over the ground between two lines [m] along the edge's normal."""
    corners = [(start, -9), (start, 9), (end, 9), (end, -9)]
    places = np.array([a * ACROSS + b * ALONG for a, b in corners])
    return csm.Scene.from_arrays(
        np.column_stack([places[:, 0], np.full(4, height), places[:, 1]]), [[0, 1, 2], [0, 2, 3]]
    )


def profile(world, settings, distance, height=0.0):
    """Visibility at distances [m] from the edge, mean along it."""
    renderer.render(world, above, zenith, settings.replace(cull="none"), outputs=("mask",))
    at = distance[:, None, None] * ACROSS + np.linspace(-1.5, 1.5, 96)[:, None] * ALONG
    points = np.column_stack(
        [at[..., 0].ravel(), np.full(at[..., 0].size, height), at[..., 1].ravel()]
    )
    seen = renderer.visibility(points, np.tile([0.0, 1.0, 0.0], (len(points), 1)))
    return seen.mask.reshape(len(distance), -1).mean(axis=1)


# %%
GROUND = csm.Scene.from_arrays(*shapes.ground(12.0))
edge = csm.Scene.merge(GROUND, plate(2.0))
s = np.linspace(-0.45, 0.45, 121)
nine = one.replace(filter="pcf", filter_size=9)
taps = {w: profile(edge, nine.replace(filter_weights=w), s) for w in ("box", "tent", "gaussian")}
taps["poisson"] = profile(edge, nine.replace(filter="poisson", filter_weights="box"), s)
bounds = {"box": taps["box"], **{
    name: profile(edge, nine.replace(filter=name), s) for name in ("vsm", "evsm4", "msm")
}}  # fmt: skip


def disc_share(height, distance):
    """Share of the sun's disc that a half plane `height` m up leaves, by distance from its edge."""
    u = np.clip(
        distance / (height * math.tan(math.radians(zenith.angular_diameter_deg / 2))), -1, 1
    )
    return 0.5 - (u * np.sqrt(1 - u * u) + np.arcsin(u)) / math.pi


soft_one = one.replace(filter="pcss", filter_size=65, tap_count=64, disc="vogel", map_size=512)
softs = {"the sun's disc": disc_share(2.0, s), "pcss": profile(edge, soft_one, s)}
_, axes = plt.subplots(1, 3, figsize=(13, 3.6), layout="constrained", sharey=True)
for ax, lines, title in zip(
    axes, (taps, bounds, softs), ("taps, 9 x 9", "bounds, 9 x 9", "pcss"), strict=True
):
    drawn(ax, 100 * s, lines, "distance from the edge [cm]", "light", title)

# %% [markdown]
# The higher the edge, the wider the true penumbra. The width between a tenth and nine tenths of
# the light is 1.374 radii of the disc; a fixed kernel is right at one height alone.

# %%
heights = np.array([0.5, 1.0, 2.0, 3.0, 4.0, 6.0])


def width(light, distance):
    """Distance over which light falls from nine tenths to one tenth [m]."""
    return abs(
        np.interp(0.1, light[::-1], distance[::-1]) - np.interp(0.9, light[::-1], distance[::-1])
    )


far = np.linspace(-0.6, 0.6, 161)
widths = {"the sun's disc": [width(disc_share(h, far), far) for h in heights]}
for name, settings in {
    "pcss": soft_one,
    "pcf gaussian, 9 x 9": nine.replace(filter_weights="gaussian"),
}.items():
    widths[name] = [
        width(profile(csm.Scene.merge(GROUND, plate(h)), settings, far), far) for h in heights
    ]
_, ax = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
drawn(ax, heights, widths, "height of the edge [m]", "penumbra, 10 to 90 % [m]",
      "width of the penumbra", marker="o")  # fmt: skip

# %% [markdown]
# ## Light that bleeds
#
# A second plate hangs a metre over the ground and covers all of it, so that the ground is dark
# everywhere. Where the edge of the high plate crosses a kernel, moments of two far depths look as
# if some of them lay behind the ground: the bound is not 0. Two moments of depth cannot know
# better. Layers leak less, warps and four moments next to nothing. The pictures look at the dark
# ground through the plates.

# %%
overlap = csm.Scene.merge(GROUND, plate(6.0), plate(1.0, -9.0, 9.0))
grid = np.linspace(-1.2, 1.2, 120)
leaky = {name: {} for name in ("vsm", "lvsm", "evsm2", "evsm4", "msm")}
leaky["esm"] = {"log_filter": True}
leaks, ground_seen = {}, {}
for name, changes in leaky.items():
    settings = one.replace(filter=name, filter_size=9, **changes)
    leaks[name] = profile(overlap, settings, s)
    x, z = np.meshgrid(grid, grid)
    points = np.column_stack([x.ravel(), 0 * x.ravel(), z.ravel()])
    up = np.tile([0.0, 1.0, 0.0], (len(points), 1))
    ground_seen[name] = renderer.visibility(points, up).mask.reshape(x.shape)
_, axes = plt.subplots(1, len(leaky), figsize=(13, 2.6), layout="constrained")
for ax, (name, image) in zip(axes, ground_seen.items(), strict=True):
    picture(ax, image, f"{name}: up to {image.max():.2f}")

# %% [markdown]
# `bleed_step` takes the light below it for bleeding, `bleed_power` bends what is left. Both lessen
# the leak and both darken honest penumbrae: the edge on the right is a single plate's, which
# needed no help.

# %%
helps = {
    "vsm as it is": {},
    "bleed_step=0.2": {"bleed_step": 0.2},
    "bleed_step=0.4": {"bleed_step": 0.4},
    "bleed_power=3": {"bleed_power": 3.0},
}
variance = one.replace(filter="vsm", filter_size=9)
helped = {name: profile(overlap, variance.replace(**more), s) for name, more in helps.items()}
honest = {name: profile(edge, variance.replace(**more), s) for name, more in helps.items()}
_, axes = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained", sharey=True)
drawn(
    axes[0],
    100 * s,
    helped,
    "distance from the high edge [cm]",
    "light",
    "under two plates: should be 0",
)
drawn(axes[1], 100 * s, honest, "distance from the edge [cm]", "light", "under one plate")

# %% [markdown]
# ## Seams between cascades
#
# Slats over a floor, cut into cascades of very different texels, looked up in smaller levels. The
# level comes from what the map's coordinates change by from pixel to pixel; where two pixels of a
# quad lie in different cascades, a plain difference (`gradients="hardware"`) is of two different
# maps, and the level is nonsense: a line of dashes. With one cascade for the quad, or with steps
# of light space on the pixel's own plane, it is gone. The truth is traced at 36 points a pixel.

# %%
slat = np.array([[0, 3, -60], [0.25, 3, -60], [0.25, 3, 30], [0, 3, 30]])
strips = (np.arange(-60, 60)[:, None, None] * [0.5, 0, 0] + slat).reshape(-1, 3)
faces = (4 * np.arange(120)[:, None, None] + [[0, 2, 1], [0, 3, 2]]).reshape(-1, 3)
floor = csm.Scene.merge(
    csm.Scene.from_arrays(*shapes.ground(200.0)), csm.Scene.from_arrays(strips, faces)
)
low = csm.Camera.look_at(
    (0, 2, 8), (0, 0, 2), (0.2, 1, 0), fov_y_deg=40, near=0.3, far=30, size=(240, 136)
)
slanted = csm.Sun((0.3, 1, 0.1))
fine = csm.truth(floor, low.replace(size=(1440, 816)), slanted).mask
lit = fine.reshape(136, 6, 240, 6).mean(axis=(1, 3))
cut = csm.ShadowSettings(
    filter="vsm", filter_size=1, map_size=1024, split="manual", manual_splits=(5, 8, 12),
    fit="box", select="interval",
)  # fmt: skip


def across(index):
    """Pixels of quads that two cascades share."""
    quads = index.reshape(len(index) // 2, 2, -1, 2)
    mixed = quads.max(axis=(1, 3)) != quads.min(axis=(1, 3))
    return mixed.repeat(2, axis=0).repeat(2, axis=1)


# %%
_, axes = plt.subplots(2, 3, figsize=(11, 4.6), layout="constrained")
plain = renderer.render(floor, low, slanted, cut, outputs=(*OUTPUTS, "view_depth"))
shared = across(plain.cascade_index) & (plain.view_depth < 10)
seams = {}
for row, lookup in zip(axes, ("trilinear", "anisotropic"), strict=True):
    for ax, gradients in zip(row, ("hardware", "quad", "analytic"), strict=True):
        settings = cut.replace(lookup=lookup, gradients=gradients)
        mask = renderer.render(floor, low, slanted, settings, outputs=("mask",)).mask
        error = seams[lookup, gradients] = float(np.abs(mask - lit)[shared].mean())
        picture(ax, mask[60:, 40:200], f"{lookup}, {gradients}: error at seams {error:.3f}")

# %% [markdown]
# ## From one cascade to the next
#
# A long wall throws its edge down the view, through the cascades, blurred by a kernel of 15
# texels. A texel is larger in each, so with a kernel constant in texels the blurred edge jumps in
# width at every split. Held constant in metres it does not. Constant on the screen it grows with
# the distance, up to the kernel that is constant in texels, which is the widest it may be. The
# widths are taken from points on the ground.

# %%
wall = csm.Scene.merge(
    csm.Scene.from_arrays(*shapes.ground(90.0)),
    csm.Scene.from_arrays(
        [[0, 0, -85], [0, 0, 10], [0, 3, 10], [0, 3, -85]], [[0, 1, 2], [0, 2, 3]]
    ),
)
along = csm.Camera.look_at((4, 4, 8), (3, 0, -14), fov_y_deg=50, near=1, far=80, size=(1920, 1080))
evening = csm.Sun.from_compass(270, 45)
long_edge = csm.ShadowSettings(
    filter="pcf",
    filter_size=15,
    filter_weights="tent",
    map_size=1024,
    view_range="camera",
    cull="none",
)
depth = np.linspace(4.0, 60.0, 113)


def edge_widths(settings):
    """Width of the wall's blurred edge [m] at view depths."""
    x = np.linspace(1.0, 5.0, 201)
    z = (along.eye - depth[:, None] * along.backward)[:, 2]
    points = np.stack(np.broadcast_arrays(x, 0.0, z[:, None]), axis=-1).reshape(-1, 3)
    normals = np.tile([0.0, 1.0, 0.0], (len(points), 1))
    light = renderer.render(
        wall, along, evening, settings, outputs=(), points=points, point_normals=normals
    ).point_visibility
    # a ramp of width w has light (1 - light) of w / 6 in all
    return (light * (1 - light)).reshape(len(depth), -1).sum(axis=1) * (x[1] - x[0]) * 6


# %%
kernels = {k: edge_widths(long_edge.replace(kernel=k)) for k in ("texels", "world", "screen")}
blends = {b: edge_widths(long_edge.replace(blend=b, blend_width=0.3))
          for b in ("none", "linear", "smooth")}  # fmt: skip
cuts = csm.fit_cascades(along, evening, long_edge, scene=wall).splits
_, axes = plt.subplots(1, 2, figsize=(12, 3.8), layout="constrained", sharey=True)
for ax, lines, title in zip(
    axes, (kernels, blends), ("what a kernel keeps", "kernel in texels, blended"), strict=True
):
    drawn(ax, depth, lines, "view depth [m]", "width of the edge [m]", title)

# %% [markdown]
# Blending mixes the two masks in a band, so the change is spread. Dithering takes one of the two
# by lot, pixel by pixel, for the price of one lookup, and leaves the rest to whoever smooths the
# picture. The pictures show the edge where the second cascade takes over.

# %%
steps = {name: float(np.abs(np.diff(widths)).max()) for name, widths in blends.items()}
smaller = along.replace(size=(640, 360))
away = np.array([3.0, 0.0, (along.eye - depth[44] * along.backward)[2]]) - along.eye
scale = 360 / (2 * along.half_height * -(away @ along.backward))  # pixels per metre there
column, line = int(320 + scale * (away @ along.right)), int(180 - scale * (away @ along.up))
_, axes = plt.subplots(1, 4, figsize=(13, 2.6), layout="constrained")
rims = {}
for ax, blend in zip(axes, ("none", "linear", "smooth", "dither"), strict=True):
    settings = long_edge.replace(blend=blend, blend_width=0.3)
    frame = renderer.render(wall, smaller, evening, settings, outputs=OUTPUTS)
    rims[blend] = frame.mask[line - 15 : line + 25, column - 40 : column + 40]
    told = f": width grows by up to {steps[blend]:.2f} m" if blend in steps else ""
    picture(ax, rims[blend], blend + told)

# %% [markdown]
# ## Sixteen bits
#
# Half the bytes of a prefiltered map. What is lost depends on what is stored. Of squares of depth
# half floats keep too little: the least variance that covers their rounding lightens whatever is
# near its caster, while the even steps of `"unorm16"` do well. Warped depths have to bend less,
# and bleed for it. Four moments fit 16 bits after a transform, which `"unorm16"` always has.

# %%
formats = {
    f"{name} {form}": {"filter": name, "moment_format": form}
    for name, forms in {
        "vsm": ("float32", "float16", "unorm16"),
        "evsm4": ("float32", "float16"),
        "msm": ("float32", "unorm16"),
    }.items()
    for form in forms
}
stored = {}
for name, changes in formats.items():
    settings = one.replace(filter_size=9, **changes)
    leak = profile(overlap, settings, s).max()
    frame, _, mb = measured(base.replace(filter_size=7, **changes), repeats=1)
    stored[name] = (mb, csm.compare(frame, soft).mean["total"], leak)
_, axes = plt.subplots(1, 3, figsize=(13, 3.2), layout="constrained", sharey=True)
for number, (ax, label, scale) in enumerate(
    zip(
        axes,
        ("maps [MB]", "mean error in the crop [%]", "light under two plates"),
        (1, 100, 1),
        strict=True,
    )
):
    ax.barh(
        list(stored), [scale * values[number] for values in stored.values()], color=colours[number]
    )
    ax.set(xlabel=label, ylabel="filter and format")
    ax.set_title(label.split(" [")[0], loc="left", fontsize="medium")
axes[0].invert_yaxis()
renderer.close()
