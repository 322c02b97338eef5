/* The kernel's functions as others call them: NaN in all outputs where the pose is not finite. Loads or roots that are 0, with
 * their derivatives, are left out; so are the roots' weights. Another library calls those of a kernel that defines ENTRY. */
#ifndef ENTRY
#define ENTRY FUNCTION
#endif

ENTRY void ${before}guarded_value(const double *pose, double *loads, double *roots) {
  if (all_finite($inputs, pose)) {
    ${before}kernel_value(pose, loads, roots);
    return;
  }
  if (loads) fill_nan($loads, loads);
  if (roots) fill_nan($roots, roots);
}

ENTRY void ${before}guarded_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[$inputs],
                               double (*roots_jacobian)[$inputs]) {
  if (all_finite($inputs, pose)) {
    ${before}kernel_jacobian(pose, loads, roots, loads_jacobian, roots_jacobian);
    return;
  }
  if (loads) fill_nan($loads, loads), fill_nan($inputs * $loads, loads_jacobian[0]);
  if (roots) fill_nan($roots, roots), fill_nan($inputs * $roots, roots_jacobian[0]);
}

ENTRY void ${before}guarded_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                              double *hessian) {
  if (all_finite($inputs, pose)) ${before}kernel_hessian(pose, loads_weight, roots_weight, hessian);
  else fill_nan($inputs * $inputs, hessian);
}

/* Of n poses (n x $inputs); an array that is 0 is left out. */
ENTRY void ${before}values_of(long long n, const double *poses, double *loads, double *roots) {
  for (long long i = 0; i < n; i++) {
    ${before}guarded_value(poses + $inputs * i, loads ? loads + $loads * i : 0, roots ? roots + $roots * i : 0);
  }
}

/* For arrays as well: with slopes (n x $loads x $inputs), and Hessians (n x $inputs x $inputs) of the sums weighted by weights (n x $loads). */
ENTRY void ${before}array_jacobians(long long n, const double *poses, double *loads, double *slopes) {
  for (long long i = 0; i < n; i++, poses += $inputs, loads += $loads, slopes += $inputs * ($loads)) {
    ${before}guarded_jacobian(poses, loads, 0, (double(*)[$inputs])slopes, 0);
  }
}

ENTRY void ${before}array_hessians(long long n, const double *poses, const double *weights, double *hessians) {
  for (long long i = 0; i < n; i++) ${before}guarded_hessian(poses + $inputs * i, weights + $loads * i, 0, hessians + $inputs * $inputs * i);
}
