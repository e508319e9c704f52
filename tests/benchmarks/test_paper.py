"""The paper's tables and the pictures, made as a user makes them, of a ball."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.benchmarks import gallery_scans, paper, pictures
from tests.benchmarks.srb import data_cases
from visco_core import gallery
from visco_core.commands.reconstruct import add_arguments
from visco_core.commands.values import option_values
from visco_core.config import ReconstructionConfig
from visco_core.gallery import uniform_scan
from visco_core.metrics import point_to_mesh_distance

SHORT = argparse.Namespace(full=False, iterations=5)


def run_main(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["paper", *words])
    paper.main()


def cells(printed: str, start: str) -> list[str]:
    line = next(line for line in printed.splitlines() if line.startswith(start))
    return [cell.strip() for cell in line.strip("|").split("|")]


def call_it_anchor(data: Path) -> None:
    for path in (*data.glob("scans/*"), *data.glob("gt/*")):
        path.rename(path.with_name(path.name.replace("ball", "anchor")))


@pytest.mark.parametrize("full", [False, True])
def test_visco_accepts_every_run_that_the_tables_ask_for(tmp_path: Path, full: bool) -> None:
    arguments = argparse.Namespace(full=full, iterations=5)
    groups = [
        paper.table1_methods(arguments),
        *paper.ablation_methods(arguments).values(),
        *paper.sweep_methods().values(),
        paper.budget_methods(),
    ]
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    for method in (method for group in groups for method in group):
        _, _, *words = method.arguments(tmp_path / "scan.ply", tmp_path / "out.ply", 256)
        asked = parser.parse_args(words)
        config = ReconstructionConfig.from_options(option_values(asked.settings))
        assert asked.report == tmp_path / "out.ply.json"
        if asked.profile == "paper":
            assert (config.schedule.epochs is None) == full


def test_an_ablation_differs_from_the_whole_in_one_weight() -> None:
    for methods in paper.ablation_methods(SHORT).values():
        whole, *others = (method.command.split("--set ") for method in methods)
        options = {text.strip() for text in whole}
        for other in others:
            assert len({text.strip() for text in other} - options) == 1


def test_table_1_puts_what_the_paper_prints_beside_ours_and_says_what_did_not_run(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    call_it_anchor(data)
    run_main(
        monkeypatch,
        *("table1", "--data", str(data), "--work", str(data / "work"), "--resolution", "64"),
        *("--iterations", "5", "--samples", "20000", "--json", str(data / "report.json")),
    )
    printed = capsys.readouterr().out
    fast = cells(printed, "| anchor     | fast ")
    assert float(fast[2]) < 0.05
    assert cells(printed, "| anchor     | paper, 5 iterations")[2:4] != fast[2:4]
    assert cells(printed, "| anchor     | *as printed*")[2:4] == ["0.21", "3.00"]
    not_run = cells(printed, "| every scan ")
    assert not_run[1] == "paper, 166,400 iterations"
    assert not_run[-1].startswith("not run")
    scores = json.loads((data / "report.json").read_text())["scores"]
    assert [score["method"] for score in scores] == ["fast", "fast, no normals", "paper"]


def test_the_budget_table_says_which_resolution_was_reached_in_the_reports_own_seconds(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paper, "BUDGETS", {64: (60,)})
    call_it_anchor(data)
    run_main(
        monkeypatch,
        *("budget", "--data", str(data), "--work", str(data / "work"), "--samples", "20000"),
    )
    printed = capsys.readouterr().out
    ours = cells(printed, "| anchor ")
    report = json.loads((data / "work" / "anchor.64 in 60.ply.json").read_text())
    assert ours[1:4] == ["64", "60 s", "64"]
    assert ours[-1] == f"{report['seconds']:.1f} s"
    assert cells(printed, "| *anchor*       | 256    | 8 min")[4:6] == ["0.280", "5.69"]
    assert cells(printed, "| *mean of five* | 256    | 30 min")[4:6] == ["0.182", "2.95"]


def test_the_gallery_stands_in_for_data_and_its_scans_lie_on_their_ground_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery_scans, "_TRUTH_RESOLUTION", 96)
    gallery_scans.write_gallery(tmp_path)
    arguments = argparse.Namespace(data=tmp_path, scans="")
    assert [case.name for case in data_cases(arguments)] == ["bracket", "bumpy_torus", "octopus"]
    cloud, truth = pictures.holey_scan()
    assert np.median(point_to_mesh_distance(cloud.points, truth)) < 1e-3 * np.ptp(truth.vertices)


def test_a_slice_through_a_ball_is_blue_inside_and_its_points_are_red(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pictures, "SLICE_VOXELS", 64)
    cloud = uniform_scan(gallery.sphere(), 4000)
    # Without its right half, so that the picture shows which way x points.
    kept = cloud.select(cloud.points[:, 0] < 0.5)
    picture = pictures.level_set_slice(kept, {}).astype(int)
    middle, side = picture.shape[0] // 2, picture.shape[1]
    red, _, blue = picture[middle, middle]
    assert blue > red
    corner = picture[5, 5]
    assert corner[0] > corner[2]
    reddish = (picture[..., 0] - picture[..., 1] > 90).nonzero()[1]
    assert reddish.min() < 0.2 * side
    assert reddish.max() < 0.95 * side


def test_small_pictures_keep_white_and_their_size(tmp_path: Path) -> None:
    disc = np.zeros((60, 80, 4), np.uint8)
    disc[20:40, 20:40] = (200, 60, 50, 255)
    whole = pictures.side_by_side([disc, disc], ["left", "right"])
    pictures.write_small(whole, tmp_path / "small.png")
    read = np.asarray(Image.open(tmp_path / "small.png").convert("RGB"))
    assert read.shape[:2] == (whole.height, whole.width)
    assert (read[0] == 255).all()
    assert np.abs(read[30, 30].astype(int) - (200, 60, 50)).max() < 8
