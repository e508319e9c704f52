"""The gallery's shapes are what they say, and the scanner errs only as it is told."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core import gallery
from visco_core.gallery import (
    SHAPES,
    Scanner,
    Shape,
    encode_scan,
    make_sample_scan,
    sample_scan_path,
    scan,
    uniform_scan,
)
from visco_core.mesh_health import mesh_health
from visco_core.metrics import nearest_distance, point_to_mesh_distance

EXACT = [name for name, make in SHAPES.items() if make().exact]


@pytest.fixture(params=SHAPES, scope="module")
def shape(request: pytest.FixtureRequest) -> Shape:
    return SHAPES[request.param]()


def test_shape_mesh_is_one_clean_surface_of_the_stated_topology(shape: Shape) -> None:
    health = mesh_health(shape.mesh(96))
    assert health["watertight"]
    assert health["outward"]
    assert health["nonmanifold_vertices"] == 0
    assert (health["genus"], health["components"]) == (shape.genus, shape.bodies)


def test_samples_lie_exactly_on_the_surface_and_inside_the_bounds(shape: Shape) -> None:
    points = shape.sample(2000, seed=3)
    assert np.abs(shape.sdf(points)).max() < 1e-9
    slack = 1e-9 * shape.diagonal
    assert (points >= shape.bounds[0] - slack).all()
    assert (points <= shape.bounds[1] + slack).all()


def test_sdf_never_overstates_the_distance(shape: Shape) -> None:
    rng = np.random.default_rng(0)
    margin = 0.2 * (shape.bounds[1] - shape.bounds[0])
    points = rng.uniform(shape.bounds[0] - margin, shape.bounds[1] + margin, (3000, 3))
    distance = point_to_mesh_distance(points, shape.mesh(96))
    # The mesh cuts creases by up to a voxel.
    assert (np.abs(shape.sdf(points)) <= distance + 1e-2 * shape.diagonal).all()


@pytest.mark.parametrize("name", EXACT)
def test_exact_sdf_has_a_gradient_of_one_and_its_own_foot_point(name: str) -> None:
    shape = SHAPES[name]()
    rng = np.random.default_rng(1)
    points = rng.uniform(1.3 * shape.bounds[0], 1.3 * shape.bounds[1], (3000, 3))
    # Where two surface points are equally near, the gradient is no single vector.
    slope = np.linalg.norm(shape.gradient(points), axis=1)
    assert np.quantile(np.abs(slope - 1.0), 0.99) < 1e-6
    foot = points - shape.sdf(points)[:, None] * shape.gradient(points)
    assert np.quantile(np.abs(shape.sdf(foot)), 0.99) < 1e-6


def test_sphere_samples_are_uniform_by_area() -> None:
    points = gallery.sphere().sample(20_000, seed=0)
    # Archimedes: the height of a uniform point on a sphere is uniform.
    shares = np.histogram(points[:, 2], bins=10, range=(-1.0, 1.0))[0] / len(points)
    assert np.abs(shares - 0.1).max() < 0.01


def test_normals_of_a_sphere_and_a_box_are_the_known_ones() -> None:
    points = gallery.sphere().sample(500)
    assert np.allclose(gallery.sphere().normal(points), points, atol=1e-8)
    face = np.array([[0.8, 0.1, 0.2], [0.1, -0.6, 0.3], [0.0, 0.0, 0.5]])
    expected = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(gallery.box().normal(face), expected, atol=1e-8)


def test_scan_without_errors_lies_on_the_surface_and_faces_outward(shape: Shape) -> None:
    cloud = scan(shape, Scanner(views=6, resolution=48))
    assert len(cloud) > 300
    assert np.abs(shape.sdf(cloud.points)).max() < 1e-9 * shape.diagonal
    assert cloud.normals is not None
    agreement = (shape.normal(cloud.points) * cloud.normals).sum(axis=1)
    # At this resolution an arm of the octopus is two pixels wide.
    assert (agreement > 0.0).mean() > 0.95


def test_one_view_sees_only_the_near_side_of_a_sphere() -> None:
    cloud = scan(gallery.sphere(), Scanner(views=np.array([[0.0, 0.0, 1.0]]), resolution=64))
    assert cloud.points[:, 2].min() > 0.0


def test_a_body_hides_what_lies_behind_it() -> None:
    shape, toward = gallery.two_bodies(), np.array([-0.8, 0.6, 0.0])
    points = scan(shape, Scanner(views=toward[None], resolution=96)).points
    on_the_box = points[points[:, 0] > 0.1]
    assert len(on_the_box) > 50
    eye, ball = shape.center + 1.5 * shape.diagonal * toward, np.array([-0.5, 0.0, 0.0])
    rays = (on_the_box - eye) / np.linalg.norm(on_the_box - eye, axis=1, keepdims=True)
    past_the_ball = np.linalg.norm(np.cross(rays, ball - eye), axis=1)
    assert past_the_ball.min() == pytest.approx(0.45, abs=0.03)
    assert past_the_ball.min() >= 0.45


def test_estimated_normals_of_a_smooth_shape_are_within_degrees() -> None:
    cloud = scan(gallery.torus(), Scanner(views=8, resolution=128))
    assert cloud.normals is not None
    agreement = (gallery.torus().normal(cloud.points) * cloud.normals).sum(axis=1)
    assert np.degrees(np.arccos(agreement.clip(-1.0, 1.0))).mean() < 2.0


def test_exact_normals_are_exact_and_none_means_none() -> None:
    exact = scan(gallery.sphere(), Scanner(views=2, resolution=32, normals="exact"))
    assert exact.normals is not None
    assert np.allclose(exact.normals, exact.points, atol=1e-6)
    assert scan(gallery.sphere(), Scanner(views=2, resolution=32, normals="none")).normals is None


def test_depth_noise_has_the_asked_size() -> None:
    shape = gallery.sphere()
    cloud = scan(shape, Scanner(views=8, resolution=96, noise=0.002))
    # Noise lies along the ray, so that it is largest on the surface seen head-on.
    spread = shape.sdf(cloud.points).std() / shape.diagonal
    assert 0.6 * 0.002 < spread < 1.05 * 0.002


def test_registration_errors_move_views_rigidly() -> None:
    shape, direction = gallery.sphere(), np.array([[0.0, 0.0, 1.0]])
    still = scan(shape, Scanner(views=direction, resolution=32), seed=5)
    moved = scan(
        shape,
        Scanner(views=direction, resolution=32, registration_degrees=2.0, registration_shift=0.01),
        seed=5,
    )
    assert len(still) == len(moved)
    turn, scale, shift = _rigid_fit(still.points, moved.points)
    assert np.allclose(still.points @ turn.T + shift, moved.points, atol=1e-9)
    assert scale == pytest.approx(1.0)
    assert np.linalg.norm(shift) > 1e-3


def _rigid_fit(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Kabsch's rotation, with the spread ratio, and the shift."""
    centered = source - source.mean(axis=0), target - target.mean(axis=0)
    left, _, right = np.linalg.svd(centered[1].T @ centered[0])
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = left @ flip @ right
    scale = float(np.linalg.norm(centered[1]) / np.linalg.norm(centered[0]))
    return turn, scale, target.mean(axis=0) - turn @ source.mean(axis=0)


