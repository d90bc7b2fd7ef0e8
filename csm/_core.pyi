"""Typed signatures of the C extension, csrc/py; csm.h says what each function guarantees.

Private: csm's own modules check and convert before they call it. ``camera`` and ``settings`` are
read by attribute, so anything with the fields of `csm.Camera` and `csm.ShadowSettings` will do.
Bounds are (2, 3) or (6,): min, max [m].
"""

from collections.abc import Sequence
from typing import Any, Literal, NotRequired, Protocol, TypedDict, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Split = Literal[0, 1, 2]  # practical, uniform, logarithmic
_Snap = Literal[0, 1]  # exact, none
_Warping = Literal[1, 2, 3]  # lispsm, psm, tsm
_Mesh = (
    tuple[ArrayLike, ArrayLike]  # positions, triangles
    | tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]  # and uv, texels that are there
)
_PassName = Literal[
    "view",
    "shadow_map",
    "shadow_moments",
    "shadow_blur",
    "shadow_sum",
    "shadow_mips",
    "shadow_mask",
    "shadow_points",
]

class _Camera(Protocol):
    @property
    def eye(self) -> ArrayLike: ...
    @property
    def right(self) -> ArrayLike: ...
    @property
    def up(self) -> ArrayLike: ...
    @property
    def backward(self) -> ArrayLike: ...
    @property
    def half_width(self) -> float: ...
    @property
    def half_height(self) -> float: ...
    @property
    def centre_x(self) -> float: ...
    @property
    def centre_y(self) -> float: ...
    @property
    def near(self) -> float: ...
    @property
    def far(self) -> float: ...
    @property
    def size(self) -> ArrayLike: ...
    @property
    def orthographic(self) -> bool: ...

class _Effect(TypedDict):
    id: str
    name: str  # "" where it is derived from other settings
    type: Literal["bool", "int", "enum"]
    default: bool | int | str
    min: int
    max: int
    passes: int  # bits: shadow_map 1, view 2, shadow_mask 4, CPU 8, shadow_forward 16,
    # receivers 32, shadow_moments 64, shadow_blur 128, shadow_sum 256
    choices: str
    help: str

class _Number(TypedDict):
    name: str
    default: float
    min: float
    max: float
    help: str

class _Cascades(TypedDict):
    splits: NDArray[np.float64]  # (n + 1,) [m]
    light_from_world: NDArray[np.float64]  # (n, 4, 4), as all matrices
    clip_from_light: NDArray[np.float64]
    clip_from_world: NDArray[np.float64]
    uvz_from_world: NDArray[np.float64]
    texel_size: NDArray[np.float64]  # (n, 2) [m]
    lattice: NDArray[np.int64]  # (n, 2)
    depth_range: NDArray[np.float64]  # (n, 2) [m]
    map_size: NDArray[np.intc]  # (n,)
    range_step: int | None
    hold: bytes  # what a later fit takes as held
    pancake: bool

_Worst = tuple[float, tuple[float, float, float]]  # amount, world point

class _Coverage(TypedDict):
    overflow: _Worst  # [texels]
    before: _Worst  # [m]
    behind: _Worst
    caster: _Worst
    gap_texels: float
    gap_share: float
    gap_points: NDArray[np.float64]  # (k, 3)
    tolerance_texels: float
    tolerance_depth: float  # [m]
    utilisation: float
    overlap: NDArray[np.float64]  # (n,)
    texels_per_pixel: tuple[float, float]
    to_light: tuple[float, float, float]
    mirrored: bool
    texel_size: tuple[float, float]
    depth_span: float
    receiver_count: int

class _GridMove(TypedDict):
    texel_size: tuple[tuple[float, float], tuple[float, float]]
    texels: float
    depth: float
    depth_quanta: tuple[float, float, float]
    rounding_texels: float
    rounding_depth: float

_CoarsePicture = tuple[_Camera, ArrayLike, ArrayLike]  # view_depth, facing
_CoarseMaps = tuple[
    Sequence[ArrayLike],  # depths
    ArrayLike,  # uvz_from_world
    ArrayLike,  # texel_size
    ArrayLike,  # depth_range
]

