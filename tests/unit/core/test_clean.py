"""Cleaning: what is dropped, what never is, and when no surface can be made."""

from __future__ import annotations

import numpy as np
import pytest
from io_files import sphere

from visco_core.clean import clean_points
from visco_core.errors import InputError
from visco_core.gallery import SHAPES, add_outliers, flip_normals, uniform_scan, vary_density
from visco_core.pointcloud import PointCloud


def cloud_of(points: np.ndarray, **extra) -> PointCloud:
    return PointCloud(np.asarray(points, np.float64), **extra)


def test_a_clean_scan_comes_back_as_it_was() -> None:
    points, normals, colors = sphere()

    cleaned, report = clean_points(PointCloud(points, normals, colors))

    assert np.array_equal(cleaned.points, points)
    assert np.allclose(cleaned.normals, normals, atol=1e-6)  # type: ignore[arg-type]
    assert np.array_equal(cleaned.colors, colors)  # type: ignore[arg-type]
    assert report.sentences == []
    assert (report.read, report.kept) == (200, 200)


def test_points_that_are_not_finite_are_dropped() -> None:
    points, normals, _ = sphere()
    points[3, 1], points[5, 0], points[8, 2] = np.nan, np.inf, -1e300

    cleaned, report = clean_points(PointCloud(points, normals))

    assert report.not_finite == 3
    assert np.array_equal(cleaned.points, np.delete(points, [3, 5, 8], axis=0))


def test_exact_duplicates_are_merged_at_their_first_place() -> None:
    points, _, colors = sphere(50)
    order = np.concatenate([np.arange(50), [7, 7, 3]])
    first = colors[order].copy()
    first[50:] = 0

    cleaned, report = clean_points(PointCloud(points[order], colors=first))

    assert report.duplicates == 3
    assert np.array_equal(cleaned.points, points)
    assert np.array_equal(cleaned.colors, colors)  # type: ignore[arg-type]


def test_zero_and_minus_zero_are_one_position_and_the_smallest_step_is_two() -> None:
    points = np.array([[0.0, 0, 0], [-0.0, 0, -0.0], [5e-324, 0, 0], [1, 0, 0], [0, 1, 0]])

    cleaned, report = clean_points(cloud_of(points))

    assert report.duplicates == 1
    assert len(cleaned) == 4


def test_the_normals_of_duplicates_are_averaged() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]], float)
    normals = np.array([[1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0]], np.float32)

    cleaned, _ = clean_points(PointCloud(points, normals))

    assert np.allclose(cleaned.normals[0], [0.5**0.5, 0.5**0.5, 0])  # type: ignore[index]


def test_merging_agrees_with_numpy_on_many_random_duplicates() -> None:
    points = np.random.default_rng(3).integers(0, 12, (5000, 3)).astype(float)

    cleaned, _ = clean_points(cloud_of(points))

    _, first = np.unique(points, axis=0, return_index=True)
    assert np.array_equal(cleaned.points, points[np.sort(first)])


def test_missing_normals_are_taken_from_the_nearest_point() -> None:
    points, normals, _ = sphere()
    broken = normals.copy()
    broken[::10] = 0
    broken[5] = np.nan

    cleaned, report = clean_points(PointCloud(points, broken))

    assert report.filled_normals == 21
    assert (np.einsum("pi,pi->p", cleaned.normals, normals) > 0.9).all()  # type: ignore[arg-type]


def test_normals_are_left_out_where_most_are_missing() -> None:
    points, normals, _ = sphere()
    normals[:120] = 0

    cleaned, report = clean_points(PointCloud(points, normals))

    assert cleaned.normals is None
    assert report.dropped_normals
    assert report.sentences == ["Most normals are zero or not finite, so all were left out."]


def test_normals_of_any_length_become_unit() -> None:
    points, normals, _ = sphere()
    lengths = np.geomspace(1e-15, 1e15, 200, dtype=np.float32)[:, None]

    cleaned, report = clean_points(PointCloud(points, normals * lengths))

    assert report.rescaled_normals == 200
    assert np.allclose(cleaned.normals, normals, atol=1e-6)  # type: ignore[arg-type]


def test_normals_that_point_to_the_wrong_side_are_turned_unless_they_are_to_be_kept() -> None:
    surface = uniform_scan(SHAPES["octopus"](), 5000)
    cloud = flip_normals(surface, 0.1)

    cleaned, report = clean_points(cloud)
    kept, silent = clean_points(cloud, normals="keep")

    assert np.allclose(cleaned.normals, surface.normals, atol=1e-6)  # type: ignore[arg-type]
    assert np.allclose(kept.normals, cloud.normals, atol=1e-6)  # type: ignore[arg-type]
    (sentence,) = report.sentences
    assert f"{report.turned_normals:,} of 5,000; normals=keep" in sentence
    assert silent.sentences == []


