#include "$name.h"

const char *const ${name}_load_names[${guard}_LOADS] = {$names};
const char *const ${name}_load_units[${guard}_LOADS] = {$unit_names};
const char *const ${name}_patch_names[${guard}_PATCHES] = {$patch_names};

void ${name}_loads(const double pose[6], double loads[${guard}_LOADS]) { guarded_value(pose, loads, 0); }

int ${name}_status(const double pose[6]) {
  if (!finite_pose(pose)) return ${guard}_NOT_FINITE;
  return outside(pose) ? ${guard}_OUTSIDE : ${guard}_OK;
}

void ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]) {
  guarded_jacobian(pose, loads, 0, jacobian, 0);
}

void ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]) {
  guarded_hessian(pose, weights, 0, &hessian[0][0]);
}

void ${name}_roots(const double pose[6], double roots[${guard}_PATCHES], double jacobian[${guard}_PATCHES][6]) {
#if ROOTS
  guarded_jacobian(pose, 0, roots, 0, jacobian);
#else
  (void)pose, fill_nan(${guard}_PATCHES, roots), fill_nan(6 * ${guard}_PATCHES, jacobian[0]);
#endif
}

#if ${guard}_PRESSURES
const char *const ${name}_pressure_names[${guard}_PRESSURES] = {$pressure_names};
const char *const ${name}_pressure_units[${guard}_PRESSURES] = {$pressure_unit_names};

void ${name}_pressures(const double pose[6], double pressures[${guard}_PRESSURES]) {
  pressure_guarded_value(pose, pressures, 0);
}
#endif

void ${name}_confidence(const double pose[6], double *validity, double expected_error[${guard}_LOADS]) {
#if CALIBRATED_MODEL
  confidence_guarded_value(pose, expected_error, validity);
#else
  (void)pose, fill_nan(1, validity), fill_nan(${guard}_LOADS, expected_error);
#endif
}
