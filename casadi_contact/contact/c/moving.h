/* Kernels of loads that depend on x: a pose, its rates, and coefficients of friction where these are inputs. They do by the
 * pose and by its motion, which CasADi writes with its derivatives: `motion_functions` in contact/friction.py. */
INLINE Frame moving_frame(const double *x) {
  Frame frame = frame_of(x);
  motion_value((const double *[]){x}, (double *[]){frame.motion}, 0, 0, 0);
  return frame;
}

/* Row of derivatives by the pose, with those by the motion */
INLINE void add_row_of_motion(const double *by_motion, double slopes[VARIABLES][LOCALS], double row[VARIABLES]) {
  for (int i = 0; i < VARIABLES; i++) {
    row[i] = i < 6 ? row[i] : 0.0;
    for (int b = 0; b < LOCALS; b++) row[i] += by_motion[b] * slopes[i][b];
  }
}

/* + second derivatives by x: of a function of the pose and the motion, what its derivatives by the motion add */
INLINE void add_bend_of_motion(const double *x, const double *gradient, double mixed[6][LOCALS],
                               double local[LOCALS][LOCALS], double *hessian) {
  double bend[VARIABLES * VARIABLES];
  motion_bend((const double *[]){x, gradient, mixed[0], local[0]}, (double *[]){bend}, 0, 0, 0);
  for (int i = 0; i < VARIABLES * VARIABLES; i++) hessian[i] += bend[i];
}
