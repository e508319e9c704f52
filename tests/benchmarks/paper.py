"""The paper's tables, measured again: ``python -m tests.benchmarks.paper [TABLE ...] --data DIR``.

table1: scans with a ground truth, beside what Pumarola et al. (VisCo Grids, NeurIPS 2022) print;
ablations: losses left out; sweeps: one setting varied, the others as they are; budget: quality
against time. DIR is laid out as for ``tests.benchmarks.srb``; without it the scans are the
gallery's. The last three tables are of the first scan whose ground truth is a mesh.

Distances are in the scan's own units. d_C and d_H are from points to points, with a fifth of
``--samples`` in the ablations and sweeps from points to triangles, which have no floor. Seconds are
those of the run's own report.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.contest import (
    Case,
    Score,
    add_run_arguments,
    compete,
    print_problems,
    write_report,
)
from tests.benchmarks.peers import Method, ours
from tests.benchmarks.srb import add_data_arguments, data_cases, mean_and_max
from tests.benchmarks.tables import markdown_table, rounded
from visco_core.config import LevelSchedule
from visco_core.presets import PAPER_EPOCHS, PAPER_WEIGHTS
from visco_core.result import Mesh


@dataclass(frozen=True)
class Printed:
    """Distances that the paper prints for one of its time budgets."""

    minutes: int
    d_c: float
    d_h: float


PRINTED = {
    "anchor": (Printed(30, 0.21, 3.00), Printed(8, 0.28, 5.69)),
    "dc": (Printed(30, 0.15, 2.22),),
    "gargoyle": (Printed(30, 0.17, 4.40),),
}
PRINTED_MEANS = {30: Printed(30, 0.182, 2.95), 8: Printed(8, 0.196, 3.53)}
"""Over the paper's five scans; of 30 minutes the mean of its rows, where it prints 0.19."""

ABLATION_VOXELS = 128
NO_VISCOSITY = "--set lambda_v=1e-12"
ABLATIONS = {
    "all losses": "",
    "without the normal loss": "--set lambda_n=0",
    "without viscosity": NO_VISCOSITY,
    "without coarea": "--set lambda_c=0",
}
FAST_ABLATIONS = {
    "all but coarea": "",
    "without the normal loss": "--set lambda_n=0",
    "without viscosity": NO_VISCOSITY,
    "with coarea, 1e-6": "--set lambda_c=1e-6",
}
"""The profile fast has no coarea loss that could be left out."""

SWEEPS = {
    "viscosity_epsilon": (1e-3, 2.5e-3, 5e-3, 1e-2, 2e-2, 5e-2),
    "lambda_v": (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3),
    "lambda_c": (0.0, 1e-8, 1e-7, 1e-6, 1e-5),
    "coarea_beta": (2.5e-3, 5e-3, 1e-2, 2e-2, 5e-2),
}
SWEPT_WITH = {"coarea_beta": f"lambda_c={PAPER_WEIGHTS.coarea}"}
"""β, which the paper does not give, matters only where coarea has a weight."""
BUDGETS = {256: (2, 3, 5, 10), 512: (3, 5, 10, 20)}

TABLE_1_HEADER = (
    *("scan", "method", "d_C", "d_H", "gt to mesh", "max", "scan to mesh", "max"),
    *("IoU", "time"),
)
EFFECT_HEADER = ("mean", "max", "normals", "pieces", "time")
BUDGET_HEADER = ("scan", "voxels", "budget", "reached", "d_C", "d_H", "time")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"{', '.join(TABLES)}; or all")
    add_data_arguments(parser)
    parser.add_argument("--resolution", type=int, default=256, help="voxels a side in table1")
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--iterations", type=int, default=200, help="of the paper profile on each level"
    )
    length.add_argument(
        "--full", action="store_true", help="the paper's 30 minute schedule; wants a CUDA device"
    )
    add_run_arguments(parser)
    parser.set_defaults(repeats=1, no_warm_up=True)
    arguments = parser.parse_args()
    unknown = set(arguments.tables) - set(TABLES)
    if unknown:
        parser.error(f"there is no table {', '.join(unknown)}; known are {', '.join(TABLES)}")
    cases, scores = list(data_cases(arguments)), []
    for name in arguments.tables or TABLES:
        print(f"\n## {name}\n", flush=True)
        found = TABLES[name](cases, arguments)
        print_problems(found)
        scores += found
    if arguments.json:
        write_report(arguments.json, arguments, scores)


