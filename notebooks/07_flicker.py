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
# # Flicker, and what stillness costs
#
# A wrong shadow edge that stands still is a stair. One that moves while nothing else does is seen
# at once. `csm.flicker` measures that: it asks for the *same* points of the world in every frame of
# a path, so that the camera's own motion is gone exactly, and adds up how their shadow changes.
# Each section says what to look at, and checks it.
#
# The scene is Littlest Tokyo if the environment variable `CSM_SCENES` names the folder of real
# scenes, and a town made by code if not. Lengths are in metres; flicker is the mean change of
# visibility from one frame to the next.

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import pictures, plot

size = (320, 180)
file = Path(os.environ.get("CSM_SCENES", "")) / "littlest_tokyo.glb"
real = file.is_file()
scene = csm.load(file) if real else csm.scenes.town(8000)
camera = scene.cameras["street"].replace(size=size)
sun = scene.suns["morning" if real else "afternoon"]
print("scene:", "Littlest Tokyo by Glen Fox (CC-BY)" if real else "a made town")

renderer = csm.Renderer()
colours = plot.CASCADE_COLOURS
base = csm.ShadowSettings(cascade_count=3, lam=0.8, map_size=512)
STILL = 1e-3  # of what flickers: a rasteriser rounds corners anew in each window


# %%
def picture(ax, array, title, **options):
    """An image without ticks, its title at the left."""
    drawn = ax.imshow(array, interpolation="nearest", **options)
    ax.set(xticks=[], yticks=[], facecolor="#C9D3DC")  # shows where an image has no number
    ax.set_title(title, loc="left", fontsize="medium")
    return drawn


