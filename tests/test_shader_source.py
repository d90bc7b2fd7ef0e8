"""Shader text: includes, error lines that name file and line, programs forgotten by reload."""

import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

import csm
from csm import _core

SHADERS = Path(__file__).resolve().parents[1] / "shaders"
MASK = "shadow_mask.comp"


@pytest.fixture
def folder(tmp_path):
    """A copy of the shaders that a test may break."""
    return Path(shutil.copytree(SHADERS, tmp_path / "shaders", ignore=lambda *_: ["__pycache__"]))


@pytest.fixture(scope="module")
def view():
    scene = csm.scenes.plane_and_box()
    camera = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=100, size=(32, 18))
    return scene, camera, scene.suns["morning"], csm.ShadowSettings(map_size=64, cascade_count=1)


def edit(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def line_of(path, text):
    """Number of the first line that holds a text."""
    lines = path.read_text().splitlines()
    return next(number for number, line in enumerate(lines, 1) if text in line)


def failing(renderer, view, **more):
    with pytest.raises(csm.ShaderError) as caught:
        renderer.render(*view, **more)
    return caught.value


def append(path, text):
    with path.open("a") as file:
        file.write(text)


# -- includes --------------------------------------------------------------------------------------


def test_a_file_is_included_once(fresh_renderer, folder, view):
    # twice directly and once through another file; a second body would be a redefinition
    (folder / "include/twice.glsl").write_text("float twice(float x) { return 2.0 * x; }\n")
    (folder / "include/other.glsl").write_text('#include "include/twice.glsl"\n')
    includes = '#include "include/twice.glsl"\n#include "include/other.glsl"\n'
    includes += '#include "include/twice.glsl"\n'
    mask = folder / MASK
    mask.write_text(includes + mask.read_text())
    edit(mask, "void main()\n{", "void main()\n{\n    float four = twice(2.0);")
    own, packaged = fresh_renderer(shader_dir=folder), fresh_renderer()
    first, second = (renderer.render(*view, outputs=("mask",)) for renderer in (own, packaged))
    assert np.array_equal(first.mask, second.mask)
    assert 0 < first.mask.mean() < 1


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_cycle_is_named(fresh_renderer, folder, view, length):
    for i in range(length):
        (folder / f"include/ring_{i}.glsl").write_text(
            f'// ring\n#include "include/ring_{(i + 1) % length}.glsl"\n'
        )
    append(folder / MASK, '#include "include/ring_0.glsl"\n')
    error = failing(fresh_renderer(shader_dir=folder), view)
    last = f"include/ring_{length - 1}.glsl"
    assert f"{last}:2: include/ring_0.glsl includes itself" in str(error)
    assert error.pass_name == "shadow_mask"


def test_a_missing_include_names_where_it_is_wanted(fresh_renderer, folder, view):
    append(folder / "include/geometry.glsl", '#include "include/nowhere.glsl"\n')
    number = len((folder / "include/geometry.glsl").read_text().splitlines())
    error = failing(fresh_renderer(shader_dir=folder), view)
    assert f"include/geometry.glsl:{number}: no shader file include/nowhere.glsl" in str(error)
    assert error.pass_name == "view"
    assert error.log.startswith("include/geometry.glsl")
    assert "#define CSM_FILTER 0" in error.defines


@pytest.mark.parametrize(
    ("missing", "pass_name"),
    [
        ("view.vert", "view"),
        ("view.frag", "view"),
        ("shadow_map.vert", "shadow_map"),
        (MASK, "shadow_mask"),
        ("shadow_points.comp", "shadow_points"),
    ],
)
def test_a_missing_pass_is_named(fresh_renderer, folder, view, missing, pass_name):
    (folder / missing).unlink()
    renderer = fresh_renderer(shader_dir=folder)
    error = failing(renderer, view, points=[(0, 0, 0)])
    assert f"no shader file {missing}" in str(error)
    assert error.pass_name == pass_name


def test_a_folder_in_the_place_of_a_shader_is_no_shader(fresh_renderer, folder, view):
    (folder / MASK).unlink()
    (folder / MASK).mkdir()
    assert f"no shader file {MASK}" in str(failing(fresh_renderer(shader_dir=folder), view))


def test_includes_without_end_stop(fresh_renderer, folder, view):
    for i in range(40):
        (folder / f"include/deep_{i}.glsl").write_text(f'#include "include/deep_{i + 1}.glsl"\n')
    append(folder / MASK, '#include "include/deep_0.glsl"\n')
    error = failing(fresh_renderer(shader_dir=folder), view)
    assert re.search(r"include/deep_\d+\.glsl:1: includes are nested deeper than \d+", str(error))


# -- errors of the driver --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "pass_name"),
    [
        ("view.vert", "view"),
        ("view.frag", "view"),
        ("shadow_map.vert", "shadow_map"),
        (MASK, "shadow_mask"),
        ("shadow_points.comp", "shadow_points"),
        ("include/geometry.glsl", "view"),
        ("include/visibility.glsl", "shadow_mask"),
        ("include/filter_hard.glsl", "shadow_mask"),
    ],
)
def test_an_error_names_file_and_line(fresh_renderer, folder, view, file, pass_name):
    path = folder / file
    last = len(path.read_text().splitlines())
    append(path, "\nfloat broken = undeclared_name;\n// and on it goes\n")
    error = failing(fresh_renderer(shader_dir=folder), view, points=[(0, 0, 0)])
    assert f"{file}:{last + 2}: " in str(error)
    assert "undeclared_name" in error.log
    assert str(error) == f"{pass_name}: {error.log}"
    assert error.pass_name == pass_name


