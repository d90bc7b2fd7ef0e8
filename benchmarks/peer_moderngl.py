"""Cascaded shadow maps as one writes them by hand in Python with moderngl: the peer of csm.

Four plain depth passes over the whole scene into one atlas, then one forward pass of the camera
that takes the first map that holds the point and compares once; the cascades (practical splits,
bounding spheres, texel snapping) are numpy. It is given every advantage that costs its author
nothing: positions alone (12 bytes a vertex), one light-space position for all four windows, one
lookup per fragment, an eight-bit mask. It does no culling and keeps floats on the GPU, as usual.
Measured while writing it: a prepass with a full-screen mask took 1.1 to 1.6 times this forward
pass, four separate maps chosen by a switch twice.
"""

import moderngl
import numpy as np

DEPTH_VERTEX = """
#version 450
uniform mat4 clip_from_local;
in vec3 position;
void main() { gl_Position = clip_from_local * vec4(position, 1.0); }
"""

DEPTH_FRAGMENT = """
#version 450
void main() {}
"""

MASK_VERTEX = """
#version 450
uniform mat4 clip_from_local;
in vec3 position;
out vec3 point;
void main()
{
    point = position;
    gl_Position = clip_from_local * vec4(position, 1.0);
}
"""

MASK_FRAGMENT = """
#version 450
const int COUNT = 4;
uniform mat3 light_from_local;
uniform vec3 window[COUNT];  // texture coordinates = light xy * z + xy
uniform float texel_size[COUNT];
uniform vec2 depth_range;
uniform vec3 eye;
uniform sampler2DShadow atlas;  // 2 x 2 maps
in vec3 point;
out float lit;

void main()
{
    vec3 normal = normalize(cross(dFdx(point), dFdy(point)));
    normal = light_from_local * faceforward(normal, point - eye, normal);
    vec3 point_ls = light_from_local * point;
    int found = -1;
    vec2 uv = vec2(0.0);
    for (int i = COUNT - 1; i >= 0; i--) {
        vec2 here = point_ls.xy * window[i].z + window[i].xy;
        if (all(equal(clamp(here, 0.0, 1.0), here))) {
            found = i;
            uv = here;
        }
    }
    if (normal.z <= 1e-5 || found < 0) {
        lit = found < 0 && normal.z > 1e-5 ? 1.0 : 0.0;
        return;
    }
    float bias = 0.75 * texel_size[found] * (abs(normal.x) + abs(normal.y)) / normal.z;
    float depth = (-point_ls.z - bias - depth_range.x) / (depth_range.y - depth_range.x);
    lit = texture(atlas, vec3(0.5 * (uv + vec2(found & 1, found >> 1)), depth));
}
"""

GL_FROM_ZO = np.diag([1.0, 1.0, 2.0, 1.0])  # moderngl leaves clip z in [-1, 1]
GL_FROM_ZO[2, 3] = -1.0


def practical_splits(near, far, count, lam):
    """(count + 1,) view depths [m]."""
    share = np.arange(count + 1) / count
    return lam * near * (far / near) ** share + (1 - lam) * (near + (far - near) * share)


def light_axes(to_light):
    """(3, 3) rows x, y, z = to_light of an orthonormal basis that needs no up vector."""
    x, y, z = to_light / np.linalg.norm(to_light)
    s = np.copysign(1.0, z)
    a = -1.0 / (s + z)
    return np.array(
        [[1 + s * x * x * a, s * x * y * a, -s * x], [x * y * a, s + y * y * a, -y], [x, y, z]]
    )


def bounding_sphere(near, far, slope):
    """View depth of the centre and radius [m] of the least sphere around a slice.

    slope is the tangent of half the diagonal field of view.
    """
    if slope**2 * (far + near) >= far - near:
        return far, slope * far
    centre = 0.5 * (near + far) * (1 + slope**2)
    return centre, np.hypot(far - centre, slope * far)


def fit(camera, axes, shadow_range, map_size, count=4, lam=0.5):
    """Lower corners (count, 2) in light space and texel sizes (count,) [m] of snapped windows."""
    splits = practical_splits(*shadow_range, count, lam)
    slope = np.hypot(camera.half_width, camera.half_height)
    corners, texels = np.zeros((count, 2)), np.zeros(count)
    for i in range(count):
        centre_depth, radius = bounding_sphere(splits[i], splits[i + 1], slope)
        centre = axes[:2] @ (camera.eye - centre_depth * camera.backward)
        texels[i] = 2 * radius / (map_size - 1)
        corners[i] = np.round(centre / texels[i] - map_size / 2) * texels[i]
    return corners, texels


