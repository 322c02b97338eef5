#include "$name.h"

const char *const ${name}_load_names[${guard}_LOADS] = {$names};
const char *const ${name}_load_units[${guard}_LOADS] = {$unit_names};
const char *const ${name}_patch_names[${guard}_PATCHES] = {$patch_names};

static int status_of(const double *pose, const double *parts) {
  if (!finite_pose(pose)) return ${guard}_NOT_FINITE;
  return outside(pose, parts) ? ${guard}_OUTSIDE : ${guard}_OK;
}

int ${name}_loads(const double pose[6], double loads[${guard}_LOADS]) {
  double parts[ROOTS + 1] = {0};
  guarded_value(pose, loads, parts);
  return status_of(pose, parts);
}

int ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]) {
  double parts[ROOTS + 1] = {0}, slopes[ROOTS + 1][6];
  guarded_jacobian(pose, loads, parts, jacobian, slopes);
  return status_of(pose, parts);
}

int ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]) {
  static const double none[ROOTS + 1] = {0};
  double loads[${guard}_LOADS];
  guarded_hessian(pose, weights, none, &hessian[0][0]);
  return ${name}_loads(pose, loads);
}

int ${name}_roots(const double pose[6], double roots[${guard}_PATCHES], double jacobian[${guard}_PATCHES][6]) {
  double loads[${guard}_LOADS], loads_jacobian[${guard}_LOADS][6], parts[ROOTS + 1] = {0}, slopes[ROOTS + 1][6];
  int status;
  guarded_jacobian(pose, loads, parts, loads_jacobian, slopes);
  status = status_of(pose, parts);
  fill_nan(${guard}_PATCHES, roots);
  for (int p = 0; p < ${guard}_PATCHES; p++) fill_nan(6, jacobian[p]);
#if ROOTS
  if (status != ${guard}_NOT_FINITE) {
    double share[ROOTS];
    patch_roots(first_part, parts, roots, share);
    for (int p = 0; p < ${guard}_PATCHES; p++) {
      for (int j = 0; j < 6; j++) {
        jacobian[p][j] = 0.0;
        for (int i = first_part[p]; i < first_part[p + 1]; i++) jacobian[p][j] += share[i] * slopes[i][j];
      }
    }
  }
#endif
  return status;
}

#if ${guard}_PRESSURES
const char *const ${name}_pressure_names[${guard}_PRESSURES] = {$pressure_names};
const char *const ${name}_pressure_units[${guard}_PRESSURES] = {$pressure_unit_names};

int ${name}_pressures(const double pose[6], double pressures[${guard}_PRESSURES]) {
  double loads[${guard}_LOADS];
  if (finite_pose(pose)) pressures_at(pose, pressures);
  else fill_nan(${guard}_PRESSURES, pressures);
  return ${name}_loads(pose, loads);
}
#endif

int ${name}_confidence(const double pose[6], double *validity, double expected_error[${guard}_LOADS]) {
  double loads[${guard}_LOADS], parts[ROOTS + 1] = {0};
  guarded_value(pose, loads, parts);
#if CALIBRATED_MODEL
  *validity = confidence_at(pose, parts, expected_error);
#else
  fill_nan(1, validity);
  fill_nan(${guard}_LOADS, expected_error);
#endif
  return status_of(pose, parts);
}
