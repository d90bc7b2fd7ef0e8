"""Renderers whose filters answer with a number they were given, read from the mask: what no output
tells, such as a pixel's footprint in its map.

The sun's angular diameter says which number, as filters that are probed do not use it.
"""

import shutil
from importlib import resources

import numpy as np

import csm

# Answers of a probed vsm and hard filter, in the order of their numbers.
FOOTPRINT = ("footprint_0", "footprint_1", "footprint_2", "footprint_3")
ANSWERS = (*FOOTPRINT, "moments", "u", "v", "slope_u", "slope_v", "z")

PROBE = """
float filter_visibility(map_receiver at)
{
    int what = int(round(frame.blend.w * 1000.0));
    vec2 place = vec2(at.texel) + at.fraction;
    if (what >= 5) {
        float plane = what == 7 ? at.slope.x : what == 8 ? at.slope.y : at.z;
        return what == 5 ? place.x : what == 6 ? place.y : plane;
    }
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    if (what < 4) {
        return at.footprint[what];
    }
#endif
#if CSM_PREFILTERED
    return moments_at(at, 0, 1).x;
#else
    return 0.0;
#endif
}
"""


def folder(tmp_path, footprint=None):
    """Shaders with probed filters; ``footprint`` is GLSL that replaces the pixel's own."""
    shaders = tmp_path / "shaders"
    shutil.copytree(resources.files("csm.shaders"), shaders)
    for name in ("vsm", "hard"):
        (shaders / "include" / f"filter_{name}.glsl").write_text(PROBE)
    if footprint is not None:
        path = shaders / "include" / "cascade_select.glsl"
        text = path.read_text()
        own = "at.footprint = footprint_of(point, chosen);"
        assert own in text
        path.write_text(text.replace(own, f"at.footprint = {footprint};"))
    return shaders


def ask(renderer, what, scene, camera, to_light, settings, outputs=("mask",), **more):
    """A frame whose mask holds the answer where the sun is faced; 1 beyond the shadow range."""
    number = ANSWERS.index(what)
    sun = csm.Sun(to_light, angular_diameter_deg=2.0 * np.degrees(np.arctan(number / 1000.0)))
    return renderer.render(scene, camera, sun, settings, outputs=outputs, **more)


def ask_footprint(renderer, *arguments, **more):
    """((h, w, 2, 2) texels, frame): steps along x, then along y, each in u, v."""
    frames = [ask(renderer, what, *arguments, **more) for what in FOOTPRINT]
    steps = np.stack([frame.mask.astype(np.float64) for frame in frames], axis=-1)
    return steps.reshape(*steps.shape[:2], 2, 2), frames[0]


# -- exact points of the ground -------------------------------------------------------------------


def ground_points(camera, column, row):
    """(..., 3) where rays through places of the picture, in pixels from its upper left corner, meet
    y = 0."""
    width, height = camera.size
    x = (2.0 * np.asarray(column) / width - 1.0) * camera.half_width + camera.centre_x
    y = (1.0 - 2.0 * np.asarray(row) / height) * camera.half_height + camera.centre_y
    side = x[..., None] * camera.right + y[..., None] * camera.up
    if camera.orthographic:
        start, direction = camera.eye + side, np.broadcast_to(-camera.backward, side.shape)
    else:
        start, direction = np.broadcast_to(camera.eye, side.shape), side - camera.backward
    return start - direction * (start[..., 1] / direction[..., 1])[..., None]


def centres(camera):
    """(h, w) column and row of every pixel's centre."""
    width, height = camera.size
    return np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)


def quad_partner(size, along_y):
    """(h, w) row and column of each pixel's partner in its quad; GL counts rows from below."""
    width, height = size
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    if along_y:
        return height - 1 - ((height - 1 - row) ^ 1), column
    return row, column ^ 1


def texels_of(cascades, index, points):
    """(..., 2) u, v in texels of the map that index names, pixel by pixel."""
    texels = np.full((*points.shape[:-1], 2), np.nan)
    for i in range(cascades.count):
        homogeneous = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)
        uvz = homogeneous @ cascades.uvz_from_world[i].T
        place = uvz[..., :2] / uvz[..., 3:] * cascades.map_size[i]
        texels[index == i] = place[index == i]
    return texels
