/* C of one patch: loads from its root load and its ratios. (void) is for a patch that none of the loads
 * needs. A template: a dollar sign marks what `formulas.py` fills in. */
INLINE void loads_on_${patch}(double normal, const double *ratio, double *loads) {
  (void)normal, (void)ratio, (void)loads;
$loads
}

INLINE void slopes_on_${patch}(const Local *local, double normal, double s, const double *ds, const double *ratio,
                            double (*d_ratio)[6], double *loads, double (*loads_jacobian)[6]) {
  (void)local, (void)d_ratio, (void)loads_jacobian;
  loads_on_${patch}(normal, ratio, loads);
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
  const double one = 1.0;
  double s, ds[6] = {0}, d2s[36] = {0};
  double ratio[RATIOS], phi = 0.0, d_phi[6] = {0}, d2_phi[36] = {0};
  root_${patch}_hessian(local.x, &one, &s, ds, d2s);
  if (loads_weight && s > 0.0) {
    const double c[RATIOS] = {$ratio_weights};
    phi = $sign($sensitive_weight);
    ratios_${patch}_hessian(local.x, c, ratio, d_phi, d2_phi);
$ratio_sum
  }
  patch_hessian_in_pose(frame, &local, $n0, s, ds, roots_weight ? roots_weight[$row] : 0.0, d2s, phi, d_phi, d2_phi, hessian);
}
