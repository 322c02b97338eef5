/* max(s, 0)^2 of a root load s: N = n0 times this. */
INLINE double pressed_square(double s) { return s > 0.0 ? s * s : 0.0; }

/* total += d2/dpose2 of N phi + root_weight s, from local derivatives; d2s and d2_phi hold the lower triangle. */
INLINE void patch_hessian_in_pose(const Frame *frame, const Local *local, double n0, double s, const double *ds,
                                  double root_weight, const double *d2s, double phi, const double *d_phi,
                                  const double *d2_phi, double *total) {
  const double contact = s > 0.0 ? s : 0.0, touching = s > 0.0 ? 2.0 * n0 * phi : 0.0;
  const double normal = n0 * pressed_square(s), slope = 2.0 * n0 * contact, on_root = slope * phi + root_weight;
  double g[6], h[6][6];
  for (int i = 0; i < 6; i++) {
    g[i] = normal * d_phi[i] + on_root * ds[i];
    for (int j = 0; j <= i; j++) {
      h[i][j] = h[j][i] = on_root * d2s[6 * i + j] + touching * ds[i] * ds[j] +
                          slope * (ds[i] * d_phi[j] + d_phi[i] * ds[j]) + normal * d2_phi[6 * i + j];
    }
  }
  hessian_in_pose(frame, local, g, h, total);
}
