"""Every compiled kernel computes what its plain twin says, and the plain ones what they claim."""

from __future__ import annotations

import inspect
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from kernel_inputs import CORNERS, INPUTS, TOPOLOGIES, Nodes, corners_of, dense, scan_on, whole_of

from visco_core.errors import InputError
from visco_core.kernels import FREE, ROW, Backend, choose_backend, native, reference
from visco_core.solvers.preconditioner import spline_basis

EXACT = {"find_nodes", "neighbour_table", "free_runs", "voxel_corners", "sample", "surface_counts"}
EXACT |= {"surface_faces", "squared_distance"}


def public_kernels(package: ModuleType) -> dict[str, Any]:
    """Name → plain Python function of the kernels that ``package`` offers."""
    return {name: getattr(package, name) for name in package.__all__}


def call(backend: Backend, name: str, *arguments: Any) -> list[np.ndarray]:
    """What the kernel returns and what it leaves in its array arguments, as numpy arrays."""
    own = [
        backend.array(a.copy() if a.flags.c_contiguous else a) if isinstance(a, np.ndarray) else a
        for a in arguments
    ]
    returned = getattr(backend.kernels, name)(*own)
    returned = returned if isinstance(returned, tuple) else (returned,)
    mutable = [a for a, given in zip(own, arguments, strict=True) if isinstance(given, np.ndarray)]
    kept = [found for found in (*returned, *mutable) if found is not None]
    return [np.asarray(found if np.isscalar(found) else backend.numpy(found)) for found in kept]


def test_both_packages_offer_the_same_kernels_with_the_same_parameters() -> None:
    plain, compiled = public_kernels(reference), public_kernels(native)
    assert plain.keys() == compiled.keys()
    for name, kernel in plain.items():
        parameters = inspect.signature(kernel).parameters
        assert list(parameters) == list(inspect.signature(compiled[name]).parameters), name


def test_a_kernel_and_its_twin_are_in_files_of_the_same_name() -> None:
    compiled = public_kernels(native)
    for name, kernel in public_kernels(reference).items():
        file = kernel.__module__.removeprefix(reference.__name__)
        assert compiled[name].__module__ == native.__name__ + file, name


def test_every_kernel_is_compared_with_its_twin() -> None:
    assert INPUTS.keys() == public_kernels(reference).keys()


@pytest.mark.parametrize("topology", TOPOLOGIES)
@pytest.mark.parametrize("name", INPUTS)
def test_compiled_kernel_equals_its_plain_twin(
    name: str, topology: str, native_backend: Backend, reference_backend: Backend
) -> None:
    arguments = INPUTS[name](TOPOLOGIES[topology]())
    expected = call(reference_backend, name, *arguments)
    found = call(native_backend, name, *arguments)
    assert len(found) == len(expected)
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape
        if name in EXACT or not np.issubdtype(theirs.dtype, np.floating):
            np.testing.assert_array_equal(ours, theirs)
        else:
            largest = np.abs(theirs).max(initial=1e-30)
            np.testing.assert_allclose(ours, theirs, rtol=2e-5, atol=1e-6 * largest)


@pytest.fixture(params=TOPOLOGIES, scope="module")
def nodes(request: pytest.FixtureRequest) -> Nodes:
    return TOPOLOGIES[request.param]()


def test_neighbours_and_flags_are_those_of_brute_force(nodes: Nodes, backend: Backend) -> None:
    table, flags = call(backend, "neighbour_table", nodes.ijk, nodes.columns, nodes.side)[:2]
    np.testing.assert_array_equal(table, nodes.neighbours)
    np.testing.assert_array_equal(flags, nodes.full_flags)


def test_runs_are_the_free_nodes_and_lead_to_their_neighbours(
    nodes: Nodes, backend: Backend
) -> None:
    runs, slabs = call(backend, "free_runs", nodes.neighbours, nodes.full_flags, nodes.slabs)[:2]
    found = [node for start, stop in runs[:, :2] for node in range(start, stop)]
    np.testing.assert_array_equal(found, np.flatnonzero(nodes.complete))
    np.testing.assert_array_equal(slabs, [(runs[:, 0] < first).sum() for first in nodes.slabs])
    for start, stop, *ways in runs:
        node = np.arange(start, stop)[:, None]
        np.testing.assert_array_equal(node + np.array([*ways, -1, 1]), nodes.neighbours[start:stop])


