/* total += d2/dpose2 of N phi + root_weight s, N = n0 max(s, 0)^2, from derivatives in the local pose; d2s and d2_phi
 * hold the lower triangle. */
INLINE void patch_hessian_in_pose(const Frame *frame, const Local *local, double n0, double s, const double *ds,
                                  const double *d2s, double phi, const double *d_phi, const double *d2_phi,
                                  double root_weight, double *total) {
  const double contact = s > 0.0 ? s : 0.0, normal = n0 * contact * contact, slope = 2.0 * n0 * contact;
  const double on_root = slope * phi + root_weight, on_square = 2.0 * n0 * phi;
  double g[6], h[6][6];
  for (int i = 0; i < 6; i++) {
    g[i] = on_root * ds[i] + normal * d_phi[i];
    for (int j = 0; j <= i; j++) {
      h[i][j] = h[j][i] = on_root * d2s[6 * i + j] + on_square * ds[i] * ds[j] +
                          slope * (ds[i] * d_phi[j] + d_phi[i] * ds[j]) + normal * d2_phi[6 * i + j];
    }
  }
  hessian_in_pose(frame, local, g, h, total);
}
