"""Why a mask differs from the truth: visibilities at the stages between them (docs/numerics.md 15).

V0 is the truth at a pixel's point. V1 is exact visibility where the map's texel has its centre, on
the surface's tangent plane; V2 the mean of V1 over the texels that the filter averages, with its
weights. V3 is what the shadow map itself gave for the one cascade, V4 the mask. Neighbouring stages
differ by one cause each, so the causes add up.

Soft shadows (`pcss`) of a sun with a disc mean to average the disc, not texels, so they have no
stage of texels: V1 is V0 of the point sun; V2 is V3 within the true penumbra, where every error is
one of width or noise, and the soft truth where all of the disc is seen or none of it. Under a point
sun they are a hard compare and judged as one.
"""

from functools import cached_property
from itertools import product
from weakref import WeakKeyDictionary

import numpy as np

from .digests import digest
from .disc import SOFT_RAYS
from .footprints import half_widths, kernel_of, pixel_lots, taps_of
from .sampling import output_of, undersampling, visibilities
from .tracing import truth

__all__ = ["CAUSES", "Stages"]

# What each cause is the difference of, or what it is a part of.
CAUSES = (
    "total", "aliasing", "penumbra", "false_shadow", "peter_panning", "light_leak", "seam",
    "too_bright", "too_dark", "perspective_aliasing", "projection_aliasing", "phase_aliasing",
)  # fmt: skip

_SOFT = WeakKeyDictionary()  # soft masks of truths of point suns: a sweep asks for each often
# By truth what the last frames asked: techniques that differ in no window ask the same again.
_ASKED = WeakKeyDictionary()
KEPT = 6  # answers, of a number a pixel
FARTHEST_REACH = 4  # texels on each side whose occluders are asked for: 81 rays a pixel
NOISE = 1e-6  # of the factors of a texel's length: float32 positions turn normals by as much
FARTHEST_TEXELS = 1e6  # of a tangent plane nearly edge-on to the light: beyond, nothing is said