def table1(cases: Sequence[Case], arguments: argparse.Namespace) -> list[Score]:
    scores = list(compete(cases, table1_methods(arguments), arguments))
    rows = []
    for case, group in itertools.groupby(scores, key=lambda score: score.case):
        rows += [_table1_row(score) for score in group if score.metrics is not None]
        rows += [_printed_row(case, printed) for printed in PRINTED.get(case, ())]
    if not arguments.full:
        rows.append(_not_run("every scan", f"paper, {_full_length():,} iterations"))
    print(markdown_table(TABLE_1_HEADER, rows))
    return scores


def table1_methods(arguments: argparse.Namespace) -> list[Method]:
    return [
        _reported("fast"),
        _reported("fast, no normals", "--set normals=ignore"),
        _reported("paper", _paper_profile(arguments)),
    ]


def ablations(cases: Sequence[Case], arguments: argparse.Namespace) -> list[Score]:
    case, scores, rows = _with_mesh(cases), [], []
    for base, methods in ablation_methods(arguments).items():
        found = list(compete([case], methods, _small(arguments)))
        rows += [[base, score.method.removeprefix(f"{base} "), *_effect(score)] for score in found]
        scores += found
    length = "at full length" if arguments.full else f"{arguments.iterations} iterations a level"
    print(f"{case.name}, {ABLATION_VOXELS} voxels; the profile paper: {length}.\n")
    print(markdown_table(("solver", "losses", *EFFECT_HEADER), rows))
    return scores


def ablation_methods(arguments: argparse.Namespace) -> dict[str, list[Method]]:
    """By solver and weights: the energy whole, and with a loss left out."""
    bases = {
        "fast": ("", FAST_ABLATIONS),
        "fast, the paper's weights": (_paper_weights(), ABLATIONS),
        "paper": (_paper_profile(arguments), ABLATIONS),
    }
    return {
        base: [
            _reported(f"{base} {label}", f"{options} {less}") for label, less in variants.items()
        ]
        for base, (options, variants) in bases.items()
    }


def sweeps(cases: Sequence[Case], arguments: argparse.Namespace) -> list[Score]:
    case, scores = _with_mesh(cases), []
    print(f"{case.name}, {ABLATION_VOXELS} voxels, profile fast.")
    for option, methods in sweep_methods().items():
        found = list(compete([case], methods, _small(arguments)))
        rows = [[score.method.split("=")[1], *_effect(score)] for score in found]
        heading = ", ".join(filter(None, (option, SWEPT_WITH.get(option))))
        print("\n" + markdown_table((heading, *EFFECT_HEADER), rows))
        scores += found
    return scores


def sweep_methods() -> dict[str, list[Method]]:
    """By option: a method for each of its values, named OPTION=VALUE."""

    def settings(option: str, value: float) -> str:
        asked = (f"{option}={value!r}", SWEPT_WITH.get(option))
        return " ".join(f"--set {setting}" for setting in asked if setting)

    return {
        option: [_reported(f"{option}={value:g}", settings(option, value)) for value in values]
        for option, values in SWEEPS.items()
    }


def budget(cases: Sequence[Case], arguments: argparse.Namespace) -> list[Score]:
    case = _with_mesh(cases)
    scores = list(compete([case], budget_methods(), arguments))
    rows = [_budget_row(score) for score in scores if score.metrics is not None]
    # Distances of scans that the paper does not have are in other units.
    if case.name in PRINTED:
        rows += _printed_budgets(case.name)
    print(markdown_table(BUDGET_HEADER, rows))
    return scores


def budget_methods() -> list[Method]:
    """Named VOXELS in SECONDS."""
    return [
        _reported(f"{voxels} in {seconds}", f"--resolution {voxels} --budget {seconds}")
        for voxels, budgets in BUDGETS.items()
        for seconds in budgets
    ]


TABLES: dict[str, Callable[[Sequence[Case], argparse.Namespace], list[Score]]] = {
    table.__name__: table for table in (table1, ablations, sweeps, budget)
}


def _reported(name: str, options: str = "") -> Method:
    return ours(name, f"--report {{out}}.json {options}")


def _paper_profile(arguments: argparse.Namespace) -> str:
    length = "" if arguments.full else f"--set epochs=1 --set iterations={arguments.iterations}"
    return f"--profile paper {length}"


