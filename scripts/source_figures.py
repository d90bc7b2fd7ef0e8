"""Figures that the sources state, and ours, computed: ``python -m scripts.source_figures`` writes
them into the table of docs/numerics.md 25.

tests/test_source_figures.py fails while the page has others.
"""

import argparse
import itertools
import re
from pathlib import Path

import numpy as np

import csm
from csm import _core, spaces

PAGE = Path(__file__).resolve().parents[1] / "docs" / "numerics.md"
BEGIN, END = "<!-- source figures -->\n", "<!-- end of source figures -->"
HEAD = "| source | states | found | how |\n|---|---|---|---|\n"


def camera_of(ratio, fov_y_deg=60.0, aspect=16 / 9, near=1.0):
    """At the origin, looking along -z, y up."""
    half_height = np.tan(np.radians(fov_y_deg / 2))
    return csm.Camera(
        np.zeros(3), *np.eye(3), half_height * aspect, half_height, near, near * ratio, (16, 9),
        False,
    )  # fmt: skip


def sun_at(camera, angle_deg, around_deg=90.0):
    """A sun whose light comes in at an angle to the view; 90 around: from above."""
    angle, around = np.radians((angle_deg, around_deg))
    side = np.cos(around) * camera.right + np.sin(around) * camera.up
    return csm.Sun(-np.cos(angle) * camera.backward + np.sin(angle) * side)


def span(values, form="{:.2f}"):
    """The least and the largest of values, as text."""
    return f"{form.format(min(values))} to {form.format(max(values))}"


# -- utilisation -----------------------------------------------------------------------------------


def utilisation(camera, centre, radius, near, far, samples=1000):
    """Share of the columns of a square window, light from above, that meet the view."""
    grid = (np.arange(samples) + 0.5) / samples * 2.0 - 1.0
    across, along = np.meshgrid(radius * grid, centre + radius * grid)
    met = (along >= near) & (along <= far) & (np.abs(across) <= camera.half_width * along)
    return met.mean()


def sylvan_utilisation(ratio):
    """A first slice whose map serves the slice alone, then all of the view, then shifted."""
    camera = camera_of(ratio)
    centre, radius = _core.fit_sphere(camera, 1.0, ratio)
    k2 = camera.half_width**2 + camera.half_height**2
    shifted = 1.0 + np.sqrt(radius**2 - k2)  # docs/numerics.md 25
    return (
        utilisation(camera, centre, radius, 1.0, ratio),
        utilisation(camera, centre, radius, 1.0, np.inf),
        utilisation(camera, shifted, radius, 1.0, np.inf),
    )


def row_utilisation():
    found = "; ".join(
        f"f/n = {ratio}: " + ", ".join(f"{share:.2f}" for share in sylvan_utilisation(ratio))
        for ratio in (3, 30)
    )
    return (
        "[Sylvan]", "about 1/6 of the first map is used, 5/6 after the shift", found,
        "slice alone, the whole view, and shifted; 60° high, 16:9, sun from above: most of the "
        "gain is the selection",
    )  # fmt: skip


# -- what the sphere costs -------------------------------------------------------------------------


def sphere_over_box(camera, sun):
    """Area of the sphere's window over that of the box, in light space."""
    settings = csm.ShadowSettings(cascade_count=1, snap="none", view_range="camera")
    areas = [
        csm.fit_cascades(camera, sun, settings.replace(fit=fit)).texel_size[0].prod()
        for fit in ("sphere", "box")
    ]
    return areas[0] / areas[1]


def row_sphere_over_box():
    above = [sphere_over_box(camera_of(ratio), csm.Sun((0, 1, 0))) for ratio in (3, 5, 10, 30)]
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(500, 3))
    means = [
        np.mean([sphere_over_box(camera_of(ratio), csm.Sun(each)) for each in directions])
        for ratio in (3, 30)
    ]
    return (
        "[Zhang2009]", "with spheres a considerable portion of the map is wasted",
        f"{span(above, '{:.1f}')} times the area; {span(means, '{:.1f}')} over all suns",
        "window of the sphere over that of the box, f/n 3 to 30, 60° high, 16:9, sun from above; "
        "means over 500 random suns",
    )  # fmt: skip


# -- levels ----------------------------------------------------------------------------------------


def turning_path(frames=1000, step=0.01):
    """Cameras that turn about the vertical."""
    for frame in range(frames):
        heading = step * frame
        ahead = (np.cos(heading), -0.2, np.sin(heading))
        yield csm.Camera.look_at((0, 2, 0), ahead, fov_y_deg=60, near=1.0, far=60.0, size=(16, 9))


