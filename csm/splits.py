"""Where the view range is cut into cascades."""

import operator

from . import _core
from .spaces import as_number

__all__ = ["split_distances"]

SCHEMES = ("practical", "uniform", "logarithmic")  # in the order of the core's numbers


def split_distances(near, far, count, *, scheme="practical", lam=0.5):
    """View depths that cut the view range into cascades.

    Parameters
    ----------
    near, far : float
        View depths to cover [m]. ``0 < near < far``; near of any sign for ``"uniform"`` and for
        ``"practical"`` with ``lam=0``.
    count : int
        Number of cascades, 1 to 8.
    scheme : {"practical", "uniform", "logarithmic"}
        Equal lengths, equal ratios, or the mean of both weighted by `lam`.
    lam : float
        Weight of the logarithmic scheme in ``"practical"``, 0 to 1.

    Returns
    -------
    splits : (count + 1,) float64
        Ascending view depths [m]; ``splits[0] == near``, ``splits[-1] == far``.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule; the text names it.

    Notes
    -----
    The schemes that need a camera, map sizes or what is seen (`ShadowSettings.split`) come from
    ``fit_cascades(...).splits``.

    References
    ----------
    .. [Zhang2006] Zhang, Sun, Xu, Lun: Parallel-split shadow maps for large-scale virtual
       environments. VRCIA 2006. doi:10.1145/1128923.1128975
    """
    if scheme not in SCHEMES:
        raise ValueError(f"scheme must be one of {', '.join(SCHEMES)} (got {scheme!r})")
    try:
        count = operator.index(count)
    except TypeError:
        raise TypeError(f"count must be a whole number from 1 to 8 (got {count!r})") from None
    if not 1 <= count <= 8:
        raise ValueError(f"count must be 1 to 8 (got {count})")
    rule = "a finite view depth in metres"
    return _core.split_distances(
        near=as_number("near", near, rule=rule),
        far=as_number("far", far, rule=rule),
        count=count,
        scheme=SCHEMES.index(scheme),
        lam=as_number("lam", lam, 0.0, 1.0),
    )
