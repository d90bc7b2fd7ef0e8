"""Settings of every kind, for properties that all of them must have."""

from hypothesis import strategies as st

import csm
from csm import _core

TABLE = {row["name"]: row for row in _core.effect_table() if row["name"]}

number = st.floats(-4, 4, allow_nan=False)


def settings_of(**values):
    """Settings of values of which some may not go together: those give way."""
    if values["filter_size"] == 2 and values["filter"] != "pcf":
        values["filter_size"] = 3
    if values["filter"] in ("esm", "evsm2", "evsm4"):
        values["moment_format"] = values["moment_format"].replace("unorm16", "float32")
    if values["filter"] == "msm":
        values["moment_format"] = values["moment_format"].replace("float16", "float32")
    if values["storage"] == "cube":
        values["cascade_count"] = min(values["cascade_count"], 6)
    if values["disc"] == "poisson":
        values["tap_count"] = 8 if values["tap_count"] < 16 else 16
    splits = tuple(range(1, values["cascade_count"]))
    return csm.ShadowSettings(**values, manual_splits=splits)


any_settings = st.builds(
    settings_of,
    cascade_count=st.integers(1, 8),
    map_size=st.integers(1, 65536),
    lam=st.floats(0, 1),
    filter_size=st.integers(0, 16).map(lambda half: 2 * half + 1) | st.just(2),
    constant_bias_texels=number,
    slope_bias=number,
    normal_offset_texels=number,
    manual_depth_range=st.just((-3.0, 4.0)),
    first_split=st.sampled_from((0.0, 4.0)),
    max_distance=st.sampled_from((0.0, 50.0)),
    sun_step_deg=st.sampled_from((0.0, 0.5)),
    turned=st.booleans(),
    level_count=st.integers(1, 4096),
    level_hysteresis=st.integers(0, 16),
    pancake=st.booleans(),
    receiver_plane=st.booleans(),
    tile_border=st.integers(0, 64),
    copied_tiles=st.booleans(),
    reversed_depth=st.booleans(),
    tap_count=st.integers(1, 64),
    rotated=st.booleans(),
    anisotropy=st.integers(2, 16),
    samples=st.sampled_from((1, 2, 4, 8)),
    exponent=st.sampled_from((0.0, 3.0)),
    negative_exponent=st.sampled_from((0.0, 2.0)),
    log_filter=st.booleans(),
    layer_count=st.sampled_from((2, 4, 6, 8)),
    fourier_terms=st.sampled_from((2, 8, 16)),
    bleed_step=st.sampled_from((0.0, 0.2)),
    bleed_power=st.sampled_from((1.0, 2.0)),
    blend_width=st.sampled_from((0.0, 0.1, 1.0)),
    fade_width=st.sampled_from((0.0, 0.5)),
    **{
        name: st.sampled_from(row["choices"].split())
        for name, row in TABLE.items()
        if row["type"] == "enum"
    },
)