def levels_along(path, **changes):
    """Different texel sizes, and frames that change one, of the first cascade."""
    settings = csm.ShadowSettings(
        cascade_count=2, view_range="camera", fit="box", map_size=1024, **changes
    )
    scene = csm.scenes.plane_and_box()
    sizes, held = [], None
    for camera in path:
        held = csm.fit_cascades(camera, csm.Sun((0.5, 0.7, 0.3)), settings, scene=scene, held=held)
        sizes.append(held.texel_size[0].copy())
    sizes = np.array(sizes)
    changed = (np.diff(sizes, axis=0) != 0).any(axis=1)
    return len(np.unique(np.round(sizes[:, 0], 12))), np.count_nonzero(changed)


def row_levels():
    raw, linear, held, geometric = (
        levels_along(turning_path(), **changes)
        for changes in (
            {"snap": "none"},
            {"snap": "approximate"},
            {"snap": "approximate", "level_hysteresis": 2},
            {"snap": "approximate", "level_spacing": "geometric"},
        )
    )
    return (
        "[Zhang2009] 4.1.2", "64 levels of scale are a good choice",
        f"{raw[0]} scales become {linear[0]}; {linear[1]} of 999 pairs of frames still change, "
        f"{held[1]} with a hysteresis of 2; geometric levels: {geometric[0]} scales, "
        f"{geometric[1]} changes",
        "width of the first box of two; a change is one of width or height; the camera turns by "
        "0.01 rad in each of 1000 frames",
    )  # fmt: skip


# -- selection -------------------------------------------------------------------------------------


def finer_share(fit, angle_deg, count=4, samples=20_000):
    """Share of the view's points that a finer map than that of their slice holds."""
    camera = camera_of(1000.0, near=0.1)
    settings = csm.ShadowSettings(fit=fit, snap="none", view_range="camera", cascade_count=count)
    cascades = csm.fit_cascades(camera, sun_at(camera, angle_deg), settings)
    rng = np.random.default_rng(1)
    shares = []
    for i, (near, far) in enumerate(itertools.pairwise(cascades.splits)):
        u, v, w = rng.uniform(-1, 1, size=(3, samples))
        depth = np.cbrt(near**3 + (0.5 + 0.5 * w) * (far**3 - near**3))  # even in space
        points = np.stack([u * camera.half_width * depth, v * camera.half_height * depth, -depth])
        finer = np.zeros(samples, bool)
        for matrix in cascades.clip_from_world[:i]:
            finer |= (np.abs(spaces.transform_points(matrix, points.T)[:, :2]) <= 1).all(axis=1)
        shares.append(finer.mean())
    return np.mean(shares)


def row_map_selection():
    angles = (0.001, 30, 60, 90)
    sphere = [finer_share("sphere", angle) for angle in angles]
    box = [finer_share("box", angle) for angle in angles]
    return (
        "[MSDN], [Zhang2009]", "by map the finest map that holds a point is used",
        f"a finer map for {span(sphere)} of the points with spheres, {span(box)} with boxes",
        "even in space within each of 4 slices, f/n 1000, λ 0.5, sun at 0°, 30°, 60°, 90° to the "
        "view",
    )  # fmt: skip


# -- culling ---------------------------------------------------------------------------------------


def boxes_of(scene):
    """(n, 6) bounds of the instances."""
    rows = []
    for mesh, matrix in zip(scene.instance_mesh, scene.world_from_instance, strict=True):
        points = spaces.transform_points(matrix, scene.meshes[mesh].positions)
        rows.append(np.concatenate([points.min(axis=0), points.max(axis=0)]))
    return np.array(rows)


def casters_saved(scene, boxes, *, exclusive):
    """For each camera and sun: share of the casters in the windows that culling leaves out."""
    saved, settings = [], csm.ShadowSettings()
    culled = {"border_texels": 0.0} if exclusive else {}
    for camera, sun in itertools.product(scene.cameras.values(), scene.suns.values()):
        drawn, held = (
            sum(
                len(
                    _core.cull_boxes(
                        camera, sun.to_light, settings, scene.bounds.ravel(), boxes, i, **options
                    )
                )
                for i in range(settings.cascade_count)
            )
            for options in (culled, {"whole_window": True})
        )
        saved.append(1 - drawn / held)
    return saved


def row_culling():
    found = []
    for name, objects in (("forest", "1501"), ("demo", "4001")):
        scene = csm.scenes.SCENES[name]()
        boxes = boxes_of(scene)
        shares = [casters_saved(scene, boxes, exclusive=each) for each in (False, True)]
        inclusive, both = (span(each, "{:.0%}") for each in shares)
        found.append(f"`{name}`, {objects} objects: {inclusive}, {both} with exclusive culling")
    return (
        "[Stone]", "30 to 75 % fewer objects", "; ".join(found),
        "casters that the windows hold and culling leaves out, every camera and sun of two made "
        "scenes, four spheres",
    )  # fmt: skip


