"""What is measured for the claims about filters and formats: a function a claim, Bench to Cases."""

import numpy as np
from claim_measures import is_clear, ratio_of
from claim_verdicts import Case

import csm

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
            if is_clear((leak, there)):
                numbers = {"leak at 512": leak, "leak at 1024": there}
                value = ratio_of(there, leak)
                found.append(Case(view.name, f"kernel of {group}", value, numbers))
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
LEAST_EXCESS = 1.1  # error at a seam over that without: below there is nothing to remove
CLEAR_SEAM = 5e-3  # of error in its pixels, likewise
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
            least = max((LEAST_EXCESS - 1.0) * plain.get("hardware", 0.0), CLEAR_SEAM)
            if added and added["hardware"] > least:
                for name in GRADIENTS[1:]:
                    value = added[name] / added["hardware"]
                    numbers = {"added by the seam": added, "without it": plain}
                    found.append(Case(view.name, f"{name}, {lookup}", value, numbers))
    return found
