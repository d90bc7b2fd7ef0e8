"""The dependency rules of docs/architecture.md, read from the sources: no import, no build."""

import ast
import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CSRC = ROOT / "csrc"
SHADERS = ROOT / "shaders"
PACKAGE = ROOT / "csm"


def without_comments(text):
    """C or GLSL with comments and the contents of strings blanked, line numbers kept."""

    def blank(match):
        kept = "\n" * match[0].count("\n")
        return f'""{kept}' if match[0].startswith('"') else f" {kept}"

    return re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', blank, text, flags=re.DOTALL)


def includes(path):
    return re.findall(r'^\s*#\s*include\s*([<"][^>"]+)[>"]', path.read_text(), flags=re.MULTILINE)


def relative(paths):
    return [pytest.param(path, id=str(path.relative_to(ROOT))) for path in sorted(paths)]


# ---------------------------------------------------------------------------------------------- C

LIBC = {
    "assert.h", "ctype.h", "float.h", "inttypes.h", "limits.h", "math.h", "stdarg.h", "stdbool.h",
    "stddef.h", "stdint.h", "stdio.h", "stdlib.h", "string.h",
}  # fmt: skip
SYSTEM = LIBC | {
    "dirent.h", "dlfcn.h", "errno.h", "link.h", "pthread.h", "stdatomic.h", "sys/types.h", "time.h",
    "unistd.h",
}  # fmt: skip

# folder: system headers, other prefixes, words that must not occur
C_RULES = {
    "core": (
        LIBC,
        (),
        r"\b(gl[A-Z]\w*|GL_\w+|Py\w+|npy_\w+|fopen|printf|exit|errno|getenv|puts)\b",
    ),
    "gl": (SYSTEM, ("glad/",), r"\b(Py[A-Z_]\w*|npy_\w+|NPY_\w+|fopen|printf|exit|puts)\b"),
    "py": (
        SYSTEM,
        ("Python.h", "structmember.h", "numpy/"),
        r"\b(gl[A-Z]\w*|GL_\w+|Glad\w+|printf|exit|puts)\b",
    ),
}

C_FILES = [path for path in CSRC.rglob("*.[ch]") if path.parent != CSRC]


@pytest.mark.parametrize("path", relative(C_FILES))
def test_c_folder_includes_only_what_its_layer_may_use(path):
    system, prefixes, _ = C_RULES[path.parent.name]
    for name in includes(path):
        if name.startswith('"'):
            own = path.parent / name[1:]
            assert name[1:] in ("csm.h", "csm_effects.def") or (
                own.exists() and "/" not in name[1:]
            ), f'{path.name} includes {name[1:]!r}: only "csm.h" and headers of its own folder'
        else:
            assert name[1:] in system or name[1:].startswith(prefixes), (
                f"{path.name} includes <{name[1:]}>, which csrc/{path.parent.name} may not use"
            )


@pytest.mark.parametrize("path", relative(C_FILES))
def test_c_folder_names_nothing_of_another_layer(path):
    *_, forbidden = C_RULES[path.parent.name]
    for number, line in enumerate(without_comments(path.read_text()).splitlines(), 1):
        if not re.match(r"\s*#\s*include", line):
            found = re.search(forbidden, line)
            assert not found, f"{path.name}:{number} uses {found[0]}"


@pytest.mark.parametrize("path", relative(CSRC.glob("core/*.[ch]")))
def test_core_keeps_no_mutable_state(path):
    # A variable at file scope, or a static one in a function, that is not const.
    text = without_comments(path.read_text())
    found = re.search(
        r"^[ \t]*static\s+(?!const\b|inline\b|_Thread_local\b)[^;{}()]*(=|;)", text, re.MULTILINE
    )
    assert not found, f"{path.name}: {found[0].strip()!r}"


@pytest.mark.parametrize("path", relative(CSRC.glob("py/*.[ch]")))
def test_glue_leaves_no_block_without_the_gil(path):
    inside = 0
    for number, line in enumerate(without_comments(path.read_text()).splitlines(), 1):
        inside += line.count("Py_BEGIN_ALLOW_THREADS")
        inside -= line.count("Py_END_ALLOW_THREADS")
        assert inside in (0, 1), f"{path.name}:{number}: unbalanced ALLOW_THREADS"
        found = re.search(r"\b(return|goto|PyErr_\w+|PyObject_\w+|Py_(?:X?(?:IN|DE)CREF))\b", line)
        assert not (inside and found), f"{path.name}:{number}: {found[0]} without the GIL"
    assert not inside


