"""Builds csm._core; pyproject.toml holds everything static. Switches are environment variables:
CSM_SANITIZE=1 adds address and undefined-behaviour sanitizers, CSM_WERROR=1 fails on warnings.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

# In the order of the data, from values to pictures to Python.
CORE = (
    "status filters effects cutouts scene hull splits splits_resolution splits_histogram"
    " frustum view_range light_basis receivers spheres clipped fits snap depth_range warp"
    " cascades cull reuse light_window tetrahedra coverage_slices coverage coverage_move"
    " coarse_outline coarse_outline_blocks coarse_picture coarse_planes coarse_edges"
    " coarse_maps coarse_thin coarse_numbers arranged forecast_sums caster_boxes"
    " caster_sample storage bias plan shader_source"
)
GL = (
    "debug context context_saved context_egl context_osmesa context_glfw program target mesh timer"
    " uniforms kept_maps pass_view pass_receivers pass_shadow_map pass_shadow_filter"
    " pass_shadow_mask pass_shadow_forward renderer visibility"
)
PY = (
    "errors arrays scene_arguments core_functions coverage_functions coarse_functions"
    " coarse_look_functions coarse_map_functions coarse_number_functions caster_functions"
    " arrange_functions forecast_sum_functions settings_functions"
    " renderer_type module"
)
FOLDERS = {"core": CORE, "gl": GL, "py": PY}
SOURCES = [f"csrc/{folder}/{name}.c" for folder, names in FOLDERS.items() for name in names.split()]
HEADERS = sorted(str(p) for p in Path("csrc").rglob("*") if p.suffix in (".h", ".def"))

# Snapping depends on rounding: no -ffast-math, and no contraction so that all machines agree. What
# nobody reads, errno of sqrt and floating point traps, must not keep loops from being vectorised;
# nor must flags that an interpreter was built with: -O2 (3 times as long, where it counts), and
# -fwrapv, under which an int that counts a loop may wrap round (twice as long).
FLAGS = "-std=c11 -Wall -Wextra -Wshadow -Wvla -fvisibility=hidden".split()
FLAGS += [] if "-O" in os.environ.get("CFLAGS", "") else ["-O3"]
FLAGS += "-ffp-contract=off -fno-math-errno -fno-trapping-math -fno-wrapv".split()
SANITIZE = "-fsanitize=address,undefined -fno-omit-frame-pointer -g".split()
FLAGS += ["-Werror"] if os.environ.get("CSM_WERROR") == "1" else []
SANITIZERS = SANITIZE if os.environ.get("CSM_SANITIZE") == "1" else []
GLAD = Path("build/glad")


class BuildWithLoader(build_ext):
    """Generates the OpenGL loader first: one struct of pointers per context, no globals."""

    def build_extension(self, ext):
        loader = GLAD / "src/gl.c"
        if not loader.exists() or loader.stat().st_mtime < Path("setup.py").stat().st_mtime:
            command = "-m glad --quiet --reproducible --api=gl:core=4.5".split()
            command += ["--extensions=GL_ARB_shader_draw_parameters", f"--out-path={GLAD}"]
            subprocess.run([sys.executable, *command, "c", "--mx"], check=True)
        ext.sources.append(str(loader))
        super().build_extension(ext)


setup(
    ext_modules=[
        Extension(
            "csm._core",
            SOURCES,
            include_dirs=["csrc", numpy.get_include(), str(GLAD / "include")],
            define_macros=[("_POSIX_C_SOURCE", "200809L")],
            depends=["setup.py", *HEADERS],
            extra_compile_args=FLAGS + SANITIZERS,
            extra_link_args=SANITIZERS,
            libraries=["dl", "m", "pthread"],
        )
    ],
    cmdclass={"build_ext": BuildWithLoader},
)