# -- float32 ---------------------------------------------------------------------------------------


def look_at_error(tilt):
    """How far a look-at basis in float32 is from the same in doubles, up being +y and the light a
    place 100 m from its target, at a tilt from up."""
    target = np.array([31.7, 2.4, -57.3])
    place = target + 100 * np.array([0.6 * np.sin(tilt), np.cos(tilt), 0.8 * np.sin(tilt)])
    bases = []
    for kind in (np.float32, np.float64):
        light = place.astype(kind) - target.astype(kind)
        light /= np.sqrt((light * light).sum())
        side = np.cross(np.array([0, 1, 0], kind), light)
        side /= np.sqrt((side * side).sum())
        bases.append(np.stack([side, np.cross(light, side), light]))
    return np.abs(bases[0] - bases[1]).max()


def row_look_at():
    tilts = (1e-2, 1e-4, 1e-6)
    directions = [(0.6 * np.sin(tilt), np.cos(tilt), 0.8 * np.sin(tilt)) for tilt in tilts]
    ours = max(
        np.abs(basis @ basis.T - np.eye(3)).max()
        for basis in (_core.light_basis(each)[:3, :3] for each in directions)
    )
    errors = ", ".join(f"{look_at_error(tilt):.0e}" for tilt in tilts)
    return (
        "[theomader]", "look-at with an up vector fails for a light straight down",
        f"axes off by {errors}; those of section 6: below {10.0 ** np.ceil(np.log10(ours)):.0e}",
        "float32 against doubles, a light 100 m from its target, 10⁻², 10⁻⁴, 10⁻⁶ from up",
    )  # fmt: skip


def matrix_error(distance, relative):
    """Texels that a float32 transform is off, 20 m on 1024 texels, `distance` from the origin."""
    rng = np.random.default_rng(2)
    origin = distance * np.ones(3)
    camera = camera_of(10.0).translated(origin)
    settings = csm.ShadowSettings(cascade_count=1, map_size=1024, view_range="camera", snap="none")
    settings = settings.replace(fit="sphere")
    camera = camera.replace(near=0.1, far=10.0 / np.hypot(camera.half_width, camera.half_height))
    matrix = csm.fit_cascades(camera, csm.Sun((0.4, 0.8, 0.3)), settings).uvz_from_world[0]
    local = rng.uniform(-3, 3, size=(2000, 3)).astype(np.float32)
    exact = spaces.transform_points(matrix, local + origin)[:, :2]
    if relative:
        shift = np.eye(4)
        shift[:3, 3] = origin
        points, rounded = local, (matrix @ shift).astype(np.float32)
    else:
        points, rounded = (local + origin).astype(np.float32), matrix.astype(np.float32)
    found = points @ rounded[:2, :3].T + rounded[:2, 3]
    return np.abs(found - exact).max() * 1024


def row_world_matrix():
    distances = [1e3, 1e4, 1e5, 1e6, 1e8]
    world = ", ".join(f"{matrix_error(each, False):.1g}" for each in distances)
    local = max(matrix_error(each, True) for each in distances)
    return (
        "[Zhang2009]", "offsets flicker because of the limited precision of floats",
        f"off by {world} texels; relative to an origin near by: at most {local:.1g}",
        "float32 matrix and positions, 20 m on 1024 texels, 10³, 10⁴, 10⁵, 10⁶, 10⁸ m from the "
        "origin: precision comes second, the window's own sub-texel motion first",
    )  # fmt: skip


ROWS = [
    row_utilisation,
    row_sphere_over_box,
    row_levels,
    row_map_selection,
    row_culling,
    row_look_at,
    row_world_matrix,
]


def line(row):
    """A row of the table as text."""
    return "| " + " | ".join(row()) + " |\n"


def table(rows):
    """The table of these rows."""
    return HEAD + "".join(map(line, rows))


def page_with(text, lines):
    """The page with the table between its marks."""
    pattern = re.escape(BEGIN) + ".*?" + re.escape(END)
    return re.sub(pattern, lambda _: BEGIN + lines + END, text, count=1, flags=re.DOTALL)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--print", action="store_true", help="print the table, write nothing")
    lines = table(ROWS)
    if parser.parse_args().print:
        print(lines)
    else:
        PAGE.write_text(page_with(PAGE.read_text(encoding="utf-8"), lines), encoding="utf-8")
        print(PAGE)


if __name__ == "__main__":
    main()
