/* Sum of max(s, 0)^2 over the root loads of spots, those of one lane `stride` apart: N = n0 times this. */
INLINE double pressed_squares(int spots, const double *s, int stride) {
  double sum = 0.0;
  for (int k = 0; k < spots; k++) {
    const double pressed = s[k * stride] > 0.0 ? s[k * stride] : 0.0;
    sum += pressed * pressed;
  }
  return sum;
}

INLINE void normal_gradient(int spots, double n0, const double *s, double (*ds)[6], double *d_normal) {
  for (int j = 0; j < 6; j++) {
    double sum = 0.0;
    for (int k = 0; k < spots; k++) sum += (s[k] > 0.0 ? s[k] : 0.0) * ds[k][j];
    d_normal[j] = 2.0 * n0 * sum;
  }
}

/* total += d2/dpose2 of N phi + root_weight s, from derivatives in the local pose: s and ds of the spots; d2s is the sum
 * of their second derivatives, each times on_root = 2 n0 max(s, 0) phi + root_weight; d2s and d2_phi hold the lower
 * triangle. */
INLINE void patch_hessian_in_pose(const Frame *frame, const Local *local, double n0, int spots, const double *s,
                                  double (*ds)[6], const double *on_root, const double *d2s, double phi,
                                  const double *d_phi, const double *d2_phi, double *total) {
  const double normal = n0 * pressed_squares(spots, s, 1);
  double d_normal[6], g[6], h[6][6];
  normal_gradient(spots, n0, s, ds, d_normal);
  for (int i = 0; i < 6; i++) {
    g[i] = normal * d_phi[i];
    for (int k = 0; k < spots; k++) g[i] += on_root[k] * ds[k][i];
    for (int j = 0; j <= i; j++) {
      double squares = 0.0;
      for (int k = 0; k < spots; k++) squares += s[k] > 0.0 ? ds[k][i] * ds[k][j] : 0.0;
      h[i][j] = h[j][i] = d2s[6 * i + j] + 2.0 * n0 * phi * squares + d_normal[i] * d_phi[j] +
                          d_phi[i] * d_normal[j] + normal * d2_phi[6 * i + j];
    }
  }
  hessian_in_pose(frame, local, g, h, total);
}
