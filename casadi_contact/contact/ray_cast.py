"""The elastic foundation on flat triangles, by exact rays: slow and plain, to check others against.

It is the articular contact model of OpenSim JAM (Smith et al. 2018) without its smoothing: a ray runs from the centre
of every fixed triangle along minus its normal to where it leaves the moving mesh; the distance, below 20 mm, is the
depth. At the overlaps of implants its facets are wrong by tens of per cent (`geometry.smooth_surface`).
"""

from collections.abc import Iterator

import numpy as np

from casadi_contact.contact.callable_model import CallableModel
from casadi_contact.contact.pressure_law import law_of, pressures
from casadi_contact.contact.pressures import PressureMap, PressureSummary
from casadi_contact.core.conventions import Array, as_poses, rotation
from casadi_contact.geometry.triangle_mesh import RayCaster
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, patch_mesh

DEEPEST_MM = 20.0  # of a ray, as JAM counts it at most


class RayCastFoundation(CallableModel):
    """Contact of a mesh scene on its flat triangles, a contact model like any other (derivatives by differences).

    The wrench of a patch on the fixed body is Σ -p(d_i)·A_i·(n_i, c_i × n_i) over its triangles.
    Raises ValueError for a scene of another shape, ImportError without the extra `mesh`.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, self._all_wrenches)
        self._caster = RayCaster(body_mesh(scene.geometry, "moving"))
        self._patches = []
        for patch in scene.patch_names:
            mesh = patch_mesh(scene.geometry, patch)
            areas = mesh.areas_mm2
            centres, normals = mesh.corners_mm.mean(axis=1), mesh.area_vectors_mm2 / areas[:, None]
            law = *law_of(scene.material)[:2], scene.thickness_at(centres, normals)
            self._patches.append((centres, normals, areas, law))

    def __repr__(self) -> str:
        return f"RayCastFoundation({self.scene.name}, {sum(len(p[2]) for p in self._patches)} triangles)"

    def summary(self, poses: Array) -> PressureSummary:
        """Areas, pressures, centres of pressure, penetrations; the mean is over triangles of any area, as JAM's."""
        poses = as_poses(poses)
        pressed = (
            (n, p, self._patches[p][0], self._patches[p][2], depths, pressures(*self._patches[p][3], depths))
            for n, p, depths in self._depths(poses)
        )
        return PressureSummary.of_elements((len(poses), len(self._patches)), pressed, counted_alike=True)

    def pressure_maps(self, pose: Array) -> list[PressureMap]:
        """Pressure of every triangle in one pose (6,), patch by patch."""
        return [
            PressureMap(
                self.patch_names[p], self._patches[p][0], self._patches[p][2], pressures(*self._patches[p][3], d)
            )
            for _, p, d in self._depths(as_poses([pose]))
        ]

    def _all_wrenches(self, poses: Array) -> Array:
        wrenches = np.zeros((len(poses), len(self._patches), 6))
        for n, p, depths in self._depths(poses):
            centres, normals, areas, law = self._patches[p]
            forces = -(pressures(*law, depths) * areas)[:, None] * normals
            wrenches[n, p] = [*forces.sum(axis=0), *np.cross(centres, forces).sum(axis=0)]
        return wrenches

    def _depths(self, poses: Array) -> Iterator[tuple[int, int, Array]]:
        """(pose, patch, depth of each triangle [mm]) one after another."""
        for n, (R, t) in enumerate(zip(rotation(poses[:, 3:]), poses[:, :3], strict=True)):
            for p, (centres, normals, *_) in enumerate(self._patches):
                directions = -normals @ R
                depth, face = self._caster.first_hits((centres - t) @ R, directions)
                touching = self._caster.leaves(directions, face) & (depth > 0.0) & (depth < DEEPEST_MM)
                yield n, p, np.where(touching, depth, 0.0)
