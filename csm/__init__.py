"""Cascaded shadow maps as numbers: masks, maps and matrices in numpy, judged against the truth."""

from importlib import metadata as _metadata

from . import measures, plot, scenes
from .cascades import Cascades, bias_metres, fit_cascades
from .check_files import read_check, write_check
from .checks import CascadeCheck, CheckProblem, check_cascades
from .director import Director
from .errors import ContextError, CsmError, GLError, GLWarning, LimitError, ShaderError
from .export import Exported, export_settings
from .frame import Frame, Visibility
from .loading import load, load_elevation
from .metrics import ErrorReport, compare
from .motion import FlickerReport, flicker
from .plans import Plan, plan
from .recommendation import Recommendation, recommend
from .renderer import Renderer, backends
from .report_runs import sweep_techniques
from .reports import report
from .scene import Camera, Mesh, Scene, Sun
from .settings import ShadowSettings
from .splits import split_distances
from .sweeps import repeat_point, sweep
from .tracing import Truth, truth

__version__ = _metadata.version("cascaded-shadow-maps")

__all__ = [
    "Camera",
    "CascadeCheck",
    "Cascades",
    "CheckProblem",
    "ContextError",
    "CsmError",
    "Director",
    "ErrorReport",
    "Exported",
    "FlickerReport",
    "Frame",
    "GLError",
    "GLWarning",
    "LimitError",
    "Mesh",
    "Plan",
    "Recommendation",
    "Renderer",
    "Scene",
    "ShaderError",
    "ShadowSettings",
    "Sun",
    "Truth",
    "Visibility",
    "backends",
    "bias_metres",
    "check_cascades",
    "compare",
    "export_settings",
    "fit_cascades",
    "flicker",
    "load",
    "load_elevation",
    "measures",
    "plan",
    "plot",
    "read_check",
    "recommend",
    "repeat_point",
    "report",
    "scenes",
    "split_distances",
    "sweep",
    "sweep_techniques",
    "truth",
    "write_check",
]
