"""What the opensim wheel says of a model, in a process of its own: its package and casadi's must not share one.

    python wheel.py describe MODEL.osim REPLY.json
    python wheel.py measure  MODEL.osim REQUEST.npz REPLY.npz

A script without casadi_contact, in OpenSim's units. ``describe`` writes bodies, joints, paths and muscles; ``measure``
takes coordinates (n, c) with their names, and names of ligaments and muscles, and writes lengths (n, f) [m], from which
to which path point each wraps (n, f, 2), -1 where it does not, moment arms (n, f, c) if asked for, and the transforms
(n, b, 3, 4) of the named bodies in the ground.
"""

import json
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import opensim

_ROTATIONS = {"PinJoint": "z", "UniversalJoint": "xy", "BallJoint": "xyz", "GimbalJoint": "xyz", "FreeJoint": "xyz"}
_ROTATIONS |= {"WeldJoint": "", "PlanarJoint": "z", "SliderJoint": ""}
_TRANSLATIONS = {"FreeJoint": "xyz", "PlanarJoint": "xy", "SliderJoint": "x"}
_AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
_LINES = ("Constant", "LinearFunction")
CURVE_LENGTHS = np.linspace(0.0, 2.5, 501)  # of fibres, over their optimal length
CURVE_SPEEDS = np.linspace(-1.5, 1.5, 301)  # over the greatest speed


def numbers(vector: Any) -> list[float]:
    """A SimTK vector of three as plain numbers."""
    return [float(vector.get(i)) for i in range(3)]


def transform(found: Any) -> np.ndarray:
    """(3, 4) rotation and translation of a SimTK transform."""
    R, t = found.R(), found.p()
    return np.array([[*(float(R.get(i, j)) for j in range(3)), float(t.get(i))] for i in range(3)])


def base(frame: Any) -> str:
    """Name of the body that a frame is fixed to."""
    return str(frame.findBaseFrame().getName())


def function_values(function: Any, span: tuple[float, float]) -> dict[str, Any]:
    """A function of one coordinate: offset and slope of a line, else (x, y, dy/dx) at its knots, cubic between them."""
    scale = 1.0
    while multiplier := opensim.MultiplierFunction.safeDownCast(function):
        scale, function = scale * multiplier.getScale(), multiplier.getFunction()

    def at(x: float, order: int = 0) -> float:
        point, parts = opensim.Vector(1, float(x)), opensim.StdVectorInt()
        if order == 0:
            return scale * float(function.calcValue(point))
        parts.append(0)
        return scale * float(function.calcDerivative(parts, point))

    if function.getConcreteClassName() in _LINES:
        offset = at(0.0)
        return {"offset": offset, "slope": at(1.0) - offset}
    spline = opensim.SimmSpline.safeDownCast(function)
    places = [float(spline.getX(i)) for i in range(spline.getSize())] if spline else np.linspace(*span, 61).tolist()
    return {"knots": [[x, at(x), at(x, 1)] for x in places]}


def joint_axes(joint: Any) -> dict[str, Any]:
    """Rotations and translations of a joint, one after another, each along an axis by a function of one coordinate."""
    kind, names = (
        joint.getConcreteClassName(),
        [joint.get_coordinates(i).getName() for i in range(joint.numCoordinates())],
    )
    coordinates = {name: joint.get_coordinates(i) for i, name in enumerate(names)}
    axes: dict[str, Any] = {"rotations": [], "translations": []}
    if custom := opensim.CustomJoint.safeDownCast(joint):
        spatial = custom.getSpatialTransform()
        for k in range(6):
            axis = spatial.getTransformAxis(k)
            of = [axis.get_coordinates(i) for i in range(axis.getCoordinateNames().size())]
            if len(of) > 1:
                raise ValueError(
                    f"joint {joint.getName()} has an axis of the coordinates {', '.join(of)}, expected one"
                )
            span = (coordinates[of[0]].getRangeMin(), coordinates[of[0]].getRangeMax()) if of else (0.0, 1.0)
            values = function_values(axis.getFunction(), span)
            given = {"axis": numbers(axis.getAxis()), "of": of[0] if of else "", **values}
            axes["rotations" if k < 3 else "translations"].append(given)
        return axes
    if kind not in _ROTATIONS:
        raise ValueError(f"joint {joint.getName()} is a {kind}, expected one of CustomJoint, {', '.join(_ROTATIONS)}")
    letters = [("rotations", a) for a in _ROTATIONS[kind]] + [("translations", a) for a in _TRANSLATIONS.get(kind, "")]
    for (group, letter), name in zip(letters, names, strict=True):
        axes[group].append({"axis": _AXES[letter], "of": name, "offset": 0.0, "slope": 1.0})
    return axes


