#include "$name.h"

const char *const ${name}_load_names[${guard}_LOADS] = {$names};
const char *const ${name}_load_units[${guard}_LOADS] = {$unit_names};
const char *const ${name}_patch_names[${guard}_PATCHES] = {$patch_names};

void ${name}_loads(const double pose[6], double loads[${guard}_LOADS]) { guarded_value(pose, loads, 0); }

int ${name}_status(const double pose[6]) {
  double parts[ROOTS + 1] = {0};
  if (!finite_pose(pose)) return ${guard}_NOT_FINITE;
  guarded_value(pose, 0, ROOTS ? parts : 0);
  return outside(pose, parts) ? ${guard}_OUTSIDE : ${guard}_OK;
}

void ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]) {
  guarded_jacobian(pose, loads, 0, jacobian, 0);
}

void ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]) {
  guarded_hessian(pose, weights, 0, &hessian[0][0]);
}

void ${name}_roots(const double pose[6], double roots[${guard}_PATCHES], double jacobian[${guard}_PATCHES][6]) {
  double parts[ROOTS + 1] = {0}, slopes[ROOTS + 1][6];
  guarded_jacobian(pose, 0, ROOTS ? parts : 0, 0, slopes);
  fill_nan(${guard}_PATCHES, roots);
  for (int p = 0; p < ${guard}_PATCHES; p++) fill_nan(6, jacobian[p]);
#if ROOTS
  if (finite_pose(pose)) {
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
}

#if ${guard}_PRESSURES
const char *const ${name}_pressure_names[${guard}_PRESSURES] = {$pressure_names};
const char *const ${name}_pressure_units[${guard}_PRESSURES] = {$pressure_unit_names};

void ${name}_pressures(const double pose[6], double pressures[${guard}_PRESSURES]) {
  if (finite_pose(pose)) pressures_at(pose, pressures);
  else fill_nan(${guard}_PRESSURES, pressures);
}
#endif

void ${name}_confidence(const double pose[6], double *validity, double expected_error[${guard}_LOADS]) {
  double parts[ROOTS + 1] = {0};
  guarded_value(pose, 0, ROOTS ? parts : 0);
#if CALIBRATED_MODEL
  *validity = confidence_at(pose, parts, expected_error);
#else
  fill_nan(1, validity);
  fill_nan(${guard}_LOADS, expected_error);
#endif
}
