"""What must be set besides a setting so that it has a meaning: for tests and the page."""

__all__ = ["NEEDS", "SOME_VALUES", "needs_of", "values_of"]

# By setting, or by setting and value.
NEEDS = {
    "filter_size": {"filter": "pcf"},
    "receiver_plane": {"bias": "manual"},
    "normal_offset_texels": {"bias": "manual"},
    "turned": {"fit": "visible"},
    "level_spacing": {"snap": "approximate"},
    "level_count": {"snap": "approximate"},
    "level_hysteresis": {"snap": "approximate"},
    ("select", "frustum"): {"filter": "pcf"},
    "filter_weights": {"filter": "pcf"},
    "filter_fetch": {"filter": "pcf"},
    "kernel": {"filter": "pcf"},
    "disc": {"filter": "poisson"},
    "tap_count": {"filter": "poisson"},
    "rotated": {"filter": "poisson"},
    "pcss_map": {"filter": "pcss"},
    "moment_format": {"filter": "vsm"},
    "lookup": {"filter": "vsm"},
    "anisotropy": {"filter": "vsm", "lookup": "anisotropic"},
    "samples": {"filter": "vsm"},
    "log_filter": {"filter": "esm"},
    "msm_bound": {"filter": "msm"},
    "layer_count": {"filter": "lvsm"},
    "fourier_terms": {"filter": "fourier"},
    "gradients": {"filter": "vsm", "lookup": "trilinear"},
    "plane": {"filter": "pcf"},
    "bias_side": {"bias": "manual", "slope_bias": 1.0},
    "tile_border": {"storage": "atlas"},
    "copied_tiles": {"storage": "atlas"},
    ("split", "manual"): {"manual_splits": (2.0, 5.0, 9.0)},
    ("split", "percentages"): {"manual_splits": (2.0, 15.0, 40.0)},
    ("depth_range", "manual"): {"manual_depth_range": (-50.0, 50.0)},
}
# Of numbers without a limit of their own kind.
SOME_VALUES = {
    "samples": [1, 2, 4],
    "tap_count": [16, 8],
    "layer_count": [4, 2, 6, 8],
    "fourier_terms": [16, 2, 4],
    "anisotropy": [8, 2, 16],
    "tile_border": [0, 1, 64],
}


def values_of(row):
    """Every value of a row of the table; of kernel sizes the first of each kind and the last."""
    if row["type"] == "enum":
        return row["choices"].split()
    if row["type"] == "bool":
        return [False, True]
    if row["name"] == "filter_size":
        return [1, 2, 3, 5, row["max"]]
    if row["name"] in SOME_VALUES:
        return SOME_VALUES[row["name"]]
    if row["name"] == "level_count":
        return [1, 64, row["max"]]
    return list(range(row["min"], row["max"] + 1))


def needs_of(name, value):
    """What must be set besides this value of a setting, as a dict of settings."""
    needs = {**NEEDS.get(name, {}), **NEEDS.get((name, value), {})}
    return {setting: given for setting, given in needs.items() if setting != name}