def path_table(path: Any, state: Any) -> dict[str, Any]:
    """Points of a path in their bodies [m], the bodies it wraps over, and kinds of points that are not fixed."""
    points, bodies, moving = [], [], []
    for i in range(path.getPathPointSet().getSize()):
        point = path.getPathPointSet().get(i)
        X = transform(point.getParentFrame().findTransformInBaseFrame())
        points.append((X[:, :3] @ numbers(point.getLocation(state)) + X[:, 3]).tolist())
        bodies.append(base(point.getParentFrame()))
        if point.getConcreteClassName() != "PathPoint":
            moving.append(point.getConcreteClassName())
    wraps = path.getWrapSet()
    over = [wraps.get(i).getWrapObjectName() for i in range(wraps.getSize())]
    return {"points": points, "bodies": bodies, "moving": moving, "wraps": over}


class Model:
    """A model file, its state, and its ligaments and muscles by name."""

    def __init__(self, path: str) -> None:
        opensim.Logger.setLevelString("off")
        self.model = opensim.Model(path)
        self.state = self.model.initSystem()
        forces = self.model.getForceSet()
        self.paths: dict[str, Any] = {}
        self.forces = [forces.get(i) for i in range(forces.getSize())]
        for force in self.forces:
            for kind in (opensim.Blankevoort1991Ligament, opensim.Ligament, opensim.PathActuator):
                if found := kind.safeDownCast(force):
                    self.paths[force.getName()] = found.getGeometryPath()
                    break
        coordinates = self.model.getCoordinateSet()
        self.coordinates = {coordinates.get(i).getName(): coordinates.get(i) for i in range(coordinates.getSize())}

    def describe(self) -> dict[str, Any]:
        """All that `workflow.opensim_import` needs of it, as plain values."""
        bodies = self.model.getBodySet()
        wrapped: dict[str, Any] = {}
        for frame in [self.model.getGround(), *(bodies.get(i) for i in range(bodies.getSize()))]:
            objects = frame.getWrapObjectSet()
            for i in range(objects.getSize()):
                wrapped[objects.get(i).getName()] = {"body": frame.getName(), **self._cylinder(objects.get(i))}
        joints = {}
        for joint in self.model.getJointList():
            parent, child = joint.getParentFrame(), joint.getChildFrame()
            joints[joint.getName()] = {
                "parent": base(parent),
                "child": base(child),
                "parent_frame": transform(parent.findTransformInBaseFrame()).tolist(),
                "child_frame": transform(child.findTransformInBaseFrame()).tolist(),
                "coordinates": [joint.get_coordinates(i).getName() for i in range(joint.numCoordinates())],
                **joint_axes(joint),
            }
        constraints = self.model.getConstraintSet()
        return {
            "name": self.model.getName(),
            "gravity": numbers(self.model.getGravity()),
            "bodies": {b.getName(): self._body(b) for b in (bodies.get(i) for i in range(bodies.getSize()))},
            "joints": joints,
            "coordinates": {name: self._coordinate(c) for name, c in self.coordinates.items()},
            "wrap_objects": wrapped,
            "frames": self._frames(),
            "ligaments": dict(self._ligaments()),
            "muscles": dict(self._muscles()),
            "springs": dict(self._springs()),
            "others": [[f.getName(), f.getConcreteClassName()] for f in self.forces if not self._known(f)],
            "curve_samples": {"lengths": CURVE_LENGTHS.tolist(), "speeds": CURVE_SPEEDS.tolist()},
            "constraints": [constraints.get(i).getName() for i in range(constraints.getSize())],
        }

    def _frames(self) -> dict[str, Any]:
        """Frames by path: the body they are fixed to, and where."""
        found = {}
        for frame in self.model.getFrameList():
            place = transform(frame.findTransformInBaseFrame()).tolist()
            found[frame.getAbsolutePathString()] = {"body": base(frame), "place": place}
        return found

    @staticmethod
    def _cylinder(wrap: Any) -> dict[str, Any]:
        """Radius and transform in its body of a wrapping cylinder, whose axis is z; nothing of other objects."""
        if (cylinder := opensim.WrapCylinder.safeDownCast(wrap)) is None:
            return {}
        return {"radius": cylinder.get_radius(), "place": transform(cylinder.getTransform()).tolist()}

    @staticmethod
    def _known(force: Any) -> bool:
        kinds = (opensim.Blankevoort1991Ligament, opensim.Muscle, opensim.SpringGeneralizedForce)
        return any(kind.safeDownCast(force) for kind in kinds)

    def _body(self, body: Any) -> dict[str, Any]:
        inertia = body.get_inertia()
        values = {"mass": body.getMass(), "mass_center": numbers(body.getMassCenter())}
        return values | {"inertia": [float(inertia.get(i)) for i in range(6)]}  # xx yy zz xy xz yz

    def _coordinate(self, c: Any) -> dict[str, Any]:
        kind = "translation" if c.getMotionType() == opensim.Coordinate.Translational else "rotation"
        fixed = c.getLocked(self.state) or c.isPrescribed(self.state)
        span = [c.getRangeMin(), c.getRangeMax()]
        return {"kind": kind, "default": c.getDefaultValue(), "range": span, "fixed": bool(fixed)}

    def _ligaments(self) -> Iterator[tuple[str, Any]]:
        for force in self.forces:
            if found := opensim.Blankevoort1991Ligament.safeDownCast(force):
                yield (
                    force.getName(),
                    {
                        **path_table(found.getGeometryPath(), self.state),
                        "applied": bool(force.get_appliesForce()),
                        "linear_stiffness": found.get_linear_stiffness(),
                        "slack_length": found.get_slack_length(),
                        "transition_strain": found.get_transition_strain(),
                        "damping_coefficient": found.get_damping_coefficient(),
                    },
                )

    def _muscles(self) -> Iterator[tuple[str, Any]]:
        for force in self.forces:
            if (muscle := opensim.Muscle.safeDownCast(force)) is None:
                continue
            table = {
                **path_table(muscle.getGeometryPath(), self.state),
                "kind": force.getConcreteClassName(),
                "applied": bool(force.get_appliesForce()),
                "max_isometric_force": muscle.getMaxIsometricForce(),
                "optimal_fiber_length": muscle.getOptimalFiberLength(),
                "tendon_slack_length": muscle.getTendonSlackLength(),
                "pennation": muscle.getPennationAngleAtOptimalFiberLength(),
                "max_contraction_velocity": muscle.getMaxContractionVelocity(),
            }
            if millard := opensim.Millard2012EquilibriumMuscle.safeDownCast(force):
                table["damping"] = millard.getFiberDamping()
                active, passive = millard.getActiveForceLengthCurve(), millard.getFiberForceLengthCurve()
                speed = millard.getForceVelocityCurve()
                table["active"] = [active.calcValue(x) for x in CURVE_LENGTHS.tolist()]
                table["passive"] = [passive.calcValue(x) for x in CURVE_LENGTHS.tolist()]
                table["speed"] = [speed.calcValue(x) for x in CURVE_SPEEDS.tolist()]
            yield force.getName(), table

    def _springs(self) -> Iterator[tuple[str, Any]]:
        for force in self.forces:
            if spring := opensim.SpringGeneralizedForce.safeDownCast(force):
                values = {"stiffness": spring.getStiffness(), "rest_length": spring.getRestLength()}
                yield force.getName(), {"of": spring.get_coordinate(), **values, "viscosity": spring.getViscosity()}

    def measure(self, request: Any) -> dict[str, np.ndarray]:
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
        found: dict[str, Any] = Model(model).measure(np.load(files[0], allow_pickle=False))
        np.savez(files[1], **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
