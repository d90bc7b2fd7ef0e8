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
# # Fitting light windows, and keeping them still
#
# Each slice of the view needs a *light window*: the box, aligned with the light, whose content its
# shadow map holds. A small window has small texels. A window whose size or whose texel grid changes
# from frame to frame makes shadow edges crawl. This notebook shows the ways to choose windows, what
# each wastes, and what keeps them still.
#
# Lengths are in metres. $n, f$ are the depths of a slice, $t_x, t_y$ the tangents of the half
# fields of view, $k = \sqrt{t_x^2 + t_y^2}$ the slope of the view's corner rays, $S$ the texels
# along a side of a map, $t$ the side of a texel.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import plot

scene = csm.scenes.stairs()
camera = csm.Camera.look_at((-9, 5, 3), (0, 1, -4), fov_y_deg=45, near=2, far=24, size=(720, 400))
sun = csm.Sun.from_compass(250, 38)
base = csm.ShadowSettings(cascade_count=3, lam=0.8, map_size=512)
outputs = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")
renderer = csm.Renderer()


def row(count, size=5.2):
    """Axes side by side."""
    _, axes = plt.subplots(1, count, figsize=(size * count, size), layout="constrained")
    return axes


# %% [markdown]
# ## Slices and windows
#
# Filled: the three slices of the view. Edges: their windows, thick over the depths of the slice and
# thin over the rest of the depth range, which reaches to the last caster of the scene. The windows
# are far larger than the slices: they are fitted to the *sphere* around a slice, so that their size
# does not depend on where the camera looks.

# %%
cascades = csm.fit_cascades(camera, sun, base, scene=scene)
plot.view_3d(cascades, camera, scene=scene)

# %% [markdown]
# From above, a window is where its light meets the ground.

# %%
plot.plan(cascades, camera)

# %% [markdown]
# ## Sphere, diameter, box
#
# | fit | side of the window | |
# |---|---|---|
# | sphere | $2R$, the smallest sphere around the slice | constant under every motion |
# | diameter | $D$, the largest distance of two corners | constant, never larger than $2R$ |
# | box | the slice's extent along light x and y | smallest, changes with every turn |
#
# $D = \max(2kf,\ \sqrt{(f-n)^2 + k^2 (f+n)^2})$. A side of a box around the slice never exceeds the
# distance of two corners, so the diameter fit is as stable as the sphere, and up to $2/\sqrt 3$
# smaller: texels up to 1.33 times as many per area, for nothing. The two differ for narrow views;
# this one has 24° and square pixels, 640 by 360.

# %%
narrow = csm.Camera.look_at((-9, 5, 3), (0, 1, -4), fov_y_deg=24, near=2, far=24, size=(640, 360))
axes = row(3, 4.6)
for ax, fit in zip(axes, ("sphere", "diameter", "box"), strict=True):
    fitted = csm.fit_cascades(narrow, sun, base.replace(fit=fit), scene=scene)
    plot.light_plan(fitted, narrow, ax=ax)
    ax.set_title(f'fit="{fit}"', loc="left")
axes[1].sharex(axes[0])
axes[1].sharey(axes[0])
axes[2].sharex(axes[0])
axes[2].sharey(axes[0])

# %% [markdown]
# ## How much of a map is used
#
# The light sees the slice (dashed) as a small part of the map: everything veiled red is wasted. But
# nothing says that only the slice may use its map: whatever lies in the map and is seen may as well
# look it up. Selecting *by map* instead of by depth interval uses four times as many texels. Then
# the cut between the slices means nothing any more, and the sphere may move along the view until
# the near corners leave it [Sylvan]: it covers more of the view, and the next one starts where it
# ends.
#
# The light here is square to the view, the field of view is 60° at 16:9, the slice from 2 to 6 m.
# A shift exists only where $k^2 > (f-n)/(f+n)$: otherwise the near corners lie on the smallest
# sphere already.

