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
# # How far to lift a receiver
#
# A shadow map stores one depth for a whole texel. A surface that slopes away from the light lies
# partly before and partly behind that depth, and shadows itself: *acne*. Lifting the receiver
# towards the light before it is compared takes the acne away, and too much of it takes the shadow
# off the foot of its caster: *peter-panning*. Between the two lies a bound that can be computed.
#
# Lengths are in metres. $t$ is the side of a texel, $g = (g_x, g_y)$ the change of the receiver's
# depth per metre along the two axes of the map, $r$ the radius of the filter's kernel in texels,
# $q$ the step between two depths that the map can store.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import plot

renderer = csm.Renderer()
one = csm.ShadowSettings(
    cascade_count=1, map_size=128, fit="scene", snap="none", view_range="camera", bias="manual"
)


def picture(ax, array, title, **options):
    """An image without ticks, its title at the left."""
    ax.imshow(array, cmap="gray", vmin=0, vmax=1, interpolation="nearest", **options)
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, loc="left", fontsize="medium")


# %% [markdown]
# ## Acne, and a box that floats
#
# A box of 2 m on a plane, a sun 35 degrees high, 128 x 128 texels: a coarse map, so that everything
# shows. Without any bias half of every lit surface is dark. With a constant bias of four texels the
# plane is clean, and light creeps in under the box.

# %%
scene = csm.scenes.plane_and_box()
camera = csm.Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=30, size=(480, 270))
sun = csm.Sun.from_compass(70, 35)
truth = csm.truth(scene, camera, sun)
_, axes = plt.subplots(1, 3, figsize=(12, 2.6), layout="constrained")
for ax, (title, settings) in zip(
    axes,
    {
        "no bias": one,
        "4 texels": one.replace(constant_bias_texels=4.0),
        "automatic": one.replace(bias="auto"),
    }.items(),
    strict=True,
):
    frame = renderer.render(scene, camera, sun, settings)
    wrong = csm.compare(frame, truth).disagreement
    picture(ax, frame.mask, f"{title}: {wrong:.1%} wrong")

# %% [markdown]
# ## The bound
#
# Within half a texel of its centre a plane's depth changes by at most $(|g_x| + |g_y|)\,t/2$. A
# kernel of radius $r$ reaches $r$ texels further, and the stored depth is rounded by half a step:
#
# $$ b = (|g_x| + |g_y|)\, t\, \left(r + \tfrac12\right) + \tfrac q2 . $$
#
# Nothing less will do: where the plane slopes along the diagonal of the map, some receiver sits in
# the corner of its texel. So let us tilt planes against the light, give them shares of this bound,
# and count the dark pixels. A rasteriser adds a little of its own, since it moves corners of
# triangles to 1/256 of a texel.


# %%
def tilted(tangent, azimuth_deg=45.0):
    """A plane under a vertical sun, its slope along a direction of the map."""
    a = math.radians(azimuth_deg)
    normal = np.array([-tangent * math.cos(a), 1.0, -tangent * math.sin(a)])
    x = np.array([[-10, -10], [-10, 10], [10, 10], [10, -10]], float)
    y = -(x @ normal[[0, 2]])
    corners = np.column_stack([x[:, 0], y, x[:, 1]])
    return csm.Scene.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])


overhead = csm.Sun((0, 1, 0))
shares = np.linspace(0.0, 1.3, 14)


def acne(tangent, settings, shares):
    """Share of a tilted plane's pixels that are dark, for shares of the bound."""
    top = csm.Camera.orthographic(
        (0, 40, 0), (0, 0, 0), up=(0, 0, -1), height=8, near=1, far=90, size=(257, 257)
    )
    # (|gx| + |gy|) (r + 1/2) texels; the quantum of 32 bits is far below
    radius = settings.filter_size // 2 if settings.filter == "pcf" else 0
    bound = math.sqrt(2.0) * tangent * (radius + 0.5)
    return [
        np.mean(
            renderer.render(
                tilted(tangent), top, overhead, settings.replace(constant_bias_texels=s * bound)
            ).mask
            < 0.999
        )
        for s in shares
    ]


# %%
_, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
curves = {}
for colour, tangent in zip(plot.CASCADE_COLOURS, (0.5, 1.0, 4.0), strict=False):
    curves[tangent] = acne(tangent, one, shares)
    ax.plot(shares, curves[tangent], color=colour, label=f"slope {tangent:g}")
kernel = one.replace(filter="pcf", filter_size=5)
curves["pcf"] = acne(1.0, kernel, shares)
ax.plot(shares, curves["pcf"], "k--", label="slope 1, pcf 5 x 5")
ax.axvline(1.0, color=plot.CASCADE_COLOURS[3], lw=1)
ax.set(xlabel="bias, as a share of the bound", ylabel="dark pixels, share")
ax.legend(frameon=False)
ax.set_title("acne ends at the bound, whatever slope and kernel", loc="left", fontsize="medium")

# %% [markdown]
# ## What a bias costs
#
# A thin wall stands on the ground. Whatever lies nearer to its occluder along the light than the
# bias is lit: with the sun at elevation $\varepsilon$ a bias of $b$ opens a strip of light
# $b \cos\varepsilon$ wide along the wall's foot. The dots are pixels counted in a picture from
# above, the line is that law.

