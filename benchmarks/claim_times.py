"""What is measured for the claims about time: a function a claim, Bench to Cases.

Settings are rendered in turns of up to three frames that count, after one that does not; every
number is a median with its quartiles. Times are those of this machine's driver.
"""

import shutil
import tempfile
from importlib import resources
from pathlib import Path

import numpy as np
from claim_measures import FIVE, THREE
from claim_verdicts import LEAST_CASES, Case

import csm

PICTURE = (1280, 720)
TIMED = ("town street", "forest path", "ms_shadow_columns dueling", "denhaag_lod2 oblique",
         "bigtujunga_dem ridge", "forest_assembled path", "littlest_tokyo street")  # fmt: skip
SUN_DISC, SOFT_RAYS = 0.53, 16  # degrees, rays a pixel: what penumbrae are judged by


def timed_views(bench):
    """Outdoor views of the size that is timed; without the real scenes, whatever there is."""
    chosen = [view for view in bench.views if view.name.startswith(TIMED)]
    if len(chosen) < LEAST_CASES:
        chosen = bench.views
    return [view.sized(PICTURE) for view in chosen]


# -- blending --------------------------------------------------------------------------------------

FILTERS = {
    "Poisson disc, 8 taps (the source's)": {"filter": "poisson", "tap_count": 8, "filter_size": 5},
    "PCF 5 x 5": {"filter": "pcf", "filter_size": 5},
}
BRANCH = "if (found.next_weight > 0.0) {\n        float next"
NO_BRANCH = BRANCH.removeprefix("if (found.next_weight > 0.0) ")


def without_branch(folder):
    """Copy of csm's shaders whose blend looks up both cascades of every pixel.

    The weight is 0 outside of transitions, so that the picture stays what it is.
    """
    path = Path(folder) / "shaders"
    with resources.as_file(resources.files("csm.shaders")) as source:
        shutil.copytree(source, path, ignore=shutil.ignore_patterns("__pycache__"))
    file = path / "include" / "visibility.glsl"
    text = file.read_text(encoding="utf-8")
    if text.count(BRANCH) != 1:
        raise RuntimeError(f"{file.name} no longer has the branch that this takes out: {BRANCH!r}")
    file.write_text(text.replace(BRANCH, NO_BRANCH), encoding="utf-8")
    return path


def blended_share(bench, view, settings):
    """Share of the receivers in a transition."""
    truth = bench.truth(view)
    bench.render(view, settings)
    seen = truth.valid & truth.facing
    found = bench.renderer.visibility(truth.position[seen], truth.normal[seen])
    return float((found.blend_weight > 0.0).mean())


