"""Every camera under every sun of the real scenes: error beside what theory says it must be.

A pair passes if fewer pixels disagree with the truth than 2 Y + 0.1 %, Y the edge yardstick (the
expected disagreement of a nearest-texel compare along the shadow edges in the picture). Below 100
judged pixels Y means nothing and the pair passes without a figure. Prints a table, writes it as
CSV, and with --pictures a sheet per camera: lit picture, mask, cascades, error, one sun per row.
"""

import csv
import math
import warnings
from pathlib import Path

import numpy as np
from cases import entries, judge, load, note, parsed, parser

import csm
from csm.pictures import (
    cascades_picture,
    error_picture,
    lit_picture,
    mask_picture,
    save_png,
)

FEWEST_JUDGED = 100
SHEET_SHRINK = 2  # block of pixels that becomes one in a sheet
COLUMNS = (
    "scene",
    "camera",
    "sun",
    "in_means",
    "judged",
    "disagreement_pct",
    "mae_pct",
    "yardstick_pct",
    "limit_pct",
    "verdict",
    "warnings",
)


def measure(renderer, scene, pair, size, settings):
    """(record, row of pictures) of one pair; every warning is part of the record."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        case = judge(renderer, scene, *pair.split("/"), size, settings)
    frame, report = case.frame, case.report
    limit = 2.0 * case.yardstick.value + 0.001
    broken = (
        not np.isfinite(frame.mask).all() or not np.isfinite(frame.view_depth[frame.valid]).all()
    )
    verdict = "pass" if report.disagreement < limit else "MISS"
    if report.judged_count < FEWEST_JUDGED:
        verdict = "few"
    record = {
        "judged": report.judged_count,
        "disagreement_pct": 100.0 * report.disagreement,
        "mae_pct": 100.0 * report.mean["total"],
        "yardstick_pct": 100.0 * case.yardstick.value,
        "limit_pct": 100.0 * limit,
        "verdict": "NAN" if broken else verdict,
        "warnings": "; ".join(str(warning.message) for warning in caught),
    }
    terrain = (scene.bounds[1] - scene.bounds[0])[[0, 2]].min() >= 1500.0
    picture = lit_picture(frame, terrain=terrain)
    views = (
        picture,
        mask_picture(frame),
        cascades_picture(frame, picture),
        error_picture(report, picture),
    )
    return record, np.concatenate([shrunk(view) for view in views], axis=1)


def shrunk(picture):
    """The picture at a fraction of its size, by means over blocks."""
    block = SHEET_SHRINK
    height, width = (length // block * block for length in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // block, block, width // block, block, 3)
    return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)


def line(record):
    """One record as a line of the table."""
    name = f"{record['scene'][:14]} {record['camera']} {record['sun']}"
    numbers = "".join(
        f"{record[key]:9.3f}"
        for key in ("disagreement_pct", "mae_pct", "yardstick_pct", "limit_pct")
    )
    mean = "" if record["in_means"] else "  not in means"
    return f"{name:38}{record['judged']:8d}{numbers}  {record['verdict']}{mean}"


def summary(records):
    """Lines about all records."""
    counted = [r for r in records if r["in_means"] and not math.isnan(r["disagreement_pct"])]
    missed = [r for r in records if r["verdict"] in ("MISS", "NAN")]
    yield (
        f"{len(records)} pairs: {len(missed)} above 2 Y + 0.1 %, "
        f"{sum(r['verdict'] == 'few' for r in records)} with fewer than {FEWEST_JUDGED} pixels, "
        f"{sum(bool(r['warnings']) for r in records)} with warnings"
    )
    if counted:
        yield (
            f"mean over the {len(counted)} in means: disagreement "
            f"{np.mean([r['disagreement_pct'] for r in counted]):.3f} %, mean absolute error "
            f"{np.mean([r['mae_pct'] for r in counted]):.3f} %, yardstick "
            f"{np.mean([r['yardstick_pct'] for r in counted]):.3f} %"
        )
    for record in missed:
        yield f"  above: {line(record)}"


def main():
    """Print the table, write the files."""
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--csv", default="all_pairs.csv", metavar="FILE")
    options.add_argument("--pictures", metavar="DIR", type=Path, help="write contact sheets")
    options.add_argument("--only", nargs="+", metavar="SCENE", help="these scenes alone")
    arguments, settings = parsed(options)
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    records = []
    print(f"{'':38}{'judged':>8}{'disagree':>9}{'MAE':>9}{'Y':>9}{'2Y+0.1':>9}  [%]")
    with csm.Renderer(arguments.backend, debug=True) as renderer:
        for name, entry in entries(arguments.scenes).items():
            if arguments.only and name not in arguments.only:
                continue
            scene = load(f"{arguments.scenes}/{entry['file']}")
            sheets = {}
            for pair, facts in entry["pairs"].items():
                camera, sun = pair.split("/")
                record, row = measure(renderer, scene, pair, arguments.size, settings)
                record |= {"scene": name, "camera": camera, "sun": sun}
                record["in_means"] = facts["in_means"]
                records.append(record)
                sheets.setdefault(camera, []).append(row)
                print(line(record), flush=True)
            for camera, rows in sheets.items() if arguments.pictures else ():
                save_png(arguments.pictures / f"{name}_{camera}.png", np.concatenate(rows))
    with open(arguments.csv, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(records)
    print("\n".join(summary(records)))
    note(f"{arguments.csv} written")


if __name__ == "__main__":
    main()
