"""Height grids: where samples land, what is a hole, how degrees become metres, which files load."""

import math

import numpy as np
import pytest
from scene_files import scene_path

import csm
from csm.elevation import degree_size, grid_mesh, surface_height
from csm.scene import Scene

NAN, INF = float("nan"), float("inf")
HEIGHTS = np.array([[10.0, 11, 12, 13], [20, 21, 22, 23], [30, 31, 32, 33]])


def height_by_search(positions, triangles, x, z):
    """Height of the triangle over a point, by trying every triangle (barycentric)."""
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    area = (b - a)[:, 0] * (c - a)[:, 2] - (b - a)[:, 2] * (c - a)[:, 0]
    beta = ((x - a[:, 0]) * (c - a)[:, 2] - (z - a[:, 2]) * (c - a)[:, 0]) / area
    gamma = ((b - a)[:, 0] * (z - a[:, 2]) - (b - a)[:, 2] * (x - a[:, 0])) / area
    inside = np.flatnonzero((beta > -1e-9) & (gamma > -1e-9) & (beta + gamma < 1 + 1e-9))
    i = inside[0]
    return a[i, 1] + beta[i] * (b - a)[i, 1] + gamma[i] * (c - a)[i, 1]


def test_samples_land_on_the_map():
    positions, triangles = grid_mesh(HEIGHTS, (30.0, 20.0))
    assert len(triangles) == 2 * 3 * 2
    # Row 0 is north (-z), column 0 west (-x), the centre of the grid at 0.
    assert positions[0].tolist() == [-45, 10, -20]
    assert positions[3].tolist() == [45, 13, -20]
    assert positions[-1].tolist() == [45, 33, 20]
    assert positions[:, 1].tolist() == HEIGHTS.ravel().tolist()


def test_every_triangle_faces_up():
    random = np.random.default_rng(4)
    positions, triangles = grid_mesh(random.normal(size=(6, 9)) * 50, 7.0)
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    assert (normals[:, 1] > 0).all()
    # Together they cover the grid once: areas on the map add up.
    assert 0.5 * normals[:, 1].sum() == pytest.approx(8 * 7.0 * 5 * 7.0, rel=1e-14)


def test_origin_is_the_place_of_the_first_sample():
    scene = Scene.from_elevation(HEIGHTS, (30.0, 20.0), origin=(394_000.5, 3_798_000.25))
    positions = scene.flatten()[0]
    assert positions[0].tolist() == [394_000.5, 10, -3_798_000.25]
    assert positions[-1].tolist() == [394_090.5, 33, -3_797_960.25]
    # The georeference is what differs from the same grid without an origin.
    here = Scene.from_elevation(HEIGHTS, (30.0, 20.0))
    assert np.array_equal(positions, here.flatten()[0] + scene.georeference)
    assert here.georeference.tolist() == [0, 0, 0]
    assert scene.georeference[1] == 0


@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("column", [0, 1, 3])
def test_a_nan_takes_out_the_cells_around_it(row, column):
    holed = HEIGHTS.copy()
    holed[row, column] = NAN
    positions, triangles = grid_mesh(holed, 1.0)
    kept = [
        (r, c)
        for r in range(2)
        for c in range(3)
        if not (r <= row <= r + 1 and c <= column <= c + 1)
    ]
    assert len(triangles) == 2 * len(kept)
    centres = positions[triangles].mean(axis=1)
    cells = {(int(z + 1), int(x + 1.5)) for x, _, z in centres}
    assert cells == set(kept)
    # No vertex is left that no triangle uses, so positions stay finite.
    assert np.unique(triangles).tolist() == list(range(len(positions)))


def test_surface_height_is_that_of_the_triangles():
    random = np.random.default_rng(9)
    heights, cell = random.normal(size=(7, 5)) * 20, (3.0, 4.0)
    positions, triangles = grid_mesh(heights, cell)
    x, z = random.uniform(-6, 6, 200), random.uniform(-12, 12, 200)
    got = surface_height(heights, cell, x, z)
    expected = [height_by_search(positions, triangles, *point) for point in zip(x, z, strict=True)]
    assert np.allclose(got, expected, atol=1e-11)
    corners = surface_height(heights, cell, positions[:, 0], positions[:, 2])
    assert np.allclose(corners, heights.ravel(), atol=1e-12)


