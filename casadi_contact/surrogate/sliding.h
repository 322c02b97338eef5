/* Loads of a surrogate whose bodies slide, by x (see contact/c/moving.h): the law of a patch, which CasADi writes, makes of
 * its wrench at rest, by kernel_value and its like, the wrench that it has. A patch that is free has none. */
typedef int Law(const double **, double **, long long *, double *, int);
Law law_value, law_first, law_second;
#define LAW(what, weights, ...) \
  law_##what((const double *[]){motion, rest + 6 * p, spreads[p], weights}, (double *[]){__VA_ARGS__}, 0, 0, 0)

static const double none[6] = {0.0};

FUNCTION void moving_kernel_value(const double *x, double *loads, double *roots) {
  double motion[11], rest[6 * PATCHES], wrench[6];
  (void)roots, motion_value((const double *[]){x}, (double *[]){motion}, 0, 0, 0);
  kernel_value(x, rest, 0), memset(loads, 0, MOVED * sizeof(double));
  for (int p = 0; p < PATCHES; p++) {
    if (!memcmp(rest + 6 * p, none, sizeof none)) continue;
    LAW(value, 0, wrench);
    for (int i = 0; i < MOVED; i++) for (int k = 0; k < 6; k++) loads[i] += selection[p][i][k] * wrench[k];
  }
}

FUNCTION void moving_kernel_jacobian(const double *x, double *loads, double *roots, double (*loads_jacobian)[VARIABLES],
                                     double (*roots_jacobian)[VARIABLES]) {
  double motion[11], rest[6 * PATCHES], rest_slopes[6 * PATCHES][6], slopes[VARIABLES][LOCALS];
  (void)roots, (void)roots_jacobian, motion_value((const double *[]){x}, (double *[]){motion}, 0, 0, 0);
  motion_slopes((const double *[]){x}, (double *[]){slopes[0]}, 0, 0, 0);
  kernel_jacobian(x, rest, 0, rest_slopes, 0);
  memset(loads, 0, MOVED * sizeof(double)), memset(loads_jacobian, 0, MOVED * sizeof(double[VARIABLES]));
  for (int p = 0; p < PATCHES; p++) {
    double wrench[6], by[LOCALS + 6][6], row[VARIABLES]; /* by the motion and by the wrench at rest */
    if (!memcmp(rest + 6 * p, none, sizeof none)) continue;
    LAW(first, 0, wrench, by[0]);
    for (int i = 0; i < MOVED; i++) {
      double picked[LOCALS + 6] = {0.0};
      for (int k = 0; k < 6; k++) {
        loads[i] += selection[p][i][k] * wrench[k];
        for (int b = 0; b < LOCALS + 6; b++) picked[b] += selection[p][i][k] * by[b][k];
      }
      through(6, picked + LOCALS, rest_slopes + 6 * p, row);
      add_row_of_motion(picked, slopes, row);
      for (int j = 0; j < VARIABLES; j++) loads_jacobian[i][j] += row[j];
    }
  }
}

FUNCTION void moving_kernel_hessian(const double *x, const double *loads_weight, const double *roots_weight,
                                    double *hessian) {
  double motion[11], rest[6 * PATCHES], rest_slopes[6 * PATCHES][6], on_rest[6 * PATCHES] = {0.0}, still[36];
  double gradient[LOCALS] = {0.0}, mixed[6][LOCALS] = {{0.0}}, local[LOCALS][LOCALS] = {{0.0}}, by_pose[36] = {0.0};
  (void)roots_weight, motion_value((const double *[]){x}, (double *[]){motion}, 0, 0, 0);
  kernel_jacobian(x, rest, 0, rest_slopes, 0);
  for (int p = 0; p < PATCHES; p++) {
    double weights[6] = {0.0}, by_motion[LOCALS], by_both[LOCALS][6], by_motions[LOCALS][LOCALS], by_rests[36];
    if (!memcmp(rest + 6 * p, none, sizeof none)) continue;
    for (int i = 0; loads_weight && i < 6 * MOVED; i++) weights[i % 6] += loads_weight[i / 6] * selection[p][i / 6][i % 6];
    LAW(second, weights, by_motion, on_rest + 6 * p, by_motions[0], by_both[0], by_rests);
    for (int b = 0; b < LOCALS; b++) {
      double row[6];
      through(6, by_both[b], rest_slopes + 6 * p, row);
      gradient[b] += by_motion[b];
      for (int j = 0; j < 6; j++) mixed[j][b] += row[j];
      for (int c = 0; c < LOCALS; c++) local[b][c] += by_motions[b][c];
    }
    add_through(6, by_rests, rest_slopes + 6 * p, by_pose);
  }
  kernel_hessian(x, on_rest, 0, still);
  memset(hessian, 0, VARIABLES * VARIABLES * sizeof(double));
  for (int i = 0; i < 36; i++) hessian[VARIABLES * (i / 6) + i % 6] = still[i] + by_pose[i];
  add_bend_of_motion(x, gradient, mixed, local, hessian);
}