def test_every_node_is_found_and_no_other(nodes: Nodes, backend: Backend) -> None:
    everywhere = np.argwhere(np.ones((nodes.side,) * 3)).astype(np.int32)
    found = call(backend, "find_nodes", everywhere, nodes.ijk, nodes.columns, nodes.side)[0]
    present = found < len(nodes)
    np.testing.assert_array_equal(found[present], np.arange(len(nodes)))
    np.testing.assert_array_equal(everywhere[present], nodes.ijk)


def test_voxel_corners_are_ordered_4x_2y_z_and_missing_as_a_whole(
    nodes: Nodes, backend: Backend
) -> None:
    base = np.arange(len(nodes), dtype=np.int32)
    found = call(backend, "voxel_corners", nodes.neighbours, base)[0]
    expected = corners_of(nodes, base)
    expected[(expected == len(nodes)).any(1)] = len(nodes)
    np.testing.assert_array_equal(found, expected)


def test_point_system_is_the_quadratic_form_of_the_point_sums(backend: Backend) -> None:
    """fᵀMf − 2bᵀf + λn·m over all voxels is λp Σ f(q)² + λn Σ ‖∇f(q) − n‖²."""
    nodes = dense()
    scan, values = scan_on(nodes), nodes.vector()
    system = scan.local, scan.normals, scan.starts, nodes.side - 1, 0.7, 0.02
    matrices, vectors = call(backend, "point_system", *system)[:2]
    sums = values, scan.corners, scan.local, scan.normals, scan.starts, nodes.side - 1
    square, mismatch = call(backend, "point_sums", *sums)[:2]
    at = values[scan.corners].astype(np.float64)
    quadratic = np.einsum("mr,mrc,mc->", at, whole_of(matrices), at) - 2 * (at * vectors).sum()
    assert quadratic + 0.02 * len(scan.local) == pytest.approx(
        0.7 * float(square) + 0.02 * float(mismatch), rel=1e-5
    )


def test_splatted_divergence_against_a_linear_field_is_minus_its_slope_along_the_vectors(
    backend: Backend,
) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0.1, 0.9, (400, 3)).astype(np.float32)
    vectors = rng.standard_normal((400, 3)).astype(np.float32)
    sources = call(backend, "splat_divergence", points, vectors, 11)[0]
    assert abs(sources.sum()) < 1e-3
    slope = np.array([2.0, -1.0, 0.5])
    linear = np.argwhere(np.ones(sources.shape)) @ slope
    assert sources.ravel() @ linear == pytest.approx(-(vectors @ slope).sum(), rel=1e-4)


def test_squared_distance_is_that_of_the_nearest_cell_outside(backend: Backend) -> None:
    rng = np.random.default_rng(4)
    region = rng.random((12, 12, 12)) < 0.98
    cells, others = np.argwhere(region), np.argwhere(~region)
    expected = np.zeros(region.shape)
    expected[region] = np.square(cells[:, None] - others).sum(2).min(1)
    np.testing.assert_array_equal(call(backend, "squared_distance", region)[0], expected)


def test_squared_distance_is_huge_where_nothing_is_outside(backend: Backend) -> None:
    assert (call(backend, "squared_distance", np.ones((5, 5, 5), bool))[0] >= 1e19).all()


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 1.0])
def test_sample_keeps_the_asked_share_independently_of_seed_and_place(
    fraction: float, backend: Backend
) -> None:
    kept = np.stack([call(backend, "sample", 40_000, fraction, s)[0] for s in (0, 1, 2**32 - 1)])
    assert set(np.unique(kept)) <= {0, 1}
    deviation = np.sqrt(fraction * (1 - fraction) / 40_000)
    np.testing.assert_allclose(kept.mean(1), fraction, atol=4 * deviation)
    np.testing.assert_allclose((kept[0] & kept[1]).mean(), fraction**2, atol=4 * deviation)
    np.testing.assert_allclose((kept[0, 1:] & kept[0, :-1]).mean(), fraction**2, atol=0.01)


