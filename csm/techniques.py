"""The techniques that a report compares: names that a reader knows, and their settings."""

from dataclasses import dataclass

__all__ = ["BASELINE", "FAMILIES", "TECHNIQUES", "Technique", "settings_by_name"]

# Families in the order of a report's colours.
FAMILIES = (
    "maps and cascades",
    "fits and splits",
    "warps",
    "bias and selection",
    "filters by taps",
    "prefiltered",
    "soft",
)
BASELINE = "hard"


@dataclass(frozen=True)
class Technique:
    """Settings that differ from the defaults, under a name."""

    name: str
    family: str
    settings: dict


def _family(number, rows):
    return [Technique(name, FAMILIES[number], changes) for name, changes in rows.items()]


def _maps():
    """Cascades and sizes; those in brackets have the bytes of four maps of 2048."""
    rows = {BASELINE: {}}
    for size in (512, 1024, 4096):
        rows[f"4 maps of {size}"] = {"map_size": size}
    for count, size in ((1, 4096), (2, 2896), (3, 2364), (6, 1672), (8, 1448)):
        rows[f"{count} of {size}" if count > 1 else "1 map of 4096"] = {
            "cascade_count": count,
            "map_size": size,
        }
    rows["5 of 640"] = {"cascade_count": 5, "map_size": 640}
    rows["3 of 1024"] = {"cascade_count": 3, "map_size": 1024}
    rows["1 of 2048"] = {"cascade_count": 1}
    rows["16-bit depth"] = {"depth_format": "d16"}
    rows["atlas"] = {"storage": "atlas"}
    return rows


def _fits():
    rows = {
        f"fit {fit}": {"fit": fit} for fit in ("diameter", "shifted", "box", "clipped", "focus")
    }
    rows |= {
        "fit visible": {"fit": "visible"},
        "visible, turned": {"fit": "visible", "turned": True},
        "visible, 4 of 1024": {"fit": "visible", "map_size": 1024},
        "visible, 1 of 2048": {"fit": "visible", "cascade_count": 1},
        "not snapped": {"snap": "none"},
        "uniform splits": {"split": "uniform"},
        "logarithmic splits": {"split": "logarithmic"},
        "lambda 0.8": {"lam": 0.8},
        "splits by what is seen": {"split": "sdsm"},
    }
    return rows


def _warps():
    return {
        "LiSPSM": {"warp": "lispsm"},
        "PSM": {"warp": "psm"},
        "TSM": {"warp": "tsm"},
        "1 of 2048, LiSPSM": {"cascade_count": 1, "warp": "lispsm"},
    }


def _biases():
    manual = {"bias": "manual"}
    return {
        "constant bias 1": {**manual, "constant_bias_texels": 1.0},
        "slope bias 1": {**manual, "slope_bias": 1.0},
        "normal offset 1": {**manual, "normal_offset_texels": 1.0, "slope_bias": 0.25},
        "back faces cast": {**manual, "caster_faces": "back"},
        "by interval": {"select": "interval"},
        "exclusive culling": {"cull": "exclusive"},
        "blended": {"blend": "linear"},
        "dithered": {"blend": "dither"},
    }


def _taps():
    rows = {"hardware 2x2": {"filter": "pcf", "filter_size": 2}}
    rows |= {f"pcf {k}x{k}": {"filter": "pcf", "filter_size": k} for k in (3, 5, 7, 9)}
    rows |= {
        f"pcf 5x5 {weights}": {"filter": "pcf", "filter_size": 5, "filter_weights": weights}
        for weights in ("bilinear", "tent", "gaussian")
    }
    rows["pcf 5x5, no gather"] = {"filter": "pcf", "filter_size": 5, "filter_fetch": "taps"}
    disc = {"filter": "poisson", "filter_size": 5}
    rows |= {
        "poisson 8": {**disc, "tap_count": 8},
        "poisson 16": disc,
        "poisson 16, rotated": {**disc, "rotated": True},
        "vogel 16, rotated": {**disc, "disc": "vogel", "rotated": True},
    }
    return rows


def _moments():
    five = {"filter_size": 5}
    rows = {f"vsm {k}x{k}": {"filter": "vsm", "filter_size": k} for k in (3, 5, 9)}
    rows |= {
        "vsm 5x5, 16 bits": {"filter": "vsm", **five, "moment_format": "float16"},
        "vsm 5x5, trilinear": {
            "filter": "vsm", **five, "lookup": "trilinear", "gradients": "analytic",
        },
        "evsm2 5x5": {"filter": "evsm2", **five},
        "evsm4 5x5": {"filter": "evsm4", **five},
        "evsm4 5x5, 16 bits": {"filter": "evsm4", **five, "moment_format": "float16"},
        "esm 5x5": {"filter": "esm", **five},
        "esm 5x5, by logarithms": {"filter": "esm", **five, "log_filter": True},
        "msm 5x5": {"filter": "msm", **five},
        "msm 5x5, 16 bits": {"filter": "msm", **five, "moment_format": "unorm16"},
        "lvsm 5x5": {"filter": "lvsm", **five},
        "savsm 5x5": {"filter": "savsm", **five},
        "fourier 5x5, 4 of 1024": {
            "filter": "fourier", **five, "map_size": 1024, "fourier_terms": 8,
            "moment_format": "float16",
        },
    }  # fmt: skip
    return rows


def _soft():
    pcss = {"filter": "pcss", "filter_size": 15}
    return {
        "pcss": pcss,
        "pcss, vogel rotated": {**pcss, "disc": "vogel", "rotated": True},
        "pcss by variance": {**pcss, "pcss_map": "variance"},
        "pcss by summed areas": {**pcss, "pcss_map": "summed"},
    }


TECHNIQUES = tuple(
    technique
    for number, rows in enumerate(
        (_maps(), _fits(), _warps(), _biases(), _taps(), _moments(), _soft())
    )
    for technique in _family(number, rows)
)


def settings_by_name(families=None):
    """Settings of the techniques: what `csm.sweep` takes as an axis ``technique``.

    Parameters
    ----------
    families : sequence of str, optional
        Only those of these families and the baseline, which is always among them.

    Returns
    -------
    settings : dict of str to dict

    Raises
    ------
    TypeError, ValueError
        If it is a text, or a name is no family.
    """
    if isinstance(families, str):
        raise TypeError(f"families must be a sequence of names (got the string {families!r})")
    names = FAMILIES if families is None else tuple(families)
    for name in names:
        if name not in FAMILIES:
            raise ValueError(f"families may name {', '.join(FAMILIES)} (got {name!r})")
    return {
        one.name: dict(one.settings)
        for one in TECHNIQUES
        if one.family in names or one.name == BASELINE
    }
