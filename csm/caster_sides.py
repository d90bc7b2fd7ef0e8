"""Which sides of triangles need to cast: what coarse renders and the triangles' areas say.

Of a closed surface every ray to the sun that is blocked crosses a side that faces the sun and one
that does not. The nearest to the sun faces it, so a map of *front* sides alone is the same map, for
less fill; a map of *back* sides holds no receiver that is lit, needs no bias, and loses what is
nearer to its occluder than a texel. Terrain faces the sun nearly everywhere: its front sides save
nothing, its few back sides nearly all.
"""

from dataclasses import dataclass

from . import _core

__all__ = ["BACK_GAIN", "FACES_SHARE", "Sides", "best_sides", "measure_sides", "wanted_faces"]

FACES_SHARE = 2e-4  # of the coarse picture's facing pixels, that may change with back sides alone
LIT_MOST = 0.75  # of the casters' area across the light, above which front sides save little
LIT_NEARLY_ALL = 0.9  # above which they save less than times repeat by
#: Of what coarse maps get wrong, that back sides must spare where they change more than a few
#: pixels. Measured over 46 real pairs: from 0.4 on they were better at every size of the maps,
#: at 0.26 (roofs without floors) only at coarse ones.
BACK_GAIN = 0.4
FEW = 0.01  # of facing pixels: where more change, back sides lose whole shadows
LEAST_LOOK = 2000  # facing pixels; that none of fewer changes leaves more than 3/2000 of them open
FINER = 2  # times the size of the coarse maps, for maps that say which of two others is right


@dataclass(frozen=True)
class Sides:
    """Shares of a coarse picture's facing pixels.

    Attributes
    ----------
    front : float
        That change when front sides alone cast; 1 where too few pixels face the sun to say, or so
        few sides do not that sparing them would save nothing.
    back : float
        That change when back sides alone cast; 1 where it was not asked.
    bias : float
        That change when, besides, nothing is biased; 0 where it was not asked, since `back` is
        small, or loses shadows, without a bias.
    gain : float
        Of the pixels that coarse maps get wrong against finer ones, the share that back sides
        spare; 0 where it was not asked.
    lit_area : float
        Of the casters' area across the light, the share that faces it.
    """

    front: float
    back: float = 1.0
    bias: float = 0.0
    gain: float = 0.0
    lit_area: float = 0.5


def best_sides(front, back, gain, lit_area):
    """``caster_faces`` for such shares.

    Front sides where no pixel minds. But where they save less than a quarter, or where a pixel
    minds: back sides, if hardly a pixel minds, or finer maps say that they are better. Where they
    save less than a tenth, as of a plain, front sides are not worth saying.

    Parameters
    ----------
    front, back, gain, lit_area : float
        As in `Sides`.

    Returns
    -------
    sides : {"front", "back", "both"}
    """
    if front == 0.0 and lit_area <= LIT_MOST:
        return "front"
    if back <= FACES_SHARE or gain >= BACK_GAIN:
        return "back"
    return "front" if front == 0.0 and lit_area <= LIT_NEARLY_ALL else "both"


def wanted_faces(signals):
    """Sides of triangles that need to cast."""
    return best_sides(
        signals.front_matters, signals.faces_matter, signals.back_gain, signals.lit_area
    )


def measure_sides(lit_area, lit, judged, count, again):
    """Render with front sides, and as far as that leaves it open with others.

    Parameters
    ----------
    lit_area : float
        As in `Sides`.
    lit, judged : (h, w) bool
        Of the coarse picture with both sides.
    count : int
        Its pixels that face the sun.
    again : callable
        Takes changes of the coarse settings; returns whether pixels are lit (h, w).

    Returns
    -------
    sides : Sides
    """

    def share(one, other):
        return _core.coarse_changed(judged, one, other) / max(count, 1)

    if count < LEAST_LOOK:
        return Sides(1.0, lit_area=lit_area)
    front = 1.0
    if lit_area <= LIT_NEARLY_ALL:
        front = share(lit, again(caster_faces="front"))
        # casters that front sides do not close, back sides do not close either
        if front > FACES_SHARE or (front == 0.0 and lit_area <= LIT_MOST):
            return Sides(front, lit_area=lit_area)
    behind = again(caster_faces="back", bias="manual")
    back, bias, gain = share(lit, behind), 0.0, 0.0
    # a bias gives light, and no shadow: where too many are lost, it is not asked
    if share(lit, lit | behind) <= FACES_SHARE < back:
        biased = again(caster_faces="back")
        bias, behind = share(behind, biased), biased
        back = share(lit, behind)
    # What back sides alone lose can be what maps that are too coarse shadow by themselves. Of
    # closed solids it is contacts: of 14 real and made pairs with front sides none gained a tenth.
    if lit_area > LIT_NEARLY_ALL and FACES_SHARE < back <= FEW:
        exact = again(finer=FINER)
        wrong = share(lit, exact)
        gain = max(0.0, 1.0 - share(behind, exact) / wrong) if wrong else 0.0
    return Sides(front, back, bias, gain, lit_area)
