"""Contacts, ligaments, springs and pulls between named bodies: one function from all poses to all loads, and the poses
in equilibrium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import POSE_IN_MM, Array, as_poses, check_above_zero, pose_index
from casadi_contact.core.quantities import FORCE, Kind, quantity
from casadi_contact.networks.frames import placed, relative_pose, rotation
from casadi_contact.networks.names import check_name
from casadi_contact.optimisation.assembly.connections import Contact, Ligament, Line, Pull, Spring, finite_vector
from casadi_contact.optimisation.assembly.settling import pseudo_transient
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.scenes.shapes.checks import identifier


@dataclass(frozen=True)
class Assembly:
    """Bodies (each with six degrees of freedom in the ground), and what acts between them and the ground.

    start: poses (6,) [mm, rad] of the free bodies by name, in the order in which functions take them. Raises
    ValueError for a start of another shape, for a body that is not there, for names that are not distinct, and for a
    contact whose scene locks or ties pose parameters: nothing holds the bodies so.
    """

    name: str
    ground: str
    start: Mapping[str, Array]
    contacts: Sequence[Contact] = ()
    ligaments: Sequence[Ligament] = ()
    pulls: Sequence[Pull] = ()
    springs: Sequence[Spring] = ()

    def __post_init__(self) -> None:
        known = tuple(identifier("body", body) for body in (self.ground, *self.start))
        parts: list[Contact | Line | Spring] = [*self.contacts, *self.ligaments, *self.pulls, *self.springs]
        names = [identifier("name", part.name) for part in parts]
        if not self.start or len(set(known)) != len(known) or len(set(names)) != len(names):
            raise ValueError(
                f"assembly {self.name} has the bodies {', '.join(known)} and the parts {', '.join(names)}, "
                "expected at least one free body, and names that differ"
            )
        for body, pose in self.start.items():
            finite_vector(f"assembly {self.name}: the start pose of {body} is", pose, 6)
        for contact in self.contacts:
            contact.model.scene.pose_space.check_unconstrained(f"assembly {self.name}: the contact {contact.name}")
        for part in parts:
            bodies, among = ((part.body,), self.bodies) if isinstance(part, Spring) else (part.bodies, known)
            if not set(map(str, bodies)) <= set(among) or len(set(bodies)) < len(bodies):
                expected = f"{'a free body' if isinstance(part, Spring) else 'different bodies'} of {', '.join(among)}"
                raise ValueError(f"{part.name} acts on {' and '.join(map(str, bodies))}, expected {expected}")
        if len(set(self.load_names)) != len(self.load_names):
            loads = ", ".join(self.load_names)
            raise ValueError(f"assembly {self.name} has the loads {loads}, expected names that differ")

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the free bodies."""
        return tuple(self.start)

    @property
    def _loads(self) -> list[tuple[str, Kind]]:
        of_contacts = [(contact.name, load) for contact in self.contacts for load in contact.model.load_names]
        loads = [(f"{name}_{load}", quantity(load).kind) for name, load in of_contacts]
        return [*loads, *((ligament.name, FORCE) for ligament in self.ligaments)]

    @property
    def load_names(self) -> tuple[str, ...]:
        """tibiofemoral_Fy_med [N], tibiofemoral_Tx [N·mm] ... of each contact, patellar_tendon [N] of each ligament."""
        return tuple(name for name, _ in self._loads)

    @property
    def load_kinds(self) -> dict[str, Kind]:
        """Force or torque, by the names of ``load_names`` and in their order."""
        return dict(self._loads)

    def start_poses(self) -> Array:
        """Poses (bodies, 6) to begin from."""
        return np.array([self.start[body] for body in self.bodies])

    def function(self, name: str = "assembly_loads") -> ca.Function:
        """casadi.Function poses (6 x bodies) -> loads (L) of ``load_names``, with exact first and second derivatives.

        Both are sparse: a contact's loads depend on its own two bodies alone.
        """
        poses = ca.MX.sym("poses", 6, len(self.bodies))
        loads = [self._contact_loads(contact, poses) for contact in self.contacts]
        tensions = [ligament.tension(self._along(ligament, poses)[0]) for ligament in self.ligaments]
        return ca.Function(check_name(name), [poses], [ca.vertcat(*loads, *tensions)], ["poses"], ["loads"])

    def forces(self, name: str = "assembly_forces") -> ca.Function:
        """casadi.Function poses (6 x bodies), tensions (pulls) [N] -> generalised forces (6 x bodies) [N, N·mm].

        All that contacts, ligaments, pulls and springs do on each free body; zero in equilibrium.
        """
        poses, tensions = ca.MX.sym("poses", 6, len(self.bodies)), ca.MX.sym("tensions", len(self.pulls))
        wrenches = {body: ca.MX.zeros(6) for body in (self.ground, *self.bodies)}
        for contact in self.contacts:
            on_fixed = self._in_ground(contact, poses)
            wrenches[contact.fixed] += on_fixed
            wrenches[contact.moving] -= on_fixed
        lines: list[Line] = [*self.ligaments, *self.pulls]
        sizes = [ligament.tension(self._along(ligament, poses)[0]) for ligament in self.ligaments]
        for line, size in zip(lines, [*sizes, *(tensions[k] for k in range(len(self.pulls)))], strict=True):
            _, points, along = self._along(line, poses)
            for body, point, sign in zip(line.bodies, points, (1.0, -1.0), strict=True):
                force = sign * size * along
                wrenches[body] += ca.vertcat(force, ca.cross(point, force))
        found = [generalised_forces(poses[:, k], wrenches[body]) for k, body in enumerate(self.bodies)]
        for spring in self.springs:
            k = self.bodies.index(spring.body)
            found[k] -= ca.DM(spring.stiffness) * (poses[:, k] - ca.DM(spring.rest))
        given = [poses, tensions]
        return ca.Function(check_name(name), given, [ca.horzcat(*found)], ["poses", "tensions"], ["forces"])

    def contact(self, name: str) -> Contact:
        """A contact by its name; ValueError where there is none."""
        found = {contact.name: contact for contact in self.contacts}
        if name not in found:
            raise ValueError(f"assembly {self.name} has no contact {name}, expected one of {', '.join(found)}")
        return found[name]

    def contact_pose(self, contact: Contact, poses: ca.MX) -> ca.MX:
        """Pose (6) of a contact's moving body in its fixed one, for poses (6 x bodies)."""
        return relative_pose(
            placed(self._pose(contact.fixed, poses), ca.DM(contact.fixed_frame)),
            placed(self._pose(contact.moving, poses), ca.DM(contact.moving_frame)),
        )

    def _pose(self, body: str, poses: ca.MX) -> ca.MX:
        return ca.MX.zeros(6) if body == self.ground else poses[:, self.bodies.index(body)]

    def _contact_loads(self, contact: Contact, poses: ca.MX) -> ca.MX:
        """Named loads of a contact (L)."""
        function = contact.model.function(name=contact.function_name)
        return function(self.contact_pose(contact, poses))

    def _in_ground(self, contact: Contact, poses: ca.MX) -> ca.MX:
        """Total wrench (6) of a contact on its fixed body, about the ground's origin and in its frame."""
        total = ca.sparsify(ca.DM(total_selection(contact.model.load_names, contact.model.patch_names)))
        wrench = ca.mtimes(total, self._contact_loads(contact, poses))
        origin, R = placed(self._pose(contact.fixed, poses), ca.DM(contact.fixed_frame))
        force = ca.mtimes(R, wrench[:3])
        return ca.vertcat(force, ca.mtimes(R, wrench[3:]) + ca.cross(origin, force))

    def _along(self, line: Line, poses: ca.MX) -> tuple[ca.MX, tuple[ca.MX, ca.MX], ca.MX]:
        """Length [mm], both points in the ground, and the unit vector from the first to the second."""
        first, second = (
            self._pose(body, poses)[:3] + ca.mtimes(rotation(self._pose(body, poses)[3:]), ca.DM(point))
            for body, point in zip(line.bodies, line.points_mm, strict=True)
        )
        length = ca.sqrt(ca.sumsqr(second - first) + 1e-18)  # 1e-9 mm where ends coincide: such a line pulls nowhere
        return length, (first, second), (second - first) / length