# %%
flat = csm.Camera.look_at((0, 2, 0), (0, 2, -1), near=2, far=60, size=(1280, 720))
noon = csm.Sun((0, 1, 0))
halves = base.replace(
    cascade_count=2, split="manual", manual_splits=(6.0,), view_range="camera", map_size=256
)
sphere = csm.fit_cascades(flat, noon, halves)
shifted = csm.fit_cascades(flat, noon, halves.replace(fit="shifted", select="frustum"))
used = row(3, 4.6)
plot.light_view(sphere, flat, select="interval", ax=used[0])
plot.light_view(sphere, flat, select="map", ax=used[1])
plot.light_view(shifted, flat, select="frustum", ax=used[2])
for ax, what in zip(used, ("slice alone", "all that is held", "shifted"), strict=True):
    ax.set_title(f"{what}, {ax.get_title(loc='left')}", loc="left", fontsize="small")

# %% [markdown]
# ## Windows for what is seen
#
# A slice of the view is mostly air. The picture itself says where its surfaces are: the window of a
# cascade need only hold the surfaces of its slice that are seen and face the sun. Grey dots are
# those surfaces. Such windows are rectangles and smaller than the spheres, but they follow the
# picture, and they hold little beyond their own slice. A sphere holds points of the next slices
# too, which then use its finer texels: where, as here, hardly anything is seen in the first slice,
# its tiny window helps nobody, and the spheres can come out ahead.

# %%
truth = csm.truth(scene, camera, sun)
seen = truth.position[truth.valid & truth.facing]
axes = row(2, 5.6)
for ax, fit in zip(axes, ("sphere", "visible"), strict=True):
    settings = base.replace(fit=fit)
    fitted = csm.fit_cascades(camera, sun, settings, scene=scene, receivers=seen)
    plot.light_plan(fitted, camera, points=seen, ax=ax)
    frame = renderer.render(scene, camera, sun, settings, outputs=outputs)
    wrong = csm.compare(frame, truth).disagreement
    ax.set_title(f'fit="{fit}": {wrong:.2%} of the pixels wrong', loc="left", fontsize="medium")

# %% [markdown]
# ## The grid must fall onto itself
#
# A shadow edge is drawn where texels end. When the camera moves and the texel grid moves by half a
# texel, so does the edge. The cure [Valient2008]: windows of constant size, and a corner that is a
# whole number of texels from the origin of the world,
#
# $$ t = \frac{2R}{S - 1 - 2p}, \qquad \text{corner} = t \cdot
#    \operatorname{round}\!\left(\frac{\text{centre}}{t} - \frac S2\right), $$
#
# where the spare texel takes up the rounding and $p$ is the radius of the filter's kernel.
#
# Listing 4.1.1 of [Zhang2009] rounds the *centre* up to multiples of $R/S$. That is half a texel of
# the window it then makes, $2R$ wide over $S$ texels. Here it is as printed, for one slice:


# %%
def sphere_of_slice(camera, near, far):
    """Centre (world) and radius of the smallest sphere around a slice."""
    slope = camera.half_width**2 + camera.half_height**2
    if slope * (far + near) >= far - near:
        depth, radius = far, math.sqrt(slope) * far
    else:
        depth = 0.5 * (near + far) * (1.0 + slope)
        radius = math.hypot(far - depth, math.sqrt(slope) * far)
    return camera.eye - depth * camera.backward, radius


def listing_4_1_1(camera, light_from_world, near, far, size, *, unit):
    """`clip_from_world` with the centre rounded up to `unit` times R / S."""
    centre, radius = sphere_of_slice(camera, near, far)
    x, y, z = light_from_world[:3, :3] @ centre
    step = unit * radius / size
    x, y = math.ceil(x / step) * step, math.ceil(y / step) * step
    clip_from_light = np.diag([1.0 / radius, 1.0 / radius, -0.5 / radius, 1.0])
    clip_from_light[:3, 3] = (-x / radius, -y / radius, 0.5 + 0.5 * z / radius)
    return clip_from_light @ light_from_world


# %% [markdown]
# A walk of 120 frames that turns a little: a fixed point of the world should keep its place within
# its texel. Each band below is one texel high.

# %%
size = 512
walk = [
    csm.Camera.look_at(
        (0.031 * i, 1.7, -0.047 * i), (0.031 * i + 2 * math.sin(0.02 * i), 1.5, -0.047 * i - 5),
        near=1, far=20, size=(640, 360),
    )
    for i in range(120)
]  # fmt: skip
one = base.replace(cascade_count=1, view_range="camera", map_size=size)
afternoon = csm.Sun((0.4, 0.8, 0.3))


