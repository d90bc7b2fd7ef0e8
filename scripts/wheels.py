"""Proves the package as others get it: sdist, a wheel from the sdist, tests of the installed wheel.

For every Python of VERSIONS that is on this machine: the wheel is built from the unpacked sdist,
installed in an empty environment, and the fast tests of the sdist run against it from another
folder. Fails if anything of that fails, and at the end if an interpreter is missing; with
``--allow-missing`` one is enough. Other arguments go to pytest.
"""

import argparse
import os
import runpy
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
CHECK = "import csm, sys; sys.exit(sys.prefix not in csm.__file__ and csm.__file__)"


def interpreters(version):
    """Paths where a Python of a version may be: PATH, then pyenv's and uv's folders."""
    name = f"python{version}"
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        yield Path(folder) / name
    home = Path.home()
    yield from sorted((home / ".pyenv/versions").glob(f"{version}.*/bin/{name}"))
    yield from sorted((home / ".local/share/uv/python").glob(f"cpython-{version}.*/bin/{name}"))


def usable(path, version):
    """Whether a path runs as the wanted version: shims of version managers may not."""
    if not path.exists():
        return False
    code = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    found = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
    return found.returncode == 0 and found.stdout.strip() == version


def run(*command, **options):
    """Run a command, or stop with its exit status."""
    print("+", *command, flush=True)
    status = subprocess.run([str(c) for c in command], check=False, **options).returncode
    if status:
        sys.exit(f"wheels: {command[0]} failed with exit status {status}")


def prove(python, version, sdist, folder, pytest_arguments):
    """Wheel from the sdist, empty environment, tests from another folder."""
    environment, wheels, elsewhere = folder / "venv", folder / "wheels", folder / "elsewhere"
    elsewhere.mkdir(parents=True)
    run(python, "-m", "venv", environment)
    own = environment / "bin/python"
    run(own, "-m", "pip", "wheel", "-q", "--no-deps", "-w", wheels, sdist)
    wheel = next(wheels.glob("*.whl"))
    shutil.copy(wheel, ROOT / "dist")
    run(own, "-m", "pip", "install", "-q", f"{wheel}[test]")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    tests = next((folder / "unpacked").iterdir()) / "tests"
    run(own, "-c", CHECK, cwd=elsewhere)
    run(
        own, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests, *pytest_arguments, cwd=elsewhere
    )
    print(f"wheels: {wheel.name} passes on Python {version}")


def main():
    """Build the sdist once, then prove it on each Python."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0], allow_abbrev=False)
    parser.add_argument("--allow-missing", action="store_true", help="one Python is enough")
    options, pytest_arguments = parser.parse_known_args()
    scenes = runpy.run_path(str(ROOT / "tests/scene_files.py"))["FOLDER"]
    os.environ["CSM_SCENES"] = str(scenes)  # the unpacked tests would look elsewhere
    shutil.rmtree(ROOT / "dist", ignore_errors=True)
    run(sys.executable, "-m", "build", "--sdist", "--outdir", ROOT / "dist", ROOT)
    sdist = next((ROOT / "dist").glob("*.tar.gz"))
    proved = []
    for version in VERSIONS:
        python = next((p for p in interpreters(version) if usable(p, version)), None)
        if python is None:
            print(f"wheels: no Python {version} on this machine, not tried", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory(prefix=f"csm-{version}-") as folder:
            prove(python, version, sdist, Path(folder), pytest_arguments)
        proved.append(version)
    if not proved:
        sys.exit(f"wheels: none of Python {', '.join(VERSIONS)} found")
    print("wheels: proved on Python", ", ".join(proved), "- files in dist/")
    missing = [version for version in VERSIONS if version not in proved]
    if missing and not options.allow_missing:
        sys.exit(
            f"wheels: not proved on Python {', '.join(missing)}, which this machine lacks "
            "(--allow-missing accepts that)"
        )


if __name__ == "__main__":
    main()
