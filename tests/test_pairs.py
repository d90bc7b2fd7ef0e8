"""Every pair of effects compiles, links and renders a finite mask."""

import numpy as np
import pairwise
import pytest

import csm

PARTS = 8
SIZE = (16, 16)


@pytest.fixture(scope="module")
def renderers():
    with (
        csm.Renderer(debug=True, stage="compute") as compute,
        csm.Renderer(debug=True, stage="fragment") as fragment,
    ):
        yield {"compute": compute, "fragment": fragment}


def all_scenes():
    """By whether a mesh is drawn more than once, and whether one is cut out."""
    once = csm.scenes.plane_and_box()
    corners = [[-4.0, 2.0, 1.0], [-2.0, 2.0, 1.0], [-2.0, 2.0, 3.0], [-4.0, 2.0, 3.0]]
    leaf = csm.Mesh(
        np.array(corners), [[0, 2, 1], [0, 3, 2]], "leaf",
        uv=np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]]), alpha=np.eye(2),
    )  # fmt: skip
    leaves = csm.Scene([leaf])
    scenes = {}
    for cut_out in (False, True):
        single = csm.Scene.merge(once, leaves) if cut_out else once
        twice = csm.Scene.merge(single, single.placed((2.5, 0.0, 1.0)))
        scenes |= {(False, cut_out): single, (True, cut_out): twice}
    return scenes


@pytest.fixture(scope="module")
def scenes():
    return all_scenes()


CAMERA = csm.Camera.look_at((-6, 4.5, 8), (-0.5, 0.6, 0), fov_y_deg=45, far=40, size=SIZE)
SUN = csm.Sun.from_angles(40.0, 35.0)


def problem_of(row, renderers, scenes):
    """What is wrong with the mask of a row; "" if nothing is."""
    renderer = renderers[row["stage"]]
    scene = scenes[row["instanced"], row["cut_out"]]
    settings = csm.ShadowSettings(**pairwise.changes_of(row))
    try:
        mask = renderer.render(scene, CAMERA, SUN, settings, outputs=("mask",)).mask
    except (csm.CsmError, csm.GLWarning) as error:
        return f"{type(error).__name__}: {error}"
    if not np.isfinite(mask).all():
        return "not finite"
    if mask.min() < 0.0 or mask.max() > 1.0:
        return f"from {mask.min()} to {mask.max()}"
    # a dark side of the box, lit ground; a kernel of a few texels may leave neither whole
    if not (mask.min() < 0.5 < mask.max()) and settings.filter != "none":
        return f"blank: from {mask.min()} to {mask.max()}"
    return ""


def test_table_has_every_pair_that_can_matter_and_no_value_is_idle():
    rows, possible = pairwise.table()
    covered = np.zeros_like(possible)
    for row in rows:
        there = pairwise.mattering(row)
        covered[np.ix_(there, there)] = True
    missing = [
        (pairwise.LEVELS[a], pairwise.LEVELS[b])
        for a, b in np.argwhere(possible & ~covered) if a < b
    ]  # fmt: skip
    assert not missing
    assert not [pairwise.LEVELS[i] for i in np.flatnonzero(~possible.any(axis=1))]


def test_table_knows_every_effect_with_a_name_and_enough_of_its_values():
    assert {name for name in pairwise.TABLE} <= set(pairwise.FACTORS)
    for name, row in pairwise.TABLE.items():
        values = pairwise.values_of(name)
        assert len(values) > 1, name
        if row["type"] == "enum":
            assert set(values) == set(row["choices"].split())


# An eighth of the table stands for all of it unless the slow tests are asked for.
@pytest.mark.parametrize(
    "part", [pytest.param(i, marks=[pytest.mark.slow] if i else []) for i in range(PARTS)]
)
def test_every_pair_renders_a_finite_mask(renderers, scenes, part):
    rows = pairwise.table()[0][part::PARTS]
    problems = [(problem_of(row, renderers, scenes), pairwise.text(row)) for row in rows]
    assert not [f"{problem}: {settings}" for problem, settings in problems if problem]
