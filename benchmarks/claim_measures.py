"""What is measured for the claims about areas and errors: a function a claim, Bench to Cases."""

import numpy as np
from claim_verdicts import Case
from claim_views import FAR, at_angle, nearest_depth

import csm

NONE = 255  # of cascade_index
# A view whose larger error is below the first is a matter of some fifty pixels, and left out. Less
# than the second is not a pixel, and counts as that.
CLEAR_ERROR, LEAST_ERROR = 1e-3, 1e-5


def is_clear(errors):
    """Whether errors are enough for their ratio to mean something."""
    return max(errors) >= CLEAR_ERROR


def ratio_of(one, other):
    """Of errors that are clear."""
    return max(one, LEAST_ERROR) / max(other, LEAST_ERROR)


def ratio_cases(bench, views, group, one, other):
    """Cases with the error of settings over that of others; views that both get right are left out.

    group: of a view; one, other: settings, or functions from a view to them.
    """
    found = []
    for view in views:
        first, second = (
            bench.error(view, settings(view) if callable(settings) else settings)
            for settings in (one, other)
        )
        if is_clear((first, second)):
            numbers = {"error": first, "error of the other": second}
            found.append(Case(view.name, group(view), ratio_of(first, second), numbers))
    return found


# -- stabilisation ---------------------------------------------------------------------------------

FOVS, SUNS = (45, 60, 90), 40


def window_areas(camera, sun, receivers=None, **changes):
    """Area of each window on the light's plane [m²]."""
    settings = csm.ShadowSettings(view_range="camera", **changes)
    cascades = csm.fit_cascades(camera, sun, settings, receivers=receivers)
    sides = np.asarray(cascades.texel_size) * np.asarray(cascades.map_size)[:, None]
    return sides.prod(axis=1)


def angle_group(degrees):
    """Name of a third of the angles between light and view."""
    names = ("light within 30° of the view", "30° to 60°", "60° to 90°, across the view")
    return names[min(int(degrees // 30), 2)]


def stabilisation_area(bench):
    """Sphere windows on a lattice over boxes that are neither: mean of four cascades."""
    number = np.arange(SUNS) + 0.5  # a spiral of equal areas over the sky
    height, azimuth = number / SUNS, number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    sky = np.stack([across * np.cos(azimuth), height, across * np.sin(azimuth)], axis=1)
    views = [(view.name, view.camera, view.sun) for view in bench.views]
    for fov in FOVS:
        camera = csm.Camera.look_at(
            (0, 2, 0), (0, 1, -10), fov_y_deg=fov, near=0.5, far=300, size=(1920, 1080)
        )
        views += [(f"{fov}°, sun {i}", camera, csm.Sun(to_light)) for i, to_light in enumerate(sky)]
    found = [_area_cases(*view) for view in views]
    return [pair[i] for i in (0, 1) for pair in found]


def _area_cases(name, camera, sun):
    """Over the box along light x and y, and over the smallest rectangle, turned as it likes."""
    tight = {
        "box along light x and y": window_areas(camera, sun, fit="box", snap="none"),
        "smallest turned rectangle": turned_areas(camera, sun),
    }
    sphere, square = (window_areas(camera, sun, fit=fit) for fit in ("sphere", "diameter"))
    angle = angle_group(np.degrees(np.arccos(min(1.0, abs(sun.to_light @ camera.backward)))))
    found = []
    for group, areas in tight.items():
        mean = float(np.exp(np.log(sphere / areas).mean()))
        numbers = {
            "each cascade": (sphere / areas).tolist(),
            "square of the diameter": float(np.exp(np.log(square / areas).mean())),
        }
        found.append(Case(name, f"over the {group}, {angle}", mean, numbers))
    return found


def turned_areas(camera, sun):
    """Area of the smallest rectangle round each slice, turned as it likes [m²].

    The slices' corners are given as all that is seen, a hair inside so that each is in its slice.
    """
    settings = csm.ShadowSettings(view_range="camera")
    splits = csm.fit_cascades(camera, sun, settings).splits
    sides = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)])
    plane = sides * [camera.half_width, camera.half_height]
    rays = plane @ np.stack([camera.right, camera.up]) - camera.backward
    hair = 1e-6
    depths = np.stack([splits[:-1] * (1 + hair), splits[1:] * (1 - hair)], axis=1).ravel()
    corners = camera.eye + (depths[:, None, None] * rays).reshape(-1, 3)
    return window_areas(
        camera, sun, corners, fit="visible", turned=True, snap="none", select="interval"
    )


# -- cascades and splits ---------------------------------------------------------------------------

FIVE = csm.ShadowSettings(cascade_count=5, map_size=640)
THREE = csm.ShadowSettings(cascade_count=3, map_size=1024)


# Of equal ratios a cascade spans r^(1/n), and a texel of it as much over the size: 5 of 640 are
# finer than 3 of 1024 if r^(1/3 - 1/5) > 1024 / 640.
DEEP = (1024 / 640) ** (1.0 / (1.0 / 3.0 - 1.0 / 5.0))  # 34


def near_raised(bench, view):
    """Copy whose near plane lies at half the depth of the nearest receivers."""
    near = 0.5 * nearest_depth(bench, view)
    return view.replace("near raised", camera=view.camera.replace(near=near))


def more_cascades_error(bench):
    """5 maps of 640² against 3 of 1024²; the near plane at what is seen."""
    found = []
    for split in ("logarithmic", "practical"):
        five, three = FIVE.replace(split=split), THREE.replace(split=split)

        def group(view, five=five, split=split):
            splits = csm.fit_cascades(view.camera, view.sun, five, scene=view.scene).splits
            deep = splits[-1] / splits[0] > DEEP
            return f"{split} splits, range {'over' if deep else 'under'} {DEEP:.0f} x its near end"

        views = [near_raised(bench, view) for view in bench.views + bench.views_of(FAR)]
        found += ratio_cases(bench, views, group, five, three)
    return found


