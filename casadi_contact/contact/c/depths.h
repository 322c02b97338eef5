/* Pressure [MPa] at places of a patch's fixed surface, for pictures. A model defines patch_depths: depths [mm] along the
 * surface's normals at n places, below zero out of contact. */
EXPORT void foundation_pressures(const double *pose, int patch, int n, const double *places, double *pressures) {
  const Frame frame = frame_of(pose);
  patch_depths(patch, pose, &frame, n, places, pressures);
  for (int i = 0; i < n; i += BLOCK) {
    Lanes depth = all(0.0);
    for (int l = 0; l < BLOCK && i + l < n; l++) depth[l] = pressures[i + l];
    depth = pressure_at(depth);
    for (int l = 0; l < BLOCK && i + l < n; l++) pressures[i + l] = depth[l];
  }
}