@pytest.mark.parametrize("path", relative(CSRC.glob("py/*.[ch]")))
def test_glue_keeps_python_objects_in_module_state(path):
    text = without_comments(path.read_text())
    found = re.search(r"^[ \t]*static\s+Py\w*Object\s*\*+\s*\w+\s*(=|;|\[)", text, re.MULTILINE)
    assert not found, f"{path.name}: {found[0].strip()!r} outlives its interpreter"


def test_setup_builds_every_c_file_once(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    listed = runpy.run_path("setup.py")["SOURCES"]
    assert len(listed) == len(set(listed))
    assert set(listed) == {str(path.relative_to(ROOT)) for path in CSRC.rglob("*.c")}


# ---------------------------------------------------------------------------------------- shaders

SHADER_FILES = [p for p in SHADERS.rglob("*") if p.suffix in (".vert", ".frag", ".comp", ".glsl")]


def effect_macros():
    """Every CSM_ word that a shader may read: effects, their choices, the outputs of a pass."""
    table = (CSRC / "csm_effects.def").read_text()
    rows = re.findall(r'^CSM_EFFECT\((\w+),.*?"([^"]*)",\s*"[^"]*"\)', table, flags=re.MULTILINE)
    assert rows, "no row of csm_effects.def understood"
    words = {f"CSM_{name}" for name, _ in rows}
    words |= {f"CSM_{name}_{choice.upper()}" for name, all_ in rows for choice in all_.split()}
    return words | set(re.findall(r"\bCSM_OUT_\w+", (CSRC / "csm.h").read_text()))


@pytest.mark.parametrize("path", relative(SHADER_FILES))
def test_shader_includes_only_functions(path):
    names = [name[1:] for name in includes(path)]
    for name in names:
        assert re.fullmatch(r"include/\w+\.glsl", name), f"{path.name} includes {name!r}"
        assert (SHADERS / name).exists(), f"{path.name} includes {name!r}, which is not there"
    assert len(names) == len(set(names))


@pytest.mark.parametrize("path", relative(SHADER_FILES))
def test_shader_words_are_effects(path):
    # Mesa takes an undefined name in #if as 0 without a word, so a misspelt effect is never found.
    text = without_comments(path.read_text())
    unknown = set(re.findall(r"\bCSM_\w+", text)) - effect_macros()
    assert not unknown, f"{path.name}: {sorted(unknown)} not in csm_effects.def"
    assert not re.search(r"#\s*(ifdef|ifndef)|\bdefined\b", text), (
        f"{path.name}: effects are always defined: #if, not #ifdef"
    )


@pytest.mark.parametrize("path", relative(SHADERS.glob("include/filter_*.glsl")))
def test_filter_reads_only_its_own_effects(path):
    text = without_comments(path.read_text())
    assert "CSM_FILTER" not in re.sub(r"\bCSM_FILTER_(SIZE|WEIGHTS|FETCH)", "", text)


def test_two_shaders_choose_the_filter():
    choosing = {
        path.name for path in SHADER_FILES if re.search(r"#\s*(?:el)?if.*\bCSM_FILTER\b(?!_)",
                                                        without_comments(path.read_text()))
    }  # fmt: skip
    assert choosing <= {"visibility.glsl", "moments.glsl"}


# ----------------------------------------------------------------------------------------- Python

# Each module may import those before it, never one after it: the order of the data.
ORDER = [
    "errors", "tables", "tasks", "spaces", "camera", "sun", "cutouts", "mesh", "instances",
    "elevation", "scene",
    "shapes", "plants", "streets", "landscapes", "scenes", "gltf", "materials", "animation",
    "loading", "formats", "settings", "splits", "matrices", "cascades", "plans", "frame", "stages",
    "renderer", "embree", "disc", "tracing", "digests", "footprints", "sampling", "causes",
    "metrics", "measures", "motion", "checks", "check_files", "progress", "arguments", "timing",
    "truth_cache", "sweep_points", "sweep_cases", "sweep_journal", "sweep_worker", "sweep_runs",
    "sweep_tables", "sweep_provenance", "sweeps", "caster_load", "caster_sides", "coarse_look",
    "horizons", "signals", "arrangements", "forecasts", "costs", "map_shares",
    "situations", "flips", "decisions", "verification", "candidates", "search", "budgets",
    "conversions", "engine_windows", "engine_rows", "engines_web",
    "engines_desktop", "engines_native", "export", "record_rules", "records",
    "recommendation",
    "director_report", "director",
    "pictures", "outlines", "plot_style", "plot_windows", "plot_frames", "plot", "techniques",
    "hard_cases", "hard_case_page", "fronts", "report_pictures", "report_tables", "reports",
    "report_runs", "results", "pytest_plugin", "viewer", "sweep_command", "recommend_command",
    "report_command", "cli", "__main__",
]  # fmt: skip
JUDGES = {
    "embree", "disc", "tracing", "footprints", "sampling", "causes", "metrics", "motion",
    "measures", "checks", "check_files",
}  # fmt: skip
AT_IMPORT = {"pytest_plugin": {"pytest"}}  # loaded by pytest alone
LAZY = {
    "elevation": {"rasterio"},
    "loading": {"trimesh"},
    "materials": {"PIL"},
    "landscapes": {"matplotlib"},
    "embree": {"embreex"},
    "pictures": {"matplotlib", "PIL"},
    "plot_style": {"matplotlib"},
    "plot_windows": {"matplotlib", "mpl_toolkits"},
    "plot_frames": {"matplotlib"},
    "progress": {"rich"},
    "report_pictures": {"PIL"},
    "sweep_runs": {"distributed"},
    "sweep_tables": {"xarray"},
    "cli": {"rich"},
}
MODULES = [path for path in PACKAGE.glob("*.py") if path.stem != "__init__"]


def imports(path):
    """(name, whether it runs when the module is imported) of every import of a file."""
    tree = ast.parse(path.read_text())
    lazy = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, id(node) not in lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = f"csm.{base}".rstrip(".")
            names = [f"{base}.{a.name}" for a in node.names] if base == "csm" else [base]
            yield from ((name, id(node) not in lazy) for name in names)


@pytest.mark.parametrize("path", relative(MODULES))
def test_module_imports_only_upstream(path):
    assert path.stem in ORDER, f"say in ORDER where csm/{path.name} stands in the data flow"
    allowed = {"_core", "shaders", "__version__", *ORDER[: ORDER.index(path.stem)]}
    if path.stem in JUDGES:
        allowed -= {"renderer"} if path.stem == "checks" else {"renderer", "_core"}
    for name, _ in imports(path):
        first, _, rest = name.partition(".")
        if first == "csm":
            module = rest.partition(".")[0]
            assert module in allowed, f"csm/{path.name} imports csm.{module}, downstream of it"


@pytest.mark.parametrize("path", relative(PACKAGE.glob("*.py")))
def test_module_needs_numpy_alone_when_imported(path):
    for name, at_import in imports(path):
        first = name.partition(".")[0]
        if first not in sys.stdlib_module_names and first not in ("csm", "numpy"):
            if first in AT_IMPORT.get(path.stem, ()):
                continue
            assert not at_import, f"csm/{path.name} imports {first} at module level"
            assert first in LAZY.get(path.stem, ()), f"csm/{path.name} has no business with {first}"


def test_package_init_is_names_alone():
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    kinds = {type(node) for node in tree.body}
    assert not kinds & {ast.FunctionDef, ast.ClassDef, ast.For, ast.While}


def test_no_public_name_is_a_module():
    # `from .splits import splits` would rebind the attribute csm.splits.
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    names = {
        a.asname or a.name for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names
    }
    relative_modules = {
        a.name
        for n in tree.body
        if isinstance(n, ast.ImportFrom) and n.level and not n.module
        for a in n.names
    }
    assert not (names - relative_modules) & {path.stem for path in MODULES}


@pytest.mark.parametrize("path", relative((ROOT / "benchmarks").glob("*.py")))
def test_benchmark_uses_the_public_api(path):
    private = {name for name, _ in imports(path) if name.startswith("csm._")}
    assert not private, f"benchmarks/{path.name} imports {sorted(private)}"
