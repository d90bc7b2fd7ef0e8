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
# # Where to cut the view
#
# A shadow map spreads its texels evenly over a square of the world; the camera spreads its pixels
# over a view that widens with distance. One map cannot serve both the ground at your feet and the
# horizon, so the view is cut along its depth, and each slice gets a map of its own.
# This notebook is about the cuts: what the schemes do, what that means in pixels, and when the
# usual choice fails.
#
# Lengths are in metres. $n$ and $f$ are the depths where the view begins and ends, $m$ is the
# number of cascades, $C_0 = n < C_1 < \dots < C_m = f$ are the cuts.

# %%
import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import plot

scene = csm.scenes.town(8000)
sun = scene.suns["afternoon"]
camera = csm.Camera.look_at((-30, 18, 38), (12, 3, -6), near=0.5, far=250, size=(640, 360))
base = csm.ShadowSettings(map_size=1024)
outputs = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
renderer = csm.Renderer()

# %% [markdown]
# ## The schemes
#
# | scheme | $C_i$ |
# |---|---|
# | uniform | $n + (f-n)\,i/m$ |
# | logarithmic | $n\,(f/n)^{i/m}$ |
# | practical | $\lambda \cdot$ logarithmic $+ (1-\lambda) \cdot$ uniform [Zhang2006] |
#
# The logarithmic scheme makes every slice look alike: each is the last one enlarged by the same
# factor. The uniform one ignores that the view widens. The bars below show the same view; the
# scale is logarithmic, so logarithmic slices are equally long. Numbers are the inner cuts.

# %%
schemes = {
    "uniform": base.replace(split="uniform"),
    "practical, λ = 0.5": base.replace(lam=0.5),
    "practical, λ = 0.9": base.replace(lam=0.9),
    "logarithmic": base.replace(split="logarithmic"),
}
cascades = {
    name: csm.fit_cascades(camera, sun, settings, scene=scene) for name, settings in schemes.items()
}
plot.splits(cascades)

# %% [markdown]
# ## What it means in pixels
#
# A texel has a side $t_i$, the same all over its map. A pixel at depth $z$ covers
# $2 z \tan(\mathrm{fov}/2) / H$ of a surface that faces the camera, with $H$ pixels in the height
# of the picture. Their ratio falls as $1/z$ inside a slice and jumps up at each cut:
#
# $$ m(z) = \frac{t_i\, H}{2 z \tan(\mathrm{fov}/2)} . $$
#
# This is *perspective aliasing*. The logarithmic scheme keeps all teeth of the saw equally high
# [Lloyd2006]; every other scheme trades resolution nearby for resolution far away. With
# $f/n = 300$ the uniform scheme makes the texels at the near plane some twenty times coarser.

# %%
plot.texels_per_pixel(cascades, camera)

# %% [markdown]
# ## What it means in this picture
#
# The teeth near the camera matter only where something is seen there. This camera looks down on a
# town from a roof: nothing is nearer than 15 m. Purple: texels finer than pixels. Orange: coarser,
# shadow edges show stairs. Faces that the sun grazes are dark orange under every scheme: no split
# helps there, since a texel is stretched along them by $1/\cos\theta$ (*projective* aliasing).

# %%
truth = csm.truth(scene, camera, sun)
fig, axes = plt.subplots(2, 1, figsize=(7.5, 8.4), layout="constrained")
for ax, name in zip(axes, ("practical, λ = 0.5", "logarithmic"), strict=True):
    frame = renderer.render(scene, camera, sun, schemes[name], outputs=outputs)
    plot.resolution(frame, truth, ax=ax)
    ax.set_title(f"{name}: {ax.get_title(loc='left')}", loc="left", fontsize="medium")

# %% [markdown]
# The logarithmic scheme spends two of its four maps on depths where this picture is empty. So the
# right λ depends on where the surfaces are, not on the camera alone. A number says how much it
# matters: the share of sun-facing pixels on the wrong side of one half, against ray tracing.


# %%
def disagreement(scene, camera, sun, settings, truth):
    """Share of judged pixels that are lit and should not be, or the other way round."""
    frame = renderer.render(
        scene, camera, sun, settings, outputs=("mask", "valid", "cascade_index")
    )
    return csm.compare(frame, truth).disagreement