def printed(camera, unit):
    """Cascades of the listing."""
    axes_of_light = csm.fit_cascades(camera, afternoon, one).light_from_world[0]
    matrix = listing_4_1_1(camera, axes_of_light, 1.0, 20.0, size, unit=unit)
    return csm.Cascades.from_matrices([matrix], [1.0, 20.0], size)


paths = {
    "no snapping": [csm.fit_cascades(c, afternoon, one.replace(snap="none")) for c in walk],
    "4.1.1 as printed": [printed(c, 1.0) for c in walk],
    "unit corrected": [printed(c, 2.0) for c in walk],
    'snap="exact"': [csm.fit_cascades(c, afternoon, one) for c in walk],
}
phases = plot.lattice_phases(paths, point=(1, 0, -3))

# %% [markdown]
# As printed, each axis sits half a texel off in about half of all frames; were the frames
# independent, three of four steps would jump in one axis or the other. With the unit corrected the
# grid stands still; what remains wrong is that rounding *up* without a margin pushes the sphere up
# to a texel out of its map.

# %% [markdown]
# ## Levels: nearly as still, far less waste
#
# The sphere wastes texels so that its size never changes. The *approximate* way [Zhang2009, 4.1.2]
# fits a box and rounds its size up to one of a few levels: texels keep their size for many frames,
# then all change at once. Linear levels, 64 parts of one base window, waste most on small windows;
# geometric ones waste the same factor on every size. A level may be held for some time although a
# smaller one would do (hysteresis), so that a window at the border between two does not flutter.


# %%
def along(path, settings):
    """Cascades along a path, each knowing the frame before."""
    frames, held = [], None
    for one_camera in path:
        held = csm.fit_cascades(one_camera, afternoon, settings, held=held)
        frames.append(held)
    return frames


turning = [
    csm.Camera.look_at((0, 1.7, 0), (math.sin(a), 1.5, -math.cos(a)), near=1, far=20)
    for a in np.linspace(0.0, 2.0, 200)
]
levels = one.replace(snap="approximate")
sizes = plot.texel_sizes(
    {
        "box, no snapping": along(turning, one.replace(fit="box", snap="none")),
        "64 linear levels": along(turning, levels.replace(fit="box")),
        "geometric, held": along(
            turning, levels.replace(fit="box", level_spacing="geometric", level_hysteresis=2)
        ),
        "sphere, exact": along(turning, one),
    }
)

# %% [markdown]
# ## Proof instead of looking
#
# `csm.check_cascades` takes matrices, ours or anybody's, and proves them sound or says what is
# wrong, where and by how much. First the walk above, as `csm` places its window:

# %%
sound = csm.check_cascades(paths['snap="exact"'], walk)
print(sound)

# %% [markdown]
# Then the same walk as the listing is printed: its grid moves by half texels, and where the grid
# stands still the depth range moves by parts of a quantum, so that stored depths change.

# %%
listing = csm.check_cascades(paths["4.1.1 as printed"], walk)
print(listing)

# %% [markdown]
# And one planted defect: three sound cascades, the second window shrunk by a third about its
# centre. With selection by interval the slice overflows its map; with selection by map the third
# map steps in, and only what no map holds is a gap. Here the third holds all of it: a shrunken
# window is then no error at all, merely coarser texels. The last window is another matter: nothing
# stands behind it. The dots are points that the check names as held by no map.


# %%
def shrunk(cascades, i, factor):
    """The same cascades with window i scaled about its centre."""
    matrices = cascades.clip_from_world.copy()
    matrices[i] = np.diag([1 / factor, 1 / factor, 1, 1]) @ matrices[i]
    return csm.Cascades.from_matrices(matrices, cascades.splits, cascades.map_size)


