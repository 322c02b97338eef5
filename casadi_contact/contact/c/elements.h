/* The elastic foundation's elements under swept arcs, BLOCK at once: the formulas of contact/elements/loops.py, element
 * for element. surface: arcs, tube radius, centre z, then axis x, y, tube offset and end tangent x, y of each arc.
 * boxes: middle and the three half axes (vectors) of a box about each block's elements, BLOCK blocks together; members:
 * of each block c, n and area of its GROUP elements, one quantity after the other, filled up with elements of no area. */

#define GROUP 16
#define RAY_ITERATIONS 30
#define RAY_TOLERANCE_MM 1e-5
#define NEAREST_SURFACE 0.9
#define STEEPEST (-0.05)
#define LEAST_LENGTH 1e-12

typedef struct {
  const double *r, *t, *surface;
} Body;

/* Distance of points in the fixed frame from the body; its gradient there. */
INLINE Lanes distance_at(const Body *body, const Lanes point[3], Lanes gradient[3]) {
  const int arcs = (int)body->surface[0];
  const double *r = body->r, *last = body->surface + 3 + 5 * (arcs - 1);
  Lanes from[3], q[3], x = all(last[0]), y = all(last[1]), offset = all(last[2]), z, rho, out, distance, scale;
  for (int i = 0; i < 3; i++) from[i] = point[i] - body->t[i];
  for (int i = 0; i < 3; i++) q[i] = r[i] * from[0] + r[3 + i] * from[1] + r[6 + i] * from[2];
  for (int k = arcs - 2; k >= 0; k--) {
    const double *arc = body->surface + 3 + 5 * k;
    const Mask past = (q[0] - arc[0]) * arc[3] + (q[1] - arc[1]) * arc[4] > 0.0;
    x = pick(past, x, all(arc[0])), y = pick(past, y, all(arc[1])), offset = pick(past, offset, all(arc[2]));
  }
  x = q[0] - x, y = q[1] - y, z = q[2] - body->surface[2];
  rho = larger_of(root(x * x + y * y), all(LEAST_LENGTH));
  out = rho - offset;
  distance = larger_of(root(out * out + z * z), all(LEAST_LENGTH));
  scale = out / (distance * rho);
  x *= scale, y *= scale, z /= distance;
  for (int i = 0; i < 3; i++) gradient[i] = r[3 * i] * x + r[3 * i + 1] * y + r[3 * i + 2] * z;
  return distance - body->surface[1];
}

/* Elements that touch, gathered until there are HELD: c, n, area, and g at c. All lanes then have work, and those of
 * different elements do not wait for one another. */
#define HELD 64

typedef struct {
  int count;
  double of[8][HELD + BLOCK];
} Touching;

typedef struct {
  Lanes wrench[6], stiffness[6][6];
} Sums;

/* One step of Newton's method along each ray that is not yet within its tolerance; the gradient where it began. */
INLINE void step_along(const Body *body, const Lanes c[3], const Lanes n[3], Lanes g, Lanes *d, Lanes gradient[3],
                       Mask *active) {
  Lanes point[3], there[3], left, moved;
  for (int k = 0; k < 3; k++) point[k] = c[k] - *d * n[k];
  left = distance_at(body, point, there);
  moved = larger_of(*d + left / smaller_of(dot_of(there, n), all(STEEPEST)), -NEAREST_SURFACE * g);
  left = moved - *d;
  *d = pick(*active, moved, *d);
  for (int k = 0; k < 3; k++) gradient[k] = pick(*active, there[k], gradient[k]);
  *active &= larger_of(left, -left) >= RAY_TOLERANCE_MM;
}

