"""Tables of a report, as pieces of HTML: what is best, what more costs, what to believe."""

import html

import numpy as np

from .fronts import FEWEST_CASES, best_within, next_halvings, on_front, paired_interval
from .hard_cases import CASES, TESTS_THAT_FAIL, kept_rows
from .techniques import BASELINE

__all__ = ["MIB", "against_baseline", "best_table", "hard_case_table", "technique_table"]

MIB = 2.0**20
MEMORIES_MIB = (4, 16, 64, 256)  # of maps, for the comparison at equal memory
TIMES = (0.5, 1.0, 2.0, 4.0)  # of the baseline's time, for the one at equal time
FLICKERS = {"flicker": "flicker", "flicker_transition": "between cascades"}


def best_table(dataset):
    """Best at each size of memory and at each time, over the mean of all cases.

    Parameters
    ----------
    dataset : xarray.Dataset
        Over case and technique.

    Returns
    -------
    parts : list of str
    """
    names = [str(name) for name in dataset.technique.values]
    dataset = _with_numbers(dataset)
    # what has no numbers in one case has no mean: that of the other cases might be of easier ones
    error, time, memory = (
        dataset[name].mean("case", skipna=False).values
        for name in ("error_total", "ms_total", "bytes_maps")
    )
    memory = memory / MIB
    rows = []
    for mib in MEMORIES_MIB:
        best = best_within(memory, error, 1.01 * mib)
        if best is not None:
            rows.append((f"{mib} MiB of maps", best))
    if BASELINE in names:
        base = time[names.index(BASELINE)]
        for factor in TIMES:
            best = best_within(time, error, factor * base)
            if best is not None:
                rows.append((f"{factor:g} x the time of {BASELINE} ({factor * base:.1f} ms)", best))
    lines = [
        f"<tr><td>{html.escape(budget)}</td><td>{html.escape(names[i])}</td>"
        f"<td class='n'>{error[i]:.3%}</td><td class='n'>{time[i]:.1f}</td>"
        f"<td class='n'>{memory[i]:.1f}</td></tr>"
        for budget, i in rows
    ]
    return [
        "<h2>At equal memory and at equal time</h2>",
        f"<p>The least error within a budget, mean of {dataset.sizes['case']} case(s).</p>",
        "<table><tr><th>budget</th><th>best</th><th>error</th><th>ms</th><th>MiB</th></tr>",
        *lines,
        "</table>",
    ]


def _with_numbers(dataset):
    """The cases that any technique has an error in: not those where no pixel is judged."""
    known = np.isfinite(dataset.error_total).any("technique")
    return dataset.isel(case=np.flatnonzero(known.values))


def technique_table(one):
    """Every technique of a case by error, with what the next halving costs.

    Parameters
    ----------
    one : xarray.Dataset
        Over technique.

    Returns
    -------
    parts : list of str
    """
    names = [str(name) for name in one.technique.values]
    error, time = one.error_total.values, one.ms_total.values
    memory = one.bytes_maps.values / MIB
    halvings = next_halvings(time, error)
    front = on_front(time, error)
    causes = [
        str(name)
        for name in one.data_vars
        if (str(name).startswith("error_") and str(name) != "error_total")
        or str(name) == "expected_aliasing"
    ]
    words = [name.removeprefix("error_").replace("_", " ") for name in causes]
    head = "".join(f"<th>{html.escape(word)}</th>" for word in words)
    moving = [name for name in ("flicker", "flicker_transition") if name in one]
    moving_head = "".join(f"<th>{FLICKERS[name]}</th>" for name in moving)
    rows = []
    for i in np.argsort(np.where(np.isfinite(error), error, np.inf), kind="stable"):
        if not np.isfinite(error[i]):
            status = str(one.message.values[i]) if "message" in one else "no numbers"
            rows.append(
                f"<tr><td>{html.escape(names[i])}</td>"
                f"<td colspan='{5 + len(causes) + len(moving)}'>"
                f"{html.escape(status or 'no pixel was judged')}</td></tr>"
            )
            continue
        next_one = halvings[i]
        text = "none"
        if next_one.index is not None:
            text = f"{html.escape(names[next_one.index])}, {next_one.factor:.2g} x the time"
        numbers = "".join(f"<td class='n'>{float(one[name].values[i]):.3%}</td>" for name in causes)
        flickers = "".join(f"<td class='n'>{_share(one[name].values[i])}</td>" for name in moving)
        rows.append(
            f"<tr{' class=front' if front[i] else ''}><td>{html.escape(names[i])}</td>"
            f"<td class='n'>{error[i]:.3%}</td>"
            f"<td class='n'>{float(one.disagreement.values[i]):.3%}</td>{numbers}{flickers}"
            f"<td class='n'>{time[i]:.1f}{_quartiles(one, i)}</td>"
            f"<td class='n'>{memory[i]:.1f}</td><td>{text}</td></tr>"
        )
    return [
        "<details open><summary>every technique, best first; <b>bold</b>: on the front of error "
        "and time</summary>",
        f"<table><tr><th>technique</th><th>error</th><th>wrong</th>{head}{moving_head}<th>ms</th>"
        "<th>MiB</th><th>cheapest with half the error</th></tr>",
        *rows,
        "</table></details>",
    ]