defects = {f"window {i} shrunk": shrunk(cascades, i, 2 / 3) for i in (1, 2)}
checks = {}
for (name, one_set), ax in zip(defects.items(), row(2), strict=True):
    for select in ("interval", "map"):
        checks[name, select] = csm.check_cascades(one_set, camera, select=select, scene=scene)
        print(f"{name}, select={select!r}: {checks[name, select]!r}")
    gaps = checks[name, "map"].gap_points
    plot.light_plan(one_set, camera, ax=ax)
    here = csm.spaces.transform_points(one_set.light_from_world[0], gaps)
    ax.plot(*here[:, :2].T, "k.", markersize=4)
    ax.set_title(f"{name}: {len(gaps)} points in no map", loc="left", fontsize="medium")

# %% [markdown]
# ## A grid that does not move with the sun
#
# When the sun moves, the light's axes turn and with them the whole texel grid: exact snapping helps
# a moving camera only. [theomader] and [Stone] skew light space instead: its depth runs along the
# light, but x and y are those of the world. Where such light meets the *ground*, the grid is
# the same whatever the sun: shadows slide over a grid that stands still, and flat ground needs no
# slope bias. The price are windows that grow, in steps, as the sun sinks, and walls that fare no
# better than before.
#
# Above: orthonormal axes. Below: the world's axes. Left and right: two suns, 20 minutes apart.

# %%
_, axes_of_suns = plt.subplots(2, 2, figsize=(9, 9), layout="constrained", sharex=True, sharey=True)
suns = (csm.Sun.from_compass(205, 54), csm.Sun.from_compass(213, 53))
for line, basis in zip(axes_of_suns, ("orthonormal", "world"), strict=True):
    for ax, one_sun in zip(line, suns, strict=True):
        fitted = csm.fit_cascades(camera, one_sun, base.replace(light_basis=basis), scene=scene)
        plot.ground_texels(fitted, 0, lines=16, ax=ax)
        ax.set_title(f'light_basis="{basis}"', loc="left", fontsize="medium")

# %% [markdown]
# ## Warps: one map, texels where the pixels are
#
# Instead of cutting the view, one map can be warped by a perspective of its own, so that texels are
# small nearby and large far away, in step with the pixels [Wimmer2004]. The grid below is one map
# on the ground, a line every few texels: without a warp, and with LiSPSM. The pictures show the
# length of a texel in pixels: the warp makes it nearly the same everywhere. As the light turns
# towards the view the gain goes to nothing, and a warped grid cannot be snapped: it moves with
# every step.

# %%
town = csm.scenes.town(8000)
street = csm.Camera.look_at((0, 6, 50), (0, 2, 0), near=1, far=90, size=(480, 270))
across = csm.Sun((0.6, 0.8, -0.1))
street_truth = csm.truth(town, street, across)
_, axes = plt.subplots(2, 2, figsize=(12, 8), layout="constrained")
for column, warp in zip(axes.T, ("none", "lispsm"), strict=True):
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, warp=warp, snap="none")
    frame = renderer.render(town, street, across, settings, outputs=outputs)
    plot.ground_texels(frame.cascades, camera=street, lines=40, ax=column[0])
    plot.resolution(frame, street_truth, ax=column[1])
    column[0].set_title(f'warp="{warp}"', loc="left", fontsize="medium")
axes[0, 1].sharex(axes[0, 0])
axes[0, 1].sharey(axes[0, 0])

# %% [markdown]
# ## What a map knows
#
# Each stored texel put back into the world as a box of its own size [theomader]. Everything that a
# shadow map can answer is here: what the light does not reach is missing, and a surface that slopes
# away from the light is a stair. Its steps are what a bias has to step over.

# %%
everything = base.replace(map_size=128, cull="none", view_range="camera")
frame = renderer.render(scene, camera, sun, everything, outputs=outputs)
plot.texel_cubes(frame, renderer=renderer)

# %% [markdown]
# ## What to take away
#
# - A window of constant size whose corner is a whole number of texels from the world's origin: this
#   is all of stability. The unit is the texel, not half of it.
# - Let every point use the finest map that holds it. Most of Sylvan's gain is that.
# - A warp gives one map the texels where the pixels are, and no grid that stands still.
# - For a moving sun, skewed axes keep the grid still on the ground; for a moving camera, they are
#   as still as any.

# %%
renderer.close()
plt.show()
