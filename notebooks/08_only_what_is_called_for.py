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
# # Only what is called for
#
# A renderer of shadows has dozens of switches, and a scene needs few of them. A flat plain under a
# high sun needs one small map; a street needs several; a picture in which nothing faces the sun
# needs no map at all. `csm.recommend` looks at the scene on a few coarse renders, switches on what
# the scene calls for, and says why. `verify` then turns every decision round and lets ray tracing
# judge.

# %%
import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import plot

renderer = csm.Renderer()
size = (320, 180)


def picture(ax, array, title, **options):
    """An image without ticks, its title at the left."""
    ax.imshow(array, cmap="gray", vmin=0, vmax=1, interpolation="nearest", **options)
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, loc="left", fontsize="medium")


# %% [markdown]
# ## A town in the afternoon
#
# The table has a row for every effect: what it was set to, what was measured, where the threshold
# lies, what the effect costs.

# %%
town = csm.scenes.town(8000)
camera = town.cameras["roofs"].replace(size=size)
sun = csm.Sun.from_compass(238, 33)
found = csm.recommend(town, camera, sun, renderer=renderer)
print(found)

# %%
frame = renderer.render(town, camera, sun, found.settings)
truth = csm.truth(town, camera, sun)
error = csm.compare(frame, truth).disagreement
_, axes = plt.subplots(1, 2, figsize=(10, 3.1), layout="constrained")
picture(axes[0], frame.mask, f"recommended: {error:.2%} wrong")
picture(axes[1], truth.mask, "ray-traced")

# %% [markdown]
# ## Take it home
#
# The nearest settings of an engine, with what is rounded and what has no counterpart there. The
# text ends in a snippet to paste.

# %%
exported = found.export("godot")
print(exported)
print(exported.text)

# %% [markdown]
# ## What was measured
#
# Receivers by depth decide the cascades. The length of shadow edges in the picture decides how fine
# the maps must be: a texel displaces an edge by a quarter of itself, so the error to expect is the
# length of the edges times a quarter texel.

# %%
signals = found.signals
_, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
ax.stairs(100 * signals.depth_shares, signals.depth_edges, fill=True, color=plot.CASCADE_COLOURS[0])
ax.set(xscale="log", xlabel="view depth of what the sun reaches [m]", ylabel="share [%]")
ax.set_title("receivers by depth", loc="left", fontsize="medium")

# %% [markdown]
# ## Accuracy has a price
#
# With `max_error` the answer is the cheapest settings whose forecast reaches it; no truth is traced
# for that. Forecasts (line) and errors that were then measured (dots):

# %%
goals = (0.02, 0.01, 0.005, 0.002)
answers = [csm.recommend(town, camera, sun, max_error=goal, renderer=renderer) for goal in goals]
measured = [
    csm.compare(renderer.render(town, camera, sun, one.settings), truth).disagreement
    for one in answers
]
costs = [one.expected_ms for one in answers]
_, ax = plt.subplots(figsize=(7, 3.4), layout="constrained")
ax.plot(costs, [100 * one.expected_error for one in answers], color=plot.CASCADE_COLOURS[0])
ax.plot(costs, 100 * np.array(measured), "o", color=plot.CASCADE_COLOURS[1])
ax.set(xscale="log", yscale="log", xlabel="forecast time of a frame [ms]", ylabel="error [%]")
ax.set_title("what less error costs", loc="left", fontsize="medium")

# %% [markdown]
# ## Scenes that call for little
#
# A plain at noon: one small map, one compare. A sun below the ground: no map. A path instead of a
# still: windows snapped to a grid, so that shadows do not crawl.

# %%
box = csm.scenes.plane_and_box()
corner = csm.Camera.look_at((6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=size)
path = [corner.translated((0.05 * k, 0, 0)) for k in range(4)]
plain = csm.Scene([csm.shapes.mesh("ground", csm.shapes.ground(20.0))])
little = {
    "plain at noon": csm.recommend(plain, corner, csm.Sun((0, 1, 0)), renderer=renderer),
    "still": csm.recommend(box, corner, csm.Sun((1, 1, 0)), renderer=renderer),
    "wide sun": csm.recommend(box, corner, csm.Sun((1, 1, 0), 4.0), renderer=renderer),
    "sun below": csm.recommend(box, corner, csm.Sun((0, -1, 0)), renderer=renderer),
    "path": csm.recommend(box, path, csm.Sun((1, 1, 0)), renderer=renderer),
}
for name, one in little.items():
    maps = str(one).partition(":")[0]
    print(f"{name:13} {maps}" + (f", snap {one.settings.snap}" if one.map_bytes else ""))

# %%
_, ax = plt.subplots(figsize=(6, 2.6), layout="constrained")
ax.barh(list(little), [one.map_bytes / 1e6 for one in little.values()], color=plot.GREY)
ax.invert_yaxis()
ax.set(xlabel="bytes of shadow maps [MB]")
ax.set_title("an effect that is off has no byte", loc="left", fontsize="medium")

# %% [markdown]
# ## The proof
#
# Every decision turned round: what was taken must be missed, what was left out must not help. Rows
# that only save time or memory are judged by those.

# %%
proof = found.verify(renderer=renderer, repeats=1)
print(f"{proof.confirmed_share:.0%} of {len(proof.decisions)} decisions confirmed")
print(proof)

# %%
ours = proof.recommended.error
rows = [row for row in proof.decisions if row.name != "shadows"]
_, ax = plt.subplots(figsize=(7, 4.6), layout="constrained")
for taken, colour, label in ((True, 0, "taken away"), (False, 1, "added")):
    chosen = [row for row in rows if row.taken is taken]
    ax.barh(
        [row.name for row in chosen],
        [row.error / ours for row in chosen],
        color=plot.CASCADE_COLOURS[colour],
        label=label,
    )
ax.axvline(1.0, color="k", lw=1)
ax.set(xscale="log", xlabel="error, over that of the recommendation")
ax.legend(frameon=False)
ax.set_title("each decision turned round", loc="left", fontsize="medium")
renderer.close()
