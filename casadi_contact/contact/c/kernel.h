/* patch_loads from the model's loads_of_patch: one function for each order, not inlined, which patches share. */
#define LOADS_OF_ORDER(name, order)                                                                                 \
  FUNCTION void name(int patch, const double *pose, const Frame *frame, int with_gap, const double *weights,       \
                     PatchLoads *out) {                                                                            \
    loads_of_patch(patch, pose, frame, order, with_gap, weights, out);                                              \
  }
LOADS_OF_ORDER(loads_value, VALUE) LOADS_OF_ORDER(loads_first, FIRST)
LOADS_OF_ORDER(loads_second, SECOND) LOADS_OF_ORDER(loads_gaps, GAPS)

INLINE void patch_loads(int patch, const double *pose, const Frame *frame, int order, int with_gap,
                        const double *weights, PatchLoads *out) {
  if (order == VALUE) loads_value(patch, pose, frame, with_gap, weights, out);
  if (order == FIRST) loads_first(patch, pose, frame, with_gap, weights, out);
  if (order == SECOND) loads_second(patch, pose, frame, with_gap, weights, out);
  if (order == GAPS) loads_gaps(patch, pose, frame, 1, weights, out);
}

/* Named loads and root loads of a pose with derivatives, from patch_loads. loads = sum of selection x wrench; the root
 * load of a patch with normal load N is sqrt(N / N0) in contact, -GAP_SLOPE gap out of it. */

/* N of a patch and dN/dF */
INLINE double normal_load(int patch, const double wrench[6], double slope[3]) {
  const int k = normal_component[patch];
  double size;
  slope[0] = slope[1] = slope[2] = 0.0;
  if (k >= 0) {
    slope[k] = normal_sign[patch];
    return normal_sign[patch] * wrench[k];
  }
  size = sqrt(wrench[0] * wrench[0] + wrench[1] * wrench[1] + wrench[2] * wrench[2]);
  for (int i = 0; i < 3; i++) slope[i] = size > 0.0 ? wrench[i] / size : 0.0;
  return size;
}

INLINE void kernel_loads(const double *pose, int order, double *loads, double *roots, double (*loads_jacobian)[VARIABLES],
                         double (*roots_jacobian)[VARIABLES]) {
  const Frame frame = FRAME_OF(pose);
  if (loads) memset(loads, 0, LOADS * sizeof(double));
  if (loads && order == FIRST) memset(loads_jacobian, 0, LOADS * sizeof(double[VARIABLES]));
#if MOVING
  double slopes[VARIABLES][LOCALS];
  if (order == FIRST) motion_slopes((const double *[]){pose}, (double *[]){slopes[0]}, 0, 0, 0);
#endif
  for (int p = 0; p < PATCHES; p++) {
    PatchLoads of;
    double rows[6][VARIABLES], slope[3], normal;
    patch_loads(p, pose, &frame, order, roots != 0, 0, &of);
    for (int k = 0; k < 6 && order == FIRST; k++) row_by_pose(&frame, of.stiffness[k], rows[k]);
#if MOVING
    for (int k = 0; k < 6 && order == FIRST; k++) add_row_of_motion(of.by_motion[k], slopes, rows[k]);
#endif
    for (int i = 0; loads && i < LOADS; i++) {
      for (int k = 0; k < 6; k++) {
        loads[i] += selection[p][i][k] * of.wrench[k];
        for (int j = 0; j < VARIABLES && order == FIRST; j++) loads_jacobian[i][j] += selection[p][i][k] * rows[k][j];
      }
    }
    if (!roots) continue;
    normal = normal_load(p, of.wrench, slope);
    roots[p] = normal > 0.0 ? sqrt(normal * (1.0 / REFERENCE_LOAD)) : -GAP_SLOPE * of.gap + 0.0 * normal;
    if (order == VALUE) continue;
    if (!(normal > 0.0)) row_by_pose(&frame, of.gap_slope, roots_jacobian[p]);
    for (int j = 0; j < 6; j++) {
      const double by_force = slope[0] * rows[0][j] + slope[1] * rows[1][j] + slope[2] * rows[2][j];
      roots_jacobian[p][j] = normal > 0.0 ? 0.5 / (REFERENCE_LOAD * roots[p]) * by_force
                                          : -GAP_SLOPE * roots_jacobian[p][j];
    }
  }
}

FUNCTION void kernel_value(const double *pose, double *loads, double *roots) {
  kernel_loads(pose, VALUE, loads, roots, 0, 0);
}

FUNCTION void kernel_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[VARIABLES],
                              double (*roots_jacobian)[VARIABLES]) {
  kernel_loads(pose, FIRST, loads, roots, loads_jacobian, roots_jacobian);
}

/* What a weighted root load adds: to the weights of the wrench's components, and what bends beside them. */
INLINE void weigh_root(int patch, const PatchLoads *of, double weight, double weights[6], double bent[6][6]) {
  double slope[3], by_twist[6] = {0.0};
  const double normal = normal_load(patch, of->wrench, slope), root = sqrt(normal / REFERENCE_LOAD);
  const double scale = 0.5 * weight / (REFERENCE_LOAD * root), size = normal_component[patch] < 0 ? normal : 0.0;
  for (int k = 0; k < 3; k++) {
    weights[k] += scale * slope[k];
    for (int a = 0; a < 6; a++) by_twist[a] += slope[k] * of->stiffness[k][a];
  }
  for (int a = 0; a < 6; a++) {
    for (int b = 0; b < 6; b++) {
      double sum = 0.0; /* the magnitude's own curvature (1 - f f^T)/|F| */
      for (int k = 0; k < 3; k++) sum += of->stiffness[k][a] * of->stiffness[k][b];
      bent[a][b] = -0.5 * scale / normal * by_twist[a] * by_twist[b];
      if (size > 0.0) bent[a][b] += scale / size * (sum - by_twist[a] * by_twist[b]);
    }
  }
}

FUNCTION void kernel_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  const Frame frame = FRAME_OF(pose);
  memset(hessian, 0, VARIABLES * VARIABLES * sizeof(double));
  for (int p = 0; p < PATCHES; p++) {
    PatchLoads of;
    double weights[6] = {0.0};
    for (int i = 0; loads_weight && i < LOADS; i++) {
      for (int k = 0; k < 6; k++) weights[k] += loads_weight[i] * selection[p][i][k];
    }
    if (roots_weight) {
      double slope[3], bent[6][6];
      patch_loads(p, pose, &frame, FIRST, 0, 0, &of);
      if (normal_load(p, of.wrench, slope) > 0.0) {
        weigh_root(p, &of, roots_weight[p], weights, bent);
        add_by_pose(&frame, bent, hessian);
      }
    }
    patch_loads(p, pose, &frame, SECOND, roots_weight != 0, weights, &of);
    add_by_pose(&frame, of.curvature, hessian);
#if MOVING
    add_bend_of_motion(pose, of.gradient, of.mixed, of.local, hessian);
#endif
    if (roots_weight) {
      for (int a = 0; a < 6; a++) for (int b = 0; b < 6; b++) of.gap_curvature[a][b] *= -GAP_SLOPE * roots_weight[p];
      add_by_pose(&frame, of.gap_curvature, hessian);
    }
  }
}
