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
# # What accuracy costs in time
#
# More texels, more cascades, a wider filter, a tighter fit: each makes shadows better or dearer,
# mostly both. This notebook sweeps a few of them over one street, finds what nothing beats, asks
# why the rest is wrong, and ends with the page that `csm.report` makes of it. Each section says
# what to look at, and checks it.
#
# The street is in The Hague if the environment variable `CSM_SCENES` names the folder of real
# scenes, and in a town made by code if not. Times are in milliseconds on the machine that runs
# this; whatever else it does disturbs them.

# %%
import os
import tempfile
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import csm
from csm import pictures, plot
from csm.fronts import next_halvings, on_front

size = (320, 180)
file = Path(os.environ.get("CSM_SCENES", "")) / "denhaag_lod2.glb"
real = file.is_file()
scene = csm.load(file) if real else csm.scenes.town(8000)
camera = scene.cameras["street"].replace(size=size)
sun = scene.suns["winter" if real else "afternoon"]
place = "The Hague" if real else "a made town"
print("scene:", "buildings of Gemeente Den Haag (open data)" if real else place)

renderer = csm.Renderer()
colours = plot.CASCADE_COLOURS
OUTPUTS = ("mask", "valid", "view_depth", "normal", "cascade_index")


def picture(ax, array, title, **options):
    """An image without ticks, its title at the left."""
    ax.imshow(array, interpolation="nearest", **options)
    ax.set(xticks=[], yticks=[])
    ax.set_title(title, loc="left", fontsize="medium")


# %% [markdown]
# ## A sweep
#
# Three sizes of maps, three numbers of cascades, two filters and two fits: 36 combinations. Each is
# rendered, judged by one ray-traced truth, and timed in turns with the others, so that a busy
# moment hits all of them alike. What comes back is an `xarray.Dataset`: an axis for each setting,
# medians with quartiles for times, units and where it was measured in the attributes. With `out=`
# it would be kept, and go on after a kill.

# %%
axes = {
    "map_size": [256, 512, 1024],
    "cascade_count": [1, 2, 4],
    "look": {"hard": {}, "pcf 5 x 5": {"filter": "pcf", "filter_size": 5}},
    "fit": ["sphere", "visible"],
}
swept = csm.sweep({place: (scene, camera, sun)}, axes, size=size, repeats=3, progress=False)
found = swept.sel(case=place)
print(dict(found.sizes), "of", swept.attrs["driver"])
print(found.ms_total.attrs["long_name"], f"[{found.ms_total.attrs['units']}]")
assert (found.status == "ok").all()

# %% [markdown]
# Memory needs no measuring: maps of $S \times S$ depths of 32 bits are $4 n S^2$ bytes for $n$
# cascades, and neither PCF nor a fit takes any more. Halving the texels should halve the error of a
# hard compare, as the error is a strip along the edges, a part of a texel wide. *Look at the slope
# of the lines: that of the grey ones, by which half the texel is half the error.* Where one falls
# faster, its coarsest map is wrong in more ways than by the place of its edges: see the causes
# below. PCF starts higher: its kernel blurs edges that are sharp under a sun that is a point.

# %%
bytes_of = 4 * found.cascade_count * found.map_size**2
assert (found.bytes_maps == bytes_of).all()
_, panels = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained", sharey=True)
for ax, look in zip(panels, axes["look"], strict=True):
    for fit, line in (("sphere", "o-"), ("visible", "s--")):
        for count, colour in zip(axes["cascade_count"], colours, strict=False):
            error = found.error_total.sel(look=look, fit=fit, cascade_count=count)
            ax.plot(error.map_size, 100 * error, line, color=colour, label=f"{count} x {fit}")
    for height in 10.0 ** np.arange(0, 6, 0.5):
        ax.plot([200, 1300], [height / 200, height / 1300], color=plot.GREY, lw=0.5, zorder=0)
    limits = 100 * float(found.error_total.min()) / 2, 200 * float(found.error_total.max())
    ax.set(xscale="log", yscale="log", xlim=(220, 1200), ylim=limits)
    ax.set(xlabel="texels along a side", ylabel="mean error [%]")
    ax.set_xticks(axes["map_size"], axes["map_size"])
    ax.minorticks_off()
    ax.set_title(f"{look}: error by size, cascades and fit", loc="left", fontsize="medium")
