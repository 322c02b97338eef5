"""From the mesh files of a joint to the poses of measured cycles, with nothing trained.

    python -m problems.implant femur.stl insert.stl walk.csv       two meshes: a scene is proposed first
    python -m problems.implant my_knee.toml walk1.csv walk2.csv    a scene file that names the meshes

1. `propose` finds frame, regions, rest pose and loads of two meshes and writes a scene file beside a picture of what
   it understood: look at it, edit the file, run again.
2. `load_contact` gives the scene's foundation, which is as exact as its elements and has exact derivatives.
3. The poses of each cycle are estimated in IPOPT and verified on the elements (`problems.pose_estimation`).
"""

from pathlib import Path

from casadi_contact.cli.commands import name_of_mesh
from casadi_contact.cli.commands import scene as propose_scene
from casadi_contact.core.files.reading import existing_file
from casadi_contact.core.terminal import PlainConsole, progress_bars, run_program
from casadi_contact.geometry.mesh_formats import FORMATS
from casadi_contact.scenes.loading import load_scene
from problems.contact_source import load_contact, load_cycle
from problems.pose_estimation import estimate


def scene_of_meshes(moving: Path, fixed: Path, folder: Path) -> Path:
    """Scene file in a folder, proposed unless it is there already; ValueError where that names other meshes."""
    path = folder / f"{name_of_mesh(fixed)}.toml"
    if not path.exists():
        propose_scene(moving, fixed, out=path)
        return path
    geometry = load_scene(path).geometry
    named = [Path(geometry.get(body, "")).resolve() for body in ("moving", "fixed")]
    if named != [moving.resolve(), fixed.resolve()]:
        raise ValueError(f"{path} is there and names other meshes ({', '.join(map(str, named))}): give another --out")
    return path


def main(scene: Path, files: list[Path], out: Path = Path("results/implant")) -> None:
    """Find the poses of measured cycles (CSV) on the meshes of a joint.

    scene: a scene file, or the moving body's mesh, which the fixed body's mesh follows (STL, OBJ, ...). files:
    the cycles. Exit status 3: some frames are not solved; 4: all are, but some are not verified."""
    for path in files:
        existing_file(path, "mesh or cycle file")
    if scene.suffix.lower() in FORMATS:
        fixed, *files = files
        if fixed.suffix.lower() not in FORMATS or not files:
            raise ValueError(f"got the mesh {scene}, then {fixed}, expected the fixed body's mesh and cycles after it")
        out.mkdir(parents=True, exist_ok=True)
        scene = scene_of_meshes(scene, fixed, out)
    if len({path.stem for path in files}) < len(files):
        raise ValueError("got two cycles of one name, expected names that differ: each names a folder of results")
    measured = {path.stem: load_cycle(load_scene(scene), path) for path in files}  # before minutes of work
    steps, codes = ["contact model", *measured, "done"], list[int]()
    with progress_bars(PlainConsole(), cure="cycles that were done are kept") as progress:
        progress("poses on meshes", 0, len(steps) - 1, steps[0])
        model = load_contact(scene=str(scene), cycles=[*measured.values()])
        for done, (name, cycle) in enumerate(measured.items(), start=1):
            progress("poses on meshes", done, len(steps) - 1, name)
            print(f"{name}: {len(cycle.time_s)} frames")
            codes.append(estimate(model, cycle, out / name))
        progress("poses on meshes", len(steps) - 1, len(steps) - 1, "done")
    raise SystemExit(3 if 3 in codes else max(codes))


if __name__ == "__main__":
    run_program(main)
