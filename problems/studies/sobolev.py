"""Derivatives as data: what a contact model's exact Jacobian is worth to a network, beside more poses.

A root load s of the knee's medial side is fitted over walking by one network, by Levenberg-Marquardt, from

- n poses, the value of each;
- the same n poses, value and six slopes of each (Sobolev training, Czarnecki et al. 2017): 7n rows;
- 7n poses, the value of each: as many rows, and so about as much work in a step.

Slopes count in units of the error that they make over `SHARES` of the poses' standard deviations; of the shares the
best is told, which favours them. Errors are those of the normal load on poses that nobody has seen. Run
``python -m problems.studies.sobolev --help``.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.progress import track
from rich.table import Table

from casadi_contact.contact.choice import foundation
from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.terminal import PlainConsole
from casadi_contact.networks.training.levenberg_marquardt import next_damping
from casadi_contact.networks.training.weights import flatten, initial_network, layer_shapes
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.walking import reference_cycle
from casadi_contact.surrogate.load import load_surrogate
from problems import pose_estimation
from problems.common.command import RESULTS, new_app, run_command
from problems.common.records import write_summary
from problems.studies.stability.walking_samples import walking_samples

NAME = "sobolev"
SHARES = (0.03, 0.1, 0.3)
_TEST_POSES = 4000
app = new_app()


@dataclass(frozen=True)
class Rows:
    """Poses as a network sees them: inputs x (n, 6) of mean 0 and deviation 1, root loads s (n,) and ds/dx (n, 6), and
    weights (n,) that turn errors of s into newtons."""

    inputs: Array
    roots: Array
    slopes: Array
    weights: Array

    def first(self, count: int) -> Rows:
        """The first so many."""
        return Rows(self.inputs[:count], self.roots[:count], self.slopes[:count], self.weights[:count])


def drawn_rows(model: ContactModel, around: Array, count: int) -> tuple[Rows, Rows]:
    """``count`` rows to learn, and `_TEST_POSES` that nobody learns, about walking; both sides pressed."""
    samples = walking_samples(model, around, 2 * (count + _TEST_POSES))  # type: ignore[arg-type]
    poses = samples.poses[samples.domain == 1][: count + _TEST_POSES]
    if len(poses) < count + _TEST_POSES:
        raise ValueError(f"{len(poses)} of {count + _TEST_POSES} poses settled, expected all: ask for fewer")
    roots, slopes = model.root_loads(poses)
    mean, deviation = poses.mean(axis=0), poses.std(axis=0)
    n0 = model.scene.reference_load
    rows = Rows((poses - mean) / deviation, roots[:, 0], slopes[:, 0] * deviation, 2.0 * n0 * roots[:, 0])
    tests = Rows(*(array[count:] for array in (rows.inputs, rows.roots, rows.slopes, rows.weights)))
    return rows.first(count), tests


def fitted(rows: Rows, tests: Rows, share: float, hidden: tuple[int, ...], steps: int, seed: int) -> float:
    """RMS error on the tests [N] of a network fitted to values, and with a share above 0 to slopes."""
    import torch
    from torch.func import jacrev, vmap

    start = initial_network(rows.inputs, rows.roots, hidden, "algebraic", seed)
    scale = float(start.output_scale)
    shapes = layer_shapes(6, hidden)

    def output(parameters: Any, x: Any) -> Any:
        begin, a = 0, x
        for level, (neurons, width) in enumerate(shapes):
            v = parameters[begin : begin + neurons * width].reshape(neurons, width)
            begin += neurons * width
            a = v[:, :-1] @ a + v[:, -1]
            if level < len(shapes) - 1:
                a = a / torch.sqrt(1.0 + a * a)
        return scale * a[0]

    def residuals(parameters: Any, x: Any, s: Any, slope: Any, weight: Any) -> Any:
        value = weight * (output(parameters, x) - s)
        if share == 0.0:
            return value[None]
        of_x = jacrev(output, argnums=1)(parameters, x)
        return torch.cat([value[None], weight * share * (of_x - slope)])

    shift, size = torch.tensor(start.input_shift), torch.tensor(start.input_scale)

    def tensors(of: Rows) -> tuple[Any, ...]:
        x = (torch.tensor(of.inputs) - shift) / size
        return x, torch.tensor(of.roots), torch.tensor(of.slopes) * size, torch.tensor(of.weights)

    learned, unseen = tensors(rows), tensors(tests)
    every = (None, 0, 0, 0, 0)
    of_all, jacobian_of_all = vmap(residuals, every), vmap(jacrev(residuals), every)
    parameters, damping, growth = torch.tensor(flatten(start)), 1e-2, 2.0
    r = of_all(parameters, *learned).reshape(-1)
    for _ in range(steps):
        jacobian = jacobian_of_all(parameters, *learned).reshape(len(r), -1)
        gram, gradient = jacobian.T @ jacobian, jacobian.T @ r
        shift_of = damping * float(gram.diagonal().mean())
        step = -torch.linalg.solve(gram + shift_of * torch.eye(len(gram), dtype=gram.dtype), gradient)
        predicted = -0.5 * float(gradient @ step) + 0.5 * shift_of * float(step @ step)
        tried = of_all(parameters + step, *learned).reshape(-1)
        gained = 0.5 * float(r @ r) - 0.5 * float(tried @ tried)
        damping, growth = next_damping(damping, growth, gained / predicted if predicted > 0.0 else -1.0)
        if gained > 0.0:
            parameters, r = parameters + step, tried
    off = vmap(lambda x, s, weight: weight * (output(parameters, x) - s))(unseen[0], unseen[1], unseen[3])
    return float(torch.sqrt((off**2).mean()))


@app.command()
def run(
    poses: Annotated[list[int], typer.Argument(help="numbers n of poses to learn", min=50)] = [200, 800],  # noqa: B006
    hidden: Annotated[int, typer.Option(min=1, help="neurons in each of two layers")] = 12,
    steps: Annotated[int, typer.Option(min=1, help="steps of Levenberg-Marquardt")] = 100,
    seeds: Annotated[int, typer.Option(min=1, help="random starts of each network; their median is told")] = 3,
    out: Annotated[Path, typer.Option(help="folder for sobolev.json")] = RESULTS / NAME,
) -> None:
    """Fit the same network to values, to values and slopes, and to more values."""
    writable_folder(out)
    walking = pose_estimation.solve(pose_estimation.build(load_surrogate("knee"), reference_cycle())).poses
    all_rows, tests = drawn_rows(foundation(load_scene("knee")), walking, 7 * max(poses))
    lines = []
    for count, what in track([(n, what) for n in poses for what in ("values", "slopes", "more poses")], "fits"):
        rows = all_rows.first(7 * count if what == "more poses" else count)
        best: dict[str, Any] = {"error_N": np.inf}
        for share in SHARES if what == "slopes" else (0.0,):
            began = time.process_time()
            errors = [fitted(rows, tests, share, (hidden, hidden), steps, seed) for seed in range(seeds)]
            seconds = (time.process_time() - began) / seeds
            if np.median(errors) < best["error_N"]:
                best = {"error_N": float(np.median(errors)), "errors_N": errors, "share": share, "cpu_s": seconds}
        row_count = len(rows.roots) * (7 if what == "slopes" else 1)
        lines.append({"what": what, "poses": len(rows.roots), "rows": row_count, **best})
    write_summary(out / f"{NAME}.json", {"hidden": [hidden, hidden], "steps": steps, "seeds": seeds, "fits": lines})
    console = PlainConsole()
    console.print(_table(lines))
    console.print(f"results in {out}", highlight=False)


def _table(lines: Sequence[dict[str, Any]]) -> Table:
    table = Table("learned", "poses", "rows", "RMS error [N]", "lowest to highest", "CPU [s] a fit")
    names = {"values": "values", "slopes": "values and slopes", "more poses": "values"}
    for line in lines:
        share = f", share {line['share']:g}" if line["share"] else ""
        told = names[line["what"]] + share
        scatter = f"{min(line['errors_N']):.3g} to {max(line['errors_N']):.3g}"
        cells = (line["poses"], line["rows"], f"{line['error_N']:.3g}", scatter, f"{line['cpu_s']:.1f}")
        table.add_row(told, *map(str, cells))
    return table


def main() -> None:
    """Entry point: a user's mistake is one line on stderr and exit status 1."""
    run_command(app, f"studies.{NAME}")


if __name__ == "__main__":
    main()
