/* The kernel's functions where patches are cut, from those of the parts: root loads of patches from those s of their parts,
 * first_part[p] to first_part[p + 1] - 1 (formulas: patch_roots of surrogate.py). A template. */
#define LEAST_ROOT 1e-9

/* S of a patch, slopes[i] = dS/ds_i, and d2S = whole dS dS^T + sum_i bends[i] ds_i ds_i^T */
INLINE double union_of(int patch, const double *s, double *slopes, double *bends, double *whole) {
  const int first = first_part[patch], end = first_part[patch + 1];
  double squares = 0.0, nearest = -INFINITY, sum = 0.0, apart[$parts], root;
  slopes[first] = 1.0, bends[first] = *whole = 0.0;
  if (end - first == 1) return s[first];
  for (int i = first; i < end; i++) {
    apart[i] = s[i] < -LEAST_ROOT ? s[i] : -LEAST_ROOT;
    if (s[i] > 0.0) squares += s[i] * s[i];
    if (apart[i] > nearest) nearest = apart[i];
  }
  for (int i = first; i < end; i++) sum += (nearest / apart[i]) * (nearest / apart[i]);
  root = squares > 0.0 ? sqrt(squares) : nearest / sqrt(sum);
  for (int i = first; i < end; i++) {
    const double share = root / apart[i];
    slopes[i] = squares > 0.0 ? (s[i] > 0.0 ? s[i] / root : 0.0) : share * share * share;
    bends[i] = squares > 0.0 ? (s[i] > 0.0) / root : -3.0 * slopes[i] / apart[i];
  }
  *whole = (squares > 0.0 ? -1.0 : 3.0) / root;
  return root;
}

FUNCTION void ${before}kernel_value(const double *pose, double *loads, double *roots) {
  double s[$parts], slopes[$parts], bends[$parts], whole;
  ${before}parts_kernel_value(pose, loads, roots ? s : 0);
  for (int p = 0; roots && p < ROOTS; p++) roots[p] = union_of(p, s, slopes, bends, &whole);
}

FUNCTION void ${before}kernel_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[6],
                                       double (*roots_jacobian)[6]) {
  double s[$parts], ds[$parts][6], slopes[$parts], bends[$parts], whole;
  ${before}parts_kernel_jacobian(pose, loads, roots ? s : 0, loads_jacobian, ds);
  for (int p = 0; roots && p < ROOTS; p++) {
    const int first = first_part[p];
    roots[p] = union_of(p, s, slopes, bends, &whole);
    through(first_part[p + 1] - first, slopes + first, ds + first, roots_jacobian[p]);
  }
}

FUNCTION void ${before}kernel_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                                      double *hessian) {
  double s[$parts], ds[$parts][6], slopes[$parts], bends[$parts], whole, weights[$parts], bent[36] = {0}, by_pose[6];
  if (roots_weight) ${before}parts_kernel_jacobian(pose, 0, s, 0, ds);
  for (int p = 0; roots_weight && p < ROOTS; p++) {
    const int first = first_part[p], end = first_part[p + 1];
    union_of(p, s, slopes, bends, &whole);
    through(end - first, slopes + first, ds + first, by_pose);
    for (int k = 0; k < 36; k++) bent[k] += roots_weight[p] * whole * by_pose[k / 6] * by_pose[k % 6];
    for (int i = first; i < end; i++) {
      weights[i] = roots_weight[p] * slopes[i];
      for (int k = 0; k < 36; k++) bent[k] += roots_weight[p] * bends[i] * ds[i][k / 6] * ds[i][k % 6];
    }
  }
  ${before}parts_kernel_hessian(pose, loads_weight, roots_weight ? weights : 0, hessian);
  for (int k = 0; k < 36; k++) hessian[k] += bent[k];
}