@pytest.mark.parametrize("mode", ["estimate", "ignore"])
def test_normals_that_will_not_be_used_are_left_out_without_a_word(mode: str) -> None:
    points, normals, _ = sphere()

    cleaned, report = clean_points(PointCloud(points, normals), normals=mode)  # type: ignore[arg-type]

    assert cleaned.normals is None
    assert report.sentences == []


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e7])
@pytest.mark.parametrize("distance", [20.0, 1e3, 1e9])
def test_far_and_lonely_points_are_strays(scale: float, distance: float) -> None:
    body = sphere(1000)[1].astype(np.float64)
    directions = np.array([[1, 0, 0], [0, -1, 0], [0.6, 0, 0.8]])
    points = np.concatenate([directions[:1] * distance, body, directions[1:] * distance * 2])

    cleaned, report = clean_points(cloud_of(points * scale + 3 * scale))

    assert report.outliers == 3
    assert np.array_equal(cleaned.points, body * scale + 3 * scale)


@pytest.mark.parametrize("members", [10, 300, 1000])
@pytest.mark.parametrize("distance", [20.0, 1e4])
def test_a_second_body_is_never_a_stray(members: int, distance: float) -> None:
    body, second = sphere(1000)[1].astype(float), sphere(members)[1].astype(float)

    cleaned, report = clean_points(cloud_of(np.concatenate([body, second + distance])))

    assert report.outliers == 0
    assert len(cleaned) == 1000 + members


def test_points_a_few_radii_away_are_no_strays() -> None:
    body = sphere(1000)[1].astype(float)

    _, report = clean_points(cloud_of(np.concatenate([body, [[5, 0, 0], [0, 0, -8]]])))

    assert report.outliers == 0


def test_a_marker_at_the_origin_repeated_for_every_lost_ray_is_one_stray() -> None:
    body = sphere(1000)[1] + np.array([5e5, 5e6, 100.0])

    cleaned, report = clean_points(cloud_of(np.concatenate([body, np.zeros((400, 3))])))

    assert (report.duplicates, report.outliers) == (399, 1)
    assert np.array_equal(cleaned.points, body)


@pytest.mark.parametrize("share", [0.001, 0.004])
def test_a_few_points_in_a_thousand_between_surfaces_are_dropped_too(share: float) -> None:
    surface = uniform_scan(SHAPES["octopus"](), 20_000)
    report = clean_points(add_outliers(surface, share))[1]
    assert 0.8 * share * 20_000 < report.scattered < 1.1 * share * 20_000


@pytest.mark.parametrize("shape", ["sphere", "octopus", "bracket"])
def test_points_scattered_between_surfaces_are_dropped_and_the_surface_is_kept(shape: str) -> None:
    surface = uniform_scan(SHAPES[shape](), 20_000)
    cloud = add_outliers(surface, 0.05)
    kept, report = clean_points(cloud)
    assert report.scattered > 850
    assert any("on none of them" in sentence for sentence in report.sentences)
    lost = set(map(tuple, surface.points)) - set(map(tuple, kept.points))
    assert len(lost) < 20


@pytest.mark.parametrize("shape", ["octopus", "bracket"])
def test_points_scattered_between_surfaces_are_dropped_without_normals_too(shape: str) -> None:
    surface = uniform_scan(SHAPES[shape](), 20_000, noise=0.001)
    kept, report = clean_points(PointCloud(add_outliers(surface, 0.05).points))
    assert report.scattered > 850
    lost = set(map(tuple, surface.points)) - set(map(tuple, kept.points))
    assert len(lost) < 20


def test_what_hides_among_other_scattered_points_is_found_when_they_are_gone() -> None:
    octopus = SHAPES["octopus"]()
    cloud = add_outliers(uniform_scan(octopus, 20_000), 0.2)
    off = np.abs(octopus.sdf(cloud.points[20_000:])) > 0.03 * octopus.diagonal
    left = clean_points(PointCloud(cloud.points))[0].points
    missed = set(map(tuple, left)) & set(map(tuple, cloud.points[20_000:][off]))
    assert len(missed) < 0.02 * off.sum()


def test_points_are_judged_once_more_when_the_usual_distance_has_fallen() -> None:
    """Of as many outliers as surface points; looking only at those that lost neighbours, 37."""
    bracket = SHAPES["bracket"]()
    cloud = add_outliers(uniform_scan(bracket, 20_000), 1.0)
    left = clean_points(PointCloud(cloud.points))[0].points
    assert (np.abs(bracket.sdf(left)) > 0.03 * bracket.diagonal).sum() < 30


@pytest.mark.parametrize("shape", ["octopus", "bracket"])
def test_no_group_of_points_far_from_the_surface_is_left(shape: str) -> None:
    body = SHAPES[shape]()
    cloud = add_outliers(uniform_scan(body, 100_000, noise=0.0003), 0.2)
    kept = clean_points(PointCloud(cloud.points))[0].points
    assert np.abs(body.sdf(kept)).max() < 0.01 * body.diagonal


