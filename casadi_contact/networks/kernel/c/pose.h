/* Local pose of a patch: x = (t + R a, rx, ry, rz) with anchor a, R = Rx Ry Rz, and its first two derivatives.
 * With v = R a and axes e_0, e_1, e_2: dv/dq_j = e_j x v, d2v/dq_i dq_j = e_i x (e_j x v) for i <= j. */
typedef struct {
  double r[3][3]; /* rotation */
  double e[3][3]; /* axes, row by row */
#if MOVING
  double motion[11]; /* see contact/c/friction.h */
#endif
} Frame;

typedef struct {
  double x[6];
  double v[3];
  double dv[3][3]; /* dv[j] = dv/dq_j */
} Local;

INLINE Frame frame_of(const double pose[6]) {
  const double sx = sin(pose[3]), sy = sin(pose[4]), sz = sin(pose[5]);
  const double cx = cos(pose[3]), cy = cos(pose[4]), cz = cos(pose[5]);
  const Frame f = {
      {{cy * cz, -cy * sz, sy},
       {cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy},
       {sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy}},
      {{1.0, 0.0, 0.0}, {0.0, cx, sx}, {sy, -sx * cy, cx * cy}},
  };
  return f;
}

INLINE void cross(const double a[3], const double b[3], double c[3]) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

/* Terms of a coordinate of the anchor that is zero, a constant, are left out, and the sines that only they need. */
INLINE Local local_of(const double pose[6], const Frame *f, double ax, double ay, double az, int derivatives) {
  Local local;
  for (int i = 0; i < 3; i++) {
    local.v[i] = (ax ? ax * f->r[i][0] : 0.0) + (ay ? ay * f->r[i][1] : 0.0) + (az ? az * f->r[i][2] : 0.0);
    local.x[i] = pose[i] + local.v[i];
    local.x[3 + i] = pose[3 + i];
  }
  if (derivatives) {
    for (int j = 0; j < 3; j++) cross(f->e[j], local.v, local.dv[j]);
  }
  return local;
}

/* d/dx -> d/dpose, in place */
INLINE void gradient_in_pose(const Local *local, double g[6]) {
  for (int j = 0; j < 3; j++) g[3 + j] += g[0] * local->dv[j][0] + g[1] * local->dv[j][1] + g[2] * local->dv[j][2];
}

/* d2/dx2 (full) with its d/dx -> d2/dpose2, added to total */
INLINE void hessian_in_pose(const Frame *f, const Local *local, const double g[6], double h[6][6], double total[36]) {
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 3; j++) for (int k = 0; k < 3; k++) h[i][3 + j] += h[i][k] * local->dv[j][k];
  }
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 3; j++) for (int k = 0; k < 3; k++) h[3 + j][i] += local->dv[j][k] * h[k][i];
  }
  for (int i = 0; i < 3; i++) {
    for (int j = i; j < 3; j++) {
      double bend[3], bent;
      cross(f->e[i], local->dv[j], bend);
      bent = g[0] * bend[0] + g[1] * bend[1] + g[2] * bend[2];
      h[3 + i][3 + j] += bent;
      if (i != j) h[3 + j][3 + i] += bent;
    }
  }
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) total[6 * i + j] += h[i][j];
}
