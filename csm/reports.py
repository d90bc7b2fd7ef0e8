"""The page about what accuracy costs in time: one HTML file with everything in it.

Made from a dataset alone, as `csm.sweep` gives it; what `csm.report_runs.with_crops_and_flicker`
adds to one over techniques (crops, flicker) is shown where it is there.
"""

import base64
import html
import json
import math
from itertools import chain, count, product
from pathlib import Path

import numpy as np

from .arguments import check_folder
from .report_pictures import crop_picture, error_crop_picture, front_picture
from .report_tables import (
    MIB,
    against_baseline,
    best_table,
    hard_case_table,
    technique_table,
)
from .sweep_points import SETTINGS
from .techniques import TECHNIQUES

__all__ = ["report"]

PAGE = "report.html"
MEANINGS = {
    "aliasing": "texels too coarse: the edge lies where the texel's centre has it (none in soft "
    "shadows of a sun with a disc, which average the disc instead of texels)",
    "penumbra": "what averaging over texels, or a hard edge where the sun's disc is soft, changes; "
    "of soft shadows every error where the truth sees a part of the disc",
    "false_shadow": "acne: surfaces that shadow themselves, for want of bias",
    "peter_panning": "light where an occluder is nearer than the bias, which hides it",
    "light_leak": "light that no bias explains: bleeding of prefiltered maps, missing casters",
    "seam": "what blending between cascades and fading at the end of the range change",
    "too_bright": "light where the truth has shadow",
    "too_dark": "shadow where the truth has light",
}
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 74rem; color: #222;
  padding: 0 1rem; }
