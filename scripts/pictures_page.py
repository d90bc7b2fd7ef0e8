"""Draw the pictures of docs/pictures.md: ``python -m scripts.pictures_page [folder]``.

They come from scenes made by code, so anybody can draw them again; the page itself is written by
hand. Needs the extras ``plot`` and ``truth`` and a renderer.
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import csm
from csm import plot, shapes

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images"
COLOURS = 64  # of the palette a picture is saved with: a third of the bytes, no difference seen
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index", "shadow_maps", "normal")


def splits():
    """Schemes along the view, and what they mean in pixels."""
    scene = csm.scenes.town(8000)
    camera = csm.Camera.look_at((-30, 18, 38), (12, 3, -6), near=0.5, far=250, size=(1280, 720))
    base = csm.ShadowSettings(map_size=1024)
    schemes = {
        "uniform": base.replace(split="uniform"),
        "practical, λ = 0.5": base,
        "practical, λ = 0.9": base.replace(lam=0.9),
        "logarithmic": base.replace(split="logarithmic"),
    }
    named = {
        name: csm.fit_cascades(camera, scene.suns["afternoon"], settings, scene=scene)
        for name, settings in schemes.items()
    }
    figure, (bars, lines) = plt.subplots(
        2, 1, figsize=(7.5, 6.0), layout="constrained", height_ratios=(2, 3), sharex=True
    )
    plot.splits(named, ax=bars).set_xlabel("")
    plot.texels_per_pixel(named, camera, ax=lines)
    return figure


def utilisation():
    """A map's use under selection by interval and by map, and after Sylvan's shift."""
    camera = csm.Camera.look_at((0, 2, 0), (0, 2, -1), near=2, far=60, size=(1280, 720))
    settings = csm.ShadowSettings(
        cascade_count=2, split="manual", manual_splits=(6.0,), view_range="camera", map_size=256
    )
    figure, axes = plt.subplots(1, 3, figsize=(12.0, 4.4), layout="constrained", sharey=True)
    for ax, fit, select in zip(
        axes, ("sphere", "sphere", "shifted"), ("interval", "map", "frustum"), strict=True
    ):
        chosen = settings.replace(fit=fit, select=select)
        cascades = csm.fit_cascades(camera, csm.Sun((0, 1, 0)), chosen)
        plot.light_view(cascades, camera, select=select, ax=ax)
        used = ax.get_title(loc="left").partition(": ")[2]
        ax.set_title(f'fit="{fit}", select="{select}"\n{used}', loc="left", fontsize="medium")
    return figure


def stairs_frame(renderer, map_size):
    """A flight of stairs in three small maps."""
    camera = csm.Camera.look_at(
        (-9, 5, 3), (0, 1, -4), fov_y_deg=45, near=2, far=24, size=(800, 430)
    )
    settings = csm.ShadowSettings(
        cascade_count=3, lam=0.8, map_size=map_size, cull="none", view_range="camera"
    )
    return renderer.render(
        csm.scenes.stairs(), camera, csm.Sun.from_compass(250, 38), settings, outputs=OUTPUTS
    )


def texels():
    """The texel grid on what is seen."""
    with csm.Renderer() as renderer:
        return plot.texel_outlines(stairs_frame(renderer, 160)).figure


def cubes():
    """What the maps stored, put back into the world."""
    with csm.Renderer() as renderer:
        return plot.texel_cubes(stairs_frame(renderer, 96), renderer=renderer).figure


def filters():
    """Filters on one crop, beside the ray-traced sun."""
    sun = csm.Sun.from_compass(125, 35, 1.6)
    slats = shapes.boxes_at(
        np.array([[0.25 * i - 3.2, 0, 1.8] for i in range(10)]),
        (-0.06, 0, -0.02),
        (0.06, 1.2, 0.02),
    )
    scene = csm.Scene.merge(csm.scenes.plane_and_box(), csm.Scene.from_arrays(*slats))
    camera = csm.Camera.look_at((-5.5, 5, 6), (-2.6, 0, 0.6), fov_y_deg=27, far=30, size=(320, 240))
    base = csm.ShadowSettings(map_size=512, cascade_count=2, filter_size=7)
    chosen = {
        "hard": {"filter": "hard"},
        "pcf, 7 x 7": {"filter": "pcf"},
        "poisson, rotated": {"filter": "poisson", "rotated": True},
        "pcss": {"filter": "pcss", "filter_size": 33, "tap_count": 32, "disc": "vogel"},
        "vsm": {"filter": "vsm"},
        "msm": {"filter": "msm"},
        "esm": {"filter": "esm"},
    }
    masks = {"ray-traced sun's disc": csm.truth(scene, camera, sun, rays_per_pixel=64).mask}
    with csm.Renderer() as renderer:
        for name, changes in chosen.items():
            settings = base.replace(**changes)
            masks[name] = renderer.render(scene, camera, sun, settings, outputs=("mask",)).mask
    return panels(masks, 2, 4)


def seams():
    """Where two cascades share quads of pixels: a lookup's level with and without remedies."""
    floor = csm.Scene.from_arrays(*shapes.ground(200.0))
    slat = np.array([[0, 3, -60], [0.25, 3, -60], [0.25, 3, 30], [0, 3, 30]])
    slats = (np.arange(-60, 60)[:, None, None] * [0.5, 0, 0] + slat).reshape(-1, 3)
    faces = (4 * np.arange(120)[:, None, None] + [[0, 2, 1], [0, 3, 2]]).reshape(-1, 3)
    camera = csm.Camera.look_at(
        (0, 2, 8), (0, 0, 2), (0.2, 1, 0), fov_y_deg=40, near=0.3, far=30, size=(480, 272)
    )
    cut = csm.ShadowSettings(
        filter="vsm", filter_size=1, map_size=1024, split="manual", manual_splits=(5, 8, 12),
        fit="box", select="interval", lookup="anisotropic",
    )  # fmt: skip
    scene = csm.Scene.merge(floor, csm.Scene.from_arrays(slats, faces))
    masks = {}
    with csm.Renderer() as renderer:
        for gradients in ("hardware", "quad", "analytic"):
            frame = renderer.render(
                scene, camera, csm.Sun((0.3, 1, 0.1)), cut.replace(gradients=gradients),
                outputs=("mask",),
            )  # fmt: skip
            masks[f'gradients="{gradients}"'] = frame.mask[120:, 80:400]
    return panels(masks, 1, 3)


def panels(masks, rows, columns):
    """Masks by name, in rows."""
    height, width = next(iter(masks.values())).shape
    size = (2.6 * columns, (2.6 * height / width + 0.25) * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained")
    for ax, (name, mask) in zip(axes.ravel(), masks.items(), strict=True):
        ax.imshow(mask, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        ax.set(xticks=[], yticks=[])
        ax.set_title(name, loc="left", fontsize="medium")
    return figure


PICTURES = {
    "splits": splits,
    "utilisation": utilisation,
    "texels": texels,
    "cubes": cubes,
    "filters": filters,
    "seams": seams,
}


def save(figure, path):
    """Write a figure as a PNG of few colours."""
    figure.savefig(path, dpi=100)
    with Image.open(path) as picture:
        few = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def main(folder=FOLDER):
    """Draw every picture into a folder."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        save(draw(), folder / f"{name}.png")
        print(f"{folder / name}.png")
        plt.close("all")


if __name__ == "__main__":
    main(*sys.argv[1:])