panels[1].legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1, 1))
hard = found.sel(look="hard")
gain = hard.error_total.sel(map_size=256) / hard.error_total.sel(map_size=1024)
slope = float(np.log(gain).mean() / np.log(4.0))
print(f"slope of hard compares, mean: {slope:.2f}")
assert 0.6 < slope < 1.4

# %% [markdown]
# ## What nothing beats
#
# A combination is on the Pareto front if no other is as good for less. *Look at who is on it*: the
# front is the line; a dot far above it is money thrown away. Of a front the useful number is what
# the *next halving* of the error costs, printed below for each of its members. Grey bars are the
# quartiles of the times: where they overlap, on a busy machine, who is on the front by time is
# partly chance; the front by bytes never is.


# %%
def flat(name):
    """Numbers of all combinations, one after the other."""
    return found[name].stack(one=list(axes)).values


names = [f"{n} x {side} {fit}, {look}" for side, n, look, fit in product(*axes.values())]
error, costs = flat("error_total"), {"time": flat("ms_total"), "bytes": flat("bytes_maps")}
is_hard = np.array([name.endswith("hard") for name in names])
_, panels = plt.subplots(1, 2, figsize=(13, 4.4), layout="constrained", sharey=True)
for ax, (kind, cost), label in zip(
    panels, costs.items(), ("time of a frame [ms]", "maps [MB]"), strict=True
):
    shown = cost if kind == "time" else cost / 1e6
    for chosen, look, colour in ((is_hard, "hard", 0), (~is_hard, "pcf 5 x 5", 3)):
        ax.plot(shown[chosen], 100 * error[chosen], "o", color=colours[colour], label=look)
    front = np.flatnonzero(on_front(cost, error))
    front = front[np.argsort(cost[front])]
    ax.step(shown[front], 100 * error[front], "k", where="post", lw=1, zorder=0)
    for i in front:
        ax.annotate(names[i].removesuffix(", hard"), (shown[i], 100 * error[i]), fontsize="x-small",
                    xytext=(4, -10), textcoords="offset points")  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel=label, ylabel="mean error [%]")
    if kind == "time":
        ax.hlines(100 * error, flat("ms_total_q1"), flat("ms_total_q3"), color=plot.GREY, lw=0.7)
    ax.set_xlim(0.7 * shown.min(), 2.2 * shown.max())
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter("{x:g}" if kind == "time" else "")
    ax.set_title(f"error against {kind}", loc="left", fontsize="medium")
panels[0].legend(frameon=False)

# %% [markdown]
# The check is the definition itself, written out: whoever is not on the front is beaten by one who
# is, and along the front the error falls as the cost rises. At equal bytes four cascades beat one
# of twice the side, as cascades are there to do.

# %%
for kind, cost in costs.items():
    front = on_front(cost, error)
    as_cheap, as_good = (one[front] <= one[:, None] for one in (cost, error))
    assert (as_cheap & as_good).any(axis=1).all()
    order = np.argsort(cost[front])
    assert (np.diff(error[front][order]) < 0).all()
    assert (np.diff(cost[front][order]) > 0).all()
    halvings = next_halvings(cost, error)
    print(f"\nthe next halving of the error, by {kind}:")
    for i in np.flatnonzero(front)[order]:
        dearer = halvings[i]
        to = "nothing here"
        if dearer.index is not None:
            to = f"{dearer.factor:.2g} x by {names[dearer.index]}"
        print(f"  {names[i]:28} {error[i]:7.3%}  {to}")
four, one = (hard.error_total.sel(fit="sphere", cascade_count=n, map_size=s) for n, s in
             ((4, 512), (1, 1024)))  # fmt: skip
assert four < one

# %% [markdown]
# ## Why it is wrong
#
# The error of a mask against the truth has causes, and what helps against one is useless against
# another. `csm.compare` traces what an ideal map of these texels under this filter would say, and
# splits the difference: pixel by pixel the causes add up to the error, to rounding. Three settings
# that are wrong in three ways: one coarse map, a wide kernel, no bias. Above their masks, below
# each pixel's largest cause in the colours of the bars. *Look at the colours: each picture has its
# own*, and a thin line of aliasing, which all of them have. The fourth is the coarsest map of the
# sweep: its texels are metres wide, so is its bias, and in The Hague that reaches through the
# shadow of a street.

