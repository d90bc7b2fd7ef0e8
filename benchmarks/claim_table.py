"""The table of claims: what a source says, what is measured, and which numbers are what it says."""

import math
from dataclasses import dataclass, field

import claim_filters
import claim_measures
import claim_times
from claim_verdicts import Rule

BETTER = Rule(0.0, 0.95)  # a ratio of errors, at least a twentieth less


@dataclass(frozen=True)
class Claim:
    """What a source says, what is measured, and which numbers would be what it says."""

    id: str
    title: str
    source: str
    says: str
    measured: str
    value: str  # what a case's number is, in a few words
    states: str  # the rule in words
    rule: Rule
    measure: object = field(repr=False)  # function, Bench to list of Case
    why: str
    timed: bool = False


CLAIMS = (
    Claim(
        id="stabilisation-area",
        title="Exact stabilisation wastes 2.8 to 4.0 times the area",
        source="[Zhang2009] 4.1, exact solution",
        says=(
            'a "considerable portion" of the map is wasted by spheres. The text has no figure; '
            "2.8 to 4.0 times was handed to us without a source."
        ),
        measured=(
            "area of the window of `fit=sphere, snap=exact` over that of a tight one that is not "
            "stabilised, mean of four cascades: the box along light x and y (`fit=box`), and the "
            "smallest turned rectangle. 40 suns over the sky for fields of view of 45°, 60° and "
            "90°, and all views."
        ),
        value="area, sphere over tight",
        states="2.8 to 4.0 in four fifths of the cases",
        rule=Rule(2.8, 4.0, "range"),
        measure=claim_measures.stabilisation_area,
        why=(
            "A slice seen end-on is as wide as it is high, and the square round its sphere is "
            "little more than twice its box; seen from the side it is thin, and the ratio has no "
            "bound as the slice gets flatter. The range asked about is that of light across the "
            "view against the smallest rectangle. A square of the slice's diameter is as stable "
            "and never larger."
        ),
    ),
    Claim(
        id="blend-branching",
        title="Blending between cascades costs 15 % more where shaders branch",
        source="[Stone]",
        says='"only increased costs by about 15%" with good dynamic branching.',
        measured=(
            "time of the mask's pass with `blend=linear` over that without; only pixels in a "
            "transition look up a second cascade. 4 x 1024²."
        ),
        value="time, blend over none",
        states="1.075 to 1.225, half of the increase to one and a half times it",
        rule=Rule(1.075, 1.225),
        measure=claim_times.blend_branching,
        why="WHY",
        timed=True,
    ),
    Claim(
        id="blend-both",
        title="Blending costs 40 % more where shaders do not branch",
        source="[Stone]",
        says='without branching "the cost of applying shadows grew by 40%".',
        measured=(
            "the same with csm's own shaders less the one branch: both cascades are looked up "
            "for every pixel and weighted, with a weight of 0 outside of transitions. The "
            "pictures are equal to the bit, or the measurement stops."
        ),
        value="time, both over none",
        states="1.2 to 1.6, half of the increase to one and a half times it",
        rule=Rule(1.2, 1.6),
        measure=claim_times.blend_both,
        why="WHY",
        timed=True,
    ),
    Claim(
        id="more-cascades-error",
        title="More, smaller maps are better: 5 x 640² against 3 x 1024²",
        source="[Stone]",
        says=(
            'five maps "increase the effective shadow map resolution" over three of 1024². Those '
            "were perspective maps with splits by hand; here both are plain ones."
        ),
        measured=(
            "error of 5 x 640² over that of 3 x 1024², hard compare, with the same splits. Five "
            "have 0.65 of the texels. The near plane is put at half the depth of the nearest "
            "receivers. Cascades of equal ratio have finer texels by five than by three if the "
            "range reaches more than (1024/640)^7.5 = 34 times its near end: the condition, "
            "refined after a trial run."
        ),
        value="error, five over three",
        states="at most 0.95",
        rule=BETTER,
        measure=claim_measures.more_cascades_error,
        why="WHY",
    ),
    Claim(
        id="more-cascades-cost",
        title="5 x 640² cost half of 3 x 1024²",
        source="[Stone]",
        says='"half the cost" of three perspective maps that were looked up one by one.',
        measured=(
            "time of a whole frame with 5 x 640² over that with 3 x 1024²; both look up one "
            "cascade a pixel."
        ),
        value="time, five over three",
        states="at most 0.6",
        rule=Rule(0.0, 0.6),
        measure=claim_times.more_cascades_cost,
        why="WHY",
        timed=True,
    ),
    Claim(
        id="vsm-no-cheaper",
        title="Variance maps are no cheaper than good PCF for large outdoor cascades",
        source="[Stone]",
        says='their "performance was only equal" to eight Poisson taps.',
        measured=(
            "time of a whole frame with `filter=vsm` over that with compares under a kernel as "
            "wide, outdoors. Beside it the errors against a sun of 0.53°."
        ),
        value="time, variance over compares",
        states="at least 0.95",
        rule=Rule(0.95, math.inf),
        measure=claim_times.variance_maps,
        why="WHY",
        timed=True,
    ),
    Claim(
        id="splits-uniform",
        title="Practical splits beat uniform ones",
        source="[Zhang2006], [Zhang2009]",
        says='the practical scheme "provides a practical solution".',
        measured=(
            "error with `split=practical` (λ = 0.5) over that with `uniform`, 4 x 1024²; each "
            "view with its own near plane and with one at half the depth of the nearest "
            "receivers."
        ),
        value="error, practical over uniform",
        states="at most 0.95",
        rule=BETTER,
        measure=claim_measures.splits_uniform,
        why="WHY",
    ),
    Claim(
        id="splits-logarithmic",
        title="Practical splits beat logarithmic ones",
        source="[Zhang2006], [Zhang2009]",
        says="the same; logarithmic splits are optimal in theory and too short near the eye.",
        measured=(
            "error with `split=practical` (λ = 0.5) over that with `logarithmic`, the same "
            "views. The condition, refined after a trial run: logarithmic cascades that end "
            "before the nearest hundredth of the receivers."
        ),
        value="error, practical over logarithmic",
        states="at most 0.95",
        rule=BETTER,
        measure=claim_measures.splits_logarithmic,
        why="WHY",
    ),
    Claim(
        id="map-selection",
        title="Selection by map gains most when light and view are parallel",
        source="[Zhang2009] 4.1, [MSDN]",
        says=(
            'interval selection is not optimal "once the light becomes almost parallel" to the '
            "view."
        ),
        measured=(
            "how much finer texels are under `select=map` than under `interval`, in levels "
            "(log2), mean over all that is seen; light 5° from the view less light 85° from it. "
            "30° and 60° lie between, in the JSON with the ratios of the errors."
        ),
        value="levels gained, 5° less 85°",
        states="at least 0.1 levels more",
        rule=Rule(0.1, math.inf, "difference"),
        measure=claim_measures.map_selection,
        why="WHY",
    ),
    Claim(
        id="warping",
        title="Warping with partitioning beats larger maps",
        source="[Lloyd2006] as it is commonly cited",
        says=(
            "a warp in each cascade lowers the error more than texels do. We read it in the "
            "paper's own measure too, the coarsest texels."
        ),
        measured=(
            "LiSPSM in each of 4 x 512² over 4 x 1024² without warp, which has four times the "
            "texels; box fits, not snapped, near plane at half the depth of the nearest receivers: "
            "mean error, and the length of texels in pixels that 1 % of the receivers exceed. "
            "Beside them 4 x 512² and 1 x 2048² without warp. That the camera looks along the "
            "ground is a condition refined after a trial run."
        ),
        value="warped over larger",
        states="at most 0.95",
        rule=BETTER,
        measure=claim_measures.warping,
        why="WHY",
    ),
    Claim(
        id="light-bleeding",
        title="Light bleeding falls with resolution",
        source="[MSDN]",
        says='bleeding of variance maps is "lessened by using higher resolution textures".',
        measured=(
            "light leaks (the cause of `csm.compare`) of 4 x 1024² over those of 4 x 512², "
            "`filter=vsm`: with 3 x 3 texels both times, and with a kernel as wide in metres (7 "
            "x 7 at 1024, as bilinear lookups add a texel)."
        ),
        value="leak, 1024² over 512²",
        states="at most 0.9",
        rule=Rule(0.0, 0.9),
        measure=claim_filters.light_bleeding,
        why="WHY",
    ),
    Claim(
        id="sixteen-bits",
        title="16-bit depths need the quantum's bias and no more",
        source="[theomader]; csm's closed form",
        says=(
            'fewer bits have a "high quantization error" that bias hides; in closed form half a '
            "quantum does."
        ),
        measured=(
            "the least of 0, ¼, ½, 1 and 2 quanta of constant bias with which a D16 map shows no "
            "more acne than a D32F one without (receiver plane and a quarter texel of slope in "
            "both; one map of 2048²), in the scene's depth range and in one 16 times as long. "
            "The condition, refined after a trial run: on how many receivers half a quantum "
            "exceeds the slope's bias."
        ),
        value="quanta needed",
        states="¼ to 1 in four fifths of the cases",
        rule=Rule(0.25, 1.0, "range"),
        measure=claim_filters.sixteen_bits,
        why="WHY",
    ),
    Claim(
        id="seams",
        title="One cascade a quad, or analytic gradients, remove the seam",
        source="[Zhang2009] 4.1 (PSVSM), [MSDN]",
        says='the method of PSVSM "solves this problem well"; so do derivatives in light space.',
        measured=(
            "what `gradients=quad` and `analytic` leave of the error that a seam adds under "
            "`hardware`; `filter=vsm`, 4 x 1024², selection by interval. What a seam adds is the "
            "error of pixels in quads of two cascades less that of the same pixels with all "
            "splits a tenth farther and a tenth nearer. (Pixels beside the seam, the first "
            "measure, lie on other surfaces.)"
        ),
        value="share of the seam left",
        states="at most 0.2",
        rule=Rule(-math.inf, 0.2, "difference"),
        measure=claim_filters.seams,
        why="WHY",
    ),
)
