"""What the opensim wheel says of a model, in a process of its own: its package and casadi's must not share one.

    python wheel.py describe MODEL.osim REPLY.json
    python wheel.py measure  MODEL.osim REQUEST.npz REPLY.npz

A script without casadi_contact. ``describe`` writes an assembly's tables (mm, rad, N, kg: see `assembly.file`) but for
contacts and wraps, muscles' curves by name, the surface that each path wraps over, frames by path, and what is lost.
``measure`` takes coordinates (n, c) with their names, and names of ligaments and muscles, and writes lengths (n, f)
[m], from which to which path point each wraps (n, f, 2), -1 where it does not, moment arms (n, f, c) if asked for, and
the transforms (n, b, 3, 4) of the named bodies in the ground.
"""

import json
import re
import sys
from functools import cached_property
from typing import Any

import numpy as np
import opensim

_ROTATIONS = {"PinJoint": "z", "UniversalJoint": "xy", "BallJoint": "xyz", "GimbalJoint": "xyz", "FreeJoint": "xyz"}
_ROTATIONS |= {"WeldJoint": "", "PlanarJoint": "z", "SliderJoint": ""}
_TRANSLATIONS = {"FreeJoint": "xyz", "PlanarJoint": "xy", "SliderJoint": "x"}
CURVE_LENGTHS = np.linspace(0.0, 2.5, 501)  # of fibres, over their optimal length
CURVE_SPEEDS = np.linspace(-1.5, 1.5, 301)  # over the greatest speed


def numbers(vector: Any) -> list[float]:
    """A SimTK vector of three as plain numbers."""
    return [float(vector.get(i)) for i in range(3)]


def transform(found: Any) -> np.ndarray:
    """(3, 4) rotation and translation of a SimTK transform."""
    R, t = found.R(), found.p()
    return np.array([[*(float(R.get(i, j)) for j in range(3)), float(t.get(i))] for i in range(3)])


def pose(found: Any) -> list[float]:
    """Pose [mm, rad] of a SimTK transform."""
    return [*(1e3 * v for v in numbers(found.p())), *numbers(found.R().convertRotationToBodyFixedXYZ())]


def base(frame: Any) -> str:
    """Name of the body that a frame is fixed to."""
    return str(frame.findBaseFrame().getName())


def function_values(function: Any, span: tuple[float, float], unit: float, per: float) -> dict[str, Any]:
    """A function of one coordinate: offset and slope of a line, else x, y and dy/dx at its knots, cubic between them;
    unit: of its value in m or rad, per: of the coordinate."""
    scale = unit
    while multiplier := opensim.MultiplierFunction.safeDownCast(function):
        scale, function = scale * multiplier.getScale(), multiplier.getFunction()

    def at(x: float, order: int = 0) -> float:
        point, parts = opensim.Vector(1, float(x)), opensim.StdVectorInt()
        if order == 0:
            return scale * float(function.calcValue(point))
        parts.append(0)
        return scale * float(function.calcDerivative(parts, point))

    if function.getConcreteClassName() in ("Constant", "LinearFunction"):
        offset = at(0.0)
        return {"offset": offset, "slope": (at(1.0) - offset) / per}
    spline = opensim.SimmSpline.safeDownCast(function)
    places = [float(spline.getX(i)) for i in range(spline.getSize())] if spline else np.linspace(*span, 61).tolist()
    return {"knots": [number for x in places for number in (per * x, at(x), at(x, 1) / per)]}


