"""Meshes as GLB and PLY: nothing is lost, others can read them, and nothing is left half done."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import plyfile
import pytest
import trimesh
from gltf_validator import validate

from visco_core.errors import InputError
from visco_core.io import read_mesh, write_mesh
from visco_core.result import Mesh

UTM = np.array([5.1e6, 1e7, 120.0])


def ball(center: np.ndarray = UTM, radius: float = 30.0, **extra) -> Mesh:
    sphere = trimesh.creation.icosphere(3)
    normals = np.asarray(sphere.vertices, np.float32)
    faces = np.asarray(sphere.faces, np.int32)
    return Mesh(np.asarray(sphere.vertices) * radius + center, faces, normals, **extra)


def colored_ball() -> Mesh:
    mesh = ball()
    rng = np.random.default_rng(1)
    count = len(mesh.vertices)
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    return replace(
        mesh,
        colors=colors,
        attributes={
            "confidence": rng.random(count).astype(np.float32),
            "scan angle": rng.random(count).astype(np.float32),
        },
    )


def gltf_of(path: Path) -> dict:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def signed_volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - mesh.vertices.mean(axis=0) for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def test_the_khronos_validator_finds_neither_errors_nor_warnings(tmp_path: Path) -> None:
    flat = replace(ball(), normals=np.zeros((len(ball().vertices), 3), np.float32))
    open_mesh = Mesh(np.eye(3) * 1e-6, np.array([[0, 1, 2]], np.int32))
    huge = ball(center=np.zeros(3), radius=1e15)
    unknown = replace(ball(), attributes={"confidence": np.full(642, np.nan, np.float32)})
    meshes = [ball(), colored_ball(), flat, open_mesh, huge, unknown]
    paths = [tmp_path / f"{i}.glb" for i in range(len(meshes))]
    for mesh, path, up in zip(meshes, paths, "xyzxyz", strict=True):
        write_mesh(mesh, path, up_axis=up, metadata={"resolution": 256})  # type: ignore[arg-type]

    for issues in validate(*paths):
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_the_validator_would_have_found_a_mistake(tmp_path: Path) -> None:
    write_mesh(ball(), tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    (tmp_path / "b.glb").write_bytes(data.replace(b'"NORMAL"', b'"NORMAX"'))

    assert validate(tmp_path / "b.glb")[0]["numErrors"] > 0


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("ending", ["glb", "ply"])
@pytest.mark.parametrize("radius", [30.0, 1e-5, 1e15])
def test_a_mesh_comes_back_in_the_frame_of_the_scan(
    tmp_path: Path, ending: str, up: str, radius: float
) -> None:
    center = UTM if radius == 30.0 else np.zeros(3)
    mesh = ball(center, radius)
    path = tmp_path / f"mesh.{ending}"
    write_mesh(mesh, path, up_axis=up)  # type: ignore[arg-type]

    back = read_mesh(path)

    assert np.abs(back.vertices - mesh.vertices).max() <= 1e-6 * 2 * radius
    assert np.array_equal(back.faces, mesh.faces)
    assert back.normals is not None
    assert mesh.normals is not None
    assert np.abs(back.normals - mesh.normals).max() < 1e-6
    assert signed_volume(back) > 0


@pytest.mark.parametrize("ending", ["glb", "ply"])
def test_attributes_whose_names_a_format_cannot_tell_apart_are_all_kept(
    tmp_path: Path, ending: str
) -> None:
    names = ["gps time", "gps_time"]
    mesh = replace(ball(), attributes={n: np.full(642, i, np.float32) for i, n in enumerate(names)})
    write_mesh(mesh, tmp_path / f"mesh.{ending}")

    back = read_mesh(tmp_path / f"mesh.{ending}").attributes

    assert [set(values) for values in back.values()] == [{0}, {1}]


@pytest.mark.parametrize("ending", ["glb", "ply"])
def test_colors_and_attributes_come_back(tmp_path: Path, ending: str) -> None:
    mesh = colored_ball()
    write_mesh(mesh, tmp_path / f"mesh.{ending}")

    back = read_mesh(tmp_path / f"mesh.{ending}")

    assert back.colors is not None
    assert np.array_equal(back.colors, mesh.colors)
    assert list(back.attributes) == ["confidence", "scan_angle"]
    assert np.array_equal(back.attributes["confidence"], mesh.attributes["confidence"])


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_the_up_axis_points_along_y_for_any_viewer(tmp_path: Path, up: str, axis: int) -> None:
    mesh = ball(center=np.zeros(3))
    mesh.vertices[:, axis] *= 3
    write_mesh(mesh, tmp_path / "mesh.glb", up_axis=up)  # type: ignore[arg-type]

    extents = trimesh.load_scene(tmp_path / "mesh.glb", process=False).extents

    assert extents == pytest.approx([60, 180, 60], rel=1e-2)


def test_trimesh_puts_a_glb_where_the_scan_is(tmp_path: Path) -> None:
    mesh = colored_ball()
    write_mesh(mesh, tmp_path / "mesh.glb", up_axis="y")

    scene = trimesh.load_scene(tmp_path / "mesh.glb", process=False)
    part = scene.to_mesh()

    assert np.abs(part.vertices - mesh.vertices).max() < 1e-5
    assert part.volume > 0


def test_a_glb_says_its_offset_and_scale(tmp_path: Path) -> None:
    mesh = ball()
    write_mesh(mesh, tmp_path / "mesh.glb", up_axis="x", metadata={"resolution": 256, "scale": 7})

    extras = gltf_of(tmp_path / "mesh.glb")["asset"]["extras"]["visco"]

    center = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    assert extras == {
        "offset": center.tolist(),
        "scale": 1.0,
        "up_axis": "x",
        "resolution": 256,
    }


def test_a_glb_is_matt_and_lit_from_both_sides(tmp_path: Path) -> None:
    write_mesh(ball(), tmp_path / "grey.glb")
    write_mesh(colored_ball(), tmp_path / "color.glb")

    grey, color = (gltf_of(tmp_path / f"{n}.glb")["materials"][0] for n in ("grey", "color"))

    for material in (grey, color):
        assert material["doubleSided"] is True
        assert material["pbrMetallicRoughness"]["metallicFactor"] == 0
        assert material["pbrMetallicRoughness"]["roughnessFactor"] == pytest.approx(0.8)
    assert color["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
    assert 0.4 < min(grey["pbrMetallicRoughness"]["baseColorFactor"][:3]) < 0.8


def test_glb_colors_are_linear_light(tmp_path: Path) -> None:
    mesh = replace(ball(), colors=np.full((642, 3), 188, np.uint8))
    write_mesh(mesh, tmp_path / "mesh.glb")

    part = next(iter(trimesh.load_scene(tmp_path / "mesh.glb").geometry.values()))
    linear = part.visual.vertex_attributes["color"][0] / 65535

    # sRGB 188 of 255 is half of the light.
    assert linear == pytest.approx([0.503, 0.503, 0.503, 1], abs=1e-3)


def test_plyfile_reads_every_property_of_a_ply(tmp_path: Path) -> None:
    mesh = colored_ball()
    write_mesh(mesh, tmp_path / "mesh.ply", metadata={"label": "part\n7"})

    ply = plyfile.PlyData.read(tmp_path / "mesh.ply")

    vertex = ply["vertex"].data
    assert vertex.dtype.descr == [
        *((axis, "<f8") for axis in "xyz"),
        *((name, "<f4") for name in ("nx", "ny", "nz")),
        *((name, "|u1") for name in ("red", "green", "blue")),
        ("confidence", "<f4"),
        ("scan_angle", "<f4"),
    ]
    assert np.array_equal(np.stack([vertex[a] for a in "xyz"], axis=1), mesh.vertices)
    assert np.array_equal(np.stack(list(ply["face"]["vertex_indices"])), mesh.faces)
    assert {"offset 0 0 0", "scale 1", 'label "part\\n7"'} <= set(ply.comments)


def test_a_ply_near_the_origin_needs_float32_only(tmp_path: Path) -> None:
    mesh = ball(center=np.array([1.0, 2.0, 3.0]))
    write_mesh(mesh, tmp_path / "mesh.ply")

    vertex = plyfile.PlyData.read(tmp_path / "mesh.ply")["vertex"].data

    assert vertex.dtype["x"] == np.dtype("<f4")
    assert np.abs(vertex["x"] - mesh.vertices[:, 0]).max() < 1e-5


def test_an_attribute_named_like_a_coordinate_gets_another_name(tmp_path: Path) -> None:
    mesh = replace(ball(), attributes={"x": np.arange(642, dtype=np.float32)})
    write_mesh(mesh, tmp_path / "mesh.ply")

    assert read_mesh(tmp_path / "mesh.ply").attributes["x_"][7] == 7


@pytest.mark.parametrize("ending", ["obj", "stl"])
def test_plain_formats_keep_shape_and_winding(tmp_path: Path, ending: str) -> None:
    mesh = ball(center=np.zeros(3))
    write_mesh(mesh, tmp_path / f"mesh.{ending}")

    back = read_mesh(tmp_path / f"mesh.{ending}")

    assert len(back.faces) == len(mesh.faces)
    assert signed_volume(back) == pytest.approx(signed_volume(mesh), rel=1e-5)


def test_an_stl_that_would_lose_digits_is_refused_with_advice(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"use \.glb or \.ply") as caught:
        write_mesh(ball(), tmp_path / "mesh.stl")
    assert caught.value.code == "unsupported_output"
    assert list(tmp_path.iterdir()) == []


def test_other_endings_are_refused_with_those_that_work(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.glb, \.ply, \.obj, \.stl") as caught:
        write_mesh(ball(), tmp_path / "mesh.fbx")
    assert caught.value.code == "unsupported_output"


def test_an_empty_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write_mesh(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), tmp_path / "mesh.glb")
    assert caught.value.code == "empty_mesh"


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    write_mesh(ball(), tmp_path / "mesh.glb")
    before = (tmp_path / "mesh.glb").read_bytes()

    with pytest.raises(TypeError):
        write_mesh(ball(), tmp_path / "mesh.glb", metadata={"not json": object()})

    assert (tmp_path / "mesh.glb").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.glb"]


def test_a_missing_folder_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        write_mesh(ball(), tmp_path / "missing" / "mesh.ply")
    assert caught.value.code == "unwritable_output"


def test_a_foreign_glb_is_read_with_the_transforms_of_its_nodes(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    for shift in (0.0, 5.0):
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([shift, 0, 0]))
    scene.export(tmp_path / "boxes.glb")

    mesh = read_mesh(tmp_path / "boxes.glb")

    assert len(mesh.faces) == 24
    assert mesh.vertices.max(axis=0) == pytest.approx([5.5, 0.5, 0.5])


def test_a_scan_without_faces_is_no_mesh(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n"
    )
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.code == "not_a_mesh"


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "vertices", "faces"),
    [
        ("srb/gt/anchor_gt_mesh.ply", 49200, 98412),
        ("meshes/pmp_fandisk.off", 6475, 12946),
        ("meshes/wassersplines_fertility.obj", 9761, 19534),
        ("stanford/bun_zipper.ply", 35947, 69451),
    ],
)
def test_real_meshes_are_read_whole(realdata: Path, name: str, vertices: int, faces: int) -> None:
    mesh = read_mesh(realdata / name)

    assert (len(mesh.vertices), len(mesh.faces)) == (vertices, faces)
    assert signed_volume(mesh) > 0