def f32(values):
    """float32 bytes; matrices in GLSL's column order."""
    return np.asarray(values, np.float32).tobytes("F" if np.ndim(values) == 2 else "C")


class Peer:
    """A hand-written hard-shadow renderer for one scene.

    Parameters
    ----------
    positions : (n, 3) float64
        World positions [m].
    triangles : (m, 3) int32
    origin : (3,) float64
        World point that the float32 positions are relative to.
    size : (int, int)
        Width and height of the mask [px].
    map_size : int
        Texels along the side of each of the four maps.
    """

    def __init__(self, positions, triangles, origin, size, map_size=2048):
        context = moderngl.create_context(
            standalone=True, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1", require=450
        )
        self.context, self.map_size, self.origin = context, map_size, origin
        vertices = context.buffer(f32(np.ravel(positions - origin)))
        indices = context.buffer(np.asarray(triangles, np.int32).tobytes())
        self.depth = context.program(vertex_shader=DEPTH_VERTEX, fragment_shader=DEPTH_FRAGMENT)
        self.mask = context.program(vertex_shader=MASK_VERTEX, fragment_shader=MASK_FRAGMENT)
        self.casters = context.vertex_array(self.depth, [(vertices, "3f", "position")], indices)
        self.receivers = context.vertex_array(self.mask, [(vertices, "3f", "position")], indices)
        atlas = context.depth_texture((2 * map_size, 2 * map_size))
        atlas.filter = (moderngl.NEAREST, moderngl.NEAREST)
        atlas.compare_func = "<="
        atlas.use(0)
        self.maps = context.framebuffer(depth_attachment=atlas)
        self.target = context.framebuffer(
            [context.texture(size, 1)], context.depth_renderbuffer(size)
        )
        self.pixels = np.empty((size[1], size[0]), np.float32)

    def render(self, camera, to_light, shadow_range, depth_range):
        """Draw four maps and the mask of a hard shadow; read the mask back.

        Parameters
        ----------
        camera : csm.Camera
            Only its numbers are read.
        to_light : (3,) float64
            Unit vector towards the sun.
        shadow_range, depth_range : (float, float)
            View depths that have shadows [m]; light-view depths of z = 0 and z = 1 [m].

        Returns
        -------
        mask : (height, width) float32
            1 is lit; row 0 on top. The next call writes the same array again.
        """
        with self.context as context:
            context.enable_only(moderngl.DEPTH_TEST)
            self._draw(camera, light_axes(np.asarray(to_light)), shadow_range, depth_range)
            rows = np.frombuffer(self.target.read(components=1, alignment=1), np.uint8)
        rows = rows.reshape(self.pixels.shape)[::-1]
        return np.multiply(rows, np.float32(1 / 255), out=self.pixels)

    def _draw(self, camera, axes, shadow_range, depth_range):
        corners, texels = fit(camera, axes, shadow_range, self.map_size)
        corners -= axes[:2] @ self.origin
        low, high = np.add(depth_range, axes[2] @ self.origin)
        sides = self.map_size * texels

        self.maps.viewport = (0, 0, 2 * self.map_size, 2 * self.map_size)
        self.maps.clear(depth=1.0)
        self.maps.use()
        for i in range(4):
            clip_from_local = np.eye(4)
            clip_from_local[:2, :3] = 2 * axes[:2] / sides[i]
            clip_from_local[:2, 3] = -2 * corners[i] / sides[i] - 1
            clip_from_local[2, :3] = -2 * axes[2] / (high - low)
            clip_from_local[2, 3] = -2 * low / (high - low) - 1
            tile = (self.map_size * (i & 1), self.map_size * (i >> 1))
            self.maps.viewport = (*tile, self.map_size, self.map_size)
            self.depth["clip_from_local"].write(f32(clip_from_local))
            self.casters.render()

        view_from_local = camera.view_from_world.copy()
        view_from_local[:3, 3] += view_from_local[:3, :3] @ self.origin
        self.mask["clip_from_local"].write(
            f32(GL_FROM_ZO @ camera.clip_from_view @ view_from_local)
        )
        self.mask["light_from_local"].write(f32(axes))
        self.mask["window"].write(
            f32(np.ravel(np.column_stack([-corners, np.ones(4)]) / sides[:, None]))
        )
        self.mask["texel_size"].write(f32(texels))
        self.mask["depth_range"].write(f32([low, high]))
        self.mask["eye"].write(f32(camera.eye - self.origin))
        self.target.clear(1.0, 1.0, 1.0, 1.0, depth=1.0)
        self.target.use()
        self.receivers.render()

    def release(self):
        """Destroy the context and all that is in it."""
        self.context.release()
