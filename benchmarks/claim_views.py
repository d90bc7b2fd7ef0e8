"""Views that claims are measured on, with what is traced and rendered of them kept."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import entries

import csm
from csm.timing import all_in_turns, quartiles, total_ms, warm_up_s

SIZE = (480, 270)  # where errors are judged
OUTPUTS = ("mask", "valid", "view_depth", "cascade_index")
ROUNDS = 7  # frames timed of each setting, in turns

# scene, camera, sun. Of the real scenes pairs with enough light and enough shadow.
MADE = (
    ("plane_and_box", "corner", "morning"),
    ("fence", "front", "across"),
    ("stairs", "side", "across"),
    ("town", "street", "afternoon"),
    ("town", "roofs", "evening"),
    ("forest", "path", "day"),
    ("forest", "canopy", "low"),
    ("long_road", "driver", "evening"),
)
REAL = (
    ("ms_shadow_columns", "top", "grazing"),
    ("ms_shadow_columns", "dueling", "dueling"),
    ("sponza_dabrovic", "nave", "noon"),
    ("sponza_dabrovic", "court", "shaft"),
    ("littlest_tokyo", "street", "morning"),
    ("littlest_tokyo", "above", "grazing"),
    ("denhaag_lod2", "street", "winter"),
    ("denhaag_lod2", "oblique", "winter"),
    ("bigtujunga_dem", "ridge", "dawn"),
    ("bigtujunga_dem", "map", "dawn"),
)
# More that look far from close by, for the claim about numbers of cascades.
FAR = (
    ("fence", "along", "across"),
    ("wires", "under", "noon"),
    ("town", "street", "evening"),
    ("long_road", "bridge", "side"),
    ("ms_shadow_columns", "aisle", "dueling"),
    ("ms_shadow_columns", "aisle", "grazing"),
)


@dataclass(frozen=True)
class View:
    """A scene from a camera under a sun."""

    scene_name: str
    name: str
    scene: csm.Scene
    camera: csm.Camera
    sun: csm.Sun

    def replace(self, suffix, **changes):
        """Copy with another camera or sun."""
        return replace(self, name=f"{self.name}, {suffix}" if suffix else self.name, **changes)

    def sized(self, size):
        """Copy with a picture of another size."""
        return self.replace("", camera=self.camera.replace(size=size))


class Bench:
    """A renderer, views, and the truths of what was asked for; for one run of the script.

    Parameters
    ----------
    renderer : Renderer
    folder : path or None
        Of the real scenes; None leaves them out.
    only : sequence of str
        Scenes to take; all if empty.
    size : (int, int)
    """

    def __init__(self, renderer, folder=None, only=(), size=SIZE):
        self.renderer, self.size = renderer, size
        self._folder, self._only = folder, only
        self._known = entries(folder) if folder else {}
        self._scenes, self._truths, self._measured = {}, {}, {}
        self.views = self.views_of((*MADE, *REAL))
        if not self.views:
            raise ValueError(f"no view is of a scene called {' or '.join(only)}")

    def views_of(self, names):
        """Views by (scene, camera, sun), without those of scenes that are absent or not wanted."""
        found = []
        for scene_name, camera, sun in names:
            if self._only and not any(one in scene_name for one in self._only):
                continue
            scene = self._scene(scene_name)
            if scene is not None:
                name = f"{scene_name} {camera} {sun}"
                view = View(scene_name, name, scene, scene.cameras[camera], scene.suns[sun])
                found.append(view.sized(self.size))
        return found

    def _scene(self, name):
        if name not in self._scenes:
            if name in csm.scenes.SCENES:
                self._scenes[name] = csm.scenes.SCENES[name]()
            elif name in self._known:
                self._scenes[name] = csm.load(Path(self._folder) / self._known[name]["file"])
            else:
                self._scenes[name] = None
        return self._scenes[name]

    def once(self, key, measure):
        """What a measure that several claims share gave, measured at the first call."""
        if key not in self._measured:
            self._measured[key] = measure(self)
        return self._measured[key]

    def render(self, view, settings, *, outputs=OUTPUTS, renderer=None):
        """Render a view as if it were the first."""
        renderer = renderer or self.renderer
        renderer.forget()
        return renderer.render(view.scene, view.camera, view.sun, settings, outputs=outputs)

    def truth(self, view, rays=1):
        """Ray-traced truth of a view, traced once."""
        key = (view.scene_name, view.camera, view.sun, rays)
        if key not in self._truths:
            self._truths[key] = csm.truth(view.scene, view.camera, view.sun, rays_per_pixel=rays)
        return self._truths[key]

    def report(self, view, settings, rays=1):
        """ErrorReport of a view under settings."""
        outputs = OUTPUTS if settings.blend == "none" else (*OUTPUTS, "mask_single")
        return csm.compare(self.render(view, settings, outputs=outputs), self.truth(view, rays))

    def error(self, view, settings, rays=1):
        """Mean absolute error of the mask, 0 to 1."""
        return self.report(view, settings, rays).mean["total"]

    def times(self, view, jobs, rounds=ROUNDS):
        """Times of settings, in turns.

        Parameters
        ----------
        view : View
        jobs : dict of str to (Renderer or None, ShadowSettings)
        rounds : int

        Returns
        -------
        times : dict of str to dict of str to [median, first quartile, third quartile]
            Milliseconds by pass and in total, by name of the job.
        """
        found = {}

        def frame_times(name):
            renderer, settings = jobs[name]
            return self.render(view, settings, outputs=("mask",), renderer=renderer).timings_ms

        warm_up = warm_up_s(self.renderer.info)
        timed = all_in_turns(list(jobs), frame_times, repeats=rounds, warm_up=warm_up)
        for name, samples in timed.items():
            found[name] = {key: quartiles([one[key] for one in samples]) for key in samples[0]}
            found[name]["total"] = quartiles([total_ms(one) for one in samples])
        return found


def nearest_depth(bench, view):
    """View depth [m] that a hundredth of the receivers that face the sun are nearer than."""
    truth = bench.truth(view)
    seen = truth.valid & truth.facing
    depth = (truth.position[seen] - view.camera.eye) @ -view.camera.backward
    return float(np.percentile(depth, 1))


def at_angle(view, degrees):
    """Copy whose light travels at this angle to the view, from behind and above the camera."""
    camera, angle = view.camera, np.radians(degrees)
    to_light = np.cos(angle) * camera.backward + np.sin(angle) * camera.up
    return view.replace(f"light {degrees:g} degrees from the view", sun=csm.Sun(to_light))
