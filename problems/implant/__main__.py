"""From the mesh files of a joint to the poses of measured cycles, in one command and with nothing trained.

The scene file names the meshes; two meshes in its place have one proposed (`from_meshes`). The poses of each cycle are
estimated in IPOPT (`problems.pose_estimation`) on the foundation of that scene (`cc.foundation`) and checked on its
element grid. ``--surrogate`` puts networks in the foundation's place: they are sampled, trained, evaluated and exported
into the same folder first (as ``casadi-contact build`` does; run again, it goes on from what is there).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli.build import build as build_surrogates
from casadi_contact.cli.propose import name_of_mesh
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.convergence import NotGoodEnoughError
from casadi_contact.core.compiler import warn_once
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.scene import Scene
from casadi_contact.workflow.presets import PRESETS
from casadi_contact.workflow.project import Project, reference_motion_cycles
from casadi_contact.workflow.train import structures_for_scene
from problems.common.command import RESULTS, new_app, run_command
from problems.common.contact import ContactSource
from problems.implant.from_meshes import fixed_and_cycles, is_mesh, scene_of_meshes
from problems.pose_estimation import estimate

NAME = "implant"
app = new_app()


@app.command()
def run(
    scene: Annotated[Path, typer.Argument(help="scene file that names the meshes, or the moving body's mesh")],
    cycles: Annotated[
        list[Path],
        typer.Argument(help="measured cycles (CSV) to find the poses of; after a mesh the fixed body's first"),
    ],
    surrogate: Annotated[bool, typer.Option("--surrogate", help="train networks and solve on these")] = False,
    preset: Annotated[str, typer.Option(help=f"how much to sample and train: {', '.join(PRESETS)}")] = "quick",
    out: Annotated[Path | None, typer.Option(help="folder of all results; results/implant/SCENE if left out")] = None,
) -> None:
    """Find the poses of measured cycles on the meshes of a joint.

    Two meshes (STL, OBJ, PLY or VTP) in place of a scene file have one proposed first, as casadi-contact scene does:
    look at its picture.

    Exit status 2: some frames are not solved, and are named with the reason; 3: all are, but some are not
    verified: the contact model of the meshes differs, or counts not all of their load.
    """
    fixed = None
    if is_mesh(scene):
        fixed, cycles = fixed_and_cycles(scene, cycles)
    _check_names(cycles)
    if fixed is not None:
        out = RESULTS / NAME / name_of_mesh(fixed) if out is None else out
        scene = scene_of_meshes(scene, fixed, out)
    joint = load_scene(scene)
    measured = reference_motion_cycles(joint, cycles)  # before minutes of training
    folder = RESULTS / NAME / joint.name if out is None else out
    source = ContactSource(scene=str(scene))
    if surrogate:
        build_surrogates(str(scene), preset=preset, cycles=list(cycles), model=_model_to_learn(joint), out=folder)
        project = Project(joint, preset, folder)
        source = ContactSource(surrogate=str(project.surrogate_path(structures_for_scene(project)[0])))
    writable_folder(folder)
    model = source.load()
    codes = []
    for number, (path, cycle) in enumerate(zip(cycles, measured, strict=True), start=1):
        typer.echo(f"cycle {number} of {len(measured)}: {path.stem}, {len(cycle.time_s)} frames")
        codes.append(estimate(model, cycle, folder / "poses" / path.stem))
    if any(codes):
        worst = "some frames have no pose" if 2 in codes else "some frames are not verified"
        typer.echo(f"{NAME}: {worst}; see above", err=True)
        raise typer.Exit(2 if 2 in codes else 3)


def _check_names(cycles: Sequence[Path]) -> None:
    """ValueError where two cycles have one name, by which their results go into one folder (perhaps of a file system
    that takes capitals for small letters)."""
    known: dict[str, Path] = {}
    for path in cycles:
        first = known.setdefault(path.stem.casefold(), path)
        if first is not path:
            raise ValueError(
                f"got the cycles {first} and {path}, expected names that differ: results go into poses/{path.stem}; "
                "rename one"
            )


def _model_to_learn(scene: Scene) -> str:
    """What networks are sampled on: the scene's foundation, elements where none is good enough."""
    try:
        foundation(scene)
    except NotGoodEnoughError as error:
        warn_once(f"{error}; networks learn from elements, which takes longer")
        return "elements"
    return "foundation"


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, NAME)


if __name__ == "__main__":
    main()
