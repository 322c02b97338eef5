"""Every file that the library reads: how a sound one is made, how it is read and used, and what reading gives."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

import casadi_contact as cc
from casadi_contact import pipeline
from casadi_contact.assembly import load_assembly
from casadi_contact.benchmark.front_file import read_front
from casadi_contact.dataset import read_sample_table, read_samples, write_samples
from casadi_contact.files import read_npz, write_npz
from casadi_contact.files.hdf5 import BLOCK, sealed
from casadi_contact.geometry.mesh import load_mesh
from casadi_contact.motion.joint_cycle import column_names, read_joint_cycle
from casadi_contact.motion.load_cycle import read_cycle, write_cycle
from casadi_contact.motion.opensim import poses_table, read_opensim_table, write_table
from casadi_contact.motion.pose_file import read_poses, write_poses
from casadi_contact.motion.walking import reference_cycle
from casadi_contact.project import read_motion
from casadi_contact.report import evaluation_tables, kernel_speed_tables, read_evaluation, read_kernel_speed
from casadi_contact.sampling.folder import ChunkFolder
from casadi_contact.scenes import Scene, load_scene
from casadi_contact.structures import Surrogate, load_surrogate
from casadi_contact.training import checkpoint
from casadi_contact.transcription import load_function, save_function
from problems.muscle_contact.example import example_walk
from problems.muscle_contact.muscle import force_capacity
from problems.muscle_contact.walk import read_length_range, read_walk
from tests.fuzz.mutations import mutated
from tests.support.drawn_spheres import sphere_motion
from tests.support.hdf5_files import unsealed
from tests.support.muscle_files import write_walk
from tests.support.own_contact import SCENE, table_rows, write_csv, write_hdf5
from tests.support.random_surrogates import random_poses, random_surrogate
from tests.support.smooth_samples import smooth_samples

POSES = random_poses(12)
FIT = checkpoint.Identity("id", np.ones(2))
FRONT = Path(cc.__file__).parent / "benchmark" / "ready" / "knee.csv"


@dataclass(frozen=True)
class Reader:
    """make(path) writes a sound file; read(path) reads and uses it and gives what must stay equal.

    exact: a changed file that still reads must give the same; elsewhere another number is another content. slow: each
    file costs a process of its own. resealed: the accident befalls the HDF5 behind the seal, whose digest is made anew.
    """

    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    exact: bool = False
    slow: bool = False
    resealed: bool = False

    def mutated(self, sound: bytes, rng: np.random.Generator) -> bytes:
        return sealed(mutated(sound[BLOCK:], rng)) if self.resealed else mutated(sound, rng)


def _surrogate(path: Path) -> None:
    random_surrogate(SCENE, "patch").save(path)


def _unsealed(make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    def made(path: Path) -> None:
        make(path)
        unsealed(path).replace(path)

    return made


def _loads(path: Path) -> Any:
    surrogate = load_surrogate(path)
    return surrogate(POSES).tolist(), str(surrogate.info())


def _samples(path: Path) -> Any:
    samples = read_samples(path)
    return samples.poses.tolist(), samples.loads().tolist(), dict(samples.provenance)


def _evaluation(path: Path) -> None:
    errors = {"Fy": {"rms": 1.5, "max": 3.0, "mean": 1.0}}
    content = {
        "format": "casadi_contact evaluation",
        "loads": ["Fy"],
        "teacher": "80×40",
        "domain_errors": {"patch": {"D1": errors, "D5": errors}},
        "test_samples": {"D1": 10, "D5": 4},
    }
    path.write_text(json.dumps(content, indent=1))


def _kernel_speed(path: Path) -> None:
    timing = {"median_us": 2.0, "low_us": 1.0, "high_us": 3.0}
    found = {"microseconds": {"value, graph": timing, "value, kernel": timing}, "limit_us": 0.5, "limit": "why"}
    path.write_text(json.dumps({"format": "casadi_contact kernel speed", "surrogates": {"patch": found}}))


def _checkpoint(path: Path) -> Any:
    content = checkpoint.read(path, FIT)
    if content is None:
        raise ValueError("a fit starts again")
    return {name: array.tolist() for name, array in content.items()}


def _motion(path: Path) -> None:
    motion, cycles = sphere_motion(), np.array(["one"])
    write_npz(path, inputs=np.array(motion.point.inputs), cycles=cycles, curves=motion.curves, poses=motion.poses)


def _read_motion(path: Path) -> Any:
    motion, names = read_motion(pipeline.Project(load_scene("knee"), "quick", path.parent))
    return motion.curves.tolist(), motion.poses.tolist(), names


def _plan(path: Path) -> Any:
    (path.parent / "chunk-000000.npz").touch()  # of a folder without chunks the plan is written anew
    return ChunkFolder(path.parent.parent / "samples.h5", {"scene": "s", "settings": {"seed": 1}}).folder


def _joint_cycle(path: Path) -> None:
    columns = column_names(SCENE.load_names)
    rows = [",".join(["time_s", columns["rz"], columns["Fy"]]), *(f"{0.1 * k:g},0.{k},{-700 - k}" for k in range(9))]
    path.write_text("\n".join(rows))


def _mesh(path: Path) -> None:
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=1, radius=20.0)
    sphere.export(path)


def _ascii_stl(path: Path) -> None:
    import trimesh

    path.write_text(trimesh.exchange.stl.export_stl_ascii(trimesh.creation.icosphere(subdivisions=1, radius=20.0)))


def _vtp(path: Path) -> None:
    import base64
    import zlib

    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=1, radius=20.0)

    def packed(array: np.ndarray) -> str:
        data = zlib.compress(array.tobytes())
        header = np.array([1, array.nbytes, 0, len(data)], dtype="<u4").tobytes()
        return base64.b64encode(header).decode() + base64.b64encode(data).decode()

    ends = 3 * np.arange(1, len(sphere.faces) + 1)
    path.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor"><PolyData><Piece>\n<Points><DataArray type="Float64" format="binary">'
        f'{packed(sphere.vertices)}</DataArray></Points>\n<Polys><DataArray type="Int32" Name="connectivity" '
        f'format="ascii">{" ".join(map(str, sphere.faces.ravel()))}</DataArray>\n<DataArray type="Int32" '
        f'Name="offsets" format="binary">{packed(ends.astype("<i4"))}</DataArray></Polys></Piece></PolyData></VTKFile>'
    )


def _read_mesh(path: Path) -> Any:
    return len(load_mesh(path, "mm").faces)


def _button(path: Path) -> None:
    from tests.support.meshes import cap_mesh, groove, sheet_mesh, write_obj

    vertices, faces = cap_mesh(22.0, 4.0, 0.7)
    write_obj(path, vertices + np.array([0.0, 22.0, 0.0]), faces)
    write_obj(path.parent / "groove.obj", *sheet_mesh(40.0, 4.0, groove))


def _mesh_scene(path: Path) -> None:
    from tests.support.meshes import mesh_scene_text

    _button(path.with_name("button.obj"))
    path.write_text(mesh_scene_text("button.obj", "groove.obj", grid=(12, 8)))


def _read_mesh_scene(path: Path) -> Any:
    model = cc.ElasticFoundation(load_scene(path))
    return model(model.scene.start_pose).tolist()


def _proposal(path: Path) -> Any:
    """What the command `scene` sees before it settles poses."""
    from tests.support.joint_meshes import seen

    return seen(*(load_mesh(each, "mm") for each in (path, path.with_name("groove.obj"))))[2].kind


@cache
def _surrogate_of(scene_text: str) -> Surrogate:
    return random_surrogate(Scene.from_toml(scene_text), "patch")


def _assembly(path: Path) -> None:
    path.write_text(
        (resources.files("casadi_contact.assembly") / "ready" / "knee_with_patella.toml").read_text("utf-8")
    )


def _read_assembly(path: Path) -> Any:
    assembly = load_assembly(path, lambda scene: _surrogate_of(scene.to_toml()))
    return assembly.load_names, assembly.start_poses().tolist()


WALK = example_walk(frames=8)


def _muscle_walk(path: Path) -> None:
    """The file and those that are read with it, beside it."""
    assert path in write_walk(path.parent, WALK).values()


def _read_muscle_walk(path: Path) -> Any:
    names = {"inverse_dynamics": "walk_inverse_dynamics"}
    parts = ("rotations", "inverse_dynamics", "muscles", "parameters")
    walk = read_walk(*(path.parent / f"{names.get(part, part)}.csv" for part in parts))
    lengths = read_length_range(path.parent / "muscles.csv", walk.muscles.names)
    capacity = force_capacity(walk.muscles.fitted_to(lengths), walk.lengths_m, walk.velocities_m_per_s)
    assert np.isfinite([capacity.active_n, capacity.passive_n, capacity.fibre]).all()
    return capacity.active_n.tolist(), walk.rz.tolist()


READERS = {
    "surrogate.h5": Reader(_surrogate, _loads, exact=True),
    "older_surrogate.h5": Reader(_unsealed(_surrogate), _loads, exact=True, slow=True),
    "samples.h5": Reader(lambda path: write_samples(path, smooth_samples(60)), _samples, exact=True),
    "resealed_surrogate.h5": Reader(_surrogate, _loads, exact=True, slow=True, resealed=True),
    "resealed_samples.h5": Reader(
        lambda path: write_samples(path, smooth_samples(60)),
        lambda path: len(read_samples(path)),
        slow=True,
        resealed=True,
    ),
    "older_samples.h5": Reader(
        _unsealed(lambda path: write_samples(path, smooth_samples(60))),
        lambda path: len(read_samples(path)),
        slow=True,
    ),
    "table.h5": Reader(
        lambda path: write_hdf5(path, table_rows(30)), lambda path: len(read_sample_table(path, SCENE)), slow=True
    ),
    "table.csv": Reader(lambda path: write_csv(path, table_rows(30)), lambda path: len(read_sample_table(path, SCENE))),
    "chunk.npz": Reader(
        lambda path: write_npz(path, poses=POSES, dropped=np.array("{}")),
        lambda path: {name: array.tolist() for name, array in read_npz(path).items()},
        exact=True,
    ),
    "checkpoint.npz": Reader(
        lambda path: checkpoint.write(path, FIT, {"weights": POSES, "seconds": 1.5}), _checkpoint, exact=True
    ),
    "motion.npz": Reader(_motion, _read_motion, exact=True),
    "plan/samples.h5.partial/plan.json": Reader(_plan, _plan),
    "evaluation.json": Reader(_evaluation, lambda path: evaluation_tables(read_evaluation(path))),
    "kernel_speed.json": Reader(_kernel_speed, lambda path: kernel_speed_tables(read_kernel_speed(path))),
    "speed_accuracy.csv": Reader(lambda path: path.write_bytes(FRONT.read_bytes()), read_front),
    "loads.casadi": Reader(
        lambda path: save_function(random_surrogate(SCENE, "patch").function(), path),
        lambda path: load_function(path)(POSES[0]).full().tolist(),
        exact=True,
    ),
    "scene.toml": Reader(
        lambda path: path.write_text(cc.load_scene("knee").to_toml()), lambda path: load_scene(path).to_toml()
    ),
    "assembly.toml": Reader(_assembly, _read_assembly),
    "own.toml": Reader(lambda path: path.write_text(SCENE.to_toml()), lambda path: load_scene(path).to_toml()),
    "cycle.csv": Reader(lambda path: write_cycle(reference_cycle(), path), read_cycle),
    "joint_cycle.csv": Reader(_joint_cycle, lambda path: read_joint_cycle(path, SCENE)),
    "poses.csv": Reader(lambda path: write_poses(np.arange(12.0), POSES, path), read_poses),
    "poses.sto": Reader(
        lambda path: write_table(poses_table(np.arange(12.0), POSES, "poses"), path), read_opensim_table
    ),
    "rotations.csv": Reader(_muscle_walk, _read_muscle_walk),
    "walk_inverse_dynamics.csv": Reader(_muscle_walk, _read_muscle_walk),
    "muscles.csv": Reader(_muscle_walk, _read_muscle_walk),
    "parameters.csv": Reader(_muscle_walk, _read_muscle_walk),
    "button.obj": Reader(_button, _proposal),
    "meshes.toml": Reader(_mesh_scene, _read_mesh_scene),
    "mesh.stl": Reader(_mesh, _read_mesh),
    "ascii.stl": Reader(_ascii_stl, _read_mesh),
    "mesh.obj": Reader(_mesh, _read_mesh),
    "mesh.ply": Reader(_mesh, _read_mesh),
    "mesh.vtp": Reader(_vtp, _read_mesh),
}
