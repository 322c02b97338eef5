"""An assembly of bodies on joints, as `casadi-contact import` writes it of an OpenSim or JAM model: one function from
coordinates and activations to generalised forces.

    assembly = cc.load_assembly("my_knee")           # names: .coordinates .ligament_names .muscle_names .contact_names
    f = assembly.function()                          # q, u, udot, activations -> forces
    forces = f(q, 0.0, 0.0, 0.02)                    # zero where the coordinate is in balance
    g = assembly.function(["forces", "muscle_lengths", "contact_wrenches"], loaded=["calcn_r"])

At the door all is OpenSim's: coordinates in the model's order and signs, m and rad, their rates, forces in N and N·m.
With L(q) the lengths of paths, T their tensions, W a contact's wrench, x(q) its pose and X(q) a body's transform:

    forces = - (∂L/∂q)ᵀ·T - (∂x/∂q)ᵀ·Q(x, W) + Σ (∂X/∂q)ᵀ·((G - Ẍ)·J) - k·(q - q0) - c·u + loads

that is ligaments and muscles, contact, gravity and inertia (`joints.Body.second_moments`; ½·tr(Ẋ·J·Ẋᵀ) is the kinetic
energy, so that this is Lagrange's equation), springs on coordinates, and wrenches given on bodies.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array, finite_numbers
from casadi_contact.core.files.reading import short
from casadi_contact.networks.frames import pose_of
from casadi_contact.networks.names import check_name
from casadi_contact.optimisation.assembly.joints import Body, Chain, Coordinate, Joint, compose, frame, inverse
from casadi_contact.optimisation.assembly.paths import Bundle, Muscle, MuscleCurves, muscle_forces, tensions
from casadi_contact.optimisation.joint_mechanics import generalised_forces, total_selection
from casadi_contact.scenes.material import Friction

Loaded = str | tuple[str, str]  # a body, or with the body in whose frame its load is given


@dataclass(frozen=True)
class Contact:
    """A contact model between a fixed and a moving body of an assembly; each frame (6,) [mm, rad] places the model's
    own body frame on that of the assembly. Raises ValueError for other frames, for a name that no function can have,
    and for a scene that locks or ties pose parameters: nothing holds the bodies so."""

    name: str
    model: SymbolicContact
    fixed: str
    moving: str
    fixed_frame: Array = field(default_factory=lambda: np.zeros(6))
    moving_frame: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        try:
            check_name(self.function_name)
        except ValueError:
            raise ValueError(f"contact {self.name!r}: expected letters, digits and single underscores") from None
        self.model.scene.pose_space.check_unconstrained(f"the contact {self.name}")
        for key in ("fixed_frame", "moving_frame"):
            numbers = finite_numbers(value := getattr(self, key))
            if numbers is None or numbers.shape != (6,):
                raise ValueError(f"{self.name}: {key} is {short(repr(value))}, expected 6 finite numbers")

    @property
    def function_name(self) -> str:
        """Of its loads, in CasADi and C."""
        return f"{self.name}_loads"

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of both."""
        return self.fixed, self.moving


@dataclass(frozen=True)
class CoordinateSpring:
    """-stiffness·(q - rest) - viscosity·u on one coordinate, in OpenSim's units (m, rad, N, N·m)."""

    name: str
    of: str
    stiffness: float
    rest: float
    viscosity: float


OUTPUTS = (
    *("forces", "of_ligaments", "of_muscles", "of_contacts", "of_gravity", "of_inertia", "of_springs", "of_loads"),
    *("ligament_lengths", "ligament_tensions", "muscle_lengths", "muscle_forces", "muscle_arms"),
    *("contact_poses", "contact_wrenches"),
)


