/* The kernel's functions, which call those of each patch. A template: a dollar sign marks what `formulas.py` fills in. */
static const double anchors[$patches][3] = {$anchors};

FUNCTION void ${before}kernel_value(const double *given, double *loads, double *roots) {
  const double *const pose = $held, *x[$patches];
  const Frame frame = frame_of(pose);
  Local local[$patches];
  double s[$patches], *of_roots[$patches], ratio[$patches][RATIOS], *of_ratios[$patches], normal[$patches];
  int which[$patches], count = 0;
  for (int p = 0; p < $patches; p++) {
    local[p] = local_of(pose, &frame, anchors[p][0], anchors[p][1], anchors[p][2], 0);
    x[p] = local[p].x, of_roots[p] = s + p, of_ratios[p] = ratio[p], which[p] = p;
  }
  roots_value($patches, which, x, of_roots);
  for (int p = 0; p < $patches; p++) {
    normal[p] = loads ? $n0 * pressed_square(s[p]) : 0.0;
    if (normal[p] > 0.0) which[count++] = p;
  }
  ratios_value(count, which, x, of_ratios);
  if (loads) memset(loads, 0, LOADS * sizeof(double));
  if (roots) memcpy(roots, s, sizeof s);
$values
}

FUNCTION void ${before}kernel_jacobian(const double *given, double *loads, double *roots, double (*loads_jacobian)[6],
                              double (*roots_jacobian)[6]) {
  const double *const pose = $held, *x[$patches];
  const Frame frame = frame_of(pose);
  Local local[$patches];
  double s[$patches], *of_roots[$patches], ratio[$patches][RATIOS], *of_ratios[$patches], normal[$patches];
  double ds[$patches][6], *slopes_of_roots[$patches], d_ratio[$patches][RATIOS][6], *slopes_of_ratios[$patches];
  int which[$patches], count = 0;
  for (int p = 0; p < $patches; p++) {
    local[p] = local_of(pose, &frame, anchors[p][0], anchors[p][1], anchors[p][2], 1);
    x[p] = local[p].x, of_roots[p] = s + p, of_ratios[p] = ratio[p], which[p] = p;
    slopes_of_roots[p] = ds[p], slopes_of_ratios[p] = d_ratio[p][0];
  }
  roots_gradient($patches, which, x, of_roots, slopes_of_roots);
  for (int p = 0; p < $patches; p++) {
    gradient_in_pose(local + p, ds[p]);
    normal[p] = loads ? $n0 * pressed_square(s[p]) : 0.0;
    if (normal[p] > 0.0) which[count++] = p;
  }
  ratios_gradient(count, which, x, of_ratios, slopes_of_ratios);
  if (loads) {
    memset(loads, 0, LOADS * sizeof(double));
    memset(loads_jacobian, 0, LOADS * sizeof(double[6]));
  }
  if (roots) {
    memcpy(roots, s, sizeof s);
    memcpy(roots_jacobian, ds, sizeof ds);
  }
$jacobians
  for (int k = 0; loads && k < LOADS; k++) gradient_by_free(loads_jacobian[k], 1);
  for (int k = 0; roots && k < $patches; k++) gradient_by_free(roots_jacobian[k], 1);
}

FUNCTION void ${before}kernel_hessian(const double *given, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  const double *const pose = $held;
  const Frame frame = frame_of(pose);
  memset(hessian, 0, 36 * sizeof(double));
$hessians
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + 6 * k, 1);
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + k, 6);
}
