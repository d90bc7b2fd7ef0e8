"""The package as others get it: what an import needs, a missing extra says, an sdist holds."""

import importlib.metadata
import importlib.util
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

import csm

ROOT = Path(__file__).resolve().parents[1]
OPTIONAL = (
    "trimesh",
    "embreex",
    "matplotlib",
    "PIL",
    "rich",
    "xarray",
    "dask",
    "rasterio",
    "scipy",
)

# Pretends that modules are not installed: None in sys.modules makes their import fail.
WITHOUT = "import sys\nfor name in {names!r}: sys.modules[name] = None\n"


def run_python(code, *, without=OPTIONAL, cwd=None):
    """stdout of a fresh interpreter in which modules are not installed."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT.format(names=without) + code],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def project():
    """The [project] table of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_import_needs_numpy_alone():
    code = "import csm\nprint(*{m.partition('.')[0] for m in sys.modules if sys.modules[m]})"
    loaded = set(run_python(code).split())
    beside = loaded - sys.stdlib_module_names - {"__main__", "csm", "numpy", "_distutils_hack"}
    assert not {name for name in beside if not name.startswith(("_", "sitecustomize"))}


def test_import_opens_no_gl_library():
    code = "import csm\nprint(open('/proc/self/maps').read())"
    opened = re.findall(r"lib(?:EGL|GL|OSMesa|glfw|gallium)[^/\s]*\.so\S*", run_python(code))
    assert not opened


def test_every_public_name_exists():
    assert len(csm.__all__) == len(set(csm.__all__))
    missing = [name for name in csm.__all__ if not hasattr(csm, name)]
    assert not missing


MISSING = {
    "mesh": ("trimesh", "open('a.obj', 'w').write('v 0 0 0'); csm.load('a.obj')"),
    "truth": (
        "embreex",
        "scene = csm.scenes.plane_and_box()\n"
        "csm.truth(scene, scene.cameras['corner'], scene.suns['diagonal'])",
    ),
    "plot": ("matplotlib", "csm.scenes.demo_terrain()"),
    "sweep": ("xarray", "csm.sweep({'a': ('stairs', None, None)}, {'map_size': [64]})"),
    "cluster": (
        "distributed",
        "csm.sweep({'a': ('stairs', None, None)}, {'map_size': [64]}, client='tcp://here')",
    ),
}


@pytest.mark.parametrize("extra", MISSING)
def test_missing_extra_names_the_pip_command(extra, tmp_path):
    module, call = MISSING[extra]
    lines = "".join(f"    {line}\n" for line in call.splitlines())
    code = f"import csm\ntry:\n{lines}except ImportError as error:\n    print(error)\n"
    said = run_python(code, without=(module,), cwd=tmp_path)
    assert module in said
    assert re.search(rf"pip install '?\"?cascaded-shadow-maps\[{extra}\]", said), said


def test_version_has_one_source():
    assert csm.__version__ == project()["version"]
    assert importlib.metadata.version("cascaded-shadow-maps") == csm.__version__
    assert f"## {csm.__version__}\n" in (ROOT / "CHANGELOG.md").read_text()


def test_all_holds_every_extra_for_users():
    extras = project()["optional-dependencies"]
    (everything,) = extras["all"]
    named = set(re.search(r"\[(.*)\]", everything)[1].split(","))
    assert named == set(extras) - {"all", "dev", "test"}
    assert set(extras) >= {"mesh", "truth", "plot", "sweep", "cluster", "notebooks", "geo", "dev"}


def tracked():
    """Files that git knows, or None outside a checkout and without git."""
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        return None
    command = ["git", "-c", f"safe.directory={ROOT}", "ls-files"]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()


@pytest.fixture(scope="module")
def sdist_names(tmp_path_factory):
    """Names in an sdist made of a copy of this tree, without the leading folder."""
    folder = tmp_path_factory.mktemp("sdist")
    # Without the egg-info, whose list of files would be added to whatever MANIFEST.in says.
    left = shutil.ignore_patterns(
        ".git", ".venv", "build", "dist", "demo", "*.egg-info", ".*_cache"
    )
    shutil.copytree(ROOT, folder / "tree", ignore=left)
    code = "import sys\nfrom setuptools import build_meta\nbuild_meta.build_sdist(sys.argv[1])"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder / "tree",
    )
    assert done.returncode == 0, done.stderr
    with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def test_sdist_holds_all_that_a_build_and_the_tests_need(sdist_names):
    folders = ("csrc", "csm", "shaders", "tests", "docs")
    wanted = {"pyproject.toml", "setup.py", "README.md", "LICENSE", "CHANGELOG.md", "MANIFEST.in"}
    known = tracked()
    if known is None:  # from an unpacked sdist: what lies here is what it held
        known = [str(p.relative_to(ROOT)) for f in folders for p in (ROOT / f).rglob("*")]
        known = [name for name in known if Path(ROOT, name).is_file()]
        known = [n for n in known if not n.endswith((".so", ".pyc"))]
    wanted |= {name for name in known if name.startswith(tuple(f"{f}/" for f in folders))}
    assert not wanted - sdist_names


def test_sdist_holds_nothing_that_was_built(sdist_names):
    built = [n for n in sdist_names if n.endswith((".so", ".o", ".pyc")) or n.startswith("build/")]
    assert not built


@pytest.fixture
def wheels(monkeypatch, tmp_path):
    """scripts/wheels.py, with steps that do nothing and one Python, 3.11."""
    spec = importlib.util.spec_from_file_location("wheels", ROOT / "scripts" / "wheels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / "dist").mkdir()
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "scene_files.py").write_text("FOLDER = None")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "run", lambda *_, **__: make_sdist(tmp_path / "dist"))
    monkeypatch.setattr(module, "interpreters", lambda version: [Path(version)])
    monkeypatch.setattr(module, "usable", lambda path, version: version == "3.11")
    monkeypatch.setenv("CSM_SCENES", "")  # put back afterwards
    return module


def make_sdist(folder):
    """What a build leaves."""
    folder.mkdir(exist_ok=True)
    (folder / "a.tar.gz").touch()


def test_wheels_fails_where_a_python_is_missing(wheels, monkeypatch):
    proved = []
    monkeypatch.setattr(wheels, "prove", lambda *arguments: proved.append(arguments))
    monkeypatch.setattr(sys, "argv", ["wheels.py", "-x"])
    with pytest.raises(SystemExit, match=r"not proved on Python 3\.12, 3\.13.*--allow-missing"):
        wheels.main()
    monkeypatch.setattr(sys, "argv", ["wheels.py", "--allow-missing", "-x"])
    wheels.main()
    assert [(version, words) for _, version, _, _, words in proved] == [("3.11", ["-x"])] * 2
    monkeypatch.setattr(wheels, "usable", lambda path, version: False)
    with pytest.raises(SystemExit, match="none of Python"):
        wheels.main()


def test_installed_package_holds_shaders_and_types():
    if Path(csm.__file__).is_relative_to(ROOT):
        pytest.skip("an editable install lists no files; make wheels installs one that does")
    files = {str(file) for file in importlib.metadata.files("cascaded-shadow-maps")}
    shaders = {f"csm/{p.relative_to(ROOT)}" for p in (ROOT / "shaders").rglob("*.*") if p.is_file()}
    shaders = {name for name in shaders if not name.endswith(".pyc")}
    assert shaders <= files
    types = {f"csm/{p.name}" for p in (ROOT / "csm").iterdir() if p.suffix in (".typed", ".pyi")}
    assert {"csm/py.typed"} <= types <= files