def _share(value):
    """A share as a percentage; a dash where there is none, as of transitions of one cascade."""
    return f"{float(value):.3%}" if np.isfinite(value) else "–"


def _quartiles(one, i):
    """First and third quartile of a technique's time, where the dataset has them."""
    if "ms_total_q1" not in one or "ms_total_q3" not in one:
        return ""
    low, high = (float(one[f"ms_total_{q}"].values[i]) for q in ("q1", "q3"))
    return f" <span class='note'>{low:.1f} to {high:.1f}</span>"


def against_baseline(dataset):
    """Techniques that differ from the baseline over the cases, and those that tie with it.

    Parameters
    ----------
    dataset : xarray.Dataset
        Over case and technique.

    Returns
    -------
    parts : list of str
        Empty where the baseline is not among the techniques.
    """
    names = [str(name) for name in dataset.technique.values]
    dataset = _with_numbers(dataset)
    if BASELINE not in names:
        return []
    title = f"<h2>Against {BASELINE}, over all cases</h2>"
    count = dataset.sizes["case"]
    if count < FEWEST_CASES:
        return [
            f"{title}<p>{count} case{'s' * (count != 1)} can tell no technique from chance: that "
            f"takes {FEWEST_CASES} or more, since even differences that are all of one sign come "
            "by chance too often with fewer. So there are no verdicts here.</p>"
        ]
    error = dataset.error_total.transpose("case", "technique").values
    base = error[:, names.index(BASELINE)]
    groups = {"better": [], "no different": [], "worse": []}
    for i, name in enumerate(names):
        if name != BASELINE and np.isfinite(error[:, i]).all():
            low, high = paired_interval(error[:, i], base)
            verdict = "better" if high < 0.0 else "worse" if low > 0.0 else "no different"
            groups[verdict].append(name)
    rows = "".join(
        f"<tr><td>{verdict}</td><td>{html.escape(', '.join(found)) or '–'}</td></tr>"
        for verdict, found in groups.items()
    )
    return [
        f"{title}<p>Two techniques differ only if the paired "
        "difference of their errors exceeds its 95 % bootstrap interval, here over "
        f"{count} cases.</p>",
        f"<table>{rows}</table>",
    ]


def hard_case_table(folder):
    """Sum up the matrix of hard cases, a line a case: its figure nearest to the tolerance.

    Parameters
    ----------
    folder : path or None
        That ``csm hard-cases --out`` wrote.

    Returns
    -------
    parts : list of str
        Empty without a folder.

    Raises
    ------
    OSError, ValueError
        If it holds no records.
    """
    if folder is None:
        return [
            "<h2 id='hard-cases'>Hard cases</h2><p>Not measured for this page: <code>csm "
            "hard-cases --out DIR</code> runs them, <code>csm report --hard-cases DIR</code> sums "
            "them up here.</p>"
        ]
    rows = kept_rows(folder)
    lines = []
    for case, title in CASES.items():
        own = [row for row in rows if row.case == case]
        if not own:
            lines.append(
                f"<tr><td>{case}</td><td>{html.escape(title)}</td>"
                "<td colspan='5'>no test ran</td></tr>"
            )
            continue
        passed = all(row.passed for row in own)
        worst = max(own, key=lambda row: (not row.passed, row.used))
        cases = sum(row.cases for row in own if row.what == TESTS_THAT_FAIL)
        lines.append(
            f"<tr><td>{case}</td><td>{html.escape(title)}</td>"
            f"<td>{'passed' if passed else '<b>failed</b>'}</td><td class='n'>{cases}</td>"
            f"<td>{html.escape(worst.what)}</td><td class='n'>{worst.worst:.3g} of "
            f"{worst.tolerance:.3g} {html.escape(worst.unit)}</td>"
            f"<td>{html.escape(', '.join(sorted({row.backend for row in own})))}</td></tr>"
        )
    return [
        "<h2 id='hard-cases'>Hard cases</h2><p>Can the numbers above be trusted where shadow maps "
        "are known to break? Each line is a family of tests with tolerances from theory; shown is "
        "the figure that comes nearest to its tolerance.</p>",
        "<table><tr><th></th><th>case</th><th></th><th>tests</th><th>nearest to its tolerance"
        "</th><th>figure</th><th>back ends</th></tr>",
        *lines,
        "</table>",
    ]
