/* Which patches are bent: most of many patches carry nothing, and their second derivatives are zero. */
  const double *x[$patches];
  Local local[$patches];
  double s[$patches], *of_roots[$patches];
  int which[$patches], bent[$patches];
  for (int p = 0; p < $patches; p++) {
    local[p] = local_of(pose, &frame, anchors[p][0], anchors[p][1], anchors[p][2], 0);
    x[p] = local[p].x, of_roots[p] = s + p, which[p] = p;
  }
  roots_value($patches, which, x, of_roots);
  for (int p = 0; p < $patches; p++) {
    bent[p] = s[p] > 0.0 || (ROOTS && roots_weight[p] != 0.0);
  }
