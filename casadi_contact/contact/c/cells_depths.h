/* Depths at nodes by their numbers. */
FUNCTION void patch_depths(int patch, const double *pose, const Frame *frame, int n, const double *places,
                           double *depths) {
  for (int i = 0; i < n; i += BLOCK) {
    int ids[BLOCK];
    Depth at;
    for (int l = 0; l < BLOCK; l++) ids[l] = (int)places[i + l < n ? i + l : i];
    depth_at(patches[patch].nodes, ids, pose, frame, 1, &at);
    for (int l = 0; l < BLOCK && i + l < n; l++) depths[i + l] = at.d[l];
  }
}