class _CoarseEdges(TypedDict):
    rows: NDArray[np.int64]  # (e,)
    columns: NDArray[np.int64]
    point: NDArray[np.float64]  # (e, 3)
    normal: NDArray[np.float64]
    across: NDArray[np.float64]  # (e, 2)
    length: NDArray[np.float64]  # (e,)

class _Warp(TypedDict):
    light_from_world: NDArray[np.float64]  # (4, 4)
    origin: NDArray[np.float64]  # (2,) of the local coordinates, from the eye [m]
    extent: NDArray[np.float64]  # (2,) [m]
    strength: float
    clip_from_local: NDArray[np.float64]  # (4, 4)

class _RendererInfo(TypedDict):
    backend: str
    platform: str
    vendor: str
    renderer: str
    version: str
    glsl: str
    software: bool
    stage: str
    max_texture_size: int
    max_cube_size: int
    max_layers: int
    max_samples: int
    max_buffer_bytes: int
    programs_compiled: int
    live_objects: int

class _Lists(TypedDict):
    timings_ms: dict[str, float]
    chunks_drawn: list[int]
    triangles_drawn: list[int]
    chunks_in_finer: list[int]
    # with reuse: action, shift along u and v, texels saved, triangles saved
    reuse: NotRequired[list[tuple[str, int, int, int, int]]]

class _Rendered(TypedDict):
    cascades: _Cascades
    lists: _Lists
    clock: str
    chunks: int
    chunks_viewed: int
    bytes: int
    scene_bytes: int
    programs_compiled: int

@final
class _GpuScene:  # a capsule: only `Renderer.upload` makes one
    ...

MAX_CASCADES: int
BACKENDS: list[str]
OUTPUTS: dict[str, int]  # bit of each output

class CsmError(RuntimeError): ...
class ContextError(CsmError): ...

class ShaderError(CsmError):
    pass_name: str
    log: str
    defines: str  # set by csm.Renderer.render

class LimitError(CsmError): ...
class GLError(CsmError): ...
class GLWarning(RuntimeWarning): ...