PRACTICAL, UNIFORM, LOGARITHMIC = (
    csm.ShadowSettings(map_size=1024, split=split)
    for split in ("practical", "uniform", "logarithmic")
)


def split_views(bench):
    """Every view with its own near plane, and with one at half the nearest receivers' depth."""
    return bench.views + [near_raised(bench, view) for view in bench.views]


def empty_cascades(bench, view):
    """Group by how many logarithmic cascades end before the nearest receivers."""
    cascades = csm.fit_cascades(view.camera, view.sun, LOGARITHMIC, scene=view.scene)
    wasted = int((cascades.splits[1:] < nearest_depth(bench, view)).sum())
    return (
        f"{('none', 'one', 'two or three')[min(wasted, 2)]} of four cascades before all receivers"
    )


def near_share(bench, view):
    """Group by the share of the receivers in the first uniform slice."""
    index = bench.render(view, UNIFORM.replace(select="interval")).cascade_index
    share = (index[index != NONE] == 0).mean()
    if share >= 0.5:
        return "most receivers in the first quarter of the range"
    return "most receivers beyond the first quarter"


def splits_uniform(bench):
    """Practical against uniform."""
    views = split_views(bench)
    return ratio_cases(bench, views, lambda view: near_share(bench, view), PRACTICAL, UNIFORM)


def splits_logarithmic(bench):
    """Practical against logarithmic."""
    views = split_views(bench)
    return ratio_cases(
        bench, views, lambda view: empty_cascades(bench, view), PRACTICAL, LOGARITHMIC
    )


# -- angles ----------------------------------------------------------------------------------------

ANGLES = (5, 30, 60, 85)
FITS = {
    "fit sphere, snapped (the source's own)": {"fit": "sphere", "snap": "exact"},
    "fit box, tight": {"fit": "box", "snap": "none"},
}


def looks_down(view):
    """Whether the camera looks down enough for a sun behind it to be above the ground."""
    return view.camera.backward[1] > 0.15


def angle_views(bench):
    """Views that take a sun at any angle, each scene and camera once."""
    return [view for view in bench.views if looks_down(view)]


def selection_gain(bench, view, fit):
    """(levels, ratio): how much finer texels are by map than by interval, and the error's ratio.

    Levels are a mean over all that is seen, sunlit or not: the same pixels at every angle.
    """
    frames = [
        bench.render(view, csm.ShadowSettings(map_size=1024, select=select, **fit))
        for select in ("interval", "map")
    ]
    seen = np.logical_and.reduce([frame.cascade_index != NONE for frame in frames])
    texel = np.log2(frames[0].cascades.texel_size.max(axis=1))
    levels = [texel[frame.cascade_index[seen]] for frame in frames]
    errors = [csm.compare(frame, bench.truth(view)).mean["total"] for frame in frames]
    ratio = ratio_of(errors[1], errors[0]) if is_clear(errors) else None
    return float((levels[0] - levels[1]).mean()), ratio


def map_selection(bench):
    """Gain of map over interval with light and view in line, less that with them across."""
    found = []
    for group, fit in FITS.items():
        for view in angle_views(bench):
            gains = [selection_gain(bench, at_angle(view, angle), fit) for angle in ANGLES]
            numbers = {
                "angles": list(ANGLES),
                "levels gained": [levels for levels, _ in gains],
                "error, map over interval": [ratio for _, ratio in gains],
            }
            found.append(Case(view.name, group, gains[0][0] - gains[-1][0], numbers))
    return found


LARGER = csm.ShadowSettings(map_size=1024, fit="box", snap="none")
SAME = LARGER.replace(map_size=512)
SINGLE = LARGER.replace(cascade_count=1, map_size=2048)
WARPED = SAME.replace(warp="lispsm")
WARP_ANGLES = {20: "light 20° from the view", 80: "light across it (80°)"}
COARSEST = 99  # percentile
LOWEST = 0.1  # sine of the sun's elevation


def coarseness(bench, view, settings):
    """(mean error, texels' length in pixels that one in a hundred receivers exceeds)."""
    frame, truth = bench.render(view, settings), bench.truth(view)
    report = csm.compare(frame, truth)
    texels = csm.metrics.undersampling(frame, truth)[report.judged]
    return report.mean["total"], float(np.nanpercentile(texels, COARSEST))


def warping(bench):
    """LiSPSM in each of four cascades of 512² against maps of four times as many texels without."""
    found = []
    cameras = {(v.scene_name, v.camera): v for v in bench.views + bench.views_of(FAR)}
    for view in cameras.values():
        looks = "camera looks down" if looks_down(view) else "camera looks along the ground"
        for angle, lit in WARP_ANGLES.items():
            one = near_raised(bench, at_angle(view, angle))
            if one.sun.to_light[1] < LOWEST:
                continue
            errors, texels = {}, {}
            for name, settings in (
                ("warped", WARPED), ("four of 512²", SAME), ("four of 1024²", LARGER),
                ("one of 2048²", SINGLE),
            ):  # fmt: skip
                errors[name], texels[name] = coarseness(bench, one, settings)
            if is_clear(errors.values()):
                for what, values in (("mean error", errors), ("coarsest texels", texels)):
                    value = ratio_of(values["warped"], values["four of 1024²"])
                    found.append(Case(one.name, f"{what}, {looks}, {lit}", value, values))
    return found
