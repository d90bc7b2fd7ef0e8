"""What is measured for the claims about areas and errors: a function a claim, Bench to Cases."""

import numpy as np
from claim_verdicts import Case
from claim_views import FAR, at_angle, nearest_depth

import csm

NONE = 255  # of cascade_index
SMALLEST_ERROR = 1e-4  # a view with less of an error than this says nothing about it


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
        if min(first, second) > SMALLEST_ERROR:
            numbers = {"error": first, "error of the other": second}
            found.append(Case(view.name, group(view), first / second, numbers))
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


# Of equal ratios a cascade spans r^(1/n), and a texel of it as much over the size: 5 of 640 are finer
# than 3 of 1024 if r^(1/3 - 1/5) > 1024 / 640.
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
    ratio = errors[1] / errors[0] if errors[0] > SMALLEST_ERROR else None
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


def coarseness(bench, view, settings):
    """(mean error, texels' length in pixels that one in a hundred receivers exceeds)."""
    frame, truth = bench.render(view, settings), bench.truth(view)
    report = csm.compare(frame, truth)
    texels = csm.metrics.undersampling(frame, truth)[report.judged]
    return report.mean["total"], float(np.nanpercentile(texels, COARSEST))


def warping(bench):
    """LiSPSM in each of four cascades of 512² against maps of four times as many texels without."""
    found = []
    for view in angle_views(bench):
        for angle, lit in WARP_ANGLES.items():
            one = near_raised(bench, at_angle(view, angle))
            errors, texels = {}, {}
            for name, settings in (
                ("warped", WARPED), ("four of 512²", SAME), ("four of 1024²", LARGER),
                ("one of 2048²", SINGLE),
            ):  # fmt: skip
                errors[name], texels[name] = coarseness(bench, one, settings)
            for what, values in (("mean error", errors), ("coarsest texels", texels)):
                for other in ("four of 1024²", "one of 2048²"):
                    if min(errors.values()) > SMALLEST_ERROR:
                        value = values["warped"] / values[other]
                        found.append(Case(one.name, f"{what}, {other}, {lit}", value, values))
    return found


# -- filters and formats ---------------------------------------------------------------------------

LEAK_SIZE = (320, 180)
KERNELS = {"the same texels": 3, "the same metres": 7}  # at 1024; 3 and the lookup's one at 512


def light_bleeding(bench):
    """Light leaks of variance maps of 1024² over those of 512²."""
    found = []
    for view in bench.views:
        view = view.sized(LEAK_SIZE)
        base = csm.ShadowSettings(filter="vsm", map_size=512, filter_size=3)
        leak = bench.report(view, base).mean["light_leak"]
        for group, kernel in KERNELS.items():
            finer = base.replace(map_size=1024, filter_size=kernel)
            there = bench.report(view, finer).mean["light_leak"]
            if min(leak, there) > SMALLEST_ERROR:
                numbers = {"leak at 512": leak, "leak at 1024": there}
                found.append(Case(view.name, f"kernel of {group}", there / leak, numbers))
    return found


QUANTA = (0.0, 0.25, 0.5, 1.0, 2.0)
FREE_OF_ACNE = (1.1, 2e-5)  # share of D32F's acne, and of the pixels, that may be left


def depth_settings(cascades, quanta, **changes):
    """One map with the receiver plane and a quarter texel of slope, plus so many D16 quanta."""
    quantum = float(np.diff(cascades.depth_range[0])[0]) / 65535.0
    texel = float(cascades.texel_size[0].max())
    return csm.ShadowSettings(
        cascade_count=1, fit="box", bias="manual", receiver_plane=True, slope_bias=0.25,
        constant_bias_texels=quanta * quantum / texel, **changes,
    )  # fmt: skip


STRETCHES = {1: "", 16: ", range 16 times the scene's"}
AT_STAKE = 0.01  # share of the receivers


def flat_share(bench, view, cascades, quantum):
    """Share of the receivers on which half a quantum is more than a quarter texel of slope."""
    truth = bench.truth(view)
    normal = truth.normal[truth.valid & truth.facing] @ cascades.light_from_world[0][:3, :3].T
    slope = np.abs(normal[:, :2]).sum(axis=1) / np.abs(normal[:, 2])
    return float((0.25 * slope * cascades.texel_size[0].max() < 0.5 * quantum).mean())


