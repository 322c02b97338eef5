/* Depths at places (u, v) of a patch's chart. */
FUNCTION void patch_depths(int patch, const double *pose, const Frame *frame, int n, const double *places,
                           double *depths) {
  const Surfaces *s = surfaces + patch;
  const Place p = place_of(s, pose, frame);
  for (int i = 0; i < n; i += BLOCK) {
    Lanes u, v;
    Ray ray;
    for (int l = 0; l < BLOCK; l++) {
      const double *place = places + 2 * (i + l < n ? i + l : i);
      u[l] = place[0], v[l] = place[1];
    }
    cast(s, &p, u, v, OWN_ARC, DEPTH_ONLY, &ray);
    for (int l = 0; l < BLOCK && i + l < n; l++) depths[i + l] = (ray.step * ray.length)[l];
  }
}