def _paper_weights() -> str:
    paper = PAPER_WEIGHTS
    return (
        f"--set lambda_p={paper.point} --set lambda_n={paper.normal} "
        f"--set lambda_v={paper.viscosity} --set lambda_c={paper.coarea} "
        f"--set viscosity_epsilon={paper.viscosity_epsilon}"
    )


def _full_length() -> int:
    """Adam iterations of the paper's 30 minute schedule."""
    return sum(PAPER_EPOCHS[30]) * LevelSchedule().iterations


def _small(arguments: argparse.Namespace) -> argparse.Namespace:
    changed = {"resolution": ABLATION_VOXELS, "samples": arguments.samples // 5}
    return argparse.Namespace(**{**vars(arguments), **changed})


def _with_mesh(cases: Iterable[Case]) -> Case:
    for case in cases:
        if isinstance(case.truth, Mesh):
            return case
    raise SystemExit("these tables need a scan with gt/NAME_gt_mesh.ply")


def _report(score: Score) -> dict[str, Any]:
    """What ``visco reconstruct --report`` wrote of a run that made a mesh."""
    return json.loads(Path(f"{score.mesh}.json").read_text(encoding="utf-8"))


def _seconds(report: dict[str, Any]) -> str:
    return f"{report['seconds']:.1f} s"


def _table1_row(score: Score) -> list[str]:
    metrics, report = score.metrics or {}, _report(score)
    done = sum(phase.get("iterations", 0) for phase in report["phases"])
    method = score.method + (f", {done:,} iterations" if score.method == "paper" else "")
    sides = metrics["one_sided"]
    return [
        score.case,
        method,
        rounded(metrics["d_C"], 3),
        rounded(metrics["d_H"], 2),
        *mean_and_max(sides["gt_to_mesh"]),
        *mean_and_max(sides["scan_to_mesh"]),
        rounded(score.iou, 4),
        _seconds(report),
    ]


def _printed_row(scan: str, printed: Printed) -> list[str]:
    distances = [rounded(printed.d_c, 2), rounded(printed.d_h, 2)]
    return [scan, "*as printed*", *distances, *["-"] * 5, f"{printed.minutes} min"]


def _not_run(scan: str, method: str) -> list[str]:
    return [scan, method, *["-"] * 7, "not run: wants a CUDA device and --full"]


def _effect(score: Score) -> list[str]:
    """The cells of ``EFFECT_HEADER``; a run without a mesh has none."""
    if score.metrics is None or score.health is None:
        return ["-"] * len(EFFECT_HEADER)
    sides = [score.metrics["point_to_triangle"][side] for side in ("gt_to_mesh", "mesh_to_gt")]
    return [
        rounded(0.5 * sum(side["mean"] for side in sides), 3),
        rounded(max(side["max"] for side in sides), 2),
        rounded(score.metrics["normal_consistency"], 4),
        str(score.health["components"]),
        _seconds(_report(score)),
    ]


def _budget_row(score: Score) -> list[str]:
    metrics, report = score.metrics or {}, _report(score)
    voxels, seconds = score.method.split(" in ")
    distances = [rounded(metrics["d_C"], 3), rounded(metrics["d_H"], 2)]
    reached = str(report["outcome"]["resolution"])
    return [score.case, voxels, f"{seconds} s", reached, *distances, _seconds(report)]


def _printed_budgets(scan: str) -> list[list[str]]:
    """What the paper prints of ``scan`` and of all its scans, for each of its budgets."""
    rows = []
    for minutes in sorted(PAPER_EPOCHS):
        known = [printed for printed in PRINTED[scan] if printed.minutes == minutes]
        rows += [_printed_budget(scan, minutes, printed) for printed in known]
        rows.append(_printed_budget("mean of five", minutes, PRINTED_MEANS.get(minutes)))
    return rows


def _printed_budget(scan: str, minutes: int, printed: Printed | None) -> list[str]:
    """None: this project has no figure of it."""
    row = [f"*{scan}*", "256", f"{minutes} min", "256"]
    if printed is None:
        return [*row, "-", "-", "*not at hand*"]
    return [*row, rounded(printed.d_c, 3), rounded(printed.d_h, 2), "*as printed*"]


if __name__ == "__main__":
    main()