class Stages:
    """Exact visibilities of the judged pixels of a frame, traced when they are first asked for.

    Parameters
    ----------
    frame : Frame
        With `cascade_index`, `cascades` and `settings`.
    truth : Truth
    judged : (h, w) bool
    """

    def __init__(self, frame, truth, judged):
        self.frame, self.truth, self.judged = frame, truth, judged
        self.settings = frame.settings.canonical()

    @cached_property
    def _groups(self):
        """The judged pixels of each cascade: (cascade, flat indices)."""
        index = np.asarray(self.frame.cascade_index)
        every = [
            (i, np.flatnonzero(self.judged & (index == i)))
            for i in range(self.frame.cascades.count)
        ]
        return [(cascade, pixels) for cascade, pixels in every if len(pixels)]

    def _of(self, name, pixels):
        array = getattr(self.truth, name)
        return array.reshape(-1, *array.shape[2:])[pixels]

    def _spread(self, values_of):
        """(h, w) array of a function of (cascade, pixels); 0 where not judged."""
        spread = np.zeros(self.judged.size)
        for cascade, pixels in self._groups:
            spread[pixels] = values_of(cascade, pixels)
        return spread.reshape(self.judged.shape)

    @property
    def _averages_disc(self):
        """Whether the filter stands for the sun's disc, and there is one."""
        return self.settings.filter == "pcss" and self.truth.sun.angular_diameter_deg > 0.0

    @cached_property
    def at_texel_centres(self):
        """V1: (h, w) float64, 0 where not judged; of soft shadows the truth of the point sun."""
        if self._averages_disc:
            return np.where(self.judged, np.asarray(self.truth.mask_point, np.float64), 0.0)

        def values(cascade, pixels):
            surface = _Surface(self, cascade, pixels)
            return surface.visibility(np.floor(surface.texels) + 0.5)

        return self.shared("texel centres", lambda: self._spread(values))

    @cached_property
    def filtered(self):
        """V2: (h, w) float64, 0 where not judged.

        Of soft shadows V3 within the true penumbra and the soft truth elsewhere.
        """
        if self._averages_disc:
            soft = self._soft_truth()
            partly = (soft > 0.0) & (soft < 1.0)
            return np.where(self.judged, np.where(partly, self.single, soft), 0.0)
        if self.settings.filter in ("hard", "pcss"):
            return self.at_texel_centres
        kernel = kernel_of(self.settings)
        return self.shared("filtered", lambda: self._spread(self._filtered), kernel)

    def shared(self, name, make, *more):
        """Answer to a question that depends on the windows, the judged pixels and `more` alone.

        Parameters
        ----------
        name : str
        make : callable
            Returns it: a number, or an array that nobody changes.
        *more
            Values that `csm.digests.digest` takes.

        Returns
        -------
        answer : float or ndarray
            That of an earlier frame, if it was among the last.
        """
        asked = _ASKED.setdefault(self.truth, {})
        key = digest(name, self._windows, more)
        answer = asked.pop(key) if key in asked else make()
        asked[key] = answer
        while len(asked) > KEPT:
            del asked[next(iter(asked))]
        return answer

    @cached_property
    def _windows(self):
        """Digest of windows, of the pixels in each, and of which are judged."""
        cascades, camera = self.frame.cascades, self.frame.camera
        arrays = (
            cascades.uvz_from_world, cascades.map_size, cascades.texel_size,
            cascades.light_from_world, self.frame.cascade_index, self.judged,
        )  # fmt: skip
        return digest(*(np.asarray(array) for array in arrays), camera)

    @cached_property
    def single(self):
        """V3: (h, w) float64, what the shadow map gave for the one cascade."""
        name = "mask_single"
        if self.settings.blend == "none" and self.settings.fade_width == 0.0:
            name = "mask"
        return visibilities(f"frame.{name}", output_of(self.frame, name))

    def _soft_truth(self):
        exact = self.truth
        if exact.rays_per_pixel > 1:
            return np.asarray(exact.mask, np.float64)
        if exact not in _SOFT:
            soft = truth(exact.scene, exact.camera, exact.sun, rays_per_pixel=SOFT_RAYS)
            _SOFT[exact] = np.asarray(soft.mask, np.float64)
        return _SOFT[exact]

    def _filtered(self, cascade, pixels):
        surface = _Surface(self, cascade, pixels)
        whole = np.floor(surface.texels)
        taps = taps_of(
            self.settings,
            surface.texels - whole,
            self._half_widths(cascade, pixels),
            pixel_lots(self.judged.shape).ravel()[pixels],
        )
        reach = max(int(np.abs(offset).max()) for offset, _ in taps)
        seen = _Lattice(surface, whole.astype(np.int64), reach, taps, surface.visibility)
        mean = np.zeros(len(pixels))
        for offset, weight in taps:
            mean += weight * seen.at(offset)
        return mean

    def _half_widths(self, cascade, pixels):
        camera = self.truth.camera
        depth = (self._of("position", pixels) - camera.eye) @ -camera.backward
        return half_widths(self, cascade, depth)

    @property
    def cascades(self):
        """Those of the frame."""
        return self.frame.cascades

    @property
    def camera(self):
        """That of the frame."""
        return self.frame.camera

    def near_occluder(self, wanted):
        """Whether an occluder lies within the applied bias of a texel that the filter averages.

        Parameters
        ----------
        wanted : (h, w) bool
            Judged pixels to look at; the rest is False.

        Returns
        -------
        near : (h, w) bool
        """

        def values(cascade, pixels):
            pixels_wanted = np.flatnonzero(wanted.ravel()[pixels])
            near = np.zeros(len(pixels))
            chosen = pixels[pixels_wanted]
            if len(chosen):
                surface = _Surface(self, cascade, chosen)
                distance = surface.nearest_occluder(self._reach(cascade, chosen))
                near[pixels_wanted] = distance <= self._bias(surface, cascade, chosen)
            return near

        return self._spread(values) > 0.0

    def _reach(self, cascade, pixels):
        """Texels around the point's own whose occluders may be meant."""
        if self.settings.filter == "hard":
            return 0
        return min(int(np.ceil(self._half_widths(cascade, pixels).max())), FARTHEST_REACH)

    def _bias(self, surface, cascade, pixels):
        """Bias that was applied at each pixel, along the light [m]."""
        applied = self.frame.info["bias"][cascade]  # a whole depth quantum included
        sine = np.sqrt(np.maximum(1.0 - surface.cosine**2, 0.0))
        tangent = sine / surface.cosine
        return (
            applied["constant_m"]
            + applied["slope_m"] * surface.gradient_sum
            # moved along the normal, a point gains this much along the light over its own plane
            + applied["normal_offset_m"] * sine * (surface.cosine + sine * tangent)
        )

    @cached_property
    def own_surface(self):
        """Judged pixels whose own texel shows their own triangle: (h, w) bool."""

        def values(cascade, pixels):
            surface = _Surface(self, cascade, pixels)
            return surface.shows_itself(np.floor(surface.texels) + 0.5)

        return self._spread(values) > 0.0

    @cached_property
    def aliasing_shares(self):
        """Parts of the aliasing by perspective and by projection: two (h, w) float64.

        By logarithms, as the two factors multiply, each taken for 1 where it is less; both 0 where
        neither exceeds 1.
        """
        camera, index = self.frame.camera, np.asarray(self.frame.cascade_index)
        largest = self.frame.cascades.texel_size.max(axis=1)
        texel = np.append(largest, np.zeros(256 - len(largest)))[index]
        depth = 1.0
        if not camera.orthographic:
            depth = (self.truth.position - camera.eye) @ -camera.backward
        perspective = texel * camera.size[1] / (2.0 * camera.half_height * depth)
        whole = undersampling(self.frame, self.truth)
        with np.errstate(invalid="ignore", divide="ignore"):
            projection = whole / perspective
            logs = [np.log(np.fmax(m, 1.0)) for m in (perspective, projection)]
            both = logs[0] + logs[1]
            shares = [np.where(both > NOISE, one / both, 0.0) for one in logs]
        return [np.nan_to_num(share) for share in shares]


