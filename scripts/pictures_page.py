"""Draw the pictures of docs/pictures.md: ``python -m scripts.pictures_page [folder]``.

They come from scenes made by code, so anybody can draw them again; the page itself is written by
hand. Needs the extras ``plot`` and ``truth`` and a renderer.
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from PIL import Image

import csm
from csm import plot

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


PICTURES = {"splits": splits, "utilisation": utilisation, "texels": texels, "cubes": cubes}


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
