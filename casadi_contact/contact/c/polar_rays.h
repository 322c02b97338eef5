/* Where polar quadrature puts its points: the formulas of contact/polar/rays.py. RAYS is a multiple of BLOCK. */
#define RAY_BLOCKS (RAYS / BLOCK)
#define ENDS (2 * RAY_BLOCKS * GAUSS) /* blocks of points */
#define FAR 1e3
#define FULL_TURN 6.283185307179586

typedef struct {
  Lanes edge[RAY_BLOCKS], junction[RAY_BLOCKS], du[RAY_BLOCKS], dv[RAY_BLOCKS];
  Lanes inside[RAY_BLOCKS]; /* 0 where the rim ends the ray, else 1 */
  int cut, broken;          /* the rim ends some ray; a junction lies on some ray */
} Plan;

typedef struct {
  int count; /* in blocks */
  Lanes u[ENDS], v[ENDS], weight[ENDS];
} Points;

INLINE Lanes rim_distance(const Surfaces *s, double u, double v, Lanes du, Lanes dv) {
  const Lanes along_v = larger_of((pick(dv > 0.0, all(s->v_high), all(s->v_low)) - v) / dv, all(0.0));
#if CURVED_RIM
  Lanes distance = along_v;
  for (int i = 0; i < 2; i++) {
    const double side = i ? s->spread : -s->spread, from_centre = u - side * s->offset;
    const Lanes a = du * du + side * side * dv * dv, b = du * from_centre + side * side * v * dv;
    const double c = from_centre * from_centre - side * side * (s->radius * s->radius - v * v);
    const Mask meets = s->rho_sign < 0.0 ? (b < 0.0) & (b * b > a * c) : (b == b);
    const Lanes there = (s->rho_sign * root(larger_of(b * b - a * c, all(0.0))) - b) / a;
    distance = pick(meets, smaller_of(distance, larger_of(there, all(0.0))), distance);
  }
  return distance;
#else
  return smaller_of(along_v, larger_of((pick(du > 0.0, all(s->u_high), all(s->u_low)) - u) / du, all(0.0)));
#endif
}

INLINE Lanes edge_of(Lanes depth, Lanes slope, Lanes curvature) {
  const Lanes k = larger_of(curvature, all(LEAST_CURVATURE));
  return (slope + root(slope * slope + 2.0 * k * depth)) / k;
}

/* Slope of the distance from the body along (du, dv) in the chart */
INLINE Lanes rise_of(const Ray *ray, Lanes du, Lanes dv) {
  return du * (ray->gradient[0] - ray->n_x * ray->gradient[1]) + dv * (ray->gradient[2] - ray->n_z * ray->gradient[1]);
}

/* The junctions at the start and at the end of the middle's arc: signed distance of the middle's ray end from them, its
 * rate along u and v, and how much more the body is curved along the arc beyond them. */
typedef struct {
  double at[2], rate[2][2], change[2];
} Junctions;

INLINE Junctions junctions_beside(const Surfaces *s, const Place *p, const Spot *m) {
  Junctions beside = {{0.0, 0.0}, {{0.0}}, {0.0, 0.0}};
  const Arc *here = s->arc + m->arc;
  const double from[3] = {m->end[0] - p->t[0], m->end[1] - p->t[1], m->end[2] - p->t[2]};
  double end[2], x, y, rho;
  turn_to_body(p, from, end);
  x = end[0] - here->axis_x, y = end[1] - here->axis_y;
  rho = sqrt(x * x + y * y);
  for (int e = 0; e < 2; e++) {
    const int k = m->arc + e - 1;
    const Arc *arc = s->arc + k;
    double normal[3];
    if (k < 0 || k >= ARCS - 1) continue;
    beside.at[e] = (end[0] - arc->axis_x) * arc->tangent_x + (end[1] - arc->axis_y) * arc->tangent_y;
    turn_to_chart(p, arc->tangent_x, arc->tangent_y, 0.0, normal);
    for (int i = 0; i < 2; i++) beside.rate[e][i] = dot3(m->tangent[i], normal);
    beside.change[e] = m->kappa * (rho / larger(rho + here[2 * e - 1].offset - here->offset, LEAST_LENGTH) - 1.0);
  }
  return beside;
}

/* Edges of a block of rays by Newton's method between a point within the body and one beyond it. */
FUNCTION void bracket_edges(const Surfaces *s, const Place *p, const Spot *m, Lanes du, Lanes dv, Lanes reach,
                            Lanes *edge) {
  Lanes low = all(0.0), high = reach;
  for (int i = 0; i < BRACKET_STEPS; i++) {
    Lanes moved;
    Ray ray;
    cast(s, p, m->u + *edge * du, m->v + *edge * dv, AT_START, &ray);
    low = pick(ray.g < 0.0, *edge, low), high = pick(ray.g < 0.0, high, *edge);
    moved = smaller_of(*edge - ray.g / larger_of(rise_of(&ray, du, dv), all(LEAST_RISE)), reach);
    *edge = pick((moved >= low) & (moved <= high), moved, 0.5 * (low + high));
  }
}

