/* Kernels of loads that depend on x: a pose, its rates, and coefficients of friction where these are inputs. The motion
 * depends on x by (v - omega x t, omega), omega = sum of rates and axes, of which each turns with the angles before it. */
INLINE Frame moving_frame(const double *x) {
  Frame frame = frame_of(x);
  double turned[3];
  for (int i = 0; i < 3; i++) {
    frame.motion[3 + i] = x[9] * frame.e[0][i] + x[10] * frame.e[1][i] + x[11] * frame.e[2][i];
  }
  cross(x, frame.motion + 3, turned);
  for (int i = 0; i < 3; i++) frame.motion[i] = x[6 + i] + turned[i];
  memcpy(frame.motion + 6, COEFFICIENTS ? x + 12 : friction, sizeof friction);
  return frame;
}
#define FRAME_OF(x) moving_frame(x)

/* Derivatives of omega by angles, then by their rates */
INLINE void turns_of(const double *x, const Frame *frame, double by[6][3]) {
  double after[3] = {0.0}; /* what turns with an angle */
  for (int j = 2; j >= 0; j--) {
    cross(frame->e[j], after, by[j]);
    for (int i = 0; i < 3; i++) by[3 + j][i] = frame->e[j][i], after[i] += x[9 + j] * frame->e[j][i];
  }
}

/* Derivatives of the motion by x */
INLINE void motion_slopes(const double *x, const Frame *frame, double slopes[VARIABLES][LOCALS]) {
  double by[6][3];
  turns_of(x, frame, by);
  memset(slopes, 0, sizeof(double[VARIABLES][LOCALS]));
  for (int j = 0; j < 6; j++) {
    double *row = slopes[j < 3 ? 3 + j : 6 + j];
    cross(x, by[j], row);
    memcpy(row + 3, by[j], sizeof by[0]);
  }
  for (int i = 0; i < 3; i++) {
    const double axis[3] = {i == 0, i == 1, i == 2};
    cross(axis, frame->motion + 3, slopes[i]);
    slopes[6 + i][i] = 1.0;
  }
  for (int j = 0; j < COEFFICIENTS; j++) slopes[12 + j][6 + j] = 1.0;
}

/* Row of derivatives by the pose, with those by the motion */
INLINE void add_row_of_motion(const double *by_motion, double slopes[VARIABLES][LOCALS], double row[VARIABLES]) {
  for (int i = 0; i < VARIABLES; i++) {
    row[i] = i < 6 ? row[i] : 0.0;
    for (int b = 0; b < LOCALS; b++) row[i] += by_motion[b] * slopes[i][b];
  }
}

/* + second derivatives by x that come with the motion; gradient . motion = g v + omega . (h - t x g) */
INLINE void bend_by_motion(const double *x, const Frame *frame, const PatchLoads *of, double h[VARIABLES][VARIABLES]) {
  double slopes[VARIABLES][LOCALS], mixed[VARIABLES][LOCALS] = {{0.0}}, by[6][3], lever[3], turned[3];
  motion_slopes(x, frame, slopes);
  turns_of(x, frame, by);
  for (int b = 0; b < LOCALS; b++) {
    double by_twist[6], by_pose[6];
    for (int a = 0; a < 6; a++) by_twist[a] = of->mixed[a][b];
    row_by_pose(frame, by_twist, by_pose);
    for (int a = 0; a < 6; a++) mixed[a][b] = by_pose[a];
  }
  for (int i = 0; i < VARIABLES; i++) { /* half of the local part goes to each side */
    for (int b = 0; b < LOCALS; b++) for (int c = 0; c < LOCALS; c++) mixed[i][b] += 0.5 * of->local[b][c] * slopes[i][c];
  }
  for (int i = 0; i < VARIABLES; i++) {
    for (int j = 0; j < VARIABLES; j++) {
      for (int b = 0; b < LOCALS; b++) h[i][j] += mixed[i][b] * slopes[j][b] + slopes[i][b] * mixed[j][b];
    }
  }
  cross(x, of->gradient, lever);
  for (int i = 0; i < 3; i++) lever[i] = of->gradient[3 + i] - lever[i];
  for (int j = 0; j < 6; j++) {
    const int column = j < 3 ? 3 + j : 6 + j;
    cross(by[j], of->gradient, turned);
    for (int i = 0; i < 3; i++) h[i][column] += turned[i], h[column][i] += turned[i];
    for (int i = 0; i < 3 && (j < 3 ? i <= j : i < j - 3); i++) {
      cross(frame->e[i], by[j], turned);
      h[3 + i][column] += dot3(lever, turned);
      if (3 + i != column) h[column][3 + i] += dot3(lever, turned);
    }
  }
}