h2 { margin-top: 2.5rem; } table { border-collapse: collapse; font-size: 13px; }
th, td { text-align: left; padding: 2px 9px; border-bottom: 1px solid #ddd; vertical-align: top; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.front td:first-child { font-weight: 600; } img { max-width: 100%; }
figure { display: inline-block; margin: 0 .6rem .8rem 0; width: 196px; vertical-align: top; }
figure img { image-rendering: pixelated; border: 1px solid #ccc; width: 96px; }
figcaption { font-size: 11px; line-height: 1.25; color: #444; }
.note { color: #555; font-size: 13px; }
"""


def report(dataset, *, out="report", title="What accuracy costs in time", hard_cases=None):
    """Write the page of a sweep.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `csm.sweep`. Labels of an axis ``technique`` are the techniques; of other axes every
        combination is one, ``"map_size 512, fit box"``, coloured by the first axis of texts,
        if there is one.
    out : path
        Folder: ``report.html``, which needs no other file, and its pictures as PNG files.
    title : str
    hard_cases : path, optional
        Folder that ``csm hard-cases --out`` wrote, to be summed up: a line a case of the matrix.

    Returns
    -------
    page : Path

    Raises
    ------
    ValueError
        If the dataset has no dimension of cases or none, nothing to compare, or lacks errors, times
        or bytes.
    OSError
        If the folder cannot be written, or nothing lies in that of the hard cases.
    """
    for name in ("case", "error_total", "ms_total", "bytes_maps"):
        if name not in dataset:
            raise ValueError(f"dataset must have {name}: csm.sweep(cases, axes) gives it")
    if not dataset.sizes.get("case"):
        raise ValueError(
            "dataset must have a dimension case, of one case at least "
            f"(it has {', '.join(map(str, dataset.sizes)) or 'none'}); take one by isel(case=[0])"
        )
    dataset = _by_technique(dataset)
    hard = hard_case_table(hard_cases)
    folder = Path(out)
    check_folder(folder, "out")
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {}
    dataset, paces = at_one_pace(dataset.transpose("case", "technique", ...))
    parts = [*_head(dataset, title, paces), *best_table(dataset)]
    for case in dataset.case.values:
        parts += _case(
            dataset.sel(case=case), pictures, str(case), _about(dataset.attrs, str(case))
        )
    parts += against_baseline(dataset)
    parts += hard
    parts += _foot(dataset)
    for name, data in pictures.items():
        (folder / name).write_bytes(data)
    page = folder / PAGE
    page.write_text("".join(parts), encoding="utf-8")
    return page


def _by_technique(dataset):
    """Join the axes of a sweep into one, ``technique``, with a ``family`` that colours it."""
    axes = [str(name) for name in dataset.error_total.dims if name != "case"]
    if axes == ["technique"]:
        return dataset
    if not axes:
        raise ValueError("dataset must have an axis to compare, e.g. technique (it has cases only)")
    values = [dataset[axis].values.tolist() for axis in axes]
    coloured = next((i for i, labels in enumerate(values) if isinstance(labels[0], str)), 0)
    names, families = [], []
    for place in product(*values):
        texts = [  # labels of one's own stand for themselves
            f"{axis} {value}" if axis in SETTINGS else str(value)
            for axis, value in zip(axes, place, strict=True)
        ]
        names.append(", ".join(texts))
        families.append(texts[coloured])
    one = "+".join(["", *axes])  # a name that no axis has
    joined = dataset.stack({one: axes}).drop_vars([one, *axes]).rename({one: "technique"})
    return joined.assign_coords(technique=names, family=("technique", families))


def at_one_pace(dataset):
    """Give times as if the machine had been as fast all along.

    Groups of points are timed beside the sweep's first settings. What these took there over their
    median of the case is the pace of a group, and divides its times.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `csm.sweep`, with an axis ``technique``.

    Returns
    -------
    dataset : xarray.Dataset
    paces : (float, float) or None
        The least and the greatest; None where nothing was timed beside.
    """
    if "ms_reference" not in dataset or not dataset.ms_reference.notnull().any():
        return dataset, None
    pace = dataset.ms_reference / dataset.ms_reference.median("technique")
    known = pace.where(pace.notnull(), 1.0)
    times = [name for name in dataset if str(name).startswith("ms_") and name != "ms_reference"]
    adjusted = {name: (dataset[name] / known).assign_attrs(dataset[name].attrs) for name in times}
    return dataset.assign(adjusted), (float(pace.min()), float(pace.max()))


def _head(dataset, title, paces):
    where = dataset.attrs.get("driver", "")
    return [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width'>",
        f"<title>csm: {html.escape(title)}</title><style>{STYLE}</style>",
        f"<h1>{html.escape(title)}</h1>",
        "<p>Every technique below drew the same pictures on the same machine, and was "
        "judged pixel by pixel against ray tracing. <b>Error</b> is the mean of |mask − truth| "
        "over the pixels that face the sun; <b>wrong</b> the share of them on the other side of "
        "one half. <b>Time</b> is the median of all passes of a frame, reading back left out; "
        "in the tables its first and third quartiles stand beside it. "
        f"{_pace_sentence(paces)}"
        "<b>Memory</b> is that of shadow maps and what is made of them. A technique that nothing "
        "beats in error and cost at once lies on the front, the line in the pictures.</p>",
        f"<p class='note'>{html.escape(str(where))}</p>" if where else "",
        *_glossary(dataset),
    ]


def _pace_sentence(paces):
    if paces is None:
        return ""
    low, high = paces
    if low == high:
        return ""
    return (
        "Techniques were timed in groups, each in turns with the first of all, whose time changed "
        f"from group to group, from {low:.2f} to {high:.2f} of its median; the times below have "
        "that taken out. "
    )


def _glossary(dataset):
    """What the causes of error are, of those that the dataset has."""
    lines = [
        f"<tr><td>{cause.replace('_', ' ')}</td><td>{html.escape(meaning)}</td></tr>"
        for cause, meaning in MEANINGS.items()
        if f"error_{cause}" in dataset
    ]
    if "expected_aliasing" in dataset:
        lines.append(
            "<tr><td>expected aliasing</td><td>what theory expects of texels of this size along "
            "the truth's edges; more is measured where texels reach into solids that stand "
            "beside a pixel, less where they are larger than the shadows</td></tr>"
        )
    if "flicker" in dataset:
        lines.append(
            "<tr><td>flicker</td><td>mean change of the mask at fixed points of the scene from "
            "frame to frame, while the camera walks and turns a little, of those that stay in "
            "their cascade</td></tr>"
        )
    if "flicker_transition" in dataset:
        lines.append(
            "<tr><td>between cascades</td><td>the same of the points that another cascade answers "
            "for in the next frame: how much a shadow jumps there</td></tr>"
        )
    if not lines:
        return []
    return [
        "<details><summary>What the columns mean</summary><p>Each error is a mean of absolute "
        "values; in a single pixel the causes add up to the error, signs and all, so that means "
        "may exceed it where causes cancel.</p><table>",
        *lines,
        "</table></details>",
    ]


def _families(one, names):
    if "family" in one.coords:
        return [str(family) for family in one.family.values]
    known = {technique.name: technique.family for technique in TECHNIQUES}
    return [known.get(name, "others") for name in names]


def _about(attributes, case):
    """What a case shows, from the sweep's provenance; "" where that is missing."""
    try:
        known = json.loads(attributes["cases"])[case]
        triangles, camera, sun = known["triangles"], known["camera"], known["sun"]
        elevation = math.degrees(math.asin(sun["to_light"][1]))
        disc = sun["angular_diameter_deg"]
        rays = int(attributes["rays_per_pixel"])
    except (KeyError, TypeError, ValueError):
        return ""
    reference = "a point" if not disc else f"a disc of {disc:g}°"
    if disc and rays > 1:
        least = attributes.get("standard_error")
        reference += ", which the truth averages over " + (
            f"so many rays that its standard error is at most {float(least):g}"
            if least
            else f"{rays} rays a pixel"
        )
    elif disc:
        reference += ", though the truth is that of a point in its middle"
    width, height = camera["size"]
    return (
        f"{triangles} triangles in {width} x {height} pixels. The sun stands {elevation:.0f}° high "
        f"and is {reference}."
    )


def _case(one, pictures, case, about):
    names = [str(name) for name in one.technique.values]
    families = _families(one, names)
    error, time = one.error_total.values, one.ms_total.values
    memory = one.bytes_maps.values / MIB
    axes = [
        ("time", time, error, "time of a frame [ms]", "mean error"),
        ("memory", memory, error, "memory of the maps [MiB]", "mean error"),
    ]
    if "flicker" in one:
        axes.append(("flicker", time, one.flicker.values, "time of a frame [ms]", "flicker"))
    parts = [f"<h2 id='{html.escape(case)}'>{html.escape(case)}</h2>"]
    if about:
        parts.append(f"<p class='note'>{html.escape(about)}</p>")
    for kind, costs, errors, cost_text, error_text in axes:
        name = _free_name(pictures, case, kind)
        pictures[name] = front_picture(
            costs, errors, names, families,
            title=f"{case}: {error_text} against {kind if kind != 'flicker' else 'time'}",
            cost=cost_text, error=error_text,
        )  # fmt: skip
        alternative = f"{error_text} of every technique against {cost_text}"
        parts.append(f"<p>{_image(pictures[name], alternative)}</p>")
    parts += technique_table(one)
    parts += _crops(one, names, pictures, case)
    return parts


def _crops(one, names, pictures, case):
    """The same spot under every technique: its mask and its error."""
    if "crop" not in one:
        return []
    reference = one.crop_truth.values
    name = _free_name(pictures, case, "truth")
    pictures[name] = crop_picture(reference)
    parts = [
        "<h3>The same spot</h3><p>Left the mask, right its error: "
        "<span style='color:#0072B2'>blue</span> too bright, "
        "<span style='color:#D55E00'>orange</span> too dark. Pale blue: nothing is seen there.</p>",
        f"<figure>{_image(pictures[name], 'ray traced mask')}"
        "<figcaption><b>ray traced</b></figcaption></figure>",
    ]
    for i, technique in enumerate(names):
        mask = one.crop.values[i]
        if not np.isfinite(mask).any():
            continue
        both = crop_picture(mask), error_crop_picture(mask, reference)
        pictures[_free_name(pictures, case, technique)] = both[0]
        parts.append(
            f"<figure>{_image(both[0], f'mask of {technique}')}"
            f"{_image(both[1], f'error of {technique}')}"
            f"<figcaption>{html.escape(technique)}: {float(one.error_total.values[i]):.2%}, "
            f"{float(one.ms_total.values[i]):.0f} ms</figcaption></figure>"
        )
    return parts


def _foot(dataset):
    rows = "".join(
        f"<tr><td>{html.escape(str(name))}</td><td>{html.escape(str(value))}</td></tr>"
        for name, value in dataset.attrs.items()
    )
    return [f"<h2>How it was measured</h2><details><table>{rows}</table></details></html>\n"]


def _image(data, alternative):
    encoded = base64.b64encode(data).decode("ascii")
    return (
        f"<img alt='{html.escape(alternative, quote=True)}' src='data:image/png;base64,{encoded}'>"
    )


def _free_name(pictures, *words):
    """File name made of words, numbered where another picture has it: "a b" is not "a_b"."""
    stem = "_".join("".join(c if c.isalnum() else "_" for c in word) for word in words)
    taken = {name.lower() for name in pictures}  # some file systems know no capitals
    names = chain([f"{stem}.png"], (f"{stem}_{number}.png" for number in count(2)))
    return next(name for name in names if name.lower() not in taken)