@dataclass(frozen=True)
class Assembly:
    """Bodies on joints, and what acts on them. Raises ValueError for a joint, path or contact of bodies that are not
    there, and for a joint or spring of unknown coordinates."""

    name: str
    ground: str
    gravity_m_s2: Array
    coordinate_table: Mapping[str, Coordinate]
    bodies: Mapping[str, Body]
    joints: Sequence[Joint]
    contacts: Sequence[Contact] = ()
    ligaments: Sequence[Bundle] = ()
    muscles: Sequence[Muscle] = ()
    springs: Sequence[CoordinateSpring] = ()
    curves: Mapping[str, MuscleCurves] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = {self.ground, *self.bodies}
        paths = [*self.ligaments, *self.muscles]
        of_parts: list[tuple[str, Sequence[str]]] = [(path.name, path.bodies) for path in paths]
        of_parts += [(contact.name, contact.bodies) for contact in self.contacts]
        of_parts += [(path.name, [path.wrap.body]) for path in paths if path.wrap is not None]
        for name, bodies in of_parts:
            if not set(bodies) <= known:
                raise ValueError(f"{name} lies on {', '.join(bodies)}, expected bodies of {', '.join(sorted(known))}")
        moved = [(joint.name, of) for joint in self.joints for of in joint.coordinates]
        for name, of in [*moved, *((spring.name, spring.of) for spring in self.springs)]:
            if of not in self.coordinate_table:
                raise ValueError(f"{name} names the coordinate {of}, expected one of {', '.join(self.coordinates)}")
        _ = self._chain

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, in the model's order: the entries of q."""
        return tuple(self.coordinate_table)

    @property
    def ligament_names(self) -> tuple[str, ...]:
        """Names of the ligaments' bundles."""
        return tuple(ligament.name for ligament in self.ligaments)

    @property
    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles: the entries of activations."""
        return tuple(muscle.name for muscle in self.muscles)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return tuple(contact.name for contact in self.contacts)

    @property
    def default(self) -> Array:
        """q (n) [m, rad] at rest, as the model says."""
        return np.array([c.default / c.scale for c in self.coordinate_table.values()])

    def rows(self, names: Iterable[str]) -> list[int]:
        """Entries of q by coordinates' names; raises ValueError for one that is not there."""
        names = list(names)
        if unknown := [name for name in names if name not in self.coordinate_table]:
            raise ValueError(f"got coordinates {', '.join(unknown)}, expected some of {', '.join(self.coordinates)}")
        return [self.coordinates.index(name) for name in names]

    def places(self, bodies: Sequence[str]) -> ca.Function:
        """casadi.Function q -> transforms (3 x 4·bodies) [m] of bodies in the ground."""
        found = [self._chain.place(body, self.ground) for body in bodies]
        return ca.Function("places", [self._q], [ca.horzcat(*(ca.horzcat(R, 1e-3 * t) for t, R in found))])

    def function(
        self,
        outputs: Sequence[str] = ("forces",),
        name: str = "assembly_forces",
        *,
        coordinates: Sequence[str] | None = None,
        loaded: Sequence[Loaded] = (),
        by_force: bool = False,
    ) -> ca.Function:
        """casadi.Function q (n), u (n), udot (n), activations (m) -> the chosen outputs, some of `OUTPUTS`.

        forces (r) [N, N·m]: all that acts on each coordinate, inertia too; of_ligaments ... of_loads: its parts.
        ligament_lengths, muscle_lengths [m]; ligament_tensions, muscle_forces [N]; muscle_arms (m x r) = -∂L/∂q [m, 1].
        contact_poses (6 x contacts) [mm, rad]: the moving body in the fixed one, as its scene counts them;
        contact_wrenches (6 x contacts) [N, N·m]: on the fixed body, the casting mesh, in the scene's frame about its
        origin.
        coordinates: r of which forces are wanted, all n if left out; fewer cost less. loaded: bodies on which wrenches
        act, a further input loads (6 x bodies) [N, N·m] in the ground about its origin; (body, other): in the frame of
        another body, or of itself, about its origin. by_force: muscles' forces [N]
        come in place of activations, and tendons play no part.
        """
        if unknown := [each for each in outputs if each not in OUTPUTS]:
            raise ValueError(f"unknown outputs {', '.join(unknown)}, expected some of {', '.join(OUTPUTS)}")
        n, m, k = len(self.coordinates), len(self.muscles), len(self.ligaments)
        rows = list(range(n)) if coordinates is None else self.rows(coordinates)
        q, u, udot = (ca.MX.sym(key, n) for key in ("q", "u", "udot"))
        drive, loads = ca.MX.sym("drive", m), ca.MX.sym("loads", 6, len(loaded))
        lengths, rates, strung = self._paths(q, u)
        force = drive if by_force else self._muscle_forces(lengths[k:], rates[k:], drive)
        poses, pose_rates = self._poses(q, u)
        wrenches = [self._wrench(of, poses[:, i], pose_rates[:, i]) for i, of in enumerate(self.contacts)]
        pressing = ca.horzcat(*wrenches) if wrenches else ca.MX(6, 0)
        made: dict[str, Callable[[], Any]] = {
            "of_ligaments": lambda: -self._pull(rows)(q, ca.vertcat(strung, ca.MX(m, 1))),
            "of_muscles": lambda: -self._pull(rows)(q, ca.vertcat(ca.MX(k, 1), force)),
            "of_contacts": lambda: -self._press(rows)(q, pressing),
            "of_gravity": lambda: self._weight(rows)(q),
            "of_inertia": lambda: -self._inertia(rows)(q, u, udot),
            "of_springs": lambda: self._sprung(q, u)[rows],
            "of_loads": lambda: self._applied(rows, loaded)(q, loads) if loaded else ca.MX(len(rows), 1),
            "ligament_lengths": lambda: 1e-3 * lengths[:k],
            "ligament_tensions": lambda: strung,
            "muscle_lengths": lambda: 1e-3 * lengths[k:],
            "muscle_forces": lambda: force,
            "muscle_arms": lambda: -self._arms(rows)(q),
            "contact_poses": lambda: poses,
            "contact_wrenches": lambda: ca.mtimes(ca.diag([1.0] * 3 + [1e-3] * 3), pressing),
        }
        others = [key for key in made if key.startswith("of_") and key not in ("of_ligaments", "of_muscles")]
        made["forces"] = lambda: sum((made[key]() for key in others), -self._pull(rows)(q, ca.vertcat(strung, force)))
        given = {"q": q, "u": u, "udot": udot, "muscle_forces" if by_force else "activations": drive}
        given |= {"loads": loads} if loaded else {}
        found = [made[key]() for key in outputs]
        return ca.Function(check_name(name), [*given.values()], found, [*given], list(outputs))

    @cached_property
    def _q(self) -> Any:
        return ca.SX.sym("q", len(self.coordinates))

    @cached_property
    def _chain(self) -> Chain:
        scales = ca.DM([c.scale for c in self.coordinate_table.values()])
        inside = dict(zip(self.coordinates, ca.vertsplit(self._q * scales), strict=True))
        return Chain(self.ground, list(self.bodies), self.joints, inside)

    @cached_property
    def _lengths(self) -> Any:
        paths = [*self.ligaments, *self.muscles]
        return ca.vertcat(*(path.length(self._chain) for path in paths)) if paths else ca.SX(0, 1)

    @cached_property
    def _paths(self) -> ca.Function:
        """q, u -> lengths [mm] and rates [mm/s] of ligaments and muscles, tensions [N] of ligaments."""
        length, u, k = self._lengths, ca.SX.sym("u", len(self.coordinates)), len(self.ligaments)
        rate = ca.jtimes(length, self._q, u)
        return ca.Function("paths", [self._q, u], [length, rate, tensions(self.ligaments, length[:k], rate[:k])])

    def _pull(self, rows: Sequence[int]) -> ca.Function:
        """q, forces along paths -> (∂L/∂q)ᵀ·force of some coordinates [N, N·m]."""
        along = ca.SX.sym("along", self._lengths.shape[0])
        return ca.Function("pull", [self._q, along], [self._against(1e-3 * self._lengths, along, rows)])

    def _arms(self, rows: Sequence[int]) -> ca.Function:
        jacobian = ca.jacobian(1e-3 * self._lengths[len(self.ligaments) :], self._q)
        return ca.Function("arms", [self._q], [jacobian[:, rows]])

    @cached_property
    def _pose_list(self) -> list[Any]:
        return [self.pose_between(c.fixed, c.fixed_frame, c.moving, c.moving_frame) for c in self.contacts]

    @cached_property
    def _poses(self) -> ca.Function:
        """q, u -> poses and their rates (6 x contacts) [mm, rad, s]."""
        found, u = ca.horzcat(*self._pose_list) if self.contacts else ca.SX(6, 0), ca.SX.sym("u", len(self.coordinates))
        return ca.Function("poses", [self._q, u], [found, ca.jtimes(found, self._q, u)])

    def _press(self, rows: Sequence[int]) -> ca.Function:
        """q, wrenches (6 x contacts) on fixed bodies [N, N·mm] -> what they do on coordinates, with the sign turned."""
        wrench, poses = ca.SX.sym("wrench", 6, len(self.contacts)), self._pose_list
        forces = [generalised_forces(pose, wrench[:, i]) for i, pose in enumerate(poses)]
        stacked = [ca.vertcat(*each) if each else ca.SX(0, 1) for each in (poses, forces)]
        return ca.Function("press", [self._q, wrench], [self._against(1e-3 * stacked[0], stacked[1], rows)])

    @cached_property
    def _transforms(self) -> Any:
        """X of all bodies in the ground [m], column after column (12·bodies)."""
        found = (self._chain.place(body, self.ground) for body in self.bodies)
        return ca.vertcat(*(ca.vec(ca.horzcat(R, 1e-3 * t)) for t, R in found))

    def _weight(self, rows: Sequence[int]) -> ca.Function:
        g = ca.DM(self.gravity_m_s2)
        weight = [ca.vec(ca.mtimes(g, ca.DM(body.second_moments[3:]))) for body in self.bodies.values()]
        return ca.Function("weight", [self._q], [self._against(self._transforms, ca.vertcat(*weight), rows)])

    def _inertia(self, rows: Sequence[int]) -> ca.Function:
        """q, u, udot -> Σ (∂X/∂q)ᵀ·(Ẍ·J)."""
        u, udot = (ca.SX.sym(key, len(self.coordinates)) for key in ("u", "udot"))
        X, q = self._transforms, self._q
        acceleration = ca.jtimes(ca.jtimes(X, q, u), ca.vertcat(q, u), ca.vertcat(u, udot))
        moments = (ca.DM(body.second_moments) for body in self.bodies.values())
        each = zip(ca.vertsplit(acceleration, 12), moments, strict=True)
        kept = ca.vertcat(*(ca.vec(ca.mtimes(ca.reshape(of_body, 3, 4), J)) for of_body, J in each))
        return ca.Function("inertia", [q, u, udot], [self._against(X, kept, rows)])

    def _against(self, of: Any, weights: Any, rows: Sequence[int]) -> Any:
        """(∂of/∂q)ᵀ·weights, of some coordinates."""
        return ca.jtimes(of, self._q, weights, True)[rows]

    def pose_between(self, fixed: str, fixed_frame: Array, moving: str, moving_frame: Array) -> Any:
        """Pose (6) [mm, rad], in SX, of a frame of one body in a frame of another."""
        place = self._chain.place(moving, fixed)
        return pose_of(*compose(inverse(frame(fixed_frame)), compose(place, frame(moving_frame))))

    def _wrench(self, contact: Contact, pose: ca.MX, rate: ca.MX) -> ca.MX:
        """Total wrench (6) [N, N·mm] on the fixed body, in the scene's frame; the pose's rate counts where its surface
        has friction or dissipation."""
        total = ca.sparsify(ca.DM(total_selection(contact.model.load_names, contact.model.patch_names)))
        rubs = contact.model.scene.friction != Friction()
        loads = contact.model.function(name=contact.function_name, velocity=rubs)
        return ca.mtimes(total, loads(pose, rate) if rubs else loads(pose))

    @cached_property
    def _muscle_forces(self) -> ca.Function:
        m = len(self.muscles)
        length, rate, activation = (ca.MX.sym(key, m) for key in ("length", "rate", "activation"))
        given = [length, rate, activation]
        if not m:
            return ca.Function("muscles", given, [ca.MX(0, 1)])
        active, passive = muscle_forces(self.muscles, dict(self.curves))(*given)
        return ca.Function("muscles", given, [ca.fmax(active + passive, 0.0)])

    def _sprung(self, q: Any, u: Any) -> Any:
        forces: list[Any] = [0.0] * len(self.coordinates)
        for spring in self.springs:
            i = self.coordinates.index(spring.of)
            forces[i] += -spring.stiffness * (q[i] - spring.rest) - spring.viscosity * u[i]
        return ca.vertcat(*forces)

    def _applied(self, rows: Sequence[int], loaded: Sequence[Loaded]) -> ca.Function:
        """q, loads (6 x bodies) -> generalised forces: with F and T about the ground's origin, the body's transform
        X = [R t] takes the force [½·(T - t × F)×·R, F]; F' and T' in a frame [S s] are F = S·F', T = S·T' + s × F."""
        loads, X, given = ca.SX.sym("loads", 6, len(loaded)), [], []
        for i, of in enumerate(loaded):
            body, within = (of, self.ground) if isinstance(of, str) else of
            (t, R), (s, S) = (self._chain.place(each, self.ground) for each in (body, within))
            force = ca.mtimes(S, loads[:3, i])
            torque = ca.mtimes(S, loads[3:, i]) + ca.cross(1e-3 * (s - t), force)
            X.append(ca.vec(ca.horzcat(R, 1e-3 * t)))
            given.append(ca.vec(ca.horzcat(0.5 * ca.mtimes(ca.skew(torque), R), force)))
        return ca.Function("applied", [self._q, loads], [self._against(ca.vertcat(*X), ca.vertcat(*given), rows)])