def sixteen_bits(bench):
    """Quanta of bias that 16-bit maps need for no more acne than 32-bit maps without."""
    found = []
    plain = csm.ShadowSettings(cascade_count=1, fit="box")
    for view in bench.views:
        window = csm.fit_cascades(view.camera, view.sun, plain, scene=view.scene)
        near, far = window.depth_range[0]
        for stretch, suffix in STRETCHES.items():
            middle, half = 0.5 * (near + far), 0.5 * stretch * (far - near)
            depths = {"depth_range": "manual", "manual_depth_range": (middle - half, middle + half)}
            settings = plain.replace(**depths)
            cascades = csm.fit_cascades(view.camera, view.sun, settings, scene=view.scene)
            quantum = 2.0 * half / 65535.0
            causes = [
                _acne(bench, view, depth_settings(cascades, quanta, depth_format="d16", **depths))
                for quanta in QUANTA
            ]
            fine = _acne(bench, view, depth_settings(cascades, 0.0, **depths))["false_shadow"]
            allowed = FREE_OF_ACNE[0] * fine + FREE_OF_ACNE[1]
            enough = [
                quanta
                for quanta, one in zip(QUANTA, causes, strict=True)
                if one["false_shadow"] <= allowed
            ]
            share = flat_share(bench, view, cascades, quantum)
            numbers = {
                "flat share": share,
                "quantum over texel": quantum / float(cascades.texel_size[0].max()),
                "quanta": list(QUANTA),
                "acne": [one["false_shadow"] for one in causes],
                "acne of D32F": fine,
                "lost contact": [one["peter_panning"] for one in causes],
            }
            many = "1 % of the receivers and more" if share >= AT_STAKE else "fewer"
            group = f"half a quantum exceeds the slope's bias on {many}"
            value = enough[0] if enough else 2.0 * QUANTA[-1]
            found.append(Case(view.name + suffix, group, value, numbers))
    return found


def _acne(bench, view, settings):
    report = bench.report(view, settings)
    return {cause: report.mean[cause] for cause in ("false_shadow", "peter_panning")}


# -- seams -----------------------------------------------------------------------------------------

LEAST_SEAM = 40  # pixels
LEAST_EXCESS = 1.1  # of the error at a seam without remedy: below there is nothing to remove
MOVED = (1.1, 1 / 1.1)  # splits of the pictures whose seams lie elsewhere
GRADIENTS = ("hardware", "quad", "analytic")


def seam_pixels(index, counted):
    """(h, w) bool: pixels in quads that more than one cascade answers for, where all count.

    GL counts rows from below, and quads begin at even rows and columns there.
    """
    height, width = (side // 2 * 2 for side in index.shape)
    top = index.shape[0] - height

    def quads(values):
        return values[top:, :width].reshape(height // 2, 2, width // 2, 2)

    mixed = quads(index).max(axis=(1, 3)) > quads(index).min(axis=(1, 3))
    mixed &= quads(counted).all(axis=(1, 3))
    found = np.zeros(index.shape, bool)
    found[top:, :width] = mixed.repeat(2, axis=0).repeat(2, axis=1)
    return found


def seam_errors(bench, view, settings):
    """What a seam adds to the mean error of its pixels, by gradients, and the error without it.

    The same pixels are judged in pictures whose splits are moved a little either way, where the
    quads of two cascades lie elsewhere: what they have there is not the seam's.

    Returns
    -------
    added, plain : dict of str to float, empty where the picture has hardly a seam
    """
    splits = csm.fit_cascades(view.camera, view.sun, settings, scene=view.scene).splits[1:-1]
    scales = (1.0, *MOVED)
    frames = {
        (name, scale): bench.render(
            view,
            settings.replace(gradients=name, split="manual", manual_splits=tuple(scale * splits)),
        )
        for name in GRADIENTS
        for scale in scales
    }
    reports = {key: csm.compare(frame, bench.truth(view)) for key, frame in frames.items()}
    judged = np.logical_and.reduce([report.judged for report in reports.values()])
    # without a remedy each pixel has the cascade of its own depth
    seam = {scale: seam_pixels(frames["hardware", scale].cascade_index, judged) for scale in scales}
    own = seam[1.0] & ~np.logical_or.reduce([seam[scale] for scale in MOVED])
    if own.sum() < LEAST_SEAM:
        return {}, {}
    error = {key: np.abs(one.per_pixel["total"])[own].mean() for key, one in reports.items()}
    plain = {name: float(np.mean([error[name, s] for s in MOVED])) for name in GRADIENTS}
    return {name: float(error[name, 1.0] - plain[name]) for name in GRADIENTS}, plain


def seams(bench):
    """Share of a seam that gradients quad and analytic leave of it."""
    found = []
    for lookup in ("trilinear", "anisotropic"):
        settings = csm.ShadowSettings(
            filter="vsm", filter_size=1, map_size=1024, lookup=lookup, select="interval"
        )
        for view in bench.views:
            added, plain = seam_errors(bench, view, settings)
            if added and added["hardware"] > (LEAST_EXCESS - 1.0) * plain["hardware"]:
                for name in GRADIENTS[1:]:
                    value = added[name] / added["hardware"]
                    numbers = {"added by the seam": added, "without it": plain}
                    found.append(Case(view.name, f"{name}, {lookup}", value, numbers))
    return found