def split_distances(
    near: float, far: float, count: int, scheme: _Split, lam: float
) -> NDArray[np.float64]: ...
def range_round_up(
    near: float, depth: float, held_step: int | None = None
) -> tuple[float, int]: ...
def light_basis(to_light: ArrayLike) -> NDArray[np.float64]: ...
def camera_matrices(camera: _Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def frustum_corners(camera: _Camera, near: float, far: float) -> NDArray[np.float64]: ...
def frustum_planes(camera: _Camera, near: float, far: float) -> NDArray[np.float64]: ...
def fit_sphere(camera: _Camera, near: float, far: float) -> tuple[float, float]: ...
def fit_shifted(camera: _Camera, near: float, far: float) -> tuple[float, float, float, float]: ...
def fit_spheres(
    camera: _Camera, splits: ArrayLike, shifted: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def fit_diameter(camera: _Camera, near: float, far: float) -> float: ...
def frustum_depth_of_box(camera: _Camera, bounds: ArrayLike) -> float | None: ...
def snap_window(
    centre: ArrayLike, half_extent: ArrayLike, map_size: int, padding_texels: int, snap: _Snap
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]: ...
def snap_level(
    ratio: float, spacing: int, count: int, hysteresis: int = 0, held: int | None = None
) -> tuple[float, int]: ...
def sun_step(to_light: ArrayLike, step_deg: float) -> NDArray[np.float64]: ...
def make_warp(
    camera: _Camera,
    to_light: ArrayLike,
    near: float,
    far: float,
    warp: _Warping,
    map_size: int,
    padding_texels: int,
) -> _Warp: ...
def fit_cascades(
    camera: _Camera,
    to_light: ArrayLike,
    settings: Any,
    scene_bounds: ArrayLike | None = None,
    held: bytes | None = None,
    receivers: ArrayLike | None = None,
    boxes: ArrayLike | None = None,
) -> _Cascades: ...
def scene_boxes(
    meshes: tuple[_Mesh, ...],
    instance_mesh: ArrayLike,
    world_from_instance: ArrayLike,
    origin: ArrayLike,
    /,
) -> NDArray[np.float64]: ...
def cull_boxes(
    camera: _Camera,
    to_light: ArrayLike,
    settings: Any,
    scene_bounds: ArrayLike | None,
    boxes: ArrayLike,
    cascade: int,
    margin_texels: float = 0.0,
    whole_window: bool = False,
    border_texels: float | None = None,
) -> NDArray[np.uint32]: ...
def coverage(
    camera: _Camera,
    clip_from_world: ArrayLike,
    splits: ArrayLike,
    map_size: ArrayLike,
    first_map: bool,
    border_texels: float,
    tolerance_texels: float,
    scene_bounds: ArrayLike | None = None,
    receivers: ArrayLike | None = None,
) -> list[_Coverage]: ...
def coverage_move(
    camera: _Camera,
    near: float,
    far: float,
    before: ArrayLike,
    size_before: int,
    after: ArrayLike,
    size_after: int,
) -> _GridMove: ...
def coarse_outline(
    pictures: tuple[_CoarsePicture, ...], ends: Any, light_axes: ArrayLike
) -> NDArray[np.float64]: ...
def coarse_plane_ends(
    camera: _Camera,
    small: _Camera,
    view_depth: ArrayLike,
    valid: ArrayLike,
    facing: ArrayLike,
    bounds: ArrayLike,
) -> tuple[Any, tuple[int, int, int, int] | None]: ...
def coarse_end_points(ends: Any, /) -> NDArray[np.float64]: ...
def coarse_edges(
    camera: _Camera,
    view_depth: ArrayLike,
    normal: ArrayLike,
    judged: ArrayLike,
    lit: ArrayLike,
    shrink: float,
) -> _CoarseEdges: ...
def coarse_receivers(
    camera: _Camera,
    view_depth: ArrayLike,
    normal: ArrayLike,
    facing: ArrayLike,
    lit: ArrayLike,
    cascade_index: ArrayLike,
    to_light: ArrayLike,
    axes: ArrayLike,
    least_cosine: float,
) -> dict[str, NDArray[Any]]: ...
def coarse_facing(
    valid: ArrayLike, normal: ArrayLike, to_light: ArrayLike, least_cosine: float
) -> NDArray[np.bool_]: ...
def coarse_look(
    valid: ArrayLike,
    normal: ArrayLike,
    mask: ArrayLike,
    cascade_index: ArrayLike,
    to_light: ArrayLike,
    least_cosine: float,
    least_lit: float,
    cascade_count: int,
) -> tuple[
    NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_], int, int, int, tuple[int, ...]
]: ...
def coarse_changed(judged: ArrayLike, one: ArrayLike, other: ArrayLike) -> int: ...
def percentiles(values: ArrayLike, at: ArrayLike) -> NDArray[np.float64]: ...
def depth_histogram(depths: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]: ...
def surface_steps(
    camera: _Camera, points: ArrayLike, normals: ArrayLike, gradients: ArrayLike
) -> NDArray[np.float64]: ...
def casters_across(
    x: ArrayLike, y: ArrayLike, side: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def casters_thinned(
    casters: Any, uvz_from_world: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.float64]]: ...
def coarse_thin_share(maps: _CoarseMaps) -> float: ...
def coarse_layered_share(
    maps: _CoarseMaps, points: ArrayLike, cascade_index: ArrayLike
) -> float: ...
def coarse_gaps(
    maps: _CoarseMaps, points: ArrayLike, cascade_index: ArrayLike, dark: ArrayLike
) -> NDArray[np.float64]: ...
def coarse_blockers(
    maps: _CoarseMaps, points: ArrayLike, normals: ArrayLike, cascade_index: ArrayLike
) -> NDArray[np.float64]: ...
def arrange(
    view: Any,
    settings: Any,
    scene_bounds: ArrayLike | None,
    boxes: ArrayLike | None,
    most_moved: float,
    /,
) -> tuple[
    NDArray[np.float64],  # uvz_from_world
    NDArray[np.float64],  # splits
    NDArray[np.float64],  # sides
    list[float],  # displaced
    list[bool],  # held
]: ...
def arranged_points(
    view: Any,
    uvz_from_world: ArrayLike,
    splits: ArrayLike,
    sides: ArrayLike,
    by_interval: bool,
    bias_texels: float,
    steepest: float,
    /,
) -> tuple[
    NDArray[np.float64],  # moved
    NDArray[np.float64],  # reach
    NDArray[np.int32],  # edge_cascade
    NDArray[np.float64],  # receiver_bias
    NDArray[np.int32],  # receiver_cascade
]: ...
def sum_capped(
    window: ArrayLike, sides: ArrayLike, values: ArrayLike, weights: ArrayLike, most: float
) -> NDArray[np.float64] | float: ...
def sum_missing(
    window: ArrayLike, sides: ArrayLike, values: ArrayLike, wide: ArrayLike, weights: ArrayLike
) -> NDArray[np.float64] | float: ...
def count_less(
    window: ArrayLike, sides: ArrayLike, gaps: ArrayLike, values: ArrayLike
) -> NDArray[np.int64] | int: ...
def least_part(values: ArrayLike, wide: ArrayLike, weights: ArrayLike, allowed: float) -> float: ...
def casters_load(
    casters: Any, uvz_from_world: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def validate_settings(settings: Any, /) -> None: ...
def canonical_settings(settings: Any, /) -> dict[str, Any]: ...
def settings_draw_alike(one: Any, other: Any, /) -> bool: ...
def effect_table() -> list[_Effect]: ...
def number_table() -> list[_Number]: ...
def moment_numbers(settings: Any, /) -> int: ...
def storage_places(settings: Any, /) -> tuple[list[tuple[int, int, int, int]], tuple[int, int]]: ...
def bias_terms(settings: Any, /) -> tuple[bool, float, float, float, float, float]: ...
def bias_metres(
    settings: Any, clip_from_light: ArrayLike, map_size: ArrayLike, depth_range: ArrayLike, /
) -> list[dict[str, str | bool | float]]: ...
def plan(
    settings: Any,
    width: int,
    height: int,
    outputs: int,
    instanced: bool = False,
    alpha_tested: bool = False,
    /,
) -> tuple[
    list[tuple[_PassName, int, int]],  # pass, cascade or -1, program key
    # name, format, width, height, layers, samples, levels, bytes
    list[tuple[str, str, int, int, int, int, int, int]],
    list[tuple[_PassName, int]],  # pass, program key
    int,  # bytes in all
]: ...
def program_defines(
    pass_name: _PassName,
    settings: Any,
    outputs: int,
    instanced: bool = False,
    alpha_tested: bool = False,
    /,
) -> str: ...

@final
class Renderer:
    def __new__(cls, backend: int, debug: bool, shader_folder: str, stage: int = 0) -> Renderer: ...
    def close(self) -> None: ...
    def describe(self) -> _RendererInfo: ...
    def set_stage(self, stage: int, /) -> None: ...
    def reload(self) -> None: ...
    def messages(self) -> list[tuple[int, str, str]]: ...
    def upload(
        self,
        meshes: tuple[_Mesh, ...],
        instance_mesh: ArrayLike,
        world_from_instance: ArrayLike,
        origin: ArrayLike,
        /,
    ) -> _GpuScene: ...
    def drop(self, scene: _GpuScene, /) -> None: ...
    def render(
        self,
        scene: _GpuScene,
        camera: _Camera,
        to_light: ArrayLike,
        settings: Any,
        scene_bounds: ArrayLike | None,
        held: bytes | None,
        outputs: int,
        arrays: dict[str, NDArray[Any]],
        points: ArrayLike | None,
        point_normals: ArrayLike | None,
        angular_diameter: float,
        reuse: int = 0,
        timed: bool = True,
        /,
    ) -> _Rendered: ...
    def visibility(
        self,
        points: ArrayLike,
        normals: ArrayLike | None,
        mask: NDArray[np.float32],
        cascade_index: NDArray[np.uint8],
        blend_weight: NDArray[np.float32],
        /,
    ) -> None: ...