@pytest.mark.parametrize(
    ("latitude", "east", "north"),
    [
        # Equator and pole in closed form: a, a (1 - e2) and a / sqrt(1 - e2) times pi / 180.
        (0.0, 6378137.0, 6378137.0 * (1 - 0.00669437999014)),
        (90.0, 0.0, 6378137.0 / math.sqrt(1 - 0.00669437999014)),
    ],
)
def test_degree_size_at_the_ends(latitude, east, north):
    got = degree_size(latitude)
    assert got[0] == pytest.approx(math.radians(east), abs=1e-9)
    assert got[1] == pytest.approx(math.radians(north), rel=1e-12)


@pytest.mark.parametrize("latitude", [-67.0, -12.5, 36.5, 52.0, 85.0])
def test_degree_size_is_the_arc_of_the_ellipse(latitude):
    # The ellipse itself: chords of a millionth of a degree, built from reduced latitudes.
    a, e2 = 6378137.0, 0.00669437999014

    def point(degrees):
        reduced = math.atan(math.sqrt(1 - e2) * math.tan(math.radians(degrees)))
        return a * math.cos(reduced), a * math.sqrt(1 - e2) * math.sin(reduced)

    h = 1e-5
    (r0, z0), (r1, z1) = point(latitude - h), point(latitude + h)
    north = math.hypot(r1 - r0, z1 - z0) / (2 * h)
    east = math.radians(point(latitude)[0])
    # Differences of numbers of 6e6 m over a chord of 2 m: 1e-9 relative.
    assert degree_size(latitude)[1] == pytest.approx(north, rel=1e-8)
    assert degree_size(latitude)[0] == pytest.approx(east, rel=1e-12)


# ------------------------------------------------------------------------------------------- files


def test_npz_in_metres(tmp_path):
    path = tmp_path / "dem.npz"
    np.savez(path, elevation=HEIGHTS.astype(np.int16), cell=30, easting0=1000, northing0=2000)
    scene = csm.load_elevation(path)
    assert scene.bounds.tolist() == [[1000, 10, -2000], [1090, 33, -1940]]
    assert scene.name == "dem"


@pytest.mark.parametrize("swapped", [False, True])
def test_npz_in_degrees_whatever_the_order_of_the_extremes(tmp_path, swapped):
    south, north = 36.0, 37.0
    ymin, ymax = (north, south) if swapped else (south, north)
    path = tmp_path / "dem.npz"
    np.savez(
        path, elevation=HEIGHTS, dx=0.01, dy=0.01, xmin=-84.5, xmax=-84.0, ymin=ymin, ymax=ymax
    )
    scene = csm.load_elevation(path)
    east, north_size = degree_size(36.5)
    extent = scene.bounds[1] - scene.bounds[0]
    assert extent[[0, 2]] == pytest.approx([0.03 * east, 0.02 * north_size], rel=1e-12)
    positions = scene.flatten()[0]
    assert positions[0, 2] < 0  # row 0 is north
    assert positions[0, 1] == 10
    assert scene.georeference.tolist() == [0, 0, 0]


def test_npy_has_cells_of_a_metre(tmp_path):
    np.save(tmp_path / "dem.npy", HEIGHTS.astype(np.float32))
    assert csm.load_elevation(tmp_path / "dem.npy").bounds.tolist() == [
        [-1.5, 10, -1],
        [1.5, 33, 1],
    ]


def test_the_terrain_inside_matplotlib():
    cbook = pytest.importorskip("matplotlib.cbook")
    path = cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)
    scene = csm.load_elevation(path)
    with np.load(path) as archive:
        heights = archive["elevation"]
    assert scene.triangle_count == 2 * 343 * 402
    assert scene.bounds[:, 1].tolist() == [heights.min(), heights.max()] == [236, 1076]
    cells = (scene.bounds[1] - scene.bounds[0])[[0, 2]] / (402, 343)
    assert cells == pytest.approx([74.5, 92.5], abs=0.1)
    # Row 0 is north although the file's ymin is the larger: the north-west sample.
    north_west = np.lexsort(scene.flatten()[0].T[[0, 2]])[0]
    assert scene.flatten()[0][north_west, 1] == heights[0, 0]


def test_the_full_grid_of_a_test_scene():
    path = scene_path("bigtujunga_30m.npz")
    scene = csm.load_elevation(path)
    with np.load(path) as archive:
        heights, cell = archive["elevation"], float(archive["cell"])
        easting, northing = float(archive["easting0"]), float(archive["northing0"])
    rows, columns = heights.shape
    assert scene.triangle_count == 2 * (rows - 1) * (columns - 1)
    expected = [
        [easting, heights.min(), -northing],
        [easting + (columns - 1) * cell, heights.max(), (rows - 1) * cell - northing],
    ]
    # Coordinates of 4e6 m in doubles.
    assert np.allclose(scene.bounds, expected, rtol=0, atol=2e-9)


