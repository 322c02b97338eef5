"""How exact finite elements are, mesh by mesh, and `knee_fem` beside them: how slow is the mesh of its own error?

Against loads of the most layers, corrected by what the narrowest nodes change on two layers. Poses: samples of D1 held
back (``casadi-contact build knee_fem --model finite-elements --preset standard``). Of `knee_fem` also bias and coverage
over all of them.
"""

from functools import partial
from pathlib import Path

import numpy as np

import casadi_contact as cc
from casadi_contact.core.quantities import FORCE, of_kind
from casadi_contact.core.terminal import run_program
from casadi_contact.samples.samples import TEST, read_samples
from casadi_contact.workflow.benchmark.candidates import compare, time_batch, time_single_calls


def main(samples: Path = Path("results/knee_fem-standard/samples.h5"), most_layers: int = 5) -> None:
    """Print errors, times, and the ratio of times at the same error."""
    whole, surrogate = read_samples(samples), cc.load_surrogate("knee_fem")
    scene, names, known, unseen = whole.scene, whole.scene.load_names, whole.select("D1"), whole.select(role=TEST)
    poses, largest = known.select(role=TEST).poses, np.abs(known.loads(names)).max(axis=0)
    layers = {k: cc.FiniteElements(scene, mesh=cc.Hexahedra(k))(poses) for k in range(2, most_layers + 1)}
    for count, found in layers.items():
        off = 100.0 * np.sqrt(np.mean((found - layers[most_layers]) ** 2, axis=0)) / largest
        print(f"{count} layers: each load within {off.max():.2f} % of its largest of {most_layers} layers")
    meshes = [cc.FiniteElements(scene, grid, cc.Hexahedra(2)) for grid in ((29, 21), (39, 29), (59, 45), (79, 61))]
    watches = {mesh.label: partial(time_batch, mesh, poses) for mesh in meshes}
    times = compare(watches | {"knee_fem": partial(time_single_calls, surrogate.function(), poses)})
    finest, spread = meshes[-1](poses), layers[most_layers] - layers[2]
    errors = {mesh.label: mesh(poses) - finest for mesh in meshes} | {"knee_fem": surrogate(poses) - finest - spread}
    columns = [names.index(name) for name in of_kind(names, FORCE)]
    rms = {label: float(np.sqrt(np.mean(error[:, columns] ** 2))) for label, error in errors.items()}
    for label, error in rms.items():
        print(f"{label}: {times[label].median_us:.3g} µs, {error:.2f} N RMS over all forces off {meshes[-1].label}")
    (e0, t0), (e1, t1) = ((rms[mesh.label], times[mesh.label].median_us) for mesh in meshes[1:3])
    same = t0 * (rms["knee_fem"] / e0) ** (np.log(t1 / t0) / np.log(e1 / e0))
    print(f"a mesh as exact as knee_fem: {same:.0f} µs, {same / times['knee_fem'].median_us:.0f} times its time")
    target, bound = unseen.loads(names), surrogate.expected_error(unseen.poses)
    missed = surrogate(unseen.poses) - target
    for name, off, below, load, most in zip(names, missed.T, (abs(missed) <= bound).T, target.T, largest, strict=True):
        covered = 100.0 * np.mean(below[load != 0.0])
        print(f"{name}: bias {100 * off.mean() / most:.2f} % of the largest, {covered:.1f} % below the expected error")


if __name__ == "__main__":
    run_program(main)