@dataclass(frozen=True)
class SettledBodies:
    """Poses (bodies, 6); residual [N]: the largest force left along a free parameter, torques over 25 mm."""

    poses: Array
    residual: float
    converged: bool


class Settling:
    """Equilibrium of the free pose parameters of bodies (by name), by `settling.pseudo_transient`.

    Raises ValueError for bodies that the assembly has not, and unless some parameters are free, each named once.
    """

    def __init__(self, assembly: Assembly, free: Mapping[str, Sequence[str]]) -> None:
        self.assembly = assembly
        self.rows = [6 * self._body(body) + pose_index(name) for body, names in free.items() for name in names]
        if not self.rows or len(set(self.rows)) < len(self.rows):
            raise ValueError(f"free is {dict(free)}, expected pose parameters of bodies, each named once")
        size = 6 * len(assembly.bodies)
        sizes = {"x": size, "applied": size, "tensions": len(assembly.pulls)}
        x, applied, tensions = (ca.MX.sym(name, count) for name, count in sizes.items())
        forces = ca.vec(assembly.forces()(ca.reshape(x, 6, len(assembly.bodies)), tensions)) + applied
        jacobian = ca.jacobian(forces, x)[self.rows, self.rows]
        self._evaluate = ca.Function("settle", [x, applied, tensions], [forces[self.rows], jacobian])

    def __call__(
        self,
        poses: ArrayLike,
        applied: Mapping[str, ArrayLike] | None = None,
        tensions: Sequence[float] = (),
        *,
        tolerance: float = 1e-6,
        max_iterations: int = 1000,
    ) -> SettledBodies:
        """Settle from poses (bodies, 6), which hold the values of locked parameters too.

        applied: further generalised forces (6,) [N, N·mm] by body; tensions [N] of the pulls. Raises ValueError for
        wrong numbers; what does not converge is reported, not raised.
        """
        check_above_zero(tolerance=tolerance)
        assembly, rows = self.assembly, self.rows
        position = as_poses(poses).ravel()
        if len(position) != 6 * len(assembly.bodies):
            raise ValueError(f"got {len(position) // 6} poses, expected those of {', '.join(assembly.bodies)}")
        expected = f"0 N or more for each pull ({', '.join(pull.name for pull in assembly.pulls) or 'none'})"
        pulling = finite_vector("tensions are", tensions, len(assembly.pulls), expected=expected)
        if (pulling < 0.0).any():
            raise ValueError(f"tensions are {list(tensions)}, expected {expected}: a line never pushes")
        given = np.zeros(len(position))
        for body, force in (applied or {}).items():
            given[6 * self._body(body) :][:6] = finite_vector(f"forces on {body} are", force, 6)
        in_mm = np.tile(POSE_IN_MM, len(assembly.bodies))[rows]

        def evaluate(at: Array) -> tuple[Array, Array]:
            left, jacobian = self._evaluate(at, given, pulling)
            return left.full().ravel(), jacobian.full()

        position, residual = pseudo_transient(evaluate, position, rows, in_mm, tolerance, max_iterations)
        return SettledBodies(position.reshape(-1, 6), residual, residual <= tolerance)

    def _body(self, name: str) -> int:
        bodies = self.assembly.bodies
        if name not in bodies:
            raise ValueError(f"got the body {name}, assembly {self.assembly.name} has {', '.join(bodies)}")
        return bodies.index(name)