def blending(bench):
    """Times of the mask without, with, and with an unconditional blend: (view, group, times…)."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        shaders = without_branch(folder)
        backend, stage = bench.renderer.info["backend"], bench.renderer.info["stage"]
        with csm.Renderer(backend, shader_dir=shaders, stage=stage) as other:
            for view in timed_views(bench):
                for group, changes in FILTERS.items():
                    plain = csm.ShadowSettings(map_size=1024, **changes)
                    linear = plain.replace(blend="linear")
                    masks = [
                        bench.render(view, linear, outputs=("mask",), renderer=renderer).mask
                        for renderer in (None, other)
                    ]
                    if not np.array_equal(*masks):
                        raise RuntimeError("without its branch the blend gives another picture")
                    jobs = {
                        "no blend": (None, plain),
                        "blend": (None, linear),
                        "both looked up": (other, linear),
                    }
                    share = blended_share(bench, view, linear)
                    found.append((view, group, share, bench.times(view, jobs)))
    return found


def _blend_cases(bench, kind):
    found = []
    for view, group, share, times in bench.once("blending", blending):
        value = times[kind]["shadow_mask"][0] / times["no blend"]["shadow_mask"][0]
        numbers = {
            "share of receivers in a transition": share,
            "whole frame": times[kind]["total"][0] / times["no blend"]["total"][0],
            "ms of the mask, no blend": times["no blend"]["shadow_mask"],
            f"ms of the mask, {kind}": times[kind]["shadow_mask"],
        }
        found.append(Case(view.name, group, value, numbers))
    return found


def blend_branching(bench):
    """Cost of the mask with a blend that only transitions pay for."""
    return _blend_cases(bench, "blend")


def blend_both(bench):
    """Cost of the mask with a blend that every pixel pays for."""
    return _blend_cases(bench, "both looked up")


# -- more and smaller maps -------------------------------------------------------------------------

CASTERS = 100_000  # triangles that divide few from many


def more_cascades_cost(bench):
    """Whole frames with 5 maps of 640² over those with 3 of 1024²."""
    found = []
    for view in timed_views(bench):
        for group, changes in FILTERS.items():
            jobs = {
                "five": (None, FIVE.replace(**changes)),
                "three": (None, THREE.replace(**changes)),
            }
            times = bench.times(view, jobs)
            ratio = {
                name: times["five"][name][0] / times["three"][name][0]
                for name in ("total", "shadow_map", "shadow_mask")
            }
            bytes_ = [csm.plan(settings).bytes for _, settings in jobs.values()]
            numbers = {
                "maps alone": ratio["shadow_map"],
                "mask alone": ratio["shadow_mask"],
                "bytes": bytes_[0] / bytes_[1],
                "ms, five": times["five"]["total"],
                "ms, three": times["three"]["total"],
            }
            many = "over" if view.scene.triangle_count > CASTERS else "under"
            name = f"{view.name}, {group}"
            found.append(Case(name, f"{many} {CASTERS:,} triangles", ratio["total"], numbers))
    return found


# -- variance maps ---------------------------------------------------------------------------------

VARIANCE_VIEWS, VARIANCE_ROUNDS = LEAST_CASES, 3  # they take seconds a frame without a GPU
MAPS = {"5 maps of 640²": (5, 640), "4 maps of 1024²": (4, 1024)}
OPPONENTS = {
    "8 Poisson taps": (5, {"filter": "poisson", "tap_count": 8, "filter_size": 5}),
    "PCF 9 x 9": (9, {"filter": "pcf", "filter_size": 9}),
    "PCF 25 x 25": (25, {"filter": "pcf", "filter_size": 25}),
}
WIDEST = {"5 maps of 640²": 25, "4 maps of 1024²": 9}  # wider blurs take minutes without a GPU


def variance_maps(bench):
    """Whole frames of variance maps over those of compares with a kernel as wide."""
    found = []
    for view in timed_views(bench)[:VARIANCE_VIEWS]:
        soft = view.sized(bench.size).replace("", sun=csm.Sun(view.sun.to_light, SUN_DISC))
        for maps, (count, size) in MAPS.items():
            base = csm.ShadowSettings(cascade_count=count, map_size=size)
            opponents = {k: one for k, one in OPPONENTS.items() if one[0] <= WIDEST[maps]}
            jobs = {}
            for name, (width, changes) in opponents.items():
                jobs[name] = (None, base.replace(**changes))
                jobs[width] = (None, base.replace(filter="vsm", filter_size=width))
            times = bench.times(view, jobs, VARIANCE_ROUNDS)
            for name, (width, _) in opponents.items():
                errors = [bench.error(soft, jobs[one][1], rays=SOFT_RAYS) for one in (width, name)]
                numbers = {
                    "error, over the compares'": errors[0] / errors[1],
                    "ms, variance": times[width]["total"],
                    "ms, compares": times[name]["total"],
                    "ms, compares, mask alone": times[name]["shadow_mask"],
                    "ms, variance, mask alone": times[width]["shadow_mask"],
                }
                value = times[width]["total"][0] / times[name]["total"][0]
                found.append(Case(view.name, f"{maps}, against {name}", value, numbers))
    return found