def test_a_sample_with_one_seed_is_the_same_on_every_backend(
    native_backend: Backend, reference_backend: Backend
) -> None:
    for seed in (0, 7, 2**32 - 1):
        ours = call(native_backend, "sample", 5000, 0.3, seed)[0]
        np.testing.assert_array_equal(ours, call(reference_backend, "sample", 5000, 0.3, seed)[0])


@pytest.mark.parametrize("side", [17, 24, 9])
def test_spline_restriction_is_the_transpose_of_prolongation(side: int, backend: Backend) -> None:
    rng = np.random.default_rng(side)
    coarse = rng.standard_normal((side // 2 + 1,) * 3).astype(np.float32)
    fine = rng.standard_normal((side,) * 3).astype(np.float32)
    up = call(backend, "spline_prolong", coarse, side)[0]
    down = call(backend, "spline_restrict", fine)[0]
    assert up.shape == fine.shape
    assert down.shape == coarse.shape
    scale = float(np.linalg.norm(up) * np.linalg.norm(fine))
    assert float(np.vdot(up, fine) - np.vdot(coarse, down)) == pytest.approx(0, abs=1e-6 * scale)


def test_spline_prolongation_repeats_linear_functions_away_from_the_border(
    backend: Backend,
) -> None:
    coarse = np.argwhere(np.ones((9, 9, 9))).astype(np.float32).reshape(9, 9, 9, 3) @ [1, -2, 3]
    fine = call(backend, "spline_prolong", coarse.astype(np.float32), 17)[0]
    expected = np.argwhere(np.ones((17, 17, 17))).reshape(17, 17, 17, 3) @ [0.5, -1, 1.5]
    inner = (slice(2, -2),) * 3
    np.testing.assert_allclose(fine[inner], expected[inner], atol=1e-4)


def test_spline_basis_is_a_coefficient_prolonged_to_the_nodes(backend: Backend) -> None:
    spline = np.zeros((9, 9, 9), np.float32)
    spline[4, 4, 4] = 1
    for level in (1, 2):
        spline = call(backend, "spline_prolong", spline, 2 * len(spline) - 1)[0]
        line = np.pad(spline_basis(level), (len(spline) - len(spline_basis(level))) // 2)
        product = line[:, None, None] * line[:, None] * line
        np.testing.assert_allclose(spline, product, atol=1e-6)


@pytest.mark.parametrize("level", [1, 2])
def test_spline_energies_are_those_of_the_splines_values_at_the_nodes(
    level: int, backend: Backend
) -> None:
    nodes = dense()
    spacing, basis = 2**level, spline_basis(level)
    scan, side = scan_on(nodes), (nodes.side - 1) // spacing + 1
    given = scan.corners, scan.matrices, scan.slabs, nodes.ijk, basis, spacing, side
    found = call(backend, "spline_energies", *given)[0]
    padded, matrices = np.append(basis, 0), whole_of(scan.matrices)
    for knot in np.ndindex(side, side, side):
        offset = nodes.ijk - spacing * np.array(knot) + len(basis) // 2
        outside = (offset < 0) | (offset >= len(basis))
        at_nodes = padded[np.where(outside, len(basis), offset)].prod(1)
        at = at_nodes[scan.corners]
        energy = np.einsum("mr,mr->", at, np.einsum("mrc,mc->mr", matrices, at))
        assert float(found[knot]) == pytest.approx(float(energy), rel=1e-4, abs=1e-6)


def test_flags_mean_the_same_everywhere() -> None:
    assert (reference.common.ROW, reference.common.FREE) == (ROW, FREE)
    assert [tuple(corner) for corner in CORNERS] == [(c >> 2, c >> 1 & 1, c & 1) for c in range(8)]


def test_an_explicit_backend_is_the_one_that_is_used() -> None:
    assert choose_backend("reference", "cpu").name == "reference"
    assert choose_backend("native", "cpu").name == "native"
    assert choose_backend("auto", "cpu").name == "native"


def test_what_runs_beside_the_kernels_gets_as_many_threads_as_they() -> None:
    for name in ("native", "reference"):
        assert choose_backend(name, "cpu", 1).threads == 1
    assert choose_backend("native", "cpu").threads >= 1


def test_native_refuses_a_cuda_device() -> None:
    with pytest.raises(InputError) as caught:
        choose_backend("native", "cuda")
    assert caught.value.code == "invalid_option"