INLINE void add_touching(const Body *body, Touching *held, int slopes, Sums *sums) {
  Lanes depth[HELD / BLOCK + 1], gradient[HELD / BLOCK + 1][3];
  Mask active[HELD / BLOCK + 1];
  const int groups = (held->count + BLOCK - 1) / BLOCK;
  int going = groups > 0;
  for (int i = held->count; i < groups * BLOCK; i++) { /* filled up with the last one, of no area */
    for (int k = 0; k < 8; k++) held->of[k][i] = k == 6 ? 0.0 : held->of[k][held->count - 1];
  }
  for (int j = 0; j < groups; j++) {
    depth[j] = -lanes_at(held->of[7] + j * BLOCK), active[j] = depth[j] > 0.0;
    memset(gradient[j], 0, sizeof gradient[j]);
  }
  for (int i = 0; i < RAY_ITERATIONS && going; i++) {
    going = 0;
    for (int j = 0; j < groups; j++) {
      Lanes c[3], n[3];
      for (int k = 0; k < 3; k++) {
        c[k] = lanes_at(held->of[k] + j * BLOCK), n[k] = lanes_at(held->of[3 + k] + j * BLOCK);
      }
      step_along(body, c, n, lanes_at(held->of[7] + j * BLOCK), depth + j, gradient[j], active + j);
      going |= any(active[j]);
    }
  }
  for (int j = 0; j < groups; j++) {
    const Lanes area = lanes_at(held->of[6] + j * BLOCK), d = depth[j], force = area * pressure_at(d);
    Lanes c[3], n[3], load[6];
    for (int k = 0; k < 3; k++) c[k] = lanes_at(held->of[k] + j * BLOCK), n[k] = lanes_at(held->of[3 + k] + j * BLOCK);
    twist_of(n, c, load); /* (n, c x n) */
    for (int k = 0; k < 6; k++) sums->wrench[k] -= force * load[k];
    if (slopes) {
      const Lanes scale = area * pressure_slope_at(d) / smaller_of(dot_of(gradient[j], n), all(STEEPEST));
      Lanes arm[3], slope[6];
      for (int k = 0; k < 3; k++) arm[k] = c[k] - d * n[k] - body->t[k];
      twist_of(gradient[j], arm, slope);
      for (int k = 0; k < 6; k++) slope[k] *= scale;
      for (int k = 0; k < 6; k++) for (int a = 0; a < 6; a++) sums->stiffness[k][a] += load[k] * slope[a];
    }
  }
  held->count = 0;
}

/* Those of a block's elements that lie inside the body. Where its tangent at the block's middle, of value `from` in the
 * fixed origin, leaves an element outside, so does the body, which is convex. */
INLINE void gather(const Body *body, const double *members, double from, const double tangent[3], Touching *held) {
  for (int e = 0; e < GROUP; e += BLOCK) {
    const Lanes area = lanes_at(members + 6 * GROUP + e);
    Lanes c[3], gradient[3], g;
    Mask inside;
    for (int k = 0; k < 3; k++) c[k] = lanes_at(members + k * GROUP + e);
    if (!any((from + tangent[0] * c[0] + tangent[1] * c[1] + tangent[2] * c[2] < 0.0) & (area > 0.0))) continue;
    g = distance_at(body, c, gradient);
    inside = (g < 0.0) & (area > 0.0);
    for (int l = 0; l < BLOCK; l++) {
      if (!inside[l]) continue;
      for (int k = 0; k < 7; k++) held->of[k][held->count] = members[k * GROUP + e + l];
      held->of[7][held->count++] = g[l];
    }
  }
}

INLINE void one_pose(const Body *body, long long blocks, const double *boxes, const double *members, int slopes,
                     Sums *sums) {
  Touching held;
  held.count = 0;
  memset(sums, 0, sizeof *sums);
  for (long long b = 0; b < blocks; b += BLOCK) {
    const double *box = boxes + 12 * b;
    Lanes middle[3], gradient[3], bound, from;
    for (int k = 0; k < 3; k++) middle[k] = lanes_at(box + k * BLOCK);
    bound = from = distance_at(body, middle, gradient);
    for (int k = 0; k < 3; k++) {
      Lanes axis[3], reach;
      for (int i = 0; i < 3; i++) axis[i] = lanes_at(box + (3 + 3 * k + i) * BLOCK);
      reach = dot_of(gradient, axis);
      from -= gradient[k] * middle[k];
      bound -= larger_of(reach, -reach);
    }
    if (!any(bound <= 0.0)) continue;
    for (int l = 0; l < BLOCK; l++) {
      const double tangent[3] = {gradient[0][l], gradient[1][l], gradient[2][l]};
      if (!(bound[l] <= 0.0)) continue;
      if (held.count > HELD - GROUP) add_touching(body, &held, slopes, sums);
      gather(body, members + (b + l) * 7 * GROUP, from[l], tangent, &held);
    }
  }
  add_touching(body, &held, slopes, sums);
}

void element_wrenches(long long n, const double *rotations, const double *translations, double *wrenches,
                             double *stiffnesses, const long long *blocks, const double *surface, const double *boxes,
                             const double *members) {
  for (long long i = 0; i < n; i++) {
    const Body body = {rotations + 9 * i, translations + 3 * i, surface};
    Sums sums;
    if (stiffnesses) one_pose(&body, *blocks, boxes, members, 1, &sums);
    else one_pose(&body, *blocks, boxes, members, 0, &sums);
    for (int k = 0; k < 6; k++) {
      wrenches[6 * i + k] = sum_of(sums.wrench[k]);
      for (int a = 0; stiffnesses && a < 6; a++) stiffnesses[36 * i + 6 * k + a] = sum_of(sums.stiffness[k][a]);
    }
  }
}
