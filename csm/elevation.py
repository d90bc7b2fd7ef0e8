"""Height grids as triangles, and the files they come in.

Heights are samples at points, row 0 north, column 0 west. On the map +x is east and -z north.
"""

import math
from pathlib import Path

import numpy as np

from .mesh import drop_unused
from .spaces import as_number, as_vector, real_array

__all__ = ["degree_size", "grid_centre", "grid_mesh", "read_elevation", "surface_height"]

# WGS 84: equatorial radius [m] and first eccentricity squared.
_WGS84_RADIUS = 6378137.0
_WGS84_E2 = 6.69437999014e-3

_METRE_KEYS = ("cell", "easting0", "northing0")
_DEGREE_KEYS = ("dx", "dy", "xmin", "xmax", "ymin", "ymax")


def grid_mesh(heights, cell_size):
    """Triangles over a height grid, two per cell, facing up.

    ::

        a --- b     north (-z), row r
        |   / |     triangles a d b and b d e: counter-clockwise from above
        | /   |
        d --- e     row r + 1

    Parameters
    ----------
    heights : (rows, columns) array_like
        Samples [m], at least 2 x 2. A cell with a NaN corner is a hole.
    cell_size : float or (float, float)
        Distance of samples [m], or (east, north).

    Returns
    -------
    positions : (n, 3) float64
        The samples that a triangle uses, row by row [m]; the grid's centre is at x = z = 0.
    triangles : (m, 3) int32

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule, or every cell is a hole.
    """
    heights = _checked_heights(heights)
    east, north = _checked_cell_size(cell_size)
    rows, columns = heights.shape
    positions = np.empty((rows, columns, 3))
    positions[..., 0] = (np.arange(columns) - 0.5 * (columns - 1)) * east
    positions[..., 1] = heights
    positions[..., 2] = ((np.arange(rows) - 0.5 * (rows - 1)) * north)[:, None]

    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, d, e = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    present = np.isfinite(heights)
    whole = present[:-1, :-1] & present[:-1, 1:] & present[1:, :-1] & present[1:, 1:]
    if not whole.any():
        raise ValueError("heights must have a cell without NaN (got none: everything is a hole)")
    triangles = np.stack([a, d, b, b, d, e], axis=-1)[whole].reshape(-1, 3)
    return drop_unused(positions.reshape(-1, 3), triangles)


def grid_centre(heights, cell_size, origin=None):
    """World point of a grid's centre at height 0.

    Parameters
    ----------
    heights, cell_size
        As in `grid_mesh`.
    origin : (2,) array_like, optional
        Easting and northing of sample [0, 0] [m]; without it the centre is the world's origin.

    Returns
    -------
    centre : (3,) float64
        World [m]: +x is easting, -z northing.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule.
    """
    if origin is None:
        return np.zeros(3)
    easting, northing = as_vector("origin", origin, 2)
    east, north = _checked_cell_size(cell_size)
    rows, columns = np.shape(heights)
    return np.array(
        [easting + 0.5 * (columns - 1) * east, 0.0, 0.5 * (rows - 1) * north - northing]
    )


def surface_height(heights, cell_size, x, z):
    """Height of the triangles of `grid_mesh` at points of the centred grid.

    Parameters
    ----------
    heights, cell_size
        As in `grid_mesh`.
    x, z : (n,) array_like
        World coordinates [m]; points beyond the edge take the edge cell's plane.

    Returns
    -------
    y : (n,) float64
        [m], NaN in holes.

    Raises
    ------
    TypeError, ValueError
        As `grid_mesh`.
    """
    heights = _checked_heights(heights)
    east, north = _checked_cell_size(cell_size)
    rows, columns = heights.shape
    across = np.asarray(x, np.float64) / east + 0.5 * (columns - 1)
    down = np.asarray(z, np.float64) / north + 0.5 * (rows - 1)
    column = np.clip(np.floor(across), 0, columns - 2).astype(np.int64)
    row = np.clip(np.floor(down), 0, rows - 2).astype(np.int64)
    u, v = across - column, down - row
    a, b = heights[row, column], heights[row, column + 1]
    d, e = heights[row + 1, column], heights[row + 1, column + 1]
    return np.where(
        u + v <= 1.0, a + u * (b - a) + v * (d - a), e + (1 - u) * (d - e) + (1 - v) * (b - e)
    )


def degree_size(latitude_deg):
    """Length of one degree on the WGS 84 ellipsoid.

    Parameters
    ----------
    latitude_deg : float
        Geodetic latitude, -90 to 90.

    Returns
    -------
    east, north : float
        Metres per degree of longitude (along the parallel) and of latitude (along the meridian).

    References
    ----------
    .. [Snyder1987] Snyder: Map projections, a working manual. USGS Professional Paper 1395, 1987.
       doi:10.3133/pp1395, eqs. 4-18 and 4-20 (radii of curvature).
    """
    latitude = math.radians(as_number("latitude_deg", latitude_deg, -90.0, 90.0))
    w2 = 1.0 - _WGS84_E2 * math.sin(latitude) ** 2
    meridian_radius = _WGS84_RADIUS * (1.0 - _WGS84_E2) / w2**1.5
    parallel_radius = _WGS84_RADIUS * math.cos(latitude) / math.sqrt(w2)
    return math.radians(parallel_radius), math.radians(meridian_radius)