# %%
wall = csm.Scene.merge(
    csm.Scene.from_arrays(
        [[-20, 0, -20], [-20, 0, 20], [20, 0, 20], [20, 0, -20]], [[0, 1, 2], [0, 2, 3]]
    ),
    csm.Scene.from_arrays([[0, 0, -6], [0, 0, 6], [0, 6, 6], [0, 6, -6]], [[0, 1, 2], [0, 2, 3]]),
)
elevation = 40.0
from_east = csm.Sun.from_compass(90, elevation)
above = csm.Camera.orthographic(
    (-2, 30, 0), (-2, 0, 0), up=(0, 0, -1), height=4, near=1, far=60, size=(1200, 900)
)
fine = one.replace(map_size=2048)
biases = np.array([0.0, 0.1, 0.2, 0.4, 0.8])
strips = []
for bias in biases:
    t = csm.fit_cascades(above, from_east, fine, scene=wall).texel_size.max()
    frame = renderer.render(
        wall, above, from_east, fine.replace(constant_bias_texels=bias / t, receiver_plane=True)
    )
    pixel = 4.0 / 900
    x = (np.arange(1200) + 0.5) * pixel - 2.0 - 600 * pixel
    row = frame.mask[450]
    strips.append(np.sum(row[(x < 0) & (x > -3)] > 0.5) * pixel)
_, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
ax.plot(biases, biases * math.cos(math.radians(elevation)), color=plot.CASCADE_COLOURS[0])
ax.plot(biases, strips, "o", color=plot.CASCADE_COLOURS[1])
ax.set(xlabel="bias along the light [m]", ylabel="strip of false light [m]")
ax.set_title("light under a wall grows with the bias", loc="left", fontsize="medium")

# %% [markdown]
# ## Ways to pay less
#
# | way | lifts by | trouble |
# |---|---|---|
# | constant | the same everywhere | too much here, too little there |
# | slope | $s\,t\,(\lvert g_x\rvert + \lvert g_y\rvert)$ | no bound at grazing light |
# | normal offset | along the normal, $o\,t \sin\theta$ | shifts every edge |
# | receiver plane | nothing: compares with the plane at the texel's centre | needs the plane |
# | back faces | nothing: casters are the far sides | thin walls, and light at contacts |
#
# The receiver plane is exact on planes, whatever the kernel: only half a step of depth is left,
# and on meshes a quarter of a texel of slope, since at the texel's centre another facet may lie.
# That is `bias="auto"`. Here is what each way makes of a town, the best of a few strengths each.

# %%
town = csm.scenes.town(8000)
view = csm.Camera.look_at((-30, 18, 38), (12, 3, -6), near=0.5, far=250, size=(640, 360))
low = csm.Sun.from_compass(250, 18)
town_truth = csm.truth(town, view, low)
manual = csm.ShadowSettings(map_size=1024, bias="manual")
ways = {
    "none": [manual],
    "constant": [manual.replace(constant_bias_texels=b) for b in (0.5, 1, 2, 4)],
    "slope": [manual.replace(slope_bias=b) for b in (0.25, 0.5, 1, 2)],
    "normal offset": [manual.replace(normal_offset_texels=b) for b in (0.5, 1, 1.5, 2)],
    "receiver plane": [manual.replace(receiver_plane=True, slope_bias=b) for b in (0, 0.25, 0.5)],
    "back faces": [manual.replace(caster_faces="back", slope_bias=b) for b in (0, 0.25)],
    "automatic": [csm.ShadowSettings(map_size=1024)],
}


def judged(settings):
    """The report of one render of the town."""
    return csm.compare(renderer.render(town, view, low, settings), town_truth)


best = {
    name: min((judged(s) for s in settings), key=lambda report: report.disagreement)
    for name, settings in ways.items()
}
print(f"without any: {best.pop('none').disagreement:.0%} wrong")
_, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
for part, left, colour in (("too_dark", None, 0), ("too_bright", "too_dark", 1)):
    widths = [100 * report.mean[part] for report in best.values()]
    starts = [100 * report.mean[left] if left else 0 for report in best.values()]
    label = part.replace("_", " ")
    ax.barh(list(best), widths, left=starts, color=plot.CASCADE_COLOURS[colour], label=label)
ax.invert_yaxis()
ax.set(xlabel="mean error [%]")
ax.legend(frameon=False)
ax.set_title("each way at its best strength", loc="left", fontsize="medium")

# %% [markdown]
# For one hard compare in this town a constant that was chosen with the truth in hand does as well
# as anything; the automatic bias needed no truth. Under kernels they part.

# %% [markdown]
# ## Larger kernels need more, unless they know the plane
#
# A constant slope bias that serves one compare is too small for a kernel: every tap may lie $r$
# texels away. With the receiver plane the kernel may grow without more bias.

# %%
sizes = (1, 3, 5, 7, 9)
_, ax = plt.subplots(figsize=(6.5, 3.4), layout="constrained")
kernels = {}
for (name, settings), colour in zip(
    {
        "slope 0.5, fixed": manual.replace(slope_bias=0.5),
        "automatic": csm.ShadowSettings(map_size=1024),
    }.items(),
    plot.CASCADE_COLOURS,
    strict=False,
):
    kernels[name] = [
        100 * judged(settings.replace(filter="pcf", filter_size=k)).mean["too_dark"] for k in sizes
    ]
    ax.plot(sizes, kernels[name], "o-", color=colour, label=name)
ax.set(xlabel="side of the kernel [texels]", ylabel="false shadow [%]")
ax.legend(frameon=False)
ax.set_title("darkening by acne and by blur, against the kernel", loc="left", fontsize="medium")

# %% [markdown]
# ## Sixteen bits
#
# A 16-bit map stores one of 65535 depths. Over 100 m that is a step of 1.5 mm, over 30 km half a
# metre. The automatic bias adds it, and no more: what changes in the picture is what 1.5 mm change.

# %%
depths = {name: judged(csm.ShadowSettings(map_size=1024, depth_format=name))
          for name in ("d32f", "d24", "d16")}  # fmt: skip
for name, report in depths.items():
    print(f"{name}: {report.disagreement:.3%} wrong")
renderer.close()
