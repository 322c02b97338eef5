"""What friction costs and how exact it is.

Times per pose of kernels that slide and at rest; friction of a surrogate against that of the foundation it learned; a
ball that slides on a plane, by rays and by OpenSim's ElasticFoundationForce on a mesh, each against its own closed
form: the springs of a rigid ball of radius R, pressed by d, of stiffness k lie on the plane under it, and carry
k·π·d²(R - d/3), or on the ball, as OpenSim's do, and carry k·π·R·d²; friction is f of it. OpenSim's time is that of a
state's forces, less that of the same model without the force. Times are CPU times, the lowest of several.
"""

import json
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import casadi_contact as cc
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.core.terminal import run_program
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.candidates import time_batch, time_mapped
from casadi_contact.workflow.opensim_import.process import run_opensim

RATES = np.array([30.0, 5.0, 10.0, 0.3, 0.5, 2.0])
RUBBING = {"dynamic_friction": 0.2, "viscous_friction": 1e-3, "transition_velocity": 2.0, "dissipation": 2e-3}
SLIDING = np.array([30.0, 0.0, -40.0, 0.0, 0.0, 0.0])  # of the ball [mm/s]
BY_OPENSIM = """
import json, sys, time, opensim
given, rows, meshes = map(json.loads, sys.argv[1:])

def made(mesh, with_force):
    model, ball = opensim.Model(), opensim.Body("ball", 1.0, opensim.Vec3(0), opensim.Inertia(1.0))
    joint, down = opensim.FreeJoint("free", model.getGround(), ball), opensim.Vec3(0, 0, -1.5707963267948966)
    surface = opensim.ContactMesh(mesh, opensim.Vec3(0), opensim.Vec3(0), ball, "mesh")
    plane = opensim.ContactHalfSpace(opensim.Vec3(0), down, model.getGround(), "plane")
    force = opensim.ElasticFoundationForce()
    model.addBody(ball), model.addJoint(joint)
    if with_force:
        model.addForce(force)
    for geometry in (surface, plane):
        model.addContactGeometry(geometry), force.addGeometry(geometry.getName())
    for name, value in given.items():
        getattr(force, "set" + name)(value)
    return joint, model, force, model.initSystem()

def taken(joint, model, force, state, row):
    best = 1.0
    for _ in range(5):
        began = time.process_time()
        for _ in range(4):
            for k in range(6):
                joint.get_coordinates(k).setValue(state, row[k], False)
                joint.get_coordinates(k).setSpeedValue(state, row[6 + k])
            model.realizeDynamics(state)
        best = min(best, (time.process_time() - began) / 4)
    return best

found = []
for mesh in meshes:
    whole, bare = made(mesh, True), made(mesh, False)
    for row in rows:
        seconds = taken(*whole, row) - taken(*bare, row)
        values = whole[2].getRecordValues(whole[3])
        found.append([values.get(k) for k in range(6, 12)] + [1e6 * seconds])
print(json.dumps(found))
"""


def by_opensim(
    model: cc.ElasticFoundation | CompiledFoundation, poses: Array, rates: Array, balls: list[Path]
) -> Array:
    """Wrench on the plane [N, N·mm] and time [µs] (balls, n, 7) of the friction and the layer of a model's scene."""
    law, friction = model.scene.material, model.scene.friction
    given = {"Stiffness": law.modulus / law.thickness * 1e9, "Dissipation": 1e3 * friction.dissipation}
    given |= {"StaticFriction": friction.static_friction, "DynamicFriction": friction.dynamic_friction}
    given |= {"ViscousFriction": 1e3 * friction.viscous_friction}
    given |= {"TransitionVelocity": 1e-3 * friction.transition_velocity}
    unit = np.repeat([1.0, 1e-3], 3)
    rows = np.hstack([poses[:, [3, 4, 5, 0, 1, 2]] * unit, rates[:, [3, 4, 5, 0, 1, 2]] * unit])
    arguments = (json.dumps(each) for each in (given, rows.tolist(), [str(ball.resolve()) for ball in balls]))
    said = run_opensim("-c", BY_OPENSIM, *arguments)
    found = np.array(json.loads(said.strip().splitlines()[-1])).reshape(len(balls), len(poses), 7)
    return found * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3, 1.0]


def microseconds(stopwatch: Callable[..., float], *arguments: Any) -> float:
    """Time of a pose by a stopwatch of the benchmark, the lowest of several."""
    return 1e6 * min(stopwatch(*arguments) for _ in range(15))


def costs(model: CompiledFoundation | Surrogate, poses: Array) -> Array:
    """Times [µs] of value, Jacobian, Hessian (3,) at poses (n, 6): at rest and sliding (2, 3)."""
    rows, given = [], np.hstack([poses, np.tile(RATES, (len(poses), 1))])
    for size in (6, 12):
        x = ca.MX.sym("x", size)
        loads = model.function(velocity=size == 12)(*ca.vertsplit(x, 6))
        weighed = ca.dot(np.cos(np.arange(loads.numel())), loads)
        parts = (loads, ca.jacobian(loads, x), ca.hessian(weighed, x)[0])
        maps = [ca.Function("part", [x], [part]).map(len(poses)) for part in parts]
        rows.append([microseconds(time_mapped, each, given[:, :size]) for each in maps])
    return np.array(rows)


