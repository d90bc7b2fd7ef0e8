"""csrc/core is C11 with libc and libm and nothing else: it compiles without a warning, links alone
and places cascades in a program of its own."""

import os
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest

import csm
from csm import _core

ROOT = Path(__file__).resolve().parents[1]
CORE = sorted((ROOT / "csrc/core").glob("*.c"))
CC = os.environ.get("CC", "cc").split()
STRICT = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]

needs_compiler = pytest.mark.skipif(not shutil.which(CC[0]), reason=f"no compiler {CC[0]}")


def choices(name):
    (row,) = [row for row in _core.effect_table() if row["name"] == name]
    return row["choices"].split()


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Folder with the objects of csrc/core, compiled as strict C11."""
    folder = tmp_path_factory.mktemp("core")
    compile_ = [*CC, *STRICT, "-c", f"-I{ROOT / 'csrc'}", *CORE]
    subprocess.run(compile_, cwd=folder, check=True)
    return folder


@needs_compiler
def test_a_program_of_core_alone_fits_cascades_of_every_kind(objects, tmp_path):
    """The benchmark's program, at one round per line: every fit with every snap, every split."""
    program = tmp_path / "bench_fit"
    main = ROOT / "benchmarks/bench_fit.c"
    link = [*CC, *STRICT, f"-I{ROOT / 'csrc'}", main, *objects.glob("*.o"), "-lm", "-o", program]
    subprocess.run(link, check=True)
    ran = subprocess.run([program, "0.001"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    lines = [line.split() for line in ran.stdout.splitlines()]
    expected = [["fit", fit, snap] for fit in choices("fit") for snap in choices("snap")]
    expected += [["split", split, "exact"] for split in choices("split")]
    assert [line[:3] for line in lines] == expected
    assert all(float(line[3]) > 0 for line in lines)


@needs_compiler
def test_core_agrees_with_the_extension(objects, tmp_path):
    """The same splits from a program of ten lines as from Python."""
    (tmp_path / "main.c").write_text("""
#include <stdio.h>
#include "csm.h"
int main(void) {
    double splits[5];
    csm_error err;
    if (csm_splits_compute(0.3, 700.0, 4, CSM_SPLIT_PRACTICAL, 0.6, splits, &err) != CSM_OK) {
        return 1;
    }
    for (int i = 0; i < 5; i++) {
        printf("%.17g\\n", splits[i]);
    }
    return csm_splits_compute(10.0, 2.0, 4, CSM_SPLIT_UNIFORM, 0.5, splits, &err) != CSM_OK &&
           puts(err.text) >= 0 ? 0 : 1;
}
""")
    program = tmp_path / "main"
    link = [*CC, *STRICT, f"-I{ROOT / 'csrc'}", tmp_path / "main.c", *objects.glob("*.o")]
    subprocess.run([*link, "-lm", "-o", program], check=True)
    ran = subprocess.run([program], capture_output=True, text=True, check=True)
    *splits, problem = ran.stdout.splitlines()
    expected = csm.split_distances(0.3, 700.0, 4, lam=0.6)
    assert [float(split) for split in splits] == pytest.approx(expected.tolist(), rel=1e-15)
    assert problem == "far must be > near (got near 10, far 2)"


@needs_compiler
def test_core_keeps_no_state(objects):
    """No writable data: every call is a function of its arguments."""
    listed = subprocess.run(
        ["nm", "--defined-only", *objects.glob("*.o")], capture_output=True, text=True, check=True
    )
    kinds = [(line.split()[1], line.split()[2]) for line in listed.stdout.splitlines()
             if len(line.split()) == 3]  # fmt: skip
    assert len(kinds) > 50
    # d is .data, b is .bss, C is common; tables of pointers to text land in .data.rel.ro, also d
    writable = [name for kind, name in kinds if kind in "bBC"]
    assert not writable


def test_setup_builds_every_file_of_core(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    sources = runpy.run_path("setup.py")["SOURCES"]
    built = {Path(source).name for source in sources if "/core/" in source}
    assert built == {path.name for path in CORE}