def test_lines_after_an_include_are_counted_in_their_own_file(fresh_renderer, folder, view):
    path = folder / MASK
    edit(path, "void main()\n{", "void main()\n{\n    int bad = vec3(1.0);")
    error = failing(fresh_renderer(shader_dir=folder), view)
    assert f"{MASK}:{line_of(path, 'int bad')}: " in str(error)


def test_several_errors_come_each_with_its_place(fresh_renderer, folder, view):
    append(folder / MASK, "float first = nothing_1;\n")
    append(folder / "include/receiver.glsl", "float second = nothing_2;\n")
    text = str(failing(fresh_renderer(shader_dir=folder), view))
    for file, name in ((MASK, "nothing_1"), ("include/receiver.glsl", "nothing_2")):
        number = line_of(folder / file, name)
        assert re.search(rf"{re.escape(file)}:{number}: [^\n]*{name}", text), text


def test_what_does_not_link_is_a_shader_error_of_its_pass(fresh_renderer, folder, view):
    append(folder / "shadow_map.vert", "void missing_body();\n")
    edit(folder / "shadow_map.vert", "void main()\n{", "void main()\n{\n    missing_body();")
    error = failing(fresh_renderer(shader_dir=folder), view)
    assert error.pass_name == "shadow_map"
    assert "does not link" in str(error) or "missing_body" in str(error)


def test_a_log_that_is_no_utf8_hides_no_error(fresh_renderer, folder, view):
    path = folder / MASK
    path.write_bytes(path.read_bytes() + b"// caf\xe9\n#error \xe9\xff broken\n")
    error = failing(fresh_renderer(shader_dir=folder), view)
    assert error.pass_name == "shadow_mask"
    assert "broken" in error.log


def test_a_warning_of_the_compiler_fails_a_debug_renderer_and_names_its_line(
    fresh_renderer, folder, view
):
    # Mesa reports warnings of the shader compiler with high severity; other drivers need not. It
    # keeps what it compiled on disk and warns once for a text: this one is new in every run.
    path = folder / MASK
    never = f"never_{time.time_ns()}"
    edit(path, "void main()\n{", f"void main()\n{{\n    float {never};\n    float copy = {never};")
    renderer = fresh_renderer(shader_dir=folder)
    if "llvmpipe" not in renderer.info["renderer"]:
        pytest.skip("only Mesa is known to warn of uninitialised variables")
    place = f"{MASK}:{line_of(path, 'copy = never')}"
    with pytest.raises(csm.GLError, match=rf"{place}: .*{never}"):
        renderer.render(*view)
    renderer.render(*view)


def test_defines_of_an_error_are_those_of_its_pass(fresh_renderer, folder, view):
    append(folder / MASK, "#error stop\n")
    settings = view[3].replace(filter="pcf", filter_size=5)
    error = failing(fresh_renderer(shader_dir=folder), (*view[:3], settings), outputs=("mask",))
    defines = dict(re.findall(r"#define CSM_(\w+) (\d+)", error.defines))
    assert defines["FILTER"] == defines["FILTER_PCF"]
    assert defines["INSTANCES"] == "0"
    assert (defines["KERNEL_SIZE"], defines["OUT_MASK"], defines["OUT_VALID"]) == ("5", "1", "0")


