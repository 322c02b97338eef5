/* Depths at points with unit normals (six numbers each) by Newton steps of g(c - d n) = 0; out of contact -g. */
#define DEPTH_STEPS 3
#define LEAST_COSINE 0.05

FUNCTION void patch_depths(int patch, const double *pose, const Frame *frame, int n, const double *places,
                           double *depths) {
  (void)patch;
  for (int i = 0; i < n; i += BLOCK) {
    Lanes from[3], normal[3], q[3], way[3], d = all(0.0), first = d;
    for (int l = 0; l < BLOCK; l++) {
      const double *place = places + 6 * (i + l < n ? i + l : i);
      for (int k = 0; k < 3; k++) from[k][l] = place[k] - pose[k], normal[k][l] = place[3 + k];
    }
    to_body(frame, from, q);
    to_body(frame, normal, way);
    for (int step = 0; step < DEPTH_STEPS; step++) {
      const Lanes point[3] = {q[0] - d * way[0], q[1] - d * way[1], q[2] - d * way[2]};
      Distance at;
      distance_at(point, 1, &at);
      if (step == 0) first = at.g;
      if (!any(first < 0.0)) break;
      d -= at.g / larger_of(-dot_of(at.slope, way), all(LEAST_COSINE));
    }
    d = pick(first < 0.0, d, -first);
    for (int l = 0; l < BLOCK && i + l < n; l++) depths[i + l] = d[l];
  }
}
