"""Templates of the C functions of a patch, and of the kernel that calls them."""

from __future__ import annotations

from string import Template

# Loads of one patch (or part) from its root load and its ratios, where it is pressed. (void) is for a patch without
# any of the loads asked for.
PATCH = Template("""\
INLINE void loads_on_${patch}(double normal, const double *ratio, double *loads) {
  (void)normal, (void)ratio, (void)loads;
$loads
}

INLINE void slopes_on_${patch}(const Local *local, double normal, double s, const double *ds, const double *ratio,
                            double (*d_ratio)[6], double (*loads_jacobian)[6]) {
  (void)local, (void)normal, (void)ratio, (void)d_ratio, (void)loads_jacobian;
$ratio_slopes
  for (int j = 0; j < 6; j++) {
    const double d_normal = 2.0 * $n0 * s * ds[j];
    (void)d_normal;
$rows
  }
}

/* N times phi = sum_k c_k ratio_k + sign c of the sensitive component: one weighted sum for all loads. */
INLINE void hessian_on_${patch}(const double *pose, const Frame *frame, const double *loads_weight,
                             const double *roots_weight, double *hessian) {
  const Local local = local_of(pose, frame, $anchor, 1);
  const double c[RATIOS] = {$ratio_weights};
  const double one = 1.0;
  double s, ds[6] = {0}, d2s[36] = {0};
  double ratio[RATIOS], phi = $sign($sensitive_weight), d_phi[6] = {0}, d2_phi[36] = {0};
  (void)loads_weight;
  root_${patch}_hessian(local.x, &one, &s, ds, d2s);
  if (s > 0.0) {
    ratios_${patch}_hessian(local.x, c, ratio, d_phi, d2_phi);
$ratio_sum
  } else {
    phi = 0.0;
  }
  patch_hessian_in_pose(frame, &local, $n0, s, ds, ROOTS ? roots_weight[$row] : 0.0, d2s, phi, d_phi, d2_phi, hessian);
}

INLINE void batch_on_${patch}(const double *pose, const Frame *frame, double (*loads)[LANES], double (*roots)[LANES]) {
  double x[6 * LANES], s[LANES], all_ratios[RATIOS * LANES];
  (void)loads;
  for (int l = 0; l < LANES; l++) {
    const Local local = local_of(pose + 6 * l, frame + l, $anchor, 0);
    for (int j = 0; j < 6; j++) x[j * LANES + l] = local.x[j];
  }
  root_${patch}_batch(x, s);
  ratios_${patch}_batch(x, all_ratios);
  if (ROOTS) memcpy(roots[$row], s, sizeof s);
  for (int l = 0; l < LANES; l++) {
    const double normal = $n0 * pressed_square(s[l]);
    (void)normal;
$lane_loads
  }
}
""")


KERNEL = Template("""\
static const double anchors[$patches][3] = {$anchors};

FUNCTION void kernel_value(const double *given, double *loads, double *roots) {
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
    normal[p] = $n0 * pressed_square(s[p]);
    if (normal[p] > 0.0) which[count++] = p;
  }
  ratios_value(count, which, x, of_ratios);
  memset(loads, 0, LOADS * sizeof(double));
  if (ROOTS) memcpy(roots, s, sizeof s);
$values
}

FUNCTION void kernel_jacobian(const double *given, double *loads, double *roots, double (*loads_jacobian)[6],
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
    normal[p] = $n0 * pressed_square(s[p]);
    if (normal[p] > 0.0) which[count++] = p;
  }
  ratios_gradient(count, which, x, of_ratios, slopes_of_ratios);
  memset(loads, 0, LOADS * sizeof(double));
  memset(loads_jacobian, 0, LOADS * sizeof(double[6]));
  if (ROOTS) {
    memcpy(roots, s, sizeof s);
    memcpy(roots_jacobian, ds, sizeof ds);
  }
$jacobians
  for (int k = 0; k < LOADS; k++) gradient_by_free(loads_jacobian[k], 1);
  for (int k = 0; k < ROOTS; k++) gradient_by_free(roots_jacobian[k], 1);
}

FUNCTION void kernel_hessian(const double *given, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  const double *const pose = $held;
  const Frame frame = frame_of(pose);
$bent
  memset(hessian, 0, 36 * sizeof(double));
$hessians
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + 6 * k, 1);
  for (int k = 0; k < 6; k++) gradient_by_free(hessian + k, 6);
}

FUNCTION void kernel_batch(const double *given, double (*loads)[LANES], double (*roots)[LANES]) {
  Frame frame[LANES];
  double pose[6 * LANES];
  for (int l = 0; l < LANES; l++, given += 6) {
    memcpy(pose + 6 * l, $held, 6 * sizeof(double));
    frame[l] = frame_of(pose + 6 * l);
  }
  memset(loads, 0, LOADS * sizeof(double[LANES]));
$batches
}
""")


# Of many patches most carry nothing, and their networks' second derivatives count for nothing.
BENT = Template("""\
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
  }""")
