"""``casadi-contact cut``: a mesh scene whose patches are cut into parts that networks learn apart."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from casadi_contact.cli import pipeline
from casadi_contact.cli.arguments import DEFAULT_PRESET, Cycles, ModelName, Out, PresetName, console
from casadi_contact.core.files.writing import writable_folder, write_text
from casadi_contact.core.terminal import progress_bars
from casadi_contact.samples.models import model_pair
from casadi_contact.workflow.project import Project
from casadi_contact.workflow.proposal.cuts import WORTH, cut_scene, find_cuts
from casadi_contact.workflow.proposal.text import cut_lines, cut_text


def cut(
    scene: Annotated[str, typer.Argument(help="the path of a mesh scene's .toml, its patches whole")],
    to: Annotated[Path | None, typer.Option(help="file of the cut scene; SCENE_parts.toml if left out")] = None,
    cycles: Cycles = None,
    preset: PresetName = DEFAULT_PRESET,
    model: ModelName = "foundation",
    worth: Annotated[
        float, typer.Option(help="share of the error that one more part must take off: less for more parts")
    ] = WORTH,
    out: Out = None,
    force: Annotated[bool, typer.Option("--force", help="replace a scene file that is there")] = False,
) -> None:
    """Find where to cut the patches of a mesh scene into parts, from samples of its contact model without training.

    Samples are drawn where the folder holds none.
    """
    given = Path(scene)
    path = given.with_name(f"{given.stem}_parts.toml") if to is None else to
    if path.suffix != ".toml":
        raise ValueError(f"--to is {path}, expected a scene file, for example my_parts.toml")
    if path.exists() and not force:
        raise ValueError(f"{path} would be replaced: give another --to, or --force")
    project = Project.open(scene, preset, out)
    writable_folder(path.parent)  # before minutes of sampling
    with progress_bars(console) as update:
        samples, _ = pipeline.sample(project, cycles or [], update, models=model_pair(model))
        found = find_cuts(project.scene, samples, update, worth=worth)
    whole = project.scene
    parts = cut_scene(whole, [cuts.cuts_mm for cuts in found], [cuts.bounds_mm for cuts in found])
    sampled = [*(word for file in cycles or [] for word in ("--cycles", str(file))), "--model", model]
    command = project.command("cut", *sampled, "--worth", f"{worth:g}")
    write_text(path, cut_text(parts, found, command, path.parent))
    console.print(*cut_lines(found), sep="\n", highlight=False, soft_wrap=True)
    console.print(f"scene in {path}", highlight=False, soft_wrap=True)
    if len(parts.parts) > len(whole.parts):
        build = shlex.join(["casadi-contact", "build", str(path), "--preset", "parts", *sampled])
        console.print(f"its networks: {build}", highlight=False, soft_wrap=True)