def surrogate_misses(model: Surrogate, poses: Array) -> None:
    """Print how far a surrogate's friction lies from its foundation's, and how often its loads lie within the expected
    error where bodies slide, all coefficients but friction and transition velocity being zero."""
    foundation, rates = cc.foundation(model.scene), np.random.default_rng(1).normal(size=poses.shape) * RATES
    still, moving = ([each(poses, velocities=way) for each in (model, foundation)] for way in (0.0 * rates, rates))
    rubbed, missed = ([one - other for one, other in zip(moving, still, strict=True)], moving[0] - moving[1])
    covered = np.abs(missed) <= model.expected_error(poses, sliding=True)
    print(f"friction of {model!r} in {len(poses)} poses, against {foundation!r}")
    for k, load in enumerate(model.load_names):
        rms, largest = np.sqrt(np.mean((rubbed[0] - rubbed[1])[:, k] ** 2)), np.abs(rubbed[1][:, k]).max()
        print(f"  {load:8s} RMS {rms:8.3g}, largest {largest:8.3g}; loads covered {np.mean(covered[:, k]):.0%}")


def ball_on_plane(folder: Path, levels: tuple[int, ...]) -> None:
    """Print error and time of a sliding ball: rays, and OpenSim on meshes that get finer."""
    import trimesh

    scene = cc.load_scene("sphere_on_plane", **RUBBING)
    R, k = scene.geometry["radius"], scene.material.modulus / scene.material.thickness
    d, zero = np.linspace(0.1, 0.5, 9), np.zeros(9)
    poses, rates = np.column_stack([zero, R - d, zero, zero, zero, zero]), np.tile(SLIDING, (9, 1))
    share = RUBBING["dynamic_friction"] + RUBBING["viscous_friction"] * float(np.linalg.norm(SLIDING))

    def errors(wrenches: Array, exact: Array) -> Array:
        normal = np.abs(wrenches[:, 1]) / exact - 1.0
        dragged = np.hypot(wrenches[:, 0], wrenches[:, 2]) / exact / share - 1.0
        return np.sqrt(np.mean([normal**2, dragged**2], axis=1))

    print("ball on a plane, sliding: RMS error of N and of friction; time")
    ours = {}
    for rays in (cc.Rays(8, 2), cc.Rays(8, 3)):
        model = cc.PolarFoundation(scene, rays)
        many = [np.tile(each, (40, 1)) for each in (poses, rates)]
        ours[rays] = microseconds(time_batch, partial(model.moving_wrenches, velocities=many[1]), many[0])
        off = errors(model.wrenches(poses, rates)[:, 0], np.pi * k * d**2 * (R - d / 3.0))
        print(f"  {rays!s:20s} {off[0]:9.2g} {off[1]:9.2g} {ours[rays]:9.3g} µs")
    balls = [folder / f"ball{level}.obj" for level in levels]
    for level, ball in zip(levels, balls, strict=True):
        trimesh.creation.icosphere(subdivisions=level, radius=1e-3 * R).export(ball)
    for level, found in zip(levels, by_opensim(model, poses, rates, balls), strict=True):
        off, took = errors(found, np.pi * k * R * d**2), found[:, 6].mean()
        print(f"  OpenSim, {20 * 4**level:7d} faces {off[0]:7.2g} {off[1]:9.2g} {took:9.3g} µs", end="")
        print(f", {took / ours[rays]:.0f} times that of {rays}")


def main(surrogate: str = "knee", finest: int = 7, count: int = 300) -> None:
    """Print times and errors of friction. finest: subdivisions of OpenSim's ball, each with four times the faces."""
    model = cc.load_surrogate(surrogate, dynamic_friction=0.06, transition_velocity=2.0)
    rays, foot = cc.foundation(model.scene), cc.foundation(cc.load_scene("foot_on_ground"))
    poses, targets = model.require_confidence().centre_poses[:count], dict.fromkeys(model.scene.sensitive_loads, -500.0)
    poses, _ = cc.settle(rays, poses, free=model.scene.sensitive_pose, targets=targets)
    poses = poses[model.validity(poses) > 0.5]
    standing = np.array([0.0, -21.0, 0.0, 0.0, 0.0, 0.05]) + 1e-3 * np.random.default_rng(1).normal(size=(count, 6))
    print("µs a pose of 500 N on each patch, at rest, sliding: value; Jacobian; Hessian")
    for each, at in ((rays, poses), (foot, standing), (model, poses)):
        print(f"  {each!r:60.60s}", "; ".join(f"{a:.2f} {b:.2f}" for a, b in zip(*costs(each, at), strict=True)))
    surrogate_misses(model, poses)
    with tempfile.TemporaryDirectory() as folder:
        ball_on_plane(Path(folder), tuple(range(5, finest + 1)))


if __name__ == "__main__":
    run_program(main)