def test_geotiff(tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed (extra geo)")
    path, heights = tmp_path / "dem.tif", HEIGHTS.astype(np.float32)
    heights[1, 2] = -9999
    profile = {
        "driver": "GTiff",
        "height": 3,
        "width": 4,
        "count": 1,
        "dtype": "float32",
        "nodata": -9999,
        "crs": "EPSG:32611",
        "transform": rasterio.Affine(30, 0, 500_000, 0, -20, 3_800_000),
    }
    with rasterio.open(path, "w", **profile) as raster:
        raster.write(heights, 1)
    scene = csm.load_elevation(path)
    assert scene.triangle_count == 2 * (6 - 4)
    # The first sample is the centre of the first pixel.
    assert scene.bounds[0, [0, 2]].tolist() == [500_015, -3_799_990]


# ------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ((HEIGHTS[0], 1.0), ValueError, r"heights must be \(rows, columns\).*\(4,\)"),
        ((HEIGHTS[:1], 1.0), ValueError, "2 x 2 or more"),
        ((HEIGHTS * INF, 1.0), ValueError, "finite or NaN"),
        ((HEIGHTS * NAN, 1.0), ValueError, "everything is a hole"),
        ((HEIGHTS.astype(str), 1.0), TypeError, "heights must be an array of real numbers"),
        ((HEIGHTS, 0.0), ValueError, r"cell_size must be a positive.*got \[0.0, 0.0\]"),
        ((HEIGHTS, -1.0), ValueError, "cell_size must be a positive"),
        ((HEIGHTS, (1.0, NAN)), ValueError, "cell_size must be a positive"),
        ((HEIGHTS, (1.0, 2.0, 3.0)), ValueError, "cell_size must be a positive"),
        ((HEIGHTS, "ten"), TypeError, "cell_size must be an array of real numbers"),
        ((HEIGHTS, 1.0, (1, 2, 3)), ValueError, "origin must be 2 numbers"),
        ((HEIGHTS, 1.0, (1, INF)), ValueError, "origin must be finite"),
    ],
)
def test_from_elevation_refuses(arguments, error, text):
    with pytest.raises(error, match=text):
        Scene.from_elevation(*arguments)


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("dem.npz", {"elevation": HEIGHTS}, r"keys elevation and \(cell, easting0, northing0\)"),
        ("dem.npz", {"cell": 1, "easting0": 0, "northing0": 0}, "keys elevation"),
        (
            "dem.npz",
            {"elevation": HEIGHTS, "cell": -30, "easting0": 0, "northing0": 0},
            "cell_size must be a positive",
        ),
        (
            "dem.npz",
            {"elevation": HEIGHTS, "cell": [], "easting0": 0, "northing0": 0},
            r"dem\.npz",
        ),
        (
            "dem.npz",
            dict(elevation=HEIGHTS, dx=1, dy=1, xmin=0, xmax=1, ymin=3e5, ymax=4e5),
            "latitude_deg",
        ),
        ("dem.npy", HEIGHTS[0], "heights must be"),
        ("dem.npy", b"\x93NUMPY broken", "not a readable .npy"),
        ("dem.npz", b"PK broken", "not a readable .npz"),
        ("dem.asc", b"ncols 4", r"ends in \.npz, \.npy, \.tif.*got '\.asc'"),
    ],
)
def test_damaged_files_are_refused_by_name(tmp_path, name, content, text):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, dict):
        np.savez(path, **content)
    else:
        np.save(path, content)
    with pytest.raises(ValueError, match=text) as caught:
        csm.load_elevation(path)
    assert name in str(caught.value)


def test_pickled_objects_are_not_run(tmp_path):
    np.save(tmp_path / "dem.npy", np.array([{"a": 1}], object), allow_pickle=True)
    # The whole text: numpy's own advises to allow what is dangerous.
    with pytest.raises(ValueError, match=r"dem\.npy: not a readable \.npy array of numbers$"):
        csm.load_elevation(tmp_path / "dem.npy")


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_text_is_refused_without_advice_on_numpy(tmp_path, suffix):
    path = tmp_path / f"dem.{suffix}"
    path.write_text("hello")
    with pytest.raises(ValueError, match=rf"dem\.{suffix}: not a readable .* of numbers$"):
        csm.load_elevation(path)


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_a_file_that_may_not_be_opened_is_not_called_damaged(tmp_path, monkeypatch, suffix):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    path = tmp_path / f"dem.{suffix}"
    path.write_bytes(b"x")
    monkeypatch.setattr("csm.elevation.open", refuse, raising=False)
    with pytest.raises(PermissionError):
        csm.load_elevation(path)
