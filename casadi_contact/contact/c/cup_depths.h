/* Depths in directions (unit vectors) from the cup's centre. */
FUNCTION void patch_depths(int patch, const double *pose, const Frame *frame, int n, const double *places,
                           double *depths) {
  const Place p = place_of(pose);
  (void)patch, (void)frame;
  for (int i = 0; i < n; i++) {
    const double s = dot3(places + 3 * i, p.b), square = BALL_RADIUS * BALL_RADIUS - p.length * p.length + s * s;
    depths[i] = square > 0.0 ? s + sqrt(square) - CUP_RADIUS : -CUP_RADIUS;
  }
}
