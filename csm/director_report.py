"""What a director did along its path, and why."""

from dataclasses import dataclass

from .tables import table_html, table_text

__all__ = ["ACTIONS", "DirectorReport", "Look"]

# What is done to a map, as `Frame.info["reuse"]` says it, and in words.
ACTIONS = {"draw": "drawn", "keep": "kept", "add": "added", "scroll": "scrolled"}


@dataclass(frozen=True)
class Look:
    """One look at the scene.

    Attributes
    ----------
    frame : int
        Number of the frame before which it was taken, from 0.
    trigger : str
        What had changed.
    changed : bool
        Whether the settings did.
    reason : str
        Why they changed, or why they stayed.
    ms : float
        That the look took.
    """

    frame: int
    trigger: str
    changed: bool
    reason: str
    ms: float


class DirectorReport:
    """What a director did over its frames; prints as a table, a table in Jupyter too.

    Attributes
    ----------
    frames : int
    maps : dict of str to int
        How many were drawn, kept, added to and scrolled: ``draw``, ``keep``, ``add``, ``scroll``.
    texels_saved, triangles_saved : int
        Neither cleared nor drawn, against drawing every map whole.
    ms_saved : float
        Estimate: of every map the time it took when it was last drawn whole, less what it took.
    ms : float
        Of all frames, without ``readback``.
    decisions : tuple of Look
    """

    _HEADS = ("over the path", "")

    def __init__(self, frames, maps, saved, ms, decisions):
        self.frames = frames
        self.maps = maps
        self.texels_saved, self.triangles_saved, self.ms_saved = saved
        self.ms = ms
        self.decisions = decisions

    @property
    def changes(self):
        """How often the settings changed after the first frame."""
        return sum(one.changed for one in self.decisions if one.frame)

    def _headline(self):
        total = sum(self.maps.values())
        share = 100.0 * (total - self.maps["draw"]) / total if total else 0.0
        return (
            f"{self.frames} frames, {self.ms:.0f} ms; {share:.0f} % of {total} maps not drawn "
            f"whole, {self.ms_saved:.0f} ms saved by estimate"
        )

    def _rows(self):
        rows = [
            (f"maps {word}{' to' if name == 'add' else ''}", f"{self.maps[name]:,}")
            for name, word in ACTIONS.items()
        ]
        rows.append(("texels saved", f"{self.texels_saved:,}"))
        rows.append(("triangles saved", f"{self.triangles_saved:,}"))
        for one in self.decisions:
            what = "changed" if one.changed else "stayed"
            rows.append((f"look before frame {one.frame}", f"{what}: {one.reason} ({one.trigger})"))
        return rows

    def __str__(self):
        return f"{self._headline()}\n\n{table_text(self._HEADS, self._rows(), (None, 90))}"

    def _repr_html_(self):
        return f"<p>{self._headline()}</p>{table_html(self._HEADS, self._rows())}"