class _Lattice:
    """What rays say at the centres of texels around every point.

    Each is traced once for a plane: neighbours on one plane look at nearly the same texels.
    `value_of` takes places in the map [texels] and, for each, a point of its plane.
    """

    def __init__(self, surface, whole, reach, taps, value_of):
        plane, first = _planes(surface)
        low = whole.min(axis=0) - reach
        self._sides = whole.max(axis=0) + reach + 1 - low
        self._keys = (plane * self._sides[0] + whole[:, 0] - low[0]) * self._sides[1]
        self._keys += whole[:, 1] - low[1]
        self._keys, self._back = np.unique(self._keys, return_inverse=True)
        wanted = _distinct(np.concatenate([self._asked(*tap) for tap in taps]))
        rest, v = np.divmod(wanted, self._sides[1])
        of, u = np.divmod(rest, self._sides[0])
        self._wanted = wanted
        centres = np.column_stack([u, v]) + low + 0.5
        self._values = value_of(centres, first[of])

    def _steps(self, offset):
        return offset[:, 0] * self._sides[1] + offset[:, 1]

    def _asked(self, offset, weight):
        """Texels that a tap looks at; one offset for all points is asked for once a texel.

        Of other offsets only those that count.
        """
        steps = self._steps(offset)
        if (steps == steps[0]).all():
            return self._keys + steps[0]
        return _distinct((self._keys[self._back] + steps)[weight > 0.0])

    def at(self, offset):
        """(m,) at the texels (m, 2) from those that hold the points; anything where not asked."""
        steps = self._steps(offset)
        if (steps == steps[0]).all():
            return self._at(self._keys + steps[0])[self._back]
        return self._at(self._keys[self._back] + steps)

    def _at(self, keys):
        place = np.searchsorted(self._wanted, keys)
        return self._values[np.minimum(place, len(self._values) - 1)]