# %%
CAUSES = ("aliasing", "penumbra", "false_shadow", "peter_panning", "light_leak", "seam")
base = csm.ShadowSettings(map_size=512)
ways = {
    "one map of 512": ("aliasing", base.replace(cascade_count=1)),
    "pcf 7 x 7": ("penumbra", base.replace(filter="pcf", filter_size=7)),
    "no bias": ("false_shadow", base.replace(bias="manual")),
    "one map of 256": (
        "peter_panning" if real else "aliasing", base.replace(cascade_count=1, map_size=256),
    ),
}  # fmt: skip
truth = csm.truth(scene, camera, sun)
frames = {n: renderer.render(scene, camera, sun, s, outputs=OUTPUTS) for n, (_, s) in ways.items()}
reports = {name: csm.compare(frame, truth) for name, frame in frames.items()}
_, panels = plt.subplots(2, 4, figsize=(14, 4.2), layout="constrained")
for (name, report), column in zip(reports.items(), panels.T, strict=True):
    picture(column[0], pictures.mask_picture(frames[name]), f"{name}: {report.mean['total']:.2%}")
    parts = np.array([report.per_pixel[cause] for cause in CAUSES])
    image = 0.55 + 0.4 * pictures.mask_picture(frames[name]) / 255
    most, size_of = np.abs(parts).argmax(axis=0), np.abs(parts).max(axis=0)[..., None]
    rgb = np.array([plt.matplotlib.colors.to_rgb(colours[i]) for i in range(len(CAUSES))])
    alpha = np.sqrt(size_of)  # a tenth of an error shows
    picture(column[1], image * (1 - alpha) + rgb[most] * alpha, "the largest cause")
    assert np.abs(parts.sum(axis=0) - report.per_pixel["total"]).max() < 1e-12

# %%
_, ax = plt.subplots(figsize=(9, 2.8), layout="constrained")
for i, cause in enumerate(CAUSES):
    shares = [100 * report.mean[cause] for report in reports.values()]
    rows = np.arange(len(ways)) + 0.13 * (i - 2.5)
    ax.barh(rows, shares, 0.12, color=colours[i], label=cause.replace("_", " "))
ax.set_yticks(range(len(ways)), list(ways))
ax.invert_yaxis()
ax.set(xlabel="mean absolute error [%]")
ax.legend(frameon=False, fontsize="small")
ax.set_title("by cause", loc="left", fontsize="medium")
for name, (planted, _) in ways.items():
    mean = reports[name].mean
    assert max(CAUSES, key=lambda cause: mean[cause]) == planted, (name, planted)

# %% [markdown]
# ## What theory expects
#
# Aliasing is the one cause that no setting removes: a texel gives the answer of its centre to all
# of its square, so an edge is misplaced by a quarter of a texel on average. From the truth's edges,
# their directions and the texels' shapes in the picture follows how much that must be, without
# rendering a mask: `ErrorReport.expected_aliasing`. *Look at how near the dots lie to the line*,
# over two orders of size. They leave it where texels are larger than the shadows they hold.

# %%
expected, measured = [], []
for texels, count, fit in product(axes["map_size"], (1, 2, 4), axes["fit"]):
    settings = csm.ShadowSettings(cascade_count=count, map_size=texels, fit=fit)
    report = csm.compare(renderer.render(scene, camera, sun, settings, outputs=OUTPUTS), truth)
    expected.append(report.expected_aliasing)
    measured.append(report.mean["aliasing"])
ratio = np.array(measured) / expected
_, ax = plt.subplots(figsize=(6, 4.2), layout="constrained")
line = 100 * np.array([min(expected), max(expected)])
ax.plot(line, line, color=plot.GREY, label="theory")
ax.plot(100 * np.array(expected), 100 * np.array(measured), "o", color=colours[0], label=place)
ax.set(xscale="log", yscale="log", xlabel="expected [%]", ylabel="measured [%]")
ax.set_title("aliasing of hard compares", loc="left", fontsize="medium")
ax.legend(frameon=False)
low, middle, high = np.percentile(ratio, [0, 50, 100])
print(f"measured over expected: {low:.2f} to {high:.2f}, median {middle:.2f}")
assert 0.75 < middle < 1.25