def bars(ax, values, xlabel, title, colour=0):
    """Horizontal bars by name, each with its number."""
    drawn = ax.barh(list(values), list(values.values()), color=colours[colour])
    ax.bar_label(drawn, fmt="%.3g", padding=3, fontsize="small")
    ax.yaxis.set_inverted(True)
    ax.margins(x=0.16)
    ax.set_xlim(left=0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set(xlabel=xlabel, ylabel="settings")
    ax.set_title(title, loc="left", fontsize="medium")


# %% [markdown]
# ## A walk
#
# The points are all that the first picture shows and the sun could light: one in each pixel, with
# the normal of its surface. The camera then goes sideways and turns a little, six steps of a few
# texels and parts of texels. `points=` renders no picture at all: it asks the maps.

# %%
truth = csm.truth(scene, camera, sun)
shown = truth.valid & truth.facing
points, normals = truth.position[shown], truth.normal[shown]
lit = truth.trace(points, normals).astype(float)
distance = np.median(np.linalg.norm(points - camera.eye, axis=1))


def moved(sideways, turn):
    """The camera gone sideways and turned, both in parts of the distance to what it looks at."""
    eye = camera.eye + sideways * distance * camera.right
    return csm.Camera.look_at(
        eye, eye - camera.backward + turn * camera.right, fov_y_deg=camera.fov_y_deg,
        near=camera.near, far=camera.far, size=size,
    )  # fmt: skip


walk = [moved(0.0037 * k, 0.0021 * k) for k in range(7)]


def frames_of(settings, cameras=walk, suns=None):
    """What the maps say of the points, along a path."""
    renderer.forget()  # nothing held from the path before
    suns = [sun] * len(cameras) if suns is None else suns
    return [
        renderer.render(
            scene, one, light, settings, outputs=(), points=points, point_normals=normals
        )
        for one, light in zip(cameras, suns, strict=True)
    ]


def error_of(frames):
    """Mean error at the points that have a cascade."""
    return np.mean(
        [np.abs(one.point_visibility - lit)[one.point_cascade != 255].mean() for one in frames]
    )


# %% [markdown]
# Left the view. In the middle how often each point changed along the walk when windows go where the
# camera goes: along every shadow edge. Right the same settings with windows that move by whole
# texels (`snap="exact"`, the default). *Look at the number in the title: it is 0, not small* (or a
# point or two, where a rasteriser rounds a corner anew in each window). It is that of the points
# that stay in their cascade, of which snapping proves something; the dots that are left in the
# picture pass from one cascade to another. Blue-grey is what faces away from the sun or shows
# nothing.


# %%
outputs = ("mask", "valid", "view_depth", "normal")
view = pictures.lit_picture(renderer.render(scene, camera, sun, base, outputs=outputs))
free = csm.flicker(frames_of(base.replace(snap="none")), scene=scene)
exact = csm.flicker(frames_of(base), scene=scene)
_, axes = plt.subplots(1, 3, figsize=(14, 2.9), layout="constrained")
picture(axes[0], view, "the first picture of the walk")
for ax, name, report in ((axes[1], "not snapped", free), (axes[2], "exact", exact)):
    title = f"{name}: flicker {report.mean:.3%}"
    image = picture(ax, report.as_picture(shown), title, cmap="magma_r", vmin=0, vmax=0.6)
axes[0].figure.colorbar(image, ax=axes[2], label="mean change per step")
print(f"not snapped: {free}\nexact:       {exact}")
assert exact.mean < STILL * free.mean

# %% [markdown]
# ## How much a free grid must flicker
#
# The share of light at a point is decided by the centre of its texel. If the grid of the next frame
# lies anywhere, independently, a point that is lit with chance $q$ changes with chance $2q(1-q)$.
# Across a straight edge along an axis of the map $q$ falls evenly over one texel: the error is a
# quarter of a texel per length of edge, the change a third. For an edge along the diagonal they are
# $\sqrt2/6$ and $7\sqrt2/30$. So
#
# $$ \frac{\text{flicker}}{\text{error}} = \frac43 \ \text{to}\ \frac75, $$
#
# for any map. What is wrong in *every* frame (a railing thinner than a texel, a bias) is no flicker
# and pulls the ratio down; it goes as texels get smaller. *Look at where the line ends.*

# %%
rng = np.random.default_rng(3)
jumps = [camera.translated(0.02 * distance * rng.uniform(-1, 1, 3)) for _ in range(5)]
sizes = (512, 1024, 2048)
errors, flickers = [], []
for texels in sizes:
    frames = frames_of(base.replace(snap="none", map_size=texels), jumps)
    errors.append(error_of(frames))
    flickers.append(csm.flicker(frames, scene=scene).mean)
ratios = np.array(flickers) / errors
_, (ax, right) = plt.subplots(1, 2, figsize=(11, 3.4), layout="constrained")
for values, name, colour in ((errors, "error", 0), (flickers, "flicker", 3)):
    ax.plot(sizes, 100 * np.array(values), "o-", color=colours[colour], label=name)
ax.set(xscale="log", ylim=(0, None), xlabel="texels along a side of a map", ylabel="mean [%]")
ax.set_title("an independent grid in every frame", loc="left", fontsize="medium")
ax.legend(frameon=False)
right.axhspan(4 / 3, 7 / 5, color=plot.GREY, alpha=0.4, lw=0, label="straight edges")
right.plot(sizes, ratios, "o-", color=colours[2], label="measured")
right.set(xscale="log", ylim=(0, 1.8), xlabel="texels along a side of a map", ylabel="ratio")
right.set_title("flicker over error", loc="left", fontsize="medium")
right.legend(frameon=False, loc="lower right")
for one in (ax, right):
    one.set_xticks(sizes, sizes)
    one.minorticks_off()
print("flicker over error:", np.round(ratios, 2))
assert 1.15 < ratios[1:].mean() < 1.55, "fine maps: what straight edges do"

# %% [markdown]
# ## What keeps still, and what it costs
#
# Left the flicker of the walk, right the error of the same frames. A box is smaller than a sphere
# and changes with every turn; `snap="approximate"` gives it one of a few sizes; windows round what
# is seen (`fit="visible"`) follow the picture. *Look for rows without an orange bar, and compare
# the blue bar of each with that of its row that is not snapped:* snapping buys no accuracy and
# costs next to none. What costs is the rigid window, on the right. Whether it costs accuracy is
# another matter: a sphere is larger than its slice, and points of the next slices use what it holds
# of them in finer texels. Where they must not (`select="interval"`, the last rows) the larger
# window is the worse one.

# %%
ways = {
    "sphere, not snapped": {"snap": "none"},
    "sphere, exact": {},
    "diameter, exact": {"fit": "diameter"},
    "box, not snapped": {"fit": "box", "snap": "none"},
    "box, approximate": {"fit": "box", "snap": "approximate"},
    "box, geometric levels": {
        "fit": "box", "snap": "approximate", "level_spacing": "geometric", "level_hysteresis": 1,
    },
    "visible, not snapped": {"fit": "visible", "snap": "none"},
    "visible, exact": {"fit": "visible"},
    "sphere, exact, by interval": {"select": "interval"},
    "box, not snapped, by interval": {"fit": "box", "snap": "none", "select": "interval"},
}  # fmt: skip
found, wrong, areas = {}, {}, {}
for name, changes in ways.items():
    frames = frames_of(base.replace(**changes))
    found[name], wrong[name] = csm.flicker(frames, scene=scene), error_of(frames)
    areas[name] = np.mean([one.cascades.texel_size.prod(axis=1) for one in frames], axis=0)
_, axes = plt.subplots(1, 3, figsize=(14, 4.0), layout="constrained", sharey=True)
bars(axes[0], {n: 100 * r.mean for n, r in found.items()}, "flicker [%]", "how restless", 3)
bars(axes[1], {n: 100 * e for n, e in wrong.items()}, "mean error [%]", "how wrong")
box = areas["box, not snapped"]
wasted = {n: np.exp(np.log(a / box).mean()) for n, a in areas.items()}
bars(axes[2], wasted, "area of a window, box = 1", "how large", 2)

# %% [markdown]
# By theory: no side of the box exceeds the distance of two corners of its slice, so that no
# diameter is smaller than a box and no sphere smaller than the diameter, cascade by cascade; and a
# still grid changes no point at all.

# %%
assert (areas["sphere, exact"] >= areas["diameter, exact"] * (1 - 1e-9)).all()
assert (areas["diameter, exact"] >= box).all()
restless = found["sphere, not snapped"].mean
assert max(found["sphere, exact"].mean, found["diameter, exact"].mean) < STILL * restless
assert found["visible, exact"].mean < 0.1 * found["visible, not snapped"].mean
by_interval = [wrong[f"{name}, by interval"] for name in ("box, not snapped", "sphere, exact")]
assert by_interval[0] < by_interval[1], "the larger window is the worse one"

# %% [markdown]
# ## Where cascades meet
#
# A point that passes from one cascade to the next gets other texels, however still both grids are.
# `csm.flicker` keeps such changes apart: `transition` is their mean, `transition_share` how many
# they are. Blending spreads the step over many frames: *the orange bars fall, and the blue ones
# rise from 0*, for what was one jump at the rim (orange in the picture) is now a slow change
# within. A dither draws lots: few points change at once, but each of them all the way, so that its
# `largest` is 1, where that of a blend is a fraction.

# %%
meeting = {"none": exact}
for blend in ("linear", "smooth", "dither"):
    frames = frames_of(base.replace(blend=blend, blend_width=0.3))
    meeting[blend] = csm.flicker(frames, scene=scene)
crossed = meeting["none"].crossed.any(axis=0)
image = np.ones((*shown.shape, 3))
image[shown] = np.where(crossed[:, None], (0.84, 0.37, 0.0), 0.45 + 0.4 * lit[:, None])
_, axes = plt.subplots(1, 3, figsize=(14, 2.9), layout="constrained")
picture(axes[0], image, f"{crossed.mean():.1%} of the points change cascade")
bars(axes[1], {n: 100 * r.transition for n, r in meeting.items()},
     "mean change there [%]", "points that change cascade", 3)  # fmt: skip
bars(axes[2], {n: 100 * r.mean for n, r in meeting.items()},
     "flicker [%]", "points that stay")  # fmt: skip
assert meeting["none"].mean < STILL * free.mean
if crossed.mean() > 0.01:
    assert meeting["linear"].transition < 0.25 * meeting["none"].transition
    assert meeting["linear"].largest < 0.5 < meeting["dither"].largest

# %% [markdown]
# ## A sun that moves
#
# Now the truth changes too. Rays say by how much, and only what goes beyond it counts; the sun is a
# point here, as these maps have it (of a disc the rays would follow the penumbrae). A camera's
# snapping is no help: the grid turns with the light. `sun_step_deg` lets the maps' sun go in steps:
# between two of them nothing in the maps changes, so that flicker is 0 by theory, and at a step
# everything changes at once. *Look at the dips to 0, and at the error that pays for them.* The
# world's axes (`light_basis="world"`) keep the grid still on level ground alone: they help as much
# as a picture shows of that, and cost larger windows.


# %%
def hour(k):
    """A point sun, turned about the vertical by k steps of 0.12 degrees."""
    angle = np.radians(0.12 * k)
    x, y, z = sun.to_light
    turned = (x * np.cos(angle) - z * np.sin(angle), y, x * np.sin(angle) + z * np.cos(angle))
    return csm.Sun(turned)


hours = [hour(k) for k in range(9)]
still = [camera] * len(hours)
true = [
    csm.truth(scene, camera.replace(size=(2, 2)), one).trace(points, normals).astype(float)
    for one in hours
]
suns = {"smooth": {}, "world's axes": {"light_basis": "world"}, "in steps": {"sun_step_deg": 0.5}}
passing, behind = {}, {}
for name, changes in suns.items():
    frames = frames_of(base.replace(**changes), still, hours)
    passing[name] = csm.flicker(frames, scene=scene)
    behind[name] = np.mean(
        [np.abs(one.point_visibility - t).mean() for one, t in zip(frames, true, strict=True)]
    )

# %%
truly = np.abs(np.diff(true, axis=0)).mean(axis=1)
_, (ax, right) = plt.subplots(1, 2, figsize=(12, 3.2), layout="constrained")
for (name, report), colour in zip(passing.items(), colours, strict=False):
    ax.plot(100 * report.per_step, "o-", color=colour, label=name, ms=4)
ax.plot(100 * truly, "--", color=plot.GREY, label="the true change")
ax.set(xlabel="step of the sun", ylabel="beyond the true change [%]", ylim=(0, None))
ax.set_title("flicker of each step", loc="left", fontsize="medium")
ax.legend(frameon=False, fontsize="small")
bars(right, {n: 100 * e for n, e in behind.items()}, "mean error [%]", "and the error")
quiet = passing["in steps"].per_step == 0.0
assert 0 < quiet.sum() < len(quiet), "the maps' sun stands still in some steps, not in all"
assert behind["in steps"] > behind["smooth"]

# %% [markdown]
# ## A zoom
#
# The field of view narrows by a fiftieth in each frame. Now even a sphere changes its size, and a
# grid whose texels change their size cannot fall onto itself: *exact snapping is no better than
# none*. Sizes in geometric levels, held for a while, change all at once in a few frames and not at
# all in the others.

# %%
zoom = [camera.replace(fov_y_deg=camera.fov_y_deg * 0.98**k) for k in range(10)]
zooms = {n: ways[n] for n in ("sphere, not snapped", "sphere, exact", "box, geometric levels")}
zoomed, sides = {}, {}
for name, changes in zooms.items():
    frames = frames_of(base.replace(**changes), zoom)
    zoomed[name] = csm.flicker(frames, scene=scene)
    sides[name] = np.array([one.cascades.texel_size.ravel() for one in frames])  # u, v of each
_, (ax, right) = plt.subplots(1, 2, figsize=(12, 3.2), layout="constrained")
for (name, report), colour in zip(zoomed.items(), colours, strict=False):
    ax.plot(100 * report.per_step, "o-", color=colour, label=f"{name}: {report.mean:.2%}", ms=4)
    right.plot(100 * sides[name][:, 2], "o-", color=colour, label=name, ms=4)
ax.set(xlabel="step", ylabel="flicker [%]", ylim=(0, None))
ax.set_title("flicker of each step", loc="left", fontsize="medium")
right.set(xlabel="frame", ylabel="texel [cm]")
right.set_title("side of a texel, second cascade", loc="left", fontsize="medium")
ax.legend(frameon=False, fontsize="small")
steps = zoomed["box, geometric levels"].per_step
same = (np.diff(sides["box, geometric levels"], axis=0) == 0).all(axis=1)
assert steps[same].max() < 0.01 * steps.max(), "no level changes: nothing flickers"
assert zoomed["sphere, exact"].mean > 0.5 * zoomed["sphere, not snapped"].mean

# %% [markdown]
# ## What filters do about it
#
# Without snapping, again the walk. A box of $k \times k$ texels is centred on the texel that holds
# the point: the grid's jumps still show, each a multiple of $1/k^2$, over $k$ times as many points.
# *The largest jump falls much further than the sum.* Weights that are centred on the point itself
# (`"bilinear"`, `"gaussian"`) move with it and flicker less. `pcss` blurs as far as the sun's disc
# does: where shadows are near their casters that is less than a texel, and it flickers as the hard
# compare does. A filter makes flicker softer; only a grid that stands still makes it go.

# %%
filters = {
    "pcf 5 x 5, box": {"filter": "pcf", "filter_size": 5},
    "pcf 5 x 5, bilinear": {"filter": "pcf", "filter_size": 5, "filter_weights": "bilinear"},
    "pcf 5 x 5, gaussian": {"filter": "pcf", "filter_size": 5, "filter_weights": "gaussian"},
    "pcss": {"filter": "pcss", "filter_size": 15},
    "pcss, exact": {"filter": "pcss", "filter_size": 15, "snap": "exact"},
}
softly = {"hard": free}
for name, changes in filters.items():
    settings = base.replace(**{"snap": "none", **changes})
    softly[name] = csm.flicker(frames_of(settings), scene=scene)
_, axes = plt.subplots(1, 2, figsize=(12, 3.2), layout="constrained", sharey=True)
bars(axes[0], {n: 100 * r.mean for n, r in softly.items()}, "flicker [%]", "on the whole", 3)
bars(axes[1], {n: r.largest for n, r in softly.items()},
     "largest change of a point", "at its worst")  # fmt: skip

# %%
changes = softly["pcf 5 x 5, box"].changes
parts = 25 * changes[np.isfinite(changes)]
assert np.abs(parts - parts.round()).max() < 1e-4, "multiples of a 25th"
assert softly["pcf 5 x 5, bilinear"].mean < 0.75 * softly["pcf 5 x 5, box"].mean
assert softly["pcss, exact"].mean < 0.01 * softly["pcss"].mean

# %% [markdown]
# ## What to take away
#
# - A window of constant size on a grid of whole texels: no point that stays in its cascade changes.
#   Snapping is free; the size of the window is its price, which `select="map"` pays back.
# - A free grid flickers by 4/3 to 7/5 of its error: halve the texel, and it is halved too.
# - Blend where cascades meet. A moving sun and a zoom need steps, of the sun or of the size.
# - Filters spread flicker, they do not stop it.

# %%
renderer.close()
plt.show()