def joint_axes(joint: Any) -> dict[str, Any]:
    """Rotations and translations of a joint, one after another, each along an axis by a function of one coordinate."""
    kind, found = joint.getConcreteClassName(), [joint.get_coordinates(i) for i in range(joint.numCoordinates())]
    coordinates = {c.getName(): c for c in found}
    axes: dict[str, Any] = {"rotations": [], "translations": []}
    if custom := opensim.CustomJoint.safeDownCast(joint):
        for k in range(6):
            axis = custom.getSpatialTransform().getTransformAxis(k)
            of = [axis.get_coordinates(i) for i in range(axis.getCoordinateNames().size())]
            if len(of) > 1:
                raise ValueError(f"joint {joint.getName()} has an axis of {', '.join(of)}, expected one coordinate")
            c = coordinates[of[0]] if of else None
            span, per = ((c.getRangeMin(), c.getRangeMax()), scale_of(c)) if c else ((0.0, 1.0), 1.0)
            values = function_values(axis.getFunction(), span, 1.0 if k < 3 else 1e3, per)
            if of or values["offset"]:
                given = {"axis": numbers(axis.getAxis()), "of": of[0] if of else "", **values}
                axes["rotations" if k < 3 else "translations"].append(given)
        return axes
    if kind not in _ROTATIONS:
        raise ValueError(f"joint {joint.getName()} is a {kind}, expected one of CustomJoint, {', '.join(_ROTATIONS)}")
    letters = [("rotations", a) for a in _ROTATIONS[kind]] + [("translations", a) for a in _TRANSLATIONS.get(kind, "")]
    for (group, letter), name in zip(letters, coordinates, strict=True):
        along = [float(letter == each) for each in "xyz"]
        axes[group].append({"axis": along, "of": name, "offset": 0.0, "slope": 1.0})
    return axes


def scale_of(coordinate: Any) -> float:
    """mm or rad in one of its units, m or rad."""
    return 1e3 if coordinate.getMotionType() == opensim.Coordinate.Translational else 1.0


