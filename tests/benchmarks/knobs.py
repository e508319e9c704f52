"""The chosen λv against fixed ones: ``python -m tests.benchmarks.knobs --meshes DIR``.

The scans and the error are those of ``tests.benchmarks.synthetic``; a fixed λv stands on every
level. The last column is the chosen one's error as a share of the best fixed one's.
"""

from __future__ import annotations

import argparse

from tests.benchmarks.contest import Case, add_run_arguments
from tests.benchmarks.peers import PEERS, Method, run_method
from tests.benchmarks.synthetic import add_scan_arguments, synthetic_cases, thousandths
from tests.benchmarks.tables import markdown_table, rounded
from visco_core.config import LossWeights, ReconstructionConfig
from visco_core.io import read_mesh, read_points
from visco_core.metrics import evaluate
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh

FIXED = tuple(10.0**power for power in range(-6, 0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scan_arguments(parser, points="5000,50000", noise="0,0.001,0.005,0.01")
    parser.add_argument("--resolution", type=int, default=256)
    add_run_arguments(parser)
    parser.set_defaults(samples=60_000)
    arguments = parser.parse_args()
    rows = []
    for case in synthetic_cases(arguments):
        rows.append(_row(case, arguments))
        print(*rows[-1], flush=True)
    fixed = (f"{viscosity:g}" for viscosity in FIXED)
    header = ["surface", "points", "noise", "open3d", "chosen", "λv", *fixed, "chosen / best"]
    print(f"\n{markdown_table(header, rows)}")


def _row(case: Case, arguments: argparse.Namespace) -> list[str]:
    scan = read_points(case.scan)

    def solved(**weights: float) -> tuple[float, float]:
        """The error, and λv of the finest level."""
        config = ReconstructionConfig(
            resolution=arguments.resolution, weights=LossWeights(**weights)
        )
        found = reconstruct(scan, config)
        return error(found.mesh), found.report["settings"]["weights"][-1]["viscosity"]

    def error(mesh: Mesh) -> float:
        assert case.truth is not None
        metrics = evaluate(mesh, case.truth, samples=arguments.samples)
        return thousandths(metrics, case.tags["diagonal"], "mean")

    out, open3d = case.scan.with_suffix(".open3d.ply"), Method("open3d", PEERS["open3d"])
    run_method(open3d, case.scan, out, arguments.resolution, arguments.timeout)
    chosen, viscosity = solved()
    fixed = [solved(viscosity=each)[0] for each in FIXED]
    return [
        case.tags["surface"],
        str(case.tags["points"]),
        f"{100 * case.tags['noise']:g} %",
        rounded(error(read_mesh(out)), 3),
        rounded(chosen, 3),
        f"{viscosity:.1e}",
        *(rounded(each, 3) for each in fixed),
        rounded(chosen / min(fixed), 3),
    ]


if __name__ == "__main__":
    main()
