"""The README's promises: its example runs as written, its commands and links exist."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import csm

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language):
    """Contents of the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.MULTILINE | re.DOTALL)


def test_example_runs_as_written(tmp_path):
    pytest.importorskip("embreex", reason="the example compares with csm.truth (extra: truth)")
    plt = pytest.importorskip(
        "matplotlib.image", reason="the example saves a picture (extra: plot)"
    )
    (example,) = blocks("python")
    done = subprocess.run(
        [sys.executable, "-c", example],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"},
    )
    assert done.returncode == 0, done.stderr
    # A wrong sign anywhere is tens of percent; a sound frame of this town is far below five.
    assert 0.0 < float(re.search(r"wrong: ([\d.]+)%", done.stdout)[1]) < 5.0
    picture = plt.imread(tmp_path / "mask.png")[:, :, 0]
    assert picture.shape == (540, 960)
    assert 0.02 < (picture < 0.5).mean() < 0.98


def test_example_is_ten_lines():
    (example,) = blocks("python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 11


def test_make_targets_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    named = {word for block in blocks("sh") for word in re.findall(r"^make (\S+)", block, re.M)}
    assert {"demo", "test"} <= named <= targets


@pytest.mark.skipif(not (ROOT / ".ci/run").exists(), reason="not a checkout: no .ci/run")
def test_ci_runs_the_test_command_and_nothing_else():
    lines = (ROOT / ".ci/run").read_text().splitlines()
    commands = [line for line in lines if line and not line.startswith(("#", "set ", "cd "))]
    assert commands == ["exec make test"]


def test_links_lead_to_files():
    links = [link for link in re.findall(r"\]\(([^)#]+)", README) if "://" not in link]
    assert links
    missing = [link for link in links if not (ROOT / link).exists()]
    assert not missing


def test_subcommands_exist():
    named = {word for block in blocks("sh") for word in re.findall(r"^csm (\S+)", block, re.M)}
    help_text = subprocess.run(
        [sys.executable, "-m", "csm", "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert named
    for name in named:
        assert re.search(rf"\b{name}\b", help_text)


def test_named_scene_of_the_command_line_exists():
    for block in blocks("sh"):
        for scene, camera, sun in re.findall(
            r"^csm render ([a-z_]+) --camera (\w+) --sun (\w+)", block, re.M
        ):
            made = csm.scenes.SCENES[scene]()
            assert camera in made.cameras
            assert sun in made.suns
