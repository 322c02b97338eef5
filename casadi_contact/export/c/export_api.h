/* $description
 * $compiler; thread-safe; no memory is allocated. Written by casadi_contact $version.
 *
 * pose      $pose
 *           of the moving body in the fixed body's frame, R = Rx(rx) Ry(ry) Rz(rz)
 * loads     $loads
 *           on the fixed body, in its frame, about its origin
 * roots     $patches [-]
 *           signed root load of each patch: the root of its normal load over $reference_load N in contact, below zero
 *           out of contact
 * validity  [-] 1 well inside what was learned, 0 far outside; expected_error [the loads' units]: 95 % of errors lie
 *           below it$no_confidence
 * pressures $pressures
 *
 * Numbers are given for every pose; NaN where it holds NaN or infinity. Where it is not one that this model is made for
 * ($learned), they mean nothing, as ${name}_status says. */
#ifndef ${guard}_H
#define ${guard}_H

#ifdef __cplusplus
extern "C" {
#endif

#define ${guard}_POSE 6
#define ${guard}_LOADS $count
#define ${guard}_PATCHES $patch_count
#define ${guard}_PRESSURES $pressure_count

enum { ${guard}_OK, ${guard}_OUTSIDE, ${guard}_NOT_FINITE };

extern const char *const ${name}_load_names[${guard}_LOADS];
extern const char *const ${name}_load_units[${guard}_LOADS];
extern const char *const ${name}_patch_names[${guard}_PATCHES];

/* Whether the model is made for a pose; it takes as long as the confidence does. */
int ${name}_status(const double pose[6]);

/* loads [$units] of pose [mm, mm, mm, rad, rad, rad] */
void ${name}_loads(const double pose[6], double loads[${guard}_LOADS]);

/* jacobian[i][j] = d loads[i] / d pose[j], row after row [a load's unit per mm, per rad] */
void ${name}_jacobian(const double pose[6], double loads[${guard}_LOADS], double jacobian[${guard}_LOADS][6]);

/* hessian = sum of weights[i] * d2 loads[i] / d pose2, symmetric, in full; it has the units of that sum */
void ${name}_hessian(const double pose[6], const double weights[${guard}_LOADS], double hessian[6][6]);

/* roots [-]; jacobian[p][j] = d roots[p] / d pose[j] [1/mm, 1/rad] */
void ${name}_roots(const double pose[6], double roots[${guard}_PATCHES], double jacobian[${guard}_PATCHES][6]);

/* validity [-] and expected_error [$units] */
void ${name}_confidence(const double pose[6], double *validity, double expected_error[${guard}_LOADS]);

#if ${guard}_PRESSURES
extern const char *const ${name}_pressure_names[${guard}_PRESSURES];
extern const char *const ${name}_pressure_units[${guard}_PRESSURES];

/* pressures as listed above, of pose [mm, mm, mm, rad, rad, rad] */
void ${name}_pressures(const double pose[6], double pressures[${guard}_PRESSURES]);
#endif

#ifdef __cplusplus
}
#endif

#endif