def test_defines_tell_of_instances(fresh_renderer, folder, view):
    append(folder / "view.vert", "#error stop\n")
    twice = csm.Scene.merge(view[0], view[0].placed((5, 0, 0)))
    error = failing(fresh_renderer(shader_dir=folder), (twice, *view[1:]))
    assert "#define CSM_INSTANCES 1" in error.defines


# -- after an error --------------------------------------------------------------------------------


def test_reload_reads_a_mended_file(fresh_renderer, folder, view):
    expected = fresh_renderer().render(*view).mask
    path = folder / "include/filter_hard.glsl"
    good = path.read_text()
    append(path, "not a shader;\n")
    renderer = fresh_renderer(shader_dir=folder)
    for _ in range(2):  # a failure is not cached as a success
        failing(renderer, view)
    path.write_text(good)
    assert np.array_equal(renderer.render(*view).mask, expected)

    edit(path, "? 1.0 : 0.0", "? 0.0 : 1.0")
    assert np.array_equal(renderer.render(*view).mask, expected), "cached until reload"
    renderer.reload()
    changed = renderer.render(*view)
    assert changed.info["programs_compiled"] == 3
    assert not np.array_equal(changed.mask, expected)


def test_a_broken_pass_fails_only_the_frames_that_need_it(fresh_renderer, folder, view):
    append(folder / "shadow_points.comp", "#error no points\n")
    renderer = fresh_renderer(shader_dir=folder)
    expected = renderer.render(*view).mask
    live = renderer.info["live_objects"]
    assert failing(renderer, view, points=[(0, 0, 0)]).pass_name == "shadow_points"
    assert renderer.info["live_objects"] == live
    assert np.array_equal(renderer.render(*view).mask, expected)


# -- words -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.name)
        for path in sorted(SHADERS.rglob("*"))
        if path.suffix in (".vert", ".frag", ".comp", ".glsl")
    ],
)
def test_every_csm_word_of_a_shader_is_defined_for_its_pass(path):
    # Mesa takes an undefined name in #if as 0 without a word
    text = re.sub(r"//[^\n]*", "", path.read_text())
    for name in ("view", "shadow_map", "shadow_mask", "shadow_forward", "shadow_points"):
        defines = _core.program_defines(name, csm.ShadowSettings(), _core.OUTPUTS["mask"])
        unknown = set(re.findall(r"\bCSM_\w+", text)) - set(re.findall(r"\bCSM_\w+", defines))
        assert not unknown


# -- what C and GLSL both write down ---------------------------------------------------------------

WORDS = {"vec4": 1, "ivec4": 1, "mat4": 4}  # in units of 16 bytes; std140 pads none of them


def block_of_the_shader(block):
    """(name, 16-byte words) of every member of a uniform block, in order."""
    text = (SHADERS / f"include/{block}.glsl").read_text()
    body = re.search(rf"struct {block}_values\s*{{(.*?)}};", text, re.S)[1]
    body = re.sub(r"//[^\n]*", "", body)
    for kind, names in re.findall(r"(\w+)\s+([^;]+);", body):
        for name, count in re.findall(r"(\w+)(?:\[(\d+)\])?", names):
            yield name, WORDS[kind] * int(count or 1)


def struct_of_the_core(block):
    """The same of csm_frame_uniforms or csm_warp_uniforms."""
    text = (SHADERS.parent / "csrc/gl/gl_internal.h").read_text()
    body = re.search(rf"typedef struct csm_{block}_uniforms {{(.*?)}}", text, re.S)[1]
    body = re.sub(r"/\*.*?\*/", "", body, flags=re.S)
    sizes = {"CSM_MAX_CASCADES": _core.MAX_CASCADES}
    for names in re.findall(r"(?:float|int32_t)\s+([^;]+);", body):
        for name, sides in re.findall(r"(\w+)((?:\[\w+\])+)", re.sub(r"\s+\[", "[", names)):
            counts = [sizes.get(n) or int(n) for n in re.findall(r"\w+", sides)]
            assert counts[-1] == 4, f"{name} is no vec4"
            yield name, int(np.prod(counts)) // 4


@pytest.mark.parametrize("block", ["frame", "warp"])
def test_uniform_block_and_struct_have_the_same_members_at_the_same_offsets(block):
    # sizes and order give the offsets, as std140 pads no member that fills whole vec4s; that the
    # struct has no padding either is a _Static_assert
    members = list(block_of_the_shader(block))
    assert len(members) > 4
    assert members == list(struct_of_the_core(block))