def _distinct(keys):
    """Sorted, each once: by sorting, which is several times faster here than numpy's hashing."""
    keys = np.sort(keys)
    return keys[np.concatenate([[True], keys[1:] != keys[:-1]])] if len(keys) else keys


def _planes(surface):
    """Number of each point's plane (m,), and a point of each plane."""
    offset = np.einsum("mk,mk->m", surface.normal, surface.point)
    scale = np.abs(surface.point).max(initial=1.0)
    rounded = np.column_stack([surface.normal * 1e9, offset / scale * 1e9]).round()
    _, first, plane = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    return plane.ravel().astype(np.int64), first


class _Surface:
    """Tangent planes of pixels, and the rays of one cascade's texels through them."""

    def __init__(self, stages, cascade, pixels):
        cascades, truth = stages.frame.cascades, stages.truth
        self.truth = truth
        self.size = int(cascades.map_size[cascade])
        self.point, self.normal = stages._of("position", pixels), stages._of("normal", pixels)
        uvz = np.asarray(cascades.uvz_from_world[cascade])
        placed = self.point @ uvz[:3, :3].T + uvz[:3, 3]
        w = self.point @ uvz[3, :3] + uvz[3, 3]
        self.texels = placed[:, :2] / w[:, None] * self.size
        self._world_from_uvz = np.linalg.inv(uvz)
        self.cosine = self.normal @ truth.sun.to_light
        light = np.asarray(cascades.light_from_world[cascade])[:3, :3]
        normal_ls = self.normal @ np.linalg.inv(light)
        self.gradient_sum = np.abs(normal_ls[:, :2] / normal_ls[:, 2:]).sum(axis=1)
        self.gradient_sum = np.minimum(self.gradient_sum, FARTHEST_TEXELS)

    def on_plane(self, texels, of=slice(None)):
        """World points of the tangent planes along the rays of texels (m, 2)."""
        uv = texels / self.size
        ends = []
        for z in (0.0, 1.0):
            uvz = np.column_stack([uv, np.full(len(uv), z), np.ones(len(uv))])
            moved = uvz @ self._world_from_uvz.T
            ends.append(moved[:, :3] / moved[:, 3:])
        ray = ends[1] - ends[0]
        slope = np.einsum("mk,mk->m", ray, self.normal[of])
        height = np.einsum("mk,mk->m", self.point[of] - ends[0], self.normal[of])
        return ends[0] + (height / slope)[:, None] * ray

    def visibility(self, texels, of=slice(None)):
        """Exact visibility of the tangent planes at texels."""
        return self.truth.trace(self.on_plane(texels, of), self.normal[of]).astype(np.float64)

    def shows_itself(self, texels):
        """Whether the light meets the pixel's own triangle first, at texels."""
        return self.truth.shows_itself(self.on_plane(texels), self.normal)

    def occluder_distance(self, texels, of=slice(None)):
        """Distance [m] from the tangent planes at texels to what first hides the sun there."""
        return self.truth.occluder_distances(self.on_plane(texels, of), self.normal[of])

    def nearest_occluder(self, reach):
        """Least distance to an occluder over the point and the texels within reach (m,) [m]."""
        nearest = self.truth.occluder_distances(self.point, self.normal)
        shape = (len(nearest), 2)
        steps = product(range(-reach, reach + 1), repeat=2)
        taps = [(np.broadcast_to(step, shape), None) for step in steps]
        whole = np.floor(self.texels).astype(np.int64)
        there = _Lattice(self, whole, reach, taps, self.occluder_distance)
        for offset, _ in taps:
            nearest = np.minimum(nearest, there.at(offset))
        return nearest
