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
            "Seen end-on a slice is as wide as it is high, and the square round its sphere is "
            "little more than twice its box; seen from the side it is thin, and the ratio has no "
            "bound as the slice gets flatter. What was asked about is nearest to light across "
            "the view, over the smallest rectangle: the mean lies in the range there, and less "
            "than half of the cases do. A square of the slice's diameter is as stable and never "
            "larger."
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
        why=(
            "Few receivers lie in a transition (the share is above), so that hardware which "
            "skips the second lookup elsewhere pays for little more than choosing two cascades. "
            "llvmpipe, a rasteriser on the CPU, gains nothing by the branch: with it the mask "
            "costs about what it costs without (next claim), even in a view that has no "
            "transition at all, as of a driver that runs both sides under a mask. An H200 does "
            "branch: the mask's times stand beside each view. What is left of the increase is "
            "finding a point's place in its cascade, which next to so few taps is no small part; "
            "of a whole frame it is a few per cent."
        ),
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
        why=(
            "Each pixel looks up two maps instead of one, and chooses two cascades. The more of "
            "the pass is lookups, the nearer that is to twice the time; what all pixels pay "
            "anyway, reading the receiver and finding its cascade, keeps it below."
        ),
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
        why=(
            "Below the bound five maps have coarser texels than three, and more error in every "
            "view. Above it they win in most views with logarithmic splits; with practical ones, "
            "whose slices are not of equal ratio, they hardly differ. Stone's game looked "
            "hundreds of metres far from the player's hands, with splits at 4 m and 100 m that "
            "left its second map a ratio of 25 to cover."
        ),
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
        why=(
            "Both look up one map a pixel, so that only drawing differs: 0.65 of the texels, but "
            "two more passes over the casters, which weigh more where casters are many or "
            "vertices dear, as on llvmpipe. The half was that of leaving "
            "perspective maps and three separate lookups, in the same rewrite."
        ),
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
        why=(
            "Variance maps are paid for by the texel, all of them, however few the picture looks "
            "up, and by the width of the blur; compares by the pixel and by the tap. On llvmpipe "
            "eight taps, and 9 x 9 gathered ones, cost less than making moments and blurring "
            "them, and the more so the larger the maps; on an H200 they are much nearer to each "
            "other. 25 x 25 compares cost more. Looking up is cheaper with variance "
            "in every row (the mask alone), as was promised of it. In error it is no worse here "
            "than compares under an equal kernel: what weighed against it in the source was how "
            "it leaks."
        ),
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
        why=(
            "Where most receivers are near, a uniform first slice gives them all one coarse map. "
            "The exceptions look a kilometre and more far, with receivers from a few metres on "
            "(the driver on the long road, the row of columns): there the first cascade is a "
            "hundred metres long and more under both schemes, and only a larger λ would help. "
            "Where the picture begins far away, all schemes cut similar slices."
        ),
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
        why=(
            "Logarithmic cascades begin at the near plane. Where it lies far before all that is "
            "seen, two or three of four maps show nothing, and the uniform half of the practical "
            "scheme mends that. With the near plane at what is seen the practical scheme has "
            "several times the error: the claim is one about near planes."
        ),
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
        why=(
            "With light and view in line the windows of all slices are concentric, and the first "
            "one holds the middle of everything behind it. Across the view tight boxes lie side "
            "by side and there is little to gain; spheres overlap anyway, so that selection by "
            "map gains there too, only less. Where one cascade holds nearly all of the picture "
            "(the fence) hardly anything is gained at any angle."
        ),
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
            "texels; box fits, not snapped, near plane at half the depth of the nearest "
            "receivers: mean error, and the length of texels in pixels that 1 % of the receivers "
            "exceed. Beside them 4 x 512² and 1 x 2048² without warp. That the camera looks "
            "along the ground is a condition refined after a trial run."
        ),
        value="warped over larger",
        states="at most 0.95",
        rule=BETTER,
        measure=claim_measures.warping,
        why=(
            "A warp evens out texels between the two ends of a slice. With the light across the "
            "view it brings the coarsest texels to about those of maps with four times as many, "
            "the paper's point and by its own measure: they are finer in most views along the "
            "ground, whose slices are long, and in few from above. The mean error follows in half "
            "of the views along the ground, those whose shadows lie far away; in the others it "
            "is no better than that of maps of the same size without a warp. With the "
            "light from behind the camera there is nothing to even out, and the warped window is "
            "only larger. More texels help in every view."
        ),
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
        why=(
            "The bound leaks where two depths lie under one kernel. With the same texels a finer "
            "map has a kernel of half the width, so that this happens along narrower strips; "
            "with a kernel of the same metres both maps see the same depths, and the rest "
            "differs from scene to scene: other leaks, as of thin casters that a coarse map "
            "misses, count in it too. It is the kernel that has to get smaller, not the texel."
        ),
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
        why=(
            "On surfaces that lean against the light the slope's quarter texel is more than half "
            "a quantum: there D16 shows the acne of D32F without any further bias, and so it "
            "does everywhere in these scenes' own depth ranges. Where the range is long and "
            "surfaces face the sun the quantum counts; half of one was enough in every case, and "
            "more only loosens shadows from their casters."
        ),
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
        why=(
            "Both remove it, whatever the lookup: what is left is next to nothing in the mean, "
            "and of either sign in single views. Quads take one cascade and keep the hardware's "
            "differences, so that their pixels have the error that hardware has elsewhere; "
            "analytic gradients have less of it at edges, too."
        ),
    ),
)