def test_holes_and_missing_views_remove_points() -> None:
    shape = gallery.sphere()
    whole = scan(shape, Scanner(views=8, resolution=64))
    fewer = scan(shape, Scanner(views=8, resolution=64, missing_views=3))
    holed = scan(shape, Scanner(views=8, resolution=64, holes=2, hole_radius=0.1))
    assert len(fewer) < 0.75 * len(whole)
    gap, _ = nearest_distance(whole.points, holed.points)
    assert 0.08 * shape.diagonal < gap.max() < 0.11 * shape.diagonal


def test_outliers_are_extra_points_off_the_surface() -> None:
    shape = gallery.sphere()
    clean = scan(shape, Scanner(views=4, resolution=48))
    dirty = scan(shape, Scanner(views=4, resolution=48, outliers=0.1))
    assert len(dirty) == round(1.1 * len(clean))
    assert (np.abs(shape.sdf(dirty.points)) > 0.01).mean() == pytest.approx(0.09, abs=0.02)


def test_same_seed_gives_the_same_scan_and_another_a_different_one() -> None:
    scanner = Scanner(views=3, resolution=32, noise=0.01, points=200)
    first, second = (scan(gallery.torus(), scanner, seed=4) for _ in range(2))
    assert first.points.tobytes() == second.points.tobytes()
    assert len(first) == 200
    assert not np.array_equal(scan(gallery.torus(), scanner, seed=5).points, first.points)


def test_uniform_scan_of_a_shape_has_the_asked_noise_in_points_and_normals() -> None:
    shape = gallery.sphere()
    cloud = uniform_scan(shape, 20_000, noise=0.003, normal_noise=10.0, seed=1)
    assert shape.sdf(cloud.points).std() / shape.diagonal == pytest.approx(0.003, rel=0.05)
    assert cloud.normals is not None
    exact = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    angle = np.degrees(np.arccos((exact * cloud.normals).sum(axis=1).clip(-1.0, 1.0)))
    assert np.sqrt((angle**2).mean()) == pytest.approx(10.0, rel=0.05)


def test_uniform_scan_of_a_mesh_takes_face_or_smooth_normals() -> None:
    mesh = gallery.sphere().mesh(24)
    faceted, smooth = (uniform_scan(mesh, 5000, smooth=choice) for choice in (False, True))
    assert np.array_equal(faceted.points, smooth.points)
    outward = smooth.points / np.linalg.norm(smooth.points, axis=1, keepdims=True)
    assert faceted.normals is not None
    assert smooth.normals is not None
    assert np.abs(smooth.normals - outward).max() < np.abs(faceted.normals - outward).max()


def test_damage_does_what_it_says() -> None:
    cloud = uniform_scan(gallery.sphere(), 4000)
    assert cloud.normals is not None
    flipped = gallery.flip_normals(cloud, 0.3)
    assert flipped.normals is not None
    assert ((flipped.normals * cloud.normals).sum(axis=1) < 0.0).mean() == pytest.approx(
        0.3, abs=0.03
    )
    assert len(gallery.subsample(cloud, 100)) == 100
    sparse = gallery.vary_density(uniform_scan(gallery.box(), 40_000), 100.0)
    near, far = (sparse.points[:, 0] < -0.6).sum(), (sparse.points[:, 0] > 0.6).sum()
    assert 20.0 < near / far < 100.0


def test_shipped_sample_is_small_colored_and_made_again_byte_for_byte() -> None:
    shipped = sample_scan_path().read_bytes()
    assert len(shipped) <= 1.5e6
    cloud = make_sample_scan()
    assert cloud.colors is not None
    assert len(np.unique(cloud.colors, axis=0)) > 100
    assert encode_scan(cloud) == shipped


def test_sample_is_readable_by_a_plain_ply_library() -> None:
    import plyfile

    vertex = plyfile.PlyData.read(str(sample_scan_path()))["vertex"]
    assert len(vertex) == 50_000
    normals = np.stack([vertex[name] for name in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=2e-4)
    assert {"red", "green", "blue"} <= set(vertex.data.dtype.names)