class Model:
    """A model file, its state, and its ligaments and muscles by name."""

    def __init__(self, path: str) -> None:
        opensim.Logger.setLevelString("off")
        self.file, self.model = path, opensim.Model(path)
        self.state = self.model.initSystem()
        forces = self.model.getForceSet()
        self.paths: dict[str, Any] = {}
        self.forces = [forces.get(i) for i in range(forces.getSize())]
        for force in self.forces:
            for kind in (opensim.Blankevoort1991Ligament, opensim.Ligament, opensim.PathActuator):
                if found := kind.safeDownCast(force):
                    self.paths[force.getName()] = found.getGeometryPath()
        coordinates = self.model.getCoordinateSet()
        self.coordinates = {coordinates.get(i).getName(): coordinates.get(i) for i in range(coordinates.getSize())}

    def describe(self) -> dict[str, Any]:
        """All that `workflow.opensim_import` needs of it, as plain values."""
        bodies, constraints = self.model.getBodySet(), self.model.getConstraintSet()
        self.curves, self.wraps, self.surfaces = dict[str, Any](), dict[str, Any](), dict[str, Any]()
        self.lost: list[str] = []
        for frame in filter(None, map(opensim.PhysicalFrame.safeDownCast, self.model.getFrameList())):
            objects, within = frame.getWrapObjectSet(), frame.findTransformInBaseFrame()
            for wrap in (objects.get(i) for i in range(objects.getSize())):
                own = self.surfaces[wrap.getName()] = {"body": base(frame)}
                if cylinder := opensim.WrapCylinder.safeDownCast(wrap):  # its axis is z
                    place = pose(within.compose(cylinder.getTransform()))
                    own |= {"frame": place, "radius_mm": 1e3 * cylinder.get_radius()}
        joints = {}
        for joint in self.model.getJointList():
            parent, child = joint.getParentFrame(), joint.getChildFrame()
            joints[joint.getName()] = {
                "parent": base(parent),
                "child": base(child),
                "parent_frame": pose(parent.findTransformInBaseFrame()),
                "child_frame": pose(child.findTransformInBaseFrame()),
                **joint_axes(joint),
            }
        tables = {
            "format": 1,
            "name": re.sub(r"^(?![A-Za-z])", "model_", re.sub(r"[^A-Za-z0-9_]", "_", self.model.getName()))[:64],
            "ground": "ground",
            "gravity_m_s2": numbers(self.model.getGravity()),
            "paths": "paths.h5",
            "coordinates": {name: self._coordinate(c) for name, c in self.coordinates.items()},
            "bodies": {b.getName(): self._body(b) for b in (bodies.get(i) for i in range(bodies.getSize()))},
            "joints": joints,
            **self._forces(),
        }
        for each in (constraints.get(i) for i in range(constraints.getSize())):
            self.lost.append(f"{each.getName()}: a constraint, which no longer holds")
        frames = {
            frame.getAbsolutePathString(): {"body": base(frame), "pose": pose(frame.findTransformInBaseFrame())}
            for frame in self.model.getFrameList()
        }
        return {"tables": tables, "curves": self.curves, "wraps": self.wraps, "frames": frames, "lost": self.lost}

    def _body(self, body: Any) -> dict[str, Any]:
        values = {"mass_kg": body.getMass(), "centre_mm": [1e3 * v for v in numbers(body.getMassCenter())]}
        return values | {"inertia_kgmm2": [1e6 * float(body.get_inertia().get(i)) for i in range(6)]}

    def _coordinate(self, c: Any) -> dict[str, Any]:
        """A locked coordinate has no range but its value."""
        scale, rest = scale_of(c), c.getDefaultValue()
        low, high = (rest, rest) if c.getDefaultLocked() else (c.getRangeMin(), c.getRangeMax())
        kind, given = "rotation" if scale == 1.0 else "translation", {"default": rest, "low": low, "high": high}
        return {"kind": kind, **{key: scale * value for key, value in given.items()}}

    def _forces(self) -> dict[str, Any]:
        """Tables of ligaments, muscles and springs by name; what other forces there are is lost."""
        tables: dict[str, Any] = {"ligaments": {}, "muscles": {}, "coordinate_springs": {}}
        for force in self.forces:
            name, kind = force.getName(), force.getConcreteClassName()
            ligament = opensim.Blankevoort1991Ligament.safeDownCast(force)
            muscle, spring = self._muscle(force), opensim.SpringGeneralizedForce.safeDownCast(force)
            if not (spring or ligament or muscle):
                self.lost.append(f"{name}: {kind}")
            elif not force.get_appliesForce() or (ligament and not ligament.get_linear_stiffness()):
                self.lost.append(f"{name}: it applies no force, so it is left out")
            elif spring:
                values = {"stiffness": spring.getStiffness(), "rest": spring.getRestLength()}
                values |= {"of": spring.get_coordinate(), "viscosity": spring.getViscosity()}
                tables["coordinate_springs"][name] = values
            elif ligament:
                tables["ligaments"][name] = self._path(name) | {
                    "stiffness_n": ligament.get_linear_stiffness(),
                    "slack_length_mm": 1e3 * ligament.get_slack_length(),
                    "toe_strain": 0.5 * ligament.get_transition_strain(),
                    "damping_n_s": ligament.get_damping_coefficient(),
                }
            else:
                tables["muscles"][name] = self._path(name) | {
                    "max_force_n": muscle.getMaxIsometricForce(),
                    "optimal_fibre_mm": 1e3 * muscle.getOptimalFiberLength(),
                    "tendon_slack_mm": 1e3 * muscle.getTendonSlackLength(),
                    "pennation_rad": muscle.getPennationAngleAtOptimalFiberLength(),
                    "max_speed_per_s": muscle.getMaxContractionVelocity(),
                    "damping": muscle.get_fiber_damping(),
                    "curves": self._curves(muscle),
                }
                if kind != muscle.getConcreteClassName():
                    self.lost.append(
                        f"{name}: the curves of {kind}; those of {muscle.getConcreteClassName()} are taken"
                    )
        return tables

    def _muscle(self, force: Any) -> Any:
        """The force as a muscle of Millard, or of De Groote and Fregly, with which OpenSim replaces others."""
        if not opensim.Muscle.safeDownCast(force) or "Millard" in force.getConcreteClassName():
            return opensim.Millard2012EquilibriumMuscle.safeDownCast(force)
        return opensim.DeGrooteFregly2016Muscle.safeDownCast(self._replaced.getMuscles().get(force.getName()))

    @cached_property
    def _replaced(self) -> Any:
        model = opensim.Model(self.file)
        opensim.DeGrooteFregly2016Muscle.replaceMuscles(model, True)
        return model

    def _path(self, name: str) -> dict[str, Any]:
        """A path's table; notes the surface that it wraps over, a cylinder where that is all."""
        path, points, bodies, kinds = self.paths[name], [], [], set()
        for point in (path.getPathPointSet().get(i) for i in range(path.getPathPointSet().getSize())):
            X = transform(point.getParentFrame().findTransformInBaseFrame())
            points.append((1e3 * (X[:, :3] @ numbers(point.getLocation(self.state)) + X[:, 3])).tolist())
            bodies.append(base(point.getParentFrame()))
            kinds.add(point.getConcreteClassName())
        moving = sorted(kinds - {"PathPoint"})
        over = [self.surfaces[path.getWrapSet().get(i).getWrapObjectName()] for i in range(path.getWrapSet().getSize())]
        if over or moving:
            body = over[0]["body"] if over else bodies[0]
            self.wraps[name] = over[0] if len(over) == 1 and not moving else {"body": body, "moves": bool(moving)}
        if moving:
            self.lost.append(f"{name}: its {', '.join(moving)} stands still, its length is fitted all the same")
        return {"bodies": bodies, "points_mm": points}

    def _curves(self, muscle: Any) -> str:
        """Name of the muscle's curves: curves_1, curves_2 ... where they differ."""
        lengths, speeds = CURVE_LENGTHS.tolist(), CURVE_SPEEDS.tolist()
        if isinstance(muscle, opensim.DeGrooteFregly2016Muscle):
            active, passive = muscle.calcActiveForceLengthMultiplier, muscle.calcPassiveForceMultiplier
            of_speed = muscle.calcForceVelocityMultiplier
        else:
            of_length = muscle.getActiveForceLengthCurve(), muscle.getFiberForceLengthCurve()
            active, passive, of_speed = (c.calcValue for c in (*of_length, muscle.getForceVelocityCurve()))
        own = {"lengths": lengths, "speeds": speeds, "of_speed": [of_speed(v) for v in speeds]}
        own |= {"active": [active(x) for x in lengths], "passive": [passive(x) for x in lengths]}
        new = f"curves_{len(self.curves) + 1}"
        name = next((name for name, known in self.curves.items() if known == own), new)
        self.curves[name] = own
        return name

    def measure(self, request: Any) -> dict[str, Any]:
        """Lengths, wrapped stretches, moment arms and transforms at coordinates (n, c)."""
        names, values = [str(n) for n in request["coordinates"]], request["values"]
        paths = [self.paths[str(n)] for n in request["paths"]]
        bodies = [self.model.getBodySet().get(str(n)) for n in request["bodies"]]
        coordinates, arms_too = [self.coordinates[n] for n in names], bool(request["arms"])
        lengths, stretches = np.zeros((len(values), len(paths))), np.full((len(values), len(paths), 2), -1)
        arms = np.zeros((len(values), len(paths), len(names) if arms_too else 0))
        places = np.zeros((len(values), len(bodies), 3, 4))
        for c in coordinates:
            c.setLocked(self.state, False)
        for n, row in enumerate(values.tolist()):
            for coordinate, value in zip(coordinates, row, strict=True):
                coordinate.setValue(self.state, value, False)
            self.model.realizePosition(self.state)
            for p, path in enumerate(paths):
                lengths[n, p] = path.getLength(self.state)
                stretches[n, p] = self._stretch(path)
                for c in range(arms.shape[2]):
                    arms[n, p, c] = path.computeMomentArm(self.state, coordinates[c])
            for b, body in enumerate(bodies):
                places[n, b] = transform(body.getTransformInGround(self.state))
        return {"lengths": lengths, "stretches": stretches, "arms": arms, "places": places}

    def _stretch(self, path: Any) -> list[int]:
        """Numbers of the path points between which it wraps, the first and the last if it does so more than once."""
        if path.getWrapSet().getSize() == 0:
            return [-1, -1]
        current, fixed, ends = path.getCurrentPath(self.state), -1, []
        for i in range(current.getSize()):
            if current.get(i).getConcreteClassName() == "PathWrapPoint":
                ends += [fixed, fixed + 1]
            else:
                fixed += 1
        return [min(ends), max(ends)] if ends else [-1, -1]


def main(task: str, model: str, *files: str) -> None:
    """Do a task, from and to files."""
    if task == "describe":
        with open(files[0], "w", encoding="utf-8") as reply:
            json.dump(Model(model).describe(), reply)
    else:
        np.savez(files[1], **Model(model).measure(np.load(files[0], allow_pickle=False)))


if __name__ == "__main__":
    main(*sys.argv[1:])