def read_elevation(path):
    """Heights, cell size and origin from a file; the formats are those of `csm.load_elevation`.

    Parameters
    ----------
    path : str or Path
        ``.npz``, ``.npy``, ``.tif`` or ``.tiff``.

    Returns
    -------
    heights : (rows, columns) ndarray
        [m], NaN where the file has no data.
    cell_size : (float, float)
        East and north [m].
    origin : (float, float) or None
        Easting and northing of sample [0, 0] [m].

    Raises
    ------
    OSError
        If there is no such file or it cannot be opened.
    ValueError
        If it is not an elevation grid; the text names the path and the cause.
    ImportError
        For a GeoTIFF without rasterio.
    """
    path = Path(path)
    readers = {".npz": _read_npz, ".npy": _read_npy, ".tif": _read_tiff, ".tiff": _read_tiff}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path}: an elevation file ends in {', '.join(readers)} (got {path.suffix!r})"
        )
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    return reader(path)


def _read_npz(path):
    with open(path, "rb") as file:  # of a damaged archive numpy leaves its own file open
        try:
            with np.load(file, allow_pickle=False) as archive:
                keys = set(archive.files)
                wanted = [key for key in ("elevation", *_METRE_KEYS, *_DEGREE_KEYS) if key in keys]
                data = {key: archive[key] for key in wanted}
        except Exception as error:  # a dozen kinds, some with advice on arguments of np.load
            raise ValueError(f"{path}: not a readable .npz archive of numbers") from error
    metres, degrees = keys.issuperset(_METRE_KEYS), keys.issuperset(_DEGREE_KEYS)
    if "elevation" not in keys or not (metres or degrees):
        raise ValueError(
            f"{path}: an elevation archive has the keys elevation and ({', '.join(_METRE_KEYS)}) "
            f"[m] or ({', '.join(_DEGREE_KEYS)}) [degrees] (got {', '.join(sorted(keys))})"
        )
    try:
        if metres:
            cell = np.asarray(data["cell"], np.float64).reshape(-1)
            cell_size = (cell[0], cell[-1])
            origin = (float(data["easting0"]), float(data["northing0"]))
            return data["elevation"], cell_size, origin
        return data["elevation"], _cell_size_of_degrees(data), None
    except (TypeError, ValueError, IndexError) as error:
        raise ValueError(f"{path}: {error}") from error


def _cell_size_of_degrees(data):
    """Return the cell's sides (east, north) [m] at the middle latitude.

    Which of ymin and ymax is larger does not matter: row 0 is north by contract, and files with
    the two swapped exist.
    """
    dx, dy, ymin, ymax = (float(data[key]) for key in ("dx", "dy", "ymin", "ymax"))
    east, north = degree_size(0.5 * (ymin + ymax))
    return abs(dx) * east, abs(dy) * north


def _read_npy(path):
    with open(path, "rb") as file:
        try:
            heights = np.load(file, allow_pickle=False)
        except Exception as error:  # as above
            raise ValueError(f"{path}: not a readable .npy array of numbers") from error
    return heights, (1.0, 1.0), None


def _read_tiff(path):
    try:
        import rasterio
    except ImportError as error:
        raise ImportError(
            f"{path}: reading a GeoTIFF needs rasterio: pip install cascaded-shadow-maps[geo]"
        ) from error
    try:
        with rasterio.open(path) as raster:
            heights = raster.read(1, masked=True).astype(np.float64).filled(np.nan)
            transform, degrees = raster.transform, bool(raster.crs and raster.crs.is_geographic)
    except rasterio.errors.RasterioError as error:
        raise ValueError(f"{path}: not a readable GeoTIFF ({error})") from error
    if transform.b or transform.d or transform.a <= 0 or transform.e >= 0:
        raise ValueError(
            f"{path}: the grid must be north up, rows to the south (got transform {transform!r})"
        )
    # A raster's transform points at the corner of a pixel, a sample is its centre.
    x, y = transform.c + 0.5 * transform.a, transform.f + 0.5 * transform.e
    if not degrees:
        return heights, (transform.a, -transform.e), (x, y)
    east, north = degree_size(y + 0.5 * (heights.shape[0] - 1) * transform.e)
    return heights, (transform.a * east, -transform.e * north), None


def _checked_heights(heights):
    heights = real_array("heights", heights)
    if heights.ndim != 2 or min(heights.shape) < 2:
        raise ValueError(f"heights must be (rows, columns), 2 x 2 or more (got {heights.shape})")
    if heights.size > np.iinfo(np.int32).max:
        raise ValueError(f"heights must have fewer than 2^31 samples (got {heights.size})")
    heights = heights.astype(np.float64)
    if np.isinf(heights).any():
        raise ValueError("heights must be finite or NaN (got an infinite height)")
    return heights


def _checked_cell_size(cell_size):
    rule = "a positive number of metres, or (east, north)"
    sides = real_array("cell_size", cell_size)
    if sides.shape not in ((), (2,)):
        raise ValueError(f"cell_size must be {rule} (got shape {sides.shape})")
    sides = np.broadcast_to(sides.astype(np.float64), (2,))
    if not np.isfinite(sides).all() or (sides <= 0).any():
        raise ValueError(f"cell_size must be {rule} (got {sides.tolist()})")
    return float(sides[0]), float(sides[1])