# %% [markdown]
# ## A soft sun
#
# The real sun is a disc, and a wide one here (2 degrees), so that its penumbra shows in a small
# picture. Its truth is soft: 64 rays in each pixel. Against *that* even an exact mask of a sun that
# is a point is wrong, by the grey line, and no number of texels brings a hard compare below it: by
# the triangle inequality its error lies within its own error against the point of that line. *Look
# at what goes below*: a kernel does where it happens to be as wide as the penumbra; `pcss` asks how
# far the caster is.

# %%
disc = csm.Sun(sun.to_light, 2.0)
point, soft = (csm.truth(scene, camera, disc, rays_per_pixel=rays) for rays in (1, 64))
techniques = {
    "hard": {},
    "pcf 5 x 5": {"filter": "pcf", "filter_size": 5},
    "pcss": {"filter": "pcss", "filter_size": 33, "disc": "vogel", "tap_count": 32},
}
softly, masks = {name: [] for name in techniques}, {}
for name, changes in techniques.items():
    for texels in axes["map_size"]:
        settings = csm.ShadowSettings(map_size=texels, **changes)
        frame = renderer.render(scene, camera, disc, settings, outputs=OUTPUTS)
        report = csm.compare(frame, soft)
        floor = np.abs(point.mask - soft.mask)[report.judged].mean()
        softly[name].append(report.mean["total"])
        if name == "hard":
            own = csm.compare(frame, point).mean["total"]
            assert abs(report.mean["total"] - floor) <= own + 1e-6, "triangle inequality"
    masks[name] = frame.mask
assert min(softly["hard"]) > 0.9 * floor > softly["pcss"][-1]

# %%
_, panels = plt.subplots(1, 4, figsize=(14, 2.9), layout="constrained", width_ratios=(1.1, 1, 1, 1))
for (name, errors), colour in zip(softly.items(), colours, strict=False):
    panels[0].plot(axes["map_size"], 100 * np.array(errors), "o-", color=colour, label=name)
panels[0].axhline(100 * floor, color=plot.GREY, label="exact, of a point")
panels[0].set(xscale="log", ylim=(0, None), xlabel="texels along a side", ylabel="mean error [%]")
panels[0].set_xticks(axes["map_size"], axes["map_size"])
panels[0].minorticks_off()
panels[0].set_title("against the sun's disc", loc="left", fontsize="medium")
panels[0].legend(frameon=False, fontsize="small")
images = {"ray-traced": soft.mask, "hard": masks["hard"], "pcss": masks["pcss"]}
for ax, (name, mask) in zip(panels[1:], images.items(), strict=True):
    picture(ax, mask, name, cmap="gray", vmin=0, vmax=1)

# %% [markdown]
# ## The page
#
# `csm.report` makes one HTML file of a sweep that opens offline: fronts, a table with what the next
# halving costs, the least error at equal memory and at equal time. Each combination of the axes is
# a row. `csm report SCENE` does all of it on the command line, over sixty named techniques, with
# crops and flicker. Here the page goes to a folder that is thrown away, after a look at its
# pictures.

# %%
with tempfile.TemporaryDirectory() as folder:
    page = csm.report(swept, out=folder, title=f"What accuracy costs in time: {place}")
    text = page.read_text(encoding="utf-8")
    drawn = {file.name: plt.imread(file) for file in sorted(page.parent.glob("*.png"))}
print(f"{page.name}: {len(text) / 1e6:.1f} MB")
_, panels = plt.subplots(1, len(drawn), figsize=(14, 4.2), layout="constrained")
for ax, (name, image) in zip(panels, drawn.items(), strict=True):
    picture(ax, image, name)
assert text.count("<td>map_size ") >= len(names), "a row for each combination"
assert "='http" not in text, "nothing from outside"

# %% [markdown]
# ## What to take away
#
# - Half the texel, half the error; and four times the bytes. A tighter fit or another cascade is
#   cheaper than either: look at the front of your own scene before you buy resolution.
# - Ask for the cause before you turn a knob. A bias does not help against aliasing.
# - If what is measured lies on the line of theory, nothing but more texels will help.
# - Judge soft shadows by a soft truth: against a point every blur is an error.

# %%
renderer.close()
plt.show()