for name, settings in schemes.items():
    print(f"{name:20} {disagreement(scene, camera, sun, settings, truth):7.2%} wrong")

# %% [markdown]
# ## What else may choose the cuts
#
# - **A hand-set first range** [Stone]: what is near is served whatever comes after.
# - **Percentages** of the range, as engines have them in their settings [MSDN].
# - **Equal resolution with unequal maps** [Stone]: choose the cuts so that the teeth of the saw are
#   equally high although the maps are not equally large. With equal maps this *is* the logarithmic
#   scheme.
# - **What is seen** [Lauritzen2011]: begin at the nearest visible surface and end at the farthest;
#   or cut so that every cascade serves as many pixels (`histogram`). The ends move in steps and are
#   held, so that they do not flicker.

# %%
seen = truth.position[truth.valid & truth.facing]
others = {
    "practical, λ = 0.5": base,
    "first range 4 m": base.replace(first_split=4.0),
    "5, 15, 60 %": base.replace(split="percentages", manual_splits=(5, 15, 60)),
    "equal resolution": base.replace(split="resolution", map_size=(2048, 1024, 1024, 512)),
    "what is seen, λ = 1": base.replace(split="sdsm", lam=1.0),
    "quarters of pixels": base.replace(split="histogram"),
}
chosen = {
    name: csm.fit_cascades(camera, sun, settings, scene=scene, receivers=seen)
    for name, settings in others.items()
}
fig, (bars, saw) = plt.subplots(
    2, 1, figsize=(7.5, 7.5), layout="constrained", sharex=True, height_ratios=(2, 3)
)
plot.splits(chosen, ax=bars)
plot.texels_per_pixel(chosen, camera, ax=saw)

# %% [markdown]
# Nothing is seen before 15 m here, so the two schemes that look at the picture start there: their
# texels are finer *where there are pixels*. Maps of 2048, 1024, 1024 and 512 texels cut for equal
# resolution have four equal teeth.

# %% [markdown]
# ## Where λ = 0.5 fails
#
# From the driver's seat of a straight road the asphalt begins two metres away and the range is
# kilometres. The uniform half of the practical scheme makes the first slice hundreds of metres
# long, and the ground before the wheels gets texels of decimetres. Below, the share of wrong pixels
# over λ: here only the last few percent of λ help.

# %%
road = csm.scenes.long_road()
driver = road.cameras["driver"].replace(size=(480, 270))
evening = road.suns["evening"]
road_truth = csm.truth(road, driver, evening)
lams = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
wrong = [disagreement(road, driver, evening, base.replace(lam=lam), road_truth) for lam in lams]

fig, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
ax.plot(range(len(lams)), 100.0 * np.array(wrong), "o-", color=plot.CASCADE_COLOURS[0])
ax.set_xticks(range(len(lams)), [f"{lam:g}" for lam in lams])
ax.set_ylim(bottom=0.0)
ax.set_xlabel("weight λ of the logarithmic scheme")
ax.set_ylabel("wrong pixels [%]")
ax.set_title("the long road: the default λ = 0.5 is far off", loc="left", fontsize="medium")
ax.spines[["top", "right"]].set_visible(False)

# %% [markdown]
# ## The texels themselves
#
# The grid of texels on what is seen [Stone]: the colour is the cascade that a pixel looks up, the
# lines are borders of texels (the legend says how many lie between two of them). On a wall that
# the sun grazes the cells are long; where two colours meet, their size jumps by the ratio of the
# two maps' texels.

# %%
roofs = camera.replace(near=8, far=110, size=(900, 500))
coarse = base.replace(cascade_count=3, lam=0.9, map_size=256)
plot.texel_outlines(renderer.render(scene, roofs, sun, coarse, outputs=outputs))

# %% [markdown]
# ## What to take away
#
# - Look at *where your surfaces are* before choosing λ: the near plane is usually empty.
# - The steps between cascades are ratios of texel sizes; the logarithmic scheme makes them equal.
# - Grazed surfaces are beyond any split. They need a better bias and filter, not more maps.
# - `csm.compare` with `csm.truth` turns the question into a number.

# %%
renderer.close()
plt.show()
