/* $description
 * Plain C99, no library but libm; thread-safe; no memory is allocated. Written by casadi_contact $version.
 * pose = ($pose): mm and rad. loads = ($loads): $units. */
#ifndef ${guard}_H
#define ${guard}_H

#ifdef __cplusplus
extern "C" {
#endif

#define ${guard}_POSE 6
#define ${guard}_LOADS $count

extern const char *const ${name}_load_names[${guard}_LOADS];

void ${name}_loads(const double pose[6], double loads[${guard}_LOADS]);

/* jacobian[i][j] = d loads[i] / d pose[j], row after row. */
void ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]);

/* hessian = sum of weights[i] * d2 loads[i] / d pose2, symmetric, in full. */
void ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]);

#ifdef __cplusplus
}
#endif

#endif