FUNCTION void plan_rays(const Surfaces *s, const Place *p, const Spot *m, Plan *plan) {
  const Lanes depth = all(m->depth);
  const double along[2] = {dot3(m->tangent[0], m->along), dot3(m->tangent[1], m->along)};
  const Junctions beside = junctions_beside(s, p, m);
  Lanes reach[RAY_BLOCKS];
  Mask far = all(0.0) > 0.0;
  for (int j = 0; j < RAY_BLOCKS; j++) {
    const Lanes du = m->scale[0] * lanes_at(ray_cos + j * BLOCK), dv = m->scale[1] * lanes_at(ray_sin + j * BLOCK);
    const Lanes slope = m->slope[0] * du + m->slope[1] * dv, turned = du * along[0] + dv * along[1];
    const Lanes form = m->curvature[0] * du * du + 2.0 * m->curvature[1] * du * dv + m->curvature[2] * dv * dv;
    const Lanes k = larger_of(form, all(LEAST_CURVATURE));
    Lanes nearest = all(FAR), more = all(0.0), edge = edge_of(depth, slope, k), left;
    for (int e = 0; e < (ARCS > 1 ? 2 : 0); e++) {
      /* where there is no junction this is 0/0, which is not closer */
      const Lanes distance = -beside.at[e] / (beside.rate[e][0] * du + beside.rate[e][1] * dv);
      const Mask closer = (distance > 0.0) & (distance < nearest);
      nearest = pick(closer, distance, nearest);
      more = pick(closer, all(beside.change[e]), more);
    }
    left = larger_of(depth + slope * nearest - 0.5 * k * nearest * nearest, all(0.0));
    left = nearest + edge_of(left, slope - k * nearest, k + more * turned * turned);
    reach[j] = rim_distance(s, m->u, m->v, du, dv);
    plan->du[j] = du, plan->dv[j] = dv, plan->junction[j] = nearest;
    plan->edge[j] = smaller_of(pick(nearest < edge, left, edge), reach[j]);
  }
  for (int i = 0; i < EDGE_STEPS; i++) { /* Newton's, of g = 0; blocks within: they do not wait for one another */
    for (int j = 0; j < RAY_BLOCKS; j++) {
      const Lanes edge = plan->edge[j];
      Lanes moved;
      Ray ray;
      cast(s, p, m->u + edge * plan->du[j], m->v + edge * plan->dv[j], AT_START, &ray);
      moved = edge - ray.g / larger_of(rise_of(&ray, plan->du[j], plan->dv[j]), all(LEAST_RISE));
      plan->edge[j] = smaller_of(smaller_of(larger_of(moved, 0.5 * edge), 2.0 * edge), reach[j]);
      if (i == EDGE_STEPS - 1) far |= size_of(plan->edge[j] - edge) > SETTLED * edge;
    }
  }
  if (any(far)) {
    for (int j = 0; j < RAY_BLOCKS; j++) bracket_edges(s, p, m, plan->du[j], plan->dv[j], reach[j], plan->edge + j);
  }
  plan->broken = plan->cut = 0;
  for (int j = 0; j < RAY_BLOCKS; j++) {
    plan->inside[j] = pick(plan->edge[j] < reach[j], all(1.0), all(0.0));
    plan->cut |= any(plan->edge[j] >= reach[j]);
    plan->broken |= any(plan->junction[j] < plan->edge[j]);
    plan->junction[j] = smaller_of(plan->junction[j], plan->edge[j]);
  }
}

/* Gauss points on the piece before the break of every ray, and on the piece after it where there is one. */
INLINE void place_points(const Spot *m, const Plan *plan, Points *points) {
  points->count = 0;
  for (int piece = 0; piece <= plan->broken; piece++) {
    for (int g = 0; g < GAUSS; g++) {
      for (int j = 0; j < RAY_BLOCKS; j++) {
        const Lanes length = piece ? plan->edge[j] - plan->junction[j] : plan->junction[j];
        const Lanes r = (piece ? plan->junction[j] : all(0.0)) + length * gauss_x[g];
        points->u[points->count] = m->u + r * plan->du[j];
        points->v[points->count] = m->v + r * plan->dv[j];
        points->weight[points->count++] = FULL_TURN / RAYS * gauss_w[g] * length * r;
      }
    }
  }
}
