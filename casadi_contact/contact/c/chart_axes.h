/* Loads in chart axes and in the fixed body's; TURNED: the two differ. */

/* A twist or wrench into chart axes. */
INLINE void turn_twist(const double turn[3][3], const double x[6], double out[6]) {
  for (int i = 0; i < 6; i++) {
    const double *row = turn[i % 3], *part = x + (i < 3 ? 0 : 3);
    out[i] = row[0] * part[0] + row[1] * part[1] + row[2] * part[2];
  }
}

#if TURNED
/* B^T h B with B = turn twice */
INLINE void turn_back_square(const double turn[3][3], double h[6][6]) {
  double half[6][6];
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 6; j++) {
      half[i][j] = 0.0;
      for (int k = 0; k < 3; k++) half[i][j] += h[i][(j < 3 ? 0 : 3) + k] * turn[k][j % 3];
    }
  }
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 6; j++) {
      h[i][j] = 0.0;
      for (int k = 0; k < 3; k++) h[i][j] += turn[k][i % 3] * half[(i < 3 ? 0 : 3) + k][j];
    }
  }
}

INLINE void turn_back_row(const double turn[3][3], double x[6]) {
  double old[6];
  memcpy(old, x, sizeof old);
  for (int i = 0; i < 6; i++) {
    const double *part = old + (i < 3 ? 0 : 3);
    x[i] = turn[0][i % 3] * part[0] + turn[1][i % 3] * part[1] + turn[2][i % 3] * part[2];
  }
}

/* A vector with the rows of its derivatives. */
INLINE void turn_back_vectors(const double turn[3][3], double x[3], double rows[3][6]) {
  double old[3], old_rows[3][6];
  memcpy(old, x, sizeof old);
  memcpy(old_rows, rows, sizeof old_rows);
  for (int i = 0; i < 3; i++) {
    x[i] = turn[0][i] * old[0] + turn[1][i] * old[1] + turn[2][i] * old[2];
    for (int a = 0; a < 6; a++) {
      rows[i][a] = turn[0][i] * old_rows[0][a] + turn[1][i] * old_rows[1][a] + turn[2][i] * old_rows[2][a];
    }
  }
}
#endif

/* Loads in chart axes become those in the fixed body's. */
INLINE void turn_back(const double turn[3][3], int order, PatchLoads *out) {
#if TURNED
  turn_back_row(turn, out->wrench);
  turn_back_row(turn, out->gap_slope);
  if (order == FIRST) turn_back_square(turn, out->stiffness);
  if (order == SECOND) {
    turn_back_square(turn, out->curvature);
    turn_back_square(turn, out->gap_curvature);
  }
#else
  (void)turn, (void)order, (void)out;
#endif
}