@pytest.mark.parametrize("shape", ["octopus", "thin_plate"])
def test_sparse_surface_is_kept_without_normals_too(shape: str) -> None:
    surface = uniform_scan(SHAPES[shape](), 20_000, noise=0.001)
    cloud = vary_density(surface, 100.0)
    assert clean_points(PointCloud(cloud.points))[1].scattered == 0


@pytest.mark.parametrize("shape", ["sphere", "octopus", "bracket", "thin_plate"])
def test_no_point_of_a_surface_is_scattered_however_noisy_or_badly_oriented(shape: str) -> None:
    cloud = flip_normals(uniform_scan(SHAPES[shape](), 20_000, noise=0.005), 0.3)
    assert clean_points(cloud)[1].scattered == 0


@pytest.mark.parametrize("shape", ["torus", "bumpy_torus", "octopus", "thin_plate"])
def test_surface_a_hundred_times_sparser_than_the_rest_is_kept(shape: str) -> None:
    cloud = vary_density(uniform_scan(SHAPES[shape](), 50_000), 100.0)
    assert clean_points(cloud)[1].scattered == 0


def test_noisy_surface_a_hundred_times_sparser_than_the_rest_is_kept() -> None:
    surface = uniform_scan(SHAPES["octopus"](), 20_000, noise=0.001, normal_noise=8)
    assert clean_points(vary_density(surface, 100))[1].scattered == 0


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e7])
def test_coordinates_are_never_changed(scale: float) -> None:
    points = (sphere()[1].astype(np.float64) + 1 / 3) * scale + 1e7

    cleaned, _ = clean_points(cloud_of(points))

    assert np.array_equal(cleaned.points, points)


@pytest.mark.parametrize("count", [4, 10])
def test_few_points_and_planes_pass(count: int) -> None:
    plane = np.random.default_rng(4).random((count, 3)) * [1, 1, 0]

    assert len(clean_points(cloud_of(plane))[0]) == count


@pytest.mark.parametrize(
    ("points", "code"),
    [
        (np.zeros((0, 3)), "no_points"),
        (np.full((50, 3), np.nan), "no_points"),
        (np.ones((50, 3)), "too_few_points"),
        (np.eye(3), "too_few_points"),
        (np.linspace(0, 1, 50)[:, None] * [1, 2, 3] + 1e5, "collinear_points"),
        ((np.linspace(0, 1, 50)[:, None] * [1, 2, 3]).astype(np.float32), "collinear_points"),
    ],
)
def test_what_no_surface_can_be_made_of_is_refused_with_advice(
    points: np.ndarray, code: str
) -> None:
    with pytest.raises(InputError) as caught:
        clean_points(cloud_of(points))
    assert caught.value.code == code
    assert str(caught.value).endswith(".")


def test_the_report_tells_what_was_done() -> None:
    points, normals, _ = sphere(1000)
    normals[0], normals[1] = 0, normals[1] * 5
    points[2] = np.nan
    points[3] = points[4]
    points[5] = 1e6

    _, report = clean_points(PointCloud(points, normals))

    assert report.sentences == [
        "Points dropped for coordinates that are not finite: 1 of 1,000.",
        "Exact duplicates merged: 1 of 1,000.",
        "Stray points dropped, far from all others: 1 of 1,000.",
        "Missing normals taken from the nearest point: 1 of 1,000.",
        "Normals scaled to unit length: 1 of 1,000.",
    ]
    assert report.kept == 997


def test_cropping_keeps_the_points_inside_the_box() -> None:
    points, normals, colors = sphere()
    cloud = PointCloud(points, normals, colors, {"intensity": np.arange(200.0)})

    part = cloud.crop([500, -300, -1e9, 600, -100, 1e9])

    inside = points[:, 0] >= 500
    assert np.array_equal(part.points, points[inside])
    assert np.array_equal(part.scalars["intensity"], np.flatnonzero(inside))


def test_a_box_without_points_is_refused_with_where_the_scan_is() -> None:
    with pytest.raises(InputError, match="0 to 1, 0 to 1, 0 to 1 in x, y, z") as caught:
        cloud_of(np.eye(3)).crop([5, 5, 5, 6, 6, 6])
    assert caught.value.code == "empty_crop"


@pytest.mark.realdata
@pytest.mark.parametrize("name", ["srb/scans/anchor.ply", "stanford/dragon_stand_100k.ply"])
def test_real_scans_lose_no_point_to_cleaning(realdata, name: str) -> None:
    from visco_core.io import read_points

    cleaned, report = clean_points(read_points(realdata / name))

    assert report.outliers == 0
    assert len(cleaned) == report.read - report.duplicates
